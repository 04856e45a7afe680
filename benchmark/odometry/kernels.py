"""The compiled loops over pixels.

They use one thread: a pass takes half a millisecond, and the barriers of a thread pool on a busy
machine take many times as long. The results therefore do not depend on a number of threads.

The pixels to use are collected in lists once per frame; an iteration only loops over the lists.
Residuals are computed before the normal equations, so that a scale can be estimated in between.
Twists are (translation, rotation), applied from the left in the reference camera's frame: T_ref_cur
<- exp(x) T_ref_cur. k are the intrinsics (fx, fy, cx, cy).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled import compiled

#: A point nearer than this to the image plane is not projected (metres).
NEAREST_M = 0.05
#: Two depths of one surface differ by less than this share from a pixel to the next.
SAME_SURFACE = 0.05
Pair = tuple[Any, Any]


class GradientPoints(NamedTuple):
    """Pixels with a gradient: points (n, 3), grey values (n,), Jacobian (n, 6) of the inverse
    compositional residual, index (n,) among the tiles of the image.
    """

    points: np.ndarray
    greys: np.ndarray
    J: np.ndarray
    tiles: np.ndarray


class SurfacePoints(NamedTuple):
    """Pixels with a normal: points (n, 3), normals (n, 3), index (n,) among the blocks of the
    image.
    """

    points: np.ndarray
    normals: np.ndarray
    blocks: np.ndarray


@compiled()
def _put_row(J: np.ndarray, p: tuple, n: tuple) -> None:
    """J (6,): derivative by a twist from the left of what changes by n with the point p."""
    x, y, z = p
    nx, ny, nz = n
    J[0] = nx
    J[1] = ny
    J[2] = nz
    J[3] = y * nz - z * ny
    J[4] = z * nx - x * nz
    J[5] = x * ny - y * nx


@compiled()
def halve_grey(grey: np.ndarray) -> np.ndarray:
    """2x2 mean."""
    out = np.empty((grey.shape[0] // 2, grey.shape[1] // 2), np.float32)
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            above = grey[2 * v, 2 * u] + grey[2 * v, 2 * u + 1]
            below = grey[2 * v + 1, 2 * u] + grey[2 * v + 1, 2 * u + 1]
            out[v, u] = (above + below) * np.float32(0.25)
    return out


@compiled()
def halve_depth(z: np.ndarray) -> np.ndarray:
    """2x2 mean of inverse depth (exact on planes) if the four are of one surface, else the nearest
    depth; 0 = missing.

    If some are missing, the mean of a diagonal, which has the same centre.
    """
    out = np.zeros((z.shape[0] // 2, z.shape[1] // 2), np.float32)
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            a = z[2 * v, 2 * u]
            b = z[2 * v, 2 * u + 1]
            c = z[2 * v + 1, 2 * u]
            d = z[2 * v + 1, 2 * u + 1]
            if a > 0 and b > 0 and c > 0 and d > 0:
                near = min(a, b, c, d)
                if max(a, b, c, d) - near < SAME_SURFACE * near:
                    out[v, u] = 4.0 / (1.0 / a + 1.0 / b + 1.0 / c + 1.0 / d)
                else:
                    out[v, u] = near
                continue
            if not (a > 0 and d > 0):
                a = b
                d = c
            if a > 0 and d > 0 and abs(a - d) < SAME_SURFACE * min(a, d):
                out[v, u] = 2.0 / (1.0 / a + 1.0 / d)
    return out


@compiled()
def halve_depth_median(z: np.ndarray) -> np.ndarray:
    """Median of the 3x3 neighbourhood of every second pixel, of the pixels with depth; 0 if fewer
    than half have depth.
    """
    h, w = z.shape
    out = np.zeros((h // 2, w // 2), np.float32)
    seen = np.empty(9, np.float32)
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            n = 0
            for i in range(2 * v - 1, 2 * v + 2):
                for j in range(2 * u - 1, 2 * u + 2):
                    d = z[min(max(i, 0), h - 1), min(max(j, 0), w - 1)]
                    if not d > 0:
                        continue
                    k = n
                    n += 1
                    while k > 0 and seen[k - 1] > d:
                        seen[k] = seen[k - 1]
                        k -= 1
                    seen[k] = d
            if n > 4:
                out[v, u] = (seen[(n - 1) // 2] + seen[n // 2]) / 2
    return out


@compiled()
def _facing(k: tuple, pixel: Pair, left: Pair, right: Pair, above: Pair, below: Pair) -> tuple:
    """Unit normal at a pixel (v, u) of the surface through its neighbours, each a column or row and
    its depth; 0 if undefined.
    """
    fx, fy, cx, cy = k
    v, u = pixel
    left_u, left_z = left
    right_u, right_z = right
    above_v, above_z = above
    below_v, below_z = below
    x1 = ((right_u - cx) * right_z - (left_u - cx) * left_z) / fx
    y1 = (v - cy) * (right_z - left_z) / fy
    z1 = right_z - left_z
    x2 = (u - cx) * (below_z - above_z) / fx
    y2 = ((below_v - cy) * below_z - (above_v - cy) * above_z) / fy
    z2 = below_z - above_z
    x = y2 * z1 - z2 * y1
    y = z2 * x1 - x2 * z1
    z = x2 * y1 - y2 * x1
    length = math.sqrt(x * x + y * y + z * z)
    if length > 0:
        return x / length, y / length, z / length
    return 0.0, 0.0, 0.0


@compiled()
def _largest_step(d: float, left_z: float, right_z: float, above_z: float, below_z: float) -> float:
    """The largest step of depth from a pixel to its neighbours."""
    return max(abs(left_z - d), abs(right_z - d), abs(above_z - d), abs(below_z - d))


@compiled()
def normals(z: np.ndarray, k: np.ndarray, s: int) -> np.ndarray:
    """Unit normals (h, w, 3) by differences over +-s pixels, one-sided where a neighbour is
    missing; 0 at depth edges.
    """
    h, w = z.shape
    camera = (k[0], k[1], k[2], k[3])
    out = np.zeros((h, w, 3), np.float32)
    for v in range(s, h - s):
        for u in range(s, w - s):
            d = z[v, u]
            if not d > 0:
                continue
            left = (u - s, z[v, u - s])
            right = (u + s, z[v, u + s])
            above = (v - s, z[v - s, u])
            below = (v + s, z[v + s, u])
            if not (left[1] > 0 and right[1] > 0 and above[1] > 0 and below[1] > 0):
                if (left[1] <= 0 and right[1] <= 0) or (above[1] <= 0 and below[1] <= 0):
                    continue
                if left[1] <= 0:
                    left = (u, d)
                if right[1] <= 0:
                    right = (u, d)
                if above[1] <= 0:
                    above = (v, d)
                if below[1] <= 0:
                    below = (v, d)
            step = _largest_step(d, left[1], right[1], above[1], below[1])
            if step <= (0.02 + 0.02 * s) * d:
                x, y, towards = _facing(camera, (v, u), left, right, above, below)
                out[v, u, 0] = x
                out[v, u, 1] = y
                out[v, u, 2] = towards
    return out


@compiled()
def gradient_points(k: np.ndarray, image: Pair, rule: tuple) -> GradientPoints:
    """The pixels of an image (grey, depth) with a gradient (central differences) and depth.

    rule: minimum gradient, maximum depth, the tiles across and down the image, and whether only
    every second pixel is used, in a chessboard pattern. Depth edges are included: without them a
    plain room has too few pixels (ATE 2 to 15 times as large).
    """
    grey, z = image
    min_gradient, max_depth, across, down, sparse = rule
    h, w = z.shape
    fx, fy, cx, cy = k
    points = np.empty((h * w, 3), np.float32)
    greys = np.empty(h * w, np.float32)
    J = np.empty((h * w, 6), np.float32)
    tiles = np.empty(h * w, np.int16)
    least = min_gradient * min_gradient
    n = 0
    for v in range(1, h - 1):
        for u in range(1 + (v & 1) * sparse, w - 1, 1 + sparse):
            a = (grey[v, u + 1] - grey[v, u - 1]) / 2
            b = (grey[v + 1, u] - grey[v - 1, u]) / 2
            d = z[v, u]
            if a * a + b * b < least or not d > 0 or d > max_depth:
                continue
            x = (u - cx) / fx * d
            y = (v - cy) / fy * d
            p = a * fx / d
            q = b * fy / d
            o = -(p * x + q * y) / d
            points[n, 0] = x
            points[n, 1] = y
            points[n, 2] = d
            _put_row(J[n], (x, y, d), (p, q, o))
            greys[n] = grey[v, u]
            tiles[n] = (v * down // h) * across + u * across // w
            n += 1
    return GradientPoints(points[:n], greys[:n], J[:n], tiles[:n])


@compiled()
def _moved(T: np.ndarray, x: float, y: float, z: float) -> tuple:
    """T p for a point."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


