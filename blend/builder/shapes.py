"""Solid shapes as meshes: rounded boxes, lathes, tubes, frames, sheets of cloth.

Numpy only; lengths in metres.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .mesh import Mesh, grid, join, outward, welded


def steps(count: int, detail: float, least: int = 3) -> int:
    """A number of segments at this level of detail."""
    return max(least, round(count * detail))


def _rounded_axis(
    half: float, radius: float, arcs: int, divisions: int
) -> tuple[np.ndarray, float]:
    """Coordinates across one side of a rounded box: equal angles in the bevel, a holding line, then
    the flat.
    """
    flat = half - radius
    bevel = flat + radius * np.tan(np.linspace(0, np.pi / 4, arcs + 1))
    hold = max(flat - 0.35 * radius, 0.6 * flat)
    inner = np.linspace(-hold, hold, divisions + 1)
    return np.concatenate([-bevel[::-1], inner, bevel]), flat


def rounded_box(
    size: Sequence[float],
    radius: float,
    arcs: int = 1,
    divisions: Sequence[int] = (1, 1, 1),
    tile_m: float = 1.0,
) -> Mesh:
    """A box of `size` (3,) about the origin with rounded edges; the flats are cut into `divisions`
    so that they can be bent.
    """
    halves = np.asarray(size, float) / 2
    radius = min(radius, 0.98 * halves.min())
    axes = [_rounded_axis(h, radius, arcs, d) for h, d in zip(halves, divisions, strict=True)]
    flats = np.array([f for _, f in axes])
    sides = []
    for a in range(3):
        b = (a + 1) % 3
        c = (a + 2) % 3
        p = np.zeros((len(axes[c][0]), len(axes[b][0]), 3))
        p[..., b], p[..., c] = np.meshgrid(axes[b][0], axes[c][0])
        for sign in (-1, 1):
            q = p.copy()
            q[..., a] = sign * halves[a]
            side = grid(q)
            sides.append(side if sign > 0 else side.flipped())
    box = join(sides)
    core = np.clip(box.verts, -flats, flats)
    ray = box.verts - core
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    box = Mesh(core + radius * ray, box.faces, box.uv, box.material)
    return welded(box).box_mapped(tile_m)


def lathe(profile: ArrayLike, segments: int, arc_deg: float = 360.0) -> Mesh:
    """Turn a profile of (radius, z) rows, from bottom to top along the outside, about the z axis; u
    runs round, v along.
    """
    prof = np.asarray(profile, float)
    angle = np.radians(np.linspace(0, arc_deg, segments + 1))
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(prof, axis=0), axis=1))])
    p = np.stack(
        [
            prof[:, :1] * np.cos(angle),
            prof[:, :1] * np.sin(angle),
            np.repeat(prof[:, 1:], len(angle), 1),
        ],
        -1,
    )
    uv = np.stack(np.meshgrid(np.linspace(0, 1, len(angle)), length / max(length[-1], 1e-9)), -1)
    return grid(p, uv)


def smooth_profile(points: ArrayLike, count: int) -> np.ndarray:
    """`count` points along a Catmull-Rom curve through rows of any dimension."""
    p = np.asarray(points, float)
    p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    t = np.linspace(0, len(p) - 3 - 1e-9, count)
    k = t.astype(int)
    s = (t % 1)[:, None]
    a = p[k]
    b = p[k + 1]
    c = p[k + 2]
    d = p[k + 3]
    return 0.5 * (
        2 * b + (c - a) * s + (2 * a - 5 * b + 4 * c - d) * s**2 + (3 * b - a - 3 * c + d) * s**3
    )


def _frames_along(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two normals (k,3) perpendicular to a path, transported along it without twist."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    n = np.cross(tangent[0], [0.0, 0.0, 1.0] if abs(tangent[0, 2]) < 0.9 else [1.0, 0.0, 0.0])
    normals = []
    for t in tangent:
        n = n - (n @ t) * t
        n /= np.linalg.norm(n)
        normals.append(n)
    first = np.array(normals)
    return first, np.cross(tangent, first)


def tube(path: ArrayLike, radius: ArrayLike, sides: int = 8, closed_ends: bool = True) -> Mesh:
    """A round bar along a path (k,3); the radius may change along it; v runs along in metres."""
    path = np.asarray(path, float)
    n, b = _frames_along(path)
    r = np.broadcast_to(np.asarray(radius, float), (len(path),))[:, None, None]
    angle = np.linspace(0, 2 * np.pi, sides + 1)[None, :, None]
    ring = path[:, None] + r * (np.cos(angle) * n[:, None] + np.sin(angle) * b[:, None])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    rows = [ring]
    along = [length]
    if closed_ends:
        ends = [np.repeat(path[i][None, None], sides + 1, 1) for i in (0, -1)]
        rows = [ends[0], ring, ends[1]]
        along = [[0.0], length, [length[-1]]]
    uv = np.stack(np.meshgrid(np.linspace(0, 1, sides + 1), np.concatenate(along)), -1)
    body = grid(np.concatenate(rows), uv)
    return outward(body)


def bar(start: ArrayLike, end: ArrayLike, radius: ArrayLike, sides: int = 8) -> Mesh:
    """A straight tube."""
    return tube(
        np.linspace(np.asarray(start), np.asarray(end), max(2, np.size(radius))), radius, sides
    )


def frame(
    width: float, height: float, profile: Sequence[Sequence[float]], tile_m: float = 0.5
) -> Mesh:
    """A mitred frame in the x-z plane facing -y: profile rows (inset from the outer edge, height
    towards the viewer), from the outer back inwards.
    """
    parts = []
    for turn in range(4):
        w, h = (width, height) if turn % 2 == 0 else (height, width)
        rows = []
        uvs = []
        run = 0.0
        for k, (inset, out) in enumerate(profile):
            run += 0 if k == 0 else float(np.hypot(*np.subtract(profile[k], profile[k - 1])))
            x = w / 2 - inset
            rows.append([[-x, -out, -(h / 2 - inset)], [x, -out, -(h / 2 - inset)]])
            uvs.append([[run / tile_m, (w / 2 - x) / tile_m], [run / tile_m, (w / 2 + x) / tile_m]])
        side = grid(np.array(rows), np.array(uvs) + 0.37 * turn)
        parts.append(side.turned("y", 90.0 * turn))
    return welded(join(parts))


def sheet(points: np.ndarray, thickness: float, uv: np.ndarray | None = None) -> Mesh:
    """Cloth or leaf: a surface (m,n,3) given a thickness along its normals, with closed rims."""
    du = np.gradient(points, axis=1)
    dv = np.gradient(points, axis=0)
    normal = np.cross(du, dv)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    top = points + normal * thickness / 2
    low = points - normal * thickness / 2
    front = grid(top, uv)
    back = grid(low, uv).flipped()
    rim_top = np.concatenate([top[0, :-1], top[:-1, -1], top[-1, :0:-1], top[:0:-1, 0], top[:1, 0]])
    rim_low = np.concatenate([low[0, :-1], low[:-1, -1], low[-1, :0:-1], low[:0:-1, 0], low[:1, 0]])
    rim = grid(np.stack([rim_low, rim_top]))
    if uv is not None:
        rim = Mesh(
            rim.verts, rim.faces, np.full_like(rim.uv, float(uv.reshape(-1, 2)[0, 0])), rim.material
        )
    return outward(welded(join([front, back, rim])))


def ripples(
    points: np.ndarray, rng: np.random.Generator, wavelength: float, waves: int = 12
) -> np.ndarray:
    """Smooth noise (N,) of unit size at points (N,3): a sum of random plane waves around one
    wavelength (metres).
    """
    direction = rng.normal(size=(waves, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    k = direction * (2 * np.pi / wavelength) * rng.uniform(0.6, 1.5, (waves, 1))
    phase = rng.uniform(0, 2 * np.pi, waves)
    return np.sin(points @ k.T + phase).sum(1) * np.sqrt(2 / waves)
