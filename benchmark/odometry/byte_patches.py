"""Subpixel positions of matched corners as FOVIS' authors' program (fovis 1.2) refines them: in
8-bit greys.

A. Huang et al., ISRR 2011, section 3.5: efficient second-order minimization (Benhimane, Malis 2004)
of squared differences between patches. `features.refine` is this project's version.
"""

import numpy as np
from numba import njit

from .features import MID_GREY, REACH, Features, Matches, depth_at, difference, points

SIDE = 2 * REACH + 1
#: The last pixel of a patch is not compared, so that the others are a multiple of 16 bytes.
COMPARED = SIDE * SIDE - 1
#: Maximum number of steps; the iteration ends with a step shorter than MIN_STEP_PX; a position
#: farther than MAX_SHIFT_PX from its corner is not used (constants of the program; pixels of the
#: level).
STEPS, MIN_STEP_PX, MAX_SHIFT_PX = 6, 0.1, 1.5
#: Minimum distance from the border of a position: the side of the patch ("feature-window-size"),
#: and one more on the right and below.
BORDER = SIDE


def match_in_bytes(
    reference: Features, current: Features, expected_uv: np.ndarray, search_px: float
) -> Matches:
    """features.match() with positions from refine_in_bytes(). A corner whose position stays, or is
    between four
    pixels without depth, keeps its point; if only some of the four have no depth, it is NaN, which
    agrees with none."""
    one, other = (reference.descriptions, reference.level), (current.descriptions, current.level)
    pairs = mutual_in_order(*one, *other, expected_uv, current.uv, search_px)
    i = np.flatnonzero(pairs >= 0)
    j = pairs[i]
    uv = current.uv[j].copy()
    for n, (image0, image1) in enumerate(zip(reference.images, current.images, strict=True)):
        at = np.flatnonzero(reference.level[i] == n)
        refine_in_bytes(image0, image1, reference.uv[i[at]] / 2**n, uv, at, float(2**n))
    z, points1_m = depth_at(current.depth_z_m, uv), current.points_m[j]
    refined = (uv != current.uv[j]).any(axis=1) & _depth_near(current.depth_z_m, uv)
    points1_m[refined] = points(current.camera, uv[refined], np.where(z > 0, z, np.nan)[refined])
    return Matches(
        reference.uv[i], reference.points_m[i], uv, points1_m, reference.level[i], np.ones(len(i))
    )