@compiled()
def _rotated(T: np.ndarray, x: float, y: float, z: float) -> tuple:
    """R n for a direction."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z,
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z,
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z,
    )


@compiled()
def _rotated_back(T: np.ndarray, x: float, y: float, z: float) -> tuple:
    """R^T n for a direction."""
    return (
        T[0, 0] * x + T[1, 0] * y + T[2, 0] * z,
        T[0, 1] * x + T[1, 1] * y + T[2, 1] * z,
        T[0, 2] * x + T[1, 2] * y + T[2, 2] * z,
    )


@compiled()
def _bilinear(grey: np.ndarray, u: float, v: float) -> float:
    j = int(u)
    i = int(v)
    s = u - j
    t = v - i
    top = grey[i, j] + s * (grey[i, j + 1] - grey[i, j])
    bottom = grey[i + 1, j] + s * (grey[i + 1, j + 1] - grey[i + 1, j])
    return top + t * (bottom - top)


@compiled()
def grey_residuals(
    T: np.ndarray, k: np.ndarray, seen: GradientPoints, image: tuple, factor: np.ndarray, out: tuple
) -> None:
    """residual = grey(warped) - greys, bilinear; NaN outside the image, without depth, or if
    occluded.

    T (4, 4) is T_current_reference; image: the current one's grey and depth, and the maximum
    difference from warped to measured depth. With `factor`, the inverse depth of a tile is
    multiplied by its factor. out: residual (n,); the mean Jacobian of both images (n, 6), or empty;
    with `factor` the derivative of the residual by it, parallax (n,).
    """
    grey, z, max_dz = image
    residual, mean, parallax = out
    h, w = grey.shape
    fx, fy, cx, cy = k
    # towards the current camera's centre
    gx, gy, gz = _rotated_back(T, -T[0, 3], -T[1, 3], -T[2, 3])
    for n in range(len(seen.points)):
        x = seen.points[n, 0]
        y = seen.points[n, 1]
        d = seen.points[n, 2]
        residual[n] = np.nan
        f = factor[seen.tiles[n]] if len(factor) else 1.0
        found_z = T[2, 0] * x + T[2, 1] * y + T[2, 2] * d + T[2, 3]
        qz = found_z + (f - 1.0) * T[2, 3]
        if qz < NEAREST_M:
            continue
        a = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * d + f * T[0, 3]) / qz + cx
        b = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * d + f * T[1, 3]) / qz + cy
        if not (a >= 1 and b >= 1 and a < w - 2 and b < h - 2):
            continue
        row = int(b + 0.5)
        column = int(a + 0.5)
        found = z[row, column]
        if not found > 0 or abs(found - found_z) > max_dz:
            continue
        residual[n] = _bilinear(grey, a, b) - seen.greys[n]
        mx = seen.J[n, 0]
        my = seen.J[n, 1]
        mz = seen.J[n, 2]
        if len(mean):
            p = fx / qz * (grey[row, column + 1] - grey[row, column - 1]) / 2
            q = fy / qz * (grey[row + 1, column] - grey[row - 1, column]) / 2
            o = -(p * (a - cx) / fx + q * (b - cy) / fy)
            px, py, pz = _rotated_back(T, p, q, o)
            mx = (px + mx) / 2
            my = (py + my) / 2
            mz = (pz + mz) / 2
            _put_row(mean[n], (x, y, d), (mx, my, mz))
        if len(factor):
            parallax[n] = mx * gx + my * gy + mz * gz


@compiled()
def surface_points(
    k: np.ndarray, z: np.ndarray, normals: np.ndarray, stride: int, grid: Pair
) -> tuple[int, SurfacePoints]:
    """The number of pixels in every stride-th row and column, and those with a normal; grid: the
    blocks across and down the image.
    """
    h, w = z.shape
    across, down = grid
    fx, fy, cx, cy = k
    size = -(-h // stride) * -(-w // stride)
    points = np.empty((size, 3), np.float32)
    directions = np.empty((size, 3), np.float32)
    blocks = np.empty(size, np.int16)
    n = 0
    for v in range(0, h, stride):
        for u in range(0, w, stride):
            if normals[v, u, 2] == 0:
                continue
            d = z[v, u]
            points[n, 0] = (u - cx) / fx * d
            points[n, 1] = (v - cy) / fy * d
            points[n, 2] = d
            directions[n] = normals[v, u]
            blocks[n] = (v * down // h) * across + u * across // w
            n += 1
    return size, SurfacePoints(points[:n], directions[:n], blocks[:n])


@compiled()
def _pixel(q: tuple, k: tuple, shape: tuple, border: int) -> Pair:
    """The row and column that a point is projected to; -1 outside the image or in its border."""
    fx, fy, cx, cy = k
    h, w = shape
    if q[2] < NEAREST_M:
        return -1, -1
    a = fx * q[0] / q[2] + cx + 0.5
    b = fy * q[1] / q[2] + cy + 0.5
    if a >= border and b >= border and a < w - border and b < h - border:
        return int(b), int(a)
    return -1, -1


@compiled()
def _way(q: tuple, k: tuple, pixel: Pair, depth: Any) -> tuple:
    """From a point to that of a pixel with a depth."""
    fx, fy, cx, cy = k
    i, j = pixel
    return (j - cx) / fx * depth - q[0], (i - cy) / fy * depth - q[1], depth - q[2]


@compiled()
def _dot(a: tuple, b: tuple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled()
def plane_residuals(
    T: np.ndarray, k: np.ndarray, seen: SurfacePoints, surface: Pair, gate: Pair, out: tuple
) -> None:
    """residual = n . (p0 - T p1) in metres, NaN without a match; T is T_reference_current.

    surface: depth and normals of the reference; gate: maximum distance, minimum cosine between the
    normals. out: residual (n,) and Jacobian (n, 6) along the reference's normal, and along the
    current one's.
    """
    z, normals = surface
    max_distance, min_cosine = gate
    residual, J, residual1, J1 = out
    camera = (k[0], k[1], k[2], k[3])
    points = seen.points
    directions = seen.normals
    for n in range(len(points)):
        residual[n] = np.nan
        q = _moved(T, points[n, 0], points[n, 1], points[n, 2])
        i, j = _pixel(q, camera, z.shape, 0)
        if i < 0 or normals[i, j, 2] == 0:
            continue
        way = _way(q, camera, (i, j), z[i, j])
        if _dot(way, way) > max_distance * max_distance:
            continue
        one = (normals[i, j, 0], normals[i, j, 1], normals[i, j, 2])
        other = _rotated(T, directions[n, 0], directions[n, 1], directions[n, 2])
        if _dot(one, other) < min_cosine:
            continue
        residual[n] = _dot(one, way)
        residual1[n] = _dot(other, way)
        _put_row(J[n], q, one)
        _put_row(J1[n], q, other)


@compiled()
def _add_point(o: np.ndarray, r: float, weight: float, p: tuple) -> None:
    """Add one pixel to elements 27 to 33 of the sums o (34,) that block_sums() describes."""
    x, y, z = p
    o[27] += weight * r * r
    o[28] += weight
    o[29] += 1
    o[30] += weight * x
    o[31] += weight * y
    o[32] += weight * z
    o[33] += weight * (x * x + y * y + z * z)


@compiled()
def _add_pair(
    o: np.ndarray, J: np.ndarray, J1: np.ndarray, residuals: Pair, weight: float, p: tuple
) -> None:
    """Add one pixel to the sums o (34,) that block_sums() describes."""
    r, q = residuals
    half = 0.5 * weight
    n = 0
    for a in range(6):
        for b in range(a, 6):
            o[n] += half * (J[a] * J1[b] + J1[a] * J[b])
            n += 1
        o[21 + a] += half * (J[a] * q + J1[a] * r)
    _add_point(o, r, weight, p)


@compiled()
def _weight(r: float, student: Pair) -> float:
    """Student-t weight (Kerl 2013, eq. 12) of a residual; student: scale, degrees of freedom nu;
    nu <= 0: plain least squares.
    """
    sigma, nu = student
    if nu <= 0:
        return 1.0
    return (nu + 1) / (nu + (r / sigma) ** 2)


@compiled()
def block_sums(
    points: np.ndarray, rows: tuple, student: Pair, blocks: np.ndarray, out: np.ndarray
) -> None:
    """out (blocks, 34), sums per block: 21 of the upper triangle of J^T W J1, 6 of J^T W r1, both
    symmetrized, w r^2, w, count, w p, w |p|^2.

    rows: residual, J, residual1, J1; student: as in _weight(). J1 = J gives the usual squares. With
    J1 of the other image they are products of independent noise; squares of noise would bias the
    motion to zero and add false information.
    """
    residual, J, residual1, J1 = rows
    out[:] = 0
    for i in range(len(residual)):
        r = residual[i]
        if not math.isfinite(r):
            continue
        p = (points[i, 0], points[i, 1], points[i, 2])
        weight = _weight(r, student)
        _add_pair(out[blocks[i]], J[i], J1[i], (r, residual1[i]), weight, p)


@compiled()
def sums(points: np.ndarray, residual: np.ndarray, J: np.ndarray, student: Pair) -> np.ndarray:
    """(34,): block_sums() of the squares of all pixels as one block."""
    out = np.empty((1, 34))
    blocks = np.zeros(len(residual), np.int16)
    block_sums(points, (residual, J, residual, J), student, blocks, out)
    return out[0]


@compiled()
def tile_sums(seen: GradientPoints, rows: tuple, student: Pair, out: np.ndarray) -> None:
    """out (tiles, 42): sums() per tile, then J^T w g (6), g^T w g and g^T w r of its parallax g.

    rows: residual, J, parallax.
    """
    residual, J, parallax = rows
    out[:] = 0
    for i in range(len(residual)):
        r = residual[i]
        if not math.isfinite(r):
            continue
        weight = _weight(r, student)
        o = out[seen.tiles[i]]
        g = parallax[i]
        n = 0
        for a in range(6):
            slope = weight * J[i, a]
            for b in range(a, 6):
                o[n] += slope * J[i, b]
                n += 1
            o[21 + a] += slope * r
            o[34 + a] += slope * g
        _add_point(o, r, weight, (seen.points[i, 0], seen.points[i, 1], seen.points[i, 2]))
        o[40] += weight * g * g
        o[41] += weight * g * r


@compiled()
def _normal(z: np.ndarray, v: int, u: int, k: tuple) -> tuple:
    """Unit normal by differences over a pixel to each side; its z is 0 at depth edges and where
    depth is missing.
    """
    d = z[v, u]
    left = z[v, u - 1]
    right = z[v, u + 1]
    above = z[v - 1, u]
    below = z[v + 1, u]
    if not (d > 0 and left > 0 and right > 0 and above > 0 and below > 0):
        return 0.0, 0.0, 0.0
    if _largest_step(d, left, right, above, below) > 0.04 * d:
        return 0.0, 0.0, 0.0
    return _facing(k, (v, u), (u - 1, left), (u + 1, right), (v - 1, above), (v + 1, below))


@compiled()
def depth_points(k: np.ndarray, z: np.ndarray, stride: int) -> SurfacePoints:
    """The pixels with a normal in every stride-th row and column, in one block."""
    fx, fy, cx, cy = k
    camera = (fx, fy, cx, cy)
    size = -(-z.shape[0] // stride) * -(-z.shape[1] // stride)
    points = np.empty((size, 3), np.float32)
    directions = np.empty((size, 3), np.float32)
    n = 0
    for v in range(1, z.shape[0] - 1, stride):
        for u in range(1, z.shape[1] - 1, stride):
            normal = _normal(z, v, u, camera)
            if normal[2] == 0:
                continue
            d = z[v, u]
            points[n, 0] = (u - cx) / fx * d
            points[n, 1] = (v - cy) / fy * d
            points[n, 2] = d
            directions[n, 0] = normal[0]
            directions[n, 1] = normal[1]
            directions[n, 2] = normal[2]
            n += 1
    return SurfacePoints(points[:n], directions[:n], np.zeros(n, np.int16))


@compiled()
def depth_sums(
    T: np.ndarray, k: np.ndarray, seen: SurfacePoints, z: np.ndarray, rule: tuple, out: Pair
) -> np.ndarray:
    """sums() of point-to-plane products, for a depth z (h, w) of the reference whose normals are
    computed only where needed.

    rule: gate of plane_residuals(), scale and degrees of freedom of _weight(). out: residual (n,)
    as of plane_residuals(), and cosine (n,) between the normals.
    """
    max_distance, min_cosine, sigma, nu = rule
    residual, cosine = out
    camera = (k[0], k[1], k[2], k[3])
    points = seen.points
    directions = seen.normals
    result = np.zeros(34)
    J = np.empty(6)
    J1 = np.empty(6)
    for n in range(len(points)):
        residual[n] = np.nan
        q = _moved(T, points[n, 0], points[n, 1], points[n, 2])
        i, j = _pixel(q, camera, z.shape, 1)
        if i < 0:
            continue
        way = _way(q, camera, (i, j), z[i, j])
        if _dot(way, way) > max_distance * max_distance:
            continue
        one = _normal(z, i, j, camera)
        other = _rotated(T, directions[n, 0], directions[n, 1], directions[n, 2])
        cosine[n] = _dot(one, other)
        if one[2] == 0 or cosine[n] < min_cosine:
            continue
        r = _dot(one, way)
        residual[n] = r
        _put_row(J, q, one)
        _put_row(J1, q, other)
        weight = (nu + 1) / (nu + (r / sigma) ** 2)
        _add_pair(result, J, J1, (r, _dot(other, way)), weight, q)
    return result


@compiled()
def student_scale(residual: np.ndarray, nu: float, start: float, rounds: int) -> float:
    """Scale of Student's t by fixed-point iteration (Kerl 2013, eq. 13), on some 5000 of the
    residuals.
    """
    step = max(1, len(residual) // 5000) | 1
    sigma = start
    for _ in range(rounds):
        total = 0.0
        n = 0
        for i in range(0, len(residual), step):
            r = residual[i]
            if math.isfinite(r):
                total += r * r * (nu + 1) / (nu + (r / sigma) ** 2)
                n += 1
        if n == 0 or total <= 0:
            return start
        before = sigma
        sigma = math.sqrt(total / n)
        if abs(sigma - before) < 1e-3 * sigma:
            break
    return sigma


@compiled()
def take_brightness(residual: np.ndarray, greys: np.ndarray, student: Pair) -> Pair:
    """(scale, gain): subtracts a gain (minus 1) and an offset of `greys` from the residual (n,).

    They are estimated with Student-t weights on some 5000 residuals, like the scale
    (student_scale), in at most five rounds.
    """
    sigma, nu = student
    step = max(1, len(residual) // 5000) | 1
    gain = 0.0
    offset = 0.0
    for _ in range(5):
        s = 0.0
        x = 0.0
        y = 0.0
        xx = 0.0
        xy = 0.0
        total = 0.0
        n = 0
        for i in range(0, len(residual), step):
            r = residual[i]
            if not math.isfinite(r):
                continue
            grey = greys[i] - 128.0
            off = r - offset - gain * grey
            weight = (nu + 1) / (nu + (off / sigma) ** 2)
            n += 1
            s += weight
            x += weight * grey
            y += weight * r
            xx += weight * grey * grey
            xy += weight * grey * r
            total += weight * off * off
        if n == 0 or s <= 0:
            break
        # regularized: a standard deviation of one grey level does not determine a gain
        gain = (xy - x * y / s) / (xx - x * x / s + s)
        offset = (y - gain * x) / s
        before = sigma
        sigma = max(math.sqrt(total / n), 1e-3)
        if abs(sigma - before) < 1e-2 * sigma:
            break
    for i in range(len(residual)):
        residual[i] -= offset + gain * (greys[i] - 128.0)
    return sigma, gain
