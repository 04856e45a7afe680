"""Cheap solids for things with many parts: blocks with chamfered edges, lofts, round plates.

Numpy only; metres.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from .mesh import Mesh, cross, grid, outward

Place = Sequence[float]


def loft(rings: Sequence[np.ndarray], closed: bool = True, uv: np.ndarray | None = None) -> Mesh:
    """A closed body through rings (n, 3) of equal count; its ends are flat fans."""
    rows = [np.concatenate([r, r[:1]]) for r in np.asarray(rings, float)]
    if closed:
        rows = [
            np.repeat(rows[0].mean(0)[None], len(rows[0]), 0),
            *rows,
            np.repeat(rows[-1].mean(0)[None], len(rows[0]), 0),
        ]
    body = grid(np.array(rows), uv)
    return outward(body) if closed else body


def rounded_ring(width: float, height: float, radius: float, arcs: int = 3) -> np.ndarray:
    """A rounded rectangle (4 (arcs + 1), 2) about the origin, counter-clockwise."""
    angle = np.radians(np.linspace(0, 90, arcs + 1))
    corner = radius * np.stack([np.cos(angle), np.sin(angle)], 1)
    turned = [corner, corner[:, ::-1] * [-1, 1], -corner, corner[:, ::-1] * [1, -1]]
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    middle = np.array([width / 2 - radius, height / 2 - radius])
    fixed = []
    for k, t in enumerate(turned):
        fixed.append(t if k % 2 == 0 else _quarter(radius, angle, k))
    return np.concatenate([np.array(s) * middle + f for s, f in zip(signs, fixed, strict=True)])


def _quarter(radius: float, angle: np.ndarray, quarter: int) -> np.ndarray:
    a = angle + quarter * np.pi / 2
    return radius * np.stack([np.cos(a), np.sin(a)], 1)


def plate(outline: np.ndarray, low: float, high: float, chamfer: float = 0.0) -> Mesh:
    """A flat body of convex outline (n,2) from z = low to high, its rims chamfered."""
    inner = outline * (1 - chamfer / np.abs(outline).max(0)) if chamfer else outline
    levels = [(inner, low), (outline, low + chamfer), (outline, high - chamfer), (inner, high)]
    levels = levels if chamfer else levels[1:3]
    return loft([np.concatenate([o, np.full((len(o), 1), z)], 1) for o, z in levels])


def block(
    size: Place,
    centre: Place = (0, 0, 0),
    chamfer: float = 0.002,
    tile_m: float = 1.0,
    turn: bool = False,
) -> Mesh:
    """A box with chamfered edges, 44 triangles; texture by projection, its grain along x, or along
    the other axis with turn.
    """
    mesh = _chamfered(tuple(map(float, size)), float(chamfer))
    shift = (0.37 * centre[0] + 0.21 * centre[2], 0.61 * centre[1] + 0.13 * centre[2])
    return mesh.box_mapped(tile_m, shift, turn).moved(*centre)


@functools.lru_cache(maxsize=256)
def _chamfered(size: tuple[float, ...], chamfer: float) -> Mesh:
    """The box about the origin: a keyboard has a hundred of the same."""
    half = np.array(size) / 2
    c = min(chamfer, 0.45 * half.min())
    verts: list[np.ndarray] = []
    faces: list[list[int]] = []
    index: dict[tuple[int, ...], int] = {}
    for signs in np.ndindex(2, 2, 2):
        s = 2 * np.array(signs) - 1
        for axis in range(3):
            index[(*signs, axis)] = len(verts)
            verts.append(s * np.where(np.arange(3) == axis, half, half - c))
    for axis in range(3):
        b = (axis + 1) % 3
        d = (axis + 2) % 3
        for side in (0, 1):
            around = ((0, 0), (1, 0), (1, 1), (0, 1))
            corners = [_corner(axis, side, b, i, d, j) for i, j in around]
            faces.append([index[(*corner, axis)] for corner in corners])
        for i, j in np.ndindex(2, 2):
            ends = [_corner(axis, e, b, i, d, j) for e in (0, 1)]
            faces.append(
                [
                    index[(*ends[0], b)],
                    index[(*ends[1], b)],
                    index[(*ends[1], d)],
                    index[(*ends[0], d)],
                ]
            )
    faces += [[index[(*s, 0)], index[(*s, 1)], index[(*s, 2)], -1] for s in np.ndindex(2, 2, 2)]
    return _away_from_origin(np.array(verts), np.array(faces))


def _corner(axis: int, side: int, b: int, i: int, d: int, j: int) -> tuple[int, ...]:
    signs = [0, 0, 0]
    signs[axis] = side
    signs[b] = i
    signs[d] = j
    return tuple(signs)


def _away_from_origin(verts: np.ndarray, faces: np.ndarray) -> Mesh:
    """A convex mesh about the origin with every face turned outwards."""
    corners = verts[np.where(faces < 0, faces[:, :1], faces)]
    normal = cross(verts[faces[:, 1]] - verts[faces[:, 0]], verts[faces[:, 2]] - verts[faces[:, 0]])
    inwards = np.einsum("ij,ij->i", normal, corners.mean(1)) < 0
    turned = np.where(faces[:, 3:] < 0, faces[:, [0, 2, 1, 3]], faces[:, [0, 3, 2, 1]])
    faces = np.where(inwards[:, None], turned, faces)
    return Mesh(verts, faces, np.zeros((len(faces), 4, 2)), np.zeros(len(faces), int))


def printed(
    centre: Place, across: Place, up: Place, window: Sequence[float] = (0, 0, 1, 1)
) -> Mesh:
    """A rectangle about `centre` spanned by the full vectors across and up, showing the window (u0,
    v0, u1, v1) of an image.
    """
    middle, right, high = (np.asarray(v, float) for v in (centre, across, up))
    s, t = np.meshgrid([-0.5, 0.5], [-0.5, 0.5])
    u0, v0, u1, v1 = window
    uv = np.stack([u0 + (s + 0.5) * (u1 - u0), v0 + (t + 0.5) * (v1 - v0)], -1)
    return grid(middle + s[..., None] * right + t[..., None] * high, uv)


def mound(width: float, depth: float, bulge: float, cells: int = 6) -> Mesh:
    """A bulging pane in the x-z plane facing -y (a picture tube's face); texture 0..1 across."""
    s, t = np.meshgrid(np.linspace(-1, 1, cells + 1), np.linspace(-1, 1, cells + 1))
    y = -bulge * (1 - 0.5 * s**2 - 0.5 * t**2)
    return grid(np.stack([s * width / 2, y, t * depth / 2], -1))
