"""A figure of runs: trajectories with the ground truth, residuals, and uncertainty over time."""

from typing import Any

import numpy as np
from iclnuim.errors import InputError, WorkError
from iclnuim.evaluation.absolute_error import absolute_error
from iclnuim.report.charts import COLOURS
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .protocol import Status
from .run import Run
from .solver import MAX_SIGMA_M, MIN_EIGENVALUE

SIZE_INCHES = 12, 6


def figure(runs: list[Run]) -> Figure:
    """All runs in one figure.

    If there is only one, its lost frames are black and its degenerate ones are marked.
    """
    drawing = Figure(figsize=SIZE_INCHES, layout="constrained")
    _fill(drawing, runs)
    return drawing


def show(runs: list[Run]) -> None:
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


def _fill(drawing: Figure, runs: list[Run]) -> None:
    """Draw all panels. The residual of a single run has the unit of its method; those of several
    are divided by their medians.
    Uncertainty is a standard deviation where all presets have a noise model, else the smallest
    eigenvalue.
    """
    grid, single = drawing.add_gridspec(2, 2, width_ratios=(1, 1.2)), len(runs) == 1
    _trajectories(drawing.add_subplot(grid[:, 0]), runs)
    above, below = (drawing.add_subplot(grid[row, 1]) for row in range(2))
    residuals = _values(runs, "residual")
    if not single:
        has_values = [np.isfinite(values[1:]).any() for values in residuals]
        residuals = [
            v / (np.nanmedian(v[1:]) or 1.0) if k else v
            for v, k in zip(residuals, has_values, strict=True)
        ]
    _over_time(above, runs, residuals, Status.FAILED, color="black", linewidth=0.6)
    above.set(
        title="residual; lost frames black",
        ylabel="method's own unit" if single else "share of each median",
    )
    curves, limit, label = (
        _values(runs, "largest_sigma_m", 1e3),
        1e3 * MAX_SIGMA_M,
        "standard deviation [mm]",
    )
    if all(np.isfinite(values).any() for values in curves):
        below.set_yscale("log")
    else:
        curves, limit, label = (
            _values(runs, "smallest_eigenvalue"),
            MIN_EIGENVALUE,
            "eigenvalue, share of the trace",
        )
    _over_time(
        below,
        runs,
        curves,
        Status.DEGENERATE if single else None,
        color=COLOURS[3],
        linewidth=0.8,
        alpha=0.5,
    )
    below.axhline(limit, color="grey", linestyle="--", linewidth=0.8)
    title = "least certain direction" + ("; degenerate frames marked" if single else "")
    below.set(title=title, xlabel="time [s]", ylabel=label)


def _values(runs: list[Run], name: str, factor: float = 1.0) -> list[np.ndarray]:
    """Attribute `name` of each run's results, (frames,) per run."""
    return [factor * np.array([getattr(f.result, name) for f in run.frames]) for run in runs]


def _over_time(
    axes: Axes, runs: list[Run], curves: list[np.ndarray], marked: Status | None, **line: Any
) -> None:
    """A curve per run, and a vertical line at each frame whose status is `marked`."""
    for i, (run, values) in enumerate(zip(runs, curves, strict=True)):
        axes.plot(
            [f.stamp_s for f in run.frames], values, color=COLOURS[i % len(COLOURS)], linewidth=1
        )
        for f in run.frames:
            if f.result.status is marked:
                axes.axvline(f.stamp_s, **line)


def _trajectories(axes: Axes, runs: list[Run]) -> None:
    """Trajectories along the two axes with the most motion, in the world of the ground truth or,
    without it, of the first camera.
    """
    truth, estimates_m = runs[0].truth, []
    for run in runs:
        try:
            poses = (
                run.trajectory.T_world_camera
                if truth is None
                else absolute_error(truth, run.trajectory).aligned
            )
            estimates_m.append(poses.translation)
        except InputError:
            truth = None
            estimates_m = [r.trajectory.positions_m for r in runs]
            break
    x, y = sorted(np.argsort(np.ptp(np.concatenate(estimates_m), axis=0))[1:])
    if truth is not None:
        axes.plot(
            truth.positions_m[:, x],
            truth.positions_m[:, y],
            color="grey",
            linewidth=1,
            label="truth",
        )
    for i, (run, at_m) in enumerate(zip(runs, estimates_m, strict=True)):
        axes.plot(
            at_m[:, x], at_m[:, y], color=COLOURS[i % len(COLOURS)], linewidth=1.2, label=run.name
        )
    axes.set(
        title=", ".join(run.name for run in runs),
        xlabel=f"{'xyz'[x]} [m]",
        ylabel=f"{'xyz'[y]} [m]",
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="best", fontsize="small")
