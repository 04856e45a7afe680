"""Filing cabinet, bookcase, rows of books and binders.

Local frames: z up from the surface below them, front towards -y.
"""

from __future__ import annotations

import numpy as np

from .hard import board
from .mesh import Mesh, grid, join, outward, welded
from .shapes import lathe, tube
from .solids import block, printed

#: Cells of the spine atlas: columns of books, then columns of binders.
BOOK_CELLS = 24
BINDER_CELLS = 8


def filing_cabinet(labels: tuple[int, int, int], detail: float) -> Mesh:
    """Three drawers, 0.47 x 0.66 x 1.32 m; slots 0 paint, 1 steel, 2 labels (an image of six,
    `labels` says which).
    """
    w = 0.468
    d = 0.62
    h = 1.32
    parts = [
        block((w, d, h), (0, 0.02, h / 2), 0.004, 1.1),
        block((w - 0.03, 0.02, 0.05), (0, -0.285, 0.025), 0.001),
    ]
    for k, cell in enumerate(labels):
        z = 0.265 + 0.425 * (2 - k)
        pull = (0.010, 0.0, 0.004)[k]
        front = -0.3015 - pull
        parts.append(
            block((w - 0.032, 0.022 + pull, 0.412), (0, front + (0.011 + pull / 2), z), 0.004, 1.1)
        )
        path = [
            [-0.085, 0, 0],
            [-0.083, -0.022, 0],
            [-0.06, -0.030, 0],
            [0.06, -0.030, 0],
            [0.083, -0.022, 0],
            [0.085, 0, 0],
        ]
        parts.append(tube(path, 0.0075, 8).moved(0, front - 0.001, z - 0.06).painted(1))
        holder = block((0.078, 0.004, 0.048), (0.125, front - 0.002, z + 0.12), 0.0015)
        u = cell / 6
        label = printed(
            (0.125, front - 0.0046, z + 0.12), (0.07, 0, 0), (0, 0, 0.040), (u, 0, u + 1 / 6, 1)
        ).painted(2)
        parts += [holder.painted(1), label]
    lock = (
        lathe([(0, 0), (0.009, 0), (0.009, 0.004), (0, 0.004)], 12)
        .turned("x", 90)
        .moved(0.19, -0.2925, h - 0.022)
    )
    del detail
    return join([*parts, lock.painted(1)])


def bookcase(width: float, height: float, shelves: int) -> tuple[Mesh, list[float]]:
    """An open bookcase 0.32 m deep. Returns it and the heights of its shelves."""
    t = 0.022
    depth = 0.30
    side = []
    for s in (-1, 1):
        side.append(
            board((t, depth, height), (s * (width / 2 - t / 2), 0, height / 2), 0.002, turn=True)
        )
    levels = np.linspace(0.07, height - t / 2, shelves + 1)
    planks = []
    for z in levels[:-1]:
        planks.append(board((width - 2 * t - 0.0006, depth - 0.012, t), (0, 0.002, z), 0.002))
    planks.append(board((width + 0.01, depth + 0.01, t), (0, 0, height + t / 2 + 0.0003), 0.003))
    back = block(
        (width - 2 * t - 0.0006, 0.006, height - 0.0025),
        (0, depth / 2 - 0.004, (height + 0.0025) / 2),
        0.0005,
        0.7,
    )
    foot = board((width - 2 * t - 0.0006, 0.018, 0.058), (0, -depth / 2 + 0.03, 0.0295), 0.002)
    return join([*side, *planks, back, foot]), [float(z) + t / 2 for z in levels[:-1]] + [
        height + t + 0.0003
    ]


def book_row(rng: np.random.Generator, width: float, tallest: float, fill: float = 0.9) -> Mesh:
    """Books standing in a row from -width/2, their spines to -y, the last one leaning; slots 0
    covers (atlas), 1 paper.
    """
    parts = []
    x = -width / 2
    while x < width / 2 - (1 - fill) * width - 0.05:
        thick = float(np.clip(rng.lognormal(-3.5, 0.45), 0.014, 0.062))
        size = (thick, rng.uniform(0.13, 0.22), min(tallest - 0.02, rng.uniform(0.19, 0.30)))
        parts.append(
            _standing(size, int(rng.integers(BOOK_CELLS))).moved(
                x + thick / 2, rng.uniform(0, 0.012) + size[1] / 2
            )
        )
        x += thick + 0.0008
    thick = 0.022
    tall = min(tallest - 0.03, 0.23)
    lean = (
        _standing((thick, 0.15, tall), int(rng.integers(BOOK_CELLS)))
        .moved(-thick / 2, 0.085)
        .turned("y", -14)
    )
    return join([*parts, lean.moved(x + 0.085, 0, 0.0002 + thick * np.sin(np.radians(14)))])


def binder_row(rng: np.random.Generator, count: int) -> Mesh:
    """Lever-arch files side by side, spines to -y, starting at x = 0; slots 0 covers (atlas), 1
    paper.
    """
    parts = []
    x = 0.0
    for _ in range(count):
        thick = float(rng.choice([0.052, 0.078]))
        cell = BOOK_CELLS + int(rng.integers(BINDER_CELLS))
        parts.append(
            _standing((thick, 0.262, 0.315), cell).moved(
                x + thick / 2, 0.131 + rng.uniform(0, 0.01)
            )
        )
        x += thick + 0.001
    return join(parts)


def _standing(size: tuple[float, float, float], cell: int) -> Mesh:
    """One upright volume: cover of three sides with a rounded spine, page block; texture cell
    `cell` of the atlas.
    """
    w = size[0] / 2
    d = size[1] / 2
    h = size[2]
    r = min(0.3 * w, 0.006)
    outer = np.array([(-w, d), (-w, -d + r), (-w + r, -d), (w - r, -d), (w, -d + r), (w, d)])
    inner = np.array(
        [
            (-w + 0.0025, d),
            *[(s * (w - 0.0025), -d + r + 0.001) for s in (-1, -0.5, 0.5, 1)],
            (w - 0.0025, d),
        ]
    )
    rows = []
    for o, z in ((inner, 0), (outer, 0), (outer, h), (inner, h), (inner, 0)):
        rows.append(np.concatenate([o, np.full((6, 1), z)], 1))
    total = BOOK_CELLS + BINDER_CELLS
    plain = (cell + 0.02) / (BOOK_CELLS + BINDER_CELLS)
    u = (cell + np.array([0.02, 0.02, 0.08, 0.92, 0.98, 0.98])) / total
    uv = np.stack([np.stack([u, np.full(6, v)], 1) for v in (0.01, 0.01, 0.99, 0.99, 0.01)])
    uv[[0, 3, 4], :, 0] = plain
    cover = welded(grid(np.array(rows), uv))
    pages = block(
        (2 * w - 0.0052, 2 * d - r - 0.006, h - 0.007), (0, (r - 0.002) / 2, h / 2), 0.0004
    ).painted(1)
    return join([outward(cover), pages]).moved(z=0.0002)
