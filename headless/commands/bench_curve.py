"""`iclnuim bench curve`: speed against accuracy as one setting changes in steps."""

import argparse
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iclnuim.benchmark.odometry.registry import names
from iclnuim.console import Console
from iclnuim.dataset.frames import read_truth, sequence_name
from iclnuim.errors import InputError
from iclnuim.shipped import source_commit
from iclnuim.version import __version__

from ..method_options import installed, open_sequence, require
from ..options import Actions, action, count, numbers
from ..sequence_options import add_camera_options

if TYPE_CHECKING:
    from iclnuim.benchmark.perturbations.segment import Segment
    from matplotlib.figure import Figure

#: Points for --json, text, and a function that draws the chart.
Curve = tuple[list[dict[str, Any]], str, Callable[[], "Figure"]]
_SEED, _FRAMES = 1, 120
#: Largest step of a curve; at a higher rate, frames in between would fill the memory.
_LARGEST_STEP, _LARGEST = 1e6, {"rate": 1000.0}


def configure(actions: Actions) -> None:
    help = "speed against accuracy of odometers as one setting changes in steps, all steps on the same frames"
    example = "iclnuim bench curve iterations out/living_room/kt2/clean --method icp --method rgbd --plot iterations.png"
    curve = action(actions, "curve", help, example, _curve)
    add = curve.add_argument
    add(
        "curve",
        metavar="CURVE",
        help="levels, iterations, pixels, keyframe, resolution, realtime, rate or voxel",
    )
    add("folders", type=Path, nargs="+", metavar="DIR", help="sequences with ground truth")
    add_camera_options(curve)
    help = "an odometer; may be given several times; default: icp and rgbd; all: every one that is installed"
    add("--method", action="append", metavar="NAME", help=help)
    help = "for the curve voxel: a room or a mesh file; default: living_room"
    add("--model", default="living_room", metavar="MODEL", help=help)
    add(
        "--values",
        type=numbers,
        metavar="V,V",
        help="values of the setting; default: those of the curve",
    )
    add("--start", type=int, default=0, metavar="N", help="the first frame; default: 0")
    add(
        "--first",
        type=count,
        metavar="N",
        help="number of frames from there; default: 120, or all if there are fewer",
    )
    help = "threads of OpenCV and Open3D; our odometers always use one; default: 1"
    add("--threads", type=count, default=1, metavar="N", help=help)
    add("--plot", type=Path, metavar="FILE", help="draw time against error (.png, .pdf, .svg)")


def _curve(args: argparse.Namespace, console: Console) -> None:
    require("bench curve", "numba", "cv2")
    os.environ.setdefault("OMP_NUM_THREADS", str(args.threads))  # of Open3D, before it is loaded
    import cv2
    from iclnuim.benchmark.experiments import curves
    from iclnuim.benchmark.perturbations.segment import Segment

    names = (*curves.CURVES, "voxel")
    if args.curve not in names:
        raise InputError(f"a curve ({', '.join(names)})", found=args.curve)
    _check_values(args.curve, args.values or ())
    segments = {}
    for folder in args.folders:
        sequence, truth = open_sequence(args, console, folder), read_truth(folder)
        if truth is None:
            raise InputError("a ground truth in the folder", path=folder)
        left = len(sequence.pairs) - args.start
        if args.start < 0:
            raise InputError("a first frame of 0 or more", setting="--start", found=args.start)
        if left < (args.first or 3):
            expected = f"at least {args.start + (args.first or 3)} frames"
            raise InputError(
                expected, path=folder, found=len(sequence.pairs), hint="another --start or --first"
            )
        frames = args.first or min(_FRAMES, left)
        segments[sequence_name(folder)] = Segment.of(
            sequence, truth, args.start, frames, seed=_SEED
        )
    if len(segments) < len(args.folders):
        raise InputError("sequences with different names", found=", ".join(map(str, args.folders)))
    cv2.setNumThreads(args.threads)
    measure = _fusion_curve if args.curve == "voxel" else _odometer_curve
    points, text, drawn = measure(args, console, segments)
    if args.plot:
        from iclnuim.report import charts

        charts.save(drawn(), args.plot)
    recipe = {
        "folders": [str(folder) for folder in args.folders],
        "start": args.start,
        "frames": {name: len(segment.numbers) for name, segment in segments.items()},
        "threads": args.threads,
        "seed": _SEED,
        "iclnuim": __version__,
        "source_commit": source_commit(),
    }
    console.result({"recipe": recipe, "points": points}, text)


def _check_values(curve: str, values: tuple[float, ...]) -> None:
    """Raises InputError unless all steps are positive numbers, or numbers of levels, within the
    limit of the curve.
    """
    most = _LARGEST.get(curve, _LARGEST_STEP)
    for value in values:
        if curve == "levels" and not (value >= 0 and value.is_integer()):
            raise InputError("whole numbers of levels", setting="--values", found=f"{value:g}")
        if curve != "levels" and not 0 < value <= most:
            raise InputError(
                f"numbers above 0, at most {most:g}", setting="--values", found=f"{value:g}"
            )


def _odometer_curve(
    args: argparse.Namespace, console: Console, segments: "dict[str, Segment]"
) -> "Curve":
    from iclnuim.benchmark.experiments import curves

    methods = args.method or ["icp", "rgbd"]
    if "all" in methods:
        methods = installed(names(), "best", console)
    values, results = args.values or curves.CURVES[args.curve][0], {}
    total = sum(curves.length(args.curve, values, segment) for segment in segments.values())
    progress = console.progress(total, f"bench curve {args.curve}")
    for name, segment in segments.items():
        results[name] = curves.measure(args.curve, methods, values, segment, progress.advance)

    def drawn() -> "Figure":
        from iclnuim.benchmark.experiments import curve_chart

        return curve_chart.figure(args.curve, results)

    return *_listed(results, curves.table), drawn


def _fusion_curve(
    args: argparse.Namespace, console: Console, segments: "dict[str, Segment]"
) -> "Curve":
    from iclnuim.benchmark.experiments import fusion_curve
    from iclnuim.benchmark.fusion.surface_error import TrueSurface, read_model

    require("bench curve voxel", "igl")
    surface = TrueSurface(*read_model(args.model))
    progress = console.progress(sum(len(s.numbers) for s in segments.values()), "bench curve voxel")
    values = args.values or fusion_curve.VALUES
    results = {
        name: fusion_curve.measure(values, s, surface, progress.advance)
        for name, s in segments.items()
    }
    return *_listed(results, fusion_curve.table), partial(fusion_curve.figure, results)


def _listed(results: dict[str, list], table: Callable[[Any], str]) -> tuple[list[dict], str]:
    """The points of all sequences for --json, and their tables."""
    points = [
        {"sequence": name, **point.to_dict()} for name, found in results.items() for point in found
    ]
    return points, "\n\n".join(f"{name}\n{table(found)}" for name, found in results.items())
