"""Chart of `iclnuim bench curve`: error over cost, with a line for each method through its steps
and the Pareto front of all.

The cost is the time per frame. Two settings do not change it, so the error is drawn over the
setting itself; the frame rate changes the time per second.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from iclnuim.report import pareto
from iclnuim.report.charts import COLOURS
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .curves import CURVES, Point
from .fusion_curve import FusedPoint

_COLUMNS = 2
_TICKS_MS = (2, 5, 10, 20, 50, 100, 200)
#: Curves whose steps take the same time: the error is drawn over the setting.
_OVER_SETTING = ("keyframe", "realtime")


def figure(curve: str, results: Mapping[str, Sequence[Point]]) -> Figure:
    """A panel for each sequence, with common axes. Ours are lines with dots; third-party ones are
    dotted lines with squares.

    The first and last step of a method have their values beside them. A cross is a step that lost
    more than half of the frames it processed; it is not part of the front.
    """
    label, cost = _axis(curve)
    columns = min(len(results), _COLUMNS)
    rows = -(-len(results) // columns)
    drawing = Figure(figsize=(4.6 * columns + 1.9, 3.5 * rows + 0.4), layout="constrained")
    panels = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    methods: dict[str, None] = {}
    for points in results.values():
        methods |= dict.fromkeys(p.method for p in points)
    shown = {}
    for axes, (name, points) in zip(panels.flat, results.items(), strict=False):
        for method in methods:
            own = [p for p in points if p.method == method and p.ate_m is not None]
            if own:
                shown[method] = _line(axes, own, cost, look(method, list(methods)))
        if curve not in _OVER_SETTING:
            _front(axes, points, cost)
        axes.set(xscale="log", yscale="log", title=name)
        ticks = _ticks(curve, points)
        axes.set_xticks(ticks, labels=[f"{x:g}" for x in ticks])
        axes.xaxis.set_minor_formatter("")
        axes.grid(alpha=0.3)
    for axes in panels.flat[len(results) :]:
        axes.set_visible(False)
    drawing.suptitle(f"{curve}: {CURVES[curve].unit}")
    drawing.supxlabel(label, fontsize="medium")
    drawing.supylabel("ATE RMSE [mm]", fontsize="medium")
    drawing.legend(shown.values(), shown.keys(), loc="outside right upper", fontsize=8)
    return drawing


def _front(axes: Axes, points: Sequence[Point], cost: Callable[[Point], float]) -> None:
    """Draw the Pareto front of the steps that did not fail."""
    good = [p for p in points if not p.failed]
    found = [(cost(p), 1e3 * p.ate_m) for p in good if p.ate_m is not None]
    best = [found[k] for k in pareto.front(found)]
    x = [one[0] for one in best]
    y = [one[1] for one in best]
    axes.plot(x, y, "--", color="grey", linewidth=0.8, zorder=0)


def look(method: str, methods: Sequence[str]) -> dict[str, Any]:
    """Line and marker of one of `methods`: colours in their order, hollow markers once these are
    used up; dotted lines for third-party ones.
    """
    k = methods.index(method)
    colour = COLOURS[k % len(COLOURS)]
    inside = "white" if k >= len(COLOURS) else colour
    style = {"color": colour, "markerfacecolor": inside, "linewidth": 1, "markersize": 4}
    if method.startswith("baseline:"):
        return {**style, "linestyle": ":", "marker": "s"}
    return {**style, "linestyle": "-", "marker": "o"}


def _axis(curve: str) -> tuple[str, Callable[[Point], float]]:
    """Label of the horizontal axis, and its value for a step."""
    if curve in _OVER_SETTING:
        return CURVES[curve].unit, lambda p: p.value or 0.0
    if curve == "rate":
        return "processing time in ms per second of the sequence", lambda p: p.ms * (p.value or 1.0)
    return "median ms per frame", lambda p: p.ms


def _ticks(curve: str, points: Sequence[Point]) -> list[float]:
    """Ticks of the horizontal axis: the steps, if it shows the setting."""
    if curve in _OVER_SETTING:
        return sorted({p.value for p in points if p.value is not None})
    return [100.0 * ms for ms in _TICKS_MS] if curve == "rate" else list(_TICKS_MS)


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
