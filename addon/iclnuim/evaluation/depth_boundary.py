"""Boundary F1 of predicted depth, as Bochkovskii and others define it for Depth Pro (ICLR 2025,
section 3.3, and its code): where the depths of neighbours differ by more than a ratio, one of them
occludes the other.

Each of four directions (a pixel is nearer than its left, right, upper or lower neighbour) has a
precision and a recall for each ratio; F1 is that of their means over the directions, averaged over
ten ratios of 1.05 to 1.25 with weights that are proportional to the ratios. A direction in which
the truth has no boundary of a ratio counts as 0, so that exact depth of a small or smooth image can
score below 1.
"""

import numpy as np

RATIOS = np.linspace(1.05, 1.25, 10)


def boundary_counts(depth_m: np.ndarray, true_m: np.ndarray) -> np.ndarray:
    """(3, 4, 10) int64: pairs of neighbours that are a boundary of both depth images (h, w), of the
    prediction, and of the truth, by direction and ratio. NaN is missing: a pair of which the truth
    lacks a depth never counts, one of which the prediction lacks a depth is no boundary of it.
    """
    counts = np.zeros((3, 4, len(RATIOS)), np.int64)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in (0, 1):
            for side, (predicted, true) in enumerate(
                zip(_ratios(depth_m, axis), _ratios(true_m, axis), strict=True)
            ):
                predicted = np.where(np.isnan(true), 0, predicted)
                seen = (predicted > RATIOS[0]) | (true > RATIOS[0])
                predicted = predicted[seen]
                true = true[seen]
                both = np.minimum(predicted, true)
                for kind, ratios in enumerate((both, predicted, true)):
                    ordered = np.sort(ratios)  # NaN last
                    within = np.searchsorted(ordered, RATIOS, "right")
                    finite = len(ordered) - np.count_nonzero(np.isnan(ordered))
                    counts[kind, 2 * axis + side] = finite - within
    return counts


def _ratios(depth_m: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """The ratio of each depth to that of the neighbour before it, and the other way round."""
    first = depth_m[:-1] if axis == 0 else depth_m[:, :-1]
    second = depth_m[1:] if axis == 0 else depth_m[:, 1:]
    return second / first, first / second


def boundary_f1(counts: np.ndarray) -> float | None:
    """F1 of the counts (3, 4, 10) of one image, or of the sum of those of many; None if the truth
    has no boundary.
    """
    both, predicted, true = counts
    if not true.any():
        return None
    precision = (both / np.maximum(predicted, 1)).mean(axis=0)
    recall = (both / np.maximum(true, 1)).mean(axis=0)
    f1 = 2 * precision * recall / np.maximum(precision + recall, np.finfo(float).tiny)
    return float((f1 * RATIOS).sum() / RATIOS.sum())
