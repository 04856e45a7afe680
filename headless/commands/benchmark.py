"""`iclnuim benchmark`: runs all experiments of the paper on our sequences and writes tables,
findings and a report.
"""

import os
from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.benchmark.experiments.recipes.paper.keys import (
    PRESETS,
    PaperKey,
    all_keys,
    chosen,
    lambertian_keys,
)
from iclnuim.benchmark.experiments.table import FORMATS, ResultTable, write_tables
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import locked, make_folder
from iclnuim.sequences.frame_pool import cores
from iclnuim.sequences.stored_sequence import StoredSequence

from ..method_options import require
from ..options import add_frames, common, count
from ..planned_work import FUSE_CORE_S, TRACK_CORE_S, PlannedWork, add_dry_run, announce
from ..sequence_input import note_sequence

if TYPE_CHECKING:
    from iclnuim.benchmark.experiments.cell import Measured
    from iclnuim.benchmark.experiments.recipes.paper.recipe import Paper
    from iclnuim.benchmark.experiments.recipes.paper.sources import Sources
    from iclnuim.benchmark.experiments.store import Store

_BYTES_A_WORKER = 2 << 30
#: So many cells fit a screen.
_SCREEN = 40


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = "folder of sequences, as `iclnuim make all` writes them; default: out"
    add("--data", type=Path, default=Path("out"), metavar="DIR", help=help)
    add(
        "--out",
        "-o",
        type=Path,
        default=Path("out/benchmark"),
        metavar="DIR",
        help="default: out/benchmark",
    )
    _add_cells(parser)
    help = (
        "results of `iclnuim run` on the same sequences, shown as further rows; default: "
        "out/systems"
    )
    add("--systems", type=Path, default=Path("out/systems"), metavar="DIR", help=help)
    add(
        "--workers",
        type=count,
        metavar="N",
        help="number of processes; default: one per core and 2 GB of memory",
    )
    add(
        "--videos",
        action="store_true",
        help="add a short film of each sequence to the report; needs --data",
    )
    help = "measure nothing: write tables and report of the cells in DIR; default: those in --out"
    add("--report-only", nargs="?", const="", metavar="DIR", help=help)
    add_dry_run(parser)
    common(parser, "iclnuim benchmark --only living_room/kt0,kt2/icp,dvo")


def _add_cells(parser: ArgumentParser) -> None:
    """Add what chooses the cells."""
    add = parser.add_argument
    help = (
        "folder of the same sequences rendered without reflections (`iclnuim make all --lambertian"
        " -o DIR`), for finding 11"
    )
    add("--lambertian", type=Path, metavar="DIR", help=help)
    help = (
        "only some cells, by words of room, trajectory, noise, odometer, preset, reference; "
        "kt0,kt2/icp: ICP on kt0 and on kt2"
    )
    add("--only", metavar="FILTER", help=help)
    add_frames(parser, "only the first N frames of every sequence; default: all", leading=True)
    add(
        "--presets",
        type=_words,
        default=["best"],
        metavar="P,P",
        help=f"one or more of {','.join(PRESETS)}; default: best",
    )
    add(
        "--seeds",
        type=count,
        default=1,
        metavar="N",
        help="number of noise seeds of the noisy sequences; default: 1, the existing sequences",
    )
    help = (
        "what frames are aligned against: default, frame, keyframe, entropy, model; default: see "
        "docs/guide/benchmark.md"
    )
    add("--references", type=_words, default=[], metavar="R,R", help=help)
    help = (
        "measure trajectories only: Tables III to VI; surfaces that are measured already are kept"
    )
    add("--no-surfaces", action="store_true", help=help)


def _words(text: str) -> list[str]:
    return [word for word in text.split(",") if word]


def run(args: Namespace, console: Console) -> int:
    """Exit code 3 if a cell could not be measured; all other cells are measured."""
    problems: list[str] = []
    args.out = Path(args.report_only or args.out)
    if args.report_only is None:
        surfaces = () if args.no_surfaces else ("embreex", "igl")
        require(console, "benchmark", "numba", "cv2", *surfaces)
        from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND
        from iclnuim.benchmark.experiments.store import Store

        paper = _experiment(args, console)
        store = Store(args.out, KIND)
        if announce(_work(paper, store, args.workers or _workers()), args, console):
            return 0
        make_folder(args.out, hint="another {out}")
        with locked(args.out):  # a lock without a thread, beside which no process can be forked
            problems = paper.run(store, args.workers or _workers(), console)
    from iclnuim.benchmark.experiments.recipes.paper.page import write_report

    results = measured_cells(args.out)
    tables = tables_of(results)
    write_tables(args.out / "tables", tables)
    console.note(f"{args.out / 'tables'} written, {len(tables)} tables in {', '.join(FORMATS)}")
    films = _films(args, results, console) if args.videos else {}
    console.note(f"{write_report(args.out, results, tables, films)} written")
    console.result(_values(results, tables), _text(tables))
    if problems:
        raise WorkError(
            f"{len(problems)} cells could not be measured, for the reasons above",
            hint="running the same command again",
        )
    return 0


def measured_cells(out: Path) -> "list[Measured]":
    """All measured cells of a benchmark. Raises InputError if there are none."""
    from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND
    from iclnuim.benchmark.experiments.store import Store

    results = Store(out, KIND).read_all(PaperKey)
    if not results:
        hint = "iclnuim benchmark, or another {out}"
        raise InputError("a benchmark with measured cells", path=out, found="none", hint=hint)
    return results


