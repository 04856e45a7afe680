"""A wandering path and an estimate of it, for the tests of errors."""

import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

sys.path.insert(0, str(Path(__file__).parent))
from paired_poses import Pairs  # noqa: E402


@pytest.fixture(scope="session")
def wander():
    """wander(seed, noise, n): paired poses of a random walk; the estimate is moved as a whole and
    noisy by pose.
    """

    def make(seed, noise=0.05, n=None, rate_hz=30.0):
        rng = np.random.default_rng(seed)
        n = n or int(rng.integers(12, 40))
        truth = SE3.exp(np.cumsum(rng.normal(0, 0.1, (n, 6)), axis=0))
        estimate = SE3.exp(rng.normal(size=6)) @ truth @ SE3.exp(rng.normal(0, noise, (n, 6)))
        return Pairs.of_poses(truth, estimate, rate_hz)

    return make
