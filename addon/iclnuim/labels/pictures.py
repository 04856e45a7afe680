"""Pictures of labels: the confusion matrix of an evaluation, and the classes of a sequence with
their names.
"""

from colorsys import hsv_to_rgb
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..formats.files import make_folder
from ..formats.images import read_colour8
from ..report.charts import save
from .classes import LARGEST_ID
from .errors import LabelErrors
from .frames import label_frames, read_ids, true_classes

_INCH_A_CLASS = 0.32
#: A cell with a larger share is dark, and has white text.
_DARK = 0.6
#: Smaller shares are drawn without text.
_SMALLEST = 0.005
_ROWS = 4
#: Hues of consecutive classes are this part of the circle apart, the golden section. Similar hues
#: have another saturation and value.
_HUE_STEP = 0.618034
_LEVELS = ((0.75, 0.95), (0.75, 0.6), (0.4, 0.95), (0.9, 0.4))


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


def draw_classes(folder: Path, out: Path) -> Path:
    """Write classes.png to `out`: colour and classes of some frames of a sequence, and the name of
    each class that they show; returns its path. Raises InputError without class images.
    """
    frames = label_frames(folder)
    spread = sorted({int(i) for i in np.linspace(0, len(frames) - 1, _ROWS)})
    colours = class_colours()
    figure = Figure(figsize=(11, 2.9 * len(spread)), layout="constrained")
    seen: set[int] = set()
    for row, axes in zip(spread, figure.subplots(len(spread), 2, squeeze=False), strict=True):
        ids = read_ids(frames[row].classes)
        seen.update(np.unique(ids).tolist())
        for place, image in zip(
            axes, (read_colour8(frames[row].pair.rgb), colours[ids]), strict=True
        ):
            place.imshow(image)
            place.set_axis_off()
        axes[0].set_title(f"frame {frames[row].pair.number}", size=9)
    patches = []
    if 0 in seen:
        patches.append(Patch(color=colours[0] / 255, label="0 unlabelled: no class_name"))
    for kind in true_classes(folder).classes:
        if kind.id in seen:
            label = f"{kind.id} {kind.name}"
            patches.append(Patch(color=colours[kind.id] / 255, label=label))
    figure.legend(handles=patches, loc="outside right upper", fontsize=9, frameon=False)
    make_folder(out)
    save(figure, out / "classes.png")
    return out / "classes.png"


def class_colours() -> np.ndarray:
    """(65536, 3) uint8: distinct colours of classes, black for none."""
    found = np.zeros((LARGEST_ID + 1, 3), np.uint8)
    for number in range(1, len(found)):
        level = _LEVELS[number % len(_LEVELS)]
        found[number] = np.rint(255 * np.array(hsv_to_rgb(_HUE_STEP * number % 1, *level)))
    return found
