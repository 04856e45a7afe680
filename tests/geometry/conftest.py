"""Rotation vectors and twists where formulas break as well as where they do not."""

import numpy as np
import pytest

COUNT = 1000
#: Distances from 0 and from pi, decades down to where doubles end.
TINY = 10.0 ** np.linspace(-14, -2, COUNT)


def directions(rng: np.random.Generator, count: int = COUNT) -> np.ndarray:
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def rotation_vectors_of(kind: str) -> np.ndarray:
    """(COUNT, 3), radians: uniform over the group, normal in the tangent space, near identity, near
    half a turn.
    """
    rng = np.random.default_rng([2, len(kind)])
    if kind == "uniform":
        quat = rng.normal(size=(COUNT, 4))
        quat /= np.linalg.norm(quat, axis=1, keepdims=True)
        angle = 2 * np.arctan2(np.linalg.norm(quat[:, :3], axis=1), np.abs(quat[:, 3]))
    elif kind == "tangent":
        angle = np.minimum(np.abs(rng.normal(size=COUNT)), 3.1)
    elif kind == "near identity":
        angle = TINY
    else:
        angle = np.pi - TINY
    return directions(rng) * angle[:, None]


@pytest.fixture(params=["uniform", "tangent", "near identity", "near pi"])
def rotation_vectors(request: pytest.FixtureRequest) -> np.ndarray:
    return rotation_vectors_of(request.param)


@pytest.fixture
def twists(rotation_vectors: np.ndarray) -> np.ndarray:
    """(COUNT, 6): translational part first, metres; rotation vector last, radians."""
    rng = np.random.default_rng(3)
    return np.concatenate([rng.normal(size=(COUNT, 3)) * 3, rotation_vectors], axis=1)
