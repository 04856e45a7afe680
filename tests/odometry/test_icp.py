"""ICP on textured and bare planes, clean and noisy."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry import icp  # noqa: E402
from iclnuim.benchmark.odometry.icp import Icp, estimate_rotation  # noqa: E402
from iclnuim.benchmark.odometry.levels import Level, Pair  # noqa: E402
from iclnuim.benchmark.odometry.protocol import OdometryStatus  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from iclnuim.benchmark.odometry.solver import MAX_SIGMA_M  # noqa: E402
from iclnuim.benchmark.odometry.terms.plane import PlaneTerm  # noqa: E402
from odometry_scenes import BIG, CAMERA, ROOM, STEP, VGA, WALL, run, view  # noqa: E402


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_a_bare_wall_is_flagged_with_and_without_noise_and_a_room_is_not(noise):
    wall = run("icp", [view(i, WALL, noise) for i in range(6)])
    room = run("icp", [view(i, ROOM, noise) for i in range(6)])
    assert all(
        f.result.status is OdometryStatus.DEGENERATE and f.result.under_constrained >= 3
        for f in wall[1:]
    )
    assert not any(f.result.status is OdometryStatus.DEGENERATE for f in room[1:])


@pytest.mark.parametrize(
    ("side", "floor", "expected"),
    [
        (0.43, 0.63, OdometryStatus.DEGENERATE),
        (0.437, 0.64, OdometryStatus.OK),
        (0.45, 0.66, OdometryStatus.OK),
    ],
    ids=["border", "a little more", "more"],
)
def test_a_motion_that_rests_on_the_last_border_of_two_faces_is_flagged_on_noisy_frames(
    side, floor, expected
):
    """A wall, and at the image's border a few pixels of a face to the side and one below, which set
    the motion along the wall.
    """
    planes = (WALL[0], (np.sqrt(1 - side**2), 0.0, side), (0.0, np.sqrt(1 - floor**2), floor))
    result = run("icp", [view(i, planes, 0.001, BIG) for i in range(2)], BIG)[1].result
    assert result.status is expected
    # no other rule flags it
    assert result.largest_sigma_m < MAX_SIGMA_M and result.under_constrained == 0


def test_noise_fakes_constraint_for_one_normal_and_not_for_two():
    frames = [view(i, WALL, 0.003) for i in range(3)]
    two = run("icp", frames)[-1].result.smallest_eigenvalue
    one = run(Icp(replace(Icp.PRESETS["paper"], bilateral=False)), frames)[
        -1
    ].result.smallest_eigenvalue
    assert two < 0.25 * one


@pytest.mark.parametrize("name", ["icp", "icp_rgbd"])
def test_a_first_guess_ten_degrees_off_ends_where_a_good_one_does(name):
    method, rotation = odometer(name), SE3.exp(np.array([0, 0, 0, 0.1, -0.12, 0.08]))
    one, other = (method.prepare(view(i, ROOM), CAMERA) for i in range(2))
    good, off = (method.align(one, other, guess) for guess in (SE3.identity(), rotation))
    assert off.status is OdometryStatus.OK
    assert np.abs(off.T_reference_camera.matrix - good.T_reference_camera.matrix).max() < 1e-4


@pytest.mark.parametrize(("noise", "rough"), [(0.0006, False), (0.00085, True)])
def test_depth_is_a_sensors_from_a_millimetre_of_noise_on(noise, rough):
    """Of 2 m depth, in a quarter of a VGA image; a renderer's is exact to a tenth of it."""
    levels = odometer("icp").prepare(view(0, ROOM, noise, BIG), BIG)
    assert levels[0].rough is rough
    assert levels[0].normal_step == (3 if rough else 1)


class Counting(Icp):
    """Counts the alignments of a frame."""

    count = 0

    def planes(self, pair, guess):
        self.count += 1
        return super().planes(pair, guess)


@pytest.mark.parametrize(("off_deg", "alignments"), [(0.5, 1), (1.0, 2)])
def test_a_guess_is_poor_where_the_surfaces_are_centimetres_apart(off_deg, alignments):
    """11 mm, as after a usual prediction, and 22 mm."""
    method = Counting(Icp.PRESETS["best"])
    one, other = (method.prepare(view(i, ROOM, camera=BIG), BIG) for i in range(2))
    off = SE3.exp(np.array([0, 0, 0, 0, np.radians(off_deg), 0]))
    assert method.align(one, other, STEP @ off).status is OdometryStatus.OK
    assert method.count == alignments


@pytest.mark.parametrize(
    ("tilt", "expected"), [(0.6, OdometryStatus.DEGENERATE), (1.0, OdometryStatus.OK)]
)
def test_a_flat_niche_is_degenerate_and_a_deep_one_is_not(tilt, expected):
    """Three faces that lean by `tilt` from the wall."""
    planes = ((tilt, 0, 1), (-tilt, tilt / 2, 1), (0, -tilt, 1))
    method = Icp(replace(Icp.PRESETS["paper"], bilateral=False))
    result = run(method, [view(i, planes, camera=BIG) for i in range(2)], BIG)[1].result
    assert result.status is expected


