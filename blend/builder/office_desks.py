"""Office desk, drawers beneath it, swivel chair.

Local frames: z up from the floor, the user sits at -y.
"""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, join
from .office_measures import DESK_TOP
from .shapes import bar, lathe, rounded_box, steps, tube
from .solids import block


def desk(width: float, depth: float, side_boards: bool = True) -> Mesh:
    """Laminate top on a steel frame, wooden modesty board at +y, boards at both narrow sides; slots
    0 laminate, 1 steel, 2 side board, 3 rubber.
    """
    x = width / 2
    y = depth / 2
    leg = 0.05
    top = DESK_TOP
    parts = [block((width, depth, 0.022), (0, 0, top - 0.011), 0.003, 0.9)]
    steel = []
    for s in (-1, 1):
        steel.append(
            block((width - 0.004, 0.045, 0.022), (0, s * (y - 0.0235), top - 0.0295), 0.002)
        )
    for s in (-1, 1):
        steel.append(block((0.045, depth - 0.1, 0.022), (s * (x - 0.0235), 0, top - 0.0295), 0.002))
    for i in (-1, 1):
        for j in (-1, 1):
            steel.append(
                block(
                    (leg, leg, top - 0.058),
                    (i * (x - 0.026), j * (y - 0.026), 0.02 + (top - 0.058) / 2),
                    0.003,
                )
            )
            parts.append(
                lathe(
                    [(0, 0.0004), (0.02, 0.0004), (0.022, 0.004), (0.02, 0.0205), (0, 0.0205)], 12
                )
                .painted(3)
                .moved(i * (x - 0.026), j * (y - 0.026))
            )
    steel.append(block((width - 0.106, 0.04, 0.02), (0, y - 0.026, 0.27), 0.002))
    parts.append(block((width - 0.106, 0.018, 0.4905), (0, y - 0.021, 0.52475), 0.002, 0.9))
    if side_boards:
        for i in (-1, 1):
            steel.append(block((0.04, depth - 0.106, 0.02), (i * (x - 0.026), 0, 0.27), 0.002))
            parts.append(
                block((0.018, depth - 0.106, 0.4905), (i * (x - 0.021), 0, 0.52475), 0.002).painted(
                    2
                )
            )
    return join([*parts, *[s.painted(1) for s in steel]])


def drawers(detail: float) -> Mesh:
    """A low case of three drawers on castors, 0.42 x 0.52 x 0.58, front at -y; slots 0 case, 1
    steel, 2 rubber.
    """
    parts = [block((0.42, 0.5, 0.52), (0, 0.01, 0.32), 0.004)]
    for z, tall in ((0.505, 0.13), (0.365, 0.13), (0.18, 0.22)):
        parts.append(block((0.408, 0.018, tall), (0, -0.2495, z), 0.003))
        parts.append(
            block((0.12, 0.022, 0.012), (0, -0.268, z + tall / 2 - 0.035), 0.003).painted(1)
        )
    wheel = lathe(
        [(0, -0.011), (0.026, -0.011), (0.029, 0), (0.026, 0.011), (0, 0.011)], steps(12, detail, 8)
    ).turned("y", 90)
    for i in (-1, 1):
        for j in (-1, 1):
            parts.append(wheel.moved(i * 0.17, j * 0.19, 0.0295).painted(2))
    return join(parts)


def swivel_chair(rng: np.random.Generator, detail: float) -> Mesh:
    """Upholstered seat and back on a five-armed foot, no arm rests, the sitter looks along -y;
    slots 0 cloth, 1 plastic, 2 steel.
    """
    n = steps(12, detail, 6)
    hub = lathe(
        [
            (0, 0.06),
            (0.035, 0.06),
            (0.04, 0.075),
            (0.032, 0.12),
            (0.028, 0.27),
            (0.018, 0.272),
            (0.018, 0.41),
            (0, 0.41),
        ],
        n,
    )
    plastic = [hub]
    start = rng.uniform(0, 72)
    wheel = lathe(
        [(0, -0.02), (0.022, -0.02), (0.025, -0.012), (0.025, 0.012), (0.022, 0.02), (0, 0.02)], n
    ).turned("x", 90)
    for k in range(5):
        arm = tube(
            [[0.03, 0, 0.092], [0.15, 0, 0.085], [0.27, 0, 0.062]],
            [0.021, 0.018, 0.013],
            steps(8, detail, 6),
        )
        plastic.append(join([arm, wheel.moved(0.262, 0, 0.0255)]).turned("z", start + 72 * k))
    seat = (
        rounded_box((0.47, 0.46, 0.075), 0.034, 2, (5, 5, 1), 0.25)
        .mapped(_waterfall)
        .moved(0, 0, 0.47)
    )
    back = (
        rounded_box((0.43, 0.06, 0.42), 0.028, 2, (5, 1, 5), 0.25)
        .mapped(_bowed)
        .turned("x", -7)
        .moved(0, 0.225, 0.80)
    )
    shell = (
        rounded_box((0.40, 0.016, 0.39), 0.006, 1, (5, 1, 5))
        .mapped(_bowed)
        .turned("x", -7)
        .moved(0, 0.262, 0.795)
    )
    spine = tube([[0, 0.05, 0.43], [0, 0.22, 0.425], [0, 0.285, 0.50], [0, 0.290, 0.72]], 0.016, 8)
    lever = bar((0.05, 0, 0.425), (0.26, -0.02, 0.40), 0.006, 6)
    tray = block((0.26, 0.26, 0.03), (0, 0, 0.42), 0.006)
    return join(
        [
            seat,
            back,
            *[p.painted(1) for p in (*plastic, shell, tray)],
            spine.painted(2),
            lever.painted(2),
        ]
    )


def _waterfall(v: np.ndarray) -> np.ndarray:
    """The seat's front edge falls, its middle is sat hollow."""
    v[:, 2] -= 0.03 * np.clip(-v[:, 1] / 0.23 - 0.45, 0, 1) ** 2
    v[:, 2] -= (
        0.008 * np.exp(-((v[:, 0] / 0.13) ** 2) - ((v[:, 1] - 0.03) / 0.13) ** 2) * (v[:, 2] > 0)
    )
    return v


def _bowed(v: np.ndarray) -> np.ndarray:
    v[:, 1] -= 0.045 * (v[:, 0] / 0.21) ** 2 + 0.025 * np.cos(3 * (v[:, 2] + 0.05) / 0.42)
    v[:, 0] *= 1 - 0.10 * np.clip(v[:, 2] / 0.21, -1, 1) ** 2
    return v
