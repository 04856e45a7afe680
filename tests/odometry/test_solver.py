"""Gauss-Newton over several passes."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.protocol import OdometryStatus  # noqa: E402
from iclnuim.benchmark.odometry.solver import Pass, SolverLimits, Stop, solve  # noqa: E402


class Once:
    """A term that is at its minimum after one step."""

    pixels = 1000

    def __init__(self, equations):
        self.equations = equations

    def linearise(self, T, iteration):
        return replace(self.equations, b=self.equations.b * (iteration == 0))


def test_a_coarse_level_without_overlap_is_left_out_and_the_finest_is_not():
    """Holes may leave a coarse level without normals; every frame was lost then."""
    term = NormalEquations(np.eye(6) * 1e6, np.eye(6)[0] * 1e3, 1.0, 500, np.zeros(3), 1.0)
    empty = replace(term, count=0)

    def result(*systems):
        passes = [Pass(Once(s), 3, Stop()) for s in systems]
        return solve(passes, SE3.identity(), SolverLimits())

    assert result(empty, term).T_reference_camera.translation == pytest.approx([1e-3, 0, 0])
    assert result(term, empty).status is OdometryStatus.FAILED


def aligned(step_m=1e-3, sigma_m=1e-3):
    """The result where all directions have the standard deviation sigma_m."""
    A = np.eye(6) / sigma_m**2
    term = NormalEquations(
        A, A[0] * step_m, 1.0, 500, np.zeros(3), length_m=1.0, is_information=True
    )
    return solve([Pass(Once(term), 3, Stop())], SE3.identity(), SolverLimits())


def test_a_motion_that_no_hand_makes_in_a_frame_is_a_failure():
    """0.3 m in a thirtieth of a second are 9 m/s."""
    assert aligned(step_m=0.2).status is OdometryStatus.OK
    failed = aligned(step_m=0.4)
    assert failed.status is OdometryStatus.FAILED and failed.reason.startswith("step: 0.400 m")


def test_a_motion_that_is_uncertain_by_millimetres_is_degenerate():
    assert aligned(sigma_m=0.002).status is OdometryStatus.OK
    assert aligned(sigma_m=0.004).status is OdometryStatus.DEGENERATE


@pytest.mark.parametrize(
    ("count", "status"), [(14, OdometryStatus.FAILED), (28, OdometryStatus.OK)]
)
def test_a_fiftieth_of_the_pixels_has_to_match(count, status):
    term = NormalEquations(np.eye(6), np.zeros(6), 1.0, count, np.zeros(3), 1.0)
    assert solve([Pass(Once(term), 3, Stop())], SE3.identity(), SolverLimits()).status is status
