"""The figures of one method on one segment of frames: the errors of its poses, and whether it
reported them.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from iclnuim.benchmark.odometry.baselines import Baseline
from iclnuim.benchmark.odometry.protocol import (
    Frame,
    Odometer,
    OdometryResult,
    OdometryStatus,
    failure,
)
from iclnuim.benchmark.odometry.track import Tracked, Tracker
from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, sample

from ..perturbations.plan import Bounds
from ..perturbations.segment import Segment

_FIRST_POSE = AbsoluteErrorSettings(alignment=AlignmentSettings(method="origin"))
#: Drift is over pairs of poses that are a second apart, to within the slack.
_SECOND_S = 1.0
_SLACK_S = 0.1
#: A number in a reason, which differs from frame to frame.
_NUMBER = re.compile(r"[-+]?\d[\d.,]*%?")
#: A share of under-constrained frames above this is named as the cause.
_UNDER_CONSTRAINED = 0.1
#: A diagnostic whose ratio to the unperturbed run is beyond these limits is named as the cause.
_FEWER_INLIERS = 0.7
_LARGER_RESIDUAL = 1.5


@dataclass(frozen=True)
class Outcome:
    """ate_m: RMSE. worst_step_m, worst_step_deg: largest error of a step. Figures are None where
    nothing can be measured.

    wrong, false_successes, false_alarms, alarms: counts of frames. False successes are wrong poses
    reported as good, false alarms are right poses reported as bad. noticed_after: number of frames
    from the first wrong pose to the first alarm; None if there was no alarm or no wrong pose. nees:
    divided by its 6 degrees of freedom. residual, inliers: medians.
    """

    frames: int
    coverage: float
    ate_m: float | None = None
    success: bool = False
    worst_step_m: float | None = None
    worst_step_deg: float | None = None
    wrong: int = 0
    false_successes: int = 0
    false_alarms: int = 0
    alarms: int = 0
    noticed_after: int | None = None
    nees: float | None = None
    cause: str = ""
    residual: float | None = None
    inliers: float | None = None
    seconds: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


class RecordingOdometer:
    """Wraps an odometer: records the reference frame of each alignment, and rotates its initial
    guess by the segment's `guess_off_deg`.

    Each frame has its own random rotation axis. Third-party odometers, which start from no motion,
    start from that rotation.
    """

    def __init__(self, odometer: Odometer, segment: Segment) -> None:
        self.odometer = odometer
        self.segment = segment
        self.name = odometer.name
        self.reference = odometer.reference
        self.pairs: dict[float, float] = {}

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any:
        return frame.stamp_s, self.odometer.prepare(frame, camera)

    def align(self, reference: Any, current: Any, guess: SE3) -> OdometryResult:
        self.pairs[current[0]] = reference[0]
        if self.segment.guess_off_deg:
            axis = self.segment.generator(len(self.pairs)).standard_normal(3)
            rotation = np.radians(self.segment.guess_off_deg) * axis / np.linalg.norm(axis)
            off = SE3.exp(np.concatenate([np.zeros(3), rotation]))
            guess = guess @ off
            if isinstance(self.odometer, Baseline):
                self.odometer.start = off
        try:
            return self.odometer.align(reference[1], current[1], guess)
        except MemoryError:
            raise
        except Exception as error:  # must not end other methods; OpenCV's have no other base
            return failure(f"crashed: {type(error).__name__}")


def track_all(
    odometers: Iterable[Odometer], segment: Segment
) -> list[tuple[list[Tracked], dict[float, float]]]:
    """Track the segment with all odometers; each frame is loaded once.

    Returns for each odometer the tracked frames, and the stamps of frame -> reference.
    """
    recorders = [RecordingOdometer(odometer, segment) for odometer in odometers]
    trackers = [Tracker(recorder, segment.camera) for recorder in recorders]
    tracked: list[list[Tracked]] = [[] for _ in recorders]
    for stamp_s, frame in segment.frames():
        for tracker, results in zip(trackers, tracked, strict=True):
            results.append(tracker.add(stamp_s, frame))
    return [(results, recorder.pairs) for results, recorder in zip(tracked, recorders, strict=True)]


@dataclass(frozen=True, eq=False)
class Poses:
    """Output of a method. good: (n,) whether each pose was reported as good; an external system
    reports every pose as good.

    alarms_s: stamps of all frames after the first that were not reported as good, including those
    without a pose.
    """

    trajectory: Trajectory
    good: np.ndarray
    alarms_s: np.ndarray
    frames: int

    @classmethod
    def of(cls, tracked: list[Tracked], min_fitness: float = 0.0) -> "Poses":
        """From the results of an odometer. A pose is good if its status is OK and, for Open3D, its
        fitness is large enough. A pose that is not finite is ignored.

        min_fitness: only for Open3D; the inliers of our odometers are a share of all pixels, of
        which few may suffice.
        """
        kept = [f for f in tracked if not f.lost and np.isfinite(f.T_world_camera.matrix).all()]
        good = np.array([_is_good(f.result, min_fitness) for f in kept])
        bad = [f.stamp_s for f in tracked[1:] if f.lost or not _is_good(f.result, min_fitness)]
        poses = SE3.from_matrix(np.array([f.T_world_camera.matrix for f in kept]).reshape(-1, 4, 4))
        trajectory = Trajectory(np.array([f.stamp_s for f in kept]), poses)
        return cls(trajectory, good, np.array(bad), len(tracked))

    @classmethod
    def of_file(cls, trajectory: Trajectory, stamps_s: np.ndarray) -> "Poses":
        """From the trajectory of a system that writes a pose for each tracked frame: frames without
        a pose are alarms.
        """
        nearest_s = np.abs(stamps_s[:, None] - trajectory.stamps_s).min(1, initial=np.inf)
        missing_s = stamps_s[nearest_s > 1e-6]
        good = np.ones(len(trajectory), bool)
        return cls(trajectory, good, missing_s[missing_s > stamps_s[0]], len(stamps_s))


def _is_good(result: OdometryResult, min_fitness: float) -> bool:
    """Whether the method reported success.

    Zero inliers means that a baseline does not report inliers.
    """
    return result.status is OdometryStatus.OK and not 0 < result.inliers < min_fitness


def outcome(
    poses: Poses,
    truth: Trajectory,
    bounds: Bounds,
    clean: bool,
    extra: dict[str, Any] | None = None,
) -> Outcome:
    """Compute the figures. clean: the frames are unperturbed, so that every lost frame is a false
    alarm. extra: the result of `diagnostics`.
    """
    found = poses.trajectory
    frames = poses.frames
    alarms = len(poses.alarms_s)
    reported = extra or {}
    coverage = len(found) / frames
    if len(found) < 3:
        lost = alarms if clean else 0
        return Outcome(frames, coverage, alarms=alarms, false_alarms=lost, **reported)
    Q = sample(truth, found.stamps_s)
    P = found.T_world_camera
    step_m, step_deg = _errors(Q, P, np.arange(len(found) - 1), np.arange(1, len(found)))
    wrong_step = np.concatenate([[False], (step_m > bounds.step_m) | (step_deg > bounds.step_deg)])
    start, end = _seconds(found.stamps_s)
    second_m, second_deg = _errors(Q, P, start, end)
    drifted = np.zeros(len(found), bool)
    drifted[end] = (second_m > bounds.second_m) | (second_deg > bounds.second_deg)
    noticed = np.zeros(len(found), bool)
    noticed[end] = _alarms_within(poses.alarms_s, found.stamps_s[start], found.stamps_s[end])
    wrong = wrong_step | drifted
    false_success = poses.good & (wrong_step | (drifted & ~noticed))
    false_alarm = ~poses.good & ~wrong
    lost = frames - len(found) if clean else 0
    ate_m = ate_rmse_m(truth, found)
    return Outcome(
        frames=frames,
        coverage=coverage,
        ate_m=ate_m,
        success=ate_m <= bounds.success_m and coverage >= bounds.min_coverage,
        worst_step_m=float(step_m.max()),
        worst_step_deg=float(step_deg.max()),
        wrong=int(wrong.sum()),
        false_successes=int(false_success.sum()),
        false_alarms=int(false_alarm.sum()) + lost,
        alarms=alarms,
        noticed_after=_noticed_after(found.stamps_s, wrong, poses.alarms_s),
        **reported,
    )


def ate_rmse_m(truth: Trajectory, found: Trajectory) -> float:
    """ATE after SE(3) alignment; if poses on a line or at one point leave the alignment
    undetermined, after alignment of the first pose.
    """
    try:
        return absolute_error(truth, found).translation_m.rmse
    except InputError:
        return absolute_error(truth, found, _FIRST_POSE).translation_m.rmse


def _errors(Q: SE3, P: SE3, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the motions from start to end, in metres and degrees."""
    if not len(start):
        return np.zeros(0), np.zeros(0)
    E = (Q[start].inverse() @ Q[end]).inverse() @ (P[start].inverse() @ P[end])
    return np.linalg.norm(E.translation, axis=1), np.degrees(so3.angle(E.rotation))


