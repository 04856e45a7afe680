"""A first rotation from small images: the in-plane rotation and shift between two frames, taken as
a rotation of the camera.

A. Huang et al., ISRR 2011, section 3.2, by efficient second-order minimization (E. Malis, ICRA
2004) of squared grey differences.
"""

import math

import numpy as np
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from numba import njit

#: The images are 2^-SMALL_LEVEL of the full size, and the motion is iterated so often (constants of
#: the authors' program).
SMALL_LEVEL, ITERATIONS = 4, 8
#: Iterations end with a step shorter than this (pixels of the small images, radians), or this many
#: after the smallest difference.
MIN_STEP, MAX_WORSE = 1e-6, 4
#: Grey value of what is outside the image.
OUTSIDE = 128.0


def small_image(coarse: np.ndarray, level: int) -> np.ndarray:
    """(h, w) float32: the image of pyramid level `level` reduced to SMALL_LEVEL by means of square
    blocks.
    """
    side = 2 ** (SMALL_LEVEL - level)
    h, w = (n // side for n in coarse.shape)
    return (
        coarse[: h * side, : w * side].reshape(h, side, w, side).mean(axis=(1, 3), dtype=np.float32)
    )


def rotation_between(
    previous: np.ndarray, current: np.ndarray, camera: PinholeCamera
) -> np.ndarray:
    """(3, 3) R_previous_current from two small_image().

    As in the authors' program the shift is that of the image's corner, and both its components are
    divided by fx.
    """
    warp = planar_motion(previous, current)
    roll, shift = warp[:, :2], warp[:, 2] * 2**SMALL_LEVEL / camera.fx
    x, y = math.asin(np.clip(shift[1], -1, 1)), -math.asin(np.clip(shift[0], -1, 1))
    z = -math.atan2(roll[1, 0], roll[0, 0])
    about_x, about_y, about_z = (
        so3.exp(angle * axis) for angle, axis in zip((x, y, z), np.eye(3), strict=True)
    )
    return about_z @ about_y @ about_x


def planar_motion(template: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(2, 3): in-plane rotation and shift in pixels from the template (h, w) to the image; the best
    of the iterations, from none.
    """
    warp, best, least, since = np.eye(3), np.eye(3), math.inf, 0
    for _ in range(ITERATIONS):
        rms, A, b = planar_equations(template, image, warp)
        since = 0 if rms < least else since + 1
        if since == 0:
            best, least = warp, rms
        if since > MAX_WORSE or not np.isfinite(A).all() or np.linalg.matrix_rank(A) < 3:
            break
        step = np.linalg.solve(A, b)
        warp = warp @ _planar(*step)
        if np.linalg.norm(step) < MIN_STEP:
            break
    return best[:2]


def _planar(u: float, v: float, angle: float) -> np.ndarray:
    """(3, 3): the exponential of a shift (u, v) in pixels and an angle."""
    s, c = math.sin(angle), math.cos(angle)
    along, across = (s / angle, (1 - c) / angle) if abs(angle) > 1e-9 else (1.0, 0.0)
    return np.array(
        [[c, s, along * u + across * v], [-s, c, along * v - across * u], [0.0, 0.0, 1.0]]
    )


@njit(cache=True)
def planar_equations(template, image, warp):
    """(RMS difference of grey, A (3, 3), b (3,)): equations for the shift and angle that improve a
    warp (3, 3) of the image onto the
    template."""
    h, w = template.shape
    seen = np.empty((h, w))
    for i in range(h):
        for j in range(w):
            seen[i, j] = _grey(
                image,
                warp[0, 0] * j + warp[0, 1] * i + warp[0, 2],
                warp[1, 0] * j + warp[1, 1] * i + warp[1, 2],
            )
    A, b, row, squares = np.zeros((3, 3)), np.zeros(3), np.empty(3), 0.0
    for i in range(h):
        for j in range(w):
            left, right, above, below = (
                max(j - 1, 0),
                min(j + 1, w - 1),
                max(i - 1, 0),
                min(i + 1, h - 1),
            )
            row[0] = (template[i, right] - template[i, left] + seen[i, right] - seen[i, left]) / (
                right - left
            )
            row[1] = (template[below, j] - template[above, j] + seen[below, j] - seen[above, j]) / (
                below - above
            )
            row[2] = row[0] * (i + 1) - row[1] * (j + 1)
            error = seen[i, j] - template[i, j]
            squares += error * error
            for a in range(3):
                b[a] -= 2.0 * row[a] * error
                for c in range(3):
                    A[a, c] += row[a] * row[c]
    return np.sqrt(squares / (h * w)), A, b


@njit(cache=True)
def _grey(image, u, v):
    """Bilinear; within a pixel of the border the pixel towards the image's corner (0, 0), or else
    the opposite one; OUTSIDE beyond.
    """
    h, w = image.shape
    j, i = math.floor(u), math.floor(v)
    if 0 <= u < w - 1 and 0 <= v < h - 1:
        s, t = u - j, v - i
        top = image[i, j] + s * (image[i, j + 1] - image[i, j])
        bottom = image[i + 1, j] + s * (image[i + 1, j + 1] - image[i + 1, j])
        return top + t * (bottom - top)
    if not (0 <= j < w and 0 <= i < h):
        j, i = math.ceil(u), math.ceil(v)
    return float(image[i, j]) if 0 <= j < w and 0 <= i < h else OUTSIDE
