"""A figure of runs: trajectories with the ground truth, residuals, and uncertainty over time."""

from typing import Any

import numpy as np
from iclnuim.errors import InputError, WorkError
from iclnuim.evaluation.absolute_error import absolute_error
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.shown import COLOURS
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .protocol import OdometryStatus
from .run import OdometryRun
from .solver import MAX_SIGMA_M, MIN_EIGENVALUE

SIZE_INCHES = (12, 6)


def figure(runs: list[OdometryRun]) -> Figure:
    """All runs in one figure.

    If there is only one, its lost frames are black and its degenerate ones are marked.
    """
    drawing = Figure(figsize=SIZE_INCHES, layout="constrained")
    _fill(drawing, runs)
    return drawing


def show(runs: list[OdometryRun]) -> None:
    """Open a window and return when it is closed. Raises WorkError if there is no display."""
    from matplotlib import pyplot

    try:
        drawing = pyplot.figure(figsize=SIZE_INCHES, layout="constrained")
        display = pyplot.get_backend().lower() != "agg"
    except Exception as error:  # each GUI toolkit raises its own class
        raise WorkError(f"no window can be opened ({error}); try a picture file instead") from None
    if not display:
        raise WorkError("no display for a window; try a picture file instead")
    _fill(drawing, runs)
    pyplot.show()


def _fill(drawing: Figure, runs: list[OdometryRun]) -> None:
    """Draw all panels."""
    grid = drawing.add_gridspec(2, 2, width_ratios=(1, 1.2))
    _trajectories(drawing.add_subplot(grid[:, 0]), runs)
    _residuals(drawing.add_subplot(grid[0, 1]), runs)
    _uncertainty(drawing.add_subplot(grid[1, 1]), runs)


def _residuals(axes: Axes, runs: list[OdometryRun]) -> None:
    """The residual of a single run has the unit of its method; those of several are divided by
    their medians.
    """
    residuals = _values(runs, "residual")
    label = "method's own unit"
    if len(runs) > 1:
        label = "share of each median"
        for k, values in enumerate(residuals):
            if np.isfinite(values[1:]).any():
                residuals[k] = values / (np.nanmedian(values[1:]) or 1.0)
    _over_time(axes, runs, residuals, OdometryStatus.FAILED, color="black", linewidth=0.6)
    axes.set(title="residual; lost frames black", ylabel=label)


def _uncertainty(axes: Axes, runs: list[OdometryRun]) -> None:
    """A standard deviation where all presets have a noise model, else the smallest eigenvalue."""
    curves = _values(runs, "largest_sigma_m", 1e3)
    limit = 1e3 * MAX_SIGMA_M
    label = "standard deviation [mm]"
    if all(np.isfinite(values).any() for values in curves):
        axes.set_yscale("log")
    else:
        curves = _values(runs, "smallest_eigenvalue")
        limit = MIN_EIGENVALUE
        label = "eigenvalue, share of the trace"
    title = "least certain direction"
    marked = None
    if len(runs) == 1:
        title += "; degenerate frames marked"
        marked = OdometryStatus.DEGENERATE
    _over_time(axes, runs, curves, marked, color=COLOURS[3], linewidth=0.8, alpha=0.5)
    axes.axhline(limit, color="grey", linestyle="--", linewidth=0.8)
    axes.set(title=title, xlabel="time [s]", ylabel=label)


def _values(runs: list[OdometryRun], name: str, factor: float = 1.0) -> list[np.ndarray]:
    """Attribute `name` of each run's results, (frames,) per run."""
    return [factor * np.array([getattr(f.result, name) for f in run.frames]) for run in runs]


def _over_time(
    axes: Axes,
    runs: list[OdometryRun],
    curves: list[np.ndarray],
    marked: OdometryStatus | None,
    **line: Any,
) -> None:
    """A curve per run, and a vertical line at each frame whose status is `marked`."""
    for i, (run, values) in enumerate(zip(runs, curves, strict=True)):
        stamps_s = [f.stamp_s for f in run.frames]
        axes.plot(stamps_s, values, color=COLOURS[i % len(COLOURS)], linewidth=1)
        for f in run.frames:
            if f.result.status is marked:
                axes.axvline(f.stamp_s, **line)


def _trajectories(axes: Axes, runs: list[OdometryRun]) -> None:
    """Trajectories along the two axes with the most motion, in the world of the ground truth or,
    without it, of the first camera.
    """
    truth = runs[0].truth
    try:
        estimates_m = [_in_world_of(truth, run) for run in runs]
    except InputError:
        truth = None
        estimates_m = [run.trajectory.positions_m for run in runs]
    x, y = sorted(np.argsort(np.ptp(np.concatenate(estimates_m), axis=0))[1:])
    if truth is not None:
        true_m = truth.positions_m
        axes.plot(true_m[:, x], true_m[:, y], color="grey", linewidth=1, label="truth")
    for i, (run, at_m) in enumerate(zip(runs, estimates_m, strict=True)):
        colour = COLOURS[i % len(COLOURS)]
        axes.plot(at_m[:, x], at_m[:, y], color=colour, linewidth=1.2, label=run.name)
    axes.set(
        title=", ".join(run.name for run in runs),
        xlabel=f"{'xyz'[x]} [m]",
        ylabel=f"{'xyz'[y]} [m]",
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="best", fontsize="small")


def _in_world_of(truth: Trajectory | None, run: OdometryRun) -> np.ndarray:
    """(n, 3): positions of a run, aligned with the ground truth, if any. Raises InputError where
    the alignment is undetermined.
    """
    if truth is None:
        return run.trajectory.positions_m
    return absolute_error(truth, run.trajectory).aligned.translation
