"""Reads the trajectory that a system wrote, matches it to the stamps of the frames, and evaluates
it; combines several runs into a row of `bench odometry`.

Only the trajectory is evaluated; how the process ended is reported in a note.
"""

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
from iclnuim.doubt.explained_error import ExplainedError
from iclnuim.doubt.time_axis import best_offset
from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.evaluation.associate import AssociationSettings, associate
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.evaluation.scale_drift import scale_drift
from iclnuim.formats.files import atomic_write_text, is_file, read_text
from iclnuim.geometry.trajectory import FRAME_RATE_HZ, Trajectory, frames_of_stamps
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

from .process import Ended
from .staging import StagedSequence
from .system import ResultSettings, System

#: A pose matches a frame if their stamps differ by less than 1 ms and by less than a quarter of a
#: frame: enough for six digits, or a float.
_MATCH_S = 1e-3
_MATCH_SHARE = 0.25
#: Coverage below which a note reports it.
_WHOLE = 0.9
_SECOND = RelativeErrorSettings(1.0, "seconds")


@dataclass(frozen=True)
class Evaluation:
    """Result of one trajectory of one run: number of frames with a pose, RMSE in metres (None if it
    cannot be computed), and notes. Of a system without scale: its scale by Sim(3), and the change
    of the scale along the path, as a share. Of one with an IMU: the seconds from the first frame
    to its initialisation.
    """

    matched: int
    ate_rmse_m: float | None
    rpe_1s_rmse_m: float | None
    notes: tuple[str, ...]
    scale: float | None = None
    scale_change: float | None = None
    initialised_s: float | None = None


def evaluate_run(
    sequence: StagedSequence, system: System, name: str, run: Path, ended: Ended
) -> Evaluation:
    """Read the trajectory `name` that a run wrote into run/out, write it as run/matched/NAME.txt
    (TUM, with the stamps of the frames), and evaluate that file.
    """
    result = system.trajectories[name]
    notes = _how(ended)
    initialised_s = None
    if system.settings.initialised:
        initialised_s, imu_notes = _initialised(sequence, system, run)
        notes += imu_notes
    file = run / "out" / result.file
    try:
        written, read_notes = _read(file, run / "matched", result, cut=ended.how != "exit 0")
        found, match_notes = _matched(sequence, system, result, written)
        notes = [*read_notes, *match_notes, *notes]
    except InputError as error:
        empty = f"wrote nothing{_last_line(run / 'log.txt')}"
        what = empty if _empty(file) else error.worded().removeprefix(f"{file.parent}/")
        return Evaluation(0, None, None, (what, *notes), initialised_s=initialised_s)
    target = run / "matched" / f"{name}.txt"
    write_trajectory(target, found, "tum")
    trajectory = read_trajectory(target, "tum").trajectory
    measured = _measured(sequence, system, trajectory, notes)
    return replace(measured, initialised_s=initialised_s)


def _initialised(
    sequence: StagedSequence, system: System, run: Path
) -> tuple[float | None, list[str]]:
    """Seconds from the first frame to the first initialisation of the IMU, None without one, and
    notes. Lines that are no stamps are those of a run that was killed.
    """
    file = run / "out" / (system.settings.initialised or "")
    stamps_s = []
    for text in file.read_bytes().split() if is_file(file) else []:
        with suppress(ValueError):
            stamps_s.append(float(text))
    if not stamps_s:
        return None, ["its IMU was never initialised"]
    times = len(stamps_s)
    notes = [f"its IMU was initialised {times} times"] if times > 1 else []
    first_s = sequence.stamps_s[0] + sequence.offset_s(system.settings.stage)
    return stamps_s[0] - first_s, notes


def _how(ended: Ended) -> list[str]:
    if ended.how == "time limit":
        return [f"killed at the time limit of {ended.wall_s:.0f} s"]
    return [] if ended.how == "exit 0" else [f"ended by {ended.how}"]


def _empty(file: Path) -> bool:
    return not file.is_file() or not file.read_bytes().strip()


def _last_line(log: Path) -> str:
    if not log.is_file():
        return ""
    lines = log.read_bytes().decode("utf-8", "replace").strip().splitlines()
    return "".join(f"; its last line: {line.strip()[:120]}" for line in lines[-1:])


