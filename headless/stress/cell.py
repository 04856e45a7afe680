"""The figures of one method on one stretch of frames: how wrong its poses are, and whether it noticed."""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, sample
from iclnuim.odometry.baselines import Baseline
from iclnuim.odometry.protocol import Frame, Odometer, Result, Status
from iclnuim.odometry.track import Tracked, Tracker

from .plan import Bounds
from .stretch import Stretch

_FIRST_POSE = AbsoluteErrorSettings(alignment=AlignmentSettings(method="origin"))
_SECOND_S, _SLACK_S = 1.0, 0.1
#: Diagnostics that changed by more than this against the unperturbed run are named as the cause.
_FEWER_INLIERS, _LARGER_RESIDUAL = 0.7, 1.5


@dataclass(frozen=True)
class Cell:
    """ATE and steps in metres and degrees, RMSE and largest; shares of the frames after the first; None where there is nothing to measure.

    false_successes: said to be good and wrong; false_alarms: said to be bad and right; noticed_after: frames from the first wrong pose to
    the first alarm, None where there was none, or nothing wrong; nees: by its 6 degrees of freedom. residual, inliers: medians.
    """

    frames: int
    coverage: float
    ate_m: float | None
    success: bool
    worst_step_m: float | None
    worst_step_deg: float | None
    wrong: int
    false_successes: int
    false_alarms: int
    alarms: int
    noticed_after: int | None
    nees: float | None
    cause: str
    residual: float | None
    inliers: float | None
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


class Witness:
    """An odometer that remembers which frame each alignment was against, and whose first guess is off by the stretch's `guess_off_deg`.

    The rotation is about an axis of the frame's own. Third-party odometers, which start from no motion, are started from that rotation.
    """

    def __init__(self, odometer: Odometer, stretch: Stretch) -> None:
        self.odometer, self.stretch = odometer, stretch
        self.name, self.reference = odometer.name, odometer.reference
        self.pairs: dict[float, float] = {}

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any:
        return frame.stamp_s, self.odometer.prepare(frame, camera)

    def align(self, reference: Any, current: Any, guess: SE3) -> Result:
        self.pairs[current[0]] = reference[0]
        if self.stretch.guess_off_deg:
            axis = self.stretch.generator(len(self.pairs)).standard_normal(3)
            turn = np.radians(self.stretch.guess_off_deg) * axis / np.linalg.norm(axis)
            off = SE3.exp(np.concatenate([np.zeros(3), turn]))
            guess = guess @ off
            if isinstance(self.odometer, Baseline):
                self.odometer.start = off
        return self.odometer.align(reference[1], current[1], guess)


def track_all(odometers: Iterable[Odometer], stretch: Stretch) -> list[tuple[list[Tracked], dict[float, float]]]:
    """Each frame is made once and given to one odometer after the other. Of each: what became of the frames, and stamps of frame and reference."""
    witnesses = [Witness(odometer, stretch) for odometer in odometers]
    trackers = [Tracker(witness, stretch.camera) for witness in witnesses]
    tracked: list[list[Tracked]] = [[] for _ in witnesses]
    for stamp_s, frame in stretch.frames():
        for tracker, results in zip(trackers, tracked, strict=True):
            results.append(tracker.add(stamp_s, frame))
    return [(results, witness.pairs) for results, witness in zip(tracked, witnesses, strict=True)]


