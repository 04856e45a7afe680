"""Redraws the measured tables of docs/measured from the cells in docs/measured/cells.jsonl.

    python tools/measured.py                        all pages
    python tools/measured.py --plan                 which cells are missing, commands, core-hours
    python tools/measured.py --take out/benchmark   cells of `iclnuim benchmark` or `iclnuim stress`
                                                    into the file, then all pages
    python tools/measured.py --measure light        measures a table's commands, then all pages
    python tools/measured.py --list                 pages, marks, commands

In a page, what is drawn is between `<!-- measured: MARK -->` and `<!-- end of MARK -->`. Commands
run in the top folder of the checkout, on the sequences that `iclnuim make all` writes to out/. A
table that no command measures any more is drawn from its cell.
"""

import json
import re
import shlex
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from iclnuim import checkout
from iclnuim.benchmark.experiments.cell import Measured
from iclnuim.benchmark.experiments.recipes.paper.best_methods import accuracy_figure
from iclnuim.benchmark.experiments.recipes.paper.charts import Material, draw
from iclnuim.benchmark.experiments.recipes.paper.figures import reference_of, system_key
from iclnuim.benchmark.experiments.recipes.paper.keys import (
    NOISES,
    PAPER_REFERENCES,
    PaperKey,
    all_keys,
    core_seconds,
    paper_odometers,
)
from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND as BENCHMARK
from iclnuim.benchmark.experiments.recipes.paper.recipe import code_of_trajectory
from iclnuim.benchmark.experiments.recipes.paper.sources import Sources
from iclnuim.benchmark.experiments.recipes.paper.tables import LIVING
from iclnuim.benchmark.experiments.recipes.stress import chart as stress_chart
from iclnuim.benchmark.experiments.recipes.stress.recipe import KIND as STRESS
from iclnuim.benchmark.experiments.recipes.stress.recipe import StressKey, work_s
from iclnuim.benchmark.experiments.store import Store, made_by
from iclnuim.benchmark.perturbations.plan import BASES, CLEAN, NOISY, SEVERITIES, read_plan
from iclnuim.errors import InputError
from iclnuim.report.charts import save
from iclnuim.shipped import paper_sequences, trajectory_file
from iclnuim.trajectory_files.trajectories import read_trajectory

checkout.load("iclnuim.tools", "measuring pages")
from iclnuim.tools.measured_cells import (  # noqa: E402
    TABLE,
    PublishedCell,
    PublishedCells,
    Run,
    code_hash,
    rooms_hash,
)
from iclnuim.tools.measured_drawn import (  # noqa: E402
    DRAWN,
    NOT_MEASURED,
    sequences,
    stress_summary,
    ways_figure,
)
from iclnuim.tools.measured_tables import COMMAND_TABLES, CommandTable, markdown  # noqa: E402

TOP = Path(__file__).resolve().parents[1]
PAGES = Path("docs/measured")
CELLS = PAGES / "cells.jsonl"
#: Endings of the marks of a page's single figures, and of the runs of all its cells.
_FACTS = "-facts"
_RUNS = "-cells"
#: Of the largest chart, so that its file stays small; its numbers can still be read.
_STRESS_DPI = 70
#: The paper's figures of measured cells.
_PAPER_FIGURES = range(5, 10)
_MARKED = re.compile(r"<!-- measured: (.*) -->\n(.*?)<!-- end of \1 -->\n", re.S)
#: Noise seeds of the preset `best`, each odometer with the paper's reference.
_SEEDS = 5
#: Core-seconds of a frame with ORB-SLAM3.
_ORB_CORE_S = 0.07
_PER_HOUR = 3600
#: Runs of a system that is not deterministic.
_RUNS_EACH = 5
#: The sequences of which `iclnuim stress` measures one segment.
_SEGMENTS = ("out/living_room/kt2/clean", "out/office/kt1/clean")
_KEYS = {BENCHMARK: PaperKey, STRESS: StressKey}


def redrawn(text: str, cells: PublishedCells) -> str:
    """A page with the tables of its marks. Raises ValueError for a mark that nothing draws."""
    cells.used.clear()
    return _MARKED.sub(lambda found: _block(found[1], cells), text)


def _block(mark: str, cells: PublishedCells) -> str:
    return f"<!-- measured: {mark} -->\n{drawn(mark, cells)}<!-- end of {mark} -->\n"


def drawn(mark: str, cells: PublishedCells) -> str:
    """What stands at a mark. Raises ValueError if nothing draws it."""
    how = "python tools/measured.py --plan"
    if mark in DRAWN:
        rows = DRAWN[mark](cells)
    elif mark in COMMAND_TABLES or (TABLE, mark) in cells.cells:
        rows = cells.table(mark) or []
        how = f"python tools/measured.py --measure {mark}"
    elif mark.endswith(_FACTS):
        page = mark.removesuffix(_FACTS)
        rows = [["what", "measured", "command", "commit"], *cells.facts(page)]
    elif mark.endswith(_RUNS):
        rows = [["command", "machine", "commits"], *_runs(cells)]
    else:
        raise ValueError(f"nothing draws {mark}")
    return markdown(rows) if rows[1:] else f"{NOT_MEASURED}: `{how}`\n"


