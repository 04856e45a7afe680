"""Which frame is a keyframe, and for how long."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.protocol import OdometryResult, OdometryStatus  # noqa: E402
from iclnuim.benchmark.odometry.references import (  # noqa: E402
    EntropyReference,
    KeyframeReference,
    MatchedKeyframeReference,
    Reference,
)
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from iclnuim.benchmark.odometry.track import Tracker  # noqa: E402
from odometry_scenes import CAMERA, ROOM, error_m, view  # noqa: E402


def test_a_kept_frame_is_left_for_one_from_half_way_when_the_camera_has_gone_away():
    reference = KeyframeReference(max_m=0.02, max_deg=90)
    kept = []
    for i in range(9):
        kept.append(reference.renew(None, i, SE3(np.eye(3), [0.006 * i, 0, 0])))
    assert [view for view, _ in kept] == [0, 0, 0, 0, 2, 2, 4, 4, 6]
    assert all(T.translation[0] == 0.006 * view for view, T in kept)


@pytest.mark.parametrize("distance", [(0.0, 10.0), (0.2, 0.0), (-1.0, 10.0), (float("nan"), 10.0)])
def test_a_keyframe_distance_that_is_not_positive_is_refused(distance):
    with pytest.raises(InputError, match="above 0 m and 0 degrees"):
        KeyframeReference(*distance)


def test_a_reported_pose_becomes_no_keyframe_while_there_is_a_good_one():
    def kept(bad):
        reference = KeyframeReference(max_m=0.02, max_deg=90)
        results = (
            OdometryResult(
                SE3.identity(), OdometryStatus.DEGENERATE if i in bad else OdometryStatus.OK
            )
            for i in range(9)
        )
        return [
            reference.renew(None, i, SE3(np.eye(3), [0.006 * i, 0, 0]), r)[0]
            for i, r in enumerate(results)
        ]

    assert kept(bad=()) == [0, 0, 0, 0, 2, 2, 4, 4, 6]
    assert kept(bad=(2,)) == [0, 0, 0, 0, 3, 3, 3, 5, 5]
    assert kept(bad=(2, 3)) == [0, 0, 0, 0, 4, 4, 4, 4, 6]  # none: the current one


def test_the_next_keyframe_is_the_most_certain_frame_per_distance():
    def kept(sigmas_m):
        reference = KeyframeReference(max_m=0.02, max_deg=90)
        results = (OdometryResult(SE3.identity(), largest_sigma_m=sigma_m) for sigma_m in sigmas_m)
        return [
            reference.renew(None, i, SE3(np.eye(3), [0.004 * i, 0, 0]), r)[0]
            for i, r in enumerate(results)
        ]

    assert kept([1e-3] * 6)[-1] == 4  # as certain as the others and the farthest
    assert kept([1e-3, 1e-3, 1e-3, 1e-3, 2e-3, 1e-3])[-1] == 3
    assert kept([1e-3, 1e-3, 1e-3, 9e-3, 2e-3, 1e-3])[-1] == 4


def test_a_single_outlier_becomes_no_keyframe():
    def kept(places_m, bad):
        reference, found = KeyframeReference(max_m=0.02, max_deg=90), []
        for i, x in enumerate(places_m):
            result = OdometryResult(
                SE3.identity(), OdometryStatus.DEGENERATE if i in bad else OdometryStatus.OK
            )
            found.append(reference.renew(None, i, SE3(np.eye(3), [x, 0, 0]), result)[0])
        return found

    assert kept([0, 0.006, 0.5, 0.008], bad=(2,)) == [0, 0, 0, 0]
    assert kept([0, 0.006, 0.5, 0.504], bad=(2, 3)) == [0, 0, 0, 3]  # the camera has gone there
    assert kept([0, 0.006, 0.5, 0.008], bad=()) == [0, 0, 2, 3]


def test_a_matched_keyframe_is_left_for_the_current_frame_when_a_quarter_of_its_first_matches_is_lost():
    def kept(matches, step_m=0.001):
        reference = MatchedKeyframeReference()
        results = [None, *(OdometryResult(SE3.identity(), matches=count) for count in matches)]
        return [
            reference.renew(None, i, SE3(np.eye(3), [step_m * i, 0, 0]), r)[0]
            for i, r in enumerate(results)
        ]

    assert kept([200, 400, 150, 200]) == [0, 0, 0, 0, 0]
    # the share is that of the new keyframe's own first matches
    assert kept([200, 149, 100, 76, 74]) == [0, 0, 2, 2, 2, 5]
    assert kept([200] * 5, step_m=0.06) == [0, 0, 0, 0, 2, 2]  # and by distance, as any keyframe
    assert kept([200, 200, 200, 200, 100, 76], step_m=0.06) == [0, 0, 0, 0, 2, 2, 4]


def test_a_matched_keyframe_after_lost_frames_counts_its_own_matches():
    reference = MatchedKeyframeReference()
    few, many = (OdometryResult(SE3.identity(), matches=count) for count in (100, 200))
    for i, result in enumerate((None, many)):
        reference.renew(None, i, SE3.identity(), result)
    assert reference.restart(None, 2, SE3.identity())[0] == 2
    assert [reference.renew(None, i, SE3.identity(), few)[0] for i in (3, 4)] == [2, 2]


def test_a_kept_frame_far_from_its_successor_is_left_for_the_last():
    reference = KeyframeReference(max_m=0.02, max_deg=90)
    for i, x in enumerate((0.0, 0.012, 0.5)):
        view, _ = reference.renew(None, i, SE3(np.eye(3), [x, 0, 0]))
    assert view == 2


def test_a_frame_is_kept_while_its_entropy_is_near_the_first_and_left_for_the_last_sure_one():
    reference, kept = EntropyReference(min_ratio=0.9), []
    for i, sigma in enumerate((1.0, 1e-3, 1.1e-3, 1.5e-3, 2.2e-3, 1e-3, 1.1e-3)):
        said = OdometryResult(
            SE3.identity(), residual=1.0, information=np.eye(6) / sigma**2, largest_sigma_m=sigma
        )
        kept.append(reference.renew(None, i, SE3.identity(), said)[0])
    # ln(2.2e-3) / ln(1e-3) is 0.886
    assert kept == [0, 0, 0, 0, 3, 3, 3]


def test_dvo_with_frames_kept_by_entropy_errs_less_than_from_frame_to_frame():
    frames, found = [view(i, ROOM, 0.002) for i in range(25)], []
    for reference in (Reference(), EntropyReference()):
        tracker = Tracker(odometer("dvo", "paper"), CAMERA, against=reference)
        found.append(error_m([tracker.add(f.stamp_s, f) for f in frames]))
    assert found[1] < found[0]


def test_errors_add_up_once_a_kept_frame():
    frames = [view(i, ROOM, 0.002) for i in range(25)]
    found = []
    for reference in (Reference(), KeyframeReference()):
        tracker = Tracker(odometer("dvo"), CAMERA, against=reference)
        found.append(error_m([tracker.add(f.stamp_s, f) for f in frames]))
    assert found[1] < found[0]


def test_a_keyframe_lasts_for_a_hand_or_some_degrees():
    """Of drift per keyframe there is the less the longer it lasts, and of its view the less left."""
    reference = KeyframeReference()
    kept_m = [reference.renew(None, i, SE3(np.eye(3), [0.02 * i, 0, 0]))[0] for i in range(16)]
    assert kept_m.count(0) in range(8, 14)  # 16 to 28 cm
    reference = KeyframeReference()
    turns = [SE3(so3.exp(np.array([0, np.radians(i), 0])), np.zeros(3)) for i in range(16)]
    kept_deg = [reference.renew(None, i, T)[0] for i, T in enumerate(turns)]
    assert kept_deg.count(0) in range(8, 15)