@dataclass(frozen=True, eq=False)
class Poses:
    """What a method said: poses, and of each whether it was called good (n,); a system of others calls every pose good.

    alarms_s: stamps of all frames, after the first, that it did not call good, those without a pose among them.
    """

    trajectory: Trajectory
    good: np.ndarray
    alarms_s: np.ndarray
    frames: int

    @classmethod
    def of(cls, tracked: list[Tracked], min_fitness: float = 0.0) -> "Poses":
        """Of our protocol: good is OK, and of Open3D a fitness that is not too small; a pose that is not finite is none.

        min_fitness: of Open3D alone; the inliers of ours are a share of all pixels, and few of them may suffice.
        """
        kept = [f for f in tracked if not f.lost and np.isfinite(f.T_world_camera.matrix).all()]
        good = np.array([_called_good(f.result, min_fitness) for f in kept])
        bad = [f.stamp_s for f in tracked[1:] if f.lost or not _called_good(f.result, min_fitness)]
        poses = SE3.from_matrix(np.array([f.T_world_camera.matrix for f in kept]).reshape(-1, 4, 4))
        trajectory = Trajectory(np.array([f.stamp_s for f in kept]), poses)
        return cls(trajectory, good, np.array(bad), len(tracked))

    @classmethod
    def of_file(cls, trajectory: Trajectory, stamps_s: np.ndarray) -> "Poses":
        """Of a system that writes a pose for each frame that it tracked: frames without one are its alarms."""
        missing = stamps_s[np.abs(stamps_s[:, None] - trajectory.stamps_s).min(1, initial=np.inf) > 1e-6]
        return cls(trajectory, np.ones(len(trajectory), bool), missing[missing > stamps_s[0]], len(stamps_s))


def _called_good(result: Result, min_fitness: float) -> bool:
    """A baseline without inliers does not report any."""
    return result.status is Status.OK and not 0 < result.inliers < min_fitness


def cell(poses: Poses, truth: Trajectory, bounds: Bounds, clean: bool, extra: dict[str, Any] | None = None) -> Cell:
    """The figures. clean: nothing was done to the frames, so that every lost one is a false alarm. extra: diagnostics, as `diagnostics` returns them."""
    told = {"nees": None, "cause": "", "residual": None, "inliers": None, "seconds": 0.0, **(extra or {})}
    found = poses.trajectory
    if len(found) < 3:
        lost = len(poses.alarms_s) if clean else 0
        empty = (None, False, None, None, 0, 0, lost, len(poses.alarms_s), None)
        return Cell(poses.frames, len(found) / poses.frames, *empty, **told)
    Q, P = sample(truth, found.stamps_s), found.T_world_camera
    step_m, step_deg = _errors(Q, P, np.arange(len(found) - 1), np.arange(1, len(found)))
    wrong_step = np.concatenate([[False], (step_m > bounds.step_m) | (step_deg > bounds.step_deg)])
    start, end = _seconds(found.stamps_s)
    second_m, second_deg = _errors(Q, P, start, end)
    beyond = (second_m > bounds.second_m) | (second_deg > bounds.second_deg)
    drifted, noticed = np.zeros(len(found), bool), np.zeros(len(found), bool)
    drifted[end] = beyond
    noticed[end] = [
        _any_within(poses.alarms_s, found.stamps_s[a], found.stamps_s[b]) for a, b in zip(start, end, strict=True)
    ]
    wrong = wrong_step | drifted
    false_success = poses.good & (wrong_step | (drifted & ~noticed))
    false_alarm = ~poses.good & ~wrong
    lost = poses.frames - len(found)
    ate_m = ate_rmse_m(truth, found)
    coverage = len(found) / poses.frames
    success = ate_m <= bounds.success_m and coverage >= bounds.min_coverage
    return Cell(
        poses.frames,
        coverage,
        ate_m,
        success,
        float(step_m.max()),
        float(step_deg.max()),
        int(wrong.sum()),
        int(false_success.sum()),
        int(false_alarm.sum()) + (lost if clean else 0),
        len(poses.alarms_s),
        _noticed_after(found.stamps_s, wrong, poses.alarms_s),
        **told,
    )


def ate_rmse_m(truth: Trajectory, found: Trajectory) -> float:
    """After SE(3) alignment; where poses on a line or in one place leave that open, after alignment of the first pose."""
    try:
        return absolute_error(truth, found).translation_m.rmse
    except InputError:
        return absolute_error(truth, found, _FIRST_POSE).translation_m.rmse


