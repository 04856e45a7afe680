"""The geometric term that checks a motion."""

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.photometric import Dvo  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame, OdometryResult, Status  # noqa: E402
from iclnuim.benchmark.odometry.terms.depth import DepthTerm  # noqa: E402
from iclnuim.benchmark.odometry.terms.free_depth import scale_ambiguity  # noqa: E402
from odometry_scenes import BIG, ROOM, STEP, after, error_m, run, view  # noqa: E402


def test_a_motion_that_depth_contradicts_is_as_uncertain_as_it_is_off():
    """A motion with a stated deviation of 0.1 mm: unchanged if it is correct; if it is 4 mm off,
    the enlarged uncertainty covers its error.
    """
    levels = [Dvo(Dvo.PRESETS["best"]).prepare(view(i, ROOM, 0.001, BIG), BIG)[1] for i in range(2)]
    for off_m in (0.0, 0.004):
        error = np.array([off_m, 0, 0, 0, 0, 0])
        depth, T = DepthTerm(*levels), SE3.exp(error) @ STEP
        depth.linearise(T)
        result = depth.checked(OdometryResult(T, information=1e8 * np.eye(6), largest_sigma_m=1e-4))
        assert (
            result.information[0, 0] > 5e7
            if off_m == 0
            else error @ result.information @ error / 6 < 3
        )


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_intensities_that_move_against_depth_are_reported_and_depth_wins(name):
    frames = [view(i, ROOM, camera=BIG) for i in range(3)]
    still = [Frame.of(frames[0].grey, f.depth_z_m, f.stamp_s) for f in frames]
    found = run(name, still, BIG)
    assert found[-1].result.status is Status.DEGENERATE and found[-1].result.reason.startswith(
        "depth: disagrees"
    )
    assert error_m(found) < 0.2 * np.linalg.norm(after(2).translation)


def test_exact_depth_of_a_plane_observes_scale_across_it_and_none_along_it():
    rng = np.random.default_rng(1)
    for scale in (1e4, 1e7, 1e10):  # up to 1e14, where rounding is above 0.01
        for normal in rng.standard_normal((50, 3)):
            normal /= np.linalg.norm(normal)
            points = rng.uniform(-1, 1, (5_000, 3))
            points += (2 - points @ normal)[:, None] * normal
            rows = np.c_[np.tile(normal, (5_000, 1)), np.cross(points, normal)]
            exact = NormalEquations(scale * rows.T @ rows, np.zeros(6), 0.0, 1.0, np.zeros(3), 1.0)
            along = np.cross(normal, [0.0, 0.0, 1.0])
            assert 0.99 < scale_ambiguity(exact, 0.01 * along) <= 1, scale
            assert 0 <= scale_ambiguity(exact, 0.01 * normal) < 0.1, scale
