"""The compiled loops that fuse a depth image: allocation of the blocks near it, and the running
means in them.

Each block is written by one thread only, so results do not depend on the number of threads.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import prange

from ..compiled import compiled
from .grid import UNIT, CameraPose, Grid, Rule

#: If the distance along the normal is more than this share of the distance along z, the nearest
#: point of the surface counts as observed.
STEEP = 0.9


#: Number of parts of the blocks that threads fuse; results do not depend on it.
_PARTS = 64
Intrinsics: TypeAlias = tuple[float, float, float, float]


class Pool(NamedTuple):
    """free (rows,) int32: a stack of free rows; listed (rows,) int32: the rows that the current
    frame needs; seen (rows,) int32: the last frame in which a row was listed; state (3,) int64:
    number of free rows, number of listed rows, and the current frame.
    """

    free: np.ndarray
    listed: np.ndarray
    seen: np.ndarray
    state: np.ndarray


@compiled()
def touch(grid: Grid, inverse: np.ndarray, camera: CameraPose, rule: Rule, pool: Pool) -> int:
    """List the blocks within the truncation distance of a measured depth, and allocate missing
    ones. Every second pixel of every second row is used. Returns the number of blocks that could
    not be allocated.

    In one function: numba's code is several times slower if the inner loop calls another one.
    """
    n_free = pool.state[0]
    frame = pool.state[2] + 1
    n_listed = 0
    lost = 0
    size = 8.0 * rule.voxel
    step = 2.0 * rule.voxel
    count = grid.slots.shape[0]
    for v in range(0, inverse.shape[0], 2):
        for u in range(0, inverse.shape[1], 2):
            if inverse[v, u] <= 0.0:
                continue
            measured = 1.0 / inverse[v, u]
            z = max(measured - rule.trunc, step)
            last = measured + rule.trunc + rule.voxel
            dx, dy, dz = _direction(camera, u, v)
            while z < last:
                # + 1 / 16: the block of the nearest voxel, which is up to half a voxel away
                a = int(math.floor((camera.t[0] + dx * z) / size + 1 / 16))
                b = int(math.floor((camera.t[1] + dy * z) / size + 1 / 16))
                c = int(math.floor((camera.t[2] + dz * z) / size + 1 / 16))
                z += step
                i = a - grid.first[0]
                j = b - grid.first[1]
                k = c - grid.first[2]
                if i < 0 or j < 0 or k < 0 or i >= count or j >= count or k >= count:
                    continue
                slot = (a & (count - 1), b & (count - 1), c & (count - 1))
                row = grid.slots[slot]
                if row == 0:
                    if n_free == 0:
                        lost += 1
                        continue
                    n_free -= 1
                    row = pool.free[n_free]
                    grid.slots[slot] = row
                    grid.place[row, 0] = a
                    grid.place[row, 1] = b
                    grid.place[row, 2] = c
                elif pool.seen[row] == frame:
                    continue
                pool.seen[row] = frame
                pool.listed[n_listed] = row
                n_listed += 1
    pool.state[:] = (n_free, n_listed, frame)
    return lost


@compiled(inline="always")
def _direction(camera: CameraPose, u: int, v: int) -> tuple[float, float, float]:
    """The ray of a pixel in the world, with z = 1 in the camera's frame."""
    x = (u - camera.K[2]) / camera.K[0]
    y = (v - camera.K[3]) / camera.K[1]
    R = camera.R
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2],
        R[1, 0] * x + R[1, 1] * y + R[1, 2],
        R[2, 0] * x + R[2, 1] * y + R[2, 2],
    )


# The functions `_project`, `_gather`, `_measure` and `_average` are loops over a layer of 64 voxels
# without branches (`x if c else y` chooses between known values), so that they are vectorized. They
# share a Layer.

U, V, Z, INSIDE, FOUND, DISTANCE, MORE = range(7)


class Layer(NamedTuple):
    """64 voxels of a block. value (7, 64): column, row and depth in the image, whether it is inside
    the image, the inverse depth found there, the distance to the surface, and the weight of this
    observation. corner (4, 64): the inverse depth of the four pixels around it. pixel (64,): index
    of the pixel above and to the left.
    """

    value: np.ndarray
    corner: np.ndarray
    pixel: np.ndarray


