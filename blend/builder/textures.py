"""Surface colours painted by code from a seed: plaster, boards, cloth, rug. Each function gives
sRGB bytes (rows, columns, 3), row 0 at the bottom.
"""

from __future__ import annotations

import numpy as np

from .patterns import blend, cloud, enlarged, grain, smoothstep, to_bytes, weave

Colour = tuple[float, float, float]


def plaster(rng: np.random.Generator, size: int, tone: Colour, strength: float = 1.0) -> np.ndarray:
    """Mottled trowelled plaster: broad patches, trowel strokes, fine sand."""
    shape = (size, size)
    patches = cloud(rng, shape, 1.6, 2, 40)
    strokes = cloud(rng, shape, 1.1, 4, 160, (1.0, 0.45)) * smoothstep(
        -0.5, 1.5, cloud(rng, shape, 1.5, 2, 8)
    )
    veins = np.exp(-((cloud(rng, shape, 1.5, 3, 60) / 0.10) ** 2))
    sand = cloud(rng, shape, 0.1, 60)
    value = 0.014 * patches + 0.024 * strokes - 0.020 * veins + 0.038 * sand
    warmth = 0.005 * cloud(rng, shape, 1.7, 1, 12)
    rgb = np.array(tone) * (1 + strength * value[..., None])
    return to_bytes(rgb + strength * warmth[..., None] * np.array([1.0, 0.2, -1.0]))


