"""`iclnuim stress`: measures where methods fail: runs every method on frames perturbed with
increasing severity, and writes figures and heat maps.
"""

import os
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.benchmark.odometry.registry import names
from iclnuim.benchmark.systems.system import System, read_system
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import make_folder, write_json
from iclnuim.sequences.frame_pool import cores

from ..method_options import installed, require
from ..options import add_frames, common, count
from ..planned_work import PlannedWork, add_dry_run, announce
from ..sequence_input import note_sequence

if TYPE_CHECKING:
    from iclnuim.benchmark.experiments.cell import Cell
    from iclnuim.benchmark.experiments.recipes.stress.recipe import Stress
    from iclnuim.benchmark.experiments.recipes.stress.tables import Summary
    from iclnuim.benchmark.perturbations.plan import Plan

_SEVERITIES = (1, 2, 3, 4, 5)
_DEFAULT = (Path("out/living_room/kt2/clean"), Path("out/office/kt1/clean"))


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = (
        "clean sequences with ground truth; default: out/living_room/kt2/clean out/office/kt1/clean"
    )
    add("folders", type=Path, nargs="*", metavar="DIR", help=help)
    add(
        "--list",
        action="store_true",
        help="only list the perturbations, one per line, with their five severities",
    )
    out = Path("out/stress")
    add("-o", "--out", type=Path, default=out, metavar="OUT", help=f"default: {out}")
    help = (
        "the frames that are perturbed: noisy, with perturbations of the scene before the sensor's "
        "noise and those of the sensor after it; or clean. Default: noisy; with --system clean"
    )
    add("--base", choices=("noisy", "clean"), help=help)
    help = (
        "only perturbations whose name contains TEXT, such as `holes`; may be given several times;"
        " default: all"
    )
    add("--only", action="append", default=[], metavar="TEXT", help=help)
    add(
        "--severities",
        type=_severities,
        default=_SEVERITIES,
        metavar="K,K",
        help="such as 1,2,5; default: all five",
    )
    _add_methods(parser)
    add_frames(parser, "the first N frames of each segment, at least 3; default: :120", True)
    add(
        "--starts",
        type=count,
        metavar="N",
        help="only the first N segments of each sequence; default: all three",
    )
    add("--workers", type=count, metavar="N", help="number of processes; default: one per core")
    _add_report(parser)
    add_dry_run(parser)
    common(parser, "iclnuim stress out/living_room/kt2/clean --only holes --only noise --starts 1")


def _add_methods(parser: ArgumentParser) -> None:
    """Add what chooses odometers and systems."""
    add = parser.add_argument
    help = (
        "an odometer, or all whose name contains TEXT, such as `opencv`; may be given several "
        "times; default: all that are installed, with --system none"
    )
    add("--methods", action="append", default=[], metavar="TEXT", help=help)
    help = (
        "a system of `iclnuim run`, such as orbslam3; may be given several times; with --methods, "
        "next to these"
    )
    add("--system", action="append", default=[], metavar="SYSTEM", help=help)
    help = "an option of a system; may be given several times"
    add("--set", action="append", default=[], metavar="SYSTEM.NAME=VALUE", help=help)
    help = "runs on each segment of a system that is not deterministic; default: 5"
    add("--runs", type=count, default=5, metavar="N", help=help)
    add("--preset", default="best", help="preset of our odometers: best (default) or paper")


def _add_report(parser: ArgumentParser) -> None:
    """Add what chooses the cells of the report."""
    add = parser.add_argument
    add(
        "--report-only",
        action="store_true",
        help="table and pages of the existing cells; measure nothing",
    )
    help = "also report the cells of FILE, a stress.csv that was measured elsewhere"
    add("--cells", type=Path, metavar="FILE", help=help)
    help = (
        "measure nothing: write the perturbed frames as sequences in DIR, with masks of what is "
        "put in, for systems that run elsewhere"
    )
    add("--write", type=Path, metavar="DIR", help=help)
    help = (
        "also report the trajectories that systems made elsewhere of the sequences of --write: "
        "DIR/trajectories/.../NAME.txt (TUM)"
    )
    add("--returned", type=Path, metavar="DIR", help=help)
    add(
        "--plot", type=Path, metavar="FILE", help="draw heat maps of all methods (.png, .pdf, .svg)"
    )


def _severities(text: str) -> tuple[int, ...]:
    found = tuple(sorted({int(part) for part in text.split(",")}))
    if not set(found) <= set(_SEVERITIES):
        raise ArgumentTypeError(
            f"expected numbers from {_SEVERITIES[0]} to {_SEVERITIES[-1]}, found {text!r}"
        )
    return found


