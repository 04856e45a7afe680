"""The objects on each desk of the office, including cables and computer towers. World frame."""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, join
from .office_computers import cable, keyboard, monitor, mouse, tower
from .office_measures import DESK_TOP, X0, X1, Z0
from .office_stationery import (
    desk_lamp,
    folder,
    mug,
    page,
    paper_pile,
    pen_jar,
    phone,
    stapler,
    tray,
)
from .stage import Stage

TOP = Z0 + DESK_TOP + 0.0003


def _computer(
    stage: Stage,
    key: str,
    detail: float,
    rng: np.random.Generator,
    at: tuple[float, float, float],
    board: tuple[float, float, float],
    screen: str = "screen",
) -> None:
    """A monitor at `at` (x, y, rotation); before the rotation its user sits at -y. A keyboard at
    `board` (x, y, rotation) with a mouse.
    """
    stage.add(
        f"monitor_{key}",
        "monitor",
        monitor(detail).turned("z", at[2]).moved(at[0], at[1], TOP),
        ("cream", screen, "slot"),
    )
    x, y, angle = board
    stage.add(
        f"keyboard_{key}",
        "keyboard",
        keyboard(rng).turned("z", angle).moved(x, y, TOP),
        ("cream", "key", "grey keys", "dark"),
    )
    a = np.radians(angle)
    beside = np.array([x, y]) + 0.31 * np.array([np.cos(a), np.sin(a)])
    stage.add(
        f"mouse_{key}",
        "mouse",
        mouse(detail).turned("z", angle + 12).moved(beside[0], beside[1], TOP),
        "cream",
    )


def _tower(stage: Stage, key: str, detail: float, x: float, y: float, turn: float) -> None:
    stage.add(
        f"tower_{key}",
        "computer",
        tower(detail).turned("z", turn).moved(x, y, Z0 + 0.0002),
        ("cream", "grey case", "dark"),
    )


def _papers(stage: Stage, rng: np.random.Generator, key: str, spots: tuple) -> None:
    """Papers at (x, y, rotation, wads): a stack of `wads` wads, or a loose sheet for 0."""
    parts: list[Mesh] = []
    for x, y, turn, wads in spots:
        heap = page(rng) if wads == 0 else paper_pile(rng, wads, 0.004)
        parts.append(heap.turned("z", turn).moved(x, y, TOP))
    stage.add(f"papers_{key}", "paper", join(parts), "pages")


