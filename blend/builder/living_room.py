"""The living room: the positions of all objects. Lengths in metres in our world (z up), measured on
the original.

p_world = (-x, -z, y) of the POV world, so the floor is at z = 0.133, the sofa wall at y = +1.929,
the window wall near y = -3.09.
"""

from __future__ import annotations

import numpy as np

from . import living_room_light, paintings
from .greenery import blade, pot, shrub, stalk
from .hard import chair, coffee_table, foot_lamp, sideboard, television
from .living_room_measures import (
    DOOR,
    LAMPS,
    SKIRT_THICK,
    SKIRT_TOP,
    SPOTS,
    WINDOW,
    X0,
    X1,
    Y0,
    Y1,
    Z0,
    Z1,
)
from .living_room_palette import palette
from .mesh import Mesh, grid, join
from .opening import open_with
from .shapes import bar, rounded_box, steps
from .soft import LENGTH, curtain, pillow, rug, sofa, throw
from .stage import Stage
from .tableware import book, fruit, magazine, plate, twigs, vase
from .wallpieces import casing, door, picture, plane, rail, skirting, spot, window


def build(seed: int = 0, detail: float = 1.0) -> None:
    """Build the room in the current, empty Blender scene.

    The same seed and detail give the same bytes of geometry.
    """
    stage = Stage(seed, palette(seed, detail), detail)
    for part, fill in enumerate(
        (_shell, _wall_pieces, _seating, _table, _media, _lamps, _plant, _textiles, _balcony)
    ):
        fill(stage, np.random.default_rng(np.random.SeedSequence([seed, 11, part])), detail)
    living_room_light.light(seed, detail)
    open_with((-1.55, 1.55, 1.55), 78, 214)


