"""How certain a motion is, by what blocks of the image say of it (the delete-a-group jackknife), and how noisy normals are."""

import math
from dataclasses import replace

import numpy as np

from .solver import RANK_TOLERANCE, SYMMETRIC, System

#: Blocks of the image, each to err by itself; errors reach farther than pixels, tiles or textures, and less far than these.
ACROSS, DOWN = 4, 3
#: Disagreement of normals (1 - cosine) that is not yet noise: steps of 0.2 mm make less.
MIN_NOISE = 1e-4


def disagreement(cosines: np.ndarray) -> float:
    """Noise of the normals of two images, from cosines (n,) between those of one place: 1 - cosine in the mean, from the median,
    as true normals differ by more at edges."""
    mean = (1.0 - float(np.median(cosines))) / math.log(2.0) if len(cosines) else 0.0
    return max(mean - MIN_NOISE, 0.0)


def informed(system: System, sums: np.ndarray, nu: float) -> System:
    """A and b as information (1 / variance), of `system` from kernels.block_sums() (blocks, 34) with weights of `nu`.

    The variance is that of the motions found with one block left out in turn (the delete-a-group jackknife), along each
    eigenvector of the centred A, and at least that of pixels that err each by itself. The information of Student's t is
    (nu + 1) / (nu + 3) of what its weights add up to.
    """
    own, G = system.centred()
    values, vectors = np.linalg.eigh(own)
    A, b = G @ sums.take(SYMMETRIC, axis=1) @ G.T, sums[:, 21:27] @ G.T
    total, all_b = A.sum(axis=0), b.sum(axis=0)
    total += np.eye(6) * (1e-6 * np.trace(total) + 1e-12)  # of a bare wall some directions are not known
    steps = np.linalg.solve(total - A, (all_b - b)[..., None])[..., 0] - np.linalg.solve(total, all_b)
    known = values > RANK_TOLERANCE * max(values[-1], 1e-30)
    error = max(system.error, 1e-12)
    spread = np.square(steps @ total @ vectors).sum(axis=0) / np.where(known, values * error, np.inf)
    spread = np.maximum(spread * (((nu + 3) / (nu + 1)) ** 2 if nu > 0 else 1.0), 1.0)
    back, right = np.linalg.solve(G, vectors), vectors.T @ (G @ system.b)
    weights = known / (spread * error)
    return replace(system, A=(back * (weights * values)) @ back.T, b=back @ (weights * right), informed=True)
