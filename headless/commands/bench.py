"""`iclnuim bench`: measurements of time and error, with their conditions."""

import importlib
from argparse import ArgumentParser, Namespace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iclnuim import checkout
from iclnuim.benchmark.experiments.recipes.system.recipe import merged, read_results
from iclnuim.benchmark.odometry.registry import ODOMETERS, names, odometer
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError

from ..method_options import COLUMNS, installed, open_sequence, require
from ..options import FRAMES, Actions, action, add_frames, add_plot, subcommands
from ..planned_work import TRACK_CORE_S, PlannedWork, add_dry_run, announce
from ..sequence_input import add_camera_options
from . import bench_curve

if TYPE_CHECKING:
    from iclnuim.benchmark.odometry.run import Sequence

#: Frames that each odometer tracks before the measurement, so that compiling and loading are not
#: timed.
_WARM_UP = 3
#: Modules of tools/ -> the actions that they add.
_TOOLS = {
    "bench_render": ("render", "textures"),
    "bench_noise": ("noise",),
    "bench_farm": ("farm", "chaos"),
}


def configure(parser: ArgumentParser) -> None:
    actions = subcommands(parser, "WHAT")
    help = "speed and error of our odometers and third-party ones in one run"
    example = (
        "iclnuim bench odometry out/living_room/kt2/clean out/living_room/kt2/noisy --plot "
        "odometry.png"
    )
    odometry = action(actions, "odometry", help, example, _odometry)
    odometry.description = f"{help}. {COLUMNS}"
    add = odometry.add_argument
    what = (
        "sequences with ground truth, or earlier results: output of --json, or results.json of "
        "`iclnuim run`"
    )
    add("folders", type=Path, nargs="+", metavar="DIR", help=what)
    add_camera_options(odometry)
    add("--preset", default="best", help="preset of our odometers: best (default) or paper")
    add_frames(odometry, FRAMES)
    add(
        "--only",
        metavar="TEXT",
        help="only odometers whose name contains TEXT, such as `icp`, or `ours`: the built-in ones",
    )

    add_plot(odometry, "time against error")
    add_dry_run(odometry)

    bench_curve.configure(actions)
    _configure_tools(actions)


def _configure_tools(actions: Actions) -> None:
    """Add the measurements of this project itself, which only a checkout has."""
    try:
        checkout.load("iclnuim.tools", "this benchmark")
        checkout.load("iclnuim.blend.builder", "this benchmark")
    except WorkError as error:
        for name in chain.from_iterable(_TOOLS.values()):
            unavailable = actions.add_parser(name, help="needs a checkout of the repository")
            unavailable.set_defaults(run=partial(_refuse, error))
    else:
        for module in _TOOLS:
            importlib.import_module(f"iclnuim.tools.{module}").configure(actions)


def _refuse(error: WorkError, args: Namespace, console: Console) -> None:
    raise error


def _odometry(args: Namespace, console: Console) -> None:
    from iclnuim.benchmark.experiments.recipes.curve.chart import front, odometry_figure
    from iclnuim.benchmark.odometry.run import odometry_table

    only = args.only or ""
    which = list(ODOMETERS) if only == "ours" else [name for name in names() if only in name]
    if not which:
        raise InputError(f"part of a name of {', '.join(names())}", found=args.only)
    results = []
    folders = []
    for path in args.folders:
        if path.suffix == ".json":
            results += read_results(path)
        else:
            folders.append(path)
    if folders:
        require(console, "bench odometry", "numba", "cv2")
        which = installed(which, args.preset, console)
    sequences = [open_sequence(args, console, folder, frames=args.frames) for folder in folders]
    if sequences and announce(_work(sequences, which), args, console):
        return
    results += [_compare_odometers(sequence, which, args, console) for sequence in sequences]
    results = merged(results)
    if args.plot:
        from iclnuim.report import charts

        charts.save(odometry_figure(results), args.plot)
    texts = []
    for result in results:
        title = result["sequence"]
        if result["preset"]:
            title += f", our odometers with preset {result['preset']}"
        best = f"Pareto front: {', '.join(front(result['runs']))}"
        texts.append("\n".join([title, odometry_table(result["runs"]), best]))
    console.result({"results": results}, "\n\n".join(texts))


def _work(sequences: "list[Sequence]", which: list[str]) -> PlannedWork:
    frames = sum(map(len, sequences))
    what = f"{frames} frames, {len(which)} odometers"
    return PlannedWork(what, frames * len(which) * TRACK_CORE_S)


def _compare_odometers(
    sequence: "Sequence", which: list[str], args: Namespace, console: Console
) -> dict[str, Any]:
    """Run the odometers; returns `sequence`, `preset` and `runs` (Run.to_dict() of each).

    Raises InputError without ground truth.
    """
    from iclnuim.benchmark.odometry.run import run_odometers
    from iclnuim.sequences.recipe import sequence_name

    for frames, progress in ((_WARM_UP, None), (None, console.progress)):
        odometers = [odometer(name, args.preset) for name in which]
        runs = run_odometers(odometers, sequence, progress=progress, frames=frames)
    if runs[0].truth is None:
        raise InputError("a ground truth in the folder", path=sequence.folder)
    return {
        "sequence": sequence_name(sequence.folder),
        "preset": args.preset,
        "runs": [run.to_dict() for run in runs],
    }