def boards(
    rng: np.random.Generator, size: int, rows: int, dark: Colour, light: Colour
) -> np.ndarray:
    """A floor of narrow boards with staggered ends; columns run along the boards."""
    height = size // rows
    out = np.zeros((size, size, 3))
    for row in range(rows):
        cuts = np.sort(rng.integers(0, size, 2)) + np.array([0, size // 5])
        strip = grain(rng, (height, size), rng.integers(2, 5))
        tones = rng.normal(0, 1, 3)
        piece = np.searchsorted(cuts % size, np.arange(size)) % 2
        tone = np.where(piece == 0, tones[0], tones[1])
        colour = blend(light, dark, np.clip(0.75 * strip + 0.16 * tone[None], 0, 1)) * (
            1 + 0.05 * tone[None, :, None]
        )
        seam = np.minimum(np.arange(height), np.arange(height)[::-1])
        edge = smoothstep(-0.5, max(1.5, height / 22), seam.astype(float))
        ends = np.min(
            np.abs((np.arange(size)[:, None] - cuts[None] + size / 2) % size - size / 2), 1
        )
        shade = (0.45 + 0.55 * edge)[:, None] * (
            0.5 + 0.5 * smoothstep(0, 2.5, ends.astype(float))
        )[None]
        out[row * height : (row + 1) * height] = colour * shade[..., None]
    out[rows * height :] = out[: size - rows * height]
    return to_bytes(out)


def timber(
    rng: np.random.Generator, size: int, dark: Colour, light: Colour, rings: float = 7
) -> np.ndarray:
    """Planed wood, grain along the columns."""
    shape = (size, size)
    tone = 1 + 0.04 * cloud(rng, shape, 1.5, 1, 6, (1, 4))
    return to_bytes(blend(light, dark, grain(rng, shape, rings)) * tone[..., None])


def cloth(
    rng: np.random.Generator,
    size: int,
    threads: int,
    tone: Colour,
    depth: float = 0.35,
    slub: float = 0.05,
) -> np.ndarray:
    """Woven cloth with uneven threads."""
    crown = weave(rng, size, threads)
    lines = cloud(rng, (size, size), 0.7, 3, threads * 2, (1, 8)) + cloud(
        rng, (size, size), 0.7, 3, threads * 2, (8, 1)
    )
    value = 1 - depth * (1 - np.clip(crown, 0, 1)) + slub * 0.6 * lines
    return to_bytes(np.array(tone) * value[..., None])


def boucle(
    rng: np.random.Generator, size: int, loops: int, tone: Colour, depth: float = 0.4
) -> np.ndarray:
    """Coarse looped upholstery: short bright yarns with dark gaps between, in irregular rows that
    deviate by more than their distance. Regular rows would cause moire with the rows of pixels, and
    an image shifted by one row would match itself.
    """
    shape = (size, size)
    y, x = np.mgrid[0:size, 0:size] / size
    row = y * loops + 1.2 * cloud(rng, shape, 1.2, 3, loops)
    col = x * loops / 2 + 0.5 * (np.floor(row) % 2) + 1.2 * cloud(rng, shape, 1.2, 3, loops)
    loop = np.sin(np.pi * (row % 1)) ** 0.5 * (0.4 + 0.6 * np.abs(np.sin(np.pi * col)) ** 0.5)
    each = enlarged(rng.normal(0, 1, (loops, loops // 2)), shape)
    fine = cloud(rng, shape, 0.3, loops)
    pressed = cloud(rng, shape, 1.5, 1, loops // 2)
    value = 1 - depth * (1 - loop) + depth * (0.10 * each * loop + 0.08 * fine + 0.1 * pressed)
    return to_bytes(np.array(tone) * value[..., None])


def rug(rng: np.random.Generator, size: int) -> np.ndarray:
    """A woven wool rug: border bands, a lattice of diamonds, abrash (uneven dye), pile."""
    y, x = np.mgrid[0:size, 0:size] / (size - 1)
    wobble = 0.004 * cloud(rng, (size, size), 1.5, 2, 30)
    edge = np.minimum(np.minimum(x, 1 - x) * 1.15, np.minimum(y, 1 - y)) + wobble
    ivory = (0.74, 0.69, 0.60)
    red = (0.46, 0.20, 0.17)
    navy = (0.20, 0.24, 0.32)
    ochre = (0.62, 0.49, 0.31)
    u, v = (x - 0.5) * 7 + wobble * 3, (y - 0.5) * 8 + wobble * 3
    cell = np.abs(u - np.round(u)) + np.abs(v - np.round(v))
    odd = (np.round(u) + np.round(v)) % 2
    field = blend(red, navy, odd * 1.0)
    field = blend(field, ochre, ((cell > 0.30) & (cell < 0.37)) * 1.0)
    field = blend(field, ivory, (cell < 0.14) * 1.0)
    field = blend(field, np.array(red) * 0.7, (cell > 0.47) * (cell < 0.53) * 1.0)
    tri = np.abs(((x + y) * 26) % 2 - 1) + 0 * x
    band = blend(navy, ivory, (tri > 0.55) * 1.0)
    out = blend(field, band, (edge < 0.105) * 1.0)
    for near, far, colour in (
        (0.098, 0.112, ochre),
        (0.055, 0.062, red),
        (0.0, 0.05, red),
        (0.022, 0.030, ivory),
    ):
        out = blend(out, colour, ((edge >= near) & (edge < far)) * 1.0)
    abrash = 0.06 * cloud(rng, (size, size), 1.4, 1, 20, (1.0, 0.15))
    pile = 0.10 * cloud(rng, (size, size), 0.25, 40) + 0.06 * np.sin(y * size * np.pi / 3)
    return to_bytes(out * (1 + abrash + pile)[..., None])


def leaf(rng: np.random.Generator, size: int) -> np.ndarray:
    """A broad leaf: midrib along v at u = 0.5, side veins, blotches."""
    y, x = np.mgrid[0:size, 0:size] / size
    side = np.abs(x - 0.5) * 2
    vein = np.exp(-((((y * 14 - side * 4.5) % 1 - 0.5) / 0.07) ** 2)) * smoothstep(0.03, 0.3, side)
    rib = np.exp(-((side / 0.035) ** 2))
    blotch = 0.10 * cloud(rng, (size, size), 1.3, 2, 40)
    base = (
        np.array([0.13, 0.30, 0.12]) * (1 + blotch)[..., None] * (1 - 0.2 * (1 - side))[..., None]
    )
    return to_bytes(
        blend(blend(base, (0.26, 0.45, 0.20), 0.55 * vein), (0.42, 0.58, 0.30), 0.9 * rib)
    )


def stone(rng: np.random.Generator, size: int, tone: Colour, tiles: int) -> np.ndarray:
    """Square paving tiles with joints."""
    t = np.arange(size) / size * tiles
    joint = np.minimum(t % 1, 1 - t % 1)
    gap = smoothstep(0.01, 0.03, np.minimum(joint[:, None], joint[None]))
    each = enlarged(rng.normal(0, 1, (tiles, tiles)), (size, size))
    value = (
        1
        + 0.05 * each
        + 0.05 * cloud(rng, (size, size), 1.0, 4)
        + 0.03 * cloud(rng, (size, size), 0.2, 40)
    )
    return to_bytes(np.array(tone) * (value * (0.6 + 0.4 * gap))[..., None])
