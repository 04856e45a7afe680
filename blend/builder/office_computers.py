"""Computers of the nineties: CRT monitor, keyboard, mouse, tower, cables.

Local frames: z up, the user at -y.
"""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, grid, join
from .shapes import lathe, smooth_profile, steps, tube
from .solids import block, loft, mound, rounded_ring


def monitor(detail: float) -> Mesh:
    """A 17-inch CRT on its swivel foot, 0.41 x 0.45 x 0.45; slots 0 plastic, 1 screen, 2 dark."""
    n = 3
    z = 0.27

    def ring(w: float, h: float, y: float, radius: float, lift: float = 0.0) -> np.ndarray:
        outline = rounded_ring(w, h, radius, n)
        return np.stack([outline[:, 0], np.full(len(outline), y), outline[:, 1] + lift], 1)

    front = [
        (0.30, 0.228, -0.196, 0.012, 0.018),
        (0.318, 0.246, -0.214, 0.016, 0.018),
        (0.396, 0.362, -0.216, 0.018, 0),
    ]
    shell = [
        (0.406, 0.372, -0.208, 0.022, 0),
        (0.408, 0.374, -0.10, 0.026, 0),
        (0.385, 0.352, -0.085, 0.026, 0),
    ]
    tail = [
        (0.36, 0.325, -0.05, 0.03, 0),
        (0.30, 0.27, 0.10, 0.025, -0.012),
        (0.285, 0.255, 0.215, 0.02, -0.014),
        (0.27, 0.24, 0.225, 0.015, -0.014),
    ]
    body = loft([ring(*r) for r in (*front, *shell, *tail)])
    screen = mound(0.304, 0.232, 0.012).moved(0, -0.1985, 0.018).painted(1)
    slots = []
    for k in range(9):
        slots.append(block((0.20, 0.003, 0.006), (0, 0.2255, k * 0.014 - 0.06), 0.001).painted(2))
    for s in (-1, 1):
        for k in range(8):
            slots.append(
                block((0.003, 0.11, 0.005), (s * 0.1475, 0.155, k * 0.014 - 0.05), 0.001).painted(2)
            )
    buttons = []
    for x in (-0.06, -0.04, -0.02, 0.0):
        buttons.append(block((0.012, 0.006, 0.007), (x, -0.2175, -0.155), 0.0015))
    power = block((0.022, 0.007, 0.012), (0.14, -0.2175, -0.155), 0.002)
    lamp = block((0.005, 0.004, 0.003), (0.112, -0.2165, -0.155), 0.0005).painted(2)
    head = join([body, screen, *slots, *buttons, power, lamp]).moved(z=z)
    outline = rounded_ring(0.17, 0.17, 0.04)
    neck = loft([np.column_stack([outline, np.full(16, height)]) for height in (0.045, 0.085)])
    foot = lathe(
        [
            (0, 0.0006),
            (0.128, 0.0006),
            (0.132, 0.004),
            (0.130, 0.012),
            (0.09, 0.036),
            (0.07, 0.046),
            (0, 0.046),
        ],
        steps(36, detail, 12),
    )
    return join([head.turned("x", -3).moved(0, 0.014, 0.003), neck, foot])


def keyboard(rng: np.random.Generator) -> Mesh:
    """A full keyboard 0.46 x 0.17, thicker at the back; slots 0 case, 1 keys, 2 grey keys, 3 dark
    gap.
    """
    low, high = 0.010, 0.028
    case = block((0.462, 0.172, 0.02), (0, 0, 0), 0.004).mapped(lambda v: _wedge(v, low, high))
    bed = (
        block((0.436, 0.13, 0.004), (0, -0.012, 0.0093), 0.001)
        .painted(3)
        .mapped(lambda v: _wedge(v, low, high))
    )
    keys = []
    for row in range(6):
        y = -0.067 + 0.019 * row + (0.006 if row == 5 else 0)
        for group, (x0, x1) in enumerate(((-0.212, 0.075), (0.085, 0.138), (0.148, 0.212))):
            if row in (3, 4) and group == 1 and row == 1:
                continue
            x = x0
            while x < x1 - 0.012:
                wide = 0.110 if (row == 0 and group == 0 and -0.16 < x < -0.13) else 0.0185
                wide = min(wide * (1.5 if group == 0 and (x == x0) and row < 5 else 1), x1 - x)
                keys.append(
                    _key(x + wide / 2, y, wide - 0.002, 0.017).painted(
                        2 if group or x == x0 or wide > 0.05 or row == 5 else 1
                    )
                )
                x += wide
    del rng
    caps = join(keys).mapped(lambda v: _wedge(v, low, high))
    return join([case, bed, caps])


