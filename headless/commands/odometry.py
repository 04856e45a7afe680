"""`iclnuim odometry`: estimates camera motion from the images of a sequence, with one odometer or
all of them.
"""

from argparse import ArgumentParser, Namespace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.benchmark.odometry.protocol import reads_depth_alone
from iclnuim.benchmark.odometry.references import MODELS, REFERENCES
from iclnuim.benchmark.odometry.registry import ODOMETERS, names, odometer
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import check_file

from ..method_options import COLUMNS, installed, open_sequence, require
from ..options import FRAMES, add_frames, add_plot, add_rerun, checked_rerun, common
from ..planned_work import TRACK_CORE_S, PlannedWork, announce
from ..sequence_input import add_camera_options, note_depth_lag

if TYPE_CHECKING:
    from iclnuim.benchmark.odometry.run import OdometryRun


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    methods = f"one of {', '.join(names())} (docs/guide/odometry.md)"
    add("method", nargs="?", metavar="METHOD", help=methods)
    add("folder", type=Path, metavar="DIR", help="a sequence in any supported format")
    help = "write a TUM trajectory; with --all a folder, METHOD.txt for each"
    add("-o", "--out", type=Path, metavar="EST", help=help)
    add("--preset", default="best", help="best (default) or paper")
    kinds = f"default (that of the method), {', '.join([*REFERENCES, *MODELS])}"
    help = f"what a frame is aligned against: {kinds}"
    add("--reference", default="default", metavar="KIND", help=help)
    help = "hold (default), constant-velocity or restart"
    add("--lost", default="hold", metavar="POLICY", help=help)
    help = "offset of the sensor's inverse depth in 1/m, which is subtracted; default: 0"
    add("--depth-offset", type=float, default=0.0, metavar="B", help=help)
    add_frames(parser, FRAMES)
    add(
        "--all",
        action="store_true",
        help=f"run {', '.join(ODOMETERS)} on the same frames and print a table. {COLUMNS}",
    )
    add_plot(parser, "trajectory, residual and uncertainty; with --all all methods in one figure")
    add("--show", action="store_true", help="show the same figure in a window")
    add_rerun(parser, "truth, estimates, errors, residuals and flags")
    add_camera_options(parser)
    common(parser, "iclnuim odometry dvo out/living_room/kt2/clean -o est.txt")


def run(args: Namespace, console: Console) -> None:
    """Exit code 0 even if frames were lost: notes name them, and the trajectory leaves them out."""
    if not args.method and not args.all and not args.folder.exists():
        expected = "a METHOD and a folder with a sequence, or --all and a folder"
        raise InputError(expected, found=args.folder)
    if bool(args.method) == args.all:
        raise InputError("a METHOD, or --all without one", found=args.method or "neither")
    require(console, "odometry", "numba", "cv2")
    from iclnuim.benchmark.fusion.reference import make_reference
    from iclnuim.benchmark.odometry.run import odometry_table, run_odometers

    recording = checked_rerun(args)
    if args.out:
        check_file(args.out / "x.txt" if args.all and args.out.exists() else args.out)
    names = [args.method]
    if args.all:
        names = installed(list(ODOMETERS), args.preset, console)
    odometers = [odometer(name, args.preset) for name in names]
    sequence = open_sequence(args, console, args.folder, args.depth_offset, frames=args.frames)
    of_both = [one.name for one in odometers if not reads_depth_alone(one)]
    note_depth_lag(sequence.pairs, of_both, console)
    seconds = len(sequence) * len(odometers) * TRACK_CORE_S
    work = PlannedWork(f"{len(sequence)} frames, {len(odometers)} odometers", seconds)
    announce(work, args, console)
    against = partial(make_reference, args.reference, preset=args.preset)
    runs = run_odometers(odometers, sequence, args.lost, console.progress, against=against)
    for done in runs:
        for line in done.losses():
            console.note(f"{done.name}: {line}")
    _note_separate_truth(runs[0], console)
    figures = [done.to_dict() for done in runs]
    try:  # files first: standard output may be closed
        if recording:
            from iclnuim.benchmark.odometry.recording import record_runs

            record_runs(recording, args.folder, runs, sequence.camera.pinhole)
            console.note(f"{recording} written")
        if args.out or args.plot or args.show:
            _write_and_draw(runs, args, console)
    finally:
        console.result({"runs": figures}, odometry_table(figures))


def _note_separate_truth(run: "OdometryRun", console: Console) -> None:
    """Print a note if the ground truth and the frames do not overlap in time, so that no error can
    be computed.
    """
    if run.truth is None or not run.frames:
        return
    first, last = run.truth.stamps_s[[0, -1]]
    begin, end = run.frames[0].stamp_s, run.frames[-1].stamp_s
    if first > end or last < begin:
        spans = f"poses at {first:.3f}..{last:.3f} s, images at {begin:.3f}..{end:.3f} s"
        console.note(f"no error is computed, as no image has a ground-truth pose: {spans}")


def _write_and_draw(runs: "list[OdometryRun]", args: Namespace, console: Console) -> None:
    """Write and draw the runs that have a trajectory. Raises WorkError if none has one."""
    found = []
    for done in runs:
        try:
            assert done.trajectory
            found.append(done)
        except WorkError as error:
            if done is runs[-1] and not found:
                raise
            console.note(str(error))
    for done in found if args.out else ():
        path = args.out / f"{done.name}.txt" if args.all else args.out
        path.parent.mkdir(exist_ok=True)
        done.write(path)
        console.note(f"{path} written")
    if args.plot or args.show:
        from iclnuim.benchmark.odometry import drawing
        from iclnuim.report import charts

        if args.plot:
            charts.save(drawing.figure(found), args.plot)
            console.note(f"{args.plot} written")
        if args.show:
            drawing.show(found)
