"""The paper's Tables I to VII with our figures next to the printed ones, the same tables for
surfaces of the office, and a table of all cells. Errors in mm.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from statistics import median

from iclnuim import shipped
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.geometry.trajectory import FRAME_RATE_HZ

from .cells import NOISES, REFERENCES, TITLES
from .lookup import (
    ATE_TABLES,
    Figures,
    Ours,
    Printed,
    ate_of,
    paper,
    presets_of,
    seeds_of,
    surface_of,
)
from .table import ResultTable

ROMAN = dict(zip("1234567", ("I", "II", "III", "IV", "V", "VI", "VII"), strict=True))
TRAJECTORIES = shipped.TRAJECTORY_NAMES
_STATISTICS = {
    "rmse": "RMSE",
    "mean": "Mean",
    "median": "Median",
    "std": "Std.",
    "min": "Min",
    "max": "Max",
}
_ROOMS = {"living_room": "living room", "office": "office"}
#: (odometer, trajectory) of the columns of Tables II and VII.
_SURFACES = {
    "clean": (("dvo", "kt0"), *(("icp", kt) for kt in TRAJECTORIES)),
    "noisy": tuple(("icp", kt) for kt in TRAJECTORIES),
}
_ONE_SIDED = "Our figures and the printed ones come from different frames and programs: compare their order, not their values."


def all_tables(results: Sequence[dict]) -> list[ResultTable]:
    """All tables in the paper's order, for each measured preset, followed by the table of all
    cells.
    """
    tables = [table_1()]
    for preset in presets_of(results) or ["best"]:
        tables += preset_tables(results, preset)
    return [*tables, cells_table(results)]


def preset_tables(results: Sequence[dict], preset: str) -> list[ResultTable]:
    """Tables II to VII, and those for surfaces of the office (2_office, 7_office).

    The name of another preset than best is appended to the table's name.
    """
    seeds = seeds_of(results, preset)
    views = [Ours(results, preset, seed) for seed in seeds]
    externals = [r for r in results if r["cell"].external] if preset == "best" else []
    ate = [_ate_table(views, externals, *where) for where in ATE_TABLES]
    lr, office = (
        [_surface_table(views, room, noise) for noise in NOISES] for room in shipped.SCENE_NAMES
    )
    tables = [lr[0], *ate, lr[1], *office]
    if preset == "best":
        return tables
    return [
        ResultTable(
            f"{t.name}_{preset}", f"{t.title} Preset {preset}.", t.columns, t.rows, t.bold, t.notes
        )
        for t in tables
    ]


# -- Table I


def trajectory_rows() -> list[dict]:
    """The eight shipped trajectories in the paper's order. Lengths in m, speeds in m/s.

    The printed speeds are not length x 30 / frames: they imply a duration of printed length /
    printed speed, and `speed_for_printed_duration_m_s` is our length over that duration.
    """
    printed, rows = paper()["tables"]["1"], []
    for room, k in product(shipped.SCENE_NAMES, range(len(TRAJECTORIES))):
        frames, length_m, speed_m_s = (
            printed[room][key][k] for key in ("frames", "length_m", "mean_speed_m_s")
        )
        trajectory = read_trajectory(
            shipped.trajectory_file(f"{room}/{TRAJECTORIES[k]}")
        ).trajectory
        ours_m = trajectory.length_m()
        row = {
            "sequence": f"{room}/{TRAJECTORIES[k]}",
            "frames": len(trajectory),
            "length_m": ours_m,
            "speed_at_30_hz_m_s": ours_m * FRAME_RATE_HZ / (len(trajectory) - 1),
            "printed_duration_s": length_m / speed_m_s,
            "speed_for_printed_duration_m_s": ours_m * speed_m_s / length_m,
            "printed_frames": frames,
            "printed_length_m": length_m,
            "printed_speed_m_s": speed_m_s,
        }
        rows.append(row)
    return rows


def table_1() -> ResultTable:
    """Frames, lengths and speeds of the shipped trajectories."""
    columns = (
        "sequence",
        "frames",
        "printed",
        "length m",
        "printed",
        "m/s at 30 Hz",
        "m/s for T",
        "printed",
        "T s",
    )
    rows = []
    for r in trajectory_rows():
        lengths = (f"{r['length_m']:.3f}", f"{r['printed_length_m']:.2f}")
        speeds = (
            r["speed_at_30_hz_m_s"],
            r["speed_for_printed_duration_m_s"],
            r["printed_speed_m_s"],
        )
        frames = (str(r["frames"]), str(r["printed_frames"]))
        duration = f"{r['printed_duration_s']:.1f}"
        rows.append((r["sequence"], *frames, *lengths, *(f"{s:.3f}" for s in speeds), duration))
    title = "Table I: the trajectories. The printed speeds do not follow from 30 frames per second; T = length / speed as printed."
    return ResultTable("table_1", title, columns, tuple(rows))


# -- Tables III to VI


def _ate_table(
    views: Sequence[Ours], externals: Sequence[dict], room: str, noise: str
) -> ResultTable:
    """One row per odometer and statistic, followed by the external systems."""
    printed, rows, bold = Printed(), list[tuple[str, ...]](), set[tuple[int, int]]()
    sides: tuple[Figures, ...] = (views[0], printed)
    best = {
        (kt, one): _best(side, room, kt, noise)
        for kt in TRAJECTORIES
        for one, side in enumerate(sides)
    }
    for odometer, (statistic, name) in product(TITLES, _STATISTICS.items()):
        row = [TITLES[odometer] if statistic == "rmse" else "", name]
        for kt in TRAJECTORIES:
            ours = [view.ate(room, kt, noise, odometer, statistic) for view in views]
            theirs = printed.ate(room, kt, noise, odometer, statistic)
            if statistic == "rmse":
                bold |= {(len(rows), len(row) + one) for one in (0, 1) if best[kt, one] == odometer}
            row += [_mm(ours), _mm([theirs], 1)]
        rows.append(tuple(row))
    for title in sorted({r["cell"].odometer for r in externals}):
        some = [
            r
            for r in externals
            if r["cell"].odometer == title and (r["cell"].room, r["cell"].noise) == (room, noise)
        ]
        row = [title, "RMSE"]
        for kt in TRAJECTORIES:
            row += [_mm([ate_of(r) for r in some if r["cell"].trajectory == kt]), ""]
        rows += [tuple(row)] if any(row[2:]) else []
    number = ATE_TABLES[room, noise]
    title = f"Table {ROMAN[number]}: ATE in mm, {_ROOMS[room]}, {noise}."
    return ResultTable(
        f"table_{number}",
        title,
        _columns("odometer", "error mm"),
        tuple(rows),
        frozenset(bold),
        (*_part_note(views[0].results, room, noise), *_notes(views, noise)),
    )


def _best(view: Figures, room: str, trajectory: str, noise: str) -> str:
    found = {odometer: view.ate(room, trajectory, noise, odometer) for odometer in TITLES}
    known = {odometer: value for odometer, value in found.items() if value is not None}
    return min(known, key=known.__getitem__, default="") if len(known) > 1 else ""


def _part_note(results: Sequence[dict], room: str, noise: str) -> tuple[str, ...]:
    """A note if cells were measured on fewer frames than the sequence has."""
    whole = dict(zip(TRAJECTORIES, paper()["tables"]["1"][room]["frames"], strict=True))
    of_table = [r for r in results if (r["cell"].room, r["cell"].noise) == (room, noise)]
    part = {
        kt: [
            r["frames"]
            for r in of_table
            if r["cell"].trajectory == kt and r.get("frames", whole[kt]) < whole[kt]
        ]
        for kt in whole
    }
    counts = [f"{kt} {min(found)} of {whole[kt]}" for kt, found in part.items() if found]
    return (
        (f"Ours are of fewer frames than the sequences have: {', '.join(counts)}.",)
        if counts
        else ()
    )


def _columns(*first: str) -> tuple[str, ...]:
    return (*first, *(text for kt in TRAJECTORIES for text in (kt, "printed")))


def _notes(views: Sequence[Ours], noise: str) -> tuple[str, ...]:
    model = [TITLES[name] for name, references in REFERENCES.items() if references[0] == "model"]
    how = f"{' and '.join(model)} are aligned against a model, as in the paper; the others are not."
    if len(views) > 1 and noise == "noisy":
        how += f" Median of {len(views)} noise seeds, in brackets the minimum and the maximum."
    return (how, _ONE_SIDED)


# -- Tables II and VII


def _surface_table(views: Sequence[Ours], room: str, noise: str) -> ResultTable:
    printed, rows = Printed(), list[tuple[str, ...]]()
    columns = ["error mm"]
    for odometer, kt in _SURFACES[noise]:
        columns += [kt if odometer == "icp" else f"{kt} ({TITLES[odometer]})"] + ["printed"] * (
            room == "living_room"
        )
    for statistic, name in list(_STATISTICS.items())[1:]:
        row = [name]
        for odometer, kt in _SURFACES[noise]:
            row.append(_mm([view.surface(room, kt, noise, odometer, statistic) for view in views]))
            if room == "living_room":
                row.append(_mm([printed.surface(room, kt, noise, odometer, statistic)], 1))
        rows.append(tuple(row))
    for name, how in _MORE_SURFACE.items():
        row = [name]
        for odometer, kt in _SURFACES[noise]:
            row.append(_mm([how(view.result(room, kt, noise, odometer)) for view in views]))
            row += [""] if room == "living_room" else []
        rows.append(tuple(row))
    number = {"clean": "2", "noisy": "7"}[noise]
    if room == "living_room":
        name, title = (
            f"table_{number}",
            f"Table {ROMAN[number]}: error of the surfaces of the living room in mm, {noise}.",
        )
    else:
        name = f"table_{number}_{room}"
        title = f"Error of the surfaces of the {_ROOMS[room]} in mm, {noise}; the paper could not measure them."
    note = "Surfaces of ICP, except where noted, aligned with the model by ICP as in the paper. The last rows are not in the paper; they align by the first pose."
    notes = (note, _ONE_SIDED)[: 2 if room == "living_room" else 1]
    return ResultTable(
        name,
        title,
        tuple(columns),
        tuple(rows),
        notes=(*_part_note(views[0].results, room, noise), *notes),
    )


def quality_of(result: dict, name: str) -> float | None:
    """A figure by name: accuracy, completion or Depth L1 in m (accuracy_m ...), or a share within a
    distance (f_score 1cm).
    """
    quality = result.get("surface", {}).get("quality", {})
    name, _, near = name.partition(" ")
    return quality.get(name, {}).get(near) if near else quality.get(name)


_MORE_SURFACE: dict[str, Callable[[dict], float | None]] = {
    "Mean, not fitted": lambda result: surface_of(result, "mean", "given_m"),
    "Accuracy": lambda result: quality_of(result, "accuracy_m"),
    "Completion": lambda result: quality_of(result, "completion_m"),
    "Depth L1": lambda result: quality_of(result, "depth_l1_m"),
}


# -- all cells


#: Columns of the table of all cells -> (result -> figure, factor).
CELL_FIGURES: dict[str, tuple[Callable[[dict], float | None], float]] = {
    "ATE mm": (ate_of, 1e3),
    "RPE mm/s": (lambda r: (r.get("rpe_1s_m") or {}).get("rmse"), 1e3),
    "lost": (lambda r: r.get("lost"), 1),
    "degenerate": (lambda r: r.get("degenerate"), 1),
    "surface mm": (surface_of, 1e3),
    "not fitted mm": (_MORE_SURFACE["Mean, not fitted"], 1e3),
    "accuracy mm": (lambda r: quality_of(r, "accuracy_m"), 1e3),
    "completion mm": (lambda r: quality_of(r, "completion_m"), 1e3),
    "Depth L1 mm": (lambda r: quality_of(r, "depth_l1_m"), 1e3),
    "F 1 cm %": (lambda r: quality_of(r, "f_score 1cm"), 100),
    "F 2 cm %": (lambda r: quality_of(r, "f_score 2cm"), 100),
    "F 5 cm %": (lambda r: quality_of(r, "f_score 5cm"), 100),
}
CELL_COLUMNS = (
    "room",
    "trajectory",
    "noise",
    "seed",
    "odometer",
    "preset",
    "reference",
    "frames",
    *CELL_FIGURES,
)


def cells_table(results: Sequence[dict]) -> ResultTable:
    """One row per cell."""
    return ResultTable("cells", "All cells.", CELL_COLUMNS, tuple(map(cell_row, results)))


def cell_row(result: dict) -> tuple[str, ...]:
    """The texts of one row: figures with three decimals, counts with none."""
    cell, figures = result["cell"], []
    for measure, factor in CELL_FIGURES.values():
        value = measure(result)
        figures.append(
            ""
            if value is None
            else str(value)
            if isinstance(value, int)
            else f"{factor * value:.3f}"
        )
    reference = f"run {cell.run}" if cell.external else cell.reference
    name = (
        cell.room,
        cell.trajectory,
        cell.noise,
        str(cell.seed),
        cell.title,
        cell.preset,
        reference,
    )
    return (*name, str(result.get("frames", "")), *figures)


def _mm(values: Iterable[float | None], decimals: int = 2) -> str:
    """The median in mm of figures in metres; if they differ, also the minimum and the maximum."""
    known = [1e3 * value for value in values if value is not None]
    if not known:
        return ""
    text = f"{median(known):.{decimals}f}"
    return (
        text
        if min(known) == max(known)
        else f"{text} [{min(known):.{decimals}f}, {max(known):.{decimals}f}]"
    )
