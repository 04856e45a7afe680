"""Corner detection and matching with depth: the front end of FOVIS.

A. Huang et al., "Visual odometry and mapping for autonomous flight using an RGB-D camera", ISRR
2011, sections 3.1 to 3.4. Each pyramid level is a 5x5 Gaussian of the even pixels of the level
before, so (u, v) on level n is (u, v) 2^n in the image.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera

from ..compiled import compiled
from .kernels import halve_depth
from .levels import MIN_SIDE, Level
from .protocol import Frame
from .terms.reprojection import Matches

#: Radius in pixels of the patch that describes a corner (section 3.3: 9 x 9 pixels).
REACH = 4
#: Mean grey value of a description.
MID_GREY = 128.0
#: Minimum eigenvalue of a corner's structure tensor (gradients per pixel of an image in 0..1,
#: squared): two grey levels.
MIN_EIGENVALUE = (2 / 255) ** 2
#: Scale of the structure tensor: half the 7x7 mean of products of Sobel sums, which are up to 4 x
#: 255.
SOBEL_SQUARES = np.float32(1 / (2 * 49 * 1020.0**2))
#: Side in pixels of a bucket, and the maximum number of corners in it; the strongest are used
#: (section 3.1; "bucket-width" and "max-keypoints-per-bucket" of the authors' program).
BUCKET_PX = 80
PER_BUCKET = 25


@dataclass(frozen=True, eq=False)
class Features:
    """Corners of one frame, sorted by level, then row.

    images: grey (h, w) uint8, fine to coarse; uv (n, 2): pixels of the full image; level (n,);
    points_m (n, 3): in the camera's frame; descriptions (n, 81) uint8.
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


def features(frame: Frame, camera: PinholeCamera, levels: int, count: int) -> Features:
    """About `count` corners with depth over all levels, at most PER_BUCKET per bucket: maxima of
    the structure tensor's smaller eigenvalue.
    """
    images: list[np.ndarray] = [cv2.convertScaleAbs(frame.grey)]
    while len(images) < levels and min(images[-1].shape) >= 2 * MIN_SIDE:
        images.append(cv2.pyrDown(images[-1]))
    found = [_inside(eigenvalue_corners(image), image.shape) for image in images]
    threshold = _threshold(np.concatenate([scores for _, scores in found]), count)
    kept = []
    for image, (uv, scores) in zip(images, found, strict=True):
        strong = scores >= threshold
        kept.append(strongest(uv[strong], scores[strong], image.shape[1]))
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
    x = (uv[:, 0] - camera.cx) / camera.fx
    y = (uv[:, 1] - camera.cy) / camera.fy
    return np.stack([x * z_m, y * z_m, z_m], axis=1)


def eigenvalue_corners(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) and scores (n,) of local maxima of the structure tensor's smaller eigenvalue
    (Shi, Tomasi 1994).
    """
    scores = smaller_eigenvalues(image)
    peaks = (scores == cv2.dilate(scores, np.ones((7, 7), np.uint8))) & (scores > MIN_EIGENVALUE)
    v, u = np.divmod(np.flatnonzero(peaks), image.shape[1])
    return np.stack([u, v], axis=1), scores[v, u]


@compiled(fastmath=True)
def smaller_eigenvalues(image: np.ndarray) -> np.ndarray:
    """(h, w) float32: smaller eigenvalue of the structure tensor, the 7x7 mean of products of Sobel
    gradients per pixel of an image in 0..1.

    Same as cv2.cornerMinEigenVal(image, 7) in less than half the time; 0 within 4 pixels of the
    border.
    """
    h, w = image.shape
    out = np.zeros((h, w), np.float32)
    slopes_x = np.zeros((7, w), np.float32)
    slopes_y = np.zeros((7, w), np.float32)
    xx = np.zeros(w, np.float32)
    xy = np.zeros(w, np.float32)
    yy = np.zeros(w, np.float32)
    for v in range(1, h - 1):
        above = image[v - 1]
        row = image[v]
        below = image[v + 1]
        x = slopes_x[v % 7]
        y = slopes_y[v % 7]
        for u in range(w):
            xx[u] -= x[u] * x[u]
            xy[u] -= x[u] * y[u]
            yy[u] -= y[u] * y[u]
        for u in range(1, w - 1):
            a = np.int32(above[u - 1])
            b = np.int32(above[u])
            c = np.int32(above[u + 1])
            d = np.int32(below[u - 1])
            e = np.int32(below[u])
            f = np.int32(below[u + 1])
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
    rank = len(scores) - count
    return float(max(np.partition(scores, rank)[rank], MIN_EIGENVALUE))


def strongest(uv: np.ndarray, scores: np.ndarray, width: int) -> np.ndarray:
    """The PER_BUCKET strongest corners of each bucket; ties are in the order of detection."""
    bucket = uv[:, 1] // BUCKET_PX * -(-width // BUCKET_PX) + uv[:, 0] // BUCKET_PX
    order = np.lexsort((-scores, bucket))
    first = np.searchsorted(bucket[order], bucket[order])
    return uv[np.sort(order[np.arange(len(order)) - first < PER_BUCKET])]


@compiled()
def describe(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(n, 81) uint8: the patch around each of uv (n, 2), shifted to a mean of mid-grey."""
    side = 2 * REACH + 1
    out = np.empty((len(uv), side * side), np.uint8)
    for n in range(len(uv)):
        u = uv[n, 0] - REACH
        v = uv[n, 1] - REACH
        total = 0
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
        (reference.descriptions, reference.level, expected_uv),
        (current.descriptions, current.level, current.uv),
        search_px,
    )
    i = np.flatnonzero(pairs >= 0)
    j = pairs[i]
    uv = current.uv[j].copy()
    lost = np.zeros(len(j), bool)
    for n, images in enumerate(zip(reference.images, current.images, strict=True)):
        at = np.flatnonzero(reference.level[i] == n)
        scale = float(2**n)
        refine(images, reference.uv[i[at]] / scale, uv, at, (scale, precision_px), lost)
    z = depth_at(current.depth_z_m, uv)
    matches = Matches(
        uv0=reference.uv[i],
        points0_m=reference.points_m[i],
        uv1=uv,
        points1_m=points(current.camera, uv, z),
        level=reference.level[i],
        weight=2.0 ** -reference.level[i],
    )
    return matches.chosen((z > 0) & ~lost)