def run(args: Namespace, console: Console) -> None:
    """Exit code 0 even if methods failed: their cells report the failures."""
    require(console, "stress", "numba", "cv2")
    from iclnuim.benchmark.perturbations.plan import read_plan

    plan = read_plan()
    if args.list:
        values = {name: p.to_dict() for name, p in plan.perturbations.items()}
        console.result(values, plan.table())
        return
    # set before Open3D is loaded, as its results depend on the number of threads
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    from iclnuim.benchmark.experiments.recipes.stress.cells_file import (
        chosen,
        read_cells,
        write_cells,
    )
    from iclnuim.benchmark.experiments.recipes.stress.elsewhere import (
        returned_cells,
        write_perturbed,
    )
    from iclnuim.benchmark.experiments.recipes.stress.recipe import KIND
    from iclnuim.benchmark.experiments.recipes.stress.tables import Summary
    from iclnuim.benchmark.experiments.store import Store

    given = read_cells(args.cells) if args.cells else {}
    plan = replace(plan, frames=_segment(args.first) or plan.frames)
    args.base = args.base or ("clean" if args.system else "noisy")
    stress = _experiment(args, console, plan, may_be_empty=bool(given) and args.report_only)
    if args.write:
        count = write_perturbed(stress, args.write, console)
        console.result({"sequences": count}, f"{count} sequences in {args.write / 'sequences'}")
        return
    store = Store(args.out, KIND)
    if not (args.report_only or args.returned):
        workers = args.workers or cores()
        if announce(_work(stress, store.missing(stress.cells()), workers), args, console):
            return
        stress.run(store, workers, console)
    others = () if args.methods or args.system else sorted({key.method for key in given})
    names = tuple(dict.fromkeys([*stress.names, *others]))
    cells = chosen(given, names, stress.perturbations, args.severities, args.starts, args.base)
    cells |= {one.key: one.figures for one in store.read(stress.cells())}
    if args.returned:
        returned = returned_cells(stress, args.returned)
        names = tuple(dict.fromkeys([*names, *(key.method for key in sorted(returned))]))
        cells |= returned
    if not cells:
        hint = "the same command without --report-only"
        raise WorkError(f"{args.out}: no measured cells", hint=hint)
    make_folder(args.out, hint="another {out}")
    write_cells(cells, args.out / "stress.csv")
    summary = Summary.of(plan, names, stress.perturbations, cells, args.base)
    _report(args, console, summary, stress)


def _report(args: Namespace, console: Console, summary: "Summary", stress: "Stress") -> None:
    """Write the results as JSON, as a page and as a figure, and print the table."""
    from iclnuim.benchmark.experiments.recipes.stress.page import write_page
    from iclnuim.benchmark.experiments.recipes.stress.thumbnails import thumbnails

    write_json(args.out / "stress.json", summary.to_dict())
    page = write_page(summary, thumbnails(stress, args.out, console), args.out)
    console.note(f"{page} written")
    if args.plot:
        from iclnuim.benchmark.experiments.recipes.stress.chart import figure
        from iclnuim.report import charts

        charts.save(figure(summary), args.plot)
    tables = (summary.by_severity(), summary.overview())
    console.result(summary.to_dict(), "\n\n".join(table.text() for table in tables))


def _work(stress: "Stress", missing: Sequence["Cell"], workers: int) -> PlannedWork:
    """The cells that are not measured."""
    from iclnuim.benchmark.experiments.recipes.stress.recipe import work_s

    frames = stress.plan.frames
    segments = len({cell.key.segment for cell in missing})
    core_s = work_s(frames, segments, len(missing))
    what = (
        f"{len(missing)} of {len(stress.cells())} cells to measure, {stress.base} frames perturbed, "
        f"{segments * frames} of them, {core_s / 3600:.2g} core-hours, {workers} processes"
    )
    return PlannedWork(what, core_s / min(workers, max(1, segments)))


def _experiment(args: Namespace, console: Console, plan: "Plan", may_be_empty: bool) -> "Stress":
    """The experiment that the options describe. may_be_empty: it may have no sequence."""
    from iclnuim.benchmark.experiments.inputs import Input, rendered_name
    from iclnuim.benchmark.experiments.recipes.stress.recipe import Stress
    from iclnuim.benchmark.odometry.run import Sequence

    texts = args.only or [""]
    found = [name for name in plan.perturbations if any(text in name for text in texts)]
    if not found:
        expected = f"part of a name of {', '.join(plan.perturbations)}"
        raise InputError(expected, setting="--only", found=args.only[0])
    folders = args.folders or [folder for folder in _DEFAULT if folder.is_dir()]
    if not folders and not may_be_empty:
        hint = f"{_DEFAULT[0]}, which `iclnuim make kt2` makes"
        raise InputError("a sequence", found="none", hint=hint)
    inputs = [Input.of(Sequence(folder), rendered_name(folder)) for folder in folders]
    for one in inputs:
        note_sequence(one.sequence.stored, console, one.truth)
    return Stress(
        plan=plan,
        inputs={one.name: one for one in inputs},
        methods=() if args.system and not args.methods else _methods(args, console),
        systems=_systems(args),
        perturbations=tuple(found),
        severities=args.severities,
        starts=args.starts,
        preset=args.preset,
        runs=args.runs,
        base=args.base,
    )


def _methods(args: Namespace, console: Console) -> tuple[str, ...]:
    """Names of the requested odometers that are installed; a note names each other one."""
    texts = args.methods or [""]
    selected = []
    for name in names():
        # icp is also part of icp_rgbd
        if any(text == name or (text in name and text not in names()) for text in texts):
            selected.append(name)
    if not selected:
        expected = f"part of a name of {', '.join(names())}"
        raise InputError(expected, setting="--methods", found=args.methods[0])
    return tuple(installed(selected, args.preset, console))


def _segment(frames: int | None) -> int | None:
    """Raises InputError for segments without a trajectory error: fewer than three positions always
    fit.
    """
    if frames is not None and frames < 3:
        raise InputError("at least 3 frames", setting="--frames", found=f":{frames}")
    return frames


def _systems(args: Namespace) -> tuple[System, ...]:
    """The systems of --system, with the options of --set."""
    options: dict[str, dict[str, str]] = {name: {} for name in args.system}
    for text in args.set:
        key, sign, value = text.partition("=")
        system, dot, name = key.rpartition(".")  # the system may be a path
        if not (sign and dot and name) or system not in options:
            expected = f"SYSTEM.NAME=VALUE with SYSTEM of {', '.join(options) or '--system'}"
            raise InputError(expected, setting="--set", found=text)
        options[system][name] = value
    systems = tuple(read_system(name, given) for name, given in options.items())
    for system in systems:
        if not system.settings.has_scale:  # an error after Sim(3) is not comparable with the others
            found = f"{system.name}, which has none"
            raise InputError("systems with a scale", setting="--system", found=found)
    return systems
