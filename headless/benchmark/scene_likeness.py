"""How like the official frames our living room's are, in what an odometer feeds on: corners, gradients, depth."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from iclnuim.errors import InputError

#: Official frames with both picture and depth, by number in lr_kt0.
FRAMES = (0, 1, 50)
TRAJECTORY = "trajectories/lr_kt0_Tpov_cam_3x4.txt"
DEPTH_SHARES = (10, 25, 50, 75, 90)


@dataclass(frozen=True)
class Likeness:
    """Of one frame: FAST corners at threshold 20 and at OpenCV's default (10), median grey gradient (8-bit units a
    pixel), mean grey 0..1, depth quantiles (m).
    """

    corners_20: int
    corners_10: int
    gradient: float
    grey: float
    depth_quantiles_m: tuple[float, ...]

    def ratios_to(self, other: Likeness) -> dict[str, float | list[float]]:
        """self / other, figure by figure."""
        mine, theirs = asdict(self), asdict(other)
        return {k: (np.divide(mine[k], theirs[k]).round(3).tolist()) for k in mine}


def measure(bgr: np.ndarray, depth_z_m: np.ndarray) -> Likeness:
    """bgr (h, w, 3) bytes and planar depth (h, w) in metres, 0 missing."""
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    dy, dx = np.gradient(grey.astype(float))
    counts = [len(cv2.FastFeatureDetector_create(threshold=t).detect(grey)) for t in (20, 10)]
    quantiles = np.percentile(depth_z_m[depth_z_m > 0], DEPTH_SHARES)
    return Likeness(
        *counts, float(np.median(np.hypot(dx, dy))), float(grey.mean() / 255), tuple(float(q) for q in quantiles)
    )


def official(samples: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Frame `number` of lr_kt0: bgr bytes (480, 640, 3) and planar depth in metres."""
    folder = samples / "lr_kt0"
    bgr = cv2.imread(str(folder / f"image_rgb_{number}.png"))
    depth_mm = cv2.imread(str(folder / f"image_depth_{number}.pgm"), cv2.IMREAD_UNCHANGED)
    if bgr is None or depth_mm is None:
        raise InputError(f"the official frame {number} (picture and depth)", path=folder, found="not both")
    return bgr, depth_mm / 1000.0


def srgb_bytes(rgb: np.ndarray) -> np.ndarray:
    """Scene-linear RGB (h, w, 3) to sRGB bytes in OpenCV's order (blue first)."""
    value = np.clip(rgb, 0, 1)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255).astype(np.uint8)[..., ::-1].copy()


def side_by_side(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """The official frame at the left, ours at the right."""
    return np.concatenate([theirs, np.full((theirs.shape[0], 8, 3), 255, np.uint8), ours], 1)
