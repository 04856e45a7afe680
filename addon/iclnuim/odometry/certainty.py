"""Uncertainty of a motion, from blocks of the image (delete-a-group jackknife), and noise of surface normals."""

import math
from dataclasses import replace

import numpy as np

from .solver import RANK_TOLERANCE, SYMMETRIC, System

#: Blocks of the image (columns, rows). Errors are correlated over more than a pixel, a tile or a texture, but are independent between blocks.
ACROSS, DOWN = 4, 3
#: Disagreement of normals (1 - cosine) that does not count as noise: depth rounded to 0.2 mm causes less.
MIN_NOISE = 1e-4


def disagreement(cosines: np.ndarray) -> float:
    """Noise of the normals of two images, from the cosines (n,) between corresponding normals: the mean of 1 - cosine.

    The mean is computed from the median, because at edges normals differ for other reasons than noise.
    """
    mean = (1.0 - float(np.median(cosines))) / math.log(2.0) if len(cosines) else 0.0
    return max(mean - MIN_NOISE, 0.0)


def jackknife_information(system: System, sums: np.ndarray, nu: float) -> System:
    """`system` with A and b as information (1 / variance); sums: kernels.block_sums() (blocks, 34) with weights of `nu`.

    The variance is that of the motions estimated with one block left out at a time (the delete-a-group jackknife). It is
    computed along each eigenvector of the centred A, and is at least the variance for pixels with independent errors. The
    information of Student's t is (nu + 1) / (nu + 3) of the sum of its weights.
    """
    A_centred, G = system.centred()
    values, vectors = np.linalg.eigh(A_centred)
    A, b = G @ sums.take(SYMMETRIC, axis=1) @ G.T, sums[:, 21:27] @ G.T
    total, total_b = A.sum(axis=0), b.sum(axis=0)
    total += np.eye(6) * (1e-6 * np.trace(total) + 1e-12)  # a bare wall leaves directions unobservable
    steps = np.linalg.solve(total - A, (total_b - b)[..., None])[..., 0] - np.linalg.solve(total, total_b)
    observable = values > RANK_TOLERANCE * max(values[-1], 1e-30)
    error = max(system.error, 1e-12)
    variance_factor = np.square(steps @ total @ vectors).sum(axis=0) / np.where(observable, values * error, np.inf)
    variance_factor = np.maximum(variance_factor * (((nu + 3) / (nu + 1)) ** 2 if nu > 0 else 1.0), 1.0)
    G_inverse, right = np.linalg.solve(G, vectors), vectors.T @ (G @ system.b)
    weights = observable / (variance_factor * error)
    return replace(
        system, A=(G_inverse * (weights * values)) @ G_inverse.T, b=G_inverse @ (weights * right), is_information=True
    )
