"""Surface colours of the office painted by code: carpet, ceiling panels, paint, prints. sRGB bytes,
row 0 at the bottom.
"""

from __future__ import annotations

import numpy as np

from .patterns import blend, cloud, enlarged, smoothstep, to_bytes
from .textures import timber

Colour = tuple[float, float, float]

#: Letters 5 x 7 for the cabinets' labels, rows from the top, five bits each.
_GLYPHS = {
    "A": (14, 17, 17, 31, 17, 17, 17), "D": (30, 17, 17, 17, 17, 17, 30), "E": (31, 16, 16, 30, 16,
    16, 31),
    "H": (17, 17, 17, 31, 17, 17, 17), "I": (14, 4, 4, 4, 4, 4, 14), "L": (16, 16, 16, 16, 16, 16,
    31),
    "M": (17, 27, 21, 21, 17, 17, 17), "P": (30, 17, 17, 30, 16, 16, 16), "Q": (14, 17, 17, 17, 21,
    18, 13),
    "T": (31, 4, 4, 4, 4, 4, 4), "U": (17, 17, 17, 17, 17, 17, 14), "Z": (31, 1, 2, 4, 8, 16, 31),
    "-": (0, 0, 0, 31, 0, 0, 0),
}  # fmt: skip
LABELS = ("A-D", "E-H", "I-L", "M-P", "Q-T", "U-Z")


def carpet(rng: np.random.Generator, size: int, tone: Colour) -> np.ndarray:
    """2 x 2 m of half-metre carpet tiles: pile, uneven tiles, soiled in places along every second
    seam.
    """
    shape = (size, size)
    t = np.arange(size) / size
    seam = np.minimum((4 * t) % 1, 1 - (4 * t) % 1) / 4  # of the tile's 2 m
    joint = smoothstep(0.0, 0.0016, np.minimum(seam[:, None], seam[None]))
    metre = np.abs((2 * t + 0.5) % 1 - 0.5) / 2
    wander = 1 + 0.6 * cloud(rng, shape, 1.5, 1, 20)
    soil = np.exp(-np.minimum(metre[:, None], metre[None]) / (0.035 * np.clip(wander, 0.3, 2)))
    each = enlarged(rng.normal(0, 1, (4, 4)), shape)
    # as much contrast between pixels as in two official frames, where a pixel covers 3 to 8 mm
    pile = cloud(rng, shape, 0.25, 60) * 0.115 + cloud(rng, shape, 0.4, 45, 270) * 0.145
    worn = cloud(rng, shape, 1.5, 1, 30)
    soil *= np.clip(0.85 + 0.7 * cloud(rng, shape, 1.2, 1, 6), 0.15, 2)
    value = (1 + pile + 0.018 * each + 0.03 * worn - 0.28 * soil) * (0.82 + 0.18 * joint)
    return to_bytes(
        np.array(tone) * value[..., None] * (1 - soil[..., None] * np.array([0.0, 0.03, 0.06]))
    )


def mineral(rng: np.random.Generator, size: int, tone: Colour) -> np.ndarray:
    """2 x 2 m of ceiling panels: fine fissures and pin holes, each panel a shade of its own."""
    shape = (size, size)
    each = enlarged(rng.normal(0, 1, (4, 4)), shape)
    fissure = smoothstep(1.3, 1.8, cloud(rng, shape, 0.5, 40, 260, (1.0, 2.5)))
    fine = cloud(rng, shape, 0.3, 60)
    value = 1 + 0.008 * each + 0.003 * fine - 0.020 * fissure
    return to_bytes(np.array(tone) * value[..., None])


def louvers(rng: np.random.Generator, size: int, tone: Colour) -> np.ndarray:
    """A luminaire's light: 4 x 4 cells, brightest beside their middle, between grey blades."""
    at = (np.arange(size) + 0.5) / size * 4 % 1
    bright = smoothstep(0.02, 0.30, np.minimum(at, 0.92 * (1 - at)))
    blade = smoothstep(0.012, 0.05, np.minimum(at, 1 - at))
    cell = bright[:, None] * bright[None] * (1 + 0.06 * cloud(rng, (size, size), 1.2, 4, 40))
    value = (0.72 + 0.30 * cell) * (0.86 + 0.14 * blade[:, None] * blade[None])
    return to_bytes(np.array(tone) * value.clip(0, 1)[..., None])


