"""Gauss-Newton over several passes."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Status  # noqa: E402
from iclnuim.benchmark.odometry.solver import Limits, Pass, Stop, solve  # noqa: E402


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
        return solve(passes, SE3.identity(), Limits())

    assert result(empty, term).T_reference_camera.translation == pytest.approx([1e-3, 0, 0])
    assert result(term, empty).status is Status.FAILED
