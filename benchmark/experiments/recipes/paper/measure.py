"""Measures one cell of the paper's experiments: the motion, ATE and RPE, and its surface."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.errors import InputError, WorkError
from iclnuim.evaluation.absolute_error import AbsoluteError, absolute_error
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

from ...cell import Measured
from ...memory import peak_mb, reset_peak
from .keys import Meter, PaperTask

#: Number of trajectory points stored for charts.
_DRAWN = 300
_SECOND = RelativeErrorSettings(1.0, "seconds")
#: The file of the estimated trajectory in the folder of a cell.
TRAJECTORY = "trajectory.txt"


def measure(task: PaperTask, folder: Path, advance: Callable[[int], object]) -> dict[str, Any]:
    """The figures of a cell, with `times` (core-seconds, ms per frame, largest memory in MB) and `path`, data for
    charts; if the odometer failed, with the reason as `failed`.

    Writes trajectory.txt and, with a surface, surface.jpg and heat.jpg into the folder.
    """
    started = time.process_time()
    reset_peak()
    times: dict[str, float] = {}
    figures: dict[str, Any] = {}
    sequence = StoredSequence(task.folder)
    truth = _truth(sequence)
    try:
        trajectory = _motion(task, sequence, Meter(advance), figures, times)
        write_trajectory(folder / TRAJECTORY, trajectory, "tum")
        error = absolute_error(truth, trajectory)
        figures |= _trajectory_figures(truth, trajectory, error)
        figures["path"] = _drawn(truth, error, task.first)
        if task.model:
            _add_surface(task, truth, folder, advance, figures, times)
    except (InputError, WorkError) as problem:
        figures["failed"] = problem.worded()
    return {**figures, "times": _with_costs(times, started)}


def measure_only_surface(
    task: PaperTask, tracked: Measured, advance: Callable[[int], object]
) -> dict[str, Any]:
    """The figures of a cell that is measured without a surface, and its surface; the pictures are
    added to the cell's folder.
    """
    figures = {name: value for name, value in tracked.figures.items() if name != "surface"}
    if not task.model:
        return figures
    started = time.process_time()
    reset_peak()
    times = dict(figures["times"])
    try:
        truth = _truth(StoredSequence(task.folder))
        _add_surface(task, truth, tracked.folder, advance, figures, times)
    except (InputError, WorkError) as problem:
        figures["failed"] = problem.worded()
    return {**figures, "times": _with_costs(times, started)}


def _truth(sequence: StoredSequence) -> Trajectory:
    truth = sequence.truth
    if truth is None:
        raise InputError("a ground truth in the folder", path=sequence.folder, found="none")
    return truth


def _add_surface(
    task: PaperTask,
    truth: Trajectory,
    folder: Path,
    advance: Callable[[int], object],
    figures: dict[str, Any],
    times: dict[str, float],
) -> None:
    """Add the surface along the trajectory in the folder: as it is stored, so that it is the same
    whenever it is measured.
    """
    from .surface import measure_surface

    trajectory = read_trajectory(folder / TRAJECTORY).trajectory
    found = measure_surface(task, truth, trajectory, folder, Meter(advance))
    times |= found.pop("times")
    figures["surface"] = found


def _with_costs(times: dict[str, float], started: float) -> dict[str, float]:
    """Times with what this process took since it started, added to what former ones took."""
    cpu_s = times.get("cpu_s", 0.0) + time.process_time() - started
    peaks = [mb for mb in (times.get("peak_mb"), peak_mb()) if mb is not None]
    known = {"peak_mb": max(peaks)} if peaks else {}
    return {**times, "cpu_s": cpu_s, **known}


def _motion(
    task: PaperTask,
    stored: StoredSequence,
    meter: Meter,
    figures: dict[str, Any],
    times: dict[str, float],
) -> Trajectory:
    """The estimated trajectory.

    The odometer's counts of frames (lost, degenerate ...) are added to the figures.
    """
    from iclnuim.benchmark.odometry.run import Sequence, run_odometers

    key = task.key
    sequence = Sequence(stored)
    if task.trajectory:
        frames = min(len(sequence), task.first or len(sequence))
        trajectory = read_trajectory(task.trajectory).trajectory
        figures |= {"frames": frames, "coverage": len(trajectory) / frames}
        return trajectory
    from iclnuim.benchmark.fusion.reference import make_reference
    from iclnuim.benchmark.odometry.registry import odometer

    against = partial(make_reference, key.reference, preset=key.preset)
    started = time.process_time()
    odometers = [odometer(key.odometer, key.preset)]
    (run,) = run_odometers(odometers, sequence, progress=meter, frames=task.first, against=against)
    found = run.to_dict()
    times["track_s"] = time.process_time() - started
    times |= {name: found[name] for name in ("ms_median", "ms_95")}
    counts = ("frames", "lost", "coverage", "not_converged", "degenerate")
    figures |= {name: found[name] for name in counts}
    return run.trajectory


def _trajectory_figures(truth: Trajectory, trajectory: Trajectory, error: AbsoluteError) -> dict:
    """Six statistics of the ATE after SE(3) alignment, and of the RPE over one second (None if the
    trajectory is shorter).
    """
    try:
        rpe = relative_error(truth, trajectory, _SECOND).translation_m.to_dict()
    except InputError:
        rpe = None
    return {"ate_m": error.translation_m.to_dict(), "rpe_1s_m": rpe}


def _drawn(truth: Trajectory, error: AbsoluteError, first: int | None) -> dict[str, Any]:
    """Data for charts, of some of the frames: positions of truth and estimate in metres, and the
    error in metres over time.
    """
    rows = np.unique(np.linspace(0, len(error.stamps_s) - 1, _DRAWN).astype(int))
    until = np.searchsorted(truth.stamps_s, error.stamps_s[-1], side="right")
    whole = truth.positions_m[: until if first else None]
    shown = np.unique(np.linspace(0, len(whole) - 1, _DRAWN).astype(int))
    return {
        "stamps_s": np.round(error.stamps_s[rows], 4).tolist(),
        "truth_m": np.round(whole[shown], 4).tolist(),
        "estimate_m": np.round(error.aligned.translation[rows], 4).tolist(),
        "error_m": np.round(error.translation_error_m[rows], 6).tolist(),
    }
