"""The paper's Tables I to VII with our figures next to the printed ones, the same tables for
surfaces of the office, and a table of all cells, which has other rooms too. Errors in mm.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from statistics import median
from typing import Any

from iclnuim import shipped
from iclnuim.benchmark.odometry.registry import ODOMETERS
from iclnuim.geometry.trajectory import FRAME_RATE_HZ
from iclnuim.trajectory_files.trajectories import read_trajectory

from ...cell import Measured
from ...table import ResultTable
from .figures import (
    ATE_TABLES,
    AUTHORS,
    SURFACE_TABLES,
    Ours,
    PaperFigures,
    Printed,
    Where,
    ate_of,
    paper,
    presets_of,
    reference_of,
    seeds_of,
    surface_of,
)
from .keys import NOISES, PaperKey, paper_odometers

_ROMAN = dict(zip("1234567", ["I", "II", "III", "IV", "V", "VI", "VII"], strict=True))
TRAJECTORIES = shipped.TRAJECTORY_NAMES
#: The room of Tables II and VII.
LIVING = "living_room"
_STATISTICS = {
    "rmse": "RMSE",
    "mean": "Mean",
    "median": "Median",
    "std": "Std.",
    "min": "Min",
    "max": "Max",
}
_ONE_SIDED = (
    "Our figures (empty: not measured) and the printed ones come from different frames and "
    "programs: compare their order, not their values."
)
#: A figure of a measured cell.
Figure = Callable[[Mapping[str, Any]], float | None]


def all_tables(results: Sequence[Measured]) -> list[ResultTable]:
    """All tables in the paper's order, for each measured preset, followed by the table of all
    cells.
    """
    tables = [table_1()]
    for preset in presets_of(results):
        tables += preset_tables(results, preset)
    return [*tables, cells_table(results)]


def has_ours(table: ResultTable) -> bool:
    """Whether the table contains a figure of ours, not only printed ones."""
    ours = [k for k, name in enumerate(table.columns) if name != "printed"]
    return any(any(table.column(k)) for k in ours[2:])


def preset_tables(results: Sequence[Measured], preset: str) -> list[ResultTable]:
    """Tables II to VII, and those for surfaces of the office (2_office, 7_office).

    The name of another preset than best is appended to the table's name.
    """
    seeds = seeds_of(results, preset)
    views = [Ours(results, preset, seed) for seed in seeds]
    others = [r.key for r in results if r.key.external and _beside(r.key, preset)]
    others += [r.key for r in results if r.key.preset == preset and _is_further(r.key)]
    ate = [_ate_table(views, others, *where) for where in ATE_TABLES]
    surfaces = product([views], shipped.paper_scenes(), NOISES)
    living_clean, living_noisy, *office = (_surface_table(*one) for one in surfaces)
    tables = [living_clean, *ate, living_noisy, *office]
    return [table.of_preset(preset) for table in tables]


def _beside(system: PaperKey, preset: str) -> bool:
    """Whether a system's rows stand in the tables of a preset: the authors' programs beside the
    paper's methods, all beside `best`.
    """
    return preset == "best" or system.odometer in AUTHORS.values()


def _is_further(key: PaperKey) -> bool:
    """Whether it is an odometer of ours that the paper does not have, against its own reference."""
    if key.external or key.odometer in paper_odometers():
        return False
    return key.odometer in ODOMETERS and key.reference == reference_of(key.odometer)


# -- Table I


def trajectory_rows() -> list[dict[str, Any]]:
    """The eight shipped trajectories in the paper's order. Lengths in m, speeds in m/s.

    The printed speeds are not length x 30 / frames: they imply a duration of printed length /
    printed speed, and `speed_for_printed_duration_m_s` is our length over that duration.
    """
    rows = []
    for room, k in product(shipped.paper_scenes(), range(len(TRAJECTORIES))):
        printed = paper()["tables"]["1"][room]
        length_m = printed["length_m"][k]
        speed_m_s = printed["mean_speed_m_s"][k]
        name = f"{room}/{TRAJECTORIES[k]}"
        trajectory = read_trajectory(shipped.trajectory_file(name)).trajectory
        ours_m = trajectory.length_m()
        row = {
            "sequence": name,
            "frames": len(trajectory),
            "length_m": ours_m,
            "speed_at_30_hz_m_s": ours_m * FRAME_RATE_HZ / (len(trajectory) - 1),
            "printed_duration_s": length_m / speed_m_s,
            "speed_for_printed_duration_m_s": ours_m * speed_m_s / length_m,
            "printed_frames": printed["frames"][k],
            "printed_length_m": length_m,
            "printed_speed_m_s": speed_m_s,
        }
        rows.append(row)
    return rows


#: Columns of Table I: key of a row, head, format.
_TABLE_1 = (
    ("sequence", "sequence", ""),
    ("frames", "frames", ""),
    ("printed_frames", "printed", ""),
    ("length_m", "length m", ".3f"),
    ("printed_length_m", "printed", ".2f"),
    ("speed_at_30_hz_m_s", "m/s at 30 Hz", ".3f"),
    ("speed_for_printed_duration_m_s", "m/s for T", ".3f"),
    ("printed_speed_m_s", "printed", ".3f"),
    ("printed_duration_s", "T s", ".1f"),
)


def table_1() -> ResultTable:
    """Frames, lengths and speeds of the shipped trajectories."""
    rows = []
    for row in trajectory_rows():
        rows.append(tuple(format(row[key], spec) for key, _, spec in _TABLE_1))
    title = (
        "Table I: the trajectories. The printed speeds do not follow from 30 frames per second; "
        "T = length / speed as printed."
    )
    return ResultTable("table_1", title, tuple(head for _, head, _ in _TABLE_1), tuple(rows))


# -- Tables III to VI


def _ate_table(
    views: Sequence[Ours], others: Sequence[PaperKey], room: str, noise: str
) -> ResultTable:
    """One row per odometer and statistic, followed by other odometers and external systems."""
    printed = Printed()
    rows: list[tuple[str, ...]] = []
    bold: set[tuple[int, int]] = set()
    for odometer, statistic in product(paper_odometers(), _STATISTICS):
        row = [odometer if statistic == "rmse" else "", _STATISTICS[statistic]]
        for kt in TRAJECTORIES:
            where = Where(room, kt, noise, odometer)
            row.append(_mm(view.ate(where, statistic) for view in _whole(views, where)))
            row.append(_mm([printed.ate(where, statistic)], 1))
            if statistic == "rmse":
                sides: tuple[PaperFigures, ...] = (views[0], printed)
                best = [_is_best(side, where) for side in sides]
                bold |= {(len(rows), len(row) - 2 + k) for k in (0, 1) if best[k]}
        rows.append(tuple(row))
    rows += _further_rows(views[0], [k for k in others if (k.room, k.noise) == (room, noise)])
    number = ATE_TABLES[room, noise]
    title = f"Table {_ROMAN[number]}: ATE in mm, {room_words(room)}, {noise}."
    columns = ["odometer", "error mm"]
    for kt in TRAJECTORIES:
        columns += [kt, "printed"]
    notes = (*_part_note(views[0].results, room, noise), *_notes(views, noise))
    return ResultTable(
        f"table_{number}", title, tuple(columns), tuple(rows), frozenset(bold), notes
    )


def _whole(views: Sequence[Ours], where: Where) -> Sequence[Ours]:
    """The seeds that have every statistic of an odometer, so that the rows of a table are of the
    same runs; all if none does.
    """
    whole = [v for v in views if all(v.ate(where, name) is not None for name in _STATISTICS)]
    return whole or views


def _further_rows(view: Ours, keys: Sequence[PaperKey]) -> list[tuple[str, ...]]:
    """The RMSE of odometers and systems that the paper does not have."""
    figures = {result.key: result.figures for result in view.results}
    rows = []
    for name in sorted({key.odometer for key in keys}):
        row = [name, "RMSE"]
        for kt in TRAJECTORIES:
            own = [key for key in keys if (key.odometer, key.trajectory) == (name, kt)]
            row += [_mm(ate_of(figures[key]) for key in own), ""]
        rows.append(tuple(row))
    return [row for row in rows if any(row[2:])]


def _is_best(view: PaperFigures, where: Where) -> bool:
    """Whether an odometer has the least ATE of those of the five that have one."""
    found = [view.ate(replace(where, odometer=name)) for name in paper_odometers()]
    known = [value for value in found if value is not None]
    return len(known) > 1 and view.ate(where) == min(known)


def _part_note(results: Sequence[Measured], room: str, noise: str) -> list[str]:
    """A note if cells were measured on fewer frames than the sequence has."""
    whole = dict(zip(TRAJECTORIES, paper()["tables"]["1"][room]["frames"], strict=True))
    fewest = dict(whole)
    for r in results:
        if (r.key.room, r.key.noise) == (room, noise) and r.key.trajectory in whole:
            kt = r.key.trajectory
            fewest[kt] = min(fewest[kt], r.figures.get("frames", whole[kt]))
    part = [f"{kt} {fewest[kt]} of {whole[kt]}" for kt in whole if fewest[kt] < whole[kt]]
    if not part:
        return []
    return [f"Ours are of fewer frames than the sequences have: {', '.join(part)}."]


def _notes(views: Sequence[Ours], noise: str) -> tuple[str, ...]:
    model = [name for name in paper_odometers() if reference_of(name) == "model"]
    how = f"{' and '.join(model)} are aligned against a model, as in the paper; the others are not."
    if len(views) > 1 and noise == "noisy":
        how += f" Median of {len(views)} noise seeds, in brackets the minimum and the maximum."
    return (how, _ONE_SIDED)


def room_words(room: str) -> str:
    return shipped.SCENES[room].title.lower()


# -- Tables II and VII


def _surface_table(views: Sequence[Ours], room: str, noise: str) -> ResultTable:
    printed = Printed()
    in_paper = room == LIVING
    cells = [Where(room, kt, noise, "icp") for kt in TRAJECTORIES]
    if noise == "clean":
        cells.insert(0, Where(room, "kt0", noise, "dvo"))
    columns = ["error mm"]
    for where in cells:
        name = f" ({where.odometer})" if where.odometer != "icp" else ""
        columns += [f"{where.trajectory}{name}", *["printed"] * in_paper]
    rows = []
    for statistic, name in list(_STATISTICS.items())[1:]:
        row = [name]
        for where in cells:
            row.append(_mm(view.surface(where, statistic) for view in views))
            row += [_mm([printed.surface(where, statistic)], 1)] * in_paper
        rows.append(tuple(row))
    for name, figure in _MORE_SURFACE:
        row = [name]
        for where in cells:
            row += [_mm(figure(view.figures(where)) for view in views), *[""] * in_paper]
        rows.append(tuple(row))
    number = SURFACE_TABLES[LIVING, noise]
    name = f"table_{number}"
    what = f"of the surfaces of the {room_words(room)} in mm, {noise}"
    note = (
        "Surfaces of icp, except where noted, aligned with the model by ICP as in the paper. The "
        "last rows are not in the paper; they align by the first pose."
    )
    notes = [*_part_note(views[0].results, room, noise), note]
    if in_paper:
        title = f"Table {_ROMAN[number]}: error {what}."
        notes.append(_ONE_SIDED)
    else:
        name = f"{name}_{room}"
        title = f"Error {what}; the paper could not measure them."
    return ResultTable(name, title, tuple(columns), tuple(rows), notes=tuple(notes))


def quality_of(name: str, near: str = "") -> Figure:
    """A figure by name: accuracy, completion or Depth L1 in m (accuracy_m ...), or a share within a
    distance (f_score, 1cm).
    """

    def figure(figures: Mapping[str, Any]) -> float | None:
        quality = figures.get("surface", {}).get("quality", {})
        return quality.get(name, {}).get(near) if near else quality.get(name)

    return figure


def _not_fitted(figures: Mapping[str, Any]) -> float | None:
    return surface_of(figures, "mean", "given_m")


_MORE_SURFACE: tuple[tuple[str, Figure], ...] = (
    ("Mean, not fitted", _not_fitted),
    ("Accuracy", quality_of("accuracy_m")),
    ("Completion", quality_of("completion_m")),
    ("Depth L1", quality_of("depth_l1_m")),
)


# -- all cells


def _rpe(figures: Mapping[str, Any]) -> float | None:
    return (figures.get("rpe_1s_m") or {}).get("rmse")


def _count(name: str) -> Figure:
    return lambda figures: figures.get(name)


def _lost(figures: Mapping[str, Any]) -> float | None:
    """The frames without a pose; those of a system's trajectory follow from its coverage."""
    if "lost" not in figures and "coverage" in figures:
        return round((1 - figures["coverage"]) * figures["frames"])
    return figures.get("lost")


