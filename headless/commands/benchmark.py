"""`iclnuim benchmark`: runs all experiments of the paper on our sequences and writes tables,
findings and a report.
"""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.benchmark.experiments.recipes.paper.keys import (
    PAPER_REFERENCES,
    PRESETS,
    all_keys,
    chosen,
    lambertian_keys,
)
from iclnuim.benchmark.experiments.table import FORMATS, write_tables
from iclnuim.benchmark.odometry.references import MODELS, REFERENCES
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import locked, make_folder
from iclnuim.sequences.stored_sequence import StoredSequence

from ..method_options import require
from ..options import add_frames, common, count
from ..planned_work import PlannedWork, add_dry_run, announce
from ..sequence_input import note_sequence

if TYPE_CHECKING:
    from iclnuim.benchmark.experiments.recipes.paper.recipe import Paper
    from iclnuim.benchmark.experiments.store import Store

_BYTES_A_WORKER = 2 << 30


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
        f"what frames are aligned against: default, {', '.join((*REFERENCES, *MODELS))}, or "
        f"{PAPER_REFERENCES} for each odometer's own in the paper; default: see "
        "docs/guide/benchmark.md"
    )
    add("--references", type=_words, default=[], metavar="R,R", help=help)
    help = (
        "measure trajectories only: Tables III to VI; surfaces that are measured already are kept, "
        "and missing ones can be measured later, along the trajectories"
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
        from iclnuim.benchmark.experiments.pool import processes
        from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND
        from iclnuim.benchmark.experiments.store import Store

        workers = args.workers or processes(_BYTES_A_WORKER)
        paper = _experiment(args, console)
        store = Store(args.out, KIND)
        if announce(_work(paper, store, workers), args, console):
            return 0
        make_folder(args.out, hint="another {out}")
        with locked(args.out):  # a lock without a thread, beside which no process can be forked
            problems = paper.run(store, workers, console)
    from iclnuim.benchmark.experiments.recipes.paper import page
    from iclnuim.benchmark.experiments.recipes.paper.recipe import measured_cells
    from iclnuim.benchmark.experiments.recipes.paper.sources import Sources

    results = measured_cells(args.out)
    tables = page.tables_of(results)
    write_tables(args.out / "tables", tables)
    console.note(f"{args.out / 'tables'} written, {len(tables)} tables in {', '.join(FORMATS)}")
    films = {}
    if args.videos:
        sources = Sources(args.data, args.out, args.lambertian)
        films = page.films(sources, results, args.first, console)
    console.note(f"{page.write_report(args.out, results, tables, films)} written")
    console.result(page.values_of(results, tables), page.text_of(tables))
    if problems:
        raise WorkError(
            f"{len(problems)} cells could not be measured, for the reasons above",
            hint="running the same command again",
        )
    return 0


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
    keys = sources.measurable(chosen(keys, args.only), args.first, console.note)
    for folder in sorted({sources.folder(key) for key in keys if not key.seed}):
        note_sequence(StoredSequence(folder), console)
    systems = {}
    if args.systems.is_dir():
        systems = external_keys(args.systems, keys, sources, args.first)
    return Paper(sources, keys, systems, args.first, surfaces=not args.no_surfaces)


def _work(paper: "Paper", store: "Store", workers: int) -> PlannedWork:
    """The cells that are not measured, with the core-hours of each preset and reference."""
    cells = paper.cells()
    missing = store.missing(cells)
    counts: dict[str, tuple[int, float]] = {}
    for cell in missing:
        kind = f"{cell.key.preset}, {cell.key.reference}"
        count, core_s = counts.get(kind, (0, 0.0))
        counts[kind] = (count + 1, core_s + paper.core_seconds(cell, store))
    what = f"{len(missing)} of {len(cells)} cells to measure, {workers} processes"
    for kind, (count, core_s) in counts.items():
        what += f"; {kind}: {count} cells, {core_s / 3600:.1f} core-hours"
    return PlannedWork(what, sum(core_s for _, core_s in counts.values()) / workers)
