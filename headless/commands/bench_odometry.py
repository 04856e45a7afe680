"""`iclnuim bench odometry`: our odometers and third-party ones on the same frames, speed against error."""

import argparse
from pathlib import Path

from iclnuim.errors import InputError, WorkError
from iclnuim.odometry.registry import NAMES, odometer

from ..console import Console
from ..options import Actions, action, count, renamed
from ..sequence_options import add_camera_options, current_word, open_sequence, require
from .odometry import RENAMED_METHODS


def configure(actions: Actions) -> None:
    example = "iclnuim bench odometry out/living_room/kt2/clean out/living_room/kt2/noisy --plot odometry.png"
    help = "speed and error of our odometers and third-party ones in one run"
    parser = action(actions, "odometry", help, example, _run)
    what = "sequences with ground truth, or results of --json from before"
    parser.add_argument("folders", type=Path, nargs="+", metavar="DIR", help=what)
    add_camera_options(parser)
    parser.add_argument("--preset", default="best", help="of ours: best (default) or paper")
    parser.add_argument("--first", type=count, metavar="N", help="only the first N frames")
    parser.add_argument("--only", metavar="TEXT", help="only odometers whose name holds this, such as `icp`")
    help = "time against error as a picture (.png, .pdf, .svg)"
    parser.add_argument("--plot", type=Path, metavar="FILE", help=help)
    renamed(parser, "--chart", "--plot", type=Path)


def _run(args: argparse.Namespace, console: Console) -> int:
    from ..benchmark import odometry_comparison as comparison

    only = current_word(args.only or "", RENAMED_METHODS, console)
    which = [name for name in NAMES if only in name]
    if not which:
        raise InputError(f"part of a name of {', '.join(NAMES)}", found=args.only)
    results = [result for folder in args.folders if folder.suffix == ".json" for result in comparison.read(folder)]
    folders = [folder for folder in args.folders if folder.suffix != ".json"]
    if folders:
        require("bench odometry", "numba", "cv2")
        which = _installed(which, args.preset, console)
    sequences = [open_sequence(args, console, folder) for folder in folders]
    results += [comparison.compare(s, which, args.preset, args.first, console.progress) for s in sequences]
    if args.plot:
        from iclnuim.report import charts

        from ..benchmark import odometry_chart

        charts.save(odometry_chart.figure(results), args.plot)
    console.result({"races": results}, "\n\n".join(comparison.text(result) for result in results))
    return 0


def _installed(names: list[str], preset: str, console: Console) -> list[str]:
    """Those whose packages are there; the others' rows are left out, with a note. Raises WorkError where none is left."""
    found = []
    for name in names:
        try:
            odometer(name, preset)
            found.append(name)
        except WorkError as error:
            if name == names[-1] and not found:
                raise
            console.note(f"left out: {error}")
    return found
