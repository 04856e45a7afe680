"""Small objects on tables: crockery, fruit, twigs, books.

Local frames: z up from the surface below them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .mesh import Mesh, join
from .shapes import lathe, rounded_box, smooth_profile, steps, tube


def vase(detail: float) -> Mesh:
    """A slender glazed vase, 27 cm, with an inner wall."""
    outer = smooth_profile(
        [
            (0.045, 0.003),
            (0.062, 0.03),
            (0.082, 0.10),
            (0.066, 0.18),
            (0.034, 0.235),
            (0.046, 0.272),
        ],
        steps(20, detail, 8),
    )
    inner = smooth_profile(
        [(0.042, 0.273), (0.029, 0.235), (0.058, 0.18), (0.072, 0.10), (0.0, 0.03)],
        steps(12, detail, 6),
    )
    return lathe(
        np.concatenate([[(0.0, 0.0005), (0.042, 0.0005)], outer, inner]), steps(36, detail, 12)
    )


def twigs(rng: np.random.Generator, detail: float) -> Mesh:
    """Dry branches with buds for the vase; slots 0 bark, 1 buds."""
    parts = []
    bud = lathe(
        [(0, -0.006), (0.004, -0.003), (0.0055, 0.002), (0.003, 0.008), (0, 0.010)], 6
    ).painted(1)
    for k in range(7):
        a = 2 * np.pi * (k + 0.5 * rng.random()) / 7
        lean = rng.uniform(0.06, 0.15)
        tip = np.array([lean * np.cos(a), lean * np.sin(a), rng.uniform(0.40, 0.52)])
        points: list[ArrayLike] = [
            (0.02 * np.cos(a + 2), 0.02 * np.sin(a + 2), 0.05),
            (0.02 * np.cos(a), 0.02 * np.sin(a), 0.26),
            tip * [0.6, 0.6, 0.75] + rng.normal(0, 0.012, 3),
            tip,
        ]
        bends = np.array(points)
        path = smooth_profile(bends, steps(10, detail, 5))
        parts.append(tube(path, np.linspace(0.0032, 0.0014, len(path)), 5))
        for at in smooth_profile(bends, 10)[5:]:
            parts.append(
                bud.turned("x", rng.uniform(-50, 50))
                .turned("z", rng.uniform(0, 360))
                .moved(*(at + rng.normal(0, 0.003, 3)))
            )
    return join(parts)


def plate(detail: float) -> Mesh:
    """A wide shallow bowl-plate, 32 cm across."""
    top = [(0.157, 0.036), (0.150, 0.034), (0.115, 0.020), (0.07, 0.0105), (0.0, 0.009)]
    return lathe(
        [
            (0.0, 0.002),
            (0.065, 0.002),
            (0.068, 0.0005),
            (0.075, 0.0005),
            (0.080, 0.006),
            (0.12, 0.016),
            (0.156, 0.032),
            (0.159, 0.0345),
            *top,
        ],
        steps(48, detail, 16),
    )


def fruit(rng: np.random.Generator, radius: float, detail: float) -> Mesh:
    """An orange resting on z = 0: slightly flattened, dimpled at the stalk."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, steps(16, detail, 6))
    r = radius * np.cos(angle)
    z = 0.93 * radius * np.sin(angle)
    z = z - 0.12 * radius * np.exp(-((r / (0.22 * radius)) ** 2)) * (z > 0)
    r[0] = r[-1] = 0.0
    ball = lathe(np.stack([r, z], 1), steps(24, detail, 8))
    return (
        ball.turned("x", rng.uniform(-25, 25))
        .turned("z", rng.uniform(0, 360))
        .moved(z=0.95 * radius)
    )


def book(size: tuple[float, float, float]) -> Mesh:
    """A lying book (width x, depth y, thickness): slots 0 boards and spine, 1 paper block."""
    w, d, t = size
    covers = [rounded_box((w, d, 0.003), 0.0012).moved(0, 0, z) for z in (0.0015, t - 0.0015)]
    spine = rounded_box((0.004, d, t), 0.0015).moved(-w / 2 - 0.0005, 0, t / 2)
    pages = (
        rounded_box((w - 0.008, d - 0.008, t - 0.0062), 0.0008).moved(-0.001, 0, t / 2).painted(1)
    )
    return join([*covers, spine, pages])


def magazine(rng: np.random.Generator, size: tuple[float, float], detail: float) -> Mesh:
    """A soft-covered magazine lying with one corner curled up."""
    n = steps(10, detail, 4)
    body = rounded_box((size[0], size[1], 0.006), 0.0015, 1, (n, n, 1))
    bend = rng.uniform(0.8, 1.2)

    def curl(v: np.ndarray) -> np.ndarray:
        out = np.clip(v[:, 0] / size[0] + v[:, 1] / size[1] - 0.55, 0, 1)
        v[:, 2] += 0.09 * bend * out**2
        return v

    return Mesh(
        (m := body.mapped(curl)).verts, m.faces, m.uv / np.array(size) + 0.5, m.material
    ).moved(z=0.0032)
