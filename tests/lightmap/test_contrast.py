"""Contrast of light: edges count, noise does not, charts do not touch."""

import numpy as np
from iclnuim.lightmap.denoise import contrast


def grey(values):
    return np.repeat(values[..., None], 3, -1)


def test_an_edge_counts_and_noise_does_not():
    rng = np.random.default_rng(3)
    light = np.where(np.arange(64) < 32, 1.0, 4.0)[None].repeat(64, 0)
    halves = [grey(light * rng.lognormal(0, 0.2, light.shape)) for _ in range(2)]
    steps = contrast(*halves, np.zeros((64, 64), int))
    edge, even = steps[:, 31:33], np.delete(steps, (31, 32), 1)
    assert np.isclose(edge.mean(), 1 / 4, rtol=0.2)
    assert abs(even.mean()) < 0.01


def test_charts_side_by_side_make_no_edge():
    light = grey(np.where(np.arange(8) < 4, 1.0, 9.0)[None].repeat(8, 0))
    chart = np.where(np.arange(8) < 4, 0, 1)[None].repeat(8, 0)
    assert not contrast(light, light, chart).any()
