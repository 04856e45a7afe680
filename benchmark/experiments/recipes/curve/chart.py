"""Chart of `iclnuim bench curve`: error over cost, with a line for each method through its steps
and the Pareto front of all.

The cost is the time per frame. Two settings do not change it, so the error is drawn over the
setting itself; the frame rate changes the time per second.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

from iclnuim.report.charts import COLOURS
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .curves import CURVES, Point
from .error_chart import TICKS_MS, ErrorChart, look
from .fusion_curve import FusedPoint

#: Curves whose steps take the same time: the error is drawn over the setting.
_OVER_SETTING = ("keyframe", "realtime")


def figure(curve: str, results: Mapping[str, Sequence[Point]]) -> Figure:
    """Ours are lines with dots; third-party ones are dotted lines with squares. The first and last
    step of a method have their values beside them. A cross is a step that lost more than half of
    the frames it processed; it is not part of the front.
    """
    label, cost = _axis(curve)
    chart = ErrorChart(list(results), 2, 4.4)
    methods = list(dict.fromkeys(p.method for p in chain.from_iterable(results.values())))
    for name, points in results.items():
        for method in methods:
            own = [p for p in points if p.method == method and p.ate_m is not None]
            if own:
                style = look(method, methods)
                chart.shown[method] = _line(chart.panels[name], own, cost, style)
        if curve not in _OVER_SETTING:
            good = [p for p in points if not p.failed and p.ate_m is not None]
            chart.front(name, [(cost(p), 1e3 * (p.ate_m or 0.0)) for p in good])
    if curve in _OVER_SETTING:
        chart.ticks(_values(results))
    elif curve == "rate":
        chart.ticks(100.0 * ms for ms in TICKS_MS)
    return chart.close(label, f"{curve}: {CURVES[curve].unit}")


def _values(results: Mapping[str, Sequence[Point]]) -> list[float]:
    """The steps of all methods."""
    points = chain.from_iterable(results.values())
    return sorted({p.value for p in points if p.value is not None})


def _axis(curve: str) -> tuple[str, Callable[[Point], float]]:
    """Label of the horizontal axis, and its value for a step."""
    if curve in _OVER_SETTING:
        return CURVES[curve].unit, lambda p: p.value or 0.0
    if curve == "rate":
        return "processing time in ms per second of the sequence", lambda p: p.ms * (p.value or 1.0)
    return "median ms per frame", lambda p: p.ms


def _line(
    axes: Axes, points: Sequence[Point], cost: Callable[[Point], float], style: dict[str, Any]
) -> Line2D:
    """The line of a method through its steps; returns its handle for the legend."""
    x = [cost(p) for p in points]
    y = [1e3 * (p.ate_m or 0.0) for p in points]
    (handle,) = axes.plot(x, y, **style)
    for p, px, py in zip(points, x, y, strict=True):
        if p.failed:
            axes.plot(px, py, "x", color="black", markersize=7)
    for k in {0, len(points) - 1}:
        value = points[k].value
        if value is not None and x[k] != value:
            _annotate(axes, (x[k], y[k]), f"{value:g}", style["color"])
    return handle


def _annotate(axes: Axes, xy: tuple[float, float], text: str, colour: str) -> None:
    offset = "offset points"
    axes.annotate(text, xy, xytext=(3, 3), textcoords=offset, fontsize=7, color=colour)


def fusion_figure(results: Mapping[str, Sequence[FusedPoint]]) -> Figure:
    """Mean distance to the true surface over time per frame and over memory, with a line for each
    sequence.
    """
    drawing = Figure(figsize=(9, 4.2), layout="constrained")
    panels = drawing.subplots(1, 2, sharey=True)
    for axes, name, label in zip(panels, ("ms", "memory_mb"), ("ms per frame", "MB"), strict=True):
        for k, (sequence, points) in enumerate(results.items()):
            colour = COLOURS[k % len(COLOURS)]
            x = [getattr(p, name) for p in points]
            y = [1e3 * p.mean_m for p in points]
            axes.plot(x, y, "o-", color=colour, linewidth=1, label=sequence)
            for p, *xy in zip(points, x, y, strict=True):
                _annotate(axes, (xy[0], xy[1]), f"{1e3 * p.voxel_m:.3g} mm", colour)
        axes.set(xscale="log", yscale="log", xlabel=label)
        axes.margins(0.12)
        axes.grid(alpha=0.3, which="both")
    panels[0].set_ylabel("mean distance to the true surface [mm]")
    panels[0].legend(fontsize=8)
    return drawing
