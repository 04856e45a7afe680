"""The photometric term, its tiles and its brightness."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.levels import Level, Pair  # noqa: E402
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.photometric import Dvo, Rgbd  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame, OdometryResult, OdometryStatus  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from iclnuim.benchmark.odometry.solver import SolverLimits  # noqa: E402
from iclnuim.benchmark.odometry.terms.photometric import (  # noqa: E402
    PhotometricSettings,
    PhotometricTerm,
    TiledTerm,
)
from odometry_scenes import BIG, CAMERA, ROOM, STEP, after, error_m, run, view  # noqa: E402

PLAIN = PhotometricSettings(min_gradients=(1,), max_depth_m=13.0, mean_gradient=True, spread=1.0)


def test_blocks_of_tiles_add_up_to_the_equations_of_the_motion():
    method = odometer("rgbd")
    pair = Pair(*(method.prepare(view(i, ROOM, camera=BIG), BIG) for i in range(2)))
    term = TiledTerm(pair, method.settings, 1)
    for firm in (False, True):
        term.linearise(STEP, 0, firm)
        system = term.tiles.eliminated(term.sums, firm)
        blocks = NormalEquations.of_sums(np.pad(term.tiles.block_sums().sum(axis=0), (0, 7)))
        np.testing.assert_allclose(
            blocks.A, system.A, rtol=1e-9, atol=1e-9 * np.abs(system.A).max()
        )
        np.testing.assert_allclose(
            blocks.b, system.b, rtol=1e-9, atol=1e-9 * np.abs(system.b).max()
        )


@pytest.mark.parametrize(
    ("outliers", "status"), [(60, OdometryStatus.OK), (130, OdometryStatus.DEGENERATE)]
)
def test_an_image_whose_greater_part_depth_contradicts_is_reported(outliers, status):
    """Of 192 equal tiles, `outliers` have a certain factor of 1.6 instead of 1."""
    term = TiledTerm(Pair([blank()], [blank()]), Rgbd.PRESETS["best"], 0)
    term.tiles.factor[:outliers], term.tiles.scale_ambiguity = 1.6, 0.0
    sums = np.zeros((192, 42))
    sums[:, [0, 6, 11, 28]], sums[:, 40] = 1.0, 1e9
    term.tiles.eliminated(sums, firm=True)
    assert term.tiles.inlier_share() == pytest.approx(1 - outliers / 192, abs=0.01)
    assert term.checked(OdometryResult(SE3.identity())).status is status
    assert (
        term.checked(OdometryResult(SE3.identity(), OdometryStatus.FAILED)).status
        is OdometryStatus.FAILED
    )


def blank():
    return Level(np.zeros((48, 64), np.float32), np.ones((48, 64), np.float32), CAMERA)


def test_student_weights_withstand_something_that_moves_through_the_picture():
    frames = [view(i, ROOM) for i in range(6)]
    for i, frame in enumerate(frames):
        frame.grey[40:80, 20 + 8 * i : 60 + 8 * i] = 250.0
    settings = replace(
        Dvo.PRESETS["paper"], median_depth=False, limits=SolverLimits(min_inliers=0.01)
    )
    plain, robust = Dvo(replace(settings, nu=0.0)), Dvo(settings)
    assert error_m(run(robust, frames)) < 0.5 * error_m(run(plain, frames))


def behind_glass(i, to_m=-0.9):
    """A corner whose left part, x < -0.9 m, is glass: its depth is the corner's, its light that of
    a wall 6 m off.
    """
    frame, T = view(i, ROOM, camera=BIG), after(i)
    rays = BIG.rays() @ T.rotation.T
    x, y, z = np.moveaxis(T.translation + rays * frame.depth_z_m[..., None].astype(float), -1, 0)
    near = (
        128
        + 40 * np.sin(27 * x + 6 * z)
        + 40 * np.sin(33 * y - 9 * z)
        + 20 * np.sin(21 * z + 12 * x)
    )
    a, b, _ = np.moveaxis(
        T.translation + rays * ((6 - T.translation[2]) / rays[..., 2])[..., None], -1, 0
    )
    far = 128 + 50 * np.sin(10 * a) + 50 * np.sin(12 * b)
    return Frame.of(np.where(x < to_m, far, near), frame.depth_z_m, frame.stamp_s)


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_light_through_a_glass_does_not_pull_the_motion_along(name):
    frames, method = [behind_glass(i) for i in range(10)], odometer(name)
    rigid = type(method)(replace(method.settings, tiles=False))
    found = run(method, frames, BIG)
    assert error_m(found) < 0.25 * error_m(run(rigid, frames, BIG))
    assert 0.5 < found[-1].result.inliers < 0.85  # what lies behind the glass is given up


def test_a_glass_over_most_of_the_view_is_not_believed_because_depth_tells_which_part_it_is():
    frames = [behind_glass(i, 0.2) for i in range(0, 10, 3)]
    rigid = type(odometer("rgbd"))(replace(odometer("rgbd").settings, tiles=False))
    found = run("rgbd", frames, BIG)
    assert error_m(found, 9) < 0.1 * error_m(run(rigid, frames, BIG), 9)
    assert found[-1].result.inliers < 0.5


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_a_change_of_exposure_is_no_motion(name):
    frames = [view(i, ROOM, camera=BIG) for i in range(3)]
    changed = [
        Frame.of(f.grey * (1, 0.6)[i % 2] + 20 * (i % 3), f.depth_z_m, f.stamp_s)
        for i, f in enumerate(frames)
    ]
    assert error_m(run(name, changed, BIG)) < error_m(run(name, frames, BIG)) + 5e-4


def pair_of(frame, current):
    return Pair([level_of(frame)], [level_of(current)])


def level_of(frame):
    return Level(frame.grey, frame.depth_z_m, BIG)


@pytest.mark.parametrize(("other", "related"), [(2.7, True), (6.0, False)])
def test_images_whose_contrast_hardly_agrees_are_unrelated(other, related):
    """Another texture, without a place of its own, is added to the image: 0.35 and 0.16 agree."""
    frame = view(0, ROOM, camera=BIG)
    texture = np.random.default_rng(1).normal(0, frame.grey.std(), frame.grey.shape)
    changed = replace(frame, grey=(frame.grey + other * texture).astype(np.float32))
    term = PhotometricTerm(pair_of(frame, changed), PLAIN, 0)
    term.linearise(SE3.identity(), 0)
    assert (not term.unrelated()) is related


@pytest.mark.parametrize(("pixels", "significant"), [(21, False), (42, True)])
def test_a_correlation_of_a_few_pixels_is_not_significant(pixels, significant):
    grey = np.random.default_rng(3).integers(0, 2, (BIG.height, BIG.width)) * 200
    depth = np.zeros(grey.shape)
    depth[100, 100 : 100 + 4 * pixels] = 2.0
    frame = Frame.of(grey, depth, 0.0)
    term = PhotometricTerm(pair_of(frame, frame), PLAIN, 0)
    term.linearise(SE3.identity(), 0)
    term.residual[pixels:] = np.nan
    assert np.isfinite(term.correlation()) == significant


def test_two_rounded_images_are_as_certain_as_rounding_leaves_them():
    """Equal images have no residual; the stated variance is that of the rounding of both."""
    frame = view(0, ROOM, camera=BIG)
    term = PhotometricTerm(pair_of(frame, frame), PLAIN, 0)
    equations = term.linearise(SE3.identity(), 0)
    rng = np.random.default_rng(0)
    exact = rng.uniform(0, 255, (2, 100_000))
    rounding = np.var((np.round(exact) - exact)[0] - (np.round(exact) - exact)[1])
    seen = np.isfinite(term.residual)
    J = term.J[seen].astype(float)
    np.testing.assert_allclose(equations.A, J.T @ J / rounding, rtol=0.02)


def test_the_tiles_behind_a_pane_are_given_up_and_no_others():
    """What counts is the visible image that is no glass, and some of the tiles at its border."""
    frames = [behind_glass(i) for i in (0, 3, 6, 9)]
    frames = [replace(f, grey=np.round(f.grey)) for f in frames]
    found = run("rgbd", frames, BIG)[-1].result
    method = odometer("rgbd")
    term = TiledTerm(
        Pair(*(method.prepare(f, BIG) for f in (frames[0], frames[-1]))), method.settings, 1
    )
    term.linearise(after(9), 0)
    clear = np.isfinite(term.residual) & (term.seen.points[:, 0] >= -0.9)
    clear_share = np.count_nonzero(clear) / term.pixels
    assert clear_share <= found.inliers < clear_share + 0.03
