"""The rule that picks one of several results."""

import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.candidates import Estimate, pick  # noqa: E402
from iclnuim.benchmark.odometry.protocol import OdometryResult, OdometryStatus  # noqa: E402


def test_the_first_candidate_stays_unless_another_is_better_by_the_margin():
    assert pick(2.0, [2.9, 1.0], float, margin=1.5) == 2.0
    assert pick(2.0, [3.1, 4.0, 3.5], float, margin=1.5) == 4.0
    assert pick(2.0, [2.0], float) == 2.0
    assert pick(2.0, [], float) == 2.0


@pytest.mark.parametrize(
    ("inliers", "status", "planes_win"),
    [
        (0.701, OdometryStatus.OK, False),  # a count that differs by rounding at the same motion
        (0.705, OdometryStatus.OK, False),
        (0.711, OdometryStatus.OK, True),
        (0.900, OdometryStatus.DEGENERATE, False),
    ],
)
def test_planes_alone_win_with_a_percent_more_of_matching_points(inliers, status, planes_win):
    joint = Estimate(OdometryResult(SE3.identity(), inliers=0.7), image=object())
    planes = Estimate(OdometryResult(SE3.identity(), status, inliers=inliers))
    assert (pick(joint, [planes], lambda one: one.inliers) is planes) is planes_win
