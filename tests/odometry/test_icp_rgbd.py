"""Planes and grey values together."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.icp_rgbd import (  # noqa: E402
    component_errors,
    is_biased,
    length_error,
)
from iclnuim.benchmark.odometry.levels import Pair  # noqa: E402
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame, OdometryStatus  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from odometry_scenes import BIG, ROOM, STEP, WALL, error_m, run, view  # noqa: E402


@pytest.mark.parametrize(("rendered", "calibrated"), [(False, False), (True, False), (False, True)])
def test_planes_of_a_sensor_are_biased_unless_its_offset_is_known_or_they_are_of_a_model(
    rendered, calibrated
):
    method = odometer("icp_rgbd")
    frames = (replace(view(i, ROOM, 0.003, BIG), calibrated=calibrated) for i in range(2))
    one, two = (method.prepare(frame, BIG) for frame in frames)
    pair = Pair([replace(level, rendered=rendered) for level in one], two)
    assert pair.rough and is_biased(pair) is not (rendered or calibrated)
    result = method.align(*pair, SE3.identity())
    assert np.linalg.norm((STEP.inverse() @ result.T_reference_camera).translation) < 0.002


def test_a_noisy_frame_with_a_few_pixels_of_contrast_is_tracked():
    """Planes have points everywhere, but few pixels of a wall have contrast: with the planes' share
    such a frame was lost, and a wrong motion followed.
    """
    method, frames = odometer("icp_rgbd"), [view(i, ROOM, 0.003, BIG) for i in range(2)]
    share = method.settings.limits.min_inliers / 3
    size = (int(np.sqrt(share) * BIG.width), int(np.sqrt(share) * BIG.height))
    for frame in frames:
        patch = frame.grey[100 : 100 + size[1], 140 : 140 + size[0]].copy()
        frame.grey[:, :] = 128
        frame.grey[100 : 100 + size[1], 140 : 140 + size[0]] = patch
    one, two = (method.prepare(frame, BIG) for frame in frames)
    result = method.align(one, two, SE3.identity())
    assert result.status is not OdometryStatus.FAILED, result.reason
    assert np.linalg.norm((STEP.inverse() @ result.T_reference_camera).translation) < 0.005


def test_a_known_offset_is_removed():
    """The offset shortens the motion, and all pixels agree on it."""
    offset = 0.01
    frames = [view(i, ROOM, camera=BIG) for i in range(2)]
    shifted = [replace(f, depth_z_m=f.depth_z_m / (1 + offset * f.depth_z_m)) for f in frames]
    known = [Frame.of(f.grey, f.depth_z_m, f.stamp_s, depth_offset=offset) for f in shifted]
    assert np.allclose(known[1].depth_z_m, frames[1].depth_z_m, rtol=1e-5) and known[1].calibrated
    steps = [run("icp_rgbd", pair, BIG)[-1].result.T_reference_camera for pair in (shifted, known)]
    errors = [np.linalg.norm((STEP.inverse() @ step).log()) for step in steps]
    assert errors[1] < 0.1 * errors[0]


def test_with_a_known_offset_icp_rgbd_is_as_accurate_as_the_better_one_of_its_parts():
    def rms_m(name):
        method, errors = odometer(name), []
        for i in range(0, 30, 3):
            pair = (replace(view(k, ROOM, 0.001, BIG), calibrated=True) for k in (i, i + 1))
            found = method.align(*(method.prepare(frame, BIG) for frame in pair), SE3.identity())
            errors.append((STEP.inverse() @ found.T_reference_camera).translation)
        return np.sqrt(np.mean(np.square(errors)))

    assert rms_m("icp_rgbd") < min(rms_m("icp"), rms_m("rgbd"))


def beside_the_camera(i):
    """A corner with little contrast, and in the middle tenth of the view a textured object that
    keeps its distance of 1 m from the camera.
    """
    corner, (x, y, _) = view(i, ROOM, camera=BIG), np.moveaxis(BIG.rays(), -1, 0)
    near = np.maximum(abs(x) * BIG.fx / BIG.width, abs(y) * BIG.fy / BIG.height) < np.sqrt(0.1) / 2
    texture = 128 + 60 * np.sin(40 * x) * np.sin(50 * y) + 40 * np.sin(90 * x + 20 * y)
    grey, depth = (
        np.where(near, texture, 90 + 0.3 * corner.grey),
        np.where(near, 1, corner.depth_z_m),
    )
    return Frame.of(np.round(grey), np.round(depth * 5000) / 5000, i / 30)


def test_an_object_that_moves_along_does_not_outvote_the_planes_with_its_texture():
    """Most of the contrast is on the object.

    Blocks of the image disagree about the motion, and planes decide.
    """
    found = run("icp_rgbd", [beside_the_camera(i) for i in range(6)], BIG)
    assert error_m(found) < 0.002


@pytest.mark.parametrize("bare", ["light", "geometry"])
def test_the_joint_odometer_holds_on_to_the_part_that_knows(bare):
    frames = [view(i, WALL if bare == "geometry" else ROOM) for i in range(6)]
    if bare == "light":
        frames = [Frame.of(f.grey * 0 + 128, f.depth_z_m, f.stamp_s) for f in frames]
    assert error_m(run("icp_rgbd", frames)) < 0.003


def test_the_slip_of_2013_changes_the_path():
    frames = [view(i, ROOM) for i in range(3)]
    paper, slip = (
        run(odometer("icp_rgbd", preset), frames)[-1].T_world_camera.matrix
        for preset in ("paper", "kintinuous2013")
    )
    assert np.abs(paper - slip).max() > 1e-6


@pytest.mark.parametrize(("errors", "turned"), [(component_errors, True), (length_error, False)])
def test_planes_of_noisy_frames_know_a_motion_to_a_tenth(errors, turned):
    """However many points they have: noise shortens all of their motions alike."""
    T = SE3.exp(np.array([0.04, 0, 0.03, 0, 0.02, 0]))
    certain = NormalEquations.of_information(1e12 * np.eye(6)).with_error(errors(T))
    deviation = np.sqrt(np.diag(np.linalg.inv(certain.A)))
    length_m = np.linalg.norm(T.translation)
    along = np.hypot(deviation[0], deviation[2]) if not turned else deviation[0]
    assert 0.07 < along / length_m < 0.14
    assert (0.0014 < deviation[4] < 0.0028) == turned