def _experiment(args: Namespace, console: Console) -> "Paper":
    """The experiment that the options describe. Raises InputError if no cell can be measured."""
    from iclnuim.benchmark.experiments.recipes.paper.recipe import Paper
    from iclnuim.benchmark.experiments.recipes.paper.sources import Sources, external_keys

    if unknown := [name for name in args.presets if name not in PRESETS]:
        expected = f"presets of {', '.join(PRESETS)}"
        raise InputError(expected, setting="presets", found=", ".join(unknown))
    sources = Sources(args.data, args.out, args.lambertian)
    keys = all_keys(args.presets, range(args.seeds), args.references)
    keys += lambertian_keys(args.presets) if args.lambertian else []
    keys = _measurable(chosen(keys, args.only), sources, args, console)
    for folder in sorted({sources.folder(key) for key in keys if not key.seed}):
        note_sequence(StoredSequence(folder), console)
    systems = {}
    if args.systems.is_dir():
        systems = external_keys(args.systems, keys, sources, args.first)
    return Paper(sources, keys, systems, args.first, surfaces=not args.no_surfaces)


def _work(paper: "Paper", store: "Store", workers: int) -> PlannedWork:
    """The cells that are not measured."""
    cells = paper.cells()
    missing = store.missing(cells)
    frames = sum(paper.sources.frames(cell.key, paper.first) for cell in missing)
    seconds = frames * (TRACK_CORE_S + paper.surfaces * FUSE_CORE_S) / workers
    what = f"{len(missing)} of {len(cells)} cells to measure, {frames} frames, {workers} processes"
    return PlannedWork(what, seconds)


def _measurable(
    keys: list[PaperKey], sources: "Sources", args: Namespace, console: Console
) -> list[PaperKey]:
    """Those whose sequences are there; a note names each other one.

    Raises InputError if there are none.
    """
    faults = {}
    for key in keys:
        if key.sequence not in faults:
            faults[key.sequence] = sources.fault(key, args.first)
    for fault in sorted(set(filter(None, faults.values()))):
        console.note(f"left out: {fault}")
    found = [key for key in keys if not faults[key.sequence]]
    if not found:
        hint = "iclnuim make all, or another {data}"
        raise InputError("sequences to measure on", path=args.data, found="none", hint=hint)
    return found


def _workers() -> int:
    """The number of processes for which there are cores and memory."""
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", {}):
        return cores()
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return max(1, min(cores(), memory // _BYTES_A_WORKER))


def _films(args: Namespace, results: "list[Measured]", console: Console) -> dict[str, bytes]:
    """The films OUT/films/SEQUENCE.webm of the measured sequences that exist, by sequence; missing
    films are made.
    """
    from iclnuim.benchmark.experiments.recipes.paper.sources import Sources
    from iclnuim.native_output import native_output_in
    from iclnuim.report.preview import write_web_film

    sources = Sources(args.data, args.out, args.lambertian)
    keys = {r.key.sequence: r.key for r in results if not r.key.seed}
    folders = {name: sources.folder(key) for name, key in keys.items()}
    there = {name: folder for name, folder in folders.items() if folder.is_dir()}
    progress = console.progress(len(there), "films", "films")
    films = {}
    for name, folder in there.items():
        path = sources.out / "films" / f"{name}.webm"
        if not path.is_file():
            make_folder(path.parent)
            with native_output_in(Path(os.devnull)):  # OpenCV's FFmpeg writes to standard error
                write_web_film(folder, path, args.first)
        films[name] = path.read_bytes()
        progress.advance()
    return films


def tables_of(results: "list[Measured]") -> list[ResultTable]:
    """All tables that are made from the measured cells."""
    from iclnuim.benchmark.experiments.recipes.paper.best_methods import best_methods_table
    from iclnuim.benchmark.experiments.recipes.paper.correlation import correlation_table
    from iclnuim.benchmark.experiments.recipes.paper.figures import presets_of
    from iclnuim.benchmark.experiments.recipes.paper.findings import findings_table
    from iclnuim.benchmark.experiments.recipes.paper.tables import all_tables

    findings = [findings_table(results, preset) for preset in presets_of(results)]
    *tables, cells = all_tables(results)
    best = best_methods_table(results)
    return [best, *tables, *findings, correlation_table(results), cells]


def _text(tables: list[ResultTable]) -> str:
    """The tables with a figure of ours; of few cells, these instead of the paper's tables."""
    from iclnuim.benchmark.experiments.recipes.paper.tables import BRIEF_COLUMNS, has_ours

    *shown, cells = tables
    if len(cells.rows) <= _SCREEN:
        found = [table for table in shown if table.name.startswith("findings")]
        shown = [cells.varying(BRIEF_COLUMNS), *found]
    with_rows = [table.text() for table in shown if table.rows and has_ours(table)]
    undecided = [table.notes[-1] for table in shown if table.notes and not table.rows]
    return "\n\n".join([*with_rows, *undecided])


def _values(results: "list[Measured]", tables: list[ResultTable]) -> dict:
    """The result for --json."""
    cells = []
    for result in results:
        figures = {name: v for name, v in result.figures.items() if name != "path"}
        cells.append({"cell": asdict(result.key), "folder": str(result.folder), **figures})
    rows = {}
    for t in tables:
        rows[t.name] = {"title": t.title, "columns": t.columns, "rows": t.rows, "notes": t.notes}
    return {"cells": cells, "tables": rows}