@compiled()
def mutual_best(one: tuple, other: tuple, search_px: float) -> np.ndarray:
    """(n0,): index of the match in image 1 of each corner of image 0, -1 without a match.

    one, other: descriptions, levels, and positions in image 1 of the corners of an image; those of
    image 1 are sorted by level, then row. Only corners of the same level match.
    """
    descriptions0, level0, expected_uv = one
    descriptions1, level1, uv1 = other
    n0 = len(level0)
    n1 = len(level1)
    best0 = np.full(n0, 1 << 30)
    best1 = np.full(n1, 1 << 30)
    of0 = np.full(n0, -1)
    of1 = np.full(n1, -1)
    for i in range(n0):
        first = np.searchsorted(level1, level0[i])
        end = np.searchsorted(level1, level0[i] + 1)
        begin = first + np.searchsorted(uv1[first:end, 1], expected_uv[i, 1] - search_px)
        for j in range(begin, end):
            du = uv1[j, 0] - expected_uv[i, 0]
            dv = uv1[j, 1] - expected_uv[i, 1]
            if dv > search_px:
                break
            if du * du + dv * dv > search_px * search_px:
                continue
            score = difference(descriptions0[i], descriptions1[j], max(best0[i], best1[j]))
            if score < best0[i]:
                best0[i] = score
                of0[i] = j
            if score < best1[j]:
                best1[j] = score
                of1[j] = i
    for i in range(n0):
        if of0[i] >= 0 and of1[of0[i]] != i:
            of0[i] = -1
    return of0


@compiled()
def difference(one: np.ndarray, other: np.ndarray, limit: int) -> int:
    """The sum of absolute differences of two descriptions.

    If it reaches the limit, the result is any number that does.
    """
    score = 0
    size = len(one)
    at_once = 3 * (2 * REACH + 1)
    for begin in range(0, size, at_once):
        part = np.int32(0)  # int() of a byte is unsigned in compiled code
        for k in range(begin, min(begin + at_once, size)):
            part += abs(np.int32(one[k]) - np.int32(other[k]))
        score += int(part)
        if score >= limit:
            break
    return score


@compiled()
def _window(image: np.ndarray, u: float, v: float, across: np.ndarray, out: np.ndarray) -> None:
    """out (n, n): the image around (u, v), bilinear, at steps of a pixel; across (n + 1, n) is a
    work array.
    """
    n = len(out)
    j = int(u)
    i = int(v)
    s = u - j
    t = v - i
    j -= n // 2
    i -= n // 2
    for y in range(n + 1):
        for x in range(n):
            a = float(image[i + y, j + x])
            across[y, x] = a + s * (float(image[i + y, j + x + 1]) - a)
    for y in range(n):
        for x in range(n):
            out[y, x] = across[y, x] + t * (across[y + 1, x] - across[y, x])


