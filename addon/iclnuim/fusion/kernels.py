"""The compiled loops of the volume: memory layout of the voxels, fusion of a depth image, and raycasting.

Blocks of 8^3 voxels are stored in a cyclic index. Voxel (i, j, k) has its centre at (i, j, k) voxel_m in the world; its block is
(i >> 3, j >> 3, k >> 3). The index is a cube of n^3 slots, n a power of two; block b is in slot b modulo n. Only blocks inside
the window that starts at `first` are stored, so that no two share a slot. Row 0 means "no block".

Each block and each pixel is written by one thread only, so results do not depend on the number of threads. K is (fx, fy, cx, cy).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

#: The weight that a frame adds on its surface and in front of it.
UNIT = 16.0
#: If the distance along the normal is more than this share of the distance along z, the nearest point of the surface counts as observed.
STEEP = 0.9


class Grid(NamedTuple):
    """first (3,) int64: lowest block of the window; slots (n, n, n) int32 rows; place (rows, 3) int32 block of a row;
    tsdf (rows, 512) float32 metres; weight (rows, 512) uint16; colour (rows, 512, channels + 1) uint16: mean times 256,
    and the count behind it.
    """

    first: np.ndarray
    slots: np.ndarray
    place: np.ndarray
    tsdf: np.ndarray
    weight: np.ndarray
    colour: np.ndarray


@njit(cache=True, inline="always")
def row_of(grid, a, b, c):
    """Row of block (a, b, c); 0 if there is none."""
    n = grid.slots.shape[0]
    x, y, z = a - grid.first[0], b - grid.first[1], c - grid.first[2]
    if x < 0 or y < 0 or z < 0 or x >= n or y >= n or z >= n:
        return 0
    return grid.slots[a & (n - 1), b & (n - 1), c & (n - 1)]


@njit(cache=True)
def read(grid, x, y, z):
    """Trilinear distance at (x, y, z) in voxels; NaN if one of the eight voxels is unobserved."""
    i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(z))
    p, q, s = x - i, y - j, z - k
    if (i & 7) < 7 and (j & 7) < 7 and (k & 7) < 7:
        return _within(grid, i, j, k, p, q, s)
    total = 0.0
    for corner in range(8):
        a, b, c = corner >> 2, corner >> 1 & 1, corner & 1
        row = row_of(grid, (i + a) >> 3, (j + b) >> 3, (k + c) >> 3)
        at = ((i + a) & 7) * 64 + ((j + b) & 7) * 8 + ((k + c) & 7)
        if row == 0 or grid.weight[row, at] == 0:
            return np.nan
        share = (p if a else 1 - p) * (q if b else 1 - q) * (s if c else 1 - s)
        total += share * grid.tsdf[row, at]
    return total


@njit(cache=True, inline="always")
def _within(grid, i, j, k, p, q, s):
    """read() if all eight voxels are in one block."""
    row = row_of(grid, i >> 3, j >> 3, k >> 3)
    if row == 0:
        return np.nan
    at = (i & 7) * 64 + (j & 7) * 8 + (k & 7)
    f, w = grid.tsdf[row], grid.weight[row]
    for step in (0, 1, 8, 9, 64, 65, 72, 73):
        if w[at + step] == 0:
            return np.nan
    low = (1 - q) * ((1 - s) * f[at] + s * f[at + 1]) + q * ((1 - s) * f[at + 8] + s * f[at + 9])
    high = (1 - q) * ((1 - s) * f[at + 64] + s * f[at + 65]) + q * ((1 - s) * f[at + 72] + s * f[at + 73])
    return (1 - p) * low + p * high


@njit(cache=True)
def read_colour(grid, x, y, z, out):
    """Write to out (channels,) the trilinear colour of those of the eight voxels that have one; unchanged if none has."""
    i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(z))
    p, q, s = x - i, y - j, z - k
    channels = grid.colour.shape[2] - 1
    share = 0.0
    for corner in range(8):
        a, b, c = corner >> 2, corner >> 1 & 1, corner & 1
        row = row_of(grid, (i + a) >> 3, (j + b) >> 3, (k + c) >> 3)
        at = ((i + a) & 7) * 64 + ((j + b) & 7) * 8 + ((k + c) & 7)
        if row == 0 or grid.colour[row, at, channels] == 0:
            continue
        part = (p if a else 1 - p) * (q if b else 1 - q) * (s if c else 1 - s)
        if part > 0:
            for n in range(channels):
                before = out[n] if share > 0 else 0.0
                out[n] = (before * share + grid.colour[row, at, n] / 256 * part) / (share + part)
            share += part


@njit(cache=True)
def gradient(grid, x, y, z, out):
    """Write to out (3,) the unit gradient by central differences over one voxel to each side; NaN at the border of the observed region."""
    out[0] = read(grid, x + 1, y, z) - read(grid, x - 1, y, z)
    out[1] = read(grid, x, y + 1, z) - read(grid, x, y - 1, z)
    out[2] = read(grid, x, y, z + 1) - read(grid, x, y, z - 1)
    size = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    for a in range(3):
        out[a] = out[a] / size if size > 0 else np.nan


# -- fusion: allocation of the blocks near a depth image, and the running means in them


@njit(cache=True)
def touch(grid, inverse, K, R, t, voxel, reach, stride, stamp, frame, free, n_free, rows):
    """List in `rows` the blocks within `reach` of a measured depth, and allocate missing ones; R, t are T_world_camera.

    Every stride-th pixel is used. Returns (number of listed rows, number of free rows, number of blocks that could not be allocated).
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
def _normal(K, u, v, found, across, down):
    """n of the tangent plane n . point = 1, from the horizontal and vertical gradient of the inverse depth, which on a plane is n . ray."""
    return K[0] * across, K[1] * down, found - (u - K[2]) * across - (v - K[3]) * down


