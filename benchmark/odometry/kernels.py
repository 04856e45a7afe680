"""The compiled loops over pixels.

They use one thread: a pass takes half a millisecond, and the barriers of a thread pool on a busy
machine take many times as long. The results therefore do not depend on a number of threads.

The pixels to use are collected in lists once per frame; an iteration only loops over the lists.
Residuals are computed before the normal equations, so that a scale can be estimated in between.
Twists are (translation, rotation), applied from the left in the reference camera's frame: T_ref_cur
<- exp(x) T_ref_cur.
"""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def halve_grey(grey):
    """2x2 mean."""
    out = np.empty((grey.shape[0] // 2, grey.shape[1] // 2), np.float32)
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            above = grey[2 * v, 2 * u] + grey[2 * v, 2 * u + 1]
            below = grey[2 * v + 1, 2 * u] + grey[2 * v + 1, 2 * u + 1]
            out[v, u] = (above + below) * np.float32(0.25)
    return out


@njit(cache=True)
def halve_depth(z):
    """2x2 mean of inverse depth (exact on planes) if the four differ by less than 5 %, else the
    nearest depth; 0 = missing.

    If some are missing, the mean of a diagonal, which has the same centre.
    """
    out = np.zeros((z.shape[0] // 2, z.shape[1] // 2), np.float32)
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            a, b, c, d = (
                z[2 * v, 2 * u],
                z[2 * v, 2 * u + 1],
                z[2 * v + 1, 2 * u],
                z[2 * v + 1, 2 * u + 1],
            )
            if a > 0 and b > 0 and c > 0 and d > 0:
                near, far = min(a, b, c, d), max(a, b, c, d)
                out[v, u] = (
                    4.0 / (1.0 / a + 1.0 / b + 1.0 / c + 1.0 / d)
                    if far - near < 0.05 * near
                    else near
                )
                continue
            if not (a > 0 and d > 0):
                a, d = b, c
            if a > 0 and d > 0 and abs(a - d) < 0.05 * min(a, d):
                out[v, u] = 2.0 / (1.0 / a + 1.0 / d)
    return out


@njit(cache=True)
def halve_depth_median(z):
    """Median of the 3x3 neighbourhood of every second pixel, of the pixels with depth; 0 if fewer
    than half have depth.
    """
    h, w = z.shape
    out, seen = np.zeros((h // 2, w // 2), np.float32), np.empty(9, np.float32)
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            n = 0
            for i in range(2 * v - 1, 2 * v + 2):
                for j in range(2 * u - 1, 2 * u + 2):
                    d = z[min(max(i, 0), h - 1), min(max(j, 0), w - 1)]
                    if not d > 0:
                        continue
                    k, n = n, n + 1
                    while k > 0 and seen[k - 1] > d:
                        seen[k] = seen[k - 1]
                        k -= 1
                    seen[k] = d
            if n > 4:
                out[v, u] = seen[n // 2] if n % 2 else (seen[n // 2 - 1] + seen[n // 2]) / 2
    return out


@njit(cache=True)
def _facing(k, v, u, left, right, above, below, e, r, a, b):
    """Unit normal at (v, u) of the surface through depths e, r (in columns left, right) and a, b
    (in rows above, below); 0 if undefined.
    """
    fx, fy, cx, cy = k
    x1, y1, z1 = ((right - cx) * r - (left - cx) * e) / fx, (v - cy) * (r - e) / fy, r - e
    x2, y2, z2 = (u - cx) * (b - a) / fx, ((below - cy) * b - (above - cy) * a) / fy, b - a
    x, y, z = y2 * z1 - z2 * y1, z2 * x1 - x2 * z1, x2 * y1 - y2 * x1
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 0 else (0.0, 0.0, 0.0)


@njit(cache=True)
def normals(z, k, s):
    """Unit normals (h, w, 3) by differences over +-s pixels, one-sided where a neighbour is
    missing; 0 at depth edges.
    """
    h, w = z.shape
    out = np.zeros((h, w, 3), np.float32)
    for v in range(s, h - s):
        for u in range(s, w - s):
            d = z[v, u]
            if not d > 0:
                continue
            e, r, a, b = z[v, u - s], z[v, u + s], z[v - s, u], z[v + s, u]
            left, right, above, below = u - s, u + s, v - s, v + s
            if not (e > 0 and r > 0 and a > 0 and b > 0):
                if (e <= 0 and r <= 0) or (a <= 0 and b <= 0):
                    continue
                left, e = (left, e) if e > 0 else (u, d)
                right, r = (right, r) if r > 0 else (u, d)
                above, a = (above, a) if a > 0 else (v, d)
                below, b = (below, b) if b > 0 else (v, d)
            limit = (0.02 + 0.02 * s) * d
            if max(abs(e - d), abs(r - d), abs(a - d), abs(b - d)) > limit:
                continue
            out[v, u, 0], out[v, u, 1], out[v, u, 2] = _facing(
                k, v, u, left, right, above, below, e, r, a, b
            )
    return out


@njit(cache=True)
def gradient_points(k, grey, z, min_gradient, max_depth, across, down, sparse):
    """Lists of the pixels with a gradient (central differences) and depth: point (n, 3), grey
    value, Jacobian (n, 6) of the inverse
    compositional residual, and the index among across x down tiles, row by row.

    Depth edges are included: without them a plain room has too few pixels (ATE 2 to 15 times as
    large).
    """
    h, w = z.shape
    fx, fy, cx, cy = k
    points, greys = np.empty((h * w, 3), np.float32), np.empty(h * w, np.float32)
    J, tiles = np.empty((h * w, 6), np.float32), np.empty(h * w, np.int16)
    n, least = 0, min_gradient * min_gradient
    for v in range(1, h - 1):
        for u in range(1 + (v & 1) * sparse, w - 1, 1 + sparse):
            a, b = (grey[v, u + 1] - grey[v, u - 1]) / 2, (grey[v + 1, u] - grey[v - 1, u]) / 2
            d = z[v, u]
            if a * a + b * b < least or not d > 0 or d > max_depth:
                continue
            x, y = (u - cx) / fx * d, (v - cy) / fy * d
            p, q = a * fx / d, b * fy / d
            o = -(p * x + q * y) / d
            points[n, 0], points[n, 1], points[n, 2], greys[n] = x, y, d, grey[v, u]
            tiles[n] = (v * down // h) * across + u * across // w
            J[n, 0], J[n, 1], J[n, 2] = p, q, o
            J[n, 3], J[n, 4], J[n, 5] = y * o - d * q, d * p - x * o, x * q - y * p
            n += 1
    return points[:n], greys[:n], J[:n], tiles[:n]


@njit(cache=True)
def grey_residuals(
    T, k, points, greys, grey, z, max_dz, residual, J, mean, tiles, factor, parallax
):
    """residual = grey(warped) - greys, bilinear; NaN outside the image, without depth, or if
    occluded.

    T (4, 4) is T_current_reference; grey and z are the current image's. With `factor`, the inverse
    depth of a tile is multiplied by its factor, and parallax (n,) is the derivative of the residual
    by it. With `mean`, the mean Jacobian of both images is written there.
    """
    h, w = grey.shape
    fx, fy, cx, cy = k
    ox, oy, oz = -T[0, 3], -T[1, 3], -T[2, 3]
    for n in range(len(points)):
        x, y, d = points[n, 0], points[n, 1], points[n, 2]
        residual[n] = np.nan
        f = factor[tiles[n]] if len(factor) else 1.0
        found_z = T[2, 0] * x + T[2, 1] * y + T[2, 2] * d + T[2, 3]
        qz = found_z + (f - 1.0) * T[2, 3]
        if qz < 0.05:
            continue
        a = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * d + f * T[0, 3]) / qz + cx
        b = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * d + f * T[1, 3]) / qz + cy
        if not (a >= 1 and b >= 1 and a < w - 2 and b < h - 2):
            continue
        row, column = int(b + 0.5), int(a + 0.5)
        found = z[row, column]
        if not found > 0 or abs(found - found_z) > max_dz:
            continue
        i, j = int(b), int(a)
        s, t = a - j, b - i
        top = grey[i, j] + s * (grey[i, j + 1] - grey[i, j])
        bottom = grey[i + 1, j] + s * (grey[i + 1, j + 1] - grey[i + 1, j])
        residual[n] = top + t * (bottom - top) - greys[n]
        mx, my, mz = J[n, 0], J[n, 1], J[n, 2]
        if len(mean):
            p = fx / qz * (grey[row, column + 1] - grey[row, column - 1]) / 2
            q = fy / qz * (grey[row + 1, column] - grey[row - 1, column]) / 2
            o = -(p * (a - cx) / fx + q * (b - cy) / fy)
            mx = (T[0, 0] * p + T[1, 0] * q + T[2, 0] * o + mx) / 2
            my = (T[0, 1] * p + T[1, 1] * q + T[2, 1] * o + my) / 2
            mz = (T[0, 2] * p + T[1, 2] * q + T[2, 2] * o + mz) / 2
            mean[n, 0], mean[n, 1], mean[n, 2] = mx, my, mz
            mean[n, 3], mean[n, 4], mean[n, 5] = y * mz - d * my, d * mx - x * mz, x * my - y * mx
        if len(factor):
            # towards the current camera's centre
            gx = T[0, 0] * ox + T[1, 0] * oy + T[2, 0] * oz
            gy = T[0, 1] * ox + T[1, 1] * oy + T[2, 1] * oz
            gz = T[0, 2] * ox + T[1, 2] * oy + T[2, 2] * oz
            parallax[n] = mx * gx + my * gy + mz * gz


@njit(cache=True)
def flat_points(k, z, normals, stride, across, down):
    """The number of pixels in every stride-th row and column, and lists of those with a normal:
    point (n, 3), normal (n, 3) and
    the index among across x down blocks of the image, row by row.
    """
    h, w = z.shape
    fx, fy, cx, cy = k
    size, n = -(-h // stride) * -(-w // stride), 0
    points, directions, blocks = (
        np.empty((size, 3), np.float32),
        np.empty((size, 3), np.float32),
        np.empty(size, np.int16),
    )
    for v in range(0, h, stride):
        for u in range(0, w, stride):
            if normals[v, u, 2] == 0:
                continue
            d = z[v, u]
            points[n, 0], points[n, 1], points[n, 2] = (u - cx) / fx * d, (v - cy) / fy * d, d
            directions[n] = normals[v, u]
            blocks[n] = (v * down // h) * across + u * across // w
            n += 1
    return size, points[:n], directions[:n], blocks[:n]


@njit(cache=True)
def _plane_row(J, x, y, z, nx, ny, nz):
    """J (6,): derivative of the distance of (x, y, z) along a normal, by a twist from the left."""
    J[0], J[1], J[2] = nx, ny, nz
    J[3], J[4], J[5] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx


@njit(cache=True)
def plane_residuals(
    T, k, points, directions, z, normals, max_distance, min_cosine, residual, J, residual1, J1
):
    """Projective association: residual = n . (p0 - T p1) in metres, NaN without a match; T is
    T_reference_current.

    z and normals are the reference's.
    """
    h, w = z.shape
    fx, fy, cx, cy = k
    farthest = max_distance * max_distance
    for n in range(len(points)):
        x, y, d = points[n, 0], points[n, 1], points[n, 2]
        residual[n] = np.nan
        qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * d + T[2, 3]
        if qz < 0.05:
            continue
        qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * d + T[0, 3]
        qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * d + T[1, 3]
        a, b = fx * qx / qz + cx + 0.5, fy * qy / qz + cy + 0.5
        if not (a >= 0 and b >= 0 and a < w and b < h):
            continue
        j, i = int(a), int(b)
        nx, ny, nz = normals[i, j, 0], normals[i, j, 1], normals[i, j, 2]
        if nz == 0:
            continue
        e = z[i, j]
        dx, dy, dz = (j - cx) / fx * e - qx, (i - cy) / fy * e - qy, e - qz
        if dx * dx + dy * dy + dz * dz > farthest:
            continue
        ox, oy, oz = directions[n, 0], directions[n, 1], directions[n, 2]
        mx = T[0, 0] * ox + T[0, 1] * oy + T[0, 2] * oz
        my = T[1, 0] * ox + T[1, 1] * oy + T[1, 2] * oz
        mz = T[2, 0] * ox + T[2, 1] * oy + T[2, 2] * oz
        if nx * mx + ny * my + nz * mz < min_cosine:
            continue
        residual[n] = nx * dx + ny * dy + nz * dz
        _plane_row(J[n], qx, qy, qz, nx, ny, nz)
        residual1[n] = mx * dx + my * dy + mz * dz
        _plane_row(J1[n], qx, qy, qz, mx, my, mz)


@njit(cache=True)
def _add_point(o, r, weight, x, y, z):
    """Add one pixel to elements 27 to 33 of the sums o (34,) that block_sums() describes."""
    o[27] += weight * r * r
    o[28] += weight
    o[29] += 1
    o[30] += weight * x
    o[31] += weight * y
    o[32] += weight * z
    o[33] += weight * (x * x + y * y + z * z)


@njit(cache=True)
def _add_pair(o, J, r, J1, q, weight, x, y, z):
    """Add one pixel to the sums o (34,) that block_sums() describes."""
    half, n = 0.5 * weight, 0
    for a in range(6):
        for b in range(a, 6):
            o[n] += half * (J[a] * J1[b] + J1[a] * J[b])
            n += 1
        o[21 + a] += half * (J[a] * q + J1[a] * r)
    _add_point(o, r, weight, x, y, z)


@njit(cache=True)
def block_sums(points, J, residual, J1, residual1, sigma, nu, blocks, out):
    """out (blocks, 34), sums per block: 21 of the upper triangle of J^T W J1, 6 of J^T W r1, both
    symmetrized, w r^2, w,
    count, w p, w |p|^2.

    Student-t weights (Kerl 2013, eq. 12); nu <= 0: plain least squares. J1 = J gives the usual
    squares. With J1 of the other image they are products of independent noise; squares of noise
    would bias the motion to zero and add false information.
    """
    out[:] = 0
    for i in range(len(residual)):
        r, q = residual[i], residual1[i]
        if not math.isfinite(r):
            continue
        weight = 1.0 if nu <= 0 else (nu + 1) / (nu + (r / sigma) ** 2)
        _add_pair(
            out[blocks[i]], J[i], r, J1[i], q, weight, points[i, 0], points[i, 1], points[i, 2]
        )


@njit(cache=True)
def sums(points, J, residual, J1, residual1, sigma, nu):
    """(34,): block_sums() of all pixels as one block."""
    out = np.empty((1, 34))
    block_sums(
        points, J, residual, J1, residual1, sigma, nu, np.zeros(len(residual), np.int16), out
    )
    return out[0]


@njit(cache=True)
def tile_sums(points, J, parallax, residual, sigma, nu, tiles, out):
    """out (tiles, 42): sums() of squares per tile, then J^T w g (6), g^T w g and g^T w r of its
    parallax g.
    """
    out[:] = 0
    for i in range(len(residual)):
        r = residual[i]
        if not math.isfinite(r):
            continue
        weight = 1.0 if nu <= 0 else (nu + 1) / (nu + (r / sigma) ** 2)
        o, g = out[tiles[i]], parallax[i]
        n = 0
        for a in range(6):
            slope = weight * J[i, a]
            for b in range(a, 6):
                o[n] += slope * J[i, b]
                n += 1
            o[21 + a] += slope * r
            o[34 + a] += slope * g
        _add_point(o, r, weight, points[i, 0], points[i, 1], points[i, 2])
        o[40] += weight * g * g
        o[41] += weight * g * r


@njit(cache=True)
def _normal(z, v, u, k):
    """Unit normal by differences over a pixel to each side; its z is 0 at depth edges and where
    depth is missing.
    """
    d, e, r, a, b = z[v, u], z[v, u - 1], z[v, u + 1], z[v - 1, u], z[v + 1, u]
    if not (d > 0 and e > 0 and r > 0 and a > 0 and b > 0):
        return 0.0, 0.0, 0.0
    if max(abs(e - d), abs(r - d), abs(a - d), abs(b - d)) > 0.04 * d:
        return 0.0, 0.0, 0.0
    return _facing(k, v, u, u - 1, u + 1, v - 1, v + 1, e, r, a, b)


@njit(cache=True)
def depth_points(k, z, stride):
    """Lists of point (n, 3) and normal (n, 3) of the pixels with a normal in every stride-th row
    and column.
    """
    fx, fy, cx, cy = k
    size, n = -(-z.shape[0] // stride) * -(-z.shape[1] // stride), 0
    points, directions = np.empty((size, 3), np.float32), np.empty((size, 3), np.float32)
    for v in range(1, z.shape[0] - 1, stride):
        for u in range(1, z.shape[1] - 1, stride):
            x, y, w = _normal(z, v, u, k)
            if w == 0:
                continue
            d = z[v, u]
            points[n, 0], points[n, 1], points[n, 2] = (u - cx) / fx * d, (v - cy) / fy * d, d
            directions[n, 0], directions[n, 1], directions[n, 2] = x, y, w
            n += 1
    return points[:n], directions[:n]


@njit(cache=True)
def depth_sums(T, k, points, directions, z, max_distance, min_cosine, sigma, nu, residual, cosine):
    """sums() of point-to-plane products; writes residual = n . (p0 - T p1) in metres (NaN without a
    match) and cosine of the normals.

    Projective association; T is T_reference_current, z (h, w) the reference's, whose normals are
    computed only where needed.
    """
    h, w = z.shape
    fx, fy, cx, cy = k
    farthest = max_distance * max_distance
    out, J, J1 = np.zeros(34), np.empty(6), np.empty(6)
    for n in range(len(points)):
        x, y, d = points[n, 0], points[n, 1], points[n, 2]
        residual[n] = np.nan
        qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * d + T[2, 3]
        if qz < 0.05:
            continue
        qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * d + T[0, 3]
        qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * d + T[1, 3]
        a, b = fx * qx / qz + cx + 0.5, fy * qy / qz + cy + 0.5
        if not (a >= 1 and b >= 1 and a < w - 1 and b < h - 1):
            continue
        j, i = int(a), int(b)
        e = z[i, j]
        dx, dy, dz = (j - cx) / fx * e - qx, (i - cy) / fy * e - qy, e - qz
        if dx * dx + dy * dy + dz * dz > farthest:
            continue
        nx, ny, nz = _normal(z, i, j, k)
        ox, oy, oz = directions[n, 0], directions[n, 1], directions[n, 2]
        mx = T[0, 0] * ox + T[0, 1] * oy + T[0, 2] * oz
        my = T[1, 0] * ox + T[1, 1] * oy + T[1, 2] * oz
        mz = T[2, 0] * ox + T[2, 1] * oy + T[2, 2] * oz
        cosine[n] = nx * mx + ny * my + nz * mz
        if nz == 0 or cosine[n] < min_cosine:
            continue
        r, q = nx * dx + ny * dy + nz * dz, mx * dx + my * dy + mz * dz
        residual[n] = r
        _plane_row(J, qx, qy, qz, nx, ny, nz)
        _plane_row(J1, qx, qy, qz, mx, my, mz)
        _add_pair(out, J, r, J1, q, (nu + 1) / (nu + (r / sigma) ** 2), qx, qy, qz)
    return out


@njit(cache=True)
def student_scale(residual, nu, start, rounds):
    """Scale of Student's t by fixed-point iteration (Kerl 2013, eq.

    13), on some 5000 of the residuals.
    """
    step = max(1, len(residual) // 5000) | 1
    sigma = start
    for _ in range(rounds):
        total, n = 0.0, 0
        for i in range(0, len(residual), step):
            r = residual[i]
            if math.isfinite(r):
                total += r * r * (nu + 1) / (nu + (r / sigma) ** 2)
                n += 1
        if n == 0 or total <= 0:
            return start
        before, sigma = sigma, math.sqrt(total / n)
        if abs(sigma - before) < 1e-3 * sigma:
            break
    return sigma


@njit(cache=True)
def take_brightness(residual, greys, nu, sigma, rounds):
    """(sigma, gain): subtracts a gain (minus 1) and an offset of `greys` from the residual (n,).
    They are estimated with Student-t
    weights on some 5000 residuals, like the scale (student_scale)."""
    step = max(1, len(residual) // 5000) | 1
    gain, offset, before = 0.0, 0.0, sigma
    for _ in range(rounds):
        s, x, y, xx, xy, total, n = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
        for i in range(0, len(residual), step):
            r, grey = residual[i], greys[i] - 128.0
            if not math.isfinite(r):
                continue
            off = r - offset - gain * grey
            weight = (nu + 1) / (nu + (off / sigma) ** 2)
            s, x, y, n = s + weight, x + weight * grey, y + weight * r, n + 1
            xx, xy, total = (
                xx + weight * grey * grey,
                xy + weight * grey * r,
                total + weight * off * off,
            )
        if n == 0 or s <= 0:
            break
        spread = xx - x * x / s
        gain = (xy - x * y / s) / (
            spread + s
        )  # regularized: a standard deviation of one grey level does not determine a gain
        offset = (y - gain * x) / s
        before, sigma = sigma, max(math.sqrt(total / n), 1e-3)
        if abs(sigma - before) < 1e-2 * sigma:
            break
    for i in range(len(residual)):
        residual[i] -= offset + gain * (greys[i] - 128.0)
    return sigma, gain