def _errors(Q: SE3, P: SE3, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Metres and degrees by which the motions from start to end differ."""
    if not len(start):
        return np.zeros(0), np.zeros(0)
    E = (Q[start].inverse() @ Q[end]).inverse() @ (P[start].inverse() @ P[end])
    return np.linalg.norm(E.translation, axis=1), np.degrees(so3.angle(E.rotation))


def _seconds(stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of poses a second apart, as far as there are."""
    start = np.argmin(np.abs(stamps_s[:, None] - (stamps_s - _SECOND_S)), axis=0)
    fits = np.abs(stamps_s - stamps_s[start] - _SECOND_S) < _SLACK_S
    return start[fits], np.flatnonzero(fits)


def _any_within(alarms_s: np.ndarray, after_s: float, to_s: float) -> bool:
    return bool(((alarms_s > after_s) & (alarms_s <= to_s)).any())


def _noticed_after(stamps_s: np.ndarray, wrong: np.ndarray, alarms_s: np.ndarray) -> int | None:
    if not wrong.any():
        return None
    first_s = stamps_s[np.argmax(wrong)]
    later_s = alarms_s[alarms_s >= first_s - _SECOND_S]
    return int(((stamps_s >= first_s) & (stamps_s < later_s[0])).sum()) if len(later_s) else None


def diagnostics(
    tracked: list[Tracked], references_s: dict[float, float], truth: Trajectory, clean: Cell | None
) -> dict[str, Any]:
    """What an odometer's own results say: NEES, medians of residual and inliers, seconds, and the cause in a phrase. clean: the unperturbed run."""
    results = [f.result for f in tracked[1:]]
    used = [r for r in results if r.status is not Status.FAILED]
    residual, inliers = (_median([getattr(r, name) for r in used]) for name in ("residual", "inliers"))
    return {
        "nees": _nees(tracked, references_s, truth),
        "cause": _cause(results, residual, inliers, clean),
        "residual": residual,
        "inliers": inliers or None,
        "seconds": float(sum(r.seconds for r in results)),
    }


def _median(values: list[float]) -> float | None:
    finite = [v for v in values if np.isfinite(v)]
    return float(np.median(finite)) if finite else None


def _nees(tracked: list[Tracked], references_s: dict[float, float], truth: Trajectory) -> float | None:
    """Squared error of each alignment, by its information and its 6 degrees of freedom, mean over frames; None without a noise model.

    The information is of a twist in the reference camera's frame, to be put before the pose.
    """
    values = []
    for f in tracked:
        if f.lost or f.stamp_s not in references_s or not np.isfinite(f.result.largest_sigma_m):
            continue
        pair = sample(truth, np.array([references_s[f.stamp_s], f.stamp_s]))
        error = (pair[0].inverse() @ pair[1] @ f.result.T_reference_camera.inverse()).log()
        values.append(float(error @ f.result.information @ error) / 6)
    return float(np.mean(values)) if values else None


def _cause(results: list[Result], residual: float | None, inliers: float | None, clean: Cell | None) -> str:
    """The first that applies: why frames were lost, that they were under-constrained, fewer inliers, a larger residual; else nothing."""
    total = max(1, len(results))
    lost = Counter(re.sub(r"[-+]?\d[\d.,]*%?", "N", r.reason) for r in results if r.status is Status.FAILED)
    if lost:
        reason, count = lost.most_common(1)[0]
        return f"{count / total:.0%} lost: {reason}"
    degenerate = sum(r.status is Status.DEGENERATE for r in results)
    if degenerate > 0.1 * total:
        return f"{degenerate / total:.0%} under-constrained"
    if clean and inliers and clean.inliers and inliers < _FEWER_INLIERS * clean.inliers:
        return f"inliers {inliers:.0%} instead of {clean.inliers:.0%}"
    if clean and residual and clean.residual and residual > _LARGER_RESIDUAL * clean.residual:
        return f"residual {residual / clean.residual:.1f} times as large"
    return ""
