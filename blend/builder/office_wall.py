"""The shell of the office: suspended ceiling, luminaires, vents, wall pieces, coat stand.

Normals of the walls point inwards.
"""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, facing, join
from .office_measures import LOW, LUMINAIRES, PANEL, RAIL, VENT_LOW, X0, X1, Y0, Y1, Z1
from .shapes import bar, frame, lathe, steps, tube
from .solids import block, printed
from .wallpieces import plane

# widths of a luminaire's frame, and of the bar between its panels
FRAME = 0.025
DIVIDER = 0.03


def is_luminaire(x: float, y: float) -> bool:
    return any(abs(x - a) < PANEL and abs(y - b) < PANEL / 2 for a, b in LUMINAIRES)


def ceiling() -> tuple[Mesh, Mesh]:
    """Mineral panels with openings for the luminaires, and the rails between them, slots: 0 rail, 1
    flanks.

    Flanks as dark as the rails would be rows of dots in most images: they are 1 mm high.
    """
    xs, ys = (np.unique(np.clip(np.arange(-8, 9) * PANEL, a, b)) for a, b in ((X0, X1), (Y0, Y1)))
    cells = []
    for a, b in zip(xs[:-1], xs[1:], strict=True):
        for c, d in zip(ys[:-1], ys[1:], strict=True):
            if not is_luminaire((a + b) / 2, (c + d) / 2):
                cells.append(
                    plane((a, c, Z1), (0, d - c, 0), (b - a, 0, 0), 2.0, (c / 2.0, a / 2.0))
                )
    long = [_strip((x, (Y0 + Y1) / 2, Z1), (0.024, Y1 - Y0), RAIL) for x in xs[1:-1]]
    cross = []
    for y in ys[1:-1]:
        for a, b in zip(xs[:-1], xs[1:], strict=True):
            cross.append(_strip(((a + b) / 2, y, Z1), (b - a - 0.024, 0.024), RAIL))
    edge = [_strip((x, 0, Z1), (0.022, Y1 - Y0), RAIL) for x in (X0 + 0.011, X1 - 0.011)]
    size = (X1 - X0 - 0.044, 0.022)
    edge += [_strip((0, y, Z1), size, RAIL) for y in (Y0 + 0.011, Y1 - 0.011)]
    rails = []
    for rail in (*long, *cross, *edge):
        rails += _with_flanks(rail)
    return join(cells), join(rails)


def _with_flanks(strip: Mesh) -> list[Mesh]:
    return [
        strip.without(lambda n: n[:, 2] > -0.9),
        strip.without(lambda n: n[:, 2] <= -0.9).painted(1),
    ]


def _strip(centre: tuple[float, float, float], size: tuple[float, float], low: float) -> Mesh:
    """A strip at the ceiling: its lower side, `low` below the centre, with its flanks."""
    return block((*size, 2 * low), centre, 0.0003).without(lambda n: n[:, 2] > 0.5)


def luminaire() -> Mesh:
    """Two panels 0.5 x 0.5 m about (0, 0): their light, flush with z = 0, in a frame 6 mm below it;
    slots 0 frame, 1 light (image).

    The louvers are painted: in the original's depth the light is flat.
    """
    w, h = 2 * PANEL + 0.02, PANEL + 0.02
    inner = h - 2 * FRAME
    rim = frame(w, h, [(0, 0.0), (0, LOW), (FRAME, LOW), (FRAME, 0.0)]).turned("x", 90)
    middle = _strip((0, 0, 0), (DIVIDER, inner), LOW)
    near = DIVIDER / 2
    far = w / 2 - FRAME
    lights = []
    for x in (-(near + far) / 2, (near + far) / 2):
        lights.append(printed((x, 0, 0), (0, inner, 0), (far - near, 0, 0)).painted(1))
    return join([rim, middle, *lights])


def vent(detail: float) -> Mesh:
    """A round air outlet of concentric cones hanging out of z = 0; slots 0 metal, 1 the gaps."""
    n = steps(40, detail, 16)
    low = -VENT_LOW
    rings = []
    for outer in (0.152, 0.118, 0.084, 0.050):
        profile = [
            (outer - 0.014, -0.0015),
            (outer - 0.016, low + 0.003),
            (outer - 0.012, low),
            (outer, low + 0.003),
            (outer + 0.002, -0.001),
        ]
        rings.append(facing(lathe(profile, n), -1))
    rings.append(facing(lathe([(0.0, low), (0.024, low), (0.026, -0.0013)], n), -1))
    back = facing(lathe([(0.0, -0.0013), (0.15, -0.0013)], n), -1).painted(1)
    return join([*rings, back])


