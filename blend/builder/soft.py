"""Soft things: sofa, pillow, curtain, rug, throw.

Local frames: z up from the floor, front towards -y.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .mesh import Mesh, grid, join, outward, welded
from .shapes import lathe, ripples, rounded_box, sheet, steps, tube
from .solids import block

# the sofa as measured from official depth
LENGTH = 2.335
DEPTH = 0.985
ARM = 0.28
ARM_TOP = 0.6795
SEAT_TOP = 0.514
BACK_TOP = 0.842
BELLY = 0.155
FABRIC_TILE = 0.32
GAP = 0.012  # between the cushions, and between these and the arms: two pixels in official frames


def _placed_box(low: tuple, high: tuple, radius: float, arcs: int, divisions: tuple) -> Mesh:
    first, last = np.array(low), np.array(high)
    return rounded_box(last - first, radius, arcs, divisions, FABRIC_TILE).moved(
        *((first + last) / 2)
    )


def _crumpled(mesh: Mesh, rng: np.random.Generator, height: float, wavelength: float) -> Mesh:
    shift = np.stack([ripples(mesh.verts, rng, wavelength) for _ in range(3)], 1)
    return mesh.mapped(lambda v: v + height * shift)


def _seat(x0: float, x1: float, rng: np.random.Generator, detail: float) -> Mesh:
    """A seat cushion: domed, front edge rolled, a little sat upon."""
    n = steps(9, detail)
    seat = _placed_box((x0, 0.002, 0.352), (x1, 0.70, SEAT_TOP - 0.006), 0.03, 2, (n, n, 2))
    cx = (x0 + x1) / 2
    hx = (x1 - x0) / 2

    def sag(v: np.ndarray) -> np.ndarray:
        s, t = (v[:, 0] - cx) / hx, (v[:, 1] - 0.35) / 0.35
        top = np.clip((v[:, 2] - 0.40) / 0.1, 0, 1)
        dome = np.clip((1 - s**4) * (1 - t**4), 0, 1)
        v[:, 2] += top * (
            0.008 * dome - 0.007 * np.exp(-((s / 0.45) ** 2 + ((t - 0.1) / 0.5) ** 2))
        )
        v[:, 1] -= 0.006 * (1 - s**2) * np.clip(-t, 0, 1) ** 4
        return v

    return _crumpled(seat.mapped(sag), rng, 0.0011, 0.16)


def _back(rng: np.random.Generator, detail: float) -> Mesh:
    n = steps(18, detail)
    back = _placed_box(
        (-LENGTH / 2, 0.703, BELLY), (LENGTH / 2, DEPTH, BACK_TOP), 0.05, 2, (n, 2, 8)
    )

    def lean(v: np.ndarray) -> np.ndarray:
        front = np.clip((DEPTH - v[:, 1]) / (DEPTH - 0.703), 0, 1)
        up = np.clip((v[:, 2] - SEAT_TOP) / (BACK_TOP - SEAT_TOP), 0, 1)
        puff = np.sin(np.pi * up) * (1 - (2 * v[:, 0] / LENGTH) ** 8)
        v[:, 1] += front * (0.045 * up**2 - 0.010 * puff)
        return v

    return _crumpled(back.mapped(lean), rng, 0.0012, 0.3)


def sofa(rng: np.random.Generator, detail: float) -> Mesh:
    """A two-seat sofa, slots: 0 fabric, 1 feet and the dark inside of the gaps.

    Centred in x, front at y = 0, back at y = DEPTH, floor at z = 0.
    """
    half = LENGTH / 2
    inner = LENGTH / 2 - ARM
    n = steps(6, detail)
    arm = _placed_box((-half, 0.0, BELLY), (-inner, 0.698, ARM_TOP), 0.028, 2, (2, n, 3))

    def soften(v: np.ndarray) -> np.ndarray:
        v[:, 2] -= 0.016 * np.clip(1 - v[:, 1] / 0.09, 0, 1) ** 2 * (v[:, 2] > 0.5)
        v[:, 0] += (
            0.006
            * np.sin(np.pi * np.clip(v[:, 1] / 0.7, 0, 1))
            * np.sign(v[:, 0] + half - ARM / 2)
            * (v[:, 2] > 0.3)
        )
        return v

    arm = _crumpled(arm.mapped(soften), rng, 0.0010, 0.2)
    base = _placed_box(
        (-inner + 0.004, 0.010, BELLY + 0.004), (inner - 0.004, 0.698, 0.342), 0.010, 1, (n, 1, 1)
    )
    seats = [
        _seat(-inner + GAP / 2, -GAP / 2, rng, detail),
        _seat(GAP / 2, inner - GAP / 2, rng, detail),
    ]
    gaps = [
        block((2 * inner, 0.60, GAP), (0, 0.325, 0.347), 0.001),
        *(block((GAP, 0.60, 0.13), (x, 0.325, 0.425), 0.001) for x in (-inner, 0, inner)),
    ]
    foot = lathe(
        [(0, 0.0), (0.018, 0.0), (0.020, 0.004), (0.026, BELLY + 0.004)], steps(12, detail, 6)
    ).painted(1)
    feet = []
    for x in (-half + 0.075, -inner + 0.02, inner - 0.02, half - 0.075):
        for y in (0.055, DEPTH - 0.06):
            feet.append(foot.moved(x, y))
    feet += [foot.moved(0, 0.055), foot.moved(0, DEPTH - 0.06)]
    return join(
        [
            arm,
            arm.mirrored(0),
            base,
            _back(rng, detail),
            *seats,
            *(gap.painted(1) for gap in gaps),
            *feet,
        ]
    )


def pillow(
    rng: np.random.Generator, size: float, thick: float, detail: float, crease: float = 1.0
) -> Mesh:
    """A scatter cushion standing on its lower edge (z = 0), centred in x, facing -y: dog ears,
    puckered seams, a dent from a hand.
    """
    n = steps(22, detail, 6) + 1
    s, t = np.meshgrid(
        np.sin(np.linspace(-1, 1, n) * np.pi / 2), np.sin(np.linspace(-1, 1, n) * np.pi / 2)
    )
    pinch = 0.05
    corner = 0.045 * s**8 * t**8
    x, z = s * (1 - pinch * (1 - t**2) - corner), t * (1 - pinch * (1 - s**2) - corner)
    body = np.clip((1 - s**2) * (1 - t**2), 0, 1)
    flat = np.stack([x, 0 * x, z], -1).reshape(-1, 3) * size / 2
    wrinkle = ripples(flat * np.array([1.0, 1.0, 0.5]), rng, 0.11).reshape(n, n)
    radial = np.sin(26 * np.arctan2(t, s) + 3 * wrinkle) * np.clip(1 - body, 0, 1) ** 3 * body**0.35
    depth = thick / 2 * body**0.5 * (1 + 0.07 * crease * wrinkle) + crease * 0.006 * radial
    dent = 0.16 * np.exp(-((s / 0.30) ** 2) - ((t - 0.9) / 0.45) ** 2)
    z = z - dent * np.clip(t, 0, 1) * 0.5
    sides = []
    uv = np.stack([(s + 1) / 2, (t + 1) / 2], -1) * size / FABRIC_TILE
    for sign in (-1, 1):
        p = np.stack([x * size / 2, sign * depth, z * size / 2], -1)
        side = grid(p, uv)
        sides.append(side.flipped() if sign > 0 else side)
    edge = np.concatenate([np.stack([c, 0 * c, d], -1) for c, d in _outline(x, z)]) * size / 2
    piping = tube(edge, 0.0045, steps(6, detail, 4), closed_ends=False).box_mapped(0.06)
    mesh = join([outward(welded(join(sides))), piping])

    def settle(v: np.ndarray) -> np.ndarray:
        low = np.clip(-v[:, 2] / (size / 2), 0, 1)
        v[:, 1] *= 1 + 0.22 * low * (1 - low) * 4
        v[:, 2] += size / 2
        v[:, 2] = np.where(v[:, 2] < 0.02, 0.02 + 0.35 * (v[:, 2] - 0.02), v[:, 2])
        return v

    return mesh.mapped(settle)


def _outline(x: np.ndarray, z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    sides: tuple[Any, ...] = (
        (0, slice(None)),
        (slice(None), -1),
        (-1, slice(None, None, -1)),
        (slice(None, None, -1), 0),
    )
    first = [(x[i][:-1], z[i][:-1]) for i in sides[:3]]
    return [*first, (x[sides[3]], z[sides[3]])]


def curtain(
    rng: np.random.Generator, width: float, height: float, pleats: int, detail: float
) -> Mesh:
    """A hanging pleated curtain, x from 0 to width, z from 0 to height, folds in y. One surface, so
    that light passes.
    """
    columns, rows = pleats * steps(10, detail, 5) + 1, steps(22, detail, 6)
    s, t = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows) ** 0.85)
    flat = np.stack([s * width * 2.2, 0 * s, t * height * 0.35], -1).reshape(-1, 3)
    drift = ripples(flat, rng, 0.55).reshape(s.shape)
    vary = ripples(flat, rng, 0.30).reshape(s.shape)
    loose = 1 - t
    phase = 2 * np.pi * (pleats * s + 0.16 * drift * loose)
    fold = np.sin(phase) + 0.25 * np.sin(2 * phase + 0.6)
    amplitude = (0.030 + 0.022 * loose) * (1 + 0.28 * vary * loose)
    x = (
        width * (s + 0.010 * np.cos(phase) + 0.02 * drift * loose * np.sin(np.pi * s))
        - 0.05 * width * loose * (s - 0.5) * 2
    )
    y = amplitude * fold + 0.03 * loose * (drift * 0.3)
    uv = np.stack([s * width * 2.0 / 0.35, t * height / 0.35], -1)
    return grid(np.stack([x, y, t * height], -1), uv)


def rug(rng: np.random.Generator, width: float, length: float, detail: float) -> Mesh:
    """A rug lying on z = 0, 9 mm thick with slightly wavy edges; no underside.

    Slots: 0 rug, 1 fringe.
    """
    nx = steps(36, detail)
    ny = steps(36, detail)
    x, y = np.meshgrid(
        np.linspace(-width / 2, width / 2, nx + 1), np.linspace(-length / 2, length / 2, ny + 1)
    )
    wave = ripples(np.stack([x, y, 0 * x], -1).reshape(-1, 3), rng, 0.5).reshape(x.shape)
    z = 0.009 + 0.0009 * wave
    p = np.stack([x + 0.004 * wave, y + 0.003 * np.roll(wave, 5, 1), z], -1)
    rim = np.concatenate([p[0, :-1], p[:-1, -1], p[-1, :0:-1], p[:0:-1, 0], p[:1, 0]])
    low = rim.copy()
    low[:, 2] = 0.0005
    side = grid(np.stack([low, rim]))
    side.uv[...] = 0.01
    strands = []
    for sign in (-1, 1):
        for x0 in np.linspace(-width / 2 + 0.012, width / 2 - 0.012, 70):
            tip = np.array(
                [x0 + rng.normal(0, 0.006), sign * (length / 2 + rng.uniform(0.045, 0.06)), 0.0035]
            )
            mid = np.array(
                [(x0 + tip[0]) / 2 + rng.normal(0, 0.003), sign * (length / 2 + 0.024), 0.0045]
            )
            strands.append(
                tube(
                    np.array([[x0, sign * (length / 2 - 0.004), 0.006], mid, tip]),
                    [0.0035, 0.003, 0.0035],
                    5,
                ).painted(1)
            )
    shown = np.linspace(0, len(strands) - 1, 2 * steps(70, min(detail, 1.0), 8)).round().astype(int)
    return join([grid(p), side, *(strands[k] for k in shown)])


def throw(rng: np.random.Generator, detail: float) -> Mesh:
    """A knitted throw hanging over a sofa's arm: lies on top (local z = ARM_TOP), falls on both
    sides. x across the arm, y along it.
    """
    half = ARM / 2 + 0.009
    drop_out = 0.40
    drop_in = 0.155
    wide = 0.42
    corner = 0.03
    path = [
        (-half - 0.012, -drop_out),
        (-half - 0.004, -drop_out / 2),
        (-half, -corner),
        (-half + 0.010, -0.004),
        (-half + corner, 0.010),
    ]
    path += [
        (0, 0.011),
        (half - corner, 0.010),
        (half - 0.008, -0.004),
        (half + 0.002, -corner),
        (half + 0.004, -drop_in),
    ]
    line = _even(np.array(path), steps(34, detail, 10))
    t = np.linspace(-0.5, 0.5, steps(22, detail, 6))
    px, s = np.meshgrid(line[:, 0], t)
    pz, _ = np.meshgrid(line[:, 1], t)
    hang = np.clip(-pz / 0.2, 0, 1.6)
    flat = np.stack([px, s * wide, pz], -1).reshape(-1, 3)
    fold = ripples(flat * np.array([0.3, 1.0, 0.15]), rng, 0.13).reshape(px.shape)
    x = px + np.sign(px) * (0.010 + 0.011 * fold) * hang
    y = s * wide * (1 - 0.06 * hang) + 0.05 * pz * (px < 0) + 0.006 * fold
    z = pz + 0.004 * (fold + 1) * (hang < 0.05) + 0.012 * fold * hang * (px < 0)
    points = np.stack([x, y, z + ARM_TOP], -1)
    uv = np.stack(
        [
            (s + 0.5) * wide / 0.2,
            np.broadcast_to(np.linspace(0, 1.05, line.shape[0]) / 0.2, px.shape),
        ],
        -1,
    )
    return sheet(points, 0.007, uv)


def _even(path: np.ndarray, count: int) -> np.ndarray:
    run = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0, run[-1], count)
    return np.stack([np.interp(at, run, path[:, k]) for k in range(path.shape[1])], 1)