def _depth_near(depth_z_m: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(n,) bool: whether any of the four pixels around each of uv (n, 2) has depth."""
    u, v = np.floor(uv).astype(int).T
    return np.any([depth_z_m[v + i, u + j] > 0 for i in (0, 1) for j in (0, 1)], axis=0)


@njit(cache=True)
def mutual_in_order(descriptions0, level0, descriptions1, level1, expected_uv, uv1, search_px):
    """features.mutual_best() for corners in any order, of which the first one of equally similar
    ones is taken.
    """
    n0, n1 = len(level0), len(level1)
    best0, best1 = np.full(n0, 1 << 30), np.full(n1, 1 << 30)
    of0, of1 = np.full(n0, -1), np.full(n1, -1)
    for i in range(n0):
        for j in range(n1):
            du, dv = uv1[j, 0] - expected_uv[i, 0], uv1[j, 1] - expected_uv[i, 1]
            if level0[i] != level1[j] or not du * du + dv * dv < search_px * search_px:
                continue
            score = difference(descriptions0[i], descriptions1[j], max(best0[i], best1[j]))
            if score < best0[i]:
                best0[i], of0[i] = score, j
            if score < best1[j]:
                best1[j], of1[j] = score, i
    for i in range(n0):
        if of0[i] >= 0 and of1[of0[i]] != i:
            of0[i] = -1
    return of0


@njit(cache=True)
def refine_in_bytes(image0, image1, uv0, uv1, at, scale):
    """Refine uv1[at] (pixels of the full image, `scale` times those of image1) so that the patch of
    image1 matches that of image0 around
    uv0. Positions that cannot be refined stay.

    Gradients are differences of neighbouring pixels at the integer position, and steps are taken
    while the difference decreases.
    """
    h, w = image1.shape
    patch0, patch1 = np.empty(COMPARED, np.int64), np.empty(COMPARED, np.int64)
    slopes0, slopes1 = np.empty((COMPARED, 2), np.int64), np.empty((COMPARED, 2), np.int64)
    for n in range(len(at)):
        start_u, start_v = uv1[at[n], 0] / scale, uv1[at[n], 1] / scale
        u, v = np.float32(start_u), np.float32(start_v)
        _patch(image0, np.float32(uv0[n, 0]), np.float32(uv0[n, 1]), patch0)
        _slopes(image0, int(uv0[n, 0]), int(uv0[n, 1]), slopes0)
        _patch(image1, u, v, patch1)
        least = _squares(patch0, patch1)
        for _ in range(STEPS):
            _slopes(image1, int(u), int(v), slopes1)
            a = b = c = p = q = 0
            for k in range(COMPARED):
                x_slope, y_slope = slopes0[k, 0] + slopes1[k, 0], slopes0[k, 1] + slopes1[k, 1]
                error = patch1[k] - patch0[k]
                a += x_slope * x_slope
                b += x_slope * y_slope
                c += y_slope * y_slope
                p += x_slope * error
                q += y_slope * error
            det = float(a * c - b * b)
            if det <= 0:
                break
            du, dv = -2 * (c * p - b * q) / det, -2 * (a * q - b * p) / det
            next_u, next_v = np.float32(u + du), np.float32(v + dv)
            if not (BORDER <= next_u <= w - BORDER - 2 and BORDER <= next_v <= h - BORDER - 2):
                break
            _patch(image1, next_u, next_v, patch1)
            squares = _squares(patch0, patch1)
            if squares >= least:
                break
            u, v, least = next_u, next_v, squares
            if abs(du) < MIN_STEP_PX and abs(dv) < MIN_STEP_PX:
                break
        if (u - start_u) ** 2 + (v - start_v) ** 2 <= MAX_SHIFT_PX**2:
            uv1[at[n], 0], uv1[at[n], 1] = u * scale, v * scale


@njit(cache=True)
def describe_in_bytes(image, uv):
    """(n, COMPARED) uint8: the patch around each of uv (n, 2), pixels of the image, shifted to a
    mean of mid-grey.

    It is shifted twice, which differs where the first shift ended at black or white.
    """
    out, patch = np.empty((len(uv), COMPARED), np.uint8), np.empty(COMPARED, np.int64)
    for n in range(len(uv)):
        _patch(image, np.float32(uv[n, 0]), np.float32(uv[n, 1]), patch)
        _shift(patch)
        out[n] = patch
    return out


@njit(cache=True)
def _patch(image, u, v, out):
    """out (COMPARED,): the patch around (u, v), bilinear and rounded down, shifted to a mean of
    mid-grey.
    """
    j, i = int(u), int(v)
    s, t = float(u) - j, float(v) - i
    a, b = (
        np.float32((1 - s) * (1 - t)),
        np.float32(s * (1 - t)),
    )  # in single precision an even area may be rounded down
    c, d = np.float32((1 - s) * t), np.float32(s * t)
    for k in range(COMPARED):
        y, x = i + k // SIDE - REACH, j + k % SIDE - REACH
        above = a * np.float32(image[y, x]) + b * np.float32(image[y, x + 1])
        out[k] = int(above + c * np.float32(image[y + 1, x]) + d * np.float32(image[y + 1, x + 1]))
    _shift(out)


@njit(cache=True)
def _shift(patch):
    """Shift a patch (COMPARED,) to a mean of mid-grey, within 0..255."""
    shift = int(MID_GREY) - patch.sum() // COMPARED
    for k in range(COMPARED):
        patch[k] = min(max(patch[k] + shift, 0), 255)


@njit(cache=True)
def _slopes(image, j, i, out):
    """out (COMPARED, 2): differences of each pixel of the patch around (j, i) to its right and
    lower neighbours.
    """
    for k in range(COMPARED):
        y, x = i + k // SIDE - REACH, j + k % SIDE - REACH
        here = int(image[y, x])
        out[k, 0], out[k, 1] = int(image[y, x + 1]) - here, int(image[y + 1, x]) - here


@njit(cache=True)
def _squares(one, other):
    total = 0
    for k in range(len(one)):
        total += (one[k] - other[k]) ** 2
    return total
