"""Parts of the walls: planes with openings, skirting, door, window, pictures, spots. World frame;
normals of the walls point inwards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .mesh import Mesh, facing, grid, join, outward
from .shapes import bar, frame, lathe, rounded_box, steps, tube


def plane(
    origin: ArrayLike,
    across: ArrayLike,
    up: ArrayLike,
    tile_m: float,
    offset: tuple[float, float] = (0.0, 0.0),
    hole: tuple[float, float, float, float] | None = None,
) -> Mesh:
    """A flat wall from `origin` along the vectors `across` and `up` (metres), normal across x up;
    hole = (a0, a1, b0, b1) in metres.
    """
    origin, across, up = (np.asarray(v, float) for v in (origin, across, up))
    width, height = np.linalg.norm(across), np.linalg.norm(up)
    a = np.unique(np.clip([0, width, *(hole[:2] if hole else ())], 0, width))
    b = np.unique(np.clip([0, height, *(hole[2:] if hole else ())], 0, height))
    cells = []
    for a0, a1 in zip(a[:-1], a[1:], strict=True):
        for b0, b1 in zip(b[:-1], b[1:], strict=True):
            if hole and hole[0] <= (a0 + a1) / 2 <= hole[1] and hole[2] <= (b0 + b1) / 2 <= hole[3]:
                continue
            s, t = np.meshgrid([a0, a1], [b0, b1])
            p = origin + s[..., None] * across / width + t[..., None] * up / height
            cells.append(grid(p, np.stack([s, t], -1) / tile_m + np.array(offset)))
    return join(cells)


def skirting(
    start: tuple[float, float],
    end: tuple[float, float],
    height: float,
    thick: float,
    cut: tuple[bool, bool],
    capped: bool = False,
) -> Mesh:
    """A skirting board on the floor (z = 0) from start to end (x, y) with the room on its left;
    `cut`: mitred into an inner corner. capped: close the other ends, where the board is thicker
    than what it meets: there is no wall behind it, and outside would be seen past it.
    """
    a = np.array(start, float)
    b = np.array(end, float)
    along = (b - a) / np.linalg.norm(b - a)
    into = np.array([-along[1], along[0]])
    profile = [
        (thick, -0.002),  # below the floor: outside would be seen through any gap
        (thick, height - 0.022),
        (thick - 0.003, height - 0.014),
        (thick - 0.010, height - 0.004),
        (thick - 0.014, height),
        (0.0, height),
    ]
    rows = []
    for out, z in profile:
        ends = [a + along * (out if cut[0] else 0), b - along * (out if cut[1] else 0)]
        rows.append([[*(p + into * out), z] for p in ends])
    parts = [grid(np.array(rows)).flipped()]
    for place, is_cut, side in ((a, cut[0], 1), (b, cut[1], -1)):
        if capped and not is_cut:
            cap = grid(
                np.array([[[*place, z], [*(place + into * out), z]] for out, z in profile[:-1]])
            )
            parts.append(cap if side < 0 else cap.flipped())
    return join(parts).box_mapped(1.0)


def door(width: float, height: float, detail: float) -> Mesh:
    """A leaf with two sunken panels and a lever, facing -y; slots 0 paint, 1 metal."""
    del detail
    x, z = width / 2, height / 2
    rail = 0.13
    groove = 0.012
    sunk = 0.006
    middle = 0.92
    parts = []
    for z0, z1 in ((0.20, middle - 0.065), (middle + 0.065, height - rail)):
        w, h = width - 2 * rail, z1 - z0
        ring = frame(w, h, [(0, 0), (groove, -sunk)])
        panel = plane(
            (-w / 2 + groove, sunk, -h / 2 + groove),
            (w - 2 * groove, 0, 0),
            (0, 0, h - 2 * groove),
            1.0,
        )
        parts += [ring.moved(z=(z0 + z1) / 2), panel.moved(z=(z0 + z1) / 2)]
    for a, b, c, d in (
        (-x, -x + rail, 0, height),
        (x - rail, x, 0, height),
        (-x + rail, x - rail, 0, 0.20),
        (-x + rail, x - rail, middle - 0.065, middle + 0.065),
        (-x + rail, x - rail, height - rail, height),
    ):
        parts.append(plane((a, 0, c), (b - a, 0, 0), (0, 0, d - c), 1.0))
    del z
    rose = lathe([(0.026, 0), (0.026, 0.006), (0.022, 0.009), (0.0, 0.009)], 20).turned("x", 90)
    lever = tube(
        [[0, -0.006, 0], [0, -0.045, 0], [0.012, -0.055, 0], [0.03, -0.057, 0], [0.12, -0.055, 0]],
        0.009,
        10,
    )
    handle = join([rose, lever]).painted(1).moved(-x + 0.075, -0.0005, 0.98)
    return join([*parts, handle])


def casing(width: float, height: float, board: float, thick: float) -> Mesh:
    """Boards round a doorway: outer width and height, in the x-z plane from z = 0, back at y = 0. A
    box behind the wall closes the doorway:
    outside would be seen through the gap round the leaf.
    """
    upright = rounded_box((board, thick, height - board), 0.004).moved(
        0, -thick / 2, (height - board) / 2
    )
    top = rounded_box((width, thick, board), 0.004).moved(0, -thick / 2, height - board / 2)
    left = upright.moved(-width / 2 + board / 2)
    parts = [left, upright.moved(width / 2 - board / 2), top]
    w = width - 0.02
    deep = 0.04
    below = 0.01
    sides = frame(w, height, [(0.0, 0.0), (0.0, -deep)])
    back = plane((-w / 2, deep, -height / 2), (w, 0, 0), (0, 0, height), 1.0)
    closed = join([sides, back]).moved(z=height / 2 - below)
    return join([*(p.without(lambda n: n[:, 1] > 0.99) for p in parts), closed])


def picture(width: float, height: float, mat: float) -> Mesh:
    """A framed picture under glass in the x-z plane, centred, facing -y, its back at y = 0; slots:
    0 wood, 1 mat, 2 print.
    """
    rim = frame(
        width,
        height,
        [
            (0, 0.002),
            (0, 0.030),
            (0.004, 0.034),
            (0.016, 0.035),
            (0.028, 0.030),
            (0.034, 0.029),
            (0.048, 0.031),
            (0.062, 0.024),
            (0.068, 0.018),
            (0.068, 0.012),
        ],
        0.4,
    )
    w, h = width / 2 - 0.0665, height / 2 - 0.0665
    bevel = 0.004
    board = plane(
        (-w, -0.015, -h),
        (2 * w, 0, 0),
        (0, 0, 2 * h),
        1.0,
        hole=(mat, 2 * w - mat, mat, 2 * h - mat),
    ).painted(1)
    chamfer = frame(2 * (w - mat), 2 * (h - mat), [(0, 0.015), (bevel, 0.012)]).painted(1)
    pw = w - mat - bevel
    ph = h - mat - bevel
    p = np.array([[[-pw, -0.012, -ph], [pw, -0.012, -ph]], [[-pw, -0.012, ph], [pw, -0.012, ph]]])
    return join([rim, board, chamfer, grid(p).painted(2)])


def spot(detail: float) -> Mesh:
    """A ceiling spot hanging 4 mm out of z = 0; slots: 0 metal ring, 1 lens."""
    n = steps(32, detail, 12)
    ring = lathe(
        [
            (0.080, -0.0005),
            (0.080, -0.002),
            (0.077, -0.004),
            (0.068, -0.0045),
            (0.060, -0.003),
            (0.058, -0.001),
        ][::-1],
        n,
    )
    lens = lathe([(0.0, -0.0022), (0.035, -0.002), (0.0585, -0.001)], n).painted(1)
    return join([facing(ring, -1), facing(lens, -1)])


def _bars(width: float, height: float, section: float, depth: float) -> Mesh:
    """A closed mitred frame of rectangular section with eased edges, centred in the x-z plane."""
    d = depth / 2
    e = 0.004
    loop = [
        (0, -d),
        (0, d - e),
        (e, d),
        (section - e, d),
        (section, d - e),
        (section, -d + e),
        (section - e, -d),
        (0, -d),
    ]
    return outward(frame(width, height, loop))


def window(x0: float, x1: float, z0: float, z1: float, detail: float) -> tuple[Mesh, Mesh]:
    """French window in the plane y = 0, seen from +y: frame (slots 0 paint, 1 metal) and panes; the
    opening x0..x1, z0..z1.
    """
    width = x1 - x0
    height = z1 - z0
    cx = (x0 + x1) / 2
    cz = (z0 + z1) / 2
    outer = _bars(width - 0.002, height - 0.002, 0.045, 0.07).moved(cx, 0, cz)
    leaf_w = (width - 2 * 0.047) / 2 - 0.002
    leaf_h = height - 2 * 0.047
    frames = [outer]
    panes = []
    for sign in (-1, 1):
        x = cx + sign * (leaf_w / 2 + 0.0015)
        frames.append(_bars(leaf_w, leaf_h, 0.06, 0.056).moved(x, 0.012, cz))
        w, h = leaf_w / 2 - 0.055, leaf_h / 2 - 0.055
        panes.append(plane((x + w, 0.008, cz - h), (-2 * w, 0, 0), (0, 0, 2 * h), 1.0))
    plate = rounded_box((0.026, 0.006, 0.12), 0.003).moved(cx + 0.032, 0.0435, 1.05)
    lever = tube(
        [
            [cx + 0.032, 0.045, 1.06],
            [cx + 0.032, 0.085, 1.06],
            [cx + 0.032, 0.092, 1.05],
            [cx + 0.032, 0.092, 0.94],
        ],
        0.008,
        steps(10, detail, 6),
    )
    return join([*frames, join([plate, lever]).painted(1)]), join(panes)


def rail(x0: float, x1: float, detail: float) -> Mesh:
    """A curtain pole along x at y = z = 0 with end knobs and two brackets reaching back to y =
    -0.10.
    """
    n = steps(12, detail, 6)
    pole = bar((x0, 0, 0), (x1, 0, 0), 0.011, n)
    knob = lathe(
        [
            (0, -0.03),
            (0.014, -0.028),
            (0.024, -0.012),
            (0.026, 0.0),
            (0.022, 0.014),
            (0.012, 0.022),
            (0.011, 0.03),
            (0, 0.03),
        ],
        n,
    )
    ends = [knob.turned("y", 90).moved(x0 - 0.02), knob.turned("y", -90).moved(x1 + 0.02)]
    brackets = []
    for x in (x0 + 0.08, x1 - 0.08):
        brackets.append(
            tube(
                [[x, -0.098, -0.03], [x, -0.05, -0.03], [x, -0.01, -0.022], [x, 0, -0.008]],
                0.006,
                8,
            )
        )
    return join([pole, *ends, *brackets])