@compiled()
def refine(
    images: tuple,
    uv0: np.ndarray,
    uv1: np.ndarray,
    at: np.ndarray,
    rule: tuple[float, float],
    lost: np.ndarray,
) -> None:
    """Refine uv1[at] (pixels of the full image) so that the patch of the second image matches that
    of the first one around uv0, or mark it as lost.

    rule: scale, the size of a pixel of the images in the full one, and the precision in pixels.
    Efficient second-order minimization (Benhimane, Malis 2004) of the squared difference after
    subtracting its mean; at most 6 steps and 1.5 pixels, and only while the difference decreases.
    """
    image0, image1 = images
    scale, precision_px = rule
    h, w = image1.shape
    side = 2 * REACH + 3
    seen0 = np.empty((side, side))
    seen1 = np.empty((side, side))
    across = np.empty((side + 1, side))
    for n in range(len(at)):
        _window(image0, uv0[n, 0], uv0[n, 1], across, seen0)
        start_u = uv1[at[n], 0] / scale
        start_v = uv1[at[n], 1] / scale
        u = best_u = start_u
        v = best_v = start_v
        best = np.inf
        for _ in range(7):
            if not (u > REACH + 1 and v > REACH + 1 and u < w - REACH - 3 and v < h - REACH - 3):
                break
            _window(image1, u, v, across, seen1)
            error, du, dv = _patch_step(seen0, seen1)
            if error >= best:
                break
            best = error
            best_u = u
            best_v = v
            if math.isnan(du):
                break
            u += du
            v += dv
            if abs(du) < precision_px and abs(dv) < precision_px:
                best_u = u
                best_v = v
                break
        if (best_u - start_u) ** 2 + (best_v - start_v) ** 2 <= 2.25:
            uv1[at[n], 0] = best_u * scale
            uv1[at[n], 1] = best_v * scale
        else:
            lost[at[n]] = True


@compiled()
def _patch_step(seen0: np.ndarray, seen1: np.ndarray) -> tuple[float, float, float]:
    """The squared difference of two patches (within a border of a pixel) after subtracting its
    mean, and the shift of the second one that reduces it, NaN without contrast.
    """
    a = b = c = p = q = mean = mean_u = mean_v = squares = 0.0
    size = len(seen0) - 2
    for i in range(1, size + 1):
        for j in range(1, size + 1):
            r = seen0[i, j] - seen1[i, j]
            # the mean gradient of both images
            x = seen0[i, j + 1] - seen0[i, j - 1] + seen1[i, j + 1] - seen1[i, j - 1]
            y = seen0[i + 1, j] - seen0[i - 1, j] + seen1[i + 1, j] - seen1[i - 1, j]
            x_slope = x / 4
            y_slope = y / 4
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
    a -= mean_u * mean_u / count
    b -= mean_u * mean_v / count
    c -= mean_v * mean_v / count
    p -= mean_u * mean / count
    q -= mean_v * mean / count
    det = a * c - b * b
    if det < 1e-9:
        return error, np.nan, np.nan
    return error, (c * p - b * q) / det, (a * q - b * p) / det


@compiled()
def depth_at(depth_z_m: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(n,) depth in metres, interpolated; 0 if one of the four pixels has none."""
    out = np.zeros(len(uv))
    for n in range(len(uv)):
        j = int(uv[n, 0])
        i = int(uv[n, 1])
        s = uv[n, 0] - j
        t = uv[n, 1] - i
        a = depth_z_m[i, j]
        b = depth_z_m[i, j + 1]
        c = depth_z_m[i + 1, j]
        d = depth_z_m[i + 1, j + 1]
        if min(a, b, c, d) > 0:
            out[n] = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d)
    return out


def consistent(points0_m: np.ndarray, points1_m: np.ndarray, max_m: float) -> np.ndarray:
    """(n,) bool: a greedy clique of matches whose pairwise distances in both frames differ by less
    than max_m (section 3.4); those that agree with most others come first.
    """
    agree = agreement(points0_m, points1_m, max_m)
    return clique(agree, np.argsort(-agree.sum(axis=1), kind="mergesort"))


@compiled()
def agreement(points0_m: np.ndarray, points1_m: np.ndarray, max_m: float) -> np.ndarray:
    """(n, n) bool: whether the distance of two matches differs by less than max_m between the
    frames; False for a match with itself.
    """
    n = len(points0_m)
    agree = np.zeros((n, n), np.bool_)
    for i in range(n):
        for j in range(i):
            d0 = 0.0
            d1 = 0.0
            for k in range(3):
                d0 += (points0_m[i, k] - points0_m[j, k]) ** 2
                d1 += (points1_m[i, k] - points1_m[j, k]) ** 2
            agree[i, j] = agree[j, i] = abs(np.sqrt(d0) - np.sqrt(d1)) < max_m
    return agree


@compiled()
def clique(agree: np.ndarray, order: np.ndarray) -> np.ndarray:
    """(n,) bool: in this order, the matches that agree with all that were chosen before."""
    n = len(agree)
    chosen = np.zeros(n, np.bool_)
    possible = np.ones(n, np.bool_)
    for i in order:
        if possible[i]:
            chosen[i] = True
            possible &= agree[i]
    return chosen
