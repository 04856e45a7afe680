"""Heat maps of `iclnuim stress`: a panel for each method, with a row per perturbation and a column
per severity.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ....perturbations.plan import SEVERITIES
from .tables import HIGH_MM, LOW_MM, Summary, colour_map, ink, method_name, shown_mm

_COLUMNS = 5


def figure(summary: Summary) -> Figure:
    """Fields show the ATE as colour and number, or a cross for a failure."""
    methods = summary.methods
    names = [name.replace("_", " ") for name in summary.perturbations]
    columns = min(_COLUMNS, len(methods))
    rows = -(-len(methods) // columns)
    size = (2.6 * columns + 2.2, (0.26 * len(names) + 0.8) * rows + 0.5)
    drawing = Figure(figsize=size, layout="constrained")
    panels = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, method in zip(panels.flat, methods, strict=False):
        _panel(axes, summary, method)
        axes.set_yticks(range(len(names)), labels=names, fontsize=8)
    for axes in panels.flat[len(methods) :]:
        axes.set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("severity")
    label = "ATE [mm]; \u00d7: failure, !: failure not noticed"
    scale = ScalarMappable(LogNorm(LOW_MM, HIGH_MM), colour_map())
    drawing.colorbar(scale, ax=panels, label=label, shrink=0.6, extend="both")
    return drawing


def _panel(axes: Axes, summary: Summary, method: str) -> None:
    groups = [summary.row(method, name) for name in summary.perturbations]
    values = np.full((len(groups), SEVERITIES + 1), math.nan)
    for y, row in enumerate(groups):
        for x, group in enumerate(row):
            if group is None:
                continue
            values[y, x] = shown_mm(group.ate_m, group.failed)
            text = axes.text(x, y, group.mark, ha="center", va="center", fontsize=6.5)
            text.set_color(ink(values[y, x]))
    axes.set_title(method_name(method), fontsize=9)
    axes.set_xticks(range(SEVERITIES + 1))
    axes.tick_params(labelbottom=True)
    norm = LogNorm(LOW_MM, HIGH_MM)
    axes.imshow(values, cmap=colour_map(), norm=norm, aspect="auto")
