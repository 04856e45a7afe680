"""The compiled loops over pixels. One thread on purpose: a row pass takes half a millisecond, which the
barriers of a thread pool on a busy machine exceed many times, and so no number of threads can change a bit.

Residuals and weights come first, normal equations after, so that a scale can be estimated in between. Twists are
(translation, rotation) applied from the left in the reference camera's frame: T_ref_cur <- exp(x) T_ref_cur.
A row of sums holds 21 of the upper triangle of J^T J, 6 of J^T r, w r^2, w, count, and w (x, y, z), w |p|^2.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SUMS = 34


@njit(cache=True)
def halve_depth(z, out):
    """2x2 mean in inverse depth (exact on planes) where the four belong together, else their nearest; 0 = missing."""
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            near, far, inverse, n = 1e9, 0.0, 0.0, 0
            for i in range(2):
                for j in range(2):
                    d = z[2 * v + i, 2 * u + j]
                    if d > 0:
                        near, far, n = min(near, d), max(far, d), n + 1
                        inverse += 1.0 / d
            if n == 0:
                out[v, u] = 0
            elif n == 4 and far - near < 0.05 * near:
                out[v, u] = 4.0 / inverse
            else:
                out[v, u] = near if n == 4 else 0


@njit(cache=True)
def normals(z, k, s, out):
    """Unit normals by differences over +-s pixels; none where depth jumps or a neighbour is missing."""
    h, w = z.shape
    fx, fy, cx, cy = k
    for v in range(h):
        for u in range(w):
            if v < s or v >= h - s or u < s or u >= w - s or not z[v, u] > 0:
                continue
            e, r, a, b = z[v, u - s], z[v, u + s], z[v - s, u], z[v + s, u]
            limit = (0.02 + 0.02 * s) * z[v, u]
            if not (e > 0 and r > 0 and a > 0 and b > 0):
                continue
            if (
                abs(e - z[v, u]) > limit
                or abs(r - z[v, u]) > limit
                or abs(a - z[v, u]) > limit
                or abs(b - z[v, u]) > limit
            ):
                continue
            x1, y1, z1 = ((u + s - cx) * r - (u - s - cx) * e) / fx, (v - cy) * (r - e) / fy, r - e
            x2, y2, z2 = (u - cx) * (b - a) / fx, ((v + s - cy) * b - (v - s - cy) * a) / fy, b - a
            nx, ny, nz = y2 * z1 - z2 * y1, z2 * x1 - x2 * z1, x2 * y1 - y2 * x1
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            if length > 0:
                out[v, u, 0], out[v, u, 1], out[v, u, 2] = nx / length, ny / length, nz / length


@njit(cache=True)
def photometric_residuals(T, k, I0, Z0, gx, gy, I1, Z1, least_gradient, most_dz, most_depth, residual):
    """residual = I1(warped) - I0, bilinear; NaN without depth or gradient, outside, or behind another surface.

    T (4, 4) is T_current_reference.
    """
    h, w = I0.shape
    fx, fy, cx, cy = k
    for v in range(h):
        for u in range(w):
            residual[v, u] = np.nan
            z = Z0[v, u]
            if not z > 0 or z > most_depth:
                continue
            if gx[v, u] * gx[v, u] + gy[v, u] * gy[v, u] < least_gradient * least_gradient:
                continue
            x, y = (u - cx) / fx * z, (v - cy) / fy * z
            qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if qz < 0.05:
                continue
            a = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / qz + cx
            b = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / qz + cy
            if not (a >= 0 and b >= 0 and a < w - 1 and b < h - 1):
                continue
            zc = Z1[int(b + 0.5), int(a + 0.5)]
            if not zc > 0 or abs(zc - qz) > most_dz:
                continue
            i, j = int(b), int(a)
            s, t = a - j, b - i
            top = I1[i, j] + s * (I1[i, j + 1] - I1[i, j])
            bottom = I1[i + 1, j] + s * (I1[i + 1, j + 1] - I1[i + 1, j])
            residual[v, u] = top + t * (bottom - top) - I0[v, u]


@njit(cache=True)
def photometric_sums(k, Z0, gx, gy, residual, sigma, nu, rows):
    """Inverse compositional: the slope of the reference image, taken once. nu <= 0: plain least squares."""
    h, w = Z0.shape
    fx, fy, cx, cy = k
    for v in range(h):
        J = np.empty(6)
        for u in range(w):
            r = residual[v, u]
            if not math.isfinite(r):
                continue
            z = Z0[v, u]
            x, y = (u - cx) / fx * z, (v - cy) / fy * z
            J[0], J[1] = gx[v, u] * fx / z, gy[v, u] * fy / z
            J[2] = -(J[0] * x + J[1] * y) / z
            J[3], J[4], J[5] = y * J[2] - z * J[1], z * J[0] - x * J[2], x * J[1] - y * J[0]
            weight = 1.0 if nu <= 0 else (nu + 1) / (nu + (r / sigma) ** 2)
            _add(rows[v], J, r, weight, x, y, z)


@njit(cache=True)
def plane_residuals(T, k, Z0, N0, Z1, N1, stride, most_distance, least_cosine, residual, partner):
    """Projective association: residual = n . (T p1 - p0) in metres, NaN without a partner; T is T_reference_current."""
    h, w = Z0.shape
    fx, fy, cx, cy = k
    for row in range(residual.shape[0]):
        v = row * stride
        for column in range(residual.shape[1]):
            u = column * stride
            residual[row, column] = np.nan
            z = Z1[v, u]
            if not z > 0 or N1[v, u, 2] == 0:
                continue
            x, y = (u - cx) / fx * z, (v - cy) / fy * z
            qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if qz < 0.05:
                continue
            a, b = fx * qx / qz + cx + 0.5, fy * qy / qz + cy + 0.5
            if not (a >= 0 and b >= 0 and a < w and b < h):
                continue
            j, i = int(a), int(b)
            d = Z0[i, j]
            if not d > 0 or N0[i, j, 2] == 0:
                continue
            dx, dy, dz = qx - (j - cx) / fx * d, qy - (i - cy) / fy * d, qz - d
            if dx * dx + dy * dy + dz * dz > most_distance * most_distance:
                continue
            nx, ny, nz = N0[i, j, 0], N0[i, j, 1], N0[i, j, 2]
            mx = T[0, 0] * N1[v, u, 0] + T[0, 1] * N1[v, u, 1] + T[0, 2] * N1[v, u, 2]
            my = T[1, 0] * N1[v, u, 0] + T[1, 1] * N1[v, u, 1] + T[1, 2] * N1[v, u, 2]
            mz = T[2, 0] * N1[v, u, 0] + T[2, 1] * N1[v, u, 1] + T[2, 2] * N1[v, u, 2]
            if nx * mx + ny * my + nz * mz < least_cosine:
                continue
            residual[row, column] = nx * dx + ny * dy + nz * dz
            partner[row, column] = i * w + j


@njit(cache=True)
def plane_sums(T, k, N0, Z1, stride, residual, partner, sigma, nu, rows):
    fx, fy, cx, cy = k
    w = N0.shape[1]
    for row in range(residual.shape[0]):
        J = np.empty(6)
        for column in range(residual.shape[1]):
            r = residual[row, column]
            if not math.isfinite(r):
                continue
            v, u = row * stride, column * stride
            z = Z1[v, u]
            x, y = (u - cx) / fx * z, (v - cy) / fy * z
            qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            i, j = partner[row, column] // w, partner[row, column] % w
            J[0], J[1], J[2] = N0[i, j, 0], N0[i, j, 1], N0[i, j, 2]
            J[3], J[4], J[5] = qy * J[2] - qz * J[1], qz * J[0] - qx * J[2], qx * J[1] - qy * J[0]
            weight = 1.0 if nu <= 0 else (nu + 1) / (nu + (r / sigma) ** 2)
            _add(rows[row], J, -r, weight, qx, qy, qz)


@njit(cache=True, inline="always")
def _add(row, J, r, weight, x, y, z):
    n = 0
    for i in range(6):
        for j in range(i, 6):
            row[n] += weight * J[i] * J[j]
            n += 1
        row[21 + i] += weight * J[i] * r
    row[27] += weight * r * r
    row[28] += weight
    row[29] += 1
    row[30] += weight * x
    row[31] += weight * y
    row[32] += weight * z
    row[33] += weight * (x * x + y * y + z * z)


@njit(cache=True)
def student_scale(residual, nu, start, rounds):
    """Sigma of Student's t by fixed-point iteration (Kerl 2013, eq. 13), on at most some 20 000 of the residuals."""
    flat = residual.ravel()
    step = max(1, flat.size // 20000) | 1
    sigma = start
    for _ in range(rounds):
        total, n = 0.0, 0
        for i in range(0, flat.size, step):
            r = flat[i]
            if math.isfinite(r):
                total += r * r * (nu + 1) / (nu + (r / sigma) ** 2)
                n += 1
        if n == 0 or total <= 0:
            return start
        before, sigma = sigma, math.sqrt(total / n)
        if abs(sigma - before) < 1e-3 * sigma:
            break
    return sigma