def _runs(cells: PublishedCells) -> Iterator[list[str]]:
    """The runs of the cells that the page has shown so far, those of a command together."""
    commits: dict[tuple[str, str], list[str]] = {}
    for run in sorted(cells.used, key=astuple):
        commits.setdefault((run.command, run.machine), []).append(run.commit)
    for (command, machine), found in sorted(commits.items()):
        yield [f"`{command}`", machine, ", ".join(found)]


def output_of(command: str) -> Any:
    """The output of a command of iclnuim with --json."""
    print(f"iclnuim {command} --json", file=sys.stderr, flush=True)
    words = [sys.executable, "-m", "iclnuim", *shlex.split(command), "--json"]
    done = subprocess.run(words, cwd=TOP, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"measured: iclnuim {command.split()[0]} ended with exit code {done.returncode}")
    return json.loads(done.stdout)


def measured(table: CommandTable) -> PublishedCell:
    """The cell of a table, from its commands."""
    found = [output_of(command) for command in table.commands]
    command = f"iclnuim {table.commands[0].partition(' --plot')[0]}"
    if len(table.commands) > 1:
        command = f"python tools/measured.py --measure {table.mark}"
    rows = {"rows": table.rows(found)}
    return PublishedCell(_run(made_by(), command), rows, input=rooms_hash())


def _run(recipe: dict[str, Any], command: str) -> Run:
    """The run of a recipe as the store writes it."""
    commit = (recipe["source_commit"] or "unknown")[:8]
    return Run(commit, f"{recipe['machine']['cores']} cores", command)


def take(cells: PublishedCells, folder: Path) -> int:
    """Put in the cells of a store; returns their number. Says which ones take a surface away."""
    recipe = _recipe(folder)
    kind = recipe["kind"]
    results = Store(folder, kind).read_all(_KEYS[kind])
    there = {one.key for one in cells.benchmark() if "surface" in one.figures}
    for one in results:
        if one.key in there and "surface" not in one.figures:
            hint = "iclnuim benchmark without --no-surfaces adds it"
            print(f"{one.key.place}: replaces a cell with a surface; {hint}", file=sys.stderr)
    cells.add(results, kind, _run(recipe, f"iclnuim {kind}"))
    return len(results)


def _recipe(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "recipe.json").read_text())
    return found


def pages() -> list[Path]:
    return sorted((TOP / PAGES).glob("*.md"))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--list", action="store_true", help="show pages, marks and commands")
    parser.add_argument("--plan", action="store_true", help="show which cells are missing")
    help = "put the cells of a benchmark's or a stress's folder into the file"
    parser.add_argument(
        "--take", type=Path, metavar="FOLDER", action="append", default=[], help=help
    )
    help = "measure the tables whose marks begin with TEXT"
    parser.add_argument("--measure", metavar="TEXT", help=help)
    args = parser.parse_args(arguments)
    cells = PublishedCells.read(TOP / CELLS)
    if args.list:
        print(listed())
        return 0
    if args.plan:
        print(plan(cells))
        return 0
    for folder in args.take:
        print(f"{folder}: {take(cells, folder)} cells", file=sys.stderr)
        if _recipe(folder)["kind"] == BENCHMARK:
            draw_paper_figures(folder)
    if args.measure is not None:
        chosen = [one for mark, one in COMMAND_TABLES.items() if mark.startswith(args.measure)]
        if not chosen:
            parser.error(f"--measure: no table of a command begins with {args.measure}")
        for table in chosen:
            cells.cells[TABLE, table.mark] = measured(table)
            cells.write(TOP / CELLS)
    cells.write(TOP / CELLS)
    cells = PublishedCells.read(TOP / CELLS)  # in the order in which every later call draws them
    for page in pages():
        page.write_text(redrawn(page.read_text(), cells))
    draw_charts(cells)
    return 0


def draw_charts(cells: PublishedCells) -> None:
    """The pictures that are drawn from the cells of experiments."""
    pictures = TOP / PAGES / "pictures"
    save(accuracy_figure(cells.benchmark()), pictures / "accuracy.png")
    for base, name in ((CLEAN, "stress"), (NOISY, "stress_noisy")):
        drawing = stress_chart.figure(stress_summary(cells, base))
        save(drawing, pictures / f"{name}.png", _STRESS_DPI)
    save(ways_figure(), pictures / "own_scenes_ways.png")


