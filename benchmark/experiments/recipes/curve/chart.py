"""Charts of error over time: of `iclnuim bench curve`, with a line for each method through its
steps, and of `iclnuim bench odometry`, with a dot for each method; both with the Pareto front.
"""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from iclnuim.benchmark.odometry.registry import BASELINES
from iclnuim.report.charts import COLOURS, pareto_front, spread_labels
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .curves import CURVES, FusedPoint, Point

#: Ticks of the time per frame in ms.
_TICKS_MS = (2, 5, 10, 20, 50, 100, 200)


class ErrorChart:
    """A figure with a panel for each title; `close` adds the legend and the labels."""

    def __init__(self, titles: Sequence[str], columns: int, side: float) -> None:
        columns = min(len(titles), columns)
        rows = -(-len(titles) // columns)
        size = ((side + 0.2) * columns + 1.7, side * rows + 0.4)
        self.drawing = Figure(figsize=size, layout="constrained")
        panels = self.drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        self.panels: dict[str, Axes] = dict(zip(titles, panels.flat, strict=False))
        self.shown: dict[str, Line2D] = {}
        for axes in panels.flat[len(titles) :]:
            axes.set_visible(False)
        for title, axes in self.panels.items():
            axes.set(xscale="log", yscale="log", title=title)
            axes.xaxis.set_minor_formatter("")
            axes.grid(alpha=0.3)
            axes.set_xticks(_TICKS_MS, labels=[f"{x:g}" for x in _TICKS_MS])

    def front(self, title: str, points: Sequence[tuple[float, float]]) -> None:
        """Draw the Pareto front of points (cost, ATE in mm) as a dashed line."""
        best = [points[k] for k in pareto_front(points)]
        x = [point[0] for point in best]
        y = [point[1] for point in best]
        self.panels[title].plot(x, y, "--", color="grey", linewidth=0.8, zorder=0)

    def close(self, cost: str, title: str = "") -> Figure:
        """The figure, with the name of the cost."""
        self.drawing.suptitle(title)
        self.drawing.supxlabel(cost, fontsize="medium")
        self.drawing.supylabel("ATE RMSE [mm], \u2193 is better", fontsize="medium")
        self.drawing.legend(
            self.shown.values(), self.shown.keys(), loc="outside right upper", fontsize=8
        )
        spread_labels(self.drawing)
        return self.drawing


def look(method: str, methods: Sequence[str]) -> dict[str, Any]:
    """Line and marker of one of `methods`: colours in their order, hollow markers once these are
    used up; dotted lines with squares for third-party ones.
    """
    k = methods.index(method)
    colour = COLOURS[k % len(COLOURS)]
    inside = "white" if k >= len(COLOURS) else colour
    style = {"color": colour, "markerfacecolor": inside, "linewidth": 1, "markersize": 4}
    if method in BASELINES:
        return {**style, "linestyle": ":", "marker": "s"}
    return {**style, "linestyle": "-", "marker": "o"}


# -- curves


def curve_figure(curve: str, results: Mapping[str, Sequence[Point]]) -> Figure:
    """Ours are lines with dots; third-party ones are dotted lines with squares. The first and last
    step of a method have their values beside them. A cross is a step that lost more than half of
    the frames it processed; it is not part of the front.
    """
    chart = ErrorChart(list(results), 2, 4.4)
    methods = list(dict.fromkeys(p.method for p in chain.from_iterable(results.values())))
    for name, points in results.items():
        for method in methods:
            own = [p for p in points if p.method == method and p.ate_m is not None]
            if own:
                style = look(method, methods)
                chart.shown[method] = _line(chart.panels[name], own, style)
        good = [p for p in points if not p.failed and p.ate_m is not None]
        chart.front(name, [(p.ms, 1e3 * (p.ate_m or 0.0)) for p in good])
    return chart.close("median ms per frame, \u2190 is better", f"{curve}: {CURVES[curve].unit}")


def _line(axes: Axes, points: Sequence[Point], style: dict[str, Any]) -> Line2D:
    """The line of a method through its steps; returns its handle for the legend."""
    x = [p.ms for p in points]
    y = [1e3 * (p.ate_m or 0.0) for p in points]
    (handle,) = axes.plot(x, y, **style)
    for p, px, py in zip(points, x, y, strict=True):
        if p.failed:
            axes.plot(px, py, "x", color="black", markersize=7)
    for k in {0, len(points) - 1}:
        value = points[k].value
        if value is not None:
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
    spread_labels(drawing)
    return drawing


# -- odometers

#: A sequence with its runs, as in the output of --json.
Comparison = Mapping[str, Any]


def front(runs: Sequence[Mapping[str, Any]]) -> list[str]:
    """The Pareto front: names of the runs that no other run beats in both median time and error."""
    known = [run for run in runs if _has_point(run)]
    best = pareto_front([(run["ms_median"], run["ate_rmse_m"]) for run in known])
    return [known[k]["odometer"] for k in best]


def _has_point(run: Mapping[str, Any]) -> bool:
    return run["ate_rmse_m"] is not None and run["ms_median"] is not None


def odometry_figure(results: Sequence[Comparison]) -> Figure:
    """A dot at the median and a line to the 95th percentile; for several runs of a system, whose
    times are those of the whole process, a triangle and the quartiles of the ATE.
    """
    chart = ErrorChart([result["sequence"] for result in results], 4, 3.4)
    runs = chain.from_iterable(result["runs"] for result in results)
    methods = list(dict.fromkeys(run["odometer"] for run in runs))
    for result in results:
        axes = chart.panels[result["sequence"]]
        points = []
        for run in filter(_has_point, result["runs"]):
            style = {**look(run["odometer"], methods), "linestyle": ""}
            ms = run["ms_median"]
            ate_mm = 1e3 * run["ate_rmse_m"]
            if "runs" in run:
                style["marker"] = "^"
                ends = [[ms, ms], [1e3 * ate_m for ate_m in run["ate_quartiles_m"]]]
            else:
                ends = [[ms, run["ms_95"]], [ate_mm, ate_mm]]
            axes.plot(*ends, color=style["color"], linewidth=1)
            (chart.shown[run["odometer"]],) = axes.plot(ms, ate_mm, **style)
            points.append((ms, ate_mm))
        chart.front(result["sequence"], points)
    return chart.close(
        "ms per frame: median, line to 95 % (triangles: whole process), \u2190 is better"
    )