#: Figures of the table of all cells, and their factors.
_CELL_FIGURES: tuple[tuple[str, Figure, float], ...] = (
    ("frames", _count("frames"), 1),
    ("ATE mm", ate_of, 1e3),
    ("RPE mm/s", _rpe, 1e3),
    ("lost", _lost, 1),
    ("degenerate", _count("degenerate"), 1),
    ("surface mm", surface_of, 1e3),
    ("not fitted mm", _not_fitted, 1e3),
    ("accuracy mm", quality_of("accuracy_m"), 1e3),
    ("completion mm", quality_of("completion_m"), 1e3),
    ("Depth L1 mm", quality_of("depth_l1_m"), 1e3),
    ("F 1 cm %", quality_of("f_score", "1cm"), 100),
    ("F 2 cm %", quality_of("f_score", "2cm"), 100),
    ("F 5 cm %", quality_of("f_score", "5cm"), 100),
)
_CELL_NAME = ("room", "trajectory", "noise", "seed", "odometer", "preset", "reference")
CELL_COLUMNS = (*_CELL_NAME, *(name for name, _, _ in _CELL_FIGURES))


#: The columns of cells in a terminal.
BRIEF_COLUMNS = CELL_COLUMNS[: CELL_COLUMNS.index("surface mm") + 1]


