"""Ours and the peers' odometers on the same frames in one run: time and error, ratios, Pareto front."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from iclnuim.errors import InputError

from ..odometry.peers import NAMES
from ..odometry.registry import OURS, odometer
from ..odometry.report import Run, run_sequence
from ..plots import COLOURS

#: Frames through each odometer beforehand, so that compiling and loading are not timed.
WARM_UP = 3


def names(peers: bool = True) -> list[str]:
    return [*OURS, *(NAMES if peers else ())]


def race(
    folder: Path,
    which: Iterable[str],
    preset: str = "best",
    frames: int | None = None,
    progress: Callable | None = None,
) -> list[Run]:
    """One Run an odometer, one after the other. Raises InputError without ground truth."""
    runs = []
    for name in which:
        run_sequence(odometer(name, preset), folder, frames=WARM_UP)
        runs.append(run_sequence(odometer(name, preset), folder, progress=progress, frames=frames))
        if runs[-1].truth is None:
            raise InputError("a ground truth in the folder", path=folder)
    return runs


def front(runs: list[Run]) -> list[str]:
    """Names of those that no other beats in both median time and error."""
    points = [(d["odometer"], d["ms_median"], d["ate_rmse_m"]) for d in (r.to_dict() for r in runs)]
    points = [p for p in points if p[2] is not None]
    return [n for n, ms, ate in points if not any(m <= ms and a <= ate and (m, a) != (ms, ate) for _, m, a in points)]


def figure(runs: list[Run]):
    """ATE over time a frame: a dot at the median, a line to the 95th percentile, the front dashed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(9, 5.5), layout="constrained")
    FigureCanvasAgg(drawing)
    axes, best = drawing.subplots(), []
    for d in (r.to_dict() for r in runs):
        if d["ate_rmse_m"] is None:
            continue
        ate_mm, peer = d["ate_rmse_m"] * 1e3, d["odometer"].startswith("peer:")
        colour = COLOURS[1 if peer else 0]
        axes.plot([d["ms_median"], d["ms_95"]], [ate_mm, ate_mm], color=colour, linewidth=1)
        axes.plot(d["ms_median"], ate_mm, "s" if peer else "o", color=colour)
        axes.annotate(d["odometer"], (d["ms_median"], ate_mm), (5, 5), textcoords="offset points", fontsize=8)
        if d["odometer"] in front(runs):
            best.append((d["ms_median"], ate_mm))
    axes.plot(*np.array(sorted(best)).T, "--", color="grey", linewidth=0.8)
    axes.set(
        xscale="log", yscale="log", xlabel="ms a frame: median, line to the 95th percentile", ylabel="ATE RMSE [mm]"
    )
    axes.set_title("ours: dots; peers: squares; dashed: Pareto front")
    axes.grid(alpha=0.3, which="both")
    return drawing
