"""The compiled loops of the volume: memory layout of the voxels, fusion of a depth image, and
raycasting.

Blocks of 8^3 voxels are stored in a cyclic index. Voxel (i, j, k) has its centre at (i, j, k)
voxel_m in the world; its block is (i >> 3, j >> 3, k >> 3). The index is a cube of n^3 slots, n a
power of two; block b is in slot b modulo n. Only blocks inside the window that starts at `first`
are stored, so that no two share a slot. Row 0 means "no block".

Each block and each pixel is written by one thread only, so results do not depend on the number of
threads. K is (fx, fy, cx, cy).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

#: The weight that a frame adds on its surface and in front of it.
UNIT = 16.0
#: If the distance along the normal is more than this share of the distance along z, the nearest
#: point of the surface counts as observed.
STEEP = 0.9


class Grid(NamedTuple):
    """first (3,) int64: lowest block of the window; slots (n, n, n) int32 rows; place (rows, 3)
    int32 block of a row;
    tsdf (rows, 512) float32 metres; weight (rows, 512) uint16; colour (rows, 512, channels + 1)
    uint16: mean times 256, and the count behind it; inside (rows,) bool: whether a voxel of the
    block is behind a surface.
    """

    first: np.ndarray
    slots: np.ndarray
    place: np.ndarray
    tsdf: np.ndarray
    weight: np.ndarray
    colour: np.ndarray
    inside: np.ndarray


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
    high = (1 - q) * ((1 - s) * f[at + 64] + s * f[at + 65]) + q * (
        (1 - s) * f[at + 72] + s * f[at + 73]
    )
    return (1 - p) * low + p * high


@njit(cache=True)
def read_colour(grid, x, y, z, out):
    """Write to out (channels,) the trilinear colour of those of the eight voxels that have one;
    unchanged if none has.
    """
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
    """Write to out (3,) the unit gradient by central differences over one voxel to each side; NaN
    at the border of the observed region.
    """
    out[0] = read(grid, x + 1, y, z) - read(grid, x - 1, y, z)
    out[1] = read(grid, x, y + 1, z) - read(grid, x, y - 1, z)
    out[2] = read(grid, x, y, z + 1) - read(grid, x, y, z - 1)
    size = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    for a in range(3):
        out[a] = out[a] / size if size > 0 else np.nan


# -- fusion: allocation of the blocks near a depth image, and the running means in them


@njit(cache=True)
def touch(grid, inverse, K, R, t, voxel, reach, stride, stamp, frame, free, n_free, rows):
    """List in `rows` the blocks within `reach` of a measured depth, and allocate missing ones; R, t
    are T_world_camera.

    Every stride-th pixel is used. Returns (number of listed rows, number of free rows, number of
    blocks that could not be allocated).
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
def _continues(inverse, K, u, v, z, found, n, size2, trunc):
    """Whether the surface is observed at the point of its tangent plane (n of squared length size2)
    that is nearest to the point at (u, v, z).

    Beyond the edge of an object its tangent plane continues, but the surface was not observed
    there.
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
def _colour(image, u, v, colour, at):
    """Add a sample, bilinear at column u and row v, to the running mean colour[at] (channels + 1,),
    whose last channel is the count.
    """
    last, one = colour.shape[1] - 1, np.uint64(1)
    p, q, i, j = v - int(v), u - int(u), np.uint64(int(v)), np.uint64(int(u))
    n = float(colour[at, last])
    for c in range(last):
        upper = (1 - q) * image[i, j, c] + q * image[i, j + one, c]
        lower = (1 - q) * image[i + one, j, c] + q * image[i + one, j + one, c]
        seen = 256.0 * ((1 - p) * upper + p * lower)
        colour[at, c] = np.uint16((float(colour[at, c]) * n + seen) / (n + 1.0) + 0.5)
    colour[at, last] = np.uint16(min(n + 1.0, 255.0))


# The next four functions are loops over a layer of 64 voxels without branches (`x if c else y`
# chooses between known values), so that they are vectorized. They share `layer`, one row for each
# of the following values, `pixel`, and `corners`, the four pixels around each voxel.

U, V, Z, INSIDE, FOUND, DISTANCE, MORE = range(7)


@njit(cache=True, error_model="numpy", inline="always")
def _project(x, y, z, voxel, K, R, t, height, width, layer, pixel):
    """Pixel columns, rows and depths of the 8 x 8 voxels of a block's layer along j and k, from (x,
    y, z) in voxels, and the index of
    the pixel above and to the left; 0 if the voxel is not inside the image."""
    r00, r01, r02, r10, r11, r12 = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2]
    r20, r21, r22, t0, t1, t2 = R[2, 0], R[2, 1], R[2, 2], t[0], t[1], t[2]
    px, last_row, last_column = x * voxel, float(height - 1), float(width - 1)
    for n in range(64):
        py, pz = (y + (n >> 3)) * voxel, (z + (n & 7)) * voxel
        depth = r20 * px + r21 * py + r22 * pz + t2
        u = K[0] * (r00 * px + r01 * py + r02 * pz + t0) / depth + K[2]
        v = K[1] * (r10 * px + r11 * py + r12 * pz + t1) / depth + K[3]
        inside = (depth > voxel) & (u >= 0.0) & (v >= 0.0) & (u < last_column) & (v < last_row)
        u, v = u if inside else 0.0, v if inside else 0.0
        layer[U, n], layer[V, n], layer[Z, n], layer[INSIDE, n] = (
            u,
            v,
            depth,
            1.0 if inside else 0.0,
        )
        pixel[n] = np.int32(v) * width + np.int32(u)


@njit(cache=True, inline="always")
def _gather(inverse, width, pixel, corners):
    """The inverse depth of the four pixels around each voxel."""
    for n in range(64):
        at = np.uint64(pixel[n])  # unsigned indices need no check for negative values
        corners[0, n], corners[1, n] = inverse[at], inverse[at + np.uint64(1)]
        corners[2, n], corners[3, n] = inverse[at + width], inverse[at + width + np.uint64(1)]


@njit(cache=True, inline="always")
def _tangent(K, u, v, found, a, b, c, d):
    """n of the tangent plane n . point = 1, from the horizontal and vertical gradient of the
    inverse depth, which on a plane is n . ray.
    """
    across, down = 0.5 * (b - a + d - c), 0.5 * (c - a + d - b)
    return K[0] * across, K[1] * down, found - (u - K[2]) * across - (v - K[3]) * down


@njit(cache=True, error_model="numpy", inline="always")
def _measure(K, trunc, behind, deepest, narrow, layer, corners):
    """The distance of each voxel to the surface, and the weight of this observation; 0 without one.

    Rules: see `fuse`.
    """
    for n in range(64):
        u, v, z = layer[U, n], layer[V, n], layer[Z, n]
        a, b, c, d = corners[0, n], corners[1, n], corners[2, n], corners[3, n]
        p, q = v - np.floor(v), u - np.floor(u)
        ab, cd = a if a > b else b, c if c > d else d
        near = ab if ab > cd else cd
        ab, cd = a if a < b else b, c if c < d else d
        far = ab if ab < cd else cd
        jumps = near - far > trunc * near * far
        upper, lower = b if q >= 0.5 else a, d if q >= 0.5 else c
        nearest = float(lower if p >= 0.5 else upper)
        smooth = (1 - p) * ((1 - q) * a + q * b) + p * ((1 - q) * c + q * d)
        found = nearest if jumps else smooth
        distance = 1.0 / found - z
        n0, n1, n2 = _tangent(K, u, v, found, a, b, c, d)
        size2 = n0 * n0 + n1 * n1 + n2 * n2
        slant = found / math.sqrt(size2)
        band = narrow & (distance < trunc)
        normal = distance * slant if band & (not jumps) else distance
        share = slant * (1.0 + (normal if normal < 0.0 else 0.0) / behind)
        slanted = np.ceil(UNIT * share)
        beyond = (distance < 0.0) & (
            (distance * found) * (distance * found) >= behind * behind * size2
        )
        slanted = 0.0 if beyond else slanted
        edge = 1.0 if distance > -behind else 0.0
        more = slanted if band else UNIT
        more = edge if narrow & jumps else more
        usable = (layer[INSIDE, n] > 0.0) & (far > 0.0) & (distance >= -deepest) & (more >= 1.0)
        layer[DISTANCE, n], layer[FOUND, n] = normal, found
        layer[MORE, n] = more if usable else 0.0


@njit(cache=True, error_model="numpy", inline="always")
def _average(tsdf, weight, trunc, max_weight, layer):
    """Update the running means of a layer, tsdf and weight (64,)."""
    free = np.float32(trunc)
    for n in range(64):
        old, w, distance, more = tsdf[n], float(weight[n]), layer[DISTANCE, n], layer[MORE, n]
        mean = np.float32((old * w + more * (distance if distance < trunc else trunc)) / (w + more))
        changes = (more > 0.0) & ((distance < trunc) | (old != free))
        tsdf[n] = mean if changes else old
        total = w + more
        weight[n] = np.uint16(total if total < max_weight else max_weight)


@njit(cache=True, inline="always")
def _drop_unseen(inverse, K, trunc, layer, corners, m):
    """Set the weight of a voxel behind a slanted surface to 0 unless the surface continues to the
    point nearest to the voxel.
    """
    u, v, z, found = layer[U, m], layer[V, m], layer[Z, m], layer[FOUND, m]
    a, b, c, d = corners[0, m], corners[1, m], corners[2, m], corners[3, m]
    near, far = max(a, b, c, d), min(a, b, c, d)
    if near - far > trunc * near * far:
        return
    n3 = _tangent(K, u, v, found, a, b, c, d)
    size2 = n3[0] * n3[0] + n3[1] * n3[1] + n3[2] * n3[2]
    if found / math.sqrt(size2) < STEEP and not _continues(
        inverse, K, u, v, z, found, n3, size2, trunc
    ):
        layer[MORE, m] = 0.0


@njit(cache=True)
def _mark_inside(grid, row):
    """Store whether an observed voxel of a block is behind a surface.

    In a function: numba drops this assignment in a parallel loop.
    """
    tsdf, weight, found = grid.tsdf[row], grid.weight[row], False
    for n in range(512):
        found = found | ((weight[n] > 0) & (tsdf[n] <= 0.0))
    grid.inside[row] = found


@njit(cache=True, parallel=True, error_model="numpy")
def fuse(grid, inverse, image, K, R, t, voxel, trunc, behind, slanted, max_weight, rows, n):
    """Update the running mean of the truncated distance in the listed blocks; R, t are
    T_camera_world.

    Inverse depth is bilinear (exact on planes), or that of the nearest pixel at depth edges.
    Distances are along z, from `trunc` in front of the surface to `trunc` behind it. With a smaller
    `behind` they are along the normal; the weight is smaller where the surface is slanted or a
    depth edge, and decreases to 0 at that distance behind it. With `slanted` above 1, slanted
    surfaces are fused up to `slanted` times `trunc` along z behind them, where the surface
    continues. image: (h, w, channels), or (1, 1, channels) for none.
    """
    coloured, narrow = image.shape[0] > 1, behind < trunc
    deepest = slanted * trunc if narrow else trunc
    camera, (height, width), flat = (K[0], K[1], K[2], K[3]), inverse.shape, inverse.ravel()
    for r in prange(n):
        row, layer, corners, pixel = (
            rows[r],
            np.empty((7, 64)),
            np.empty((4, 64), np.float32),
            np.empty(64, np.int32),
        )
        colour, place = grid.colour[row], grid.place[row]
        for i in range(8):
            first = 64 * i
            tsdf, weight = grid.tsdf[row, first : first + 64], grid.weight[row, first : first + 64]
            _project(
                place[0] * 8 + i,
                place[1] * 8,
                place[2] * 8,
                voxel,
                camera,
                R,
                t,
                height,
                width,
                layer,
                pixel,
            )
            _gather(flat, np.uint64(width), pixel, corners)
            _measure(camera, trunc, behind, deepest, narrow, layer, corners)
            if narrow and slanted > 1:
                for m in range(64):
                    if layer[MORE, m] > 0.0 and layer[DISTANCE, m] < 0.0:
                        _drop_unseen(inverse, camera, trunc, layer, corners, m)
            _average(tsdf, weight, trunc, max_weight, layer)
            if coloured:
                for m in range(64):
                    if layer[MORE, m] > 0.0 and layer[DISTANCE, m] < trunc:
                        _colour(image, layer[U, m], layer[V, m], colour, first + m)
        _mark_inside(grid, row)


# -- raycasting: along each ray to the trilinear zero crossing


@njit(cache=True, inline="always")
def _beside(x, z, f, c, size, radius):
    """Whether a sphere at (x, z) is outside one of the two planes through opposite borders of the
    image.
    """
    low, high = c + 0.5, size - 0.5 - c
    return f * x + low * z < -radius * math.hypot(
        f, low
    ) or high * z - f * x < -radius * math.hypot(f, high)


@njit(cache=True)
def ranges(grid, highest, K, R, t, voxel, tile, near, far):
    """Range of planar depth, `near` to `far`, of those blocks of rows 1..highest that are partly
    behind a surface, per tile of the image.

    near, far (h, w): filled with infinity and 0 by the caller. R, t are T_camera_world. A block is
    approximated by its bounding sphere.
    """
    size = 8.0 * voxel
    radius = 0.5 * math.sqrt(3.0) * size
    height, width = near.shape[0] * tile, near.shape[1] * tile
    for row in range(1, highest + 1):
        if not grid.inside[row]:
            continue
        px = grid.place[row, 0] * size + 3.5 * voxel
        py = grid.place[row, 1] * size + 3.5 * voxel
        pz = grid.place[row, 2] * size + 3.5 * voxel
        z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]
        if (
            z < -radius
            or row_of(grid, grid.place[row, 0], grid.place[row, 1], grid.place[row, 2]) != row
        ):
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
            u1 = int(
                min(near.shape[1] - 1.0, (max((u + du) / z, (u + du) / nearest) + K[2]) // tile)
            )
            v1 = int(
                min(near.shape[0] - 1.0, (max((v + dv) / z, (v + dv) / nearest) + K[3]) // tile)
            )
        for i in range(v0, v1 + 1):
            for j in range(u0, u1 + 1):
                near[i, j] = min(near[i, j], nearest)
                far[i, j] = max(far[i, j], z + radius)


@njit(cache=True, inline="always")
def _leave(p, inverse):
    """Distance along a ray to the border of the block of a coordinate p (voxels, shifted by half);
    inverse: 1 / its direction.
    """
    low = 8.0 * math.floor(p * 0.125)
    return ((low + 8.0 if inverse > 0.0 else low) - p) * inverse


@njit(cache=True, inline="always")
def _inverse(d):
    """1 / d, but finite."""
    return 1.0 / (d if abs(d) > 1e-12 else 1e-12)


@njit(cache=True)
def _refined(grid, o, d, front, behind, step):
    """Planar z of the trilinear zero crossing, from positive to negative, near front..behind; NaN
    without one.

    At front and behind the nearest voxel is positive and negative, so the crossing can be up to a
    step outside this interval.
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
    unit, sure = 1.0 / math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), 0.8 / voxel
    ix, iy, iw = _inverse(d[0]), _inverse(d[1]), _inverse(d[2])
    ox, oy, ow, dx, dy, dw = o[0] + 0.5, o[1] + 0.5, o[2] + 0.5, d[0], d[1], d[2]
    z, front = start, -1.0
    while z < far:
        x, y, w = ox + dx * z, oy + dy * z, ow + dw * z
        i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(w))
        row = row_of(grid, i >> 3, j >> 3, k >> 3)
        if row == 0:
            front = -1.0
            z += min(_leave(x, ix), _leave(y, iy), _leave(w, iw)) + 1e-3
            continue
        at = (i & 7) * 64 + (j & 7) * 8 + (k & 7)
        f, step = grid.tsdf[row, at], 1.0
        if f > 0.0:  # 0 in voxels that are not observed
            front, step = z, max(1.0, sure * f)
        elif front >= 0.0 and grid.weight[row, at] > 0:
            hit = _refined(grid, o, d, front, z, unit)
            if not math.isnan(hit):
                return hit
            front = -1.0
        z += step * unit
    return np.nan


@njit(cache=True, parallel=True)
def trace(grid, K, R, t, voxel, trunc, tile, near, far, depth, normals, colour):
    """First crossing from front to back along each pixel's ray; without one the outputs are
    unchanged.

    R, t are T_world_camera; near, far: per tile, from `ranges`. A ray starts `trunc` in front of
    near: no step is longer, so that it enters a surface from free space. normals (h, w, 3) are in
    the camera's frame. normals and colour (h, w, channels) are not computed if they are empty.
    """
    for v in prange(depth.shape[0]):
        o, d, q, g = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        for u in range(depth.shape[1]):
            x, y = (u - K[2]) / K[0], (v - K[3]) / K[1]
            for a in range(3):
                o[a] = t[a] / voxel
                d[a] = (R[a, 0] * x + R[a, 1] * y + R[a, 2]) / voxel
            first, last = (
                max(near[v // tile, u // tile] - trunc, 4.0 * voxel),
                far[v // tile, u // tile],
            )
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