@njit(cache=True, inline="always")
def _continues(inverse, K, u, v, z, found, n, size2, trunc):
    """Whether the surface is observed at the point of its tangent plane (n of squared length size2) that is nearest to the point at (u, v, z).

    Beyond the edge of an object its tangent plane continues, but the surface was not observed there.
    """
    along = (1.0 - z * found) / size2
    depth = z + along * n[2]
    i = int(((v - K[3]) * z + K[1] * along * n[1]) / depth + K[3] + 0.5)
    j = int(((u - K[2]) * z + K[0] * along * n[0]) / depth + K[2] + 0.5)
    if not (depth > 0.0 and 0 <= i < inverse.shape[0] and 0 <= j < inverse.shape[1]):
        return False
    plane, seen = found + (j - u) * n[0] / K[0] + (i - v) * n[1] / K[1], inverse[i, j]
    return abs(plane - seen) <= trunc * plane * seen


@njit(cache=True, inline="always")
def _colour(image, i, j, p, q, colour, at):
    """Add a sample, bilinear at (i + p, j + q), to the running mean colour[at] (channels + 1,), whose last channel is the count."""
    last, one = colour.shape[1] - 1, np.uint64(1)
    n = float(colour[at, last])
    for c in range(last):
        upper = (1 - q) * image[i, j, c] + q * image[i, j + one, c]
        lower = (1 - q) * image[i + one, j, c] + q * image[i + one, j + one, c]
        seen = 256.0 * ((1 - p) * upper + p * lower)
        colour[at, c] = np.uint16((float(colour[at, c]) * n + seen) / (n + 1.0) + 0.5)
    colour[at, last] = np.uint16(min(n + 1.0, 255.0))


@njit(cache=True, inline="always")
def _project(x, y, z, voxel, K, R, t, out):
    """Write to out (3, 8) the pixel columns, rows and depths of the eight voxels of a line of a block along k. (x, y, z): the first, in voxels."""
    px, py = x * voxel, y * voxel
    a, b, c = R[0, 0] * px + R[0, 1] * py, R[1, 0] * px + R[1, 1] * py, R[2, 0] * px + R[2, 1] * py
    a2, b2, c2, t0, t1, t2 = R[0, 2], R[1, 2], R[2, 2], t[0], t[1], t[2]
    fx, fy, cx, cy = K
    for k in range(8):  # without branches, so that the loop is vectorized
        pz = (z + k) * voxel
        depth = c + c2 * pz + t2
        out[0, k] = fx * (a + a2 * pz + t0) / depth + cx
        out[1, k] = fy * (b + b2 * pz + t1) / depth + cy
        out[2, k] = depth


