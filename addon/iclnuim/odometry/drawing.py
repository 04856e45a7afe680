"""A run as a picture: the path beside the truth, the residual, and how sure the odometer was."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..errors import InputError, WorkError
from ..evaluation.absolute_error import absolute_error
from ..report.charts import COLOURS
from .minimise import Limits
from .report import Run
from .system import DEGENERATE

SIZE_INCHES = 12, 6


def figure(run: Run) -> Figure:
    drawing = Figure(figsize=SIZE_INCHES, layout="constrained")
    FigureCanvasAgg(drawing)
    _fill(drawing, run)
    return drawing


def show(run: Run) -> None:
    """A window; returns when it is closed. WorkError where there is no display."""
    from matplotlib import pyplot

    try:
        drawing = pyplot.figure(figsize=SIZE_INCHES, layout="constrained")
        display = pyplot.get_backend().lower() != "agg"
    except Exception as error:  # each toolkit has its own
        raise WorkError(f"no window can be opened ({error}); try: --plot FILE") from None
    if not display:
        raise WorkError("no display for a window; try: --plot FILE")
    _fill(drawing, run)
    pyplot.show()


def _fill(drawing: Figure, run: Run) -> None:
    grid = drawing.add_gridspec(2, 2, width_ratios=(1, 1.2))
    _path(drawing.add_subplot(grid[:, 0]), run)
    _residual(drawing.add_subplot(grid[0, 1]), run)
    _certainty(drawing.add_subplot(grid[1, 1]), run)


def _path(axes: Axes, run: Run) -> None:
    """In the world of the truth where there is one, else the first camera's; along the two axes of most motion."""
    estimate_m, truth_m = run.trajectory.positions_m, None
    try:
        if run.truth is not None:
            estimate_m = absolute_error(run.truth, run.trajectory).aligned.translation
            truth_m = run.truth.positions_m
    except InputError:
        pass
    x, y = sorted(np.argsort(np.ptp(estimate_m, axis=0))[1:])
    if truth_m is not None:
        axes.plot(truth_m[:, x], truth_m[:, y], color="grey", linewidth=1, label="truth")
    axes.plot(estimate_m[:, x], estimate_m[:, y], color=COLOURS[0], linewidth=1.2, label=run.name)
    axes.set(title=run.name, xlabel=f"{'xyz'[x]} [m]", ylabel=f"{'xyz'[y]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="best", fontsize="small")


def _residual(axes: Axes, run: Run) -> None:
    stamps_s = _stamps_s(run)
    axes.plot(stamps_s, [f.result.residual for f in run.frames], color=COLOURS[1], linewidth=1)
    for stamp_s in stamps_s[[f.lost for f in run.frames]]:
        axes.axvline(stamp_s, color="black", linewidth=0.6)
    axes.set(title="residual; lost frames black", ylabel="method's own unit")


def _certainty(axes: Axes, run: Run) -> None:
    """In metres where the preset has a noise model, else as the share that smallest_eigenvalue is."""
    stamps_s = _stamps_s(run)
    values = 1e3 * np.array([f.result.weakest_sigma_m for f in run.frames])
    limit, label = 1e3 * Limits().most_sigma_m, "standard deviation [mm]"
    if np.isfinite(values).any():
        axes.set_yscale("log")
    else:
        values = np.array([f.result.smallest_eigenvalue for f in run.frames])
        limit, label = DEGENERATE, "eigenvalue, share of the trace"
    axes.plot(stamps_s, values, color=COLOURS[2], linewidth=1)
    axes.axhline(limit, color="grey", linestyle="--", linewidth=0.8)
    for stamp_s in stamps_s[[f.result.degenerate for f in run.frames]]:
        axes.axvline(stamp_s, color=COLOURS[3], linewidth=0.8, alpha=0.5)
    axes.set(title="least known direction; flagged frames marked", xlabel="time [s]", ylabel=label)


def _stamps_s(run: Run) -> np.ndarray:
    return np.array([f.stamp_s for f in run.frames])