def _wedge(v: np.ndarray, low: float, high: float) -> np.ndarray:
    """Lift what lies on z = -0.01..0.01 into a wedge that stands on 0."""
    slope = low + (high - low) * (v[:, 1] + 0.086) / 0.172
    top = np.clip((v[:, 2] + 0.01) / 0.02, 0, None)
    v[:, 2] = 0.0005 + np.where(v[:, 2] <= 0.01, top * slope, slope + v[:, 2] - 0.01)
    return v


def _key(x: float, y: float, w: float, d: float) -> Mesh:
    low = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * [w / 2, d / 2] + [x, y]
    top = (low - [x, y]) * [1 - 0.005 / w, 0.72] + [x, y + 0.001]
    sides = np.array(
        [np.concatenate([p, np.full((4, 1), z)], 1) for p, z in ((low, 0.0105), (top, 0.0185))]
    )
    wall = grid(np.concatenate([sides, sides[:, :1]], 1))
    cap = grid(sides[1][[0, 1, 3, 2]].reshape(2, 2, 3))
    return join([wall, cap])


def mouse(detail: float) -> Mesh:
    """A two-button mouse; slot 0 plastic."""
    n = steps(12, detail, 8)
    a = np.linspace(0, 2 * np.pi, n + 1)[:-1]
    rings = []
    for scale, z in ((0.9, 0.0006), (1.0, 0.004), (1.0, 0.014), (0.86, 0.027), (0.5, 0.034)):
        x, y = (
            0.031 * np.cos(a) * scale,
            0.056 * np.sign(np.sin(a)) * np.abs(np.sin(a)) ** 0.8 * scale,
        )
        rings.append(np.stack([x, y, z + 0.004 * (y / 0.056) * (z > 0.02)], 1))
    return loft(rings)


def tower(detail: float) -> Mesh:
    """A tower case 0.19 x 0.43 x 0.42, front at -y; slots 0 plastic, 1 metal, 2 dark."""
    parts = [
        block((0.188, 0.41, 0.405), (0, 0.01, 0.2155), 0.003).painted(1),
        block((0.192, 0.026, 0.415), (0, -0.207, 0.2155), 0.008),
    ]
    parts += [block((0.150, 0.008, 0.041), (0, -0.2205, z), 0.003) for z in (0.385, 0.34, 0.295)]
    parts += [
        block((0.125, 0.003, 0.003), (0, -0.2246, 0.347), 0.0005).painted(2),
        block((0.102, 0.006, 0.022), (0, -0.221, 0.25), 0.002).painted(2),
    ]
    for z in np.arange(0.04, 0.15, 0.012):
        parts.append(block((0.12, 0.004, 0.004), (0, -0.2203, z), 0.001).painted(2))
    button = lathe([(0, 0), (0.010, 0), (0.008, 0.005), (0, 0.006)], steps(14, detail, 8)).turned(
        "x", 90
    )
    parts += [button.moved(-0.05, -0.2195, 0.205), button.moved(0.05, -0.2195, 0.205).painted(2)]
    for i in (-1, 1):
        for j in (-1, 1):
            parts.append(block((0.02, 0.02, 0.012), (i * 0.07, j * 0.17, 0.0065), 0.002).painted(2))
    return join(parts)


def cable(points: list, radius: float, detail: float) -> Mesh:
    """A cable that hangs or lies through points (k,3)."""
    return tube(
        smooth_profile(points, steps(9 * len(points), detail, 6)), radius, steps(6, detail, 4)
    )