def cells_table(results: Sequence[Measured]) -> ResultTable:
    """One row per cell."""
    rows = tuple(map(cell_row, results))
    others = {r.key.room for r in results} - set(shipped.paper_scenes())
    notes = [f"The paper's tables do not have {room_words(room)}." for room in sorted(others)]
    return ResultTable("cells", "All cells.", CELL_COLUMNS, rows, notes=tuple(notes))


def cell_row(result: Measured) -> tuple[str, ...]:
    """The texts of one row: figures with three decimals, counts with none."""
    key = result.key
    texts = []
    for _, figure, factor in _CELL_FIGURES:
        value = figure(result.figures)
        if value is None:
            texts.append("")
        else:
            texts.append(str(value) if isinstance(value, int) else f"{factor * value:.3f}")
    reference = f"run {key.run}" if key.external else key.reference
    name = (key.room, key.trajectory, key.noise, str(key.seed), key.odometer, key.preset, reference)
    return (*name, *texts)


def _mm(values: Iterable[float | None], decimals: int = 2) -> str:
    """The median in mm of figures in metres; if they differ, also the minimum and the maximum."""
    known = [1e3 * value for value in values if value is not None]
    if not known:
        return ""
    middle, low, high = (f"{f(known):.{decimals}f}" for f in (median, min, max))
    return middle if min(known) == max(known) else f"{middle} [{low}, {high}]"
