"""The scale along the path: planted scales are found, and no similarity changes the drift."""

import numpy as np
import pytest
from iclnuim import SE3
from iclnuim.evaluation.scale_drift import scale_drift


@pytest.fixture
def path():
    t = np.linspace(0, 6, 500)
    return np.stack([3 * np.cos(t), 2 * np.sin(2 * t), 0.5 * t], 1)


def drifting(path, scales):
    """The path whose steps are divided by scales (n,)."""
    steps = np.diff(path, axis=0) / scales[1:, None]
    return np.concatenate([path[:1], path[:1] + np.cumsum(steps, axis=0)])


def test_a_constant_scale_does_not_drift(path):
    found = scale_drift(path, path / 2.5)
    assert np.allclose(found.scales, 2.5, rtol=1e-12) and len(found.scales) == 10
    assert abs(found.change) < 1e-12


def test_a_planted_drift_is_found(path):
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    planted = 2 * (1 + 0.3 * along / along[-1])
    found = scale_drift(path, drifting(path, planted))
    centres = 2 * (1 + 0.3 * (np.arange(10) + 0.5) / 10)
    assert np.allclose(found.scales, centres, rtol=2e-3)
    assert found.change == pytest.approx(centres[-1] / centres[0] - 1, rel=0.02)
    assert "+26" in str(found)


def test_no_similarity_of_the_estimate_changes_the_drift(path):
    estimate = drifting(path, np.linspace(1, 1.2, 500))
    T = SE3.exp(np.array([1.0, -2.0, 0.5, 0.3, 1.5, -0.4]))
    first = scale_drift(path, estimate)
    moved = scale_drift(path, T.apply(3 * estimate))
    assert np.allclose(np.array(moved.scales) * 3, first.scales, rtol=1e-12)
    assert moved.change == pytest.approx(first.change)


def test_a_camera_that_does_not_move_has_no_scale():
    still = np.zeros((50, 3))
    assert scale_drift(still, still) is None
    assert scale_drift(np.eye(3)[:2], np.eye(3)[:2]) is None
