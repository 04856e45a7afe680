"""The office: the positions of all objects. Lengths in metres in our world (z up), measured on the
original where it is visible.

p_world = (-x, -z, y)/100 of the POV world: floor z = 3.0, the filing cabinets at the end y = -3.7,
the bare wall x = -2.5.
"""

from __future__ import annotations

import numpy as np

from . import office_light
from .mesh import join
from .office_desks import desk, drawers, swivel_chair
from .office_desktops import dress_a, dress_b, dress_c, dress_d
from .office_measures import DOOR, LUMINAIRES, VENTS, X0, X1, Y0, Y1, Z0, Z1
from .office_palette import palette
from .office_stationery import paper_pile, tray, waste_basket
from .office_storage import binder_row, book_row, bookcase, filing_cabinet
from .office_wall import (
    ceiling,
    clock,
    coat_stand,
    luminaire,
    notice_board,
    pull_handle,
    slim_picture,
    socket_plate,
    vent,
)
from .opening import open_with
from .solids import block
from .stage import Stage
from .wallpieces import casing, door, plane, skirting


def build(seed: int = 0, detail: float = 1.0) -> None:
    """Build the room in the current, empty Blender scene.

    The same seed and detail give the same bytes of geometry.
    """
    stage = Stage(seed, palette(seed, detail), detail)
    parts = (
        _shell,
        _ceiling,
        _wall_pieces,
        _desks,
        _storage,
        _floor_things,
        dress_a,
        dress_b,
        dress_c,
        dress_d,
    )
    for part, fill in enumerate(parts):
        fill(stage, np.random.default_rng(np.random.SeedSequence([seed, 12, part])), detail)
    office_light.light()
    open_with((0.6, 1.2, 4.55), 80, 168)


