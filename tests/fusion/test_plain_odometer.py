"""An odometer that has nothing but the protocol, against every reference; a failure that it
reports; grain.
"""

from functools import cache

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba")
from iclnuim.benchmark.fusion.reference import NAMES, make_reference  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame, OdometryResult, OdometryStatus, failure  # noqa: E402
from iclnuim.benchmark.odometry.registry import ODOMETERS, odometer  # noqa: E402
from iclnuim.benchmark.odometry.track import PREDICTION_DECAY, Tracker, track  # noqa: E402

CAMERA = PinholeCamera.parse("160x120")
STEP = SE3.exp(np.array([0.01, 0.0, 0.0, 0.0, 0.002, 0.0]))


class Plain:
    """Says that each frame is a step on from the guess."""

    name, reference = "plain", "frame"

    def __init__(self, results=()):
        self.results = dict(results)
        self.calls, self.guesses = 0, []

    def prepare(self, frame, camera):
        assert frame.depth_z_m.shape == (camera.height, camera.width)
        return frame

    def align(self, reference, current, guess):
        assert isinstance(reference, Frame) and isinstance(current, Frame)
        self.calls += 1
        self.guesses.append(guess)
        return self.results.get(self.calls, OdometryResult(guess @ STEP))


def frames(count):
    depth = np.full((120, 160), 2.0)
    return [Frame.of(np.full(depth.shape, 100.0 + i), depth, i / 30) for i in range(count)]


@pytest.mark.parametrize("name", NAMES)
def test_an_odometer_with_nothing_but_the_protocol_works_against_every_reference(name):
    one = Plain()
    tracker = Tracker(one, CAMERA, against=make_reference(name, one, CAMERA))
    found = [tracker.add(f.stamp_s, f) for f in frames(8)]
    assert one.calls == 7
    assert not any(f.lost for f in found)


def test_a_reported_failure_is_a_lost_frame_also_with_a_residual_and_without_a_reason():
    results = {
        2: failure("nothing to see"),
        3: OdometryResult(STEP, OdometryStatus.FAILED, residual=1.0),
        4: OdometryResult(STEP, residual=np.nan),
    }
    found = list(track(Plain(results), CAMERA, [(f.stamp_s, f) for f in frames(5)]))
    assert [f.lost for f in found] == [False, False, True, True, False]
    assert found[2].result.reason == "nothing to see"
    np.testing.assert_allclose(
        found[3].T_world_camera.matrix, found[1].T_world_camera.matrix, atol=1e-14
    )


def test_a_prediction_that_the_images_did_not_confirm_decays():
    one = Plain({1: OdometryResult(STEP), 2: OdometryResult(STEP @ STEP, under_constrained=1)})
    against = make_reference("keyframe", one, CAMERA)
    for _ in track(one, CAMERA, [(f.stamp_s, f) for f in frames(4)], against=against):
        pass
    confirmed, decayed = (
        a.inverse() @ b for a, b in zip((STEP, STEP @ STEP), one.guesses[1:], strict=True)
    )
    np.testing.assert_allclose(confirmed.log(), STEP.log(), atol=1e-12)
    np.testing.assert_allclose(decayed.log(), PREDICTION_DECAY * STEP.log(), atol=1e-12)
    assert PREDICTION_DECAY == 0.95


def grain(count, shape=(240, 320)):
    """Independent noise before a corner of a room, which a camera that moves 2 mm a frame sees."""
    rng, camera = np.random.default_rng(7), PinholeCamera.parse(f"{shape[1]}x{shape[0]}")
    rays = camera.rays()
    for i in range(count):
        z = np.min(
            [
                (2.0 - 0.002 * i * n[0]) / np.maximum(rays @ n, 1e-3)
                for n in ((0.8, 0, 0.6), (-0.6, 0, 0.8), (0, 0.6, 0.8))
            ],
            axis=0,
        )
        yield i / 30, Frame.of(rng.uniform(0, 255, shape), np.where(z < 8, z, 0), i / 30)


@pytest.fixture(scope="module")
def among_grain():
    """`among_grain(name, preset)`: what an odometer finds in 24 frames of it, found once."""
    frames, camera = list(grain(24)), PinholeCamera.parse("320x240")
    return cache(lambda name, preset: list(track(odometer(name, preset), camera, frames)))


@pytest.mark.parametrize("preset", ["paper", "best"])
@pytest.mark.parametrize("name", ODOMETERS)
def test_images_that_are_unrelated_are_lost_to_intensities_and_leave_geometry_alone(
    among_grain, name, preset
):
    found = among_grain(name, preset)
    if name in ("rgbd", "dvo", "fovis"):
        assert np.mean([f.result.status is not OdometryStatus.OK for f in found[1:]]) >= 0.95
        assert all(np.linalg.norm(f.T_world_camera.translation) < 0.05 for f in found)
    else:
        alone = among_grain("icp", preset)
        error_m = np.linalg.norm(
            found[-1].T_world_camera.translation - alone[-1].T_world_camera.translation
        )
        assert error_m < 0.02


@pytest.mark.parametrize("preset", ["paper", "best"])
@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_no_official_frame_is_taken_for_unrelated(samples, name, preset):
    from iclnuim.benchmark.odometry.run import Sequence

    sequence = Sequence(samples / "or_kt0")
    sequence.pairs = sequence.pairs[:120:8]  # 8 frames apart: harder than they are
    found = list(track(odometer(name, preset), sequence.camera.pinhole, sequence.frames()))
    assert not [f.result.reason for f in found if "unrelated" in f.result.reason]