@njit(cache=True, parallel=True, error_model="numpy")
def fuse(grid, inverse, image, K, R, t, voxel, trunc, behind, slanted, max_weight, rows, n):
    """Update the running mean of the truncated distance in the listed blocks; R, t are T_camera_world.

    Inverse depth is bilinear (exact on planes), or that of the nearest pixel at depth edges. Distances are along z, from `trunc` in
    front of the surface to `trunc` behind it. With a smaller `behind` they are along the normal; the weight is smaller where the
    surface is slanted, and decreases to 0 at that distance behind it. With `slanted` above 1, slanted surfaces are fused up to
    `slanted` times `trunc` along z behind them, where the surface continues. image: (h, w, channels), or (1, 1, channels) for none.
    """
    coloured, free, narrow = image.shape[0] > 1, np.float32(trunc), behind < trunc
    deepest = slanted * trunc if narrow else trunc
    height, width = np.uint64(inverse.shape[0] - 1), np.uint64(inverse.shape[1] - 1)
    one = np.uint64(1)  # unsigned indices need no check for negative values
    camera = (K[0], K[1], K[2], K[3])
    for r in prange(n):
        row, line8 = rows[r], np.empty((3, 8))
        tsdf, weight, colour = grid.tsdf[row], grid.weight[row], grid.colour[row]
        x0, y0, z0 = grid.place[row, 0] * 8, grid.place[row, 1] * 8, grid.place[row, 2] * 8
        for line in range(64):
            _project(x0 + (line >> 3), y0 + (line & 7), z0, voxel, camera, R, t, line8)
            for k in range(8):
                u, v, z = line8[0, k], line8[1, k], line8[2, k]
                if not (z > voxel and u >= 0.0 and v >= 0.0):
                    continue
                p, q = v - int(v), u - int(u)
                i, j = np.uint64(int(v)), np.uint64(int(u))
                if i >= height or j >= width:
                    continue
                a, b, c, d = inverse[i, j], inverse[i, j + one], inverse[i + one, j], inverse[i + one, j + one]
                near, far = max(a, b, c, d), min(a, b, c, d)
                if far <= 0.0:
                    continue
                jumps = near - far > trunc * near * far
                if jumps:
                    found = float((d if q >= 0.5 else c) if p >= 0.5 else (b if q >= 0.5 else a))
                else:
                    found = (1 - p) * ((1 - q) * a + q * b) + p * ((1 - q) * c + q * d)
                distance = 1.0 / found - z
                if distance < -deepest:
                    continue
                more = UNIT
                if narrow:
                    if jumps:  # a depth edge, or a surface that is almost edge-on: small weight
                        more = 1.0 if distance > -behind else 0.0
                    elif distance < trunc:
                        n3 = _normal(camera, u, v, found, 0.5 * (b - a + d - c), 0.5 * (c - a + d - b))
                        size2 = n3[0] * n3[0] + n3[1] * n3[1] + n3[2] * n3[2]
                        if distance < 0.0 and (distance * found) ** 2 >= behind * behind * size2:
                            continue
                        slant = found / math.sqrt(size2)
                        distance *= slant
                        asked = slanted > 1 and distance < 0.0 and slant < STEEP
                        if asked and not _continues(inverse, camera, u, v, z, found, n3, size2, trunc):
                            continue
                        more = float(math.ceil(UNIT * slant * (1.0 + min(distance, 0.0) / behind)))
                    if more < 1.0:
                        continue
                at = line * 8 + k
                w = float(weight[at])
                if distance < trunc or tsdf[at] != free:
                    tsdf[at] = (tsdf[at] * w + more * min(distance, trunc)) / (w + more)
                weight[at] = np.uint16(min(w + more, max_weight))
                if coloured and distance < trunc:
                    _colour(image, i, j, p, q, colour, at)


# -- raycasting: along each ray to the trilinear zero crossing


@njit(cache=True, inline="always")
def _beside(x, z, f, c, size, radius):
    """Whether a sphere at (x, z) is outside one of the two planes through opposite borders of the image."""
    low, high = c + 0.5, size - 0.5 - c
    return f * x + low * z < -radius * math.hypot(f, low) or high * z - f * x < -radius * math.hypot(f, high)