def _read(
    file: Path, matched: Path, result: ResultSettings, cut: bool
) -> tuple[Trajectory, list[str]]:
    """Read a trajectory. Rows without a finite pose are frames that the system did not track; a
    note counts them. cut: the last line may be incomplete.
    """
    matched.mkdir(exist_ok=True)
    lines = read_text(file, "a trajectory").splitlines(keepends=True)
    notes = []
    if cut and not lines[-1].endswith("\n"):
        file = matched / f"whole_{file.name}"
        atomic_write_text(file, "".join(lines[:-1]))
    rate_hz = 1.0 if result.counted else FRAME_RATE_HZ
    loaded = read_trajectory(file, result.format, rate_hz=rate_hz)
    if loaded.read_as.lost:
        notes.append(f"{loaded.read_as.lost} poses with NaN or infinity")
    if loaded.read_as.repeated:
        notes.append(f"{loaded.read_as.repeated} repeated stamps left out")
    return loaded.trajectory, notes


def _matched(
    sequence: StagedSequence, system: System, result: ResultSettings, written: Trajectory
) -> tuple[Trajectory, list[str]]:
    """The poses that match a frame, with the stamp of that frame, and notes.

    Raises InputError if less than half match.
    """
    own_s = sequence.stamps_s
    if result.counted:
        numbers = np.rint(frames_of_stamps(written.stamps_s, 1.0)).astype(int)
        if numbers[-1] >= len(own_s):
            raise InputError(f"frames 0 to {len(own_s) - 1}", found=numbers[-1])
        theirs_s = own_s[numbers]
        window_s = 1e-9
    else:
        theirs_s = written.stamps_s - sequence.offset_s(system.settings.stage)
        window_s = min(_MATCH_S, _MATCH_SHARE / sequence.rate_hz)
    pairs = associate(own_s, theirs_s, AssociationSettings(max_difference_s=window_s))
    left = len(written) - len(pairs)
    if 2 * len(pairs) < min(len(written), len(own_s)):
        found = f"{left} of {len(written)} that match no frame, {_range(theirs_s)}"
        theirs = Trajectory(theirs_s, written.T_world_camera)
        if sequence.truth and (fit := best_offset(sequence.truth, theirs)):
            found += f"; they fit best {-fit.offset_s:+.9g} s off"
        raise InputError(f"the stamps of the frames, {_range(own_s)}", found=found)
    notes = []
    if left:
        notes.append(f"{left} stamps that match no frame")
    return Trajectory(own_s[pairs.first], written.T_world_camera[pairs.second]), notes


def _range(stamps_s: np.ndarray) -> str:
    return f"{stamps_s[0]:.6f} to {stamps_s[-1]:.6f} s"


def _truth(sequence: StagedSequence, notes: list[str]) -> Trajectory | None:
    """The ground truth from where the evaluation begins, with a note if that is not the start."""
    truth = sequence.truth
    if truth is None or not sequence.skip_s:
        return truth
    notes.append(f"errors without the first {sequence.skip_s:g} s")
    return truth[truth.stamps_s >= sequence.stamps_s[0] + sequence.skip_s - 1e-9]


def _measured(
    sequence: StagedSequence, system: System, found: Trajectory, notes: list[str]
) -> Evaluation:
    coverage = len(found) / len(sequence.pairs)
    if coverage < _WHOLE:
        notes.insert(0, f"covers {coverage:.0%} of the frames")
    truth = _truth(sequence, notes)
    if truth is None:
        return Evaluation(len(found), None, None, tuple(notes))
    errors = _errors if system.settings.has_scale else _errors_without_scale
    return errors(truth, found, notes)


def _errors(truth: Trajectory, found: Trajectory, notes: list[str]) -> Evaluation:
    ate_m = None
    rpe_m = None
    try:
        ate_m = absolute_error(truth, found).translation_m.rmse
    except InputError as error:
        notes.append(error.worded())
    with suppress(InputError):  # a trajectory may be too short for pairs one second apart
        rpe_m = relative_error(truth, found, _SECOND).translation_m.rmse
    if ate_m is None:
        return Evaluation(len(found), None, rpe_m, tuple(notes))
    explained = ExplainedError.of_trajectories(truth, found, AbsoluteErrorSettings())
    if explained is not None:
        notes.insert(0, _explained(explained))
    return Evaluation(len(found), ate_m, rpe_m, tuple(notes))


