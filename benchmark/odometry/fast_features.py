"""The front end of FOVIS as its authors' program (fovis 1.2) has it: FAST corners with a threshold
that follows their number.

A. Huang et al., "Visual odometry and mapping for autonomous flight using an RGB-D camera", ISRR
2011, sections 3.1 and 3.3. Names in quotes are options of the program, with their default.
"""

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera

from .byte_patches import describe_in_bytes
from .features import BUCKET_PX, PER_BUCKET, REACH, Features, assembled
from .gcc_order import largest_first
from .protocol import Frame
from .solver import MIN_SIDE

#: FAST's threshold in grey levels of the first frame ("fast-threshold"), and its limits (constants
#: of the program).
FIRST_THRESHOLD, MIN_THRESHOLD, MAX_THRESHOLD = 20, 5, 70
#: Pixels of the full image for each corner ("target-pixels-per-feature"), and the change of the
#: threshold, in grey levels, for each corner above this number ("fast-threshold-adaptive-gain").
PIXELS_PER_CORNER, GAIN = 250, 0.005
#: Greys are rounded down, as libpng does it for the program. Those of whole colours are multiples
#: of 0.001.
ROUNDING = np.float32(0.0005)


def fast_features(frame: Frame, camera: PinholeCamera, levels: int, threshold: int) -> Features:
    """FAST corners with depth, at most PER_BUCKET for each bucket of each level.

    `next_threshold` is set for the next frame.
    """
    images = [np.clip(frame.grey + ROUNDING, 0, 255).astype(np.uint8)]
    while len(images) < levels and min(images[-1].shape) >= 2 * MIN_SIDE:
        images.append(halved(images[-1]))
    found = [fast_corners(image, threshold) for image in images]
    excess = sum(len(uv) for uv, _ in found) - camera.width * camera.height // PIXELS_PER_CORNER
    kept = [
        _inside(strongest(*corners), image) for corners, image in zip(found, images, strict=True)
    ]
    next_threshold = int(np.clip(threshold + int(GAIN * excess), MIN_THRESHOLD, MAX_THRESHOLD))
    return assembled(images, frame, camera, kept, describe_in_bytes, next_threshold)


def halved(image: np.ndarray) -> np.ndarray:
    """(h // 2, w // 2) uint8: the binomial mean of 5x5 pixels around each even pixel, rounded down
    after the rows and after the columns.

    At the left and upper border the program weights three pixels 1, 4, 3; the other borders are
    reflected.
    """
    h, w = image.shape
    for n in (w // 2, h // 2):  # along the rows, then, of the transpose, along the columns
        wide = np.pad(image, ((0, 0), (2, 2)), mode="reflect").astype(np.uint16)
        a, b, c, d, e = (wide[:, i : i + 2 * n : 2] for i in range(5))
        mean = (a + 4 * b + 6 * c + 4 * d + e) >> 4
        mean[:, 0] = (c[:, 0] + 4 * d[:, 0] + 3 * e[:, 0]) >> 3
        image = mean.astype(np.uint8).T
    return np.ascontiguousarray(image)


def fast_corners(image: np.ndarray, threshold: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) and scores (n,) of FAST; the score is the highest threshold at which a pixel is
    still a corner.
    """
    corners = cv2.FastFeatureDetector.create(threshold, True).detect(image)
    return np.array([c.pt for c in corners], np.int64).reshape(-1, 2), np.array(
        [c.response for c in corners]
    )


def _inside(uv: np.ndarray, image: np.ndarray) -> np.ndarray:
    """The corners that are more than the patch's radius from the border."""
    h, w = image.shape
    return uv[((uv > REACH) & (uv < (w - REACH - 1, h - REACH - 1))).all(axis=1)]


def strongest(uv: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """The PER_BUCKET strongest corners of each bucket, one bucket after the other."""
    _, bucket = np.unique(uv[:, ::-1] // BUCKET_PX, axis=0, return_inverse=True)
    chosen = [np.zeros(0, np.int64)]
    for n in range(bucket.max(initial=-1) + 1):
        at = np.flatnonzero(bucket == n)
        chosen.append(at[largest_first(scores[at], PER_BUCKET)[:PER_BUCKET]])
    return uv[np.concatenate(chosen)]
