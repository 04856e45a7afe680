"""The compiled loops over blocks of 8^3 voxels: which blocks a depth image touches, fusing, tracing rays.

Voxel (i, j, k) has its centre at origin + (i, j, k) voxel_m; index[bx, by, bz] is the row of a block or -1.
Each block and each pixel is written by one thread only, so the number of threads cannot change a bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange


@njit(cache=True)
def touch(depth, K, R, t, origin, voxel, trunc, index, stamp, frame, rows, free):
    """Blocks within the truncation of a measured depth: marked in stamp, listed in rows; returns (listed, free row, lost)."""
    n, lost = 0, 0
    step = 2.0 * voxel
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            if not depth[v, u] > 0.0:
                continue
            x, y = (u - K[2]) / K[0], (v - K[3]) / K[1]
            z, last = max(depth[v, u] - trunc, step), depth[v, u] + trunc + voxel
            while z < last:
                b = np.empty(3, np.int64)
                inside = True
                for a in range(3):
                    p = (R[a, 0] * x + R[a, 1] * y + R[a, 2]) * z + t[a] - origin[a]
                    b[a] = math.floor(p / voxel / 8.0)
                    inside = inside and 0 <= b[a] < index.shape[a]
                z += step
                if not inside or stamp[b[0], b[1], b[2]] == frame:
                    continue
                if index[b[0], b[1], b[2]] < 0:
                    if free >= rows.shape[0]:
                        lost += 1
                        continue
                    index[b[0], b[1], b[2]] = free
                    free += 1
                stamp[b[0], b[1], b[2]] = frame
                for a in range(3):
                    rows[n, a] = b[a]
                n += 1
    return n, free, lost


@njit(cache=True)
def sample_depth(depth, u, v, trunc):
    """Bilinear in inverse depth (exact on planes) where the four belong together; 0 = missing."""
    i, j = int(math.floor(v)), int(math.floor(u))
    if i < 0 or j < 0 or i + 1 >= depth.shape[0] or j + 1 >= depth.shape[1]:
        return 0.0
    a, b, c, d = depth[i, j], depth[i, j + 1], depth[i + 1, j], depth[i + 1, j + 1]
    if not (a > 0.0 and b > 0.0 and c > 0.0 and d > 0.0):
        return 0.0
    if max(a, b, c, d) - min(a, b, c, d) > trunc:
        return depth[int(math.floor(v + 0.5)), int(math.floor(u + 0.5))]
    p, q = v - i, u - j
    return 1.0 / ((1 - p) * ((1 - q) / a + q / b) + p * ((1 - q) / c + q / d))


@njit(cache=True, parallel=True)
def fuse(depth, rgb, coloured, K, R, t, origin, voxel, trunc, most, rows, n, index, tsdf, weight, colour):
    """Running mean of the truncated distance along z in the listed blocks; R, t are T_camera_world."""
    for r in prange(n):
        row = index[rows[r, 0], rows[r, 1], rows[r, 2]]
        for k in range(512):
            gx, gy, gz = rows[r, 0] * 8 + k // 64, rows[r, 1] * 8 + k // 8 % 8, rows[r, 2] * 8 + k % 8
            px, py, pz = origin[0] + gx * voxel, origin[1] + gy * voxel, origin[2] + gz * voxel
            z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]
            if z <= voxel:
                continue
            u = K[0] * (R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + t[0]) / z + K[2]
            v = K[1] * (R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + t[1]) / z + K[3]
            measured = sample_depth(depth, u, v, trunc)
            if not measured > 0.0 or measured - z < -trunc:
                continue
            w = weight[row, k]
            tsdf[row, k] = (tsdf[row, k] * w + min(measured - z, trunc)) / (w + 1.0)
            if coloured and measured - z < trunc:
                for c in range(3):
                    seen = rgb[int(math.floor(v + 0.5)), int(math.floor(u + 0.5)), c]
                    colour[row, k, c] = (colour[row, k, c] * w + seen) / (w + 1.0)
            weight[row, k] = min(w + 1.0, most)


@njit(cache=True)
def read(x, y, z, index, tsdf, weight):
    """Trilinear distance at grid coordinates (voxels); NaN where one of the eight is unseen."""
    i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(z))
    total = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                g, h, m = i + a, j + b, k + c
                if g < 0 or h < 0 or m < 0:
                    return np.nan
                if g >= 8 * index.shape[0] or h >= 8 * index.shape[1] or m >= 8 * index.shape[2]:
                    return np.nan
                row = index[g >> 3, h >> 3, m >> 3]
                if row < 0:
                    return np.nan
                at = (g & 7) * 64 + (h & 7) * 8 + (m & 7)
                if weight[row, at] <= 0.0:
                    return np.nan
                s = (x - i if a else 1 - x + i) * (y - j if b else 1 - y + j) * (z - k if c else 1 - z + k)
                total += s * tsdf[row, at]
    return total


@njit(cache=True, parallel=True)
def trace(K, R, t, origin, voxel, far, index, tsdf, weight, colour, depth, normals, rgb):
    """First crossing from front to back along each pixel's ray, refined by secants; outputs stay NaN without one."""
    for v in prange(depth.shape[0]):
        for u in range(depth.shape[1]):
            x, y = (u - K[2]) / K[0], (v - K[3]) / K[1]
            d = R @ np.array([x, y, 1.0]) / voxel
            o = (t - origin) / voxel
            length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            z, before, z_before = 4.0 / length, np.nan, 0.0
            while z < far:
                f = read(o[0] + d[0] * z, o[1] + d[1] * z, o[2] + d[2] * z, index, tsdf, weight)
                if before > 0.0 and f <= 0.0:
                    lo, hi, flo, fhi = z_before, z, before, f
                    for _ in range(4):
                        mid = lo + (hi - lo) * flo / (flo - fhi)
                        fm = read(o[0] + d[0] * mid, o[1] + d[1] * mid, o[2] + d[2] * mid, index, tsdf, weight)
                        if math.isnan(fm):
                            break
                        if fm > 0.0:
                            lo, flo = mid, fm
                        else:
                            hi, fhi = mid, fm
                    mid = lo + (hi - lo) * flo / (flo - fhi)
                    q = o + d * mid
                    g = np.empty(3)
                    for a in range(3):
                        e = np.zeros(3)
                        e[a] = 1.0
                        g[a] = read(q[0] + e[0], q[1] + e[1], q[2] + e[2], index, tsdf, weight) - read(
                            q[0] - e[0], q[1] - e[1], q[2] - e[2], index, tsdf, weight)
                    depth[v, u] = mid
                    size = math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
                    if size > 0.0:
                        for a in range(3):
                            normals[v, u, a] = g[a] / size
                    i, j, k = int(q[0] + 0.5), int(q[1] + 0.5), int(q[2] + 0.5)
                    row = index[i >> 3, j >> 3, k >> 3]
                    if row >= 0:
                        for a in range(3):
                            rgb[v, u, a] = colour[row, (i & 7) * 64 + (j & 7) * 8 + (k & 7), a]
                    break
                before, z_before = f, z
                z += 4.0 / length if math.isnan(f) else 1.0 / length
