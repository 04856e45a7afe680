"""Pictures of labels: the confusion matrix of an evaluation."""

import numpy as np
from matplotlib.figure import Figure

from ..dataset.label_errors import LabelErrors

_INCH_A_CLASS = 0.32
#: A cell with a larger share is dark, and has white text.
_DARK = 0.6
#: Smaller shares are drawn without text.
_SMALLEST = 0.005


def confusion_figure(errors: LabelErrors) -> Figure:
    """The confusion matrix: each row, a class of the truth, as shares of its pixels in percent."""
    rows, columns, counts = errors.shown()
    shares = counts / counts.sum(axis=1, keepdims=True)
    size = (4 + _INCH_A_CLASS * len(columns), 3 + _INCH_A_CLASS * len(rows))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    names = errors.classes.names
    axes.set_xticks(range(len(columns)), [names[k] for k in columns], rotation=90)
    ious = errors.figures.iou
    axes.set_yticks(range(len(rows)), [f"{names[k]} (IoU {100 * ious[k]:.1f})" for k in rows])
    axes.set_xlabel("predicted")
    axes.set_ylabel("truth")
    for (i, j), share in np.ndenumerate(shares):
        if share >= _SMALLEST:
            colour = "white" if share > _DARK else "black"
            axes.text(j, i, f"{100 * share:.0f}", ha="center", va="center", color=colour, size=7)
    axes.set_title(
        f"mean IoU {100 * errors.figures.mean_iou:.2f} % over {len(rows)} classes "
        f"({errors.classes.name}); cells: percent of the true class"
    )
    return figure