@njit(cache=True)
def ranges(grid, highest, K, R, t, voxel, tile, near, far):
    """Range of planar depth, `near` to `far`, of the blocks of rows 1..highest, per tile of the image.

    near, far (h, w): filled with infinity and 0 by the caller. R, t are T_camera_world. A block is approximated by its bounding sphere.
    """
    size = 8.0 * voxel
    radius = 0.5 * math.sqrt(3.0) * size
    height, width = near.shape[0] * tile, near.shape[1] * tile
    for row in range(1, highest + 1):
        px = grid.place[row, 0] * size + 3.5 * voxel
        py = grid.place[row, 1] * size + 3.5 * voxel
        pz = grid.place[row, 2] * size + 3.5 * voxel
        z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]
        if z < -radius or row_of(grid, grid.place[row, 0], grid.place[row, 1], grid.place[row, 2]) != row:
            continue
        x = R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + t[0]
        y = R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + t[1]
        if _beside(x, z, K[0], K[2], width, radius) or _beside(y, z, K[1], K[3], height, radius):
            continue
        nearest = z - radius
        if nearest < 0.1:
            u0, u1, v0, v1 = 0, near.shape[1] - 1, 0, near.shape[0] - 1
            nearest = 0.0
        else:
            u, v = K[0] * x, K[1] * y
            du, dv = K[0] * radius, K[1] * radius
            u0 = int(max(0.0, (min((u - du) / z, (u - du) / nearest) + K[2]) // tile))
            v0 = int(max(0.0, (min((v - dv) / z, (v - dv) / nearest) + K[3]) // tile))
            u1 = int(min(near.shape[1] - 1.0, (max((u + du) / z, (u + du) / nearest) + K[2]) // tile))
            v1 = int(min(near.shape[0] - 1.0, (max((v + dv) / z, (v + dv) / nearest) + K[3]) // tile))
        for i in range(v0, v1 + 1):
            for j in range(u0, u1 + 1):
                near[i, j] = min(near[i, j], nearest)
                far[i, j] = max(far[i, j], z + radius)


@njit(cache=True, inline="always")
def _leave_block(x, y, z, dx, dy, dz):
    """Distance along d to the border of the block of a point (voxels, shifted by half), plus a small margin."""
    best = 1e9
    for p, d in ((x, dx), (y, dy), (z, dz)):
        low = 8.0 * math.floor(p / 8.0)
        if d > 1e-12:
            best = min(best, (low + 8.0 - p) / d)
        elif d < -1e-12:
            best = min(best, (low - p) / d)
    return best + 1e-3


@njit(cache=True)
def _refined(grid, o, d, front, behind, step):
    """Planar z of the trilinear zero crossing, from positive to negative, near front..behind; NaN without one.

    At front and behind the nearest voxel is positive and negative, so the crossing can be up to a step outside this interval.
    """
    before = read(grid, o[0] + d[0] * front, o[1] + d[1] * front, o[2] + d[2] * front)
    if not before > 0.0:
        front -= step
        before = read(grid, o[0] + d[0] * front, o[1] + d[1] * front, o[2] + d[2] * front)
    after = read(grid, o[0] + d[0] * behind, o[1] + d[1] * behind, o[2] + d[2] * behind)
    if after > 0.0:
        front, before = behind, after
        behind += step
        after = read(grid, o[0] + d[0] * behind, o[1] + d[1] * behind, o[2] + d[2] * behind)
    if not (before > 0.0 and after <= 0.0):
        return np.nan
    for _ in range(4):
        middle = front + (behind - front) * before / (before - after)
        m = read(grid, o[0] + d[0] * middle, o[1] + d[1] * middle, o[2] + d[2] * middle)
        if abs(m) < 1e-6:
            return middle
        if m > 0.0:
            front, before = middle, m
        elif m < 0.0:
            behind, after = middle, m
        else:
            return np.nan
    return front + (behind - front) * before / (before - after)


@njit(cache=True)
def _first_crossing(grid, o, d, start, far, voxel):
    """Planar z where the ray o + d z (voxels) enters a surface from the front; NaN without one.

    Missing blocks are skipped. In free space the step is the distance stored in the nearest voxel.
    """
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    z, front = start, -1.0
    while z < far:
        x, y, w = o[0] + d[0] * z + 0.5, o[1] + d[1] * z + 0.5, o[2] + d[2] * z + 0.5
        i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(w))
        row = row_of(grid, i >> 3, j >> 3, k >> 3)
        if row == 0:
            front = -1.0
            z += _leave_block(x, y, w, d[0], d[1], d[2])
            continue
        at = (i & 7) * 64 + (j & 7) * 8 + (k & 7)
        step = 1.0
        if grid.weight[row, at] > 0:
            f = grid.tsdf[row, at]
            if f > 0.0:
                front, step = z, max(1.0, 0.8 * f / voxel)
            elif front >= 0.0:
                hit = _refined(grid, o, d, front, z, 1.0 / length)
                if not math.isnan(hit):
                    return hit
                front = -1.0
        z += step / length
    return np.nan


@njit(cache=True, parallel=True)
def trace(grid, K, R, t, voxel, tile, near, far, depth, normals, colour):
    """First crossing from front to back along each pixel's ray; without one the outputs are unchanged.

    R, t are T_world_camera; near, far: per tile, from `ranges`. normals (h, w, 3) are in the camera's frame. normals and
    colour (h, w, channels) are not computed if they are empty.
    """
    for v in prange(depth.shape[0]):
        o, d, q, g = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        for u in range(depth.shape[1]):
            x, y = (u - K[2]) / K[0], (v - K[3]) / K[1]
            for a in range(3):
                o[a] = t[a] / voxel
                d[a] = (R[a, 0] * x + R[a, 1] * y + R[a, 2]) / voxel
            first, last = max(near[v // tile, u // tile], 4.0 * voxel), far[v // tile, u // tile]
            z = _first_crossing(grid, o, d, first, last, voxel)
            if math.isnan(z):
                continue
            depth[v, u] = z
            for a in range(3):
                q[a] = o[a] + d[a] * z
            if normals.size:
                gradient(grid, q[0], q[1], q[2], g)
                for a in range(3):
                    normals[v, u, a] = R[0, a] * g[0] + R[1, a] * g[1] + R[2, a] * g[2]
            if colour.size:
                read_colour(grid, q[0], q[1], q[2], colour[v, u])
