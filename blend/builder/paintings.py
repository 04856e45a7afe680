"""Pictures painted by code: a mountain landscape, a coast, the view from the balcony, the sky. sRGB
bytes, row 0 at the bottom.
"""

from __future__ import annotations

import numpy as np

from .patterns import blend, cloud, smoothstep, to_bytes


def _ridge(
    rng: np.random.Generator, width: int, base: float, height: float, low: float, slope: float = 1.6
) -> np.ndarray:
    """A skyline (width,) in picture heights."""
    line = cloud(rng, (1, width * 2), slope, low, 400)[0][:width]
    return base + height * line


def _sky(
    rng: np.random.Generator,
    shape: tuple[int, int],
    v: np.ndarray,
    top: tuple,
    bottom: tuple,
    cover: float,
) -> np.ndarray:
    """Blue gradient and clouds lit from above; v (h,1) is 0 at the horizon and 1 at the top."""
    sky = blend(bottom, top, np.broadcast_to(np.clip(v, 0, 1) ** 0.7, shape))
    puff = cloud(rng, shape, 1.75, 3, 120, (1.0, 2.0))
    mass = 0.9 * smoothstep(cover, cover + 1.2, puff)
    under = smoothstep(-0.4, 1.0, puff - np.roll(puff, max(2, shape[0] // 40), 0))
    lit = blend((0.58, 0.60, 0.66), (0.97, 0.96, 0.95), np.clip(1 - 0.7 * under, 0, 1))
    return sky * (1 - 0.95 * mass[..., None]) + lit * 0.95 * mass[..., None]


def _mesa(rng: np.random.Generator, width: int, height: float, steep: float) -> np.ndarray:
    """A table mountain's skyline (width,), 0..height: flat tops, steep flanks."""
    line = cloud(rng, (1, 2 * width), 1.8, 1, 9)[0][:width]
    rough = cloud(rng, (1, 2 * width), 1.3, 8, 90)[0][:width]
    return (
        height
        * (smoothstep(-0.7, -0.7 + steep, line) * 0.75 + 0.25 * smoothstep(0.5, 0.5 + steep, line))
        + 0.006 * rough
    )


def landscape(rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """Rocky tableland under a blue cloudy sky, bushes and a river below: the large picture over the
    sofa.
    """
    h, w = size
    y, x = np.mgrid[0:h, 0:w] / np.array([h, w]).reshape(2, 1, 1)
    out = (
        _sky(rng, size, (y[:, :1] - 0.4) / 0.6, (0.20, 0.30, 0.50), (0.50, 0.58, 0.70), 0.75) * 0.92
    )
    for base, tall, tone, contrast in (
        (0.46, 0.05, (0.42, 0.48, 0.56), 0.05),
        (0.38, 0.20, (0.29, 0.285, 0.26), 0.26),
    ):
        line = base + _mesa(rng, w, tall, 0.5)
        rock = cloud(rng, size, 1.55, 3, 56, (0.6, 1.0))
        light = rock - np.roll(rock, 5, 1)
        strata = np.sin(60 * (y + 0.01 * rock) + 2 * rock)
        value = np.clip(1 + contrast * (0.45 * rock + 1.2 * light + 0.15 * strata), 0.3, 1.9)
        out = blend(
            out, np.array(tone) * value[..., None], smoothstep(-0.002, 0.002, line[None] - y)
        )
    bushes = cloud(rng, size, 1.55, 4, 44)
    lit = bushes - np.roll(bushes, 6, 0)
    meadow = smoothstep(-0.6, 1.4, cloud(rng, size, 1.7, 1, 16, (2.0, 1.0)))
    green = blend((0.13, 0.155, 0.10), (0.34, 0.33, 0.21), meadow)
    green = green * np.clip(1 + 0.13 * bushes - 0.36 * lit, 0.35, 1.8)[..., None]
    ground = smoothstep(
        0.0,
        0.04,
        0.33 + 0.06 * cloud(rng, (1, 2 * w), 1.8, 2, 60)[0][:w][None] + 0.008 * bushes - y,
    )
    out = blend(out, green, ground)
    river = np.abs(x - (0.80 - 0.35 * y + 0.03 * np.sin(16 * y))) - 0.045 * (0.34 - y)
    water = smoothstep(0.004, -0.004, river) * (y < 0.28)
    return to_bytes(blend(out, np.array([0.42, 0.49, 0.57]), 0.85 * water))


def coast(rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """Evening over the sea, dunes with grass in front."""
    h, w = size
    y, x = np.mgrid[0:h, 0:w] / np.array([h, w]).reshape(2, 1, 1)
    out = _sky(rng, size, (y[:, :1] - 0.5) / 0.5, (0.30, 0.38, 0.52), (0.93, 0.74, 0.55), 0.25)
    waves = cloud(rng, size, 1.0, 4, 110, (1.0, 5.0))
    glow = np.exp(-(((x - 0.62) / 0.10) ** 2)) * 0.35
    sea = blend(
        (0.10, 0.20, 0.27), (0.45, 0.52, 0.55), np.clip((y / 0.5) ** 3 + 0.18 * waves + glow, 0, 1)
    )
    out = blend(out, sea, (y < 0.5) * 1.0)
    dune = _ridge(rng, w, 0.19, 0.06, 1, 2.0)[None] - y
    grass = cloud(rng, size, 0.9, 6, 110, (0.3, 1.0))
    sand = (
        blend((0.62, 0.54, 0.40), (0.27, 0.30, 0.16), smoothstep(-0.2, 0.7, grass))
        * (1 + 0.12 * grass)[..., None]
    )
    return to_bytes(blend(out, sand, smoothstep(-0.004, 0.008, dune + 0.012 * grass)))


def _town(rng: np.random.Generator, out: np.ndarray, horizon: float) -> np.ndarray:
    """Small houses with gables and windows along a hillside, far and hazy first."""
    h, w = out.shape[:2]
    for k in range(150):
        near = k / 150
        bw = int(w * (0.004 + 0.010 * near))
        bh = int(h * (0.020 + 0.045 * near))
        x0, y0 = (
            int(rng.integers(0, w - bw)),
            int(h * (horizon - 0.02 - 0.17 * near + 0.01 * rng.normal())),
        )
        haze = np.array([0.70, 0.76, 0.83])
        wall = np.array([0.86, 0.82, 0.74]) * rng.uniform(0.75, 1.05) * (1 - 0.08 * rng.random(3))
        roof = np.array([0.55, 0.29, 0.22]) * rng.uniform(0.7, 1.15)
        mix = 0.45 * (1 - near)
        ys = slice(max(y0, 0), max(y0 + bh, 1))
        out[ys, x0 : x0 + bw] = wall * (1 - mix) + haze * mix
        for wx in range(x0 + bw // 6, x0 + bw - 2, max(4, bw // 4)):
            out[max(y0 + bh // 3, 0) : y0 + 2 * bh // 3, wx : wx + max(1, bw // 10)] = (
                1 - mix
            ) * np.array([0.25, 0.28, 0.32]) + mix * haze
        for r in range(max(1, bh // 2)):
            inset = int(bw * 0.5 * r / max(1, bh // 2))
            row = y0 + bh + r
            if 0 <= row < h:
                out[row, x0 + inset - 1 : x0 + bw - inset + 1] = roof * (1 - mix) + haze * mix
    return out


def skyline(seed: int, count: int) -> np.ndarray:
    """Height (count,) of the farthest hills in the balcony's view, as a share of its image: the
    surface ends there, and the sky begins.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 55]))
    t = np.linspace(0, 1, count)[:, None] * np.array([2.0, 3.3, 5.1, 9.7, 16.3, 29.0])
    return 0.86 + (
        np.sin(2 * np.pi * (t + rng.random(6)))
        * np.array([0.030, 0.022, 0.016, 0.008, 0.004, 0.002])
    ).sum(1)


def view(rng: np.random.Generator, size: tuple[int, int], seed: int) -> np.ndarray:
    """The view from the balcony: hazy hills up to the skyline, fields, a small town, gardens with
    trees.
    """
    h, w = size
    y = np.arange(h)[:, None] / h + np.zeros((1, w))
    far = skyline(seed, w)
    forest = cloud(rng, size, 1.1, 6, 200, (0.5, 1.0))
    out = np.array([0.56, 0.65, 0.76]) * (1 + 0.015 * forest)[..., None]
    out = blend(out, (0.66, 0.73, 0.81), 0.5 * smoothstep(0.12, 0.0, np.abs(y - far[None] + 0.1)))
    layers = (
        (0.765, 0.035, (0.47, 0.57, 0.64), 0.05),
        (0.685, 0.03, (0.40, 0.50, 0.48), 0.09),
        (0.60, 0.022, (0.36, 0.45, 0.35), 0.13),
    )
    for base, tall, tone, contrast in layers:
        line = _ridge(rng, w, base, tall, 2, 2.0)
        woods = cloud(rng, size, 0.9, 30, 500, (0.5, 1.0))
        fields = smoothstep(0.4, 0.6, cloud(rng, size, 1.7, 6, 60, (0.25, 1.0)))
        colour = (
            blend(tone, np.array(tone) * 0.6 + np.array([0.25, 0.25, 0.15]), 0.8 * fields)
            * (1 + contrast * woods * (1 - fields))[..., None]
        )
        out = blend(out, colour, smoothstep(-0.003, 0.003, line[None] - y))
    out = _town(rng, out, 0.56)
    for base, tone, grow in ((0.36, (0.24, 0.33, 0.18), 0.02), (0.22, (0.17, 0.26, 0.12), 0.03)):
        crowns = cloud(rng, (1, 2 * w), 1.0, 20, 220)[0][:w]
        leaves = cloud(rng, size, 0.75, 40, 900)
        shade = 1 + 0.30 * leaves + 0.5 * smoothstep(0, 0.2, y - base + 0.1)
        out = blend(
            out,
            np.array(tone) * np.clip(shade, 0.3, 2)[..., None],
            smoothstep(-0.004, 0.004, base + grow * crowns[None] - y),
        )
    return to_bytes(out)


def sky(rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """The whole sky, equirectangular: blue above, pale at the horizon, grey-green ground below."""
    h, w = size
    v = (np.arange(h)[:, None] / h - 0.5) * 2
    above = _sky(rng, size, v * 1.2, (0.30, 0.50, 0.80), (0.80, 0.87, 0.93), 0.55)
    haze = np.exp(-np.clip(v, 0, 1) / 0.06)
    above = blend(above, (0.84, 0.89, 0.94), np.broadcast_to(haze, size))
    return to_bytes(
        blend(above, np.array([0.42, 0.44, 0.40]), np.broadcast_to((v < 0) * 1.0, size))
    )
