"""Hard furniture: table, chair, sideboard, television, lamp.

Local frames: z up from 0, front towards -y.
"""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, join
from .shapes import bar, lathe, rounded_box, smooth_profile, steps, tube

WOOD_TILE = 0.7


def board(
    size: tuple[float, float, float],
    centre: tuple[float, float, float],
    radius: float = 0.004,
    turn: bool = False,
    arcs: int = 1,
) -> Mesh:
    """A planed board with rounded edges; grain along x, or along the other axis with `turn`."""
    shift = (0.37 * centre[0] + 0.21 * centre[2], 0.61 * centre[1] + 0.13 * centre[2])
    return rounded_box(size, radius, arcs).box_mapped(WOOD_TILE, shift, turn).moved(*centre)


def coffee_table(width: float, depth: float, top: float, detail: float) -> Mesh:
    """Board on a stand: four splayed round legs, a stretcher frame and a lower slatted shelf; slots
    0 top, 1 stand.
    """
    parts = [board((width, depth, 0.032), (0, 0, top - 0.016), 0.008, arcs=2)]
    n = steps(14, detail, 8)
    sx = width / 2 - 0.10
    sy = depth / 2 - 0.085
    stand = []
    for i in (-1, 1):
        for j in (-1, 1):
            stand.append(
                bar(
                    (i * (sx + 0.035), j * (sy + 0.03), 0),
                    (i * sx, j * sy, top - 0.033),
                    [0.013, 0.016, 0.020, 0.022],
                    n,
                )
            )
        stand.append(
            board((0.022, 2 * sy - 0.04, 0.055), (i * (sx + 0.001), 0, top - 0.0655), turn=True)
        )
    for j in (-1, 1):
        stand.append(board((2 * sx - 0.05, 0.022, 0.055), (0, j * (sy + 0.001), top - 0.0655)))
    for k in np.linspace(-1, 1, 7):
        stand.append(board((2 * sx + 0.015, 0.055, 0.014), (0, k * (sy - 0.035), 0.17), 0.003))
    for i in (-1, 1):
        stand.append(
            bar(
                (i * (sx + 0.021), -sy - 0.015, 0.155),
                (i * (sx + 0.021), sy + 0.015, 0.155),
                0.009,
                n,
            )
        )
    return join(parts + [s.painted(1) for s in stand])


def chair(detail: float) -> Mesh:
    """A wooden chair with a bent back rest and an upholstered seat; slots 0 wood, 1 fabric. Seat
    centre above the origin.
    """
    n = steps(12, detail, 6)
    wood = []
    for i in (-1, 1):
        wood.append(
            bar((i * 0.215, -0.215, 0), (i * 0.195, -0.19, 0.425), [0.012, 0.015, 0.018, 0.019], n)
        )
        back = smooth_profile(
            [
                (i * 0.205, 0.255, 0),
                (i * 0.195, 0.195, 0.40),
                (i * 0.192, 0.205, 0.60),
                (i * 0.188, 0.275, 0.84),
            ],
            steps(12, detail, 6),
        )
        wood.append(
            tube(
                back,
                np.interp(np.linspace(0, 1, len(back)), [0, 0.45, 1], [0.012, 0.019, 0.012]),
                n,
            )
        )
        wood.append(bar((i * 0.207, -0.20, 0.17), (i * 0.201, 0.222, 0.17), 0.008, n))
        wood.append(board((0.020, 0.34, 0.05), (i * 0.193, 0.0, 0.405), turn=True))
    wood.append(board((0.36, 0.020, 0.05), (0, -0.188, 0.405)))
    wood.append(board((0.36, 0.020, 0.05), (0, 0.192, 0.405)))
    wood.append(bar((-0.204, 0.01, 0.17), (0.204, 0.01, 0.17), 0.008, n))

    def bowed(z: float, y: float, tall: float, deep: float) -> Mesh:
        slat = rounded_box((0.37, 0.014, tall), 0.005, 1, (steps(8, detail, 4), 1, 1), WOOD_TILE)
        return slat.mapped(
            lambda v: (
                v + np.stack([0 * v[:, 0], deep * (1 - (v[:, 0] / 0.19) ** 2), 0 * v[:, 0]], 1)
            )
        ).moved(0, y, z)

    wood += [
        bowed(0.79, 0.262, 0.095, 0.035),
        bowed(0.66, 0.224, 0.035, 0.032),
        bowed(0.57, 0.203, 0.035, 0.030),
    ]
    seat = rounded_box(
        (0.43, 0.43, 0.055), 0.022, 2, (steps(6, detail), steps(6, detail), 1), 0.3
    ).painted(1)

    def dome(v: np.ndarray) -> np.ndarray:
        s, t = v[:, 0] / 0.215, v[:, 1] / 0.215
        v[:, 2] += (v[:, 2] > 0) * 0.014 * np.clip((1 - s**2) * (1 - t**2), 0, 1)
        v[:, 0] *= 1 - 0.05 * t
        return v

    return join([*wood, seat.mapped(dome).moved(0, 0, 0.458)])


