"""The compiled loops over pixels."""

import numpy as np
import pytest

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry import kernels  # noqa: E402
from odometry_scenes import BIG, ROOM, view  # noqa: E402


def test_normals_and_pyramids_bear_single_missing_pixels():
    frame, missing = view(0, ROOM, camera=BIG), np.random.default_rng(8).random((240, 320)) < 0.1
    whole, holey = frame.depth_z_m, np.where(missing, np.float32(0), frame.depth_z_m)
    true = kernels.normals(whole, BIG.intrinsics, 1)
    for step in (1, 2):
        found = kernels.normals(holey, BIG.intrinsics, step)
        has = found[..., 2] != 0
        assert has.mean() > 0.8
        assert np.median(np.abs(found - true)[has].max(axis=-1)) < 1e-3
    for halve in (kernels.halve_depth, kernels.halve_depth_median):
        half, half_true = halve(holey), halve(whole)
        assert (half > 0).mean() > 0.95
        assert np.abs(half / half_true - 1)[half > 0].max() < 0.05 and (half[half > 0] > 1).all()
    assert np.median(np.abs(kernels.halve_depth(holey) / kernels.halve_depth(whole) - 1)) < 1e-6
