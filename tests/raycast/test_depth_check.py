"""The limits of the independent check of rendered depth, instances and normals, on planes across the
view whose depth is known.
"""

import numpy as np
import pytest
from iclnuim.channels import INSTANCE, NORMAL
from iclnuim.formats.scene_model import SceneModel
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("embreex", reason="casts rays")
from iclnuim.raycast.caster import RayCaster  # noqa: E402
from iclnuim.raycast.depth_check import (  # noqa: E402
    GlassCaster,
    TruthCaster,
    compare_depth,
    depth_summary,
    rounding_m,
    truth_summary,
)

CAMERA = PinholeCamera(9, 9, 9.0, 9.0, 4.0, 4.0)
IDENTITY = SE3.identity()
FAR_M = 2.0


def plane(z_m, left_m=-9.0, right_m=9.0):
    """(2, 3, 3) corners of two triangles that face the camera."""
    a, b = (left_m, -9, z_m), (right_m, -9, z_m)
    c, d = (right_m, 9, z_m), (left_m, 9, z_m)
    return np.array([(a, c, b), (a, d, c)], float)


def edges(*planes):
    """(9, 9) whether a pixel is left out."""
    corners = np.concatenate(planes)
    caster = RayCaster(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    depth_z_m = caster.depth(CAMERA, IDENTITY)
    return np.isnan(compare_depth(depth_z_m, caster, CAMERA, IDENTITY))


@pytest.mark.parametrize(("offset_px", "is_edge"), [(0.07, True), (0.14, False)])
def test_a_pixel_is_on_an_edge_within_a_tenth_of_a_pixel(offset_px, is_edge):
    """The nearer plane begins beside the centres of the middle column."""
    found = edges(plane(FAR_M), plane(1.0, left_m=offset_px / 9))
    assert found[:, 4].all() == is_edge and not found[:, [0, 1, 2, 3, 5, 6, 7, 8]].any()


@pytest.mark.parametrize(("share", "is_edge"), [(0.7e-4, False), (1.5e-4, True)])
def test_an_edge_is_a_step_of_a_ten_thousandth_of_depth(share, is_edge):
    found = edges(plane(FAR_M), plane(FAR_M * (1 - share), left_m=0.05 / 9 * FAR_M))
    assert found[:, 4].all() == is_edge


def model(*planes):
    """Planes as instances 1, 2 ..., with normals towards the camera."""
    corners = np.concatenate(planes)
    count = len(corners)
    normals = np.broadcast_to([0.0, 0.0, -1.0], (count, 3, 3))
    instance = np.repeat(np.arange(len(planes)), 2) + 1
    return SceneModel(corners, normals, np.zeros((count, 3, 2)), np.zeros(count, int), instance)


def frame(depth_m, instance):
    channels = {"Z": np.full((9, 9), depth_m), INSTANCE: np.full((9, 9), instance)}
    return channels | {name: np.full((9, 9), v) for name, v in zip(NORMAL, (0, 0, -1), strict=True)}


@pytest.mark.parametrize(("apart_m", "is_outline"), [(0.7e-4, False), (1.5e-4, True)])
def test_depths_a_tenth_of_a_millimetre_apart_are_an_outline(apart_m, is_outline):
    caster = TruthCaster(model(plane(FAR_M)))
    found = truth_summary([caster.compare(frame(FAR_M + apart_m, 1), CAMERA, IDENTITY)])
    assert found.outline_share == is_outline


@pytest.mark.parametrize(("share", "coincides"), [(0.7e-5, True), (1.5e-5, False)])
def test_surfaces_within_a_hundred_thousandth_of_depth_coincide(share, coincides):
    """The frame shows the one that is a little farther away."""
    caster = TruthCaster(model(plane(FAR_M), plane(FAR_M * (1 + share))))
    found = truth_summary([caster.compare(frame(FAR_M, 2), CAMERA, IDENTITY)])
    assert found.coincident_share == coincides
    if not coincides:
        assert found.equal_instance_share == 0


def test_normals_are_promised_to_a_tenth_of_a_degree():
    degrees = np.array([0.07, 0.15, 0.04, 0.3])
    found = truth_summary([(np.ones(4, bool), degrees, np.array([4, 0, 0]))])
    assert found.normal_within_share == 0.5


@pytest.mark.parametrize("holes", [False, True])
def test_a_pane_is_looked_through_or_is_a_hole(holes):
    """In the left half of the image, before a wall that is farther away to the right and below."""
    wall = plane(FAR_M)
    wall[..., 2] += 0.1 * wall[..., 0] + 0.05 * wall[..., 1]
    pane = np.concatenate([wall, plane(1.0, right_m=0.0)])
    surface, behind = (
        RayCaster(p.reshape(-1, 3), np.arange(3 * len(p)).reshape(-1, 3)) for p in (pane, wall)
    )
    expected = behind.depth(CAMERA, IDENTITY)
    assert (np.diff(expected) > 0).all() and (np.diff(expected, axis=0) > 0).all()
    expected[:, :5] *= not holes
    assert (GlassCaster(surface, behind, holes).depth(CAMERA, IDENTITY) == expected).all()


@pytest.mark.parametrize("distance_m", [0.5, 27.0, 3000.0])
def test_depth_that_float32_rounds_is_right_and_other_depth_is_not(distance_m):
    """Depth as a chain of five operations in float32 gives it, each of which rounds by half a step;
    beyond 2 km the steps are larger than 0.1 mm.
    """
    rng = np.random.default_rng(0)
    exact = distance_m * (1 + 0.2 * rng.random((50, 60)))
    shift = distance_m * rng.random((50, 60))
    rounded = ((exact - shift).astype(np.float32) + shift.astype(np.float32)) * np.float32(1 / 3)
    error_m = (rounded * np.float32(3)).astype(float) - exact
    assert depth_summary([error_m], [exact]).within_01mm_share == 1.0
    assert np.median(np.abs(error_m)) < rounding_m(np.median(exact))
    off = depth_summary([error_m + 1.5e-4 + 2 * rounding_m(exact)], [exact])
    assert off.within_01mm_share == 0.0
