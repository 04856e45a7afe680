"""Plants: the palm-like pot plant with long thin stems and big leaves, balcony shrubs.

World or local metres, z up.
"""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, facing, grid, join
from .shapes import lathe, ripples, sheet, smooth_profile, steps, tube


def blade(
    path: np.ndarray, width: float, cup: float, detail: float, roll_deg: float = 0.0, rows: int = 15
) -> Mesh:
    """A broad leaf along a midrib path (k,3): pointed, its halves lifted by `cup`, edges a little
    wavy; texture v runs along the rib.
    """
    rib = smooth_profile(path, steps(rows, detail, 6))
    t = np.linspace(0, 1, len(rib))
    tangent = np.gradient(rib, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    side[np.linalg.norm(side, axis=1) < 0.05] = [1.0, 0.0, 0.0]
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent)
    a = np.radians(roll_deg)
    side, up = np.cos(a) * side + np.sin(a) * up, np.cos(a) * up - np.sin(a) * side
    half = width / 2 * np.sin(np.pi * np.clip(t, 0, 1) ** 0.75) ** 0.8
    half[0] = half[-1] = 0.0015
    s = np.linspace(-1, 1, steps(8, detail, 4) + 1)
    wave = 0.05 * np.sin(9 * t[:, None] * np.pi + 2 * np.sign(s)[None]) * np.abs(s)[None] ** 2
    lift = cup * np.abs(s)[None] ** 1.4 + wave
    points = rib[:, None] + half[:, None, None] * (
        s[None, :, None] * side[:, None] + lift[..., None] * up[:, None]
    )
    uv = np.stack(np.broadcast_arrays((s[None] + 1) / 2, t[:, None]), -1)
    return sheet(points, 0.0016, uv)


def stalk(path: np.ndarray, thick: float, detail: float) -> Mesh:
    line = smooth_profile(path, steps(14, detail, 6))
    return tube(line, np.linspace(thick, 0.55 * thick, len(line)), steps(8, detail, 5))


def pot(rng: np.random.Generator, radius: float, height: float, detail: float) -> Mesh:
    """A glazed pot with rim and saucer, filled with soil; slots 0 glaze, 1 soil."""
    n = steps(40, detail, 12)
    wall = [
        (0.0, 0.016),
        (radius * 0.70, 0.016),
        (radius * 0.74, 0.022),
        (radius * 0.90, height * 0.6),
        (radius * 0.98, height - 0.03),
        (radius, height - 0.028),
        (radius * 1.01, height - 0.006),
        (radius * 0.99, height),
        (radius * 0.93, height),
        (radius * 0.91, height - 0.04),
    ]
    saucer = [
        (0.0, 0.0005),
        (radius * 0.85, 0.0005),
        (radius * 1.0, 0.018),
        (radius * 1.01, 0.021),
        (radius * 0.98, 0.021),
        (radius * 0.84, 0.012),
        (0.0, 0.012),
    ]
    angle, ring = np.meshgrid(
        np.linspace(0, 2 * np.pi, n + 1), np.linspace(0.0, radius * 0.915, 6), indexing="xy"
    )
    soil = np.stack([ring * np.cos(angle), ring * np.sin(angle), 0 * ring], -1)
    bumps = ripples(soil.reshape(-1, 3), rng, 0.06).reshape(ring.shape)
    soil[..., 2] = height - 0.035 + 0.004 * bumps
    return join([lathe(wall, n), lathe(saucer, n), facing(grid(soil), 1).painted(1)])


def shrub(rng: np.random.Generator, size: tuple[float, float, float], detail: float) -> Mesh:
    """A leafy bush in a box of `size` (x, y, z) above the origin: small folded leaves that face
    outwards, some left out at low detail.
    """
    # always drawn from the seed, so that later draws do not change
    parts = []
    leaves = 420
    d = rng.normal(size=(leaves, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    r = rng.uniform(0.45, 1.0, (leaves, 1)) ** 0.6
    lumps = 1 + 0.2 * ripples(d, rng, 1.1)[:, None]
    centre = d * r * lumps * np.array(size) / 2 + np.array([0, 0, size[2] / 2])
    for c, n in zip(centre, d, strict=True):
        long = rng.normal(size=3) + 0.6 * n
        long /= np.linalg.norm(long)
        wide = np.cross(long, n + 0.4 * rng.normal(size=3))
        wide /= np.linalg.norm(wide) + 1e-9
        length = rng.uniform(0.035, 0.06)
        fold = np.cross(wide, long) * 0.004
        p = [[c, c + wide * 0.001, c + wide * 0.002]]
        for f, w in ((0.4, 0.012), (1.0, 0.001)):
            p.append(
                [
                    c + long * length * f - wide * w,
                    c + long * length * f - fold,
                    c + long * length * f + wide * w,
                ]
            )
        parts.append(grid(np.array(p)))
    return join(parts[: steps(leaves, min(detail, 1.0), 20)])