def slim_picture(width: float, height: float, mat: float) -> Mesh:
    """A picture in a thin frame in the x-z plane facing -y, its back at y = 0; slots 0 frame, 1
    mat, 2 print.
    """
    rim = frame(
        width,
        height,
        [(0, 0.001), (0, 0.021), (0.002, 0.023), (0.010, 0.023), (0.012, 0.021), (0.012, 0.013)],
        0.4,
    )
    w, h = width - 0.023, height - 0.023
    board = plane(
        (-w / 2, -0.014, -h / 2), (w, 0, 0), (0, 0, h), 1.0, hole=(mat, w - mat, mat, h - mat)
    ).painted(1)
    edge = frame(w - 2 * mat, h - 2 * mat, [(0, 0.014), (0.002, 0.012)]).painted(1)
    art = printed((0, -0.012, 0), (w - 2 * mat - 0.004, 0, 0), (0, 0, h - 2 * mat - 0.004)).painted(
        2
    )
    return join([rim, board, edge, art])


def clock(detail: float) -> Mesh:
    """A wall clock facing -y at ten past ten, 0.30 m across; slots 0 rim, 1 dial, 2 hands."""
    n = steps(48, detail, 16)
    rim = lathe(
        [
            (0.150, 0.001),
            (0.150, 0.03),
            (0.146, 0.036),
            (0.139, 0.036),
            (0.136, 0.030),
            (0.136, 0.022),
        ],
        n,
    ).turned("x", 90)
    disc = facing(lathe([(0.0, 0.020), (0.137, 0.020)], n), 1)
    uv = disc.verts[np.where(disc.faces < 0, disc.faces[:, :1], disc.faces)][..., :2] / 0.274 + 0.5
    dial = Mesh(disc.verts, disc.faces, uv, disc.material).turned("x", 90).painted(1)
    hands = [
        block((0.010, 0.002, 0.085), (0, -0.024, 0.032), 0.0006).turned("y", -54),
        block((0.007, 0.002, 0.125), (0, -0.0265, 0.05), 0.0006).turned("y", 60),
        block((0.003, 0.001, 0.13), (0, -0.0285, 0.045), 0.0003).turned("y", 200),
    ]
    pin = (
        lathe([(0, 0), (0.007, 0), (0.006, 0.008), (0, 0.009)], 12)
        .turned("x", 90)
        .moved(0, -0.0215)
    )
    return join([rim, dial, *[p.painted(2) for p in (*hands, pin)]])


def notice_board(width: float, height: float) -> Mesh:
    """A cork board in a wooden frame facing -y; slots 0 frame, 1 cork."""
    rim = frame(
        width,
        height,
        [(0, 0.001), (0, 0.018), (0.003, 0.020), (0.022, 0.020), (0.025, 0.018), (0.025, 0.009)],
        0.5,
    )
    w, h = width - 0.049, height - 0.049
    return join([rim, plane((-w / 2, -0.010, -h / 2), (w, 0, 0), (0, 0, h), 0.5).painted(1)])


def pull_handle(height: float) -> Mesh:
    """A round vertical pull on two feet, facing -y; slot 0 steel."""
    return join(
        [
            bar((0, -0.026, -height / 2), (0, -0.026, height / 2), 0.014, 16),
            *[block((0.016, 0.016, 0.016), (0, -0.0085, s * height * 0.38)) for s in (-1, 1)],
        ]
    )


def socket_plate() -> Mesh:
    """Two mains sockets facing -y; slots 0 plastic, 1 dark."""
    parts = [block((0.15, 0.010, 0.082), (0, -0.0052, 0), 0.003)]
    for x in (-0.036, 0.036):
        dish = facing(lathe([(0.0, -0.002), (0.020, -0.002), (0.022, 0.0)], 16), 1).turned("x", 90)
        parts.append(dish.moved(x, -0.0127, 0))
        for s in (-1, 1):
            hole = block((0.005, 0.003, 0.005), (x + s * 0.0095, -0.0112, 0), 0.0005)
            parts.append(hole.painted(1))
    return join(parts)


def coat_stand(detail: float) -> Mesh:
    """A polished pole with four tiers of arms that end in balls, 1.76 m; slot 0 chrome."""
    n = steps(16, detail, 8)
    ball = lathe(
        [
            (0, -0.019),
            (0.012, -0.0155),
            (0.0185, -0.004),
            (0.0185, 0.004),
            (0.012, 0.0155),
            (0, 0.019),
        ],
        n,
    )
    foot = lathe(
        [
            (0, 0.0005),
            (0.14, 0.0005),
            (0.145, 0.006),
            (0.13, 0.018),
            (0.04, 0.028),
            (0.017, 0.035),
            (0.015, 0.06),
            (0, 0.06),
        ],
        steps(36, detail, 12),
    )
    parts = [foot, bar((0, 0, 0.055), (0, 0, 1.73), 0.015, n), ball.moved(z=1.741)]
    for z, turn, reach in (
        (1.66, 78, 0.165),
        (1.60, 168, 0.12),
        (1.53, 78, 0.115),
        (1.47, 168, 0.11),
    ):
        for side in (0, 180):
            arm = tube(
                [[0.012, 0, z - 0.012], [reach * 0.6, 0, z], [reach, 0, z + 0.012]], 0.0062, 8
            )
            parts.append(
                join([arm, ball.moved(reach + 0.008, 0, z + 0.016)]).turned("z", turn + side)
            )
    return join(parts)
