"""Corner detection and matching with depth: the front end of FOVIS.

A. Huang et al., "Visual odometry and mapping for autonomous flight using an RGB-D camera", ISRR
2011, sections 3.1 to 3.4. Each pyramid level is a 5x5 Gaussian of the even pixels of the level
before, so (u, v) on level n is (u, v) 2^n in the image.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from numba import njit

from .kernels import halve_depth
from .protocol import Frame
from .solver import MIN_SIDE, Level

#: Radius in pixels of the patch that describes a corner.
REACH = 4
#: Mean grey value of a description.
MID_GREY = 128.0
#: Minimum eigenvalue of a corner's structure tensor (gradients per pixel of an image in 0..1,
#: squared): two grey levels.
MIN_EIGENVALUE = (2 / 255) ** 2
#: Scale of the structure tensor: half the 7x7 mean of products of Sobel sums, which are up to 4 x
#: 255.
SOBEL_SQUARES = np.float32(1 / (2 * 49 * 1020.0**2))
#: Side in pixels of a bucket, and the maximum number of corners in it; the strongest are used.
BUCKET_PX, PER_BUCKET = 80, 25


@dataclass(frozen=True, eq=False)
class Features:
    """Corners of one frame, sorted by level, then row. images: grey (h, w) uint8, fine to coarse;
    uv (n, 2): pixels of the full
    image; level (n,); points_m (n, 3): in the camera's frame; descriptions (n, 81) uint8.
    """

    images: list[np.ndarray]
    depth_z_m: np.ndarray
    camera: PinholeCamera
    uv: np.ndarray
    level: np.ndarray
    points_m: np.ndarray
    descriptions: np.ndarray
    calibrated: bool = False  # Frame.calibrated

    @cached_property
    def half(self) -> Level:
        """The half-size level for the geometric term, which does not use its grey values."""
        half = halve_depth(self.depth_z_m)
        return Level(self.images[-1], half, self.camera.halved(), calibrated=self.calibrated)


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched corners: pixels uv (n, 2) and points_m (n, 3) in both frames, the pyramid level (n,)
    and a weight (n,) of their residuals.
    """

    uv0: np.ndarray
    points0_m: np.ndarray
    uv1: np.ndarray
    points1_m: np.ndarray
    level: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.level)

    def chosen(self, which: np.ndarray) -> "Matches":
        """The matches selected by a mask or by indices."""
        return Matches(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def features(frame: Frame, camera: PinholeCamera, levels: int, count: int) -> Features:
    """About `count` corners with depth over all levels, at most PER_BUCKET per bucket: maxima of
    the structure tensor's smaller eigenvalue.
    """
    images: list[np.ndarray] = [cv2.convertScaleAbs(frame.grey)]
    while len(images) < levels and min(images[-1].shape) >= 2 * MIN_SIDE:
        images.append(cv2.pyrDown(images[-1]))
    found = [_inside(eigenvalue_corners(image), image.shape) for image in images]
    threshold = _threshold(np.concatenate([scores for _, scores in found]), count)
    kept = [
        strongest(uv[scores >= threshold], scores[scores >= threshold], images[n].shape[1])
        for n, (uv, scores) in enumerate(found)
    ]
    level = np.repeat(np.arange(len(images)), [len(uv) for uv in kept])
    uv = np.concatenate([uv * 2**n for n, uv in enumerate(kept)]).astype(float)
    z = frame.depth_z_m[uv[:, 1].astype(int), uv[:, 0].astype(int)]
    descriptions = np.concatenate([describe(*pair) for pair in zip(images, kept, strict=True)])
    has = z > 0
    return Features(
        images=images,
        depth_z_m=frame.depth_z_m,
        camera=camera,
        uv=uv[has],
        level=level[has],
        points_m=points(camera, uv[has], z[has]),
        descriptions=descriptions[has],
        calibrated=frame.calibrated,
    )


def points(camera: PinholeCamera, uv: np.ndarray, z_m: np.ndarray) -> np.ndarray:
    x, y = (uv[:, 0] - camera.cx) / camera.fx, (uv[:, 1] - camera.cy) / camera.fy
    return np.stack([x * z_m, y * z_m, z_m], axis=1)


def eigenvalue_corners(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) and scores (n,) of local maxima of the structure tensor's smaller eigenvalue
    (Shi, Tomasi 1994).
    """
    scores = smaller_eigenvalues(image)
    peaks = (scores == cv2.dilate(scores, np.ones((7, 7), np.uint8))) & (scores > MIN_EIGENVALUE)
    v, u = np.divmod(np.flatnonzero(peaks), image.shape[1])
    return np.stack([u, v], axis=1), scores[v, u]


@njit(cache=True, fastmath=True)
def smaller_eigenvalues(image):
    """(h, w) float32: smaller eigenvalue of the structure tensor, the 7x7 mean of products of Sobel
    gradients per pixel of an image
    in 0..1.

    Same as cv2.cornerMinEigenVal(image, 7) in less than half the time; 0 within 4 pixels of the
    border.
    """
    h, w = image.shape
    out = np.zeros((h, w), np.float32)
    slopes_x, slopes_y = np.zeros((7, w), np.float32), np.zeros((7, w), np.float32)
    xx, xy, yy = np.zeros(w, np.float32), np.zeros(w, np.float32), np.zeros(w, np.float32)
    for v in range(1, h - 1):
        above, row, below = image[v - 1], image[v], image[v + 1]
        x, y = slopes_x[v % 7], slopes_y[v % 7]
        for u in range(w):
            xx[u] -= x[u] * x[u]
            xy[u] -= x[u] * y[u]
            yy[u] -= y[u] * y[u]
        for u in range(1, w - 1):
            a, b, c = np.int32(above[u - 1]), np.int32(above[u]), np.int32(above[u + 1])
            d, e, f = np.int32(below[u - 1]), np.int32(below[u]), np.int32(below[u + 1])
            x[u] = np.float32(c - a + 2 * (np.int32(row[u + 1]) - np.int32(row[u - 1])) + f - d)
            y[u] = np.float32(d - a + 2 * (e - b) + f - c)
        for u in range(w):
            xx[u] += x[u] * x[u]
            xy[u] += x[u] * y[u]
            yy[u] += y[u] * y[u]
        if v < 7:
            continue
        for u in range(4, w - 4):
            a = xx[u - 3] + xx[u - 2] + xx[u - 1] + xx[u] + xx[u + 1] + xx[u + 2] + xx[u + 3]
            b = xy[u - 3] + xy[u - 2] + xy[u - 1] + xy[u] + xy[u + 1] + xy[u + 2] + xy[u + 3]
            c = yy[u - 3] + yy[u - 2] + yy[u - 1] + yy[u] + yy[u + 1] + yy[u + 2] + yy[u + 3]
            out[v - 3, u] = (a + c - np.sqrt((a - c) * (a - c) + 4 * b * b)) * SOBEL_SQUARES
    return out


def _inside(
    found: tuple[np.ndarray, np.ndarray], shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """The corners whose patch is inside the image."""
    uv, scores = found
    inside = ((uv > REACH) & (uv < (shape[1] - REACH - 2, shape[0] - REACH - 2))).all(axis=1)
    return uv[inside], scores[inside]


def _threshold(scores: np.ndarray, count: int) -> float:
    """The threshold, at least MIN_EIGENVALUE, that about `count` corners exceed."""
    if len(scores) <= count:
        return MIN_EIGENVALUE
    return float(
        max(np.partition(scores, len(scores) - count)[len(scores) - count], MIN_EIGENVALUE)
    )


def strongest(uv: np.ndarray, scores: np.ndarray, width: int) -> np.ndarray:
    """The PER_BUCKET strongest corners of each bucket; ties are in the order of detection."""
    bucket = uv[:, 1] // BUCKET_PX * -(-width // BUCKET_PX) + uv[:, 0] // BUCKET_PX
    order = np.lexsort((-scores, bucket))
    first = np.searchsorted(bucket[order], bucket[order])
    return uv[np.sort(order[np.arange(len(order)) - first < PER_BUCKET])]


@njit(cache=True)
def describe(image, uv):
    """(n, 81) uint8: the patch around each of uv (n, 2), shifted to a mean of mid-grey."""
    side = 2 * REACH + 1
    out = np.empty((len(uv), side * side), np.uint8)
    for n in range(len(uv)):
        u, v, total = uv[n, 0] - REACH, uv[n, 1] - REACH, 0
        for i in range(side):
            for j in range(side):
                total += int(image[v + i, u + j])
        shift = MID_GREY - total / (side * side)
        for i in range(side):
            for j in range(side):
                out[n, i * side + j] = np.uint8(min(max(image[v + i, u + j] + shift, 0.0), 255.0))
    return out


def match(
    reference: Features,
    current: Features,
    expected_uv: np.ndarray,
    search_px: float,
    precision_px: float,
) -> Matches:
    """Mutual best matches (sum of absolute differences) within search_px of the expected positions.

    expected_uv (n, 2): positions of the reference's corners in the current image. Positions are
    refined to subpixel accuracy until a step is shorter than precision_px, and those where this
    fails are left out; depth is interpolated there.
    """
    pairs = mutual_best(
        reference.descriptions,
        current.descriptions,
        reference.level,
        current.level,
        expected_uv,
        current.uv,
        search_px,
    )
    found = pairs >= 0
    i, j = np.flatnonzero(found), pairs[found]
    uv, lost = current.uv[j].copy(), np.zeros(len(j), bool)
    for n, (image0, image1) in enumerate(zip(reference.images, current.images, strict=True)):
        at = np.flatnonzero(reference.level[i] == n)
        refine(image0, image1, reference.uv[i[at]] / 2**n, uv, at, float(2**n), precision_px, lost)
    z = depth_at(current.depth_z_m, uv)
    points_m = points(current.camera, uv, z)
    matches = Matches(
        reference.uv[i], reference.points_m[i], uv, points_m, reference.level[i], np.ones(len(i))
    )
    return matches.chosen((z > 0) & ~lost)


@njit(cache=True)
def mutual_best(descriptions0, descriptions1, level0, level1, expected_uv, uv1, search_px):
    """(n0,): index of the match in image 1 of each corner of image 0, -1 without a match. Only
    corners of the same level match; those of
    image 1 are sorted by level, then row."""
    n0, n1 = len(level0), len(level1)
    best0, best1 = np.full(n0, 1 << 30), np.full(n1, 1 << 30)
    of0, of1 = np.full(n0, -1), np.full(n1, -1)
    for i in range(n0):
        first, end = np.searchsorted(level1, level0[i]), np.searchsorted(level1, level0[i] + 1)
        rows = uv1[first:end, 1]
        begin = first + np.searchsorted(rows, expected_uv[i, 1] - search_px)
        for j in range(begin, end):
            du, dv = uv1[j, 0] - expected_uv[i, 0], uv1[j, 1] - expected_uv[i, 1]
            if dv > search_px:
                break
            if du * du + dv * dv > search_px * search_px:
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
def difference(one, other, limit):
    """The sum of absolute differences of two descriptions.

    If it reaches the limit, the result is any number that does.
    """
    score, size, at_once = 0, len(one), 3 * (2 * REACH + 1)
    for begin in range(0, size, at_once):
        part = np.int32(0)  # int() of a byte is unsigned in compiled code
        for k in range(begin, min(begin + at_once, size)):
            part += abs(np.int32(one[k]) - np.int32(other[k]))
        score += int(part)
        if score >= limit:
            break
    return score


@njit(cache=True)
def _window(image, u, v, across, out):
    """out (n, n): the image around (u, v), bilinear, at steps of a pixel; across (n + 1, n) is a
    work array.
    """
    n = len(out)
    j, i = int(u), int(v)
    s, t = u - j, v - i
    j, i = j - n // 2, i - n // 2
    for y in range(n + 1):
        for x in range(n):
            a = float(image[i + y, j + x])
            across[y, x] = a + s * (float(image[i + y, j + x + 1]) - a)
    for y in range(n):
        for x in range(n):
            out[y, x] = across[y, x] + t * (across[y + 1, x] - across[y, x])


@njit(cache=True)
def refine(image0, image1, uv0, uv1, at, scale, precision_px, lost):
    """Refine uv1[at] (pixels of the full image, `scale` times those of image1) so that the patch of
    image1 matches that of image0 around uv0.

    Efficient second-order minimization (Benhimane, Malis 2004) of the squared difference after
    subtracting its mean; at most 6 steps and 1.5 pixels, and only while the difference decreases.
    """
    h, w = image1.shape
    size = 2 * REACH + 1
    seen0, seen1 = np.empty((size + 2, size + 2)), np.empty((size + 2, size + 2))
    across = np.empty((size + 3, size + 2))
    for n in range(len(at)):
        _window(image0, uv0[n, 0], uv0[n, 1], across, seen0)
        start_u, start_v = uv1[at[n], 0] / scale, uv1[at[n], 1] / scale
        u, v, best_u, best_v, best = start_u, start_v, start_u, start_v, np.inf
        for _ in range(7):
            if not (u > REACH + 1 and v > REACH + 1 and u < w - REACH - 3 and v < h - REACH - 3):
                break
            _window(image1, u, v, across, seen1)
            a = b = c = p = q = mean = mean_u = mean_v = squares = 0.0
            for i in range(1, size + 1):
                for j in range(1, size + 1):
                    r = seen0[i, j] - seen1[i, j]
                    # the mean gradient of both images
                    x_slope = (
                        seen0[i, j + 1] - seen0[i, j - 1] + seen1[i, j + 1] - seen1[i, j - 1]
                    ) / 4
                    y_slope = (
                        seen0[i + 1, j] - seen0[i - 1, j] + seen1[i + 1, j] - seen1[i - 1, j]
                    ) / 4
                    a += x_slope * x_slope
                    b += x_slope * y_slope
                    c += y_slope * y_slope
                    p += x_slope * r
                    q += y_slope * r
                    mean += r
                    mean_u += x_slope
                    mean_v += y_slope
                    squares += r * r
            count = size * size
            error = squares - mean * mean / count
            if error >= best:
                break
            best, best_u, best_v = error, u, v
            a -= mean_u * mean_u / count
            b -= mean_u * mean_v / count
            c -= mean_v * mean_v / count
            p -= mean_u * mean / count
            q -= mean_v * mean / count
            det = a * c - b * b
            if det < 1e-9:
                break
            du, dv = (c * p - b * q) / det, (a * q - b * p) / det
            u, v = u + du, v + dv
            if abs(du) < precision_px and abs(dv) < precision_px:
                best_u, best_v = u, v
                break
        if (best_u - start_u) ** 2 + (best_v - start_v) ** 2 <= 2.25:
            uv1[at[n], 0], uv1[at[n], 1] = best_u * scale, best_v * scale
        else:
            lost[at[n]] = True


@njit(cache=True)
def depth_at(depth_z_m, uv):
    """(n,) depth in metres, interpolated; 0 if one of the four pixels has none."""
    out = np.zeros(len(uv))
    for n in range(len(uv)):
        j, i = int(uv[n, 0]), int(uv[n, 1])
        s, t = uv[n, 0] - j, uv[n, 1] - i
        a, b, c, d = (
            depth_z_m[i, j],
            depth_z_m[i, j + 1],
            depth_z_m[i + 1, j],
            depth_z_m[i + 1, j + 1],
        )
        if min(a, b, c, d) > 0:
            out[n] = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d)
    return out


def consistent(points0_m: np.ndarray, points1_m: np.ndarray, max_m: float) -> np.ndarray:
    """(n,) bool: a greedy clique of matches whose pairwise distances in both frames differ by less
    than max_m (section 3.4); those that agree with most others come first.
    """
    agree = agreement(points0_m, points1_m, max_m)
    return clique(agree, np.argsort(-agree.sum(axis=1), kind="mergesort"))


@njit(cache=True)
def agreement(points0_m, points1_m, max_m):
    """(n, n) bool: whether the distance of two matches differs by less than max_m between the
    frames; False for a match with itself.
    """
    n = len(points0_m)
    agree = np.zeros((n, n), np.bool_)
    for i in range(n):
        for j in range(i):
            d0 = d1 = 0.0
            for k in range(3):
                d0 += (points0_m[i, k] - points0_m[j, k]) ** 2
                d1 += (points1_m[i, k] - points1_m[j, k]) ** 2
            agree[i, j] = agree[j, i] = abs(np.sqrt(d0) - np.sqrt(d1)) < max_m
    return agree


@njit(cache=True)
def clique(agree, order):
    """(n,) bool: in this order, the matches that agree with all that were chosen before."""
    n = len(agree)
    chosen, possible = np.zeros(n, np.bool_), np.ones(n, np.bool_)
    for i in order:
        if possible[i]:
            chosen[i] = True
            possible &= agree[i]
    return chosen