def sideboard(width: float, depth: float, height: float, detail: float) -> Mesh:
    """A low media cupboard: carcass, two doors, three drawers, knobs, tapered legs; slots 0 wood, 1
    metal, 2 dark inside.
    """
    low = 0.14
    t = 0.022
    tall = height - low
    parts = [
        board((width, depth, t), (0, 0, height - t / 2)),
        board((width - 0.001, depth - 0.002, t), (0, 0, low + t / 2)),
        board(
            (t, depth - 0.001, tall - 2 * t - 0.001),
            (-width / 2 + t / 2 + 0.0005, 0, low + tall / 2),
            turn=True,
        ),
        board(
            (t, depth - 0.001, tall - 2 * t - 0.001),
            (width / 2 - t / 2 - 0.0005, 0, low + tall / 2),
            turn=True,
        ),
        rounded_box((width - 2 * t - 0.002, 0.01, tall - 2 * t - 0.002), 0.001)
        .moved(0, -depth / 2 + 0.035, low + tall / 2)
        .painted(2),
    ]
    inside = width - 2 * t
    clear = tall - 2 * t
    third = inside / 3
    front = -depth / 2 + 0.012
    knob = (
        lathe(
            [
                (0.005, 0),
                (0.005, 0.012),
                (0.012, 0.016),
                (0.014, 0.022),
                (0.010, 0.027),
                (0, 0.028),
            ],
            steps(14, detail, 8),
        )
        .turned("x", 90)
        .painted(1)
    )
    for i in (-1, 1):
        parts.append(
            board((third - 0.005, 0.019, clear - 0.006), (i * third, front, low + tall / 2))
        )
        parts.append(
            knob.moved(i * (third - third / 2 + 0.05), front - 0.009, low + tall / 2 + 0.03)
        )
    for k in range(3):
        z = low + t + clear * (k + 0.5) / 3
        parts += [
            board((third - 0.005, 0.019, clear / 3 - 0.005), (0, front, z)),
            knob.moved(0, front - 0.009, z),
        ]
    for i in (-1, 1):
        for j in (-1, 1):
            parts.append(
                bar(
                    (i * (width / 2 - 0.09), j * (depth / 2 - 0.06), 0),
                    (i * (width / 2 - 0.12), j * (depth / 2 - 0.08), low - 0.0005),
                    [0.011, 0.015, 0.020],
                    steps(12, detail, 6),
                )
            )
    return join(parts)


def television(width: float, detail: float) -> Mesh:
    """A flat television on two feet; slots 0 body, 1 screen, 2 metal."""
    height = width * 9 / 16 + 0.02
    z = 0.07 + height / 2
    body = rounded_box((width, 0.028, height), 0.006, 2).moved(0, 0, z)
    hump = rounded_box((width * 0.6, 0.035, height * 0.5), 0.012).moved(0, 0.030, z - 0.08)
    screen = (
        rounded_box((width - 0.018, 0.002, height - 0.026), 0.0009)
        .moved(0, -0.0146, z + 0.004)
        .painted(1)
    )
    feet = []
    for i in (-1, 1):
        path = [
            [i * width * 0.36, -0.11, 0.006],
            [i * width * 0.36, -0.03, 0.018],
            [i * width * 0.36, 0, 0.075],
        ]
        feet += [
            tube(path, 0.006, steps(8, detail, 6)),
            bar((i * width * 0.36, 0.11, 0.006), (i * width * 0.36, 0.0, 0.05), 0.006, 8),
        ]
    return join([body, hump, screen, *[f.painted(2) for f in feet]])


def foot_lamp(shade: tuple[float, float, float], detail: float) -> tuple[Mesh, Mesh, Mesh]:
    """Foot lamp and its shade (radius, low z, high z): stand of steel, cloth drum (slots 0 cloth, 1
    rim), bulb.
    """
    n = steps(48, detail, 12)
    radius, low, high = shade
    socket = (low + high) / 2 - 0.05
    foot = lathe(
        [
            (0.168, 0.0005),
            (0.170, 0.003),
            (0.170, 0.043),
            (0.167, 0.048),
            (0.161, 0.0495),
            (0.05, 0.0495),
            (0.022, 0.051),
            (0.018, 0.058),
            (0.0165, 0.064),
        ],
        n,
    )
    pole = lathe(
        [
            (0.0165, 0.060),
            (0.0165, socket - 0.045),
            (0.020, socket - 0.044),
            (0.020, socket),
            (0.0, socket),
        ],
        steps(20, detail, 8),
    )
    bulb = lathe(
        [
            (0.012, 0.001),
            (0.013, 0.012),
            (0.024, 0.034),
            (0.028, 0.052),
            (0.024, 0.069),
            (0.012, 0.079),
            (0.0, 0.081),
        ],
        steps(16, detail, 8),
    )
    arms = []
    for c, s in [(np.cos(a), np.sin(a)) for a in np.radians([30, 150, 270])]:
        arms.append(
            tube(
                [
                    [0.018 * c, 0.018 * s, socket - 0.02],
                    [radius * 0.6 * c, radius * 0.6 * s, socket - 0.03],
                    [(radius - 0.001) * c, (radius - 0.001) * s, low + 0.006],
                ],
                0.0022,
                5,
            )
        )
    drum = lathe(
        [
            (radius, low),
            (radius, (2 * low + high) / 3),
            (radius, (low + 2 * high) / 3),
            (radius, high),
        ],
        n,
    )
    drum = Mesh(drum.verts, drum.faces, drum.uv * np.array([4.0, 0.8]), drum.material)
    turn = np.linspace(0, 2 * np.pi, n + 1)
    rings = []
    for z in (low + 0.002, high - 0.002):
        rings.append(np.stack([radius * np.cos(turn), radius * np.sin(turn), 0 * turn + z], 1))
    rims = [tube(ring, 0.0032, 6, closed_ends=False).painted(1) for ring in rings]
    return join([foot, pole, *arms]), join([drum, *rims]), bulb.moved(z=socket)