@compiled(inline="always")
def _continues(
    inverse: np.ndarray,
    K: Intrinsics,
    at: tuple[float, float, float],
    found: float,
    n: tuple[float, float, float],
    trunc: float,
) -> bool:
    """Whether the surface is observed at the point of its tangent plane n that is nearest to the
    point with pixel and depth `at`.

    Beyond the edge of an object its tangent plane continues, but the surface was not observed
    there.
    """
    fx, fy, cx, cy = K
    u, v, z = at
    along = (1.0 - z * found) / (n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    depth = z + along * n[2]
    i = int(((v - cy) * z + fy * along * n[1]) / depth + cy + 0.5)
    j = int(((u - cx) * z + fx * along * n[0]) / depth + cx + 0.5)
    if not (depth > 0.0 and 0 <= i < inverse.shape[0] and 0 <= j < inverse.shape[1]):
        return False
    plane = found + (j - u) * n[0] / fx + (i - v) * n[1] / fy
    seen = inverse[i, j]
    return abs(plane - seen) <= trunc * plane * seen


@compiled()
def _colour(image: np.ndarray, trunc: float, layer: Layer, colour: np.ndarray) -> None:
    """Add a sample, bilinear, to the running mean of each observed voxel near the surface, colour
    (64, channels + 1), whose last channel is the count.
    """
    last = colour.shape[1] - 1
    one = np.uint64(1)
    for m in range(64):
        if not (layer.value[MORE, m] > 0.0 and layer.value[DISTANCE, m] < trunc):
            continue
        u = layer.value[U, m]
        v = layer.value[V, m]
        p = v - int(v)
        q = u - int(u)
        i = np.uint64(int(v))
        j = np.uint64(int(u))
        n = float(colour[m, last])
        for c in range(last):
            upper = (1 - q) * image[i, j, c] + q * image[i, j + one, c]
            lower = (1 - q) * image[i + one, j, c] + q * image[i + one, j + one, c]
            seen = 256.0 * ((1 - p) * upper + p * lower)
            colour[m, c] = np.uint16((float(colour[m, c]) * n + seen) / (n + 1.0) + 0.5)
        colour[m, last] = np.uint16(min(n + 1.0, 255.0))


@compiled(error_model="numpy", inline="always")
def _project(
    corner: tuple[int, int, int],
    voxel: float,
    camera: CameraPose,
    shape: tuple[int, ...],
    layer: Layer,
) -> None:
    """Write the pixel columns, rows and depths of the 8 x 8 voxels along j and k from `corner`, and
    the index of the pixel above and to the left; 0 if the voxel is not inside the image. camera:
    T_camera_world.
    """
    fx, fy, cx, cy = camera.K[0], camera.K[1], camera.K[2], camera.K[3]
    r00, r01, r02 = camera.R[0, 0], camera.R[0, 1], camera.R[0, 2]
    r10, r11, r12 = camera.R[1, 0], camera.R[1, 1], camera.R[1, 2]
    r20, r21, r22 = camera.R[2, 0], camera.R[2, 1], camera.R[2, 2]
    t0, t1, t2 = camera.t[0], camera.t[1], camera.t[2]
    last_row = float(shape[0] - 1)
    last_column = float(shape[1] - 1)
    px = corner[0] * voxel
    for n in range(64):
        py = (corner[1] + (n >> 3)) * voxel
        pz = (corner[2] + (n & 7)) * voxel
        depth = r20 * px + r21 * py + r22 * pz + t2
        u = fx * (r00 * px + r01 * py + r02 * pz + t0) / depth + cx
        v = fy * (r10 * px + r11 * py + r12 * pz + t1) / depth + cy
        inside = (depth > voxel) & (u >= 0.0) & (v >= 0.0) & (u < last_column) & (v < last_row)
        u = u if inside else 0.0
        v = v if inside else 0.0
        layer.value[U, n] = u
        layer.value[V, n] = v
        layer.value[Z, n] = depth
        layer.value[INSIDE, n] = 1.0 if inside else 0.0
        layer.pixel[n] = np.int32(v) * shape[1] + np.int32(u)


@compiled(inline="always")
def _gather(inverse: np.ndarray, width: int, layer: Layer) -> None:
    """The inverse depth of the four pixels around each voxel; inverse: the image in one row."""
    one = np.uint64(1)
    for n in range(64):
        at = np.uint64(layer.pixel[n])  # unsigned indices need no check for negative values
        below = at + np.uint64(width)
        layer.corner[0, n] = inverse[at]
        layer.corner[1, n] = inverse[at + one]
        layer.corner[2, n] = inverse[below]
        layer.corner[3, n] = inverse[below + one]


@compiled(inline="always")
def _tangent(
    K: Intrinsics,
    u: float,
    v: float,
    found: float,
    corner: tuple[float, float, float, float],
) -> tuple[float, float, float]:
    """n of the tangent plane n . point = 1, from the horizontal and vertical gradient of the
    inverse depth, which on a plane is n . ray.
    """
    a, b, c, d = corner
    across = 0.5 * (b - a + d - c)
    down = 0.5 * (c - a + d - b)
    return K[0] * across, K[1] * down, found - (u - K[2]) * across - (v - K[3]) * down


@compiled(error_model="numpy", inline="always")
def _measure(K: Intrinsics, rule: Rule, layer: Layer) -> None:
    """The distance of each voxel to the surface, and the weight of this observation; 0 without one.

    Rules: see `fuse`.
    """
    trunc = rule.trunc
    behind = rule.behind
    narrow = behind < trunc
    deepest = rule.slanted * trunc if narrow else trunc
    for n in range(64):
        u = layer.value[U, n]
        v = layer.value[V, n]
        a, b = layer.corner[0, n], layer.corner[1, n]
        c, d = layer.corner[2, n], layer.corner[3, n]
        p = v - np.floor(v)
        q = u - np.floor(u)
        ab = a if a > b else b
        cd = c if c > d else d
        near = ab if ab > cd else cd
        ab = a if a < b else b
        cd = c if c < d else d
        far = ab if ab < cd else cd
        jumps = near - far > trunc * near * far
        upper = b if q >= 0.5 else a
        lower = d if q >= 0.5 else c
        nearest = float(lower if p >= 0.5 else upper)
        smooth = (1 - p) * ((1 - q) * a + q * b) + p * ((1 - q) * c + q * d)
        found = nearest if jumps else smooth
        distance = 1.0 / found - layer.value[Z, n]
        n0, n1, n2 = _tangent(K, u, v, found, (a, b, c, d))
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
        inside = layer.value[INSIDE, n] > 0.0
        usable = inside & (far > 0.0) & (distance >= -deepest) & (more >= 1.0)
        layer.value[DISTANCE, n] = normal
        layer.value[FOUND, n] = found
        layer.value[MORE, n] = more if usable else 0.0


@compiled(error_model="numpy", inline="always")
def _average(tsdf: np.ndarray, weight: np.ndarray, rule: Rule, layer: Layer) -> None:
    """Update the running means of a layer, tsdf and weight (64,)."""
    trunc = rule.trunc
    free = np.float32(trunc)
    for n in range(64):
        old = tsdf[n]
        w = float(weight[n])
        distance = layer.value[DISTANCE, n]
        more = layer.value[MORE, n]
        mean = np.float32((old * w + more * (distance if distance < trunc else trunc)) / (w + more))
        changes = (more > 0.0) & ((distance < trunc) | (old != free))
        tsdf[n] = mean if changes else old
        total = w + more
        weight[n] = np.uint16(total if total < rule.max_weight else rule.max_weight)


@compiled(error_model="numpy")
def _drop_unseen(inverse: np.ndarray, K: Intrinsics, trunc: float, layer: Layer) -> None:
    """Set the weight of voxels behind a slanted surface to 0 unless the surface continues to the
    point nearest to the voxel.
    """
    for m in range(64):
        if not (layer.value[MORE, m] > 0.0 and layer.value[DISTANCE, m] < 0.0):
            continue
        a, b = layer.corner[0, m], layer.corner[1, m]
        c, d = layer.corner[2, m], layer.corner[3, m]
        near = max(a, b, c, d)
        far = min(a, b, c, d)
        if near - far > trunc * near * far:
            continue
        at = (layer.value[U, m], layer.value[V, m], layer.value[Z, m])
        found = layer.value[FOUND, m]
        n = _tangent(K, at[0], at[1], found, (a, b, c, d))
        size2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
        is_steep = found / math.sqrt(size2) < STEEP
        if is_steep and not _continues(inverse, K, at, found, n, trunc):
            layer.value[MORE, m] = 0.0


@compiled(error_model="numpy")
def _fuse_blocks(
    grid: Grid,
    rows: np.ndarray,
    inverse: np.ndarray,
    image: np.ndarray,
    camera: CameraPose,
    rule: Rule,
) -> None:
    """`fuse` of some blocks.

    In a function: in a parallel loop numba drops assignments to the arrays of a tuple.
    """
    layer = Layer(np.empty((7, 64)), np.empty((4, 64), np.float32), np.empty(64, np.int32))
    flat = inverse.ravel()
    K = (camera.K[0], camera.K[1], camera.K[2], camera.K[3])
    continued = rule.slanted > 1 and rule.behind < rule.trunc
    for row in rows:
        place = grid.place[row]
        for i in range(8):
            part = slice(64 * i, 64 * i + 64)
            corner = (place[0] * 8 + i, place[1] * 8, place[2] * 8)
            _project(corner, rule.voxel, camera, inverse.shape, layer)
            _gather(flat, inverse.shape[1], layer)
            _measure(K, rule, layer)
            if continued:
                _drop_unseen(inverse, K, rule.trunc, layer)
            _average(grid.tsdf[row, part], grid.weight[row, part], rule, layer)
            if image.shape[0] > 1:
                _colour(image, rule.trunc, layer, grid.colour[row, part])
        found = False
        for n in range(512):
            found = found | ((grid.weight[row, n] > 0) & (grid.tsdf[row, n] <= 0.0))
        grid.inside[row] = found


@compiled(parallel=True)
def fuse(
    grid: Grid,
    inverse: np.ndarray,
    image: np.ndarray,
    camera: CameraPose,
    rule: Rule,
    rows: np.ndarray,
) -> None:
    """Update the running mean of the truncated distance in the listed blocks, and whether a voxel
    of them is behind a surface; camera: T_camera_world.

    Inverse depth is bilinear (exact on planes), or that of the nearest pixel at depth edges.
    Distances are along z, from `trunc` in front of the surface to `trunc` behind it. With a smaller
    `behind` they are along the normal; the weight is smaller where the surface is slanted or a
    depth edge, and decreases to 0 at that distance behind it. With `slanted` above 1, slanted
    surfaces are fused up to `slanted` times `trunc` along z behind them, where the surface
    continues. image: (h, w, channels), or (1, 1, channels) for none.
    """
    for part in prange(_PARTS):
        _fuse_blocks(grid, rows[part::_PARTS], inverse, image, camera, rule)
