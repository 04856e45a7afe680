"""Fusing a depth image, compiled: which blocks it touches, and the running means in them.

Each block is written by one thread only, so the number of threads cannot change a bit. K is (fx, fy, cx, cy).
"""

import math

import numpy as np
from numba import njit, prange

#: Of weight: what a frame adds on the surface and before it.
UNIT = 16.0


@njit(cache=True)
def touch(grid, inverse, K, R, t, voxel, reach, stride, stamp, frame, free, n_free, rows):
    """Rows of the blocks within `reach` of a measured depth, made where there are none; R, t are T_world_camera.

    Every stride-th pixel is looked at. Returns (number listed in rows, free rows left, blocks that found no row).
    """
    n, lost = 0, 0
    size, step = 8.0 * voxel, 2.0 * voxel
    count = grid.slots.shape[0]
    for v in range(0, inverse.shape[0], stride):
        for u in range(0, inverse.shape[1], stride):
            if inverse[v, u] <= 0.0:
                continue
            x, y, measured = (u - K[2]) / K[0], (v - K[3]) / K[1], 1.0 / inverse[v, u]
            dx = R[0, 0] * x + R[0, 1] * y + R[0, 2]
            dy = R[1, 0] * x + R[1, 1] * y + R[1, 2]
            dz = R[2, 0] * x + R[2, 1] * y + R[2, 2]
            z, last = max(measured - reach, step), measured + reach + voxel
            while z < last:
                a = int(math.floor((t[0] + dx * z) / size + 1 / 16))
                b = int(math.floor((t[1] + dy * z) / size + 1 / 16))
                c = int(math.floor((t[2] + dz * z) / size + 1 / 16))
                z += step
                i, j, k = a - grid.first[0], b - grid.first[1], c - grid.first[2]
                if i < 0 or j < 0 or k < 0 or i >= count or j >= count or k >= count:
                    continue
                i, j, k = a & (count - 1), b & (count - 1), c & (count - 1)
                row = grid.slots[i, j, k]
                if row == 0:
                    if n_free == 0:
                        lost += 1
                        continue
                    n_free -= 1
                    row = free[n_free]
                    grid.slots[i, j, k] = row
                    grid.place[row, 0], grid.place[row, 1], grid.place[row, 2] = a, b, c
                elif stamp[row] == frame:
                    continue
                stamp[row] = frame
                rows[n] = row
                n += 1
    return n, n_free, lost


@njit(cache=True, inline="always")
def _sample(inverse, u, v, jump):
    """(inverse depth, whether depth jumps here): bilinear, exact on planes, else the nearest pixel's; 0 = missing."""
    i, j = int(math.floor(v)), int(math.floor(u))
    if i < 0 or j < 0 or i + 1 >= inverse.shape[0] or j + 1 >= inverse.shape[1]:
        return 0.0, False
    a, b, c, d = inverse[i, j], inverse[i, j + 1], inverse[i + 1, j], inverse[i + 1, j + 1]
    near, far = max(a, b, c, d), min(a, b, c, d)
    if far <= 0.0:
        return 0.0, False
    p, q = v - i, u - j
    if near - far > jump * near * far:
        return inverse[i + (1 if p >= 0.5 else 0), j + (1 if q >= 0.5 else 0)], True
    return (1 - p) * ((1 - q) * a + q * b) + p * ((1 - q) * c + q * d), False


@njit(cache=True, inline="always")
def _slant(inverse, K, u, v, found):
    """Distance along the normal as a share of that along z, where depth does not jump.

    On a plane the inverse depth is linear in the image, and its slopes are the normal's: n . ray = inverse depth.
    """
    i, j = int(math.floor(v)), int(math.floor(u))
    a, b, c, d = inverse[i, j], inverse[i, j + 1], inverse[i + 1, j], inverse[i + 1, j + 1]
    across, down = 0.5 * (b - a + d - c), 0.5 * (c - a + d - b)
    nz = found - (u - K[2]) * across - (v - K[3]) * down
    return found / math.sqrt((K[0] * across) ** 2 + (K[1] * down) ** 2 + nz * nz)


@njit(cache=True, inline="always")
def _colour(image, u, v, colour):
    """One more sample, bilinear, into the running mean; the last channel of colour (channels + 1,) counts."""
    i, j = int(math.floor(v)), int(math.floor(u))
    p, q = v - i, u - j
    last = colour.shape[0] - 1
    n = colour[last]
    for c in range(last):
        upper = (1 - q) * image[i, j, c] + q * image[i, j + 1, c]
        lower = (1 - q) * image[i + 1, j, c] + q * image[i + 1, j + 1, c]
        seen = 256.0 * ((1 - p) * upper + p * lower)
        colour[c] = np.uint16((float(colour[c]) * n + seen) / (n + 1) + 0.5)
    colour[last] = min(n + 1, 255)


@njit(cache=True, parallel=True)
def fuse(grid, inverse, image, K, R, t, voxel, trunc, behind, max_weight, rows, n):
    """Running mean of the truncated distance in the listed blocks; R, t are T_camera_world.

    Along z, from `trunc` before the surface to `trunc` behind it. With a smaller `behind`: along the normal, with a weight
    that is less where the surface is slanted, and falls to 0 that far behind it.
    image (h, w, channels), or (1, 1, channels) for none.
    """
    coloured = image.shape[0] > 1
    for r in prange(n):
        row = rows[r]
        tsdf, weight, colour = grid.tsdf[row], grid.weight[row], grid.colour[row]
        for line in range(64):
            px = (grid.place[row, 0] * 8 + (line >> 3)) * voxel
            py = (grid.place[row, 1] * 8 + (line & 7)) * voxel
            for k in range(8):
                pz = (grid.place[row, 2] * 8 + k) * voxel
                z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]
                if z <= voxel:
                    continue
                u = K[0] * (R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + t[0]) / z + K[2]
                v = K[1] * (R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + t[1]) / z + K[3]
                found, jumps = _sample(inverse, u, v, trunc)
                if found <= 0.0:
                    continue
                distance = 1.0 / found - z
                if distance < -trunc:
                    continue
                more = UNIT
                if behind < trunc:
                    if jumps:  # one of two surfaces, or one that is almost edge-on: it hardly counts
                        more = 1.0 if distance > -behind else 0.0
                    elif distance < trunc:
                        slant = _slant(inverse, K, u, v, found)
                        distance *= slant
                        more = math.ceil(UNIT * slant * (1.0 + min(distance, 0.0) / behind))
                    if more < 1.0:
                        continue
                at = line * 8 + k
                w = float(weight[at])
                tsdf[at] = (tsdf[at] * w + more * min(distance, trunc)) / (w + more)
                weight[at] = np.uint16(min(w + more, max_weight))
                if coloured and distance < trunc:
                    _colour(image, u, v, colour[at])