def _errors_without_scale(truth: Trajectory, found: Trajectory, notes: list[str]) -> Evaluation:
    """As _errors(), after an alignment by Sim(3), with a note on the scale."""
    try:
        settings = AbsoluteErrorSettings(alignment=AlignmentSettings("sim3"))
        error = absolute_error(truth, found, settings)
    except InputError as reason:
        return Evaluation(len(found), None, None, (*notes, reason.worded()))
    rpe_m = None
    with suppress(InputError):  # a trajectory may be too short for pairs one second apart
        second = _SECOND.changed(correct_scale=True)
        rpe_m = relative_error(truth, found, second).translation_m.rmse
    scale = error.alignment.scale
    drift = scale_drift(error.reference.translation, error.aligned.translation / scale)
    text = f"no scale of its own: errors after Sim(3), whose scale is {scale:.6g}"
    notes.insert(0, text if drift is None else f"{text}; it changes by {drift}")
    return Evaluation(
        len(found),
        error.translation_m.rmse,
        rpe_m,
        tuple(notes),
        scale=scale,
        scale_change=None if drift is None else drift.change,
    )


def _explained(explained: ExplainedError) -> str:
    time = explained.explanation.time
    if explained.explanation.kinds != ["offset"] or time is None:
        return explained.sentence()
    corrected = f"{1e3 * explained.found.translation_m.rmse:.3f} mm with this offset corrected"
    return f"stamps are {-time.axis.offset_s:+.9g} s off: {corrected}"


def row(name: str, frames: int, runs: Sequence[tuple[Ended, Evaluation]]) -> dict:
    """Combine several runs into a row of `bench odometry`: medians over the runs that have a
    figure, quartiles of the ATE, and the notes of all runs.

    Times per frame are those of the whole process, including its start and reading the images.
    """
    ates = [v.ate_rmse_m for _, v in runs if v.ate_rmse_m is not None]
    median_ms = _middle([1e3 * ended.wall_s / frames for ended, v in runs if v.matched])
    matched = float(np.median([v.matched for _, v in runs]))
    return {
        "odometer": name,
        "frames": frames,
        "lost": frames - math.floor(matched),
        "coverage": matched / frames,
        "not_converged": None,
        "degenerate": None,
        "ms_median": median_ms,
        "ms_95": None,
        "frames_per_s": 1e3 / median_ms if median_ms else None,
        "ate_rmse_m": _middle(ates),
        "rpe_1s_rmse_m": _middle([v.rpe_1s_rmse_m for _, v in runs]),
        "ate_quartiles_m": np.percentile(ates, (25, 75)).tolist() if ates else None,
        "runs": len(runs),
        "good_runs": sum(v.matched > 0 for _, v in runs),
        "wall_s": _middle([ended.wall_s for ended, _ in runs]),
        "cpu_s": _middle([ended.cpu_s for ended, _ in runs]),
        "peak_bytes": _middle([ended.peak_bytes for ended, _ in runs]),
        "scale": _middle([v.scale for _, v in runs]),
        "scale_change": _middle([v.scale_change for _, v in runs]),
        "initialised_s": _middle([v.initialised_s for _, v in runs]),
        "notes": _joined(runs),
    }


def _middle(values: Iterable[float | None]) -> float | None:
    """The median of the values that are known; None if there is none."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _joined(runs: Sequence[tuple[Ended, Evaluation]]) -> list[str]:
    """Every note once, preceded by the numbers of its runs unless it applies to all."""
    texts = chain.from_iterable(evaluation.notes for _, evaluation in runs)
    found = []
    for text in dict.fromkeys(texts):
        numbers = [str(number) for number, (_, v) in enumerate(runs, 1) if text in v.notes]
        found.append(text if len(numbers) == len(runs) else f"run {', '.join(numbers)}: {text}")
    return found
