"""Which poses are doubted."""

import numpy as np
import pytest
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.protocol import OdometryResult, OdometryStatus, failure  # noqa: E402
from odometry_scenes import reasons_of_tracked  # noqa: E402


def test_the_frame_after_an_outlier_is_reported_as_the_motion_between_them_is_wrong():
    def states(places_m, bad, lost=()):
        def result_of(one, other):
            T = SE3(np.eye(3), [places_m[other] - places_m[one], 0, 0])
            return OdometryResult(
                T,
                OdometryStatus.DEGENERATE if other in bad else OdometryStatus.OK,
                reason="test" if other in bad else "",
            )

        return reasons_of_tracked(len(places_m), result_of, lost)

    outlier = "track: the pose before was an outlier"
    assert states([0, 1e-3, 2e-2, 3e-3, 4e-3], bad=(2,)) == ["", "", "test", outlier, ""]
    assert states([0, 1e-3, 3e-3, 3e-3, 4e-3], bad=(2,)) == ["", "", "test", "", ""]
    assert states([0, 1e-3, 2e-2, 3e-3, 4e-3], bad=()) == [""] * 5  # not doubted
    # a third of what counts as wrong: 2 cm
    assert states([0, 1e-3, 1.1e-2, 3e-3, 4e-3], bad=(2,)) == ["", "", "test", outlier, ""]
    assert states([0, 1e-3, 6.7e-3, 3e-3, 4e-3], bad=(2,)) == ["", "", "test", "", ""]
    assert states([0, 1e-3, 2e-2, 2e-2, 3e-3, 4e-3], bad=(2,), lost=(3,)) == [
        "",
        "",
        "test",
        "no image",
        outlier,
        "",
    ]
    assert states([0, 1e-3, 2e-3, 2e-3, 4e-3, 5e-3], bad=(2,), lost=(3,)) == [
        "",
        "",
        "test",
        "no image",
        "",
        "",
    ]


def test_an_outlier_after_a_new_reference_at_an_assumed_pose_is_noticed_too():
    def states(places_m):
        def result_of(one, other):
            if 2 <= other <= 6:
                return failure("test: unrelated")
            T = SE3(np.eye(3), [places_m[other] - places_m[one], 0, 0])
            return OdometryResult(
                T,
                OdometryStatus.DEGENERATE if other == 7 else OdometryStatus.OK,
                reason="test: uncertain" if other == 7 else "",
            )

        return reasons_of_tracked(len(places_m), result_of)[7:]

    after_six = [0.0] * 7
    outlier = "track: the pose before was an outlier"
    assert states([*after_six, 2e-2, 2e-3, 3e-3]) == ["test: uncertain", outlier, ""]
    assert states([*after_six, 1e-3, 2e-3, 3e-3]) == ["test: uncertain", "", ""]


def test_after_an_uncertain_pose_frames_are_reported_until_an_alignment_converges_or_is_certain():
    def reasons(sigmas_m, unconverged):
        def result_of(one, other):
            return OdometryResult(
                SE3.identity(), converged=other not in unconverged, largest_sigma_m=sigmas_m[other]
            )

        return reasons_of_tracked(len(sigmas_m), result_of)

    after = "track: not converged, and the pose before was uncertain"
    assert reasons([0, 1e-3, 0.03, 0.03, 1e-3, 1e-3], unconverged=(1, 3, 4, 5)) == [
        "",
        "",
        "",
        after,
        after,
        "",
    ]
    assert reasons([0, 1e-3, 0.03, 1e-3], unconverged=(1,)) == [""] * 4
    assert reasons([0, 1e-3, 0.01, 1e-3], unconverged=(1, 2, 3)) == [""] * 4


def test_an_unconverged_pose_far_from_its_prediction_is_reported():
    def reasons(places_m, angles_deg, unconverged):
        def result_of(one, other):
            axis = np.array([0, 0, np.radians(angles_deg[other] - angles_deg[one])])
            T = SE3(so3.exp(axis), [places_m[other] - places_m[one], 0, 0])
            return OdometryResult(T, converged=other not in unconverged, largest_sigma_m=1e-3)

        return reasons_of_tracked(len(places_m), result_of)

    far, still = "track: not converged, and far from the prediction", [0.0] * 4
    assert reasons([0, 0.03, 0.06, 0.09], still, unconverged=(2, 3)) == [""] * 4  # as predicted
    assert reasons([0, 0.01, 0.045, 0.08], still, unconverged=(2, 3)) == ["", "", far, ""]
    assert reasons([0, 0.01, 0.045, 0.08], still, unconverged=()) == [""] * 4
    assert reasons(still, [0, 0.2, 1.6, 3.0], unconverged=(2, 3)) == ["", "", far, ""]


@pytest.mark.parametrize(("off_deg", "is_outlier"), [(0.23, False), (0.47, True)])
def test_an_outlier_may_be_one_of_rotation(off_deg, is_outlier):
    """A third of what counts as wrong: 1 degree."""

    def result_of(one, other):
        angles_deg = [0, 0, off_deg, 0, 0]
        axis = np.array([0, 0, np.radians(angles_deg[other] - angles_deg[one])])
        status = OdometryStatus.DEGENERATE if other == 2 else OdometryStatus.OK
        return OdometryResult(SE3(so3.exp(axis), np.zeros(3)), status)

    reasons = reasons_of_tracked(5, result_of)
    assert (reasons[3] == "track: the pose before was an outlier") is is_outlier
