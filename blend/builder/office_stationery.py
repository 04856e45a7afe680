"""Objects on desks: papers, trays, phone, lamp, jar, folders, stapler.

Local frames: z up from the surface below them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .mesh import Mesh, join
from .shapes import bar, lathe, ripples, rounded_box, sheet, smooth_profile, steps, tube
from .solids import block, plate, rounded_ring

A4 = (0.21, 0.297)


def page(rng: np.random.Generator, thick: float = 0.0006, curl: float = 0.006) -> Mesh:
    """A sheet or a thin wad of paper on z = 0, one of the four printed pages; slot 0 pages."""
    n = 5
    s, t = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    lift = curl * np.clip(s * rng.uniform(0, 1.5) + t * rng.uniform(-1, 1) - 0.6, 0, 1) ** 2
    points = np.stack([(s - 0.5) * A4[0], (t - 0.5) * A4[1], lift + thick / 2], -1)
    cell = np.array([rng.integers(2), rng.integers(2)]) / 2
    uv = np.stack([s, t], -1) / 2 * 0.98 + cell + 0.005
    return sheet(points, thick, uv).moved(z=0.0003)


def paper_pile(
    rng: np.random.Generator, count: int, wad: float = 0.006, askew: float = 7.0
) -> Mesh:
    """Wads of paper on one another, each a little askew."""
    wads = []
    for k in range(count):
        curl = 0.0 if k < count - 1 else 0.008
        turned = page(rng, wad, curl).turned("z", rng.normal(0, askew))
        shift = (rng.normal(0, 0.004), rng.normal(0, 0.005))
        wads.append(turned.moved(*shift, k * (wad + 0.0004)))
    return join(wads)


def tray(levels: int) -> Mesh:
    """Stacked letter trays 0.24 x 0.33, open at -y, 68 mm each; slot 0 plastic."""
    parts = []
    for k in range(levels):
        z = 0.071 * k
        parts.append(block((0.236, 0.33, 0.003), (0, 0, z + 0.004), 0.001))
        parts += [_side(s).moved(z=z) for s in (-1, 1)]
        parts.append(block((0.236, 0.003, 0.066), (0, 0.1635, z + 0.036), 0.001))
        parts.append(block((0.236, 0.003, 0.018), (0, -0.1635, z + 0.012), 0.001))
        for i in (-1, 1):
            for j in (-1, 1):
                parts.append(block((0.012, 0.012, 0.07), (i * 0.114, j * 0.15, z + 0.036), 0.002))
    return join(parts)


def _side(sign: int) -> Mesh:
    """A side wall whose upper edge falls towards the front."""
    wall = block((0.003, 0.33, 0.066), (sign * 0.1185, 0, 0.036), 0.001)
    return wall.mapped(
        lambda v: (
            v
            - np.stack(
                [
                    0 * v[:, 0],
                    0 * v[:, 0],
                    (v[:, 2] > 0.04) * 0.03 * np.clip(-v[:, 1] / 0.165, 0, 1),
                ],
                1,
            )
        )
    )


def phone(detail: float) -> Mesh:
    """A desk telephone with handset, keys and coiled cord; slots 0 body, 1 keys, 2 dark."""
    body = plate(rounded_ring(0.19, 0.22, 0.02), 0.0, 0.05, 0.005)
    body = body.mapped(
        lambda v: (
            v * [1, 1, 1]
            + np.stack(
                [
                    0 * v[:, 0],
                    0 * v[:, 0],
                    0.0005 + v[:, 2] * (-0.35 + 2.2 * (v[:, 1] + 0.11) / 0.4),
                ],
                1,
            )
        )
    )

    def top(y: float) -> float:
        return 0.0005 + 0.05 * (0.65 + 2.2 * (y + 0.11) / 0.4)

    keys = []
    for i in range(3):
        for j in range(4):
            keys.append(
                block(
                    (0.017, 0.012, 0.008),
                    (0.01 + 0.025 * i, -0.07 + 0.022 * j, top(-0.07 + 0.022 * j)),
                    0.002,
                ).painted(1)
            )
    window = (
        block((0.07, 0.022, 0.004), (0.035, 0.045, top(0.045)), 0.001).turned("x", 0).painted(2)
    )
    arc = smooth_profile(
        [
            (-0.065, -0.10, 0.068),
            (-0.065, -0.06, 0.098),
            (-0.065, 0.0, 0.112),
            (-0.065, 0.06, 0.118),
            (-0.065, 0.10, 0.108),
        ],
        9,
    )
    handset = tube(
        arc, [0.018, 0.019, 0.014, 0.013, 0.0125, 0.013, 0.015, 0.020, 0.019], steps(12, detail, 6)
    )
    cups = []
    for y, z in ((-0.088, 0.070), (0.088, 0.106)):
        cups.append(
            lathe(
                [(0, -0.012), (0.024, -0.012), (0.027, 0.0), (0.022, 0.014), (0, 0.016)],
                steps(16, detail, 8),
            ).moved(-0.065, y, z)
        )
    t = np.linspace(0, 1, steps(26 * 8, detail, 60))
    coil = np.stack(
        [
            -0.065 - 0.10 * np.sin(np.pi * t) + 0.007 * np.cos(52 * np.pi * t),
            -0.10 - 0.035 * np.sin(np.pi * t) + 0.20 * t * 0.4,
            0.010 + 0.055 * (1 - t) ** 3 + 0.007 * np.sin(52 * np.pi * t),
        ],
        1,
    )
    return join([body, *keys, window, handset, *cups, tube(coil, 0.0016, 4).painted(2)])


def desk_lamp(detail: float) -> Mesh:
    """A jointed lamp of metal, 0.42 m high, its shade towards -x; slots 0 metal, 1 bulb."""
    n = steps(28, detail, 10)
    foot = lathe(
        [
            (0, 0.0005),
            (0.078, 0.0005),
            (0.080, 0.004),
            (0.078, 0.010),
            (0.03, 0.020),
            (0.012, 0.024),
            (0.010, 0.05),
            (0, 0.05),
        ],
        n,
    )
    joints = [(0.0, 0.0, 0.045), (0.075, 0.0, 0.215), (-0.035, 0.0, 0.385)]
    arms = []
    for a, b in zip(joints[:-1], joints[1:], strict=True):
        for s in (-1, 1):
            arms.append(bar(np.add(a, (0, s * 0.009, 0)), np.add(b, (0, s * 0.009, 0)), 0.0032, 8))
    knobs = []
    for p in joints:
        knobs.append(
            lathe([(0, -0.016), (0.009, -0.015), (0.011, 0), (0.009, 0.015), (0, 0.016)], 12)
            .turned("x", 90)
            .moved(*p)
        )
    spring = bar((0.012, 0, 0.075), (0.058, 0, 0.165), 0.005, 8)
    outer = [
        (0.072, 0.0),
        (0.066, 0.03),
        (0.045, 0.062),
        (0.024, 0.082),
        (0.020, 0.112),
        (0, 0.116),
    ]
    shade = lathe(
        outer
        + [
            (0.0, 0.110),
            (0.017, 0.106),
            (0.021, 0.078),
            (0.042, 0.058),
            (0.063, 0.028),
            (0.0705, 0.0),
            (0.072, 0.0),
        ],
        n,
    )
    bulb = lathe([(0, 0.012), (0.02, 0.02), (0.026, 0.035), (0.016, 0.06), (0, 0.062)], 14).painted(
        1
    )
    head = join([shade, bulb]).moved(z=-0.06).turned("y", 24).moved(-0.062, 0, 0.37)
    return join([foot, *arms, *knobs, spring, head])


def pen_jar(rng: np.random.Generator, detail: float) -> Mesh:
    """A jar with pens and a ruler; slots 0 jar, 1 dark, 2 yellow, 3 red."""
    jar = lathe(
        [
            (0, 0.0005),
            (0.036, 0.0005),
            (0.039, 0.004),
            (0.039, 0.096),
            (0.0365, 0.098),
            (0.0345, 0.096),
            (0.0345, 0.006),
            (0, 0.006),
        ],
        steps(22, detail, 10),
    )
    pens = []
    for k in range(6):
        a = 2 * np.pi * (k + rng.random()) / 6
        foot = 0.022 * np.array([np.cos(a), np.sin(a)])
        head = 0.036 * np.array([np.cos(a + 2.6), np.sin(a + 2.6)])
        tip = foot + (head - foot) * 1.35
        pens.append(
            bar(
                (*foot, 0.009),
                (*tip, rng.uniform(0.13, 0.165)),
                [0.0036, 0.0036, 0.0036, 0.0030],
                6,
            ).painted(1 + k % 3)
        )
    return join([jar, *pens])


def mug(detail: float) -> Mesh:
    """A coffee mug with a dark rest inside; slots 0 glaze, 1 coffee."""
    n = steps(28, detail, 10)
    wall = lathe(
        [
            (0, 0.0006),
            (0.036, 0.0006),
            (0.040, 0.004),
            (0.041, 0.092),
            (0.0395, 0.094),
            (0.038, 0.092),
            (0.037, 0.006),
            (0, 0.006),
        ],
        n,
    )
    rest = lathe([(0, 0.03), (0.0372, 0.03)], n).painted(1)
    ear = tube(
        smooth_profile(
            [
                (0.039, 0, 0.078),
                (0.062, 0, 0.077),
                (0.070, 0, 0.05),
                (0.058, 0, 0.025),
                (0.039, 0, 0.020),
            ],
            14,
        ),
        0.0048,
        8,
    )
    return join([wall, rest if rest.verts[0, 2] else rest.flipped(), ear])


def folder(rng: np.random.Generator, thick: float = 0.012) -> Mesh:
    """A cardboard folder with papers looking out; slots 0 cardboard, 1 pages."""
    papers = (
        page(rng, thick * 0.7, 0.0)
        .turned("z", rng.normal(0, 2))
        .moved(0.012, rng.normal(0, 0.006), 0.0015)
        .painted(1)
    )
    covers = []
    for z in (0.0008, 0.0022 + thick * 0.75):
        covers.append(block((0.235, 0.315, 0.0012), (0, 0, z), 0.0003))
    lid = covers[1].mapped(
        lambda v: (
            v + np.stack([0 * v[:, 0], 0 * v[:, 0], 0.012 * np.clip(v[:, 0] / 0.117, 0, 1) ** 2], 1)
        )
    )
    return join([covers[0], lid, papers])


def stapler(detail: float) -> Mesh:
    """Slots 0 body, 1 metal."""
    base = rounded_box((0.038, 0.145, 0.010), 0.004).moved(z=0.0055)
    arm = rounded_box((0.032, 0.140, 0.022), 0.008, 2).turned("x", 5).moved(0, -0.001, 0.037)
    del detail
    return join(
        [
            base,
            arm,
            block((0.02, 0.13, 0.008), (0, 0, 0.021), 0.001).painted(1),
            block((0.024, 0.02, 0.03), (0, 0.055, 0.02), 0.002).painted(1),
        ]
    )


def waste_basket(rng: np.random.Generator, detail: float) -> Mesh:
    """A tapered bin with crumpled paper; slots 0 plastic, 1 paper."""
    n = steps(36, detail, 12)
    wall = [
        (0, 0.0008),
        (0.105, 0.0008),
        (0.110, 0.006),
        (0.138, 0.29),
        (0.143, 0.297),
        (0.140, 0.302),
        (0.134, 0.298),
        (0.105, 0.012),
        (0, 0.012),
    ]
    parts = [lathe(wall, n)]
    for k in range(5):
        a = 2 * np.pi * k / 5
        ball = rounded_box((0.09, 0.08, 0.075), 0.025, 1, (3, 3, 3))
        dented = replace(
            ball,
            verts=ball.verts
            + 0.005 * np.stack([ripples(ball.verts, rng, 0.07) for _ in range(3)], 1),
        )
        parts.append(
            dented.turned("x", 70 * k)
            .turned("z", 40 * k)
            .moved(0.05 * np.cos(a), 0.05 * np.sin(a), 0.20 + 0.014 * (k % 3))
            .painted(1)
        )
    return join(parts)