def test_a_guess_half_a_right_angle_off_is_turned_back_by_planes():
    """35 degrees; all surfaces are seen at once, at a distance of metres."""
    method = odometer("icp")
    pair = Pair(*(method.prepare(view(i, ROOM, camera=BIG), BIG) for i in range(2)))
    for axis in (*np.eye(3), *-np.eye(3)):
        guess = STEP @ SE3.exp(np.r_[0, 0, 0, np.radians(35) * axis])
        found = STEP.inverse() @ estimate_rotation(pair, method.settings, guess)
        assert np.abs(found.log()[3:]).max() < np.radians(1.5)


def test_a_guess_a_right_angle_s_half_off_is_turned_back_though_many_surfaces_mismatch():
    """45 degrees, about the two axes and in the senses in which the corner has a minimum there."""
    method = odometer("icp")
    pair = Pair(*(method.prepare(view(i, ROOM, camera=BIG), BIG) for i in range(2)))
    for axis in (np.eye(3)[0], -np.eye(3)[0], -np.eye(3)[1]):
        guess = STEP @ SE3.exp(np.r_[0, 0, 0, np.radians(45) * axis])
        found = STEP.inverse() @ estimate_rotation(pair, method.settings, guess)
        assert np.abs(found.log()[3:]).max() < np.radians(1.5)


def test_a_guess_that_is_turned_by_twenty_degrees_is_turned_back_in_a_room_twice_as_large():
    """Surfaces 4 to 8 m away are a metre and more from where the guess has them."""
    method, frame = odometer("icp"), view(0, ROOM, camera=BIG)
    levels = method.prepare(replace(frame, depth_z_m=2 * frame.depth_z_m), BIG)
    for axis in (*np.eye(3), *-np.eye(3)):
        guess = SE3.exp(np.r_[0, 0, 0, np.radians(20) * axis])
        found = estimate_rotation(Pair(levels, levels), method.settings, guess)
        assert np.abs(found.log()[3:]).max() < np.radians(1.5)


@pytest.mark.parametrize(("angle_deg", "matched"), [(21, True), (42, False)])
def test_normals_of_noisy_depth_match_to_thirty_degrees(angle_deg, matched):
    """A page at 20 cm, turned about its middle: all of its points stay near. On exact depth normals
    twelve degrees apart are of two surfaces.
    """
    grey, z_m = np.full((120, 160), 100, np.float32), np.full((120, 160), 0.2, np.float32)
    method, about = odometer("icp"), SE3(np.eye(3), [0, 0, 0.2])
    turn = about @ SE3.exp(np.array([0, 0, 0, 0, np.radians(angle_deg), 0])) @ about.inverse()
    for rough in (True, False):
        levels = [Level(grey, z_m, CAMERA, rough=rough)]
        pair = Pair(levels, levels)
        term = PlaneTerm(pair, method.plane_settings(pair), 0)
        term.linearise(turn, 0)
        assert np.isfinite(term.residual).any() == (matched and rough)


def along_a_wall(rough, relief):
    """The information along a wall, as a share of that across it, in units of the variance of the
    noise of its normals: each image has its own noise, and both have a common relief, of `relief`
    times that variance.
    """
    rng = np.random.default_rng(4)
    noise = 0.03
    levels = []
    common = np.sqrt(relief) * noise * rng.normal(size=(CAMERA.height, CAMERA.width, 2))
    for _ in range(2):
        slopes = common + noise * rng.normal(size=common.shape)
        normals = np.concatenate([slopes, -np.ones((*slopes.shape[:2], 1))], axis=2)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        depth = np.full(common.shape[:2], 2.0, np.float32)
        levels.append(Level(np.zeros_like(depth), depth, CAMERA, rough=rough))
        levels[-1].__dict__["normals"] = normals.astype(np.float32)
    pair = Pair(levels[:1], levels[1:])
    term = PlaneTerm(pair, odometer("icp").plane_settings(pair), 0)
    A = term.linearise(SE3.identity(), 0).A
    return A[0, 0] / A[2, 2] / noise**2


@pytest.mark.parametrize(
    ("rough", "noise", "relief"), [(False, 1.5, 3.0), (True, 0.4, 1.0)], ids=["exact", "noisy"]
)
def test_normals_that_agree_by_chance_are_no_relief_and_relief_is_known(rough, noise, relief):
    """Steps of depth at the same pixels are common to both images. On exact depth as much as the
    normals disagree can be, on a sensor's, whose noise changes, little of it.
    """
    assert along_a_wall(rough, noise) < 0.05
    assert along_a_wall(rough, relief) > 0.25


@pytest.mark.parametrize("name", ["icp", "icp_rgbd"])
def test_a_rotation_after_a_poor_guess_is_estimated_from_a_few_thousand_points(name, monkeypatch):
    """Of a VGA image: its iterations, up to twenty, cost less than those of the alignment."""
    terms = []

    class Counted(PlaneTerm):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            terms.append(self)

    monkeypatch.setattr(icp, "PlaneTerm", Counted)
    method = odometer(name)
    levels = method.prepare(view(0, ROOM, camera=VGA), VGA)
    guess = SE3.exp(np.array([0, 0, 0, 0, np.radians(10), 0]))
    found = estimate_rotation(Pair(levels, levels), method.settings, guess)
    assert np.abs(found.log()[3:]).max() < np.radians(0.5)
    assert 3000 < terms[0].pixels < 8000
