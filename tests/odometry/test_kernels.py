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


def test_depth_is_halved_within_a_surface_and_not_across_its_edge():
    """The mean of 3.5 % of difference; of 7 % the nearest one: a mean would float between both."""
    for step, expected in ((0.035, 2 / (1 + 1 / 1.035)), (0.07, 1.0)):
        depth = np.array([[1, 1 + step], [1, 1 + step]], np.float32)
        assert kernels.halve_depth(depth) == pytest.approx(expected, rel=1e-6)
        depth[0, 0] = 0  # the other diagonal, if it is of one surface
        assert kernels.halve_depth(depth) == pytest.approx(expected if step < 0.05 else 0)


@pytest.mark.parametrize(("z_m", "seen"), [(0.035, False), (0.07, True)])
def test_points_in_the_lens_match_nothing(z_m, seen):
    """Nearer than 5 cm, where no sensor measures and a pixel of motion is a tenth of a millimetre."""
    depth = np.full((BIG.height, BIG.width), z_m, np.float32)
    flat = kernels.normals(depth, BIG.intrinsics, 1)
    _, points = kernels.surface_points(BIG.intrinsics, depth, flat, 8, (1, 1))
    count = len(points.points)
    residual, J = np.empty(count, np.float32), np.empty((count, 6), np.float32)
    out = (residual, J, residual.copy(), J.copy())
    kernels.plane_residuals(np.eye(4), BIG.intrinsics, points, (depth, flat), (0.1, 0.9), out)
    assert np.isfinite(residual).all() == seen and np.isfinite(residual).any() == seen
