"""Charts of error over cost: a panel for each sequence with common axes, a colour for each method,
and the Pareto front.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from iclnuim.report.charts import COLOURS, pareto_front
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

#: Ticks of the time per frame in ms.
TICKS_MS = (2, 5, 10, 20, 50, 100, 200)


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
        self.ticks(TICKS_MS)

    def ticks(self, values: Iterable[float]) -> None:
        """Set the ticks of the common horizontal axis."""
        found = list(values)
        for axes in self.panels.values():
            axes.set_xticks(found, labels=[f"{x:g}" for x in found])

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
        self.drawing.supylabel("ATE RMSE [mm]", fontsize="medium")
        self.drawing.legend(
            self.shown.values(), self.shown.keys(), loc="outside right upper", fontsize=8
        )
        return self.drawing


def look(method: str, methods: Sequence[str]) -> dict[str, Any]:
    """Line and marker of one of `methods`: colours in their order, hollow markers once these are
    used up; dotted lines with squares for third-party ones.
    """
    k = methods.index(method)
    colour = COLOURS[k % len(COLOURS)]
    inside = "white" if k >= len(COLOURS) else colour
    style = {"color": colour, "markerfacecolor": inside, "linewidth": 1, "markersize": 4}
    if method.startswith("baseline:"):
        return {**style, "linestyle": ":", "marker": "s"}
    return {**style, "linestyle": "-", "marker": "o"}
