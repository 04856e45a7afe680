"""A chart of the trajectory error of every method, by condition: a dot for each sequence and a line
at the geometric mean.
"""

from collections.abc import Sequence

from iclnuim.report.charts import COLOURS
from matplotlib.figure import Figure

from ...cell import Measured
from .best_methods import errors_by_condition, means

_COLUMNS = 2


def figure(results: Sequence[Measured]) -> Figure:
    """A panel for each condition, with the most accurate method on top. Needs at least one cell
    with an ATE.
    """
    conditions = errors_by_condition(results)
    columns = min(_COLUMNS, len(conditions))
    rows = -(-len(conditions) // columns)
    most = max(map(len, conditions.values()))
    size = (5.0 * columns, (0.24 * most + 0.9) * rows)
    drawing = Figure(figsize=size, layout="constrained")
    panels = drawing.subplots(rows, columns, sharex=True, squeeze=False).flat
    for axes in panels[len(conditions) :]:
        axes.set_visible(False)
    for axes in panels[len(conditions) - columns : len(conditions)]:
        axes.tick_params(labelbottom=True)
    for axes, (condition, errors) in zip(panels, conditions.items(), strict=False):
        ranked = means(errors)
        for y, (mean_m, name) in enumerate(ranked):
            errors_mm = [1e3 * ate_m for ate_m in errors[name].values()]
            axes.plot(errors_mm, [y] * len(errors_mm), "o", color=COLOURS[0], markersize=4)
            axes.plot(1e3 * mean_m, y, "|", color=COLOURS[1], markersize=13, markeredgewidth=2)
        axes.set_yticks(range(len(ranked)), labels=[name for _, name in ranked], fontsize=8)
        axes.set(title=", ".join(condition).replace("_", " "), xscale="log")
        axes.set_ylim(len(ranked) - 0.5, -0.5)
        axes.grid(alpha=0.3, axis="x")
    drawing.supxlabel("ATE RMSE [mm]: a dot for each sequence, a line at the mean", fontsize=9)
    return drawing
