"""Measures the similarity of our frames to the official ones in features that odometers use:
corners, gradients, depth.
"""

from dataclasses import asdict, dataclass

import cv2
import numpy as np

DEPTH_SHARES = (10, 25, 50, 75, 90)


@dataclass(frozen=True)
class Likeness:
    """Figures of one frame: FAST corners at threshold 20 and at OpenCV's default (10), median grey
    gradient (8-bit units per pixel), mean grey value 0..1, depth quantiles (m).
    """

    corners_20: int
    corners_10: int
    gradient: float
    grey: float
    depth_quantiles_m: tuple[float, ...]

    def ratios_to(self, other: "Likeness") -> dict[str, float | list[float]]:
        """self / other, figure by figure."""
        theirs = asdict(other)
        return {k: np.divide(v, theirs[k]).round(3).tolist() for k, v in asdict(self).items()}


def measure(bgr: np.ndarray, depth_z_m: np.ndarray) -> Likeness:
    """Measure a frame: bgr (h, w, 3) uint8, planar depth (h, w) in metres, 0 = missing."""
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    dy, dx = np.gradient(grey.astype(float))
    quantiles = np.percentile(depth_z_m[depth_z_m > 0], DEPTH_SHARES)
    return Likeness(
        len(cv2.FastFeatureDetector.create(threshold=20).detect(grey)),
        len(cv2.FastFeatureDetector.create(threshold=10).detect(grey)),
        float(np.median(np.hypot(dx, dy))),
        float(grey.mean() / 255),
        tuple(float(q) for q in quantiles),
    )


def side_by_side(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """One image with the official frame on the left and ours on the right."""
    return np.concatenate([theirs, np.full((theirs.shape[0], 8, 3), 255, np.uint8), ours], 1)
