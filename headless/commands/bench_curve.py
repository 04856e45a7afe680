"""`iclnuim bench curve`: speed against accuracy as one setting changes in steps."""

import os
from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iclnuim.benchmark.odometry.registry import names
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.sequences.recipe import sequence_name

from ..isolation import isolated_model
from ..method_options import installed, open_sequence, require
from ..options import Actions, action, add_span, count, numbers
from ..planned_work import TRACK_CORE_S, PlannedWork, add_dry_run, announce
from ..sequence_input import add_camera_options

if TYPE_CHECKING:
    from iclnuim.benchmark.experiments.inputs import Input
    from iclnuim.benchmark.experiments.recipes.curve.recipe import CurveRecipe
    from iclnuim.benchmark.perturbations.segment import Segment

_OUT = "folder of the measured steps, by which the command resumes; default: out/curves"
_SEED = 1
_FRAMES = 120
_LARGEST_STEP = 1e6
#: Former curves -> what shows the same.
_ELSEWHERE = {
    "keyframe": "iclnuim odometry --reference keyframe",
    "rate": "iclnuim stress --only speed, and --only motion_blur",
    "realtime": "another curve, whose ms say which frame rate a method keeps up with",
}


def configure(actions: Actions) -> None:
    help = (
        "speed against accuracy of odometers as one setting changes in steps, all steps on the "
        "same frames"
    )
    example = (
        "iclnuim bench curve iterations out/living_room/kt2/clean --method icp --method rgbd "
        "--plot iterations.png"
    )
    curve = action(actions, "curve", help, example, _curve)
    add = curve.add_argument
    add(
        "curve",
        metavar="CURVE",
        help="levels, iterations, pixels, resolution or voxel",
    )
    add("folders", type=Path, nargs="+", metavar="DIR", help="sequences with ground truth")
    add_camera_options(curve)
    help = (
        "an odometer; may be given several times; default: icp and rgbd; all: every one that is "
        "installed"
    )
    add("--method", action="append", metavar="NAME", help=help)
    help = "for the curve voxel: a room or a mesh file; default: living_room"
    add("--model", default="living_room", metavar="MODEL", help=help)
    add(
        "--values",
        type=numbers,
        metavar="V,V",
        help="values of the setting; default: those of the curve",
    )
    help = "these frames (B excluded); default: :120, or all if there are fewer"
    add_span(curve, help, 0, None)
    help = "threads of OpenCV and Open3D; our odometers always use one; default: 1"
    add("--threads", type=count, default=1, metavar="N", help=help)
    add("-o", "--out", type=Path, default=Path("out/curves"), metavar="OUT", help=_OUT)
    add("--plot", type=Path, metavar="FILE", help="draw time against error (.png, .pdf, .svg)")
    add_dry_run(curve)


def _curve(args: Namespace, console: Console) -> None:
    require(console, "bench curve", "numba", "cv2")
    os.environ.setdefault("OMP_NUM_THREADS", str(args.threads))  # of Open3D, before it is loaded
    import cv2
    from iclnuim.benchmark.experiments.recipes.curve.recipe import KIND
    from iclnuim.benchmark.experiments.store import Store

    curve = _experiment(args, console)
    cv2.setNumThreads(args.threads)
    store = Store(args.out / curve.name, KIND)
    frames = sum(job.steps for job in curve.jobs(store))
    what = f"{len(curve.steps)} steps of {curve.name}, {frames} frames"
    if announce(PlannedWork(what, frames * len(curve.steps) * TRACK_CORE_S), args, console):
        return
    curve.run(store, console)
    points = curve.points(store)
    if args.plot:
        from iclnuim.report import charts

        charts.save(curve.figure(points), args.plot)
    console.note(f"{curve.page(points).write(store.out / 'curve.html')} written")
    rows: list[dict[str, Any]] = []
    for sequence, found in points.items():
        rows += [{"sequence": sequence, **asdict(point)} for point in found]
    recipe = {
        "start": args.start,
        "frames": {name: len(segment.numbers) for name, segment in curve.segments.items()},
        "threads": args.threads,
        "seed": _SEED,
    }
    text = "\n\n".join(curve.table(*one).text() for one in points.items())
    console.result({"recipe": recipe, "points": rows}, text)


def _experiment(args: Namespace, console: Console) -> "CurveRecipe":
    """The curve that the options describe."""
    from iclnuim.benchmark.experiments.recipes.curve import curves
    from iclnuim.benchmark.experiments.recipes.curve import recipe as curve

    known = (*curves.CURVES, curve.FUSION)
    if args.curve not in known:
        hint = _ELSEWHERE.get(args.curve, "")
        raise InputError(f"a curve ({', '.join(known)})", found=args.curve, hint=hint)
    _check_values(args.curve, args.values or ())
    inputs = _inputs(args, console)
    segments = {name: _segment(args, one) for name, one in inputs.items()}
    settings: dict[str, Any] = {"threads": args.threads, "seed": _SEED}
    if args.curve == curve.FUSION:
        require(console, "bench curve voxel", "igl")
        from iclnuim.benchmark.fusion.surface_error import TrueSurface

        model = isolated_model(args.model)
        surface = TrueSurface(model.points, model.triangles)
        steps: list[curves.Step] = [("fusion", value) for value in args.values or curves.VOXELS_M]
        settings["model"] = curve.surface_sha256(surface)
        return curve.FusionCurve(args.curve, inputs, segments, steps, settings, surface)
    methods = args.method or ["icp", "rgbd"]
    if "all" in methods:
        methods = installed(names(), "best", console)
    values = args.values or curves.CURVES[args.curve].values
    steps = curves.steps_of(args.curve, methods, values)
    return curve.CurveRecipe(args.curve, inputs, segments, steps, settings)


def _inputs(args: Namespace, console: Console) -> "dict[str, Input]":
    from iclnuim.benchmark.experiments.inputs import Input

    if args.start < 0:
        raise InputError("a first frame of 0 or more", setting="--start", found=args.start)
    found = {}
    for folder in args.folders:
        name = sequence_name(folder)
        found[name] = Input.of(open_sequence(args, console, folder), name)
    if len(found) < len(args.folders):
        raise InputError("sequences with different names", found=", ".join(map(str, args.folders)))
    return found


def _segment(args: Namespace, one: "Input") -> "Segment":
    """The chosen frames. Raises InputError if there are fewer."""
    from iclnuim.benchmark.perturbations.segment import Segment

    total = len(one.sequence.pairs)
    left = total - args.start
    if left < (args.first or 3):
        expected = f"at least {args.start + (args.first or 3)} frames"
        hint = "another {frames}"
        raise InputError(expected, path=one.sequence.folder, found=total, hint=hint)
    frames = args.first or min(_FRAMES, left)
    return Segment.of(one.sequence, one.truth, args.start, frames, seed=_SEED)


def _check_values(curve: str, values: tuple[float, ...]) -> None:
    """Raises InputError unless all steps are positive numbers, or numbers of levels."""
    for value in values:
        if curve == "levels" and not (value >= 0 and value.is_integer()):
            raise InputError("whole numbers of levels", setting="--values", found=f"{value:g}")
        if curve != "levels" and not 0 < value <= _LARGEST_STEP:
            raise InputError(
                f"numbers above 0, at most {_LARGEST_STEP:g}",
                setting="--values",
                found=f"{value:g}",
            )
