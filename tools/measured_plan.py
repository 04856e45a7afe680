"""Which cells of docs/measured are missing, the commands that measure them, and core-hours."""

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass

from iclnuim.benchmark.experiments.paper_keys import PaperKey, all_keys
from iclnuim.benchmark.experiments.recipes.paper import KIND, code_of_trajectory
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.shipped import trajectory_file
from iclnuim.tools.measured_cells import PublishedCells, code_hash
from iclnuim.tools.measured_tables import COMMAND_TABLES

#: Noise seeds of the preset `best`.
_SEEDS = 5
#: Core-seconds of a frame that is tracked, and of one that is fused and compared: 80 cells took 3.6
#: core-hours.
_TRACK_CORE_S = 0.07
_FUSE_CORE_S = 0.07
_PER_HOUR = 3600


@dataclass(frozen=True)
class MissingCells:
    """Cells that one command measures. core_hours: None where it is not known."""

    command: str
    cells: int
    core_hours: float | None = None


def missing_cells(cells: PublishedCells) -> Iterator[MissingCells]:
    """The trajectories, those that have no surface, and the tables of commands."""
    best = all_keys(["best"], range(_SEEDS))
    paper = all_keys(["paper"], references=["default"])
    yield from _missing(cells, [key for key in best if not key.seed], "--no-surfaces")
    yield from _missing(cells, paper, "--no-surfaces --presets paper --references default")
    yield from _missing(cells, [key for key in best if key.seed], f"--no-surfaces --seeds {_SEEDS}")
    yield from _missing(cells, [key for key in best if not key.seed], "", surface=True)
    seeds = [key for key in best if key.odometer == "icp" and key.seed]
    yield from _missing(cells, seeds, f"--seeds {_SEEDS}", surface=True)
    for table in COMMAND_TABLES.values():
        if cells.table(table.mark) is None:
            yield MissingCells(f"python tools/measured.py --measure {table.mark}", 1)


def _missing(
    cells: PublishedCells, keys: Sequence[PaperKey], options: str, surface: bool = False
) -> Iterator[MissingCells]:
    """A line for each sequence with missing cells."""
    by_sequence: dict[str, int] = {}
    for key in keys:
        cell = cells.cells.get((KIND, *astuple(key)))
        valid = cell is not None and cell.code in ("", code_hash(code_of_trajectory(key)))
        if cell is None or not valid or (surface and "surface" not in cell.figures):
            only = f"{key.room}/{key.trajectory}"
            by_sequence[only] = by_sequence.get(only, 0) + 1
    for only, count in by_sequence.items():
        frames = len(read_trajectory(trajectory_file(only)).trajectory)
        each_s = frames * (_TRACK_CORE_S + surface * _FUSE_CORE_S)
        command = f"iclnuim benchmark --only {only} {options}".rstrip()
        yield MissingCells(command, count, count * each_s / _PER_HOUR)


def plan(cells: PublishedCells) -> str:
    """The commands that measure what is missing, with the cells and core-hours of each."""
    missing = list(missing_cells(cells))
    lines = []
    for one in missing:
        hours = "" if one.core_hours is None else f", {one.core_hours:.1f} core-hours"
        lines.append(f"{one.command}: {one.cells} cells{hours}")
    total = sum(one.core_hours or 0 for one in missing)
    return "\n".join([*lines, f"{sum(one.cells for one in missing)} cells, {total:.1f} core-hours"])
