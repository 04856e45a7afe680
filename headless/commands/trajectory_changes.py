"""The actions of `iclnuim trajectory` that read a trajectory, change it, and write it: convert,
adopt, resample.
"""

import json
import os
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.files import atomic_write_text, is_file, read_text
from iclnuim.geometry import trajectory as trajectories
from iclnuim.geometry.scene_axes import parse_unit
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files import trajectories as files
from iclnuim.trajectory_files.paths import EXACT, CameraPath, exact_path

from ..options import Actions, action, trajectory_file
from .trajectory_options import FILE, add_reading, check_out, loaded

Change = Callable[[Namespace, files.LoadedTrajectory, Console], Trajectory]


def configure(actions: Actions) -> None:
    _configure_convert(actions)
    _configure_adopt(actions)
    _configure_resample(actions)


def _configure_convert(actions: Actions) -> None:
    help = "convert a trajectory file to another format"
    example = "iclnuim trajectory convert traj0.gt.freiburg kt0.txt"
    convert = action(actions, "convert", help, example, partial(_run, _converted), json=False)
    add = convert.add_argument
    add("source", type=trajectory_file, metavar="IN", help=FILE)
    words = ", ".join(writer.word for _, writer in files.FORMATS.values() if writer and writer.word)
    help = (
        "output file; its name decides the format: .tum .txt .csv .kitti .gt.freiburg .gt.sim; "
        f"the words {words} in the name of a .txt file select these formats instead of TUM"
    )
    add("out", metavar="OUT", help=help)
    help = "use the stamps 1 + i / FILE_RATE instead of those of the file"
    add("--restamp", action="store_true", help=help)
    help = (
        "change what `iclnuim evaluate GT IN` finds that explains the error of IN: axes, offset, "
        "scale ..."
    )
    add("--explained", metavar="GT", type=trajectory_file, help=help)
    _add_writing(convert)


def _configure_adopt(actions: Actions) -> None:
    help = (
        "move any trajectory into a scene with a start pose and a uniform scale "
        "(equation 2 of the paper)"
    )
    example = (
        "iclnuim trajectory adopt odometer.txt --start -1.4,-1.4,1.5,0,0.707,0.707,0 "
        "--scale 0.8 -o kt9.txt"
    )
    adopt = action(actions, "adopt", help, example, partial(_run, _adopted), json=False)
    add = adopt.add_argument
    add("source", type=trajectory_file, metavar="SOURCE", help=FILE)
    help = "camera to world, 'x,y,z,qx,qy,qz,qw', or a trajectory file whose first pose is used"
    add("--start", required=True, metavar="POSE", help=help)
    help = "scale of the translations of SOURCE (default 1)"
    add("--scale", type=float, default=1.0, metavar="S", help=help)
    _add_out(adopt)
    _add_writing(adopt)


def _configure_resample(actions: Actions) -> None:
    help = (
        "the same motion at another frame rate: of a file with the recipe of its poses beside it on "
        "the recipe's path, which is kept; of others by interpolation on SE(3)"
    )
    example = "iclnuim trajectory resample kt2.txt --rate 120 -o kt2_120hz.txt"
    resample = action(actions, "resample", help, example, partial(_run, _resampled), json=False)
    resample.add_argument("source", type=trajectory_file, metavar="SOURCE", help=FILE)
    resample.add_argument("--rate", required=True, type=float, metavar="HZ", help="15 to 240")
    _add_out(resample)
    _add_writing(resample)


def _add_out(parser: ArgumentParser) -> None:
    help = "output file; default: TUM on standard output"
    parser.add_argument("-o", "--out", metavar="OUT", help=help)


def _add_writing(parser: ArgumentParser) -> None:
    add_reading(parser)
    add = parser.add_argument
    names = ", ".join(name for name, known in files.FORMATS.items() if known.writer)
    help = f"format of OUT, instead of the one that its name implies: {names}"
    add("--to", dest="out_format", metavar="FORMAT", help=help)
    help = "unit of the output (default m)"
    add("--out-unit", type=parse_unit, default=1.0, metavar="UNIT", help=help)
    help = "z of the start pose in gt.freiburg and gt.sim (default -2.25; office -2.5)"
    add("--start-z", type=float, default=-2.25, metavar="Z", help=help)
    add("--force", action="store_true", help="overwrite OUT")


