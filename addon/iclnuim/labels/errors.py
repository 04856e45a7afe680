"""Evaluation of label images against the class and instance images of a sequence: one confusion
matrix over all frames, and panoptic quality.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..channels import INSTANCE
from ..console import Meter, advance_of
from ..errors import InputError, StrPath, named
from ..formats.files import csv_text
from .classes import OURS, ClassMap, class_map
from .doubt import label_doubts
from .frames import (
    CLASS,
    CLASSES,
    LabelFrame,
    LabelPredictions,
    indices_of_truth,
    label_frames,
    read_ids,
    true_classes,
)
from .images import read_label_image
from .panoptic import QUALITIES, PanopticQuality, Segmentation, panoptic_quality
from .scores import VOID, LabelFigures, label_confusion, label_figures

#: Figures of each class that have one.
_OF_CLASS = ("iou", "accuracy")


@dataclass(frozen=True, eq=False)
class LabelErrors:
    """Figures of labels in a table of n classes: over all pixels or samples together, and mean IoU
    of each image alone by its name (None for an image without a true class). panoptic: None
    without instances. unknown: pixels by id or colour that the table does not have. without: true
    classes that the table does not have, which do not count, and their pixels. missing: names of
    frames without an image. warnings: what makes the labels fit far better, settings as `{name}`.
    """

    classes: ClassMap
    figures: LabelFigures
    of_frames: tuple[tuple[str, float | None], ...] = ()
    panoptic: PanopticQuality | None = None
    unknown: tuple[tuple[str, int], ...] = ()
    without: tuple[tuple[str, int], ...] = ()
    missing: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def mean_iou_per_frame(self) -> float | None:
        """Mean over the images of their mean IoU over the classes of their truth."""
        values = [value for _, value in self.of_frames if value is not None]
        return float(np.mean(values)) if values else None

    def to_dict(self) -> dict[str, Any]:
        """All figures; `per_class` has the classes of the truth and `rare` those of them with less
        than 0.1 % of its pixels.
        """
        found: dict[str, Any] = {"classes": self.classes.name, **self.figures.to_dict()}
        if self.of_frames:
            found |= {
                "mean_iou_per_frame": self.mean_iou_per_frame,
                "frames": len(self.of_frames),
            }
        if self.panoptic is not None:
            found |= self.panoptic.to_dict()
        rows = self._rows()
        found |= {
            "compared": int(self.figures.truth.sum()),
            "per_class": [row for row, is_rare in rows if not is_rare],
            "rare": [row for row, is_rare in rows if is_rare],
            "unknown_labels": dict(self.unknown),
            "unmapped_classes": dict(self.without),
            "missing": list(self.missing),
            "warnings": [named(text) for text in self.warnings],
        }
        return found

    def csv(self) -> str:
        """The confusion matrix as CSV: a row for each class of the truth, a column for each class
        of either.
        """
        rows, columns, counts = self.shown()
        names = self.classes.names
        table = [["truth", *(names[k] for k in columns)]]
        for k, row in zip(rows, counts.tolist(), strict=True):
            table.append([names[k], *row])
        return csv_text(table)

    def shown(self) -> tuple[list[int], list[int], np.ndarray]:
        """Indices of the classes of the truth, of those of truth or prediction, and the confusion
        matrix (r, c) of these rows and columns.
        """
        confusion = self.figures.confusion
        rows = np.flatnonzero(confusion.any(axis=1))
        columns = np.flatnonzero(confusion.any(axis=0) | confusion.any(axis=1))
        return rows.tolist(), columns.tolist(), confusion[np.ix_(rows, columns)]

    def _rows(self) -> list[tuple[dict[str, Any], bool]]:
        """The figures of each class of the truth, and whether it is rare."""
        figures = self.figures
        found = []
        for k in np.flatnonzero(figures.truth).tolist():
            share = figures.truth[k] / figures.truth.sum()
            row = {"id": self.classes.classes[k - 1].id, "class": self.classes.names[k]}
            row |= {"share": float(share)}
            row |= {name: float(getattr(figures, name)[k]) for name in _OF_CLASS}
            if self.panoptic is not None:
                row |= {name: float(getattr(self.panoptic, name)[k]) for name in QUALITIES}
            found.append((row, bool(figures.is_rare[k])))
        return found


def label_errors(
    folder: StrPath,
    truth: StrPath,
    classes: str = OURS,
    progress: Meter = None,
) -> LabelErrors:
    """Compare label images in `folder` with the class images of the sequence `truth`, and its
    instance images with those in `folder`, if it has any. Images are found by the frames' names or
    numbers.

    classes: the numbering of the labels, ours, nyu40, scannet20, replica, or the file of a table
    (label_classes.py). Pixels whose truth is no class of it never count. progress: as of
    render_frames().

    Raises InputError if there are no images, images differ in size, or no true pixel has a class.
    """
    folder = Path(folder)
    truth = Path(truth)
    frames = label_frames(truth)
    comparison = _LabelSums(truth, classes)
    predictions = _predictions(folder, truth, CLASS, frames[0].classes)
    images = predictions.of_frames(frames)
    instances = _instances(folder, truth, frames)
    on_frame = advance_of(progress, len(frames), "evaluate")
    for frame, image, instance in zip(frames, images, instances, strict=True):
        if image is not None:
            if any(instances) and instance is None:
                expected = f"an instance image for each class image, such as {image.name}"
                raise InputError(expected, path=folder, found="none")
            comparison.add(frame, image, instance)
        on_frame()
    names = [f.pair.rgb.stem for f, image in zip(frames, images, strict=True) if image is None]
    found = comparison.result(tuple(names))
    doubts = label_doubts(
        frames,
        images,
        predictions.images,
        comparison.listed,
        comparison.classes,
        found.mean_iou_per_frame,
    )
    return replace(found, warnings=doubts)


class _LabelSums:
    """What is summed over the frames."""

    def __init__(self, truth: Path, classes: str) -> None:
        self.listed = true_classes(truth)
        self.table = truth / CLASSES
        self.classes = class_map(classes, self.listed)
        self._of_truth = indices_of_truth(self.listed, self.classes)
        self._unknown: Counter[str] = Counter()
        self._true_pixels = np.zeros(len(self._of_truth), np.int64)
        self._confusions: list[tuple[str, np.ndarray]] = []
        self._panoptic: PanopticQuality | None = None

    def add(self, frame: LabelFrame, image: Path, instance: Path | None) -> None:
        ids = read_ids(frame.classes)
        true = self._of_truth[ids]
        if (true < 0).any():
            found = f"class {ids[true < 0][0]}"
            raise InputError(f"classes of {self.table}", path=frame.classes, found=found)
        self._true_pixels += np.bincount(ids.ravel(), minlength=len(self._of_truth))
        labels = read_label_image(image)
        _check_size(image, labels.shape, ids)
        predicted = self.classes.of_image(labels, image)
        self._unknown.update(predicted.unknown)
        count = len(self.classes.classes)
        confusion = label_confusion(true, predicted.values, count)
        self._confusions.append((frame.pair.rgb.stem, confusion))
        if instance is None or frame.instance is None:
            return
        numbers = read_ids(instance)
        _check_size(instance, numbers.shape, ids)
        quality = panoptic_quality(
            Segmentation(true, read_ids(frame.instance)),
            Segmentation(predicted.values, numbers),
            self.classes.is_thing,
        )
        self._panoptic = quality if self._panoptic is None else self._panoptic + quality

    def result(self, missing: tuple[str, ...]) -> LabelErrors:
        confusion = np.sum([matrix for _, matrix in self._confusions], axis=0)
        with_truth = self._of_truth != VOID
        if not self._true_pixels[with_truth].any():
            expected = f"classes of the ground truth that are in {self.classes.name}"
            raise InputError(expected, path=self.table, found="none")
        of_frames = []
        for name, matrix in self._confusions:
            of_frames.append((name, LabelFigures(matrix).mean_iou if matrix.any() else None))
        without = []
        for kind in self.listed.classes:
            pixels = int(self._true_pixels[kind.id])
            if pixels and not with_truth[kind.id]:
                without.append((kind.name, pixels))
        return LabelErrors(
            self.classes,
            label_figures(confusion),
            tuple(of_frames),
            panoptic=self._panoptic,
            unknown=tuple(self._unknown.most_common()),
            without=tuple(without),
            missing=missing,
        )


def _predictions(folder: Path, truth: Path, kind: str, image: Path) -> LabelPredictions:
    return LabelPredictions(folder, kind, str(image.parent.relative_to(truth)))


def _instances(folder: Path, truth: Path, frames: list[LabelFrame]) -> list[Path | None]:
    """The predicted instance image of each frame, None for all if there are none."""
    first = frames[0].instance
    if first is not None and (found := _predictions(folder, truth, INSTANCE, first)):
        return found.of_frames(frames)
    return [None] * len(frames)


def _check_size(path: Path, shape: tuple[int, ...], truth: np.ndarray) -> None:
    if shape != truth.shape:
        expected = f"{truth.shape[1]} x {truth.shape[0]}, as the true image"
        raise InputError(expected, path=path, found=f"{shape[1]} x {shape[0]}")
