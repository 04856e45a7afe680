"""Which cells of docs/measured are missing, the commands that measure them, and core-hours."""

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass

from iclnuim.benchmark.experiments.recipes.paper.figures import reference_of
from iclnuim.benchmark.experiments.recipes.paper.keys import PaperKey, all_keys
from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND, code_of_trajectory
from iclnuim.benchmark.experiments.recipes.stress.recipe import KIND as STRESS
from iclnuim.benchmark.perturbations.plan import SEVERITIES
from iclnuim.shipped import trajectory_file
from iclnuim.tools.measured_cells import TABLE, PublishedCells, code_hash, rooms_hash
from iclnuim.tools.measured_drawn import sequences, stress_summary, system_key
from iclnuim.tools.measured_tables import COMMAND_TABLES
from iclnuim.trajectory_files.trajectories import read_trajectory

#: Noise seeds of the preset `best`, each odometer with the paper's reference.
_SEEDS = 5
#: Core-seconds of a frame that is tracked, and of one that is fused and compared: 80 cells took 3.6
#: core-hours.
_TRACK_CORE_S = 0.07
_FUSE_CORE_S = 0.07
#: Core-seconds of a frame with ORB-SLAM3, and of a segment of `iclnuim stress` with one method: 30
#: cells took 70 s with compilation.
_ORB_CORE_S = 0.07
_STRESS_CORE_S = 5.0
_PER_HOUR = 3600
#: Runs of a system that is not deterministic.
_RUNS = 5
#: The sequences of which `iclnuim stress` measures one segment.
_SEGMENTS = ("out/living_room/kt2/clean", "out/office/kt1/clean")


@dataclass(frozen=True)
class MissingCells:
    """Cells that one command measures. core_hours: None where it is not known."""

    command: str
    cells: int
    core_hours: float | None = None


def missing_cells(cells: PublishedCells) -> Iterator[MissingCells]:
    """The trajectories, those that have no surface, and the tables of commands that are missing or
    of other rooms.
    """
    best = all_keys(["best"], range(_SEEDS))
    paper = all_keys(["paper"], references=["default"])
    yield from _missing(cells, [key for key in best if not key.seed], "--no-surfaces")
    yield from _missing(cells, paper, "--no-surfaces --presets paper --references default")
    seeds = [key for key in best if key.seed and key.reference == reference_of(key.odometer)]
    for reference in ("default", "model"):
        others = [key for key in seeds if key.reference == reference and key.odometer != "icp"]
        names = ",".join(sorted({key.odometer for key in others}))
        options = f"--no-surfaces --seeds {_SEEDS} --references {reference}"
        yield from _missing(cells, others, options, words=f"/{names}")
    icp = [key for key in seeds if key.odometer == "icp"]
    options = f"--seeds {_SEEDS} --references {reference_of('icp')}"
    yield from _missing(cells, icp, options, surface=True, words="/icp")
    yield from _missing(cells, [key for key in best if not key.seed], "", surface=True)
    yield from _missing_runs(cells)
    yield from _missing_stress(cells)
    for mark in COMMAND_TABLES:
        cell = cells.cells.get((TABLE, mark))
        if cell is None or cell.input != rooms_hash():
            yield MissingCells(f"python tools/measured.py --measure {mark}", 1)


def _missing(
    cells: PublishedCells,
    keys: Sequence[PaperKey],
    options: str,
    surface: bool = False,
    words: str = "",
) -> Iterator[MissingCells]:
    """A line for each sequence with missing cells. words: of the filter, after the sequence."""
    by_sequence: dict[str, int] = {}
    for key in keys:
        cell = cells.cells.get((KIND, *astuple(key)))
        valid = cell is not None and cell.code in ("", code_hash(code_of_trajectory(key)))
        if cell is None or not valid or (surface and "surface" not in cell.figures):
            only = f"{key.room}/{key.trajectory}{words}"
            by_sequence[only] = by_sequence.get(only, 0) + 1
    for only, count in by_sequence.items():
        each_s = _frames(only.removesuffix(words)) * (_TRACK_CORE_S + surface * _FUSE_CORE_S)
        command = f"iclnuim benchmark --only {only} {options}".rstrip()
        yield MissingCells(command, count, count * each_s / _PER_HOUR)


def _missing_runs(cells: PublishedCells) -> Iterator[MissingCells]:
    """The runs of ORB-SLAM3, which is not deterministic, on all sequences."""
    count = 0
    hours = 0.0
    for sequence in sequences():
        keys = [system_key(sequence, "ORB-SLAM3", run) for run in range(1, _RUNS + 1)]
        missing = sum((KIND, *astuple(key)) not in cells.cells for key in keys)
        count += missing
        hours += missing * _frames(f"{sequence[0]}/{sequence[1]}") * _ORB_CORE_S / _PER_HOUR
    if count:
        command = f"iclnuim run orbslam3 out/ROOM/TRAJECTORY/NOISE --runs {_RUNS}"
        yield MissingCells(command, count, hours)


def _missing_stress(cells: PublishedCells) -> Iterator[MissingCells]:
    """The cells of all perturbations and severities on one segment of each room, by method."""
    summary = stress_summary(cells)
    expected = len(_SEGMENTS) * (1 + SEVERITIES * len(summary.perturbations))
    for method in summary.methods:
        count = expected - sum(key[5] == method for key in cells.cells if key[0] == STRESS)
        if count:
            command = f"iclnuim stress {' '.join(_SEGMENTS)} --starts 1 --methods {method}"
            yield MissingCells(command, count, count * _STRESS_CORE_S / _PER_HOUR)


def _frames(sequence: str) -> int:
    return len(read_trajectory(trajectory_file(sequence)).trajectory)


def plan(cells: PublishedCells) -> str:
    """The commands that measure what is missing, with the cells and core-hours of each."""
    missing = list(missing_cells(cells))
    lines = []
    for one in missing:
        hours = "" if one.core_hours is None else f", {one.core_hours:.1f} core-hours"
        lines.append(f"{one.command}: {one.cells} cells{hours}")
    total = sum(one.core_hours or 0 for one in missing)
    return "\n".join([*lines, f"{sum(one.cells for one in missing)} cells, {total:.1f} core-hours"])
