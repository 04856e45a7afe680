"""Runs as a picture: trajectories beside the truth, residuals, and how certain the odometers were."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..errors import InputError, WorkError
from ..evaluation.absolute_error import absolute_error
from ..report.charts import COLOURS
from .protocol import Status
from .run import Run
from .solver import MIN_EIGENVALUE, Limits

SIZE_INCHES = 12, 6


def figure(runs: list[Run]) -> Figure:
    """All runs in one figure; with one, its lost frames are black and its degenerate ones marked."""
    drawing = Figure(figsize=SIZE_INCHES, layout="constrained")
    FigureCanvasAgg(drawing)
    _fill(drawing, runs)
    return drawing


def show(runs: list[Run]) -> None:
    """A window; returns when it is closed. WorkError where there is no display."""
    from matplotlib import pyplot

    try:
        drawing = pyplot.figure(figsize=SIZE_INCHES, layout="constrained")
        display = pyplot.get_backend().lower() != "agg"
    except Exception as error:  # each toolkit has its own
        raise WorkError(f"no window can be opened ({error}); try a picture in a file instead") from None
    if not display:
        raise WorkError("no display for a window; try a picture in a file instead")
    _fill(drawing, runs)
    pyplot.show()


def _fill(drawing: Figure, runs: list[Run]) -> None:
    grid = drawing.add_gridspec(2, 2, width_ratios=(1, 1.2))
    _trajectories(drawing.add_subplot(grid[:, 0]), runs)
    _residuals(drawing.add_subplot(grid[0, 1]), runs)
    _certainty(drawing.add_subplot(grid[1, 1]), runs)


def _trajectories(axes: Axes, runs: list[Run]) -> None:
    """In the world of the truth where there is one, else the first camera's; along the two axes of most motion."""
    truth, estimates_m = runs[0].truth, []
    for run in runs:
        try:
            poses = run.trajectory.T_world_camera if truth is None else absolute_error(truth, run.trajectory).aligned
            estimates_m.append(poses.translation)
        except InputError:
            truth = None
            estimates_m = [r.trajectory.positions_m for r in runs]
            break
    x, y = sorted(np.argsort(np.ptp(np.concatenate(estimates_m), axis=0))[1:])
    if truth is not None:
        axes.plot(truth.positions_m[:, x], truth.positions_m[:, y], color="grey", linewidth=1, label="truth")
    for i, (run, at_m) in enumerate(zip(runs, estimates_m, strict=True)):
        axes.plot(at_m[:, x], at_m[:, y], color=COLOURS[i % len(COLOURS)], linewidth=1.2, label=run.name)
    axes.set(title=", ".join(run.name for run in runs), xlabel=f"{'xyz'[x]} [m]", ylabel=f"{'xyz'[y]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="best", fontsize="small")


def _residuals(axes: Axes, runs: list[Run]) -> None:
    """Of one run in the method's own unit, of several as shares of their median."""
    for i, run in enumerate(runs):
        stamps_s, values = _stamps_s(run), np.array([f.result.residual for f in run.frames])
        scale = np.nanmedian(values[1:]) if len(runs) > 1 and np.isfinite(values[1:]).any() else 1.0
        axes.plot(stamps_s, values / (scale or 1.0), color=COLOURS[i % len(COLOURS)], linewidth=1)
        for stamp_s in stamps_s[[f.lost for f in run.frames]]:
            axes.axvline(stamp_s, color="black", linewidth=0.6)
    unit = "method's own unit" if len(runs) == 1 else "share of each median"
    axes.set(title="residual; lost frames black", ylabel=unit)


def _certainty(axes: Axes, runs: list[Run]) -> None:
    """In metres where all presets have a noise model, else as the share that smallest_eigenvalue is."""
    sigmas_mm = [1e3 * np.array([f.result.largest_sigma_m for f in run.frames]) for run in runs]
    if all(np.isfinite(values).any() for values in sigmas_mm):
        axes.set_yscale("log")
        curves, limit, label = sigmas_mm, 1e3 * Limits().max_sigma_m, "standard deviation [mm]"
    else:
        curves = [np.array([f.result.smallest_eigenvalue for f in run.frames]) for run in runs]
        limit, label = MIN_EIGENVALUE, "eigenvalue, share of the trace"
    for i, (run, values) in enumerate(zip(runs, curves, strict=True)):
        stamps_s = _stamps_s(run)
        axes.plot(stamps_s, values, color=COLOURS[i % len(COLOURS)], linewidth=1)
        if len(runs) == 1:
            for stamp_s in stamps_s[[f.result.status is Status.DEGENERATE for f in run.frames]]:
                axes.axvline(stamp_s, color=COLOURS[3], linewidth=0.8, alpha=0.5)
    axes.axhline(limit, color="grey", linestyle="--", linewidth=0.8)
    title = "least certain direction" + ("; degenerate frames marked" if len(runs) == 1 else "")
    axes.set(title=title, xlabel="time [s]", ylabel=label)


def _stamps_s(run: Run) -> np.ndarray:
    return np.array([f.stamp_s for f in run.frames])
