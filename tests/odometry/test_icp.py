"""ICP on textured and bare planes, clean and noisy."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.icp import Icp  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Status  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from iclnuim.benchmark.odometry.solver import MAX_SIGMA_M  # noqa: E402
from odometry_scenes import BIG, CAMERA, ROOM, WALL, run, view  # noqa: E402


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_a_bare_wall_is_flagged_with_and_without_noise_and_a_room_is_not(noise):
    wall = run("icp", [view(i, WALL, noise) for i in range(6)])
    room = run("icp", [view(i, ROOM, noise) for i in range(6)])
    assert all(
        f.result.status is Status.DEGENERATE and f.result.under_constrained >= 3 for f in wall[1:]
    )
    assert not any(f.result.status is Status.DEGENERATE for f in room[1:])


@pytest.mark.parametrize(
    ("side", "floor", "expected"),
    [(0.43, 0.63, Status.DEGENERATE), (0.45, 0.66, Status.OK)],
    ids=["border", "more"],
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
    assert (
        result.largest_sigma_m < MAX_SIGMA_M and result.under_constrained == 0
    )  # no other rule flags it


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
    assert off.status is Status.OK
    assert np.abs(off.T_reference_camera.matrix - good.T_reference_camera.matrix).max() < 1e-4
