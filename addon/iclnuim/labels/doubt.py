"""Label images that hardly fit: of other frames, with labels moved by one, or of another numbering
of classes.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from ..doubt.fit import is_explained
from ..doubt.frame_order import other_order
from ..errors import InputError
from .classes import BUILT_IN, ClassMap, class_map
from .frames import LabelFrame, indices_of_truth, read_ids
from .images import LabelImage, read_label_image
from .scores import VOID

#: Below this mean IoU labels are in doubt, or if images or frames are left over.
_DOUBTFUL_IOU = 0.7
#: About so many pixels a row are compared, of so many images.
_ACROSS = 160
_IMAGES = 8


def label_doubts(
    frames: Sequence[LabelFrame],
    images: Sequence[Path | None],
    every_image: Sequence[Path],
    listed: ClassMap,
    classes: ClassMap,
    mean_iou: float | None,
) -> tuple[str, ...]:
    """At most one sentence. images: of the frames; every_image: in the order of their numbers."""
    left_over = any(one is None for one in images) or len(every_image) != len(frames)
    if not left_over and (mean_iou is None or mean_iou >= _DOUBTFUL_IOU):
        return ()
    used = [k for k, image in enumerate(images) if image is not None]
    used = used[:: max(1, len(used) // _IMAGES)]
    some = [(frames[k], images[k]) for k in used]
    as_read = _differences(some, listed, classes)
    for words, table, step in _numberings(listed, classes):
        found = _differences(some, listed, table, step)
        if is_explained(as_read, found):
            return (
                f"{words} {1 - found.mean():.1%} of the labels of some images are right instead of "
                f"{1 - as_read.mean():.1%}",
            )
    return _of_other_frames(frames, images, every_image, listed, classes)


def _numberings(listed: ClassMap, classes: ClassMap) -> list[tuple[str, ClassMap, int]]:
    """Other numberings: in words, the table, and what is added to ids."""
    found = []
    for step, first in ((1, 0), (-1, 2)):
        words = f"labels may be numbered from {first}: moved by {step:+d},"
        found.append((words, classes, step))
    for name in BUILT_IN:
        if name != classes.name:
            table = class_map(name, listed)
            words = f"labels may be numbered as in {name}"
            found.append((f"{words}; with {{classes}} {name}", table, 0))
            found.append((f"{words}, from 0; moved by +1 and with {{classes}} {name}", table, 1))
    return found


def _moved(ids: np.ndarray, step: int) -> np.ndarray:
    return np.clip(ids.astype(np.int64) + step, 0, np.iinfo(np.uint16).max).astype(np.uint16)


def _differences(
    pairs: Sequence[tuple[LabelFrame, Path | None]],
    listed: ClassMap,
    table: ClassMap,
    step: int = 0,
) -> np.ndarray:
    """(n,) the share of the true labels of this table that is another one in each image; 1 where
    nothing can be compared.
    """
    of_truth = indices_of_truth(listed, table)
    shares = []
    for frame, image in pairs:
        true = of_truth[_thin(read_ids(frame.classes))]
        found = None if image is None else _labels(image, table, step)
        shares.append(_wrong(found, true))
    return np.array(shares)


def _wrong(found: np.ndarray | None, true: np.ndarray) -> float:
    """The share of known true labels (h, w) that is another one; 1 where none can be compared."""
    known = true > VOID
    if found is None or found.shape != true.shape or not known.any():
        return 1.0
    return float((found[known] != true[known]).mean())


def _labels(image: Path, table: ClassMap, step: int = 0) -> np.ndarray | None:
    read = read_label_image(image)
    if read.ids is not None:
        read = LabelImage(_moved(read.ids, step), read.colours)
    try:
        thin = replace(
            read,
            ids=None if read.ids is None else _thin(read.ids),
            colours=None if read.colours is None else _thin(read.colours),
        )
        return table.of_image(thin, image).values
    except InputError:
        return None


def _thin(image: np.ndarray) -> np.ndarray:
    step = max(1, image.shape[1] // _ACROSS)
    return image[::step, ::step]


def _of_other_frames(
    frames: Sequence[LabelFrame],
    images: Sequence[Path | None],
    every_image: Sequence[Path],
    listed: ClassMap,
    classes: ClassMap,
) -> tuple[str, ...]:
    of_truth = indices_of_truth(listed, classes)

    @cache
    def true(row: int) -> np.ndarray:
        return of_truth[_thin(read_ids(frames[row].classes))]

    @cache
    def labels(place: int) -> np.ndarray | None:
        return _labels(every_image[place], classes)

    def error(place: int, row: int) -> float:
        return _wrong(labels(place), true(row))

    rows = {image: row for row, image in enumerate(images) if image is not None}
    order = other_order(error, [rows.get(image) for image in every_image], len(frames))
    if order is None:
        return ()
    return (
        f"label images seem to be of other frames, renumbered or shifted: with {order.words}, "
        f"{1 - order.found:.1%} of their labels are right instead of {1 - order.given:.1%}",
    )