def paint(rng: np.random.Generator, size: int, tone: Colour, strength: float = 1.0) -> np.ndarray:
    """Rolled wall paint on a smooth wall: very fine texture, faint patches, some scuffs."""
    shape = (size, size)
    value = 0.0015 * cloud(rng, shape, 1.6, 1, 20) + 0.0014 * cloud(rng, shape, 0.35, 50)
    return to_bytes(np.array(tone) * (1 + strength * value[..., None]))


def worn_paint(rng: np.random.Generator, size: int, tone: Colour) -> np.ndarray:
    """Enamel on sheet metal: clouds, thin scratches, small chips."""
    shape = (size, size)
    scratch = smoothstep(2.6, 3.2, cloud(rng, shape, 0.7, 20, 300, (1.0, 14.0)))
    chip = smoothstep(3.1, 3.4, cloud(rng, shape, 0.9, 30, 260))
    value = (
        1
        + 0.022 * cloud(rng, shape, 1.5, 1, 40)
        + 0.012 * cloud(rng, shape, 0.3, 50)
        + 0.10 * scratch
        - 0.2 * chip
    )
    return to_bytes(np.array(tone) * value[..., None])


def laminate(
    rng: np.random.Generator, size: int, dark: Colour, light: Colour, rings: float
) -> np.ndarray:
    """1 x 1 m of a desk's top: timber with long streaks along the grain, and short fine ones."""
    shape = (size, size)
    streaks = 0.11 * cloud(rng, shape, 0.3, 20, 250, (1, 30)) + 0.24 * cloud(
        rng, shape, 0.1, 90, 400, (1, 8)
    )
    return to_bytes(timber(rng, size, dark, light, rings) / 255 * (1 + streaks[..., None]))


def cork(rng: np.random.Generator, size: int) -> np.ndarray:
    value = (
        1 + 0.10 * cloud(rng, (size, size), 0.5, 20, 400) + 0.05 * cloud(rng, (size, size), 0.2, 80)
    )
    return to_bytes(np.array((0.66, 0.50, 0.34)) * value[..., None])