def dress_a(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    """Desk A as in the original: trays, keyboard, a monitor with its back to the room and cables in
    front.
    """
    _computer(stage, "a", detail, rng, (-2.09, -1.985, -16), (-1.82, -2.36, 8))
    stage.add("trays_blue", "tray", tray(2).moved(-1.10, -2.06, TOP), "blue plastic")
    stage.add("trays_black", "tray", tray(3).moved(-1.35, -1.965, TOP), "black")
    heaps = [
        paper_pile(rng, 3, 0.009, 1.5).moved(-1.10, -2.06, TOP + 0.078),
        paper_pile(rng, 3, 0.010, 1.5).moved(-1.35, -1.965, TOP + 0.149),
    ]
    heaps.append(paper_pile(rng, 4, 0.009, 1.5).moved(-1.10, -2.06, TOP + 0.007))
    stage.add("papers_trays", "paper", join(heaps), "paper")
    _papers(stage, rng, "a", ((-1.42, -2.42, 12, 0), (-1.15, -2.42, -20, 2)))
    edge = -1.806 + 0.012
    over = TOP + 0.004
    leads = (
        (-2.13, -1.745, 0.0042, "black", 0.62, 0.04),
        (-2.25, -1.77, 0.0050, "white plastic", 0.40, 0.13),
        (-1.98, -1.76, 0.0040, "white plastic", 0.46, -0.05),
    )
    for k, (x, y, radius, colour, fall, drift) in enumerate(leads, 1):
        low = TOP - fall
        path = [
            (x, y - 0.02, over + 0.075),
            (x + 0.02, y - 0.01 - 0.02, over + 0.03),
            (x + 0.01, edge - 0.02, over + 0.012),
            (x + drift * 0.2, edge + 0.012, over - 0.012),
            (x + drift * 0.4, edge + 0.014, TOP - 0.18),
            (x + drift * 0.8, edge + 0.018, low + 0.05),
            (x + drift, edge + 0.022, low),
        ]
        stage.add(f"cable_a{k}", "cable", cable(path, radius, detail), colour)
    _tower(stage, "a", detail, -1.12, -2.30, 0)


def dress_b(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    """The pair of desks: B2's monitor with a dark screen to the room, red folder, green jar; B1
    with phone and a lit screen.
    """
    _computer(stage, "b2", detail, rng, (1.27, -1.51, 168), (1.36, -1.13, 176))
    stage.add(
        "folder_red",
        "folder",
        folder(rng, 0.018).turned("z", 100).moved(1.66, -1.42, TOP),
        ("red card", "pages"),
    )
    stage.add(
        "folder_red_2",
        "folder",
        folder(rng, 0.012).turned("z", 92).moved(1.65, -1.425, TOP + 0.032),
        ("red card", "pages"),
    )
    stage.add(
        "pen_jar_b",
        "jar",
        pen_jar(rng, detail).moved(1.03, -2.33, TOP),
        ("green glass", "black", "yellow", "red plastic"),
    )
    stage.add(
        "phone_b",
        "phone",
        phone(detail).turned("z", 200).moved(2.08, -1.22, TOP),
        ("phone", "white plastic", "black"),
    )
    _papers(stage, rng, "b2", ((1.75, -1.15, -14, 3), (2.02, -1.53, 8, 5), (1.55, -1.10, 24, 0)))
    _computer(stage, "b1", detail, rng, (1.78, -2.06, 6), (1.74, -2.43, 3), screen="lit screen")
    stage.add(
        "mug_b", "mug", mug(detail).turned("z", 40).moved(2.28, -2.40, TOP), ("glaze", "coffee")
    )
    stage.add(
        "stapler_b",
        "stapler",
        stapler(detail).turned("z", 70).moved(1.24, -2.36, TOP),
        ("black", "steel"),
    )
    stage.add("trays_b", "tray", tray(3).moved(2.27, -2.02, TOP), "grey case")
    _papers(stage, rng, "b1", ((1.42, -2.44, 15, 2), (2.05, -2.44, -8, 4), (2.27, -2.02, 0, 1)))
    _tower(stage, "b1", detail, 1.15, -2.28, 0)
    _tower(stage, "b2", detail, 2.20, -1.28, 180)
    for k, (x, y) in enumerate(((1.20, -1.742), (1.84, -1.815)), 1):
        path = [
            (x, y + (0.06 if k == 1 else -0.02), TOP + 0.09),
            (x - 0.04, y + 0.01, TOP + 0.03),
            (x - 0.16, y + (0.04 if k == 1 else -0.06), TOP + 0.006),
            (x - 0.24, y + (0.01 if k == 1 else -0.02), TOP + 0.006),
            (x - 0.25, -1.775, TOP - 0.03),
            (x - 0.25, -1.778, TOP - 0.4),
            (x - 0.28, -1.776, Z0 + 0.02),
        ]
        stage.add(f"cable_b{k}", "cable", cable(path, 0.004, detail), "black")


def dress_c(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    """Desk C along the right wall: monitor, lamp, papers, mug."""
    _computer(stage, "c", detail, rng, (2.16, 1.28, -84), (1.80, 1.26, -92), screen="lit screen")
    stage.add(
        "lamp_c",
        "lamp",
        desk_lamp(detail).turned("z", 60).moved(2.28, 0.74, TOP),
        ("chrome", "bulb"),
    )
    stage.add(
        "phone_c",
        "phone",
        phone(detail).turned("z", -70).moved(2.02, 1.90, TOP),
        ("cream", "grey keys", "black"),
    )
    stage.add(
        "mug_c",
        "mug",
        mug(detail).turned("z", 130).moved(1.86, 0.72, TOP),
        ("blue plastic", "coffee"),
    )
    stage.add(
        "folder_green",
        "folder",
        folder(rng, 0.02).turned("z", -80).moved(2.26, 1.94, TOP),
        ("green card", "pages"),
    )
    _papers(stage, rng, "c", ((1.84, 0.92, -100, 2), (1.85, 1.66, -80, 3), (2.10, 0.86, -96, 0)))
    _tower(stage, "c", detail, 2.22, 0.80, -90)
    x = X1 - 0.042
    path = [
        (2.38, 1.30, TOP + 0.10),
        (2.43, 1.34, TOP + 0.03),
        (x - 0.005, 1.42, TOP + 0.006),
        (x + 0.018, 1.46, TOP - 0.03),
        (x + 0.018, 1.48, TOP - 0.35),
        (x + 0.016, 1.4, Z0 + 0.08),
        (X1 - 0.10, 1.2, Z0 + 0.006),
    ]
    stage.add("cable_c", "cable", cable(path, 0.004, detail), "black")


def dress_d(stage: Stage, rng: np.random.Generator, detail: float) -> None:
    """Desk D along the bare wall: binders, phone, lamp, open folders, a monitor."""
    from .office_storage import binder_row

    _computer(stage, "d", detail, rng, (-2.18, 2.62, 78), (-1.84, 2.56, 86))
    stage.add(
        "phone_d",
        "phone",
        phone(detail).turned("z", 75).moved(-2.0, 2.02, TOP),
        ("cream", "grey keys", "black"),
    )
    stage.add(
        "binders_d",
        "books",
        binder_row(rng, 5).turned("z", 90).moved(-2.17, 3.02 - 0.12, TOP),
        ("spines", "paper"),
    )
    stage.add(
        "folder_buff",
        "folder",
        folder(rng, 0.016).turned("z", 70).moved(-1.90, 1.83, TOP),
        ("buff card", "pages"),
    )
    stage.add(
        "pen_jar_d",
        "jar",
        pen_jar(rng, detail).moved(-2.08, 2.27, TOP),
        ("red plastic", "black", "yellow", "white plastic"),
    )
    stage.add(
        "lamp_d",
        "lamp",
        desk_lamp(detail).turned("z", 165).moved(-2.33, 2.20, TOP),
        ("chrome", "bulb"),
    )
    stage.add("trays_d", "tray", tray(2).turned("z", 90).moved(-2.26, 1.90, TOP), "black")
    _papers(stage, rng, "d", ((-1.88, 2.14, 60, 1), (-1.88, 3.08, 96, 4), (-2.26, 1.90, 90, 1)))
    _tower(stage, "d", detail, -2.2, 1.95, 90)
    path = [
        (-2.38, 2.60, TOP + 0.10),
        (-2.43, 2.55, TOP + 0.03),
        (X0 + 0.034, 2.48, TOP + 0.006),
        (X0 + 0.02, 2.45, TOP - 0.04),
        (X0 + 0.02, 2.44, TOP - 0.4),
        (X0 + 0.03, 2.52, Z0 + 0.26),
    ]
    stage.add("cable_d", "cable", cable(path, 0.004, detail), "black")
