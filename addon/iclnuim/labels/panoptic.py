"""Panoptic quality of segments: classes with instances (things), and classes without (stuff), which
are one segment in each image.

Kirillov, He, Girshick, Rother and Dollar, Panoptic Segmentation, CVPR 2019, section 4.
"""

from dataclasses import dataclass

import numpy as np

from ..shown import Brief
from .scores import VOID

#: A predicted segment matches a true one of its class above this IoU; no more than one does
#: (section 4.1).
_MATCHED = 0.5
#: The figures of each class.
QUALITIES = ("panoptic_quality", "segmentation_quality", "recognition_quality")


@dataclass(frozen=True, eq=False, repr=False)
class PanopticQuality(Brief):
    """Segments by class, (n + 1,) each: matched pairs, false_positives (unmatched predicted ones),
    false_negatives (unmatched true ones), and iou_sum of the pairs. Figures of each class are NaN
    for classes of which the truth has no segment.
    """

    matched: np.ndarray
    false_positives: np.ndarray
    false_negatives: np.ndarray
    iou_sum: np.ndarray

    def __add__(self, other: "PanopticQuality") -> "PanopticQuality":
        """The segments of both, of other images."""
        return PanopticQuality(*map(np.add, vars(self).values(), vars(other).values()))

    @property
    def segmentation_quality(self) -> np.ndarray:
        """(n + 1,) SQ of each class: mean IoU of matched segments, 0 without any."""
        return self._of_present(self.iou_sum / np.maximum(self.matched, 1))

    @property
    def recognition_quality(self) -> np.ndarray:
        """(n + 1,) RQ of each class: the F1 score of its segments."""
        unmatched = self.false_positives + self.false_negatives
        return self._of_present(self.matched / np.maximum(self.matched + unmatched / 2, 0.5))

    @property
    def panoptic_quality(self) -> np.ndarray:
        """(n + 1,) PQ of each class: SQ times RQ."""
        return self.segmentation_quality * self.recognition_quality

    @property
    def is_present(self) -> np.ndarray:
        """(n + 1,) bool: classes of which the truth has a segment."""
        return self.matched + self.false_negatives > 0

    def to_dict(self) -> dict[str, float]:
        """Means over the classes of which the truth has a segment."""
        return {name: float(np.nanmean(getattr(self, name))) for name in QUALITIES}

    def _of_present(self, values: np.ndarray) -> np.ndarray:
        return np.where(self.is_present, values, np.nan)


@dataclass(frozen=True, eq=False, repr=False)
class Segmentation(Brief):
    """One image: classes from 0, VOID, on, and numbers of instances, integers (h, w)."""

    classes: np.ndarray
    instances: np.ndarray


def panoptic_quality(
    truth: Segmentation, predicted: Segmentation, is_thing: np.ndarray
) -> PanopticQuality:
    """The matched and unmatched segments of an image. is_thing (n + 1,) bool: classes whose
    instances are segments of their own. Pixels whose truth is VOID belong to no segment.
    """
    valid = truth.classes != VOID
    true_ids, true_of = _segments(truth, valid, is_thing)
    ids, of = _segments(predicted, valid, is_thing)
    pairs, common = np.unique(true_of * len(ids) + of, return_counts=True)
    a, b = np.divmod(pairs, max(len(ids), 1))
    areas = np.bincount(true_of, minlength=len(true_ids))[a] + np.bincount(of)[b]
    iou = common / (areas - common)
    same = (_class_of(true_ids)[a] == _class_of(ids)[b]) & (iou > _MATCHED)
    count = len(is_thing)
    kinds = _class_of(true_ids[a[same]])
    matched = np.bincount(kinds, minlength=count)
    segments = np.bincount(_class_of(ids), minlength=count)
    segments[VOID] = 0
    return PanopticQuality(
        matched,
        segments - matched,
        np.bincount(_class_of(true_ids), minlength=count) - matched,
        np.bincount(kinds, iou[same], minlength=count),
    )


def _segments(
    image: Segmentation, valid: np.ndarray, is_thing: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of the segments of the valid pixels, and the index of each pixel's."""
    classes = image.classes[valid].astype(np.int64)
    instances = np.where(is_thing[classes], image.instances[valid].astype(np.int64), 0)
    return np.unique(classes << 32 | instances, return_inverse=True)


def _class_of(segment: np.ndarray) -> np.ndarray:
    return segment >> 32
