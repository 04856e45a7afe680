"""Triangle mesh of a sequence in any TUM-like format and a trajectory: its images are fused, and
the volume is meshed.

Marching cubes (W. Lorensen, H. Cline, SIGGRAPH 1987) over blocks, compiled: first triangles by the
keys of their edges, then vertices by key. The 256 cases are computed. On each face one line
separates every run of inside corners, so two cubes that share a face always agree, and the surface
has no holes at ambiguous faces.

Corner n of a cube is at (n >> 2, n >> 1 & 1, n & 1); edge 3 n + axis starts at corner n towards
+axis. A cube belongs to the block of its lowest corner. The key of an edge is ((i n + j) n + k) 3 +
axis, where (i, j, k) is its start voxel, relative to a corner below all blocks, and n = 2^19. A
vertex shared by several cubes therefore has one key.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from iclnuim.dataset.frames import ImagePair
from iclnuim.dataset.layout import SequenceCamera
from iclnuim.errors import InputError
from iclnuim.evaluation.associate import AssociationSettings, associate
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, frame_slice, sample
from numba import njit, prange

from ..odometry.run import Sequence
from .kernels import UNIT, row_of
from .settings import FuseSettings
from .volume import BlockLimitError, Volume

SIDE = 1 << 19
#: Corners around each face, counter-clockwise as seen from outside.
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def edge(one: int, two: int) -> int:
    """The edge between two neighbouring corners."""
    return 3 * min(one, two) + {4: 0, 2: 1, 1: 2}[one ^ two]


def loops(case: int) -> list[list[int]]:
    """Closed loops of intersected edges that separate the inside corners (bits of `case`) from the
    others.
    """
    following = {}
    for face in FACES:
        inside = [bool(case >> corner & 1) for corner in face]
        for i in range(4):
            if inside[i] or not inside[(i + 1) % 4]:
                continue
            run = next(n for n in range(1, 4) if not inside[(i + 1 + n) % 4])
            entered, left = (
                edge(face[i], face[(i + 1) % 4]),
                edge(face[(i + run) % 4], face[(i + run + 1) % 4]),
            )
            following[entered] = left
    found = []
    while following:
        loop = [next(iter(following))]
        while following[loop[-1]] != loop[0]:
            loop.append(following.pop(loop[-1]))
        del following[loop[-1]]
        found.append(loop)
    return found


def case_table() -> tuple[np.ndarray, np.ndarray]:
    """(count (256,), edges (256, max, 3)) int8: number of triangles of each case, and the edges of
    their vertices.

    Loops are triangulated as fans; normals point away from the inside.
    """
    cases = [
        [(loop[0], *loop[i : i + 2]) for loop in loops(case) for i in range(1, len(loop) - 1)]
        for case in range(256)
    ]
    count = np.array([len(c) for c in cases], np.int8)
    edges = np.zeros((256, count.max(), 3), np.int8)
    for case, found in enumerate(cases):
        edges[case, : len(found)] = np.array(found, np.int8).reshape(-1, 3)
    return count, edges


COUNT, EDGES = case_table()


@njit(cache=True)
def _cubes(grid, row, min_weight, leaves, edges, count, low, keys):
    """The triangles of a block's cubes, written to keys (n, 3) unless that is empty. Returns their
    number.

    A cube is used if all its corners have at least min_weight, and one of them is in a row that
    leaves.
    """
    a0, b0, c0 = grid.place[row, 0], grid.place[row, 1], grid.place[row, 2]
    near, found, any_leaves = np.empty(8, np.int64), 0, False
    for n in range(8):
        near[n] = row_of(grid, a0 + (n >> 2), b0 + (n >> 1 & 1), c0 + (n & 1))
        any_leaves = any_leaves or leaves[near[n]]
    if not any_leaves:
        return 0
    for at in range(512):
        i, j, k = at >> 6, at >> 3 & 7, at & 7
        case, whole, mine = 0, True, False
        for n in range(8):
            x, y, z = i + (n >> 2), j + (n >> 1 & 1), k + (n & 1)
            other = near[(x >> 3) * 4 + (y >> 3) * 2 + (z >> 3)]
            place = (x & 7) * 64 + (y & 7) * 8 + (z & 7)
            if other == 0 or grid.weight[other, place] < min_weight:
                whole = False
                break
            mine = mine or leaves[other]
            case |= (1 << n) if grid.tsdf[other, place] <= 0.0 else 0
        if not (whole and mine):
            continue
        if keys.shape[0]:
            for m in range(count[case]):
                for e in range(3):
                    edge = edges[case, m, e]
                    n = edge // 3
                    x = (a0 - low[0]) * 8 + i + (n >> 2)
                    y = (b0 - low[1]) * 8 + j + (n >> 1 & 1)
                    z = (c0 - low[2]) * 8 + k + (n & 1)
                    keys[found + m, e] = ((x * SIDE + y) * SIDE + z) * 3 + edge % 3
        found += count[case]
    return found


@njit(cache=True, parallel=True)
def list_triangles(grid, rows, min_weight, leaves, edges, count, low, start, keys, totals):
    """Write the number of triangles of each block r to totals (rows,), and the triangles to keys
    (n, 3) from start[r] to start[r + 1],
    unless that is empty."""
    for r in prange(rows.shape[0]):
        part = keys[start[r] : start[r + 1]]
        totals[r] = _cubes(grid, rows[r], min_weight, leaves, edges, count, low, part)


@njit(cache=True, parallel=True)
def place_vertices(grid, keys, low, voxel, points, colours):
    """Write the zero crossing of the distance on each edge to points, and its colour (mean of the
    ends that have one) to colours.
    """
    channels = grid.colour.shape[2] - 1
    for v in prange(keys.shape[0]):
        axis, rest = keys[v] % 3, keys[v] // 3
        p = np.empty(3, np.int64)
        p[0] = rest // (SIDE * SIDE) + low[0] * 8
        p[1], p[2] = rest // SIDE % SIDE + low[1] * 8, rest % SIDE + low[2] * 8
        q = p.copy()
        q[axis] += 1
        one = row_of(grid, p[0] >> 3, p[1] >> 3, p[2] >> 3)
        two = row_of(grid, q[0] >> 3, q[1] >> 3, q[2] >> 3)
        i = (p[0] & 7) * 64 + (p[1] & 7) * 8 + (p[2] & 7)
        j = (q[0] & 7) * 64 + (q[1] & 7) * 8 + (q[2] & 7)
        f, g = grid.tsdf[one, i], grid.tsdf[two, j]
        share = f / (f - g)
        for a in range(3):
            points[v, a] = p[a] * voxel
        points[v, axis] += share * voxel
        if channels:
            w = (1 - share) if grid.colour[one, i, channels] else 0.0
            x = share if grid.colour[two, j, channels] else 0.0
            for c in range(channels):
                mixed = w * grid.colour[one, i, c] + x * grid.colour[two, j, c]
                colours[v, c] = (
                    np.uint8(min(mixed / (256 * (w + x)) + 0.5, 255.0)) if w + x > 0 else 0
                )


@dataclass(frozen=True, eq=False)
class Mesh:
    """points (n, 3) in metres, triangles (m, 3) counter-clockwise from free space, colours (n, 3)
    uint8 or (n, 0).
    """

    points: np.ndarray
    triangles: np.ndarray
    colours: np.ndarray

    @classmethod
    def joined(cls, parts: "list[Mesh]") -> "Mesh":
        """One mesh; vertices of different parts are not merged."""
        if not parts:
            return cls(
                np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.uint8)
            )
        starts = np.cumsum([0, *(len(part.points) for part in parts)])
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate(
                [part.triangles + start for part, start in zip(parts, starts, strict=False)]
            ),
            np.concatenate([part.colours for part in parts]),
        )


def extract(volume: Volume, leaves: np.ndarray | None = None, min_weight: float = 0.25) -> Mesh:
    """Marching cubes over all blocks, or over the cubes with a corner in the rows where `leaves`
    (rows,) is true.

    Parts that are meshed when they leave and parts that are meshed later therefore join without
    gaps and overlaps. A cube is used if all its corners have at least `min_weight` frames; slanted
    views, and voxels behind the surface, have smaller weights.
    """
    grid, rows = volume.grid, volume.rows()
    leaves = np.ones(len(grid.place), bool) if leaves is None else leaves
    if not len(rows):
        return Mesh.joined([])
    low = grid.place[rows].min(axis=0).astype(np.int64)
    common = (max(1.0, min_weight * UNIT), leaves, EDGES, COUNT, low)
    totals = np.zeros(len(rows), np.int64)
    list_triangles(
        grid, rows, *common, np.zeros(len(rows) + 1, np.int64), np.empty((0, 3), np.int64), totals
    )
    rows, totals = rows[totals > 0], totals[totals > 0]
    start = np.concatenate([[0], np.cumsum(totals)])
    keys = np.empty((start[-1], 3), np.int64)
    list_triangles(grid, rows, *common, start, keys, totals)
    unique, corners = np.unique(keys, return_inverse=True)
    points = np.empty((len(unique), 3), np.float32)
    colours = np.zeros((len(unique), volume.settings.channels), np.uint8)
    place_vertices(grid, unique, low, volume.settings.voxel_m, points, colours)
    if colours.shape[1] == 1:
        colours = np.repeat(colours, 3, axis=1)
    return Mesh(points, corners.reshape(-1, 3).astype(np.int32), colours)


# -- a sequence


@dataclass(frozen=True, eq=False)
class FusedSurface:
    """The mesh, in the trajectory's world; the camera that was used; the frames left out, with
    reasons; counts and times.
    """

    mesh: Mesh
    camera: SequenceCamera
    left_out: list[str]
    figures: dict


def fuse_sequence(
    folder: Path | str,
    trajectory: Trajectory,
    settings: FuseSettings | None = None,
    progress: Callable | None = None,
    camera: SequenceCamera | None = None,
) -> FusedSurface:
    """Fuse all images that have a pose. `progress(total, label)` returns an object with advance();
    camera: by default the folder's.

    Raises InputError if there is nothing to fuse, BlockLimitError if one frame needs more than
    max_blocks.
    """
    if not isinstance(trajectory, Trajectory):
        hint = "iclnuim.read_trajectory(file).trajectory"
        raise InputError("a Trajectory", found=type(trajectory).__name__, hint=hint)
    settings, sequence = settings or FuseSettings(), Sequence(folder, camera=camera)
    chosen = [sequence.pairs[i] for i in frame_slice(settings.frames, len(sequence))]
    posed, poses = _posed(chosen, trajectory, settings.max_difference_s)
    parts: list[Mesh] = []
    volume = Volume(
        settings.volume,
        lambda volume, leaves: parts.append(extract(volume, leaves, settings.min_weight)),
    )
    bar = progress(len(posed), "fuse") if progress else None
    without = [p.stamp_s for p in chosen if p not in set(posed)]
    left_out = [
        f"{stamp_s:.6f} s: no pose within {settings.max_difference_s} s" for stamp_s in without
    ]
    refused: list[InputError] = []
    started, fusing_s = time.perf_counter(), 0.0
    for i, pair in enumerate(posed):
        try:
            rgb, depth_z_m = sequence.images(pair)
            before = time.perf_counter()
            volume.integrate(depth_z_m, sequence.camera.pinhole, poses[i], rgb)
            fusing_s += time.perf_counter() - before
        except BlockLimitError:
            raise
        except InputError as error:
            left_out.append(f"{pair.stamp_s:.6f} s: {error}")
            refused.append(error)
        if bar:
            bar.advance()
    before = time.perf_counter()
    parts.append(extract(volume, min_weight=settings.min_weight))
    mesh = Mesh.joined([part for part in parts if len(part.triangles)])
    if not len(mesh.triangles):
        raise _no_surface(folder, volume.frames, left_out, refused)
    figures = {
        "frames": volume.frames,
        "left_out": len(left_out),
        "seconds": time.perf_counter() - started,
        "fusing_ms_a_frame": 1e3 * fusing_s / max(volume.frames, 1),
        "meshing_s": time.perf_counter() - before,
        "blocks_at_most": volume.max_used,
        "memory_mb": volume.bytes_used / 1e6,
        "parts_that_left": len(parts) - 1,
        "vertices": len(mesh.points),
        "triangles": len(mesh.triangles),
        "camera": asdict(sequence.camera),
        "settings": asdict(settings),
    }
    return FusedSurface(mesh, sequence.camera, left_out, figures)


def _no_surface(
    folder: Path | str, fused: int, left_out: list[str], refused: list[InputError]
) -> InputError:
    """The error for no surface, with the number of frames left out, and the reason of the first
    whose images were refused, if any was.
    """
    found, hint = f"no triangle in {fused} fused frames", None
    if left_out:
        first = left_out[0]
        if refused:
            first, hint = str(refused[0]).partition("; try ")[0], refused[0].hint
        found += f"; {len(left_out)} left out, the first: {first.removeprefix(f'{folder}/')}"
    return InputError("images that produce a surface", path=folder, found=found, hint=hint)


def _posed(
    pairs: list[ImagePair], trajectory: Trajectory, max_difference_s: float
) -> tuple[list[ImagePair], SE3]:
    """The pairs with a pose near their stamp, and the poses (n,) at their stamps, interpolated
    between neighbouring poses.
    """
    stamps_s = np.array([pair.stamp_s for pair in pairs])
    rule = AssociationSettings("nearest", max_difference_s)
    found = np.unique(associate(trajectory.stamps_s, stamps_s, rule).second) if len(pairs) else []
    if not len(found):
        covered = (
            f"{trajectory.stamps_s[0]:.3f}..{trajectory.stamps_s[-1]:.3f} s"
            if len(trajectory)
            else "no poses"
        )
        images = f"{stamps_s.min():.3f}..{stamps_s.max():.3f} s" if len(pairs) else "none"
        raise InputError("images that have a pose", found=f"poses at {covered}, images at {images}")
    if len(trajectory) == 1:
        return [pairs[i] for i in found], trajectory.T_world_camera[np.zeros(len(found), int)]
    at_s = np.clip(stamps_s[found], trajectory.stamps_s[0], trajectory.stamps_s[-1])
    return [pairs[i] for i in found], sample(trajectory, at_s)
