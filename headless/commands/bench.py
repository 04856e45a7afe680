"""`iclnuim bench`: measurements of time and error; each reports its figures and their conditions."""

import argparse
import importlib
from collections.abc import Callable
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim import checkout
from iclnuim.benchmark.experiments.recipes.system import merged, read_results
from iclnuim.benchmark.odometry.registry import names, odometer
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError

from ..method_options import installed, open_sequence, require
from ..options import Actions, action, add_plot, count, subcommands
from ..sequence_options import add_camera_options
from . import bench_curve

if TYPE_CHECKING:
    from iclnuim.benchmark.odometry.run import Sequence
    from matplotlib.figure import Figure

#: Frames that each odometer tracks before the measurement, so that compiling and loading are not
#: timed.
_WARM_UP = 3
#: Modules of tools/ -> the actions that they add.
_TOOLS = {
    "bench_render": ("render", "textures"),
    "bench_noise": ("noise",),
    "bench_evaluate": ("evaluate",),
    "bench_farm": ("farm", "chaos"),
    "bench_detail": ("detail",),
    "detail_odometry": ("detail-odometry",),
}


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser, "WHAT")
    help = "speed and error of our odometers and third-party ones in one run"
    example = "iclnuim bench odometry out/living_room/kt2/clean out/living_room/kt2/noisy --plot odometry.png"
    odometry = action(actions, "odometry", help, example, _odometry)
    add = odometry.add_argument
    what = "sequences with ground truth, or earlier results: output of --json, or results.json of `iclnuim run`"
    add("folders", type=Path, nargs="+", metavar="DIR", help=what)
    add_camera_options(odometry)
    add("--preset", default="best", help="preset of our odometers: best (default) or paper")
    add("--first", type=count, metavar="N", help="only the first N frames")
    add(
        "--only",
        metavar="TEXT",
        help="only odometers whose name contains TEXT, such as `icp`, or `ours`: the built-in ones",
    )

    add_plot(odometry, "time against error")

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


def _refuse(error: WorkError, args: argparse.Namespace, console: Console) -> None:
    raise error


def _odometry(args: argparse.Namespace, console: Console) -> None:
    from iclnuim.benchmark.odometry.run import table

    only = args.only or ""
    which = [
        name for name in names() if only in (name if ":" in name else f"ours:{name}")
    ]  # as in `iclnuim run`
    if not which:
        raise InputError(f"part of a name of {', '.join(names())}", found=args.only)
    results = [
        result
        for folder in args.folders
        if folder.suffix == ".json"
        for result in read_results(folder)
    ]
    folders = [folder for folder in args.folders if folder.suffix != ".json"]
    if folders:
        require("bench odometry", "numba", "cv2")
        which = installed(which, args.preset, console)
    sequences = [open_sequence(args, console, folder) for folder in folders]
    results += [
        _compare_odometers(s, which, args.preset, args.first, console.progress) for s in sequences
    ]
    results = merged(results)
    if args.plot:
        from iclnuim.report import charts

        charts.save(_odometry_figure(results), args.plot)
    texts = []
    for r in results:
        title = r["sequence"] + (
            f", our odometers with preset {r['preset']}" if r["preset"] else ""
        )
        texts.append(f"{title}\n{table(r['runs'])}\nPareto front: {', '.join(_front(r['runs']))}")
    console.result({"results": results}, "\n\n".join(texts))


def _compare_odometers(
    sequence: "Sequence", names: list[str], preset: str, frames: int | None, progress: Callable
) -> dict:
    """Run the odometers; returns `sequence`, `preset` and `runs` (Run.to_dict() of each).

    Raises InputError without ground truth.
    """
    from iclnuim.benchmark.odometry.run import run_together
    from iclnuim.dataset.frames import sequence_name

    run_together([odometer(name, preset) for name in names], sequence, frames=_WARM_UP)
    runs = run_together(
        [odometer(name, preset) for name in names], sequence, progress=progress, frames=frames
    )
    if runs[0].truth is None:
        raise InputError("a ground truth in the folder", path=sequence.folder)
    return {
        "sequence": sequence_name(sequence.folder),
        "preset": preset,
        "runs": [run.to_dict() for run in runs],
    }


def _front(runs: list[dict]) -> list[str]:
    """The Pareto front: names of the runs that no other run beats in both median time and error."""
    from iclnuim.report import pareto

    runs = [d for d in runs if _has_point(d)]
    return [
        runs[k]["odometer"] for k in pareto.front([(d["ms_median"], d["ate_rmse_m"]) for d in runs])
    ]


def _has_point(d: dict) -> bool:
    return d["ate_rmse_m"] is not None and d["ms_median"] is not None


def _odometry_figure(results: list[dict]) -> "Figure":
    """ATE over time per frame: a dot at the median and a line to the 95th percentile (several runs:
    a triangle, and the quartiles of the ATE); the Pareto front is dashed.
    """
    import numpy as np
    from iclnuim.report.charts import COLOURS
    from matplotlib.figure import Figure

    columns = min(len(results), 4)
    rows = -(-len(results) // columns)
    side = 4.0 if rows == 1 else 3.0
    drawing = Figure(figsize=((side + 0.2) * columns + 1.5, side * rows), layout="constrained")
    panels = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    names = dict.fromkeys(d["odometer"] for result in results for d in result["runs"])
    # hollow markers once the colours are used up
    looks = {name: (COLOURS[i % len(COLOURS)], i // len(COLOURS)) for i, name in enumerate(names)}
    shown = {}
    for axes, result in zip(panels.flat, results, strict=False):
        best, not_beaten = [], _front(result["runs"])
        for d in result["runs"]:
            if not _has_point(d):
                continue
            ate_mm, marker = (
                d["ate_rmse_m"] * 1e3,
                "s" if d["odometer"].startswith("baseline:") else "o",
            )
            colour, hollow = looks[d["odometer"]]
            if (
                "runs" in d
            ):  # from `iclnuim run`: quartiles of the error, and the time of the whole process
                marker = "^"
                axes.plot(
                    [d["ms_median"]] * 2,
                    1e3 * np.array(d["ate_quartiles_m"]),
                    color=colour,
                    linewidth=1,
                )
            else:
                axes.plot([d["ms_median"], d["ms_95"]], [ate_mm, ate_mm], color=colour, linewidth=1)
            style = {
                "color": colour,
                "linestyle": "",
                "markerfacecolor": "white" if hollow else colour,
            }
            (shown[d["odometer"]],) = axes.plot(d["ms_median"], ate_mm, marker, **style)
            if d["odometer"] in not_beaten:
                best.append((d["ms_median"], ate_mm))
        axes.plot(
            [ms for ms, _ in sorted(best)],
            [mm for _, mm in sorted(best)],
            "--",
            color="grey",
            linewidth=0.8,
        )
        axes.set(xscale="log", yscale="log", title=result["sequence"])
        axes.set_xticks([5, 10, 20, 50, 100, 200], labels=["5", "10", "20", "50", "100", "200"])
        axes.xaxis.set_minor_formatter("")
        axes.yaxis.set_minor_formatter("")
        axes.grid(alpha=0.3)
    for axes in panels.flat[len(results) :]:
        axes.set_visible(False)
    systems = (
        " (triangles: whole process)"
        if any("runs" in d for one in results for d in one["runs"])
        else ""
    )
    drawing.supxlabel(f"ms per frame: median, line to 95 %{systems}", fontsize="medium")
    drawing.supylabel("ATE RMSE [mm]", fontsize="medium")
    drawing.legend(shown.values(), shown.keys(), loc="outside right upper", fontsize=8)
    return drawing