def labels(rng: np.random.Generator, height: int) -> np.ndarray:
    """Six white cards side by side with typed letters."""
    wide = height * 7 // 4
    out = 0.92 + 0.01 * rng.normal(size=(height, wide * 6))
    for k, text in enumerate(LABELS):
        dot = max(1, height // 14)
        x0, y0 = k * wide + (wide - 17 * dot) // 2, (height - 7 * dot) // 2
        for i, letter in enumerate(text):
            for row, bits in enumerate(_GLYPHS[letter]):
                for column in range(5):
                    if bits >> (4 - column) & 1:
                        x, y = x0 + (6 * i + column) * dot, y0 + (6 - row) * dot
                        out[y : y + dot, x : x + dot] = 0.12
    return to_bytes(np.repeat(out[..., None], 3, 2))


def pages(rng: np.random.Generator, size: int) -> np.ndarray:
    """Four typed pages, two by two: letter, list, table with a chart, handwriting on yellow."""
    half = size // 2
    out = np.full((size, size, 3), 0.93)
    for k in range(4):
        y0, x0 = (k // 2) * half, (k % 2) * half
        leaf = out[y0 : y0 + half, x0 : x0 + half]
        leaf[:] = (0.93, 0.925, 0.90) if k < 3 else (0.92, 0.89, 0.70)
        _write(rng, leaf, list_like=k == 1, chart=k == 2)
    return to_bytes(out)


def _write(rng: np.random.Generator, leaf: np.ndarray, list_like: bool, chart: bool) -> None:
    n = len(leaf)
    tone = np.array((0.52, 0.52, 0.55))
    leaf[
        int(0.90 * n) : int(0.925 * n), int(0.1 * n) : int(0.1 * n + 0.4 * n * rng.uniform(0.5, 1))
    ] = tone
    for y in np.arange(0.08, 0.86, 0.026):
        if chart and 0.2 < y < 0.5 or rng.random() < 0.08:
            continue
        x = 0.1 + 0.05 * list_like
        end = rng.uniform(0.55, 0.9) if rng.random() < 0.25 else 0.9
        while x < (0.5 if list_like and rng.random() < 0.5 else end):
            word = rng.uniform(0.02, 0.09)
            leaf[int(y * n) : int((y + 0.010) * n), int(x * n) : int(min(x + word, end) * n)] = (
                tone + rng.uniform(0, 0.25)
            )
            x += word + 0.014
    if chart:
        for i, tall in enumerate(rng.uniform(0.05, 0.26, 8)):
            leaf[
                int(0.22 * n) : int((0.22 + tall) * n),
                int((0.15 + 0.085 * i) * n) : int((0.21 + 0.085 * i) * n),
            ] = (
                0.25,
                0.35,
                0.6,
            )


def spines(rng: np.random.Generator, size: tuple[int, int], books: int, binders: int) -> np.ndarray:
    """An atlas of backs, one a column: titles as broken bands across books, white labels and a hole
    on binders.
    """
    h, w = size
    out = np.zeros((h, w, 3))
    cell = w // (books + binders)
    dyes = np.array(
        [
            (0.45, 0.10, 0.10),
            (0.12, 0.18, 0.34),
            (0.10, 0.28, 0.20),
            (0.78, 0.72, 0.58),
            (0.14, 0.14, 0.15),
            (0.70, 0.42, 0.12),
            (0.36, 0.20, 0.38),
            (0.86, 0.84, 0.80),
            (0.20, 0.42, 0.52),
            (0.55, 0.30, 0.20),
        ]
    )
    for k in range(books + binders):
        back = out[:, k * cell : (k + 1) * cell]
        back[:] = dyes[rng.integers(len(dyes))] * rng.uniform(0.8, 1.15)
        _bind(rng, back) if k < books else _file(rng, back)
    return to_bytes(out * (1 + 0.03 * cloud(rng, (h, w), 0.8, 4))[..., None])


def _bind(rng: np.random.Generator, back: np.ndarray) -> None:
    h, w = back.shape[:2]
    ink = np.array((0.90, 0.84, 0.62)) if back.mean() < 0.5 else np.array((0.15, 0.13, 0.16))
    for y in rng.choice([0.06, 0.09, 0.90, 0.94], 2, replace=False):
        back[int(y * h) : int(y * h) + max(2, h // 120)] = ink
    y = 0.22
    while y < rng.uniform(0.6, 0.8):
        run = rng.uniform(0.03, 0.09)
        back[int(y * h) : int((y + run) * h), int(0.38 * w) : int(0.62 * w)] = ink
        y += run + 0.02


def _file(rng: np.random.Generator, back: np.ndarray) -> None:
    h, w = back.shape[:2]
    back[:] = back * 0.25 + rng.choice([0.08, 0.12, 0.40])
    back[int(0.45 * h) : int(0.86 * h), int(0.16 * w) : int(0.84 * w)] = (0.90, 0.89, 0.85)
    for y in np.arange(0.52, 0.82, 0.05):
        back[int(y * h) : int((y + 0.012) * h), int(0.26 * w) : int(rng.uniform(0.5, 0.76) * w)] = (
            0.2,
            0.2,
            0.25,
        )
    yy, xx = np.mgrid[0:h, 0:w]
    back[np.hypot((yy / h - 0.18) * 4.2, xx / w - 0.5) < 0.22] = (0.55, 0.55, 0.56)
    back[np.hypot((yy / h - 0.18) * 4.2, xx / w - 0.5) < 0.15] = (0.03, 0.03, 0.03)


def spreadsheet(rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """A window with a table on a teal desktop, as a screen showed it then."""
    h, w = size
    out = np.zeros((h, w, 3)) + np.array((0.0, 0.50, 0.50))
    out[: int(0.055 * h)] = 0.75
    out[int(0.10 * h) : int(0.95 * h), int(0.05 * w) : int(0.93 * w)] = 0.75
    out[int(0.90 * h) : int(0.94 * h), int(0.055 * w) : int(0.925 * w)] = (0.0, 0.0, 0.5)
    sheet = out[int(0.12 * h) : int(0.80 * h), int(0.06 * w) : int(0.92 * w)]
    sheet[:] = 0.97
    rows, columns = sheet.shape[0] // 14, 9
    for r in range(rows):
        sheet[r * sheet.shape[0] // rows] = 0.88
        for c in range(columns):
            x0 = c * sheet.shape[1] // columns
            y0 = r * sheet.shape[0] // rows
            fill = rng.random()
            sheet[:, x0] = 0.88
            if fill < 0.75:
                sheet[
                    y0 + 3 : y0 + 8, x0 + 4 : x0 + 4 + int(0.8 * fill * sheet.shape[1] / columns)
                ] = 0.60
    return to_bytes(out)


def dial(rng: np.random.Generator, size: int) -> np.ndarray:
    """A clock face: minute marks, bold hours."""
    del rng
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size * 2 - 1
    r = np.hypot(x, y)
    a = np.degrees(np.arctan2(x, y))
    minute, hour = (np.abs((a / step + 0.5) % 1 - 0.5) * step for step in (6, 30))
    ink = ((r > 0.86) & (r < 0.94) & (minute < 0.7)) | ((r > 0.70) & (r < 0.94) & (hour < 2.2))
    return to_bytes(blend((0.93, 0.93, 0.90), (0.06, 0.06, 0.07), ink * 1.0))


def still_life(rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """A lit window with bars behind two pots of foliage: the small poster over desk A."""
    h, w = size
    y, x = np.mgrid[0:h, 0:w] / np.array([h, w]).reshape(2, 1, 1)
    out = blend(
        (0.80, 0.50, 0.22),
        (0.93, 0.82, 0.52),
        np.clip(y + 0.15 * cloud(rng, size, 1.5, 1, 20), 0, 1),
    )
    bars = (np.abs((x * 3) % 1 - 0.5) > 0.47) | (np.abs((y * 4) % 1 - 0.5) > 0.47)
    out = blend(out, (0.10, 0.07, 0.06), bars * 1.0)
    out = blend(out, (0.42, 0.20, 0.10), (y < 0.16) * 1.0)
    for cx, wide, tall in ((0.30, 0.13, 0.30), (0.70, 0.15, 0.24)):
        out = blend(
            out,
            (0.36, 0.12, 0.07),
            ((np.abs(x - cx) < wide * (0.6 + 0.6 * y)) & (y > 0.10) & (y < tall)) * 1.0,
        )
        leaf = cloud(rng, size, 0.8, 6, 60) + 1.6 - 9 * np.hypot((x - cx) * 1.3, y - tall - 0.22)
        green = np.array((0.12, 0.22, 0.08)) * (1 + 0.4 * cloud(rng, size, 0.6, 10, 120))[..., None]
        out = blend(out, green, smoothstep(-0.2, 0.2, leaf))
    return to_bytes(out)


def rocks(rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """Pale cliffs with bushes over dark water under a blue sky with one cloud: the large picture on
    the bare wall.
    """
    h, w = size
    y, x = np.mgrid[0:h, 0:w] / np.array([h, w]).reshape(2, 1, 1)
    puff = cloud(rng, size, 1.7, 2, 60)
    sky = blend((0.52, 0.62, 0.78), (0.20, 0.34, 0.62), np.clip((y - 0.5) * 2, 0, 1))
    white = smoothstep(0.5, 1.5, 0.8 * puff + 2.4 - 7 * np.hypot((x - 0.25) * 1.1, (y - 0.80) * 2))
    out = blend(sky, (0.86, 0.86, 0.88), 0.9 * white)
    crest = 0.52 + 0.30 * smoothstep(0.25, 0.6, x) - 0.12 * smoothstep(0.7, 0.95, x)
    crest = crest + 0.05 * cloud(rng, (1, 2 * w), 1.3, 3, 120)[0][:w][None]
    block = cloud(rng, size, 1.15, 6, 160, (1.6, 1.0))
    light = block - np.roll(block, (w // 160, -w // 160), (0, 1))
    stone = (
        np.array((0.62, 0.56, 0.46))
        * np.clip(1 + 0.16 * block + 0.55 * light, 0.15, 1.7)[..., None]
    )
    leaf = cloud(rng, size, 0.85, 24, 170)
    bush = smoothstep(0.35, 0.75, cloud(rng, size, 1.5, 4, 40) + 0.35 * leaf)
    green = np.array((0.20, 0.27, 0.12)) * np.clip(1 + 0.55 * leaf, 0.15, 2.2)[..., None]
    out = blend(out, blend(stone, green, bush), smoothstep(-0.004, 0.004, crest + 0.02 * leaf - y))
    water = (
        np.array((0.20, 0.20, 0.19))
        * (1 + 0.22 * cloud(rng, size, 0.8, 10, 120, (3.0, 0.6)))[..., None]
    )
    return to_bytes(blend(out, water, (y < 0.16 + 0.02 * block) * 1.0))