def _run(change: Change, args: Namespace, console: Console) -> None:
    """Read a trajectory, change it, and write it. OUT is checked first, before anything is read."""
    to = args.out_format or (files.format_for_name(args.out) if args.out else "tum")
    if args.out:
        check_out(args.out, args.force)
    source = loaded(args, args.source)
    console.note(f"{args.source}: {source.read_as.sentence}")
    changed = change(args, source, console)
    options = files.FileOptions(args.file_rate, args.out_unit, args.start_z)
    if args.out is None:
        console.result({}, files.trajectory_text(changed, to, options).rstrip("\n"))
        return
    files.write_trajectory(args.out, changed, to, options)
    writer = files.writer_of(to)
    console.note(f"{args.out}: {writer.goes_to}")
    if not writer.has_stamps and args.file_rate != trajectories.FRAME_RATE_HZ:
        rate = f"{args.file_rate:g}"
        console.note(
            f"note: {args.out} has no stamps; its frames are at {rate} Hz: "
            f"give --file-rate {rate} where it is read"
        )
    if "stamps are not written" in writer.goes_to:
        consequence = (
            "a line's number is no longer that of its frame: "
            "programs that read this file assume one pose per frame"
        )
        _note_gaps(changed, consequence, console)


def _converted(args: Namespace, source: files.LoadedTrajectory, console: Console) -> Trajectory:
    trajectory = _explained(args, source, console) if args.explained else source.trajectory
    if not args.restamp:
        return trajectory
    return Trajectory.at_rate(trajectory.T_world_camera, args.file_rate)


def _explained(args: Namespace, source: files.LoadedTrajectory, console: Console) -> Trajectory:
    """The trajectory with all changes with which it fits the ground truth of --explained."""
    from iclnuim.doubt.explained_error import ExplainedError
    from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings
    from iclnuim.sequences.stored_sequence import StoredSequence

    folder = Path(args.explained)
    truth = StoredSequence(folder).load_truth() if folder.is_dir() else None
    truth = truth or files.read_trajectory(args.explained, positions_suffice=True)
    explained = ExplainedError.of(truth, source, AbsoluteErrorSettings())
    if explained is None:
        expected = f"a trajectory whose error against {args.explained} has an explanation"
        raise InputError(expected, path=args.source, found="none")
    explanation = explained.explanation
    if any(change.of == "reference" for change in explanation.changes):
        hint = f"iclnuim trajectory convert {args.explained} OUT --explained {args.source}"
        found = f"one of {args.explained}: {explained.sentence()}"
        raise InputError("an explanation of its own", path=args.source, found=found, hint=hint)
    console.note(explained.sentence(truth.read_as.format, source.read_as.format))
    return explanation.estimate


def _adopted(args: Namespace, source: files.LoadedTrajectory, console: Console) -> Trajectory:
    T_world_start, frame = _start_pose(args.start.strip())
    adopted = trajectories.adopt(source.trajectory, T_world_start, args.scale)
    scaled = f"translations scaled by {args.scale:g}"
    console.note(f"adopted: the first pose is the start pose in {frame}, {scaled}")
    return adopted


def _resampled(args: Namespace, read: files.LoadedTrajectory, console: Console) -> Trajectory:
    source = read.trajectory
    resampled = trajectories.resample(source, args.rate)
    exact = exact_path(Path(args.source), source)
    if exact is not None:
        poses = exact.motion.states(resampled.stamps_s).T_world_body
        resampled = Trajectory(resampled.stamps_s, poses)
        if args.out is not None:
            _keep_recipe(exact, Path(args.out).with_suffix(".json"))
    how = f", on {EXACT}" if exact else ""
    console.note(f"resampled: {len(source)} poses to {len(resampled)} at {args.rate:g} Hz{how}")
    _note_gaps(source, "poses in it are interpolated as if the motion were uniform", console)
    args.file_rate = args.rate
    return resampled


def _keep_recipe(path: CameraPath, file: Path) -> None:
    """Write the recipe beside the resampled poses, which are on its path too. Raises InputError for
    another file there.
    """
    text = json.dumps(path.recipe, indent=2) + "\n"
    if is_file(file) and read_text(file) != text:
        raise InputError("no other file where the recipe belongs", path=file, found="one")
    atomic_write_text(file, text)


def _note_gaps(trajectory: Trajectory, consequence: str, console: Console) -> None:
    if len(trajectory) < 2:
        return
    found = trajectories.trajectory_statistics(trajectory)
    if found.gaps:
        count = f"{found.gaps} gap{'s' * (found.gaps > 1)}"
        longest = f"the longest of {found.longest_gap_s:.3f} s"
        console.note(f"note: the trajectory has {count}, {longest}; {consequence}")


def _start_pose(text: str) -> tuple[SE3, str]:
    """The pose given by --start, and the name of its world."""
    text = trajectory_file(text)
    if os.path.exists(text):
        first = files.read_trajectory(text)
        return first.trajectory.T_world_camera[0], first.read_as.frame
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.array([])
    if numbers.shape != (7,) or not np.isfinite(numbers).all():
        raise InputError("--start x,y,z,qx,qy,qz,qw or a trajectory file", found=text)
    try:
        return SE3.from_quat_xyzw(numbers[3:], numbers[:3]), "the world of --start"
    except InputError as error:
        raise InputError(f"{error.expected} in --start", found=error.found) from None