def _shell(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    w = X1 - X0
    d = Y1 - Y0
    h = Z1 - Z0
    stage.add(
        "floor", "floor", plane((X0, Y0 - 0.20, Z0), (w, 0, 0), (0, d + 0.20, 0), 2.1), "floor"
    )
    stage.add("ceiling", "ceiling", plane((X0, Y0, Z1), (0, d, 0), (w, 0, 0), 2.5), "ceiling")
    low = Z0 + SKIRT_TOP - 0.004
    tall = h - SKIRT_TOP + 0.004
    x0, x1, top = DOOR
    hole = (x0 + 0.1 - X0, x1 - 0.1 - X0, -1.0, top - 0.1 - low)
    stage.add(
        "wall_sofa",
        "wall",
        plane((X0, Y1, low), (w, 0, 0), (0, 0, tall), 2.5, (0.13, 0.4), hole),
        "wall",
    )
    stage.add(
        "wall_left", "wall", plane((X0, Y0, low), (0, d, 0), (0, 0, tall), 2.5, (0.55, 0.1)), "wall"
    )
    stage.add(
        "wall_right",
        "wall",
        plane((X1, Y1, low), (0, -d, 0), (0, 0, tall), 2.5, (0.31, 0.7)),
        "wall",
    )
    a, b, c, e = WINDOW
    hole = (X1 - b, X1 - a, -1.0, e - low)
    inner = plane((X1, Y0, low), (-w, 0, 0), (0, 0, tall), 2.5, (0.77, 0.25), hole)
    stage.add(
        "wall_window", "wall", join([inner, *_reveal(a, b, Z0, e, 0.20)]), ("wall", "white paint")
    )


def _reveal(a: float, b: float, c: float, e: float, deep: float) -> list[Mesh]:
    """The sides and the head of the window opening, outwards from the window wall; painted with
    slot 1.
    """
    sides = [
        plane((a, Y0 - deep, c), (0, deep, 0), (0, 0, e - c), 2.5),
        plane((b, Y0, c), (0, -deep, 0), (0, 0, e - c), 2.5),
        plane((a, Y0, e), (b - a, 0, 0), (0, -deep, 0), 2.5),
    ]
    return [s.painted(1) for s in sides]


def _wall_pieces(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    h = SKIRT_TOP
    t = SKIRT_THICK
    runs = [
        skirting((X0, Y1), (X0, Y0), h, t, (True, True)),
        skirting((X0, Y0), (WINDOW[0] - 0.002, Y0), h, t, (True, False), capped=True),
        skirting((WINDOW[1] + 0.002, Y0), (X1, Y0), h, t, (False, True), capped=True),
        skirting((X1, Y0), (X1, Y1), h, t, (True, True)),
        skirting((X1, Y1), (DOOR[1], Y1), h, t, (True, False), capped=True),
        skirting((DOOR[0], Y1), (X0, Y1), h, t, (False, True), capped=True),
    ]
    stage.add("skirting", "moulding", join(runs).moved(z=Z0), "white paint")
    x0, x1, top = DOOR
    stage.add(
        "door_casing",
        "door",
        casing(x1 - x0, top - Z0, 0.115, 0.018).moved((x0 + x1) / 2, Y1, Z0),
        "white paint",
    )
    leaf = door(x1 - x0 - 0.19, top - Z0 - 0.095, detail).moved(
        (x0 + x1) / 2, Y1 - 0.0015, Z0 + 0.003
    )
    stage.add("door", "door", leaf, ("white paint", "steel"))
    art = picture(1.36, 1.02, 0.055)
    stage.add(
        "picture_landscape",
        "picture",
        art.moved(-0.225, Y1 - 0.002, 1.695),
        ("frame wood", "mat", "landscape"),
    )
    art = picture(1.36, 1.02, 0.055).turned("z", -90)
    stage.add(
        "picture_coast",
        "picture",
        art.moved(X1 - 0.002, -0.785, 1.695),
        ("frame wood", "mat", "coast"),
    )
    for k, (x, y) in enumerate(SPOTS, 1):
        fitting = stage.add(
            f"ceiling_spot_{k}", "lamp", spot(detail).moved(x, y, Z1), ("trim", "lens")
        )
        fitting.visible_diffuse = (
            False  # the spot lamp gives the light; the emission is only visible
        )
    frame, panes = window(*WINDOW, detail)
    stage.add("window_frame", "window", frame.moved(0, Y0 - 0.025, 0), ("white paint", "steel"))
    stage.add("window_pane", "window", panes.moved(0, Y0 - 0.025, 0), "glass")


def _seating(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    stage.add(
        "sofa_wall", "sofa", sofa(rng, detail).moved(-0.2375, 0.86, Z0), ("sofa", "dark metal")
    )
    second = sofa(rng, detail).turned("z", -90).moved(1.44, -0.7825, Z0)
    stage.add("sofa_side", "sofa", second, ("sofa", "dark metal"))
    seat = 0.640
    red = pillow(rng, 0.44, 0.21, detail).turned("x", -17).turned("z", 21).moved(-0.615, 1.41, seat)
    stage.add("pillow_crimson", "pillow", red, "crimson")
    blue = (
        pillow(rng, 0.43, 0.20, detail).turned("x", -19).turned("z", -5).moved(-0.265, 1.492, seat)
    )
    stage.add("pillow_blue", "pillow", blue, "blue")
    side = (
        pillow(rng, 0.43, 0.20, detail).turned("x", -24).turned("z", -14).moved(1.76, -0.035, seat)
    )
    stage.add("pillow_ochre", "pillow", side, "ochre")
    back = (
        pillow(rng, 0.45, 0.20, detail).turned("x", -17).turned("z", -84).moved(2.02, -1.33, seat)
    )
    stage.add("pillow_side_blue", "pillow", back, "blue")
    for name, x, y, turn in (("chair_left", -1.93, -2.02, 128), ("chair_table", 0.05, -1.46, 196)):
        stage.add(
            name,
            "chair",
            chair(detail).turned("z", turn).moved(x, y, Z0 + 0.0005),
            ("oak", "grey seat"),
        )


def _table(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    top = 0.647
    x = 0.045
    y = -0.475
    on_rug = Z0 + 0.0112
    stage.add(
        "table",
        "table",
        coffee_table(1.01, 0.67, top - on_rug, detail).moved(x, y, on_rug),
        ("oak", "nut"),
    )
    stage.add("plate", "plate", plate(detail).moved(0.20, -0.36, top + 0.0002), "porcelain")
    fruits = []
    for dx, dy, dz in ((-0.047, -0.012, 0.0), (0.036, -0.040, 0.0), (0.022, 0.046, 0.0)):
        fruits.append(fruit(rng, 0.039, detail).moved(0.20 + dx, -0.36 + dy, top + 0.0145 + dz))
    stage.add("fruit", "fruit", join(fruits), "orange")
    stage.add("vase", "vase", vase(detail).moved(0.40, -0.655, top + 0.0002), "glaze")
    stage.add("twigs", "plant", twigs(rng, detail).moved(0.40, -0.655, top), ("bark", "bud"))
    volumes = [
        book((0.29, 0.22, 0.030)).turned("z", 8),
        book((0.25, 0.19, 0.024)).turned("z", -7).moved(z=0.0304),
        book((0.21, 0.15, 0.020)).turned("z", 16).moved(z=0.0548),
    ]
    for k, (volume, cover) in enumerate(
        zip(volumes, ("book blue", "book cream", "book red"), strict=True), 1
    ):
        stage.add(f"book_{k}", "books", volume.moved(-0.24, -0.36, top + 0.0003), (cover, "paper"))
    paper = magazine(rng, (0.21, 0.28), detail).turned("z", 20).moved(-0.02, -0.645, top + 0.0004)
    stage.add("magazine", "books", paper, "coast")


def _media(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    x, y = 1.10, Y0 + 0.255
    stage.add(
        "sideboard",
        "cabinet",
        sideboard(1.36, 0.42, 0.50, detail).turned("z", 180).moved(x, y, Z0 + 0.0005),
        ("nut", "brass", "dark metal"),
    )
    tv = television(1.04, detail).turned("z", 180).moved(x - 0.06, y - 0.04, Z0 + 0.501)
    stage.add("tv", "television", tv, ("dark metal", "screen", "steel"))
    for k, (height, cover) in enumerate(((0.024, "book red"), (0.030, "book cream")), 4):
        lying = (
            book((0.20, 0.14, height))
            .turned("z", 90 - 9 * k)
            .moved(x + 0.585 - 0.0, y + 0.05, Z0 + 0.5008 + (0.0246 if k == 5 else 0))
        )
        stage.add(f"book_{k}", "books", lying, (cover, "paper"))


def _lamps(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    for name, (x, y) in LAMPS.items():
        stand, shade, bulb = foot_lamp((0.182, 1.337, 1.582), detail)
        stage.add(f"lamp_{name}", "lamp", stand.moved(x, y, Z0), "steel")
        stage.add(f"lamp_shade_{name}", "lamp", shade.moved(x, y, Z0), ("shade", "steel"))
        shining = stage.add(f"lamp_bulb_{name}", "lamp", bulb.moved(x, y, Z0), "bulb")
        shining.visible_shadow = shining.visible_diffuse = (
            False  # the lamp inside gives the light; the emission is only visible
        )


def _plant(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    x, y = -2.09, 0.66
    stage.add("plant_pot", "pot", pot(rng, 0.17, 0.31, detail).moved(x, y, Z0), ("pot", "soil"))
    soil = Z0 + 0.27
    stems = [
        (
            [
                (-2.06, 0.68, soil),
                (-2.055, 0.69, 0.55),
                (-2.03, 0.69, 0.68),
                (-1.96, 0.69, 0.84),
                (-1.86, 0.685, 0.965),
                (-1.80, 0.682, 1.008),
            ],
            0.0085,
        ),
        (
            [
                (-2.12, 0.67, soil),
                (-2.14, 0.70, 0.47),
                (-2.145, 0.74, 0.70),
                (-2.155, 0.80, 0.88),
                (-2.165, 0.865, 0.985),
            ],
            0.0085,
        ),
        (
            [
                (-2.08, 0.65, soil),
                (-2.05, 0.665, 0.56),
                (-2.055, 0.64, 0.70),
                (-2.09, 0.57, 0.785),
                (-2.14, 0.47, 0.812),
                (-2.185, 0.40, 0.805),
            ],
            0.008,
        ),
        (
            [
                (-2.07, 0.62, soil),
                (-2.06, 0.60, 0.48),
                (-2.045, 0.555, 0.575),
                (-2.04, 0.53, 0.590),
            ],
            0.006,
        ),
        (
            [(-2.13, 0.64, soil), (-2.19, 0.62, 0.55), (-2.25, 0.64, 0.72), (-2.30, 0.70, 0.80)],
            0.007,
        ),
    ]
    leaves = [
        (
            [
                (-1.80, 0.682, 1.008),
                (-1.72, 0.675, 1.022),
                (-1.63, 0.665, 1.008),
                (-1.535, 0.655, 0.975),
            ],
            0.170,
            0.10,
            0,
        ),
        (
            [
                (-2.162, 0.855, 0.975),
                (-2.175, 0.90, 1.002),
                (-2.185, 0.96, 0.998),
                (-2.19, 1.03, 0.975),
            ],
            0.150,
            0.22,
            0,
        ),
        (
            [
                (-2.185, 0.40, 0.805),
                (-2.235, 0.335, 0.775),
                (-2.275, 0.28, 0.720),
                (-2.30, 0.235, 0.655),
            ],
            0.165,
            0.12,
            12,
        ),
        (
            [
                (-2.04, 0.53, 0.590),
                (-2.038, 0.51, 0.597),
                (-2.035, 0.48, 0.593),
                (-2.03, 0.445, 0.578),
            ],
            0.075,
            0.2,
            0,
        ),
        (
            [
                (-2.30, 0.70, 0.80),
                (-2.325, 0.745, 0.815),
                (-2.345, 0.80, 0.80),
                (-2.355, 0.85, 0.76),
            ],
            0.09,
            0.15,
            0,
        ),
    ]
    parts = [stalk(np.array(path), thick, detail).painted(1) for path, thick in stems]
    parts += [blade(np.array(path), width, cup, detail, roll) for path, width, cup, roll in leaves]
    stage.add("plant", "plant", join(parts), ("leaf", "stalk"))


def _textiles(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    stage.add("rug", "rug", rug(rng, 1.66, 1.86, detail).moved(0.19, -0.43, Z0), ("rug", "fringe"))
    over = throw(rng, detail).turned("z", 180).moved(LENGTH / 2 - 0.14, 0.40)
    stage.add("throw", "blanket", over.turned("z", -90).moved(1.44, -0.7825, Z0), "knit")
    y = Y0 + 0.105
    height = 2.365
    left = curtain(rng, 0.46, height, 9, detail).moved(-2.395, y, Z0 + 0.012)
    right = curtain(rng, 0.46, height, 9, detail).moved(-0.10, y, Z0 + 0.012)
    stage.add("curtain_left", "curtain", left, "curtain")
    stage.add("curtain_right", "curtain", right, "curtain")
    stage.add(
        "curtain_rail",
        "curtain",
        rail(X0 + 0.06, 0.42, detail).moved(0, y, Z0 + height + 0.030),
        "dark metal",
    )


def _balcony(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    x0 = -3.1
    x1 = 1.3
    y0 = -4.55
    y1 = Y0 - 0.20
    slab = (
        rounded_box((x1 - x0, y1 - y0, 0.16), 0.01)
        .moved((x0 + x1) / 2, (y0 + y1) / 2, Z0 - 0.10)
        .box_mapped(1.6)
    )
    stage.add("balcony_floor", "floor", slab, "paving")
    kerb = rounded_box((x1 - x0, 0.10, 0.22), 0.01).moved((x0 + x1) / 2, y0 + 0.05, Z0 + 0.0905)
    stage.add("balcony_kerb", "wall", kerb, "white paint")
    low, high = Z0 + 0.20, Z0 + 1.02
    posts = []
    for x in np.linspace(x0 + 0.05, x1 - 0.05, steps(38, detail, 8)):
        posts.append(bar((x, y0 + 0.05, low), (x, y0 + 0.05, high), 0.007, steps(8, detail, 5)))
    hand = rounded_box((x1 - x0, 0.055, 0.035), 0.010).moved(
        (x0 + x1) / 2, y0 + 0.05, high + 0.0165
    )
    stage.add("balcony_railing", "railing", join([*posts, hand]), "dark metal")
    for k, (x, y) in enumerate(((-1.95, -4.20), (-0.55, -4.22)), 1):
        box = [rounded_box((0.62, 0.26, 0.26), 0.012).moved(x, y, Z0 - 0.0195 + 0.13)]
        stage.add(f"planter_{k}", "pot", join(box), "terracotta")
        bush = shrub(rng, (0.66, 0.36, 0.42), detail).moved(x, y, Z0 + 0.20)
        stage.add(f"shrub_{k}", "plant", bush, "shrub")
    stage.add("view", "backdrop", _view(stage.seed), "view")


def _view(seed: int) -> Mesh:
    """The painted surroundings: part of a cylinder 40 m away that ends at the hills' skyline."""
    n = 161
    angle = np.radians(np.linspace(345, 195, n))
    ring = np.stack([-1.1 + 40 * np.cos(angle), 40 * np.sin(angle)], 1)
    top = paintings.skyline(seed, n)
    u = np.linspace(0, 1, n)
    rows = [np.concatenate([ring, (-14.0 + 20.0 * v)[:, None]], 1) for v in (0 * top, top)]
    return grid(np.stack(rows), np.stack([np.stack([u, v], 1) for v in (0 * top, top)]))