def draw_paper_figures(folder: Path) -> None:
    """The paper's figures 5 to 9 that the pictures in a benchmark's folder allow, of the preset
    `paper` if it has their cells. None of a preset some of whose cells the folder lacks, which would
    leave holes.
    """
    results = [r for r in Store(folder, BENCHMARK).read_all(PaperKey) if r.folder.is_dir()]
    whole = [preset for preset in ("paper", "best") if _has_all_cells(results, preset)]
    for number in _PAPER_FIGURES:
        for preset in whole:
            try:
                figure = draw(number, Material(Sources(TOP / "out", folder), results, preset))
            except InputError:  # no cell of it
                continue
            save(figure, TOP / PAGES / f"pictures/figure_{number}.jpg", _STRESS_DPI)
            break


def _has_all_cells(results: Sequence[Measured], preset: str) -> bool:
    """Whether each of the paper's odometers is there on each of its sequences."""
    keys = [r.key for r in results if r.key.preset == preset]
    there = {(f"{key.room}/{key.trajectory}", key.noise, key.odometer) for key in keys}
    return there >= set(product(paper_sequences(), NOISES, paper_odometers()))


def listed() -> str:
    """The marks of each page, with the commands of those that commands measure."""
    lines = []
    for page in pages():
        for mark, _ in _MARKED.findall(page.read_text()):
            lines.append(f"{PAGES / page.name} {mark}")
            if mark in COMMAND_TABLES:
                lines += [f"    iclnuim {command}" for command in COMMAND_TABLES[mark].commands]
    return "\n".join(lines)


# -- the plan


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
    paper = all_keys(["paper"], references=[PAPER_REFERENCES])
    of_paper = f"--presets paper --references {PAPER_REFERENCES}"
    for surface in (True, False):  # the paper has surfaces of the living room
        some = [key for key in paper if (key.room == LIVING) == surface]
        options = of_paper if surface else f"--no-surfaces {of_paper}"
        yield from _missing(cells, some, options, surface)
    ahead = all_keys(["paper"], references=["model-ahead"])
    ahead = [key for key in ahead if reference_of(key.odometer) == "model"]
    options = "--no-surfaces --presets paper --references model-ahead"
    yield from _missing(cells, ahead, options, words="/icp,icp_rgbd")
    yield from _missing(cells, [key for key in best if not key.seed], "--no-surfaces")
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
    by_sequence: dict[str, tuple[int, float]] = {}
    for key in keys:
        cell = cells.cells.get((BENCHMARK, *astuple(key)))
        valid = cell is not None and cell.code in ("", code_hash(code_of_trajectory(key)))
        if cell is None or not valid or (surface and "surface" not in cell.figures):
            only = f"{key.room}/{key.trajectory}{words}"
            core_s = _frames(f"{key.room}/{key.trajectory}") * core_seconds(key, True, surface)
            count, total_s = by_sequence.get(only, (0, 0.0))
            by_sequence[only] = (count + 1, total_s + core_s)
    for only, (count, total_s) in by_sequence.items():
        command = f"iclnuim benchmark --only {only} {options}".rstrip()
        yield MissingCells(command, count, total_s / _PER_HOUR)


def _missing_runs(cells: PublishedCells) -> Iterator[MissingCells]:
    """The runs of ORB-SLAM3, which is not deterministic, on all sequences."""
    count = 0
    hours = 0.0
    for sequence in sequences():
        keys = [system_key(sequence, "ORB-SLAM3", run) for run in range(1, _RUNS_EACH + 1)]
        missing = sum((BENCHMARK, *astuple(key)) not in cells.cells for key in keys)
        count += missing
        hours += missing * _frames(f"{sequence[0]}/{sequence[1]}") * _ORB_CORE_S / _PER_HOUR
    if count:
        command = f"iclnuim run orbslam3 out/ROOM/TRAJECTORY/NOISE --runs {_RUNS_EACH}"
        yield MissingCells(command, count, hours)


def _missing_stress(cells: PublishedCells) -> Iterator[MissingCells]:
    """The cells of all perturbations and severities on one segment of each room, by base and
    method: of our odometers on both bases, of the others on clean frames.
    """
    found = list(cells.stress())
    frames = read_plan().frames
    for base in BASES:
        summary = stress_summary(cells, base)
        names = summary.perturbations if base == CLEAN else tuple(read_plan().perturbations)
        expected = len(_SEGMENTS) * (1 + SEVERITIES * len(names))
        for method in summary.methods if base == CLEAN else paper_odometers():
            count = expected - sum((key.method, key.base) == (method, base) for key in found)
            if count:
                what = f"--starts 1 --base {base} --methods {method}"
                command = f"iclnuim stress {' '.join(_SEGMENTS)} {what}"
                yield MissingCells(command, count, work_s(frames, count, count) / _PER_HOUR)


@cache
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


if __name__ == "__main__":
    sys.exit(main())
