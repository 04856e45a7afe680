"""Prediction, lost and repeated frames."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.protocol import Frame, OdometryResult, OdometryStatus, failure  # noqa: E402
from iclnuim.benchmark.odometry.references import (  # noqa: E402
    KeyframeReference,
    MatchedKeyframeReference,
    MatchesReference,
)
from iclnuim.benchmark.odometry.registry import ODOMETERS, odometer  # noqa: E402
from iclnuim.benchmark.odometry.track import Tracker, track  # noqa: E402
from odometry_scenes import BIG, CAMERA, ROOM, STEP, after, error_m, run, tracked_by, view  # noqa: E402


def test_a_frame_that_does_not_fit_a_matched_keyframe_is_aligned_with_the_frame_before_and_reported():
    aligned = []

    def result_of(one, other):
        aligned.append((one, other))
        if other - one > farthest or other in unusable:
            return failure("test: too far")
        return OdometryResult(SE3(np.eye(3), [0.01 * (other - one), 0, 0]))

    def run_on(count, lost=(), against=MatchedKeyframeReference):
        aligned.clear()
        found = tracked_by(result_of, count, lost, against())
        places_m = [f.T_world_camera.translation[0] for f in found if not f.lost]
        assert places_m == pytest.approx([0.01 * i for i, f in enumerate(found) if not f.lost])
        return [f.result.status for f in found]

    ok, bad, lost = OdometryStatus.OK, OdometryStatus.DEGENERATE, OdometryStatus.FAILED
    farthest, unusable = 2, ()
    # after five such frames the last one is the keyframe
    assert run_on(9) == [ok] * 3 + [bad] * 5 + [ok]
    assert aligned[:6] == [(0, 1), (0, 2), (0, 3), (2, 3), (0, 4), (3, 4)] and aligned[-1] == (7, 8)
    farthest, unusable = 9, (2,)
    assert run_on(4) == [ok, ok, lost, ok] and aligned == [(0, 1), (0, 2), (1, 2), (0, 3)]
    farthest, unusable = 1, ()
    assert run_on(4, lost=(2,)) == [ok, ok, lost, lost] and aligned == [(0, 1), (0, 3)]
    assert run_on(3, against=KeyframeReference) == [ok, ok, lost] and aligned == [(0, 1), (0, 2)]


class Noting:
    """An odometer that knows the true pose of each frame by its stamp, and notes the guesses it is
    given.
    """

    name, reference = "noting", "frame"

    def __init__(self):
        self.guesses = []

    def prepare(self, frame, camera):
        return frame.stamp_s

    def align(self, reference, current, guess):
        self.guesses.append((current, guess))
        return OdometryResult(at(reference).inverse() @ at(current))


def at(stamp_s):
    return SE3.exp(30 * stamp_s * STEP.log())


def test_a_motion_is_predicted_for_the_time_since_the_last_frame():
    stamps_s = [k / 30 for k in (0, 1, 2, 5, 6, 13, 14)]
    noting = Noting()
    found = list(
        track(
            noting, CAMERA, [(t, replace(view(k, ROOM), stamp_s=t)) for k, t in enumerate(stamps_s)]
        )
    )
    for (stamp_s, guess), before in list(zip(noting.guesses, stamps_s, strict=False))[
        1:
    ]:  # the first has no motion yet
        off = guess.inverse() @ at(before).inverse() @ at(stamp_s)
        assert np.abs(off.log()).max() < 1e-9, stamp_s
    assert all(f.result.status is OdometryStatus.OK for f in found)
    noting = Noting()  # after a gap of ten seconds, the motion of one
    list(
        track(
            noting,
            CAMERA,
            [(t, replace(view(k, ROOM), stamp_s=t)) for k, t in enumerate((0.0, 1 / 30, 10.0))],
        )
    )
    np.testing.assert_allclose(noting.guesses[-1][1].log(), at(1.0).log(), atol=1e-9)


@pytest.mark.parametrize("name", sorted(ODOMETERS))
def test_repeated_frames_keep_the_pose_and_are_reported_and_the_motion_goes_on_after_them(name):
    stuck = [0, 1, 2, 3, 3, 3, 3, 7, 8, 9]
    frames = [
        (k / 30, replace(view(j, ROOM, camera=BIG), stamp_s=k / 30)) for k, j in enumerate(stuck)
    ]
    found = list(track(odometer(name), BIG, frames))
    reported = [k for k, f in enumerate(found) if f.result.status is not OdometryStatus.OK]
    assert reported == [4, 5, 6, 7]
    assert (
        all(f.result.reason.startswith("image: repeats") for f in found[4:7])
        and "repeated" in found[7].result.reason
    )
    np.testing.assert_allclose(
        found[6].T_world_camera.matrix, found[3].T_world_camera.matrix, atol=1e-12
    )
    steady = run(name, [view(k, ROOM, camera=BIG) for k in range(len(stuck))], BIG)
    moved = found[-1].T_world_camera.translation - steady[-1].T_world_camera.translation
    assert np.linalg.norm(moved) < 0.002
    # of fovis with its keyframe one alignment of these few corners is off by 10 mm, with and
    # without repeated frames
    against = MatchesReference() if name == "fovis" else None
    assert error_m(list(track(odometer(name), BIG, frames, against=against))) < (
        0.01 if name == "fovis" else 0.002
    )
    interrupted = list(
        track(odometer(name), BIG, [*frames[:7], (6.5 / 30, "no image"), *frames[7:]])
    )
    assert [k for k, f in enumerate(interrupted) if f.result.status is not OdometryStatus.OK] == [
        4,
        5,
        6,
        7,
        8,
    ]


def test_a_hundred_lost_frames_leave_the_pose_a_rigid_motion():
    """Each lost frame is a new reference; rounding errors of the rotation must not grow from one to
    the next.
    """

    class Lost:
        name, reference, turn = "lost", "frame", after(2)

        def prepare(self, frame, camera):
            return frame.stamp_s

        def align(self, reference, current, guess):
            return (
                failure("test: no motion found") if 2 < current < 110 else OdometryResult(self.turn)
            )

    tracker, image = Tracker(Lost(), CAMERA, "restart"), view(0, ROOM)
    for k in range(112):
        pose = tracker.add(
            float(k), Frame.of(image.grey + k % 2, image.depth_z_m, float(k))
        ).T_world_camera
        assert np.abs(pose.rotation @ pose.rotation.T - np.eye(3)).max() < 1e-12


def test_a_prediction_that_no_image_confirms_fades_within_a_second():
    """To a fifth; before a bare wall a camera that has stopped would slide on for ever."""

    class Blind:
        name, reference = "blind", "frame"

        def prepare(self, frame, camera):
            return frame.stamp_s

        def align(self, reference, current, guess):
            if current < 0.04:
                return OdometryResult(STEP)
            return OdometryResult(guess, under_constrained=1)

    frames = [(k / 30, replace(view(k % 2, ROOM), stamp_s=k / 30)) for k in range(32)]
    poses = [f.T_world_camera for f in track(Blind(), CAMERA, frames)]
    lengths_m = [np.linalg.norm((a.inverse() @ b).translation) for a, b in pairwise(poses)]
    assert 0.1 < lengths_m[-1] / lengths_m[0] < 0.4


@pytest.mark.parametrize(("share", "lost"), [(0.014, True), (0.028, False)])
def test_a_frame_with_depth_in_a_fiftieth_of_its_pixels_is_not_tracked(share, lost):
    depth = np.zeros((480, 640))
    depth.flat[: int(share * depth.size)] = 2.0
    fault = Frame.of(depth, depth, 0.0).fault(PinholeCamera.parse("640x480"))
    assert fault.startswith("depth: only") is lost
