"""What an odometer knows of its own error."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry import kernels  # noqa: E402
from iclnuim.benchmark.odometry.certainty import (  # noqa: E402
    BLOCKS,
    disagreement,
    jackknife_information,
    spread_information,
)
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from odometry_scenes import BIG, ROOM, STEP, run, view  # noqa: E402


def test_the_stated_deviation_is_of_the_size_of_the_error():
    found = run("icp", [view(i, ROOM, 0.001) for i in range(12)])
    steps = [
        a.T_world_camera.inverse() @ b.T_world_camera
        for a, b in zip(found, found[1:], strict=False)
    ]
    errors = [np.linalg.norm((STEP.inverse() @ step).translation) for step in steps[1:]]
    stated = [np.sqrt(np.trace(np.linalg.inv(f.result.information)[:3, :3])) for f in found[2:]]
    assert 0.1 < np.sqrt(np.mean(np.square(errors))) / np.mean(stated) < 3


@pytest.mark.parametrize("shared", [0.0, 1.0])
def test_information_is_of_errors_that_pixels_share_and_of_those_that_they_do_not(shared):
    """The mean NEES per degree of freedom is 1, whether errors are correlated within blocks or not."""
    rng, nees = np.random.default_rng(7), []
    blocks = np.repeat(np.arange(BLOCKS, dtype=np.int16), 100)
    for _ in range(60):
        J = (
            rng.normal(size=(len(blocks), 6)).astype(np.float32)
            + rng.normal(size=(BLOCKS, 6))[blocks]
        )
        J, points = J.astype(np.float32), rng.uniform(1, 2, (len(blocks), 3)).astype(np.float32)
        r = (rng.normal(size=len(blocks)) + shared * rng.normal(size=BLOCKS)[blocks]).astype(
            np.float32
        ) * 1e-3
        sums = np.empty((BLOCKS, 34))
        kernels.block_sums(points, (r, J, r, J), (1.0, 0.0), blocks, sums)
        system = jackknife_information(NormalEquations.of_sums(sums.sum(axis=0)), sums, 0.0)
        twist = np.linalg.solve(system.A, system.b)
        nees.append(twist @ system.A @ twist / 6)
    assert 0.5 < np.mean(nees) < 2


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_noise_that_pixels_do_not_share_is_not_taken_for_noise_that_they_share(name):
    """The mean NEES per degree of freedom is near 1 with exact depth and noise that is independent
    in every pixel.
    """

    def noisy(i):
        frame = view(i, ROOM, camera=BIG)
        noise = np.random.default_rng(i).normal(0, 8, frame.grey.shape)
        return replace(frame, grey=frame.grey + noise.astype(np.float32))

    method, nees = odometer(name), []
    for i in range(12):
        result = method.align(*(method.prepare(noisy(k), BIG) for k in (i, i + 1)), STEP)
        error = (STEP @ result.T_reference_camera.inverse()).log()
        nees.append(error @ result.information @ error / 6)
    assert 0.5 < np.mean(nees) < 2


@pytest.mark.parametrize("moves", [False, True])
def test_the_image_is_less_certain_only_in_directions_in_which_its_blocks_disagree(moves):
    """Independent errors; one of the blocks may see something that moves sideways (the second
    component of the twist).
    """
    rng, blocks = np.random.default_rng(3), np.repeat(np.arange(BLOCKS, dtype=np.int16), 400)
    J = rng.normal(size=(len(blocks), 6)).astype(np.float32)
    r = rng.normal(size=len(blocks)).astype(np.float32) + moves * 2 * J[:, 1] * (blocks == 5)
    points, sums = (
        rng.normal(size=(len(blocks), 3)).astype(np.float32),
        np.empty((BLOCKS, 34)),
    )
    points -= points.mean(axis=0)
    kernels.block_sums(points, (r, J, r, J), (1.0, 0.0), blocks, sums)
    system = NormalEquations.of_sums(sums.sum(axis=0))
    known, spread = (
        system.as_information(10.0),
        spread_information(system, sums[:, :27], 0.0, 10.0, 1e-12),
    )
    share = np.diag(spread.A) / np.diag(known.A)
    assert share[1] < 0.2 if moves else share[1] == 1
    assert (share[[0, 2, 3, 4, 5]] > 0.8).all()


@pytest.mark.parametrize(("calibrated", "share"), [(False, 0.005), (True, 0.002)])
def test_the_stated_deviation_of_a_noisy_frame_allows_for_the_bias_of_its_depth(calibrated, share):
    """Many pixels with independent errors do not make the length of a motion more certain than the
    sensor's scale.
    """
    frames = [replace(view(i, ROOM, 0.001, BIG), calibrated=calibrated) for i in (0, 8)]
    result = run("icp", frames, BIG)[1].result
    t = result.T_reference_camera.translation
    stated = np.sqrt(t @ np.linalg.inv(result.information)[:3, :3] @ t) / (t @ t)
    assert share < stated < 1.5 * share


@pytest.mark.parametrize("name", ["fovis", "rgbd", "dvo"])
@pytest.mark.parametrize("noise", [0.001, 0])
def test_images_with_depth_of_a_sensor_add_its_bias_to_their_own_variance(name, noise):
    """A bias of 0.5 % of the length, or of 0.2 % of calibrated depth; none of exact depth."""

    def covariance(calibrated):
        frames = [replace(view(i, ROOM, noise, BIG), calibrated=calibrated) for i in (0, 8)]
        result = run(name, frames, BIG)[1].result
        length_m = np.linalg.norm(result.T_reference_camera.translation)
        return np.linalg.inv(result.information), length_m

    (as_made, length_m), (calibrated, _) = covariance(False), covariance(True)
    added = (noise > 0) * (0.005**2 - 0.002**2) * length_m**2
    expected = added * np.diag([1, 1, 1, 0, 0, 0])
    assert np.allclose(as_made - calibrated, expected, rtol=1e-3, atol=1e-12)


@pytest.mark.parametrize(("step_mm", "noisy"), [(1.0, False), (1.4, True)])
def test_normals_of_rounded_depth_disagree_from_a_millimetre_on(step_mm, noisy):
    """At 2 m, in a quarter of a VGA image: what a 16-bit image rounds is no noise of a sensor."""
    exact = view(0, ROOM, camera=BIG).depth_z_m
    rounded = (np.round(exact * 1e3 / step_mm) * step_mm / 1e3).astype(np.float32)
    one, other = (kernels.normals(depth, BIG.intrinsics, 1) for depth in (exact, rounded))
    both = (one[..., 2] != 0) & (other[..., 2] != 0)
    assert (disagreement(np.sum(one * other, axis=-1)[both]) > 0) is noisy


def test_noise_of_normals_is_the_mean_that_their_median_implies():
    rng = np.random.default_rng(2)
    cosines = 1 - rng.exponential(0.004, 20_000)
    assert disagreement(cosines) == pytest.approx(0.004, rel=0.05)
    cosines[::5] = 0.0  # edges
    assert disagreement(cosines) < 0.006
    assert disagreement(cosines[:0]) == 0