def _shell(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    w = X1 - X0
    d = Y1 - Y0
    h = Z1 - Z0
    stage.add(
        "floor", "floor", plane((X0, Y0, Z0), (w, 0, 0), (0, d, 0), 2.0, (0.25, 0.35)), "floor"
    )
    stage.add(
        "wall_cabinets", "wall", plane((X1, Y0, Z0), (-w, 0, 0), (0, 0, h), 1.5, (0.3, 0.1)), "wall"
    )
    stage.add(
        "wall_bare", "wall", plane((X0, Y0, Z0), (0, d, 0), (0, 0, h), 1.5, (0.6, 0.7)), "wall"
    )
    stage.add("wall_right", "wall", plane((X1, Y1, Z0), (0, -d, 0), (0, 0, h), 1.5), "wall")
    a, b, top = DOOR
    hole = (a + 0.05 - X0, b - 0.05 - X0, -1.0, top - 0.05)
    stage.add(
        "wall_door",
        "wall",
        plane((X0, Y1, Z0), (w, 0, 0), (0, 0, h), 1.5, (0.1, 0.2), hole),
        "wall",
    )


def _ceiling(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    panels, rails = ceiling()
    stage.add("ceiling", "ceiling", panels, "ceiling")
    stage.add("ceiling_rails", "ceiling", rails, ("rail", "ceiling"))
    for k, (x, y) in enumerate(LUMINAIRES, 1):
        fitting = stage.add(
            f"luminaire_{k}", "lamp", luminaire().moved(x, y, Z1), ("rail", "tube light")
        )
        fitting.visible_diffuse = (
            False  # the rectangle beneath it gives the light; the emission is only visible
        )
    for k, (x, y) in enumerate(VENTS, 1):
        stage.add(f"vent_{k}", "vent", vent(detail).moved(x, y, Z1), ("vent", "steel paint"))


def _wall_pieces(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    runs = [((X0, Y0), (X1, Y0), (True, True)), ((X1, Y0), (X1, Y1), (True, True))]
    runs += [((X1, Y1), (DOOR[1], Y1), (True, False)), ((DOOR[0], Y1), (X0, Y1), (False, True))]
    stage.add(
        "skirting",
        "moulding",
        join([skirting(a, b, 0.06, 0.012 + 0.003, c) for a, b, c in runs]).moved(z=Z0),
        "skirting",
    )
    a, b, top = DOOR
    stage.add(
        "door_casing", "door", casing(b - a, top, 0.07, 0.018).moved((a + b) / 2, Y1, Z0), "door"
    )
    stage.add(
        "door",
        "door",
        door(b - a - 0.11, top - 0.055, detail).moved((a + b) / 2, Y1 - 0.0015, Z0 + 0.003),
        ("door", "steel"),
    )
    for k, y in enumerate((-0.725, -0.675), 1):
        stage.add(
            f"handle_{k}",
            "handle",
            pull_handle(0.20).turned("z", 90).moved(X0 + 0.0005, y, Z0 + 0.947),
            "steel",
        )
    art = slim_picture(1.05, 0.42, 0.035).turned("z", 90)
    stage.add(
        "picture_rocks",
        "picture",
        art.moved(X0 + 0.002, 0.955, Z0 + 1.495),
        ("black", "mat", "rocks"),
    )
    art = slim_picture(0.53, 0.53, 0.02).turned("z", 90)
    stage.add(
        "picture_window",
        "picture",
        art.moved(X0 + 0.002, -2.905, Z0 + 1.455),
        ("black", "mat", "still life"),
    )
    art = slim_picture(0.75, 0.52, 0.05).turned("z", -90)
    stage.add(
        "picture_coast",
        "picture",
        art.moved(X1 - 0.002, 1.45, Z0 + 1.60),
        ("black", "mat", "coast"),
    )
    stage.add(
        "clock",
        "clock",
        clock(detail).moved(0.86, Y1 - 0.001, Z0 + 2.02),
        ("black", "dial", "black"),
    )
    _board(stage, rng)
    for k, (x, y, turn) in enumerate(((X0, 2.55, 90), (X1, -0.55, -90), (X1, 2.6, -90)), 1):
        stage.add(
            f"socket_{k}",
            "socket",
            socket_plate().turned("z", turn).moved(x - np.sign(x) * 0.0005, y, Z0 + 0.26),
            ("white plastic", "dark"),
        )


def _board(stage: Stage, rng: np.random.Generator) -> None:
    """The notice board over the pair of desks, papers pinned crookedly."""
    from .office_stationery import page

    board = notice_board(1.25, 0.85).turned("z", -90).moved(X1 - 0.001, -1.78, Z0 + 1.50)
    stage.add("notice_board", "board", board, ("beech", "cork"))
    spots = (
        (-0.42, 0.16),
        (-0.15, 0.18),
        (0.14, 0.13),
        (0.42, 0.17),
        (-0.40, -0.19),
        (-0.02, -0.20),
        (0.30, -0.20),
    )
    sheets = []
    for x, z in spots:
        leaf = page(rng, 0.0005, 0.02).turned("z", rng.normal(0, 5)).turned("x", 90)
        sheets.append(leaf.moved(x, -0.0107, z))
    pins = []
    for x, z in spots:
        pins.append(block((0.009, 0.010, 0.009), (x, -0.0165, z + 0.125), 0.002).painted(1))
    notes = join([*sheets, *pins]).turned("z", -90).moved(X1 - 0.001, -1.78, Z0 + 1.50)
    stage.add("notices", "paper", notes, ("pages", "red plastic"))


def _desks(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    skins = ("laminate", "steel paint", "blue board", "black")
    for name, x, y, turn, width in (
        ("desk_a", -1.65, -2.206, 0, 1.60),
        ("desk_b1", 1.65, -2.205, 0, 1.60),
        ("desk_b2", 1.65, -1.35, 180, 1.60),
        ("desk_c", 2.05, 1.35, -90, 1.60),
        ("desk_d", -2.07, 2.50, 90, 1.60),
    ):
        stage.add(name, "desk", desk(width, 0.80).turned("z", turn).moved(x, y, Z0), skins)
    for k, (x, y, turn) in enumerate(
        ((-2.10, -2.30, 0), (2.10, -2.30, 0), (2.05, 1.85, -90), (-2.07, 3.0, 90)), 1
    ):
        stage.add(
            f"drawers_{k}",
            "cabinet",
            drawers(detail).turned("z", turn).moved(x, y, Z0 + 0.0005),
            ("grey case", "steel", "black"),
        )
    for k, (x, y, turn) in enumerate(
        (
            (-0.90, 3.00, 150),
            (1.60, -2.95, -14),
            (1.86, -0.74, 186),
            (1.66, 1.20, -84),
            (-1.62, 2.42, 102),
        ),
        1,
    ):
        chair = swivel_chair(rng, detail).mapped(lambda v: v * [1, -1, 1]).flipped()
        stage.add(
            f"chair_{k}",
            "chair",
            chair.turned("z", turn).moved(x, y, Z0 + 0.0005),
            ("cloth", "black", "steel"),
        )


def _storage(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    for k, (x, y, turn, labels) in enumerate(
        (
            (0.239, -3.36, 180, (0, 1, 2)),
            (-0.239, -3.36, 180, (3, 4, 5)),
            (0.84, 3.36, 0, (1, 3, 5)),
        ),
        1,
    ):
        stage.add(
            f"cabinet_{k}",
            "cabinet",
            filing_cabinet(labels, detail).turned("z", turn).moved(x, y, Z0 + 0.0005),
            ("ochre", "steel paint", "labels"),
        )
    on = Z0 + 1.3207
    stage.add("trays_red", "tray", tray(2).turned("z", 90).moved(0.24, -3.47, on), "red plastic")
    stage.add(
        "papers_cabinet",
        "paper",
        paper_pile(rng, 2, 0.006, 4).turned("z", 80).moved(-0.22, -3.42, on),
        "pages",
    )
    stage.add(
        "binders_cabinet", "books", binder_row(rng, 4).moved(0.68, 3.24, on), ("spines", "paper")
    )
    for k, x in enumerate((-1.475, -0.475), 1):
        case, levels = bookcase(0.94, 1.88, 5)
        y = Y1 - 0.19
        stage.add(f"bookcase_{k}", "bookcase", case.moved(x, y, Z0 + 0.0005), "beech")
        for row, z in enumerate(levels):
            place = {"x": x, "y": y - 0.13, "z": Z0 + 0.0007 + z}
            if row == len(levels) - 1:
                pile = paper_pile(rng, 3, 0.02, 18).moved(x + 0.2, y, place["z"])
                stage.add(f"papers_bookcase_{k}", "paper", pile, "pages")
            elif (row + k) % 3 == 0:
                stage.add(
                    f"binders_{k}_{row}",
                    "books",
                    binder_row(rng, int(rng.integers(7, 11))).moved(
                        place["x"] - 0.44, place["y"] - 0.01, place["z"]
                    ),
                    ("spines", "paper"),
                )
            else:
                stage.add(
                    f"books_{k}_{row}",
                    "books",
                    book_row(rng, 0.88, 0.33, rng.uniform(0.6, 0.95)).moved(**place),
                    ("spines", "paper"),
                )


def _floor_things(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    stage.add("coat_stand", "stand", coat_stand(detail).moved(-2.29, 0.10, Z0), "chrome")
    for k, (x, y) in enumerate(((-2.24, -3.36), (2.22, -0.55), (1.55, 2.42), (-2.28, 3.48)), 1):
        stage.add(
            f"waste_basket_{k}",
            "basket",
            waste_basket(rng, detail).moved(x, y, Z0),
            ("black" if k % 2 else "grey case", "paper"),
        )
    box = block((0.40, 0.30, 0.26), (0, 0, 0.1305), 0.003)
    lid = block((0.41, 0.31, 0.05), (0, 0, 0.2605), 0.003)
    stage.add(
        "archive_box", "box", join([box, lid]).turned("z", 12).moved(1.95, 3.40, Z0), "buff card"
    )
