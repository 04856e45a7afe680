"""Figures of a semantic segmentation from one confusion matrix: IoU of each class and its means,
accuracies of pixels and classes.

Definitions: mean and frequency-weighted IoU and both accuracies as in Long, Shelhamer and Darrell
(CVPR 2015), section 5; the mean is over the classes that the truth has.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..shown import Brief

#: The index of pixels without a class. Where the truth has it, a pixel never counts; where only a
#: prediction has it, the pixel is wrong.
VOID = 0
#: Classes with a smaller share of the true pixels are listed separately.
RARE = 0.001
#: The figures over all classes.
_OF_ALL = (
    "mean_iou",
    "mean_iou_without_rare",
    "frequency_weighted_iou",
    "pixel_accuracy",
    "mean_accuracy",
    "unlabelled",
)


@dataclass(frozen=True, eq=False, repr=False)
class LabelFigures(Brief):
    """Figures of n classes. confusion (n + 1, n + 1) int64: pixels by true class (row) and
    predicted class (column), both from 0, VOID, on; row VOID is 0. Figures of each class are (n +
    1,), NaN for VOID and for classes that the truth does not have.
    """

    confusion: np.ndarray

    @property
    def truth(self) -> np.ndarray:
        """(n + 1,) int64: true pixels of each class."""
        return self.confusion.sum(axis=1)

    @property
    def iou(self) -> np.ndarray:
        """(n + 1,) intersection over union of each class."""
        union = self.truth + self.confusion.sum(axis=0) - self._right
        return np.where(self.truth > 0, self._right / np.maximum(union, 1), np.nan)

    @property
    def accuracy(self) -> np.ndarray:
        """(n + 1,) share of the true pixels of each class that are predicted as this class."""
        return np.where(self.truth > 0, self._right / np.maximum(self.truth, 1), np.nan)

    @property
    def is_rare(self) -> np.ndarray:
        """(n + 1,) bool: classes of the truth with a share below RARE of its pixels."""
        return (self.truth > 0) & (self.truth < RARE * self.truth.sum())

    @property
    def mean_iou(self) -> float:
        """Mean IoU over the classes that the truth has."""
        return float(np.nanmean(self.iou))

    @property
    def mean_iou_without_rare(self) -> float:
        """Mean IoU over the classes of the truth that are not rare."""
        return float(np.nanmean(self.iou[~self.is_rare]))

    @property
    def frequency_weighted_iou(self) -> float:
        """Mean IoU of the classes, weighted with their true pixels."""
        present = self.truth > 0
        return float((self.truth[present] * self.iou[present]).sum() / self.truth.sum())

    @property
    def pixel_accuracy(self) -> float:
        """Share of the true pixels with the right class."""
        return float(self._right.sum() / self.truth.sum())

    @property
    def mean_accuracy(self) -> float:
        """Mean accuracy over the classes that the truth has."""
        return float(np.nanmean(self.accuracy))

    @property
    def unlabelled(self) -> float:
        """Share of the true pixels without a predicted class."""
        return float(self.confusion[:, VOID].sum() / self.truth.sum())

    @property
    def _right(self) -> np.ndarray:
        return self.confusion.diagonal()

    def to_dict(self) -> dict[str, float]:
        """The figures over all classes."""
        return {name: getattr(self, name) for name in _OF_ALL}


def label_confusion(truth: np.ndarray, predicted: np.ndarray, classes: int) -> np.ndarray:
    """(classes + 1, classes + 1) int64: pixels by true and predicted class, both integers from 0,
    VOID, to `classes`, in arrays of one shape. Pixels whose truth is VOID are left out.

    Raises InputError for other shapes, types or values.
    """
    for name, labels in (("truth", truth), ("prediction", predicted)):
        _check(name, labels, classes)
    if truth.shape != predicted.shape:
        raise InputError(f"a prediction of shape {truth.shape}", found=predicted.shape)
    valid = truth != VOID
    side = classes + 1
    codes = truth[valid].astype(np.int64) * side + predicted[valid]
    return np.bincount(codes, minlength=side * side).reshape(side, side)


def label_figures(confusion: np.ndarray) -> LabelFigures:
    """The figures of a confusion matrix (n + 1, n + 1).

    Raises InputError if no true pixel has a class.
    """
    if not confusion.any():
        raise InputError("true labels other than unlabelled", found="none")
    return LabelFigures(confusion)


def _check(name: str, labels: np.ndarray, classes: int) -> None:
    if labels.dtype.kind not in "iu":
        raise InputError(f"a {name} of integers", found=labels.dtype)
    if labels.size and not 0 <= labels.min() <= labels.max() <= classes:
        found = f"{labels.min()} to {labels.max()}"
        raise InputError(f"a {name} of classes 0 to {classes}", found=found)