def _seconds(stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of all pairs of poses that are one second apart."""
    start = np.argmin(np.abs(stamps_s[:, None] - (stamps_s - _SECOND_S)), axis=0)
    fits = np.abs(stamps_s - stamps_s[start] - _SECOND_S) < _SLACK_S
    return start[fits], np.flatnonzero(fits)


def _alarms_within(alarms_s: np.ndarray, after_s: np.ndarray, to_s: np.ndarray) -> np.ndarray:
    """Whether there is an alarm in each window (after, to]: an alarm at its first frame is of the
    motion before it.
    """
    later = alarms_s[:, None] > after_s
    return (later & (alarms_s[:, None] <= to_s)).any(axis=0)


def _noticed_after(stamps_s: np.ndarray, wrong: np.ndarray, alarms_s: np.ndarray) -> int | None:
    if not wrong.any():
        return None
    first_s = stamps_s[np.argmax(wrong)]
    later_s = alarms_s[alarms_s >= first_s - _SECOND_S]
    if not len(later_s):
        return None
    return int(((stamps_s >= first_s) & (stamps_s < later_s[0])).sum())


def diagnostics(
    tracked: list[Tracked],
    references_s: dict[float, float],
    truth: Trajectory,
    clean: Outcome | None,
) -> dict[str, Any]:
    """Diagnostics of an odometer's results: NEES, medians of residual and inliers, seconds, and the
    cause of failure as text. clean: the unperturbed run.
    """
    results = [f.result for f in tracked[1:]]
    used = [r for r in results if r.status is not OdometryStatus.FAILED]
    residual = median(r.residual for r in used if np.isfinite(r.residual))
    inliers = median(r.inliers for r in used if np.isfinite(r.inliers))
    return {
        "nees": _nees(tracked, references_s, truth),
        "cause": _cause(results, residual, inliers, clean),
        "residual": residual,
        "inliers": inliers or None,
        "seconds": float(sum(r.seconds for r in results)),
    }


def median(values: Iterable[float | None]) -> float | None:
    """Of the values that are known; None if there is none."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def mean(values: Iterable[float | None]) -> float | None:
    """Of the values that are known; None if there is none."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _nees(
    tracked: list[Tracked], references_s: dict[float, float], truth: Trajectory
) -> float | None:
    """Mean over frames of the squared error of each alignment, weighted by its information and
    divided by 6; None without a noise model.

    The information is that of a twist in the reference camera's frame, which multiplies the pose
    from the left.
    """
    values = []
    for f in tracked:
        if f.lost or f.stamp_s not in references_s or not np.isfinite(f.result.largest_sigma_m):
            continue
        pair = sample(truth, np.array([references_s[f.stamp_s], f.stamp_s]))
        error = (pair[0].inverse() @ pair[1] @ f.result.T_reference_camera.inverse()).log()
        values.append(float(error @ f.result.information @ error) / 6)
    return mean(values)


def _cause(
    results: list[OdometryResult],
    residual: float | None,
    inliers: float | None,
    clean: Outcome | None,
) -> str:
    """The first cause that applies: why frames were lost, under-constrained frames, fewer inliers,
    a larger residual; else an empty text.
    """
    total = max(1, len(results))
    reasons = [r.reason for r in results if r.status is OdometryStatus.FAILED]
    if reasons:
        alike = Counter(_NUMBER.sub("N", reason) for reason in reasons)
        pattern, count = alike.most_common(1)[0]
        same = [reason for reason in reasons if _NUMBER.sub("N", reason) == pattern]
        return f"{count / total:.0%} lost: {_middle(same)}"
    degenerate = sum(r.status is OdometryStatus.DEGENERATE for r in results)
    if degenerate > _UNDER_CONSTRAINED * total:
        return f"{degenerate / total:.0%} under-constrained"
    if clean and inliers and clean.inliers and inliers < _FEWER_INLIERS * clean.inliers:
        return f"inliers {inliers:.0%} instead of {clean.inliers:.0%}"
    if clean and residual and clean.residual and residual > _LARGER_RESIDUAL * clean.residual:
        return f"residual {residual / clean.residual:.1f} times as large"
    return ""


def _middle(reasons: list[str]) -> str:
    """Of reasons that differ in their numbers alone: the one whose first number is the median."""

    def first_number(reason: str) -> float:
        found = _NUMBER.search(reason)
        return float(found[0].rstrip("%.,").replace(",", "")) if found else 0.0

    return sorted(reasons, key=first_number)[len(reasons) // 2]
