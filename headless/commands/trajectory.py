"""`iclnuim trajectory`: info, convert, plot, make, camera, adopt, resample. Each says which frame it comes from and goes to."""

import argparse
import os
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim.blender import output
from iclnuim.errors import InputError, blender_missing
from iclnuim.formats import trajectories as files
from iclnuim.geometry import trajectory as trajectories
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

from ..console import Console
from ..isolation import survived
from ..options import SCENE_KINDS, Actions, action, add_scene_options, reading_from, renamed, subcommands
from . import trajectory_make

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_FILE = "a trajectory file or a folder of POV-Ray camera files"


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser)
    _configure_info(actions)
    _configure_convert(actions)
    _configure_plot(actions)
    _configure_adopt(actions)
    _configure_resample(actions)
    trajectory_make.configure(actions)
    _configure_camera(actions)


def _configure_info(actions: Actions) -> None:
    text = "frames, length, duration, speeds, rotation rates, gaps, and how each file was taken"
    parser = action(actions, "info", text, "iclnuim trajectory info trajectories/living_room/kt2.txt", run_info)
    parser.add_argument("files", nargs="+", metavar="FILE", help=_FILE)
    _reading(parser)


def run_info(args: argparse.Namespace, console: Console) -> None:
    found = []
    for file in args.files:
        loaded = _loaded(args, file)
        statistics = trajectories.statistics(loaded.trajectory)
        found.append({"file": os.fspath(file), "taken": asdict(loaded.read_as), **asdict(statistics)})
    console.result({"trajectories": found}, "\n\n".join(_info_text(one) for one in found))


def _info_text(one: dict) -> str:
    gaps = f"{one['gaps']}, the longest step is {one['longest_gap_s']:.3f} s" if one["gaps"] else "none"
    return f"""{one["file"]}
  taken as  {one["taken"]["sentence"]}
  frames    {one["frames"]} at {one["rate_hz"]:.6g} Hz
  length    {one["length_m"]:.3f} m
  duration  {one["duration_s"]:.3f} s
  speed     {one["mean_speed"]:.3f} m/s on average, {one["max_speed"]:.3f} at most
  rotation  {one["mean_rotation_rate"]:.2f} degrees/s on average, {one["max_rotation_rate"]:.2f} at most
  gaps      {gaps}"""


def _configure_convert(actions: Actions) -> None:
    text, example = "turn a trajectory file into another format", "iclnuim trajectory convert traj0.gt.freiburg kt0.txt"
    parser = action(actions, "convert", text, example, run_convert, json=False)
    add = parser.add_argument
    add("source", metavar="IN", help=_FILE)
    add("out", metavar="OUT", help="its name decides the format: .tum .txt .csv .kitti .gt.freiburg .gt.sim")
    add("--restamp", action="store_true", help="stamps i / FILE_RATE from 0 on instead of the file's own")
    _reading(parser)
    _writing(parser)


def run_convert(args: argparse.Namespace, console: Console) -> None:
    _refuse_to_overwrite(args)
    trajectory = _read(args, args.source, console)
    if args.restamp:
        trajectory = Trajectory.at_rate(trajectory.T_world_camera, args.file_rate)
    _write(args, trajectory, console)


def _configure_plot(actions: Actions) -> None:
    text = "top view and time plots of position, speed and rotation rate"
    example = "iclnuim trajectory plot kt0.txt kt2.txt -o trajectories.png"
    parser = action(actions, "plot", text, example, run_plot, json=False)
    parser.add_argument("files", nargs="+", metavar="FILE", help="trajectory files")
    picture = "the picture (.png, .pdf or .svg), overwritten"
    parser.add_argument("-o", "--out", required=True, metavar="PNG", help=picture)
    _reading(parser)


def run_plot(args: argparse.Namespace, console: Console) -> None:
    loaded = [(file, _loaded(args, file)) for file in args.files]
    for file, one in loaded:
        console.note(f"{file}: {one.read_as.sentence}")
    from iclnuim.report import charts as plots  # Matplotlib takes half a second to import

    plots.save(plots.trajectories_figure([(os.path.basename(file), one) for file, one in loaded]), args.out)
    console.note(f"{args.out}: {len(loaded)} drawn; gt.freiburg and gt.sim turned z up")


def _configure_adopt(actions: Actions) -> None:
    text = "put any trajectory into a scene: a start pose and a uniform scale (equation 2 of the paper)"
    example = "iclnuim trajectory adopt odometer.txt --start -1.4,-1.4,1.5,0,0.707,0.707,0 --scale 0.8 -o kt9.txt"
    parser = action(actions, "adopt", text, example, run_adopt, json=False)
    # a start pose may begin with a minus; argparse would take it for an option
    parser._negative_number_matcher = re.compile(r"^-[\d.]")
    parser.add_argument("source", metavar="SOURCE", help="a trajectory file")
    pose = "camera to world, 'x,y,z,qx,qy,qz,qw', or a trajectory file whose first pose is taken"
    parser.add_argument("--start", required=True, metavar="POSE", help=pose)
    parser.add_argument("--scale", type=float, default=1.0, metavar="S", help="of the source's path (default 1)")
    _reading(parser)
    _writing(parser, out=True)


def run_adopt(args: argparse.Namespace, console: Console) -> None:
    _refuse_to_overwrite(args)
    source = _read(args, args.source, console)
    T_world_start, frame = _start_pose(args)
    adopted = trajectories.adopt(source, T_world_start, args.scale)
    console.note(f"adopted: first pose put on the start pose in {frame}, path scaled by {args.scale:g}")
    _write(args, adopted, console)


def _start_pose(args: argparse.Namespace) -> tuple[SE3, str]:
    """The pose that --start gives, and the name of its world."""
    if os.path.exists(args.start):
        loaded = files.read_trajectory(args.start)
        return loaded.trajectory.T_world_camera[0], loaded.read_as.frame
    try:
        numbers = np.array([float(part) for part in args.start.split(",")])
    except ValueError:
        numbers = np.array([])
    if numbers.shape != (7,) or not np.isfinite(numbers).all():
        raise InputError("--start x,y,z,qx,qy,qz,qw or a trajectory file", found=args.start)
    try:
        return SE3.from_quat_xyzw(numbers[3:], numbers[:3]), "the world it was given in"
    except InputError as error:
        raise InputError(f"{error.expected} in --start", found=error.found) from None


def _configure_resample(actions: Actions) -> None:
    text = "the same motion at another frame rate, by interpolation on SE(3)"
    example = "iclnuim trajectory resample kt2.txt --rate 120 -o kt2_120hz.txt"
    parser = action(actions, "resample", text, example, run_resample, json=False)
    parser.add_argument("source", metavar="SOURCE", help="a trajectory file")
    parser.add_argument("--rate", required=True, type=float, metavar="HZ", help="15 to 240")
    _reading(parser)
    _writing(parser, out=True)


def run_resample(args: argparse.Namespace, console: Console) -> None:
    _refuse_to_overwrite(args)
    source = _read(args, args.source, console)
    resampled = trajectories.resample(source, args.rate)
    console.note(f"resampled: {len(source)} poses to {len(resampled)} at {args.rate:g} Hz")
    args.file_rate = args.rate
    _write(args, resampled, console)


def _configure_camera(actions: Actions) -> None:
    text = "the animation of a scene's camera as a TUM trajectory"
    parser = action(actions, "camera", text, "iclnuim trajectory camera room.blend -o film.txt", run_camera)
    parser.add_argument("scene", metavar="SCENE", help=f"a file: {SCENE_KINDS}")
    parser.add_argument("-o", "--out", type=Path, metavar="OUT", help="default: the scene's name with .txt, here")
    parser.add_argument("--camera-object", metavar="NAME", help="another camera than the active one")
    renamed(parser, "--camera", "--camera-object")
    parser.add_argument("--force", action="store_true", help="overwrite OUT")
    add_scene_options(parser)


def run_camera(args: argparse.Namespace, console: Console) -> None:
    """Write the poses, one for each frame of the scene's timeline."""
    args.out = args.out or Path(f"{Path(args.scene).stem}.txt")
    _refuse_existing(args.out, args.force)
    survived(lambda: _save_camera(args, console), args.scene)


def _save_camera(args: argparse.Namespace, console: Console) -> int:
    with output.blender_output_in(Path(os.devnull)):
        try:
            import bpy
            from iclnuim.blender import camera as cameras
            from iclnuim.blender import scene
        except ImportError as error:
            raise blender_missing("trajectory camera", error) from None
        scene.open_scene(str(Path(args.scene).resolve()), reading_from(args))
        camera = cameras.active(bpy.context.scene, args.camera_object)
        animated = cameras.trajectory(bpy.context.scene, camera if args.camera_object else None)
        lens = cameras.pinhole(bpy.context.scene, camera)
    files.write_trajectory(args.out, animated, "tum")
    figures = asdict(trajectories.statistics(animated)) if len(animated) > 1 else {"frames": len(animated)}
    option = lens and f"{lens.width}x{lens.height},{lens.fx:.6g},{lens.fy:.6g},{lens.cx:.6g},{lens.cy:.6g}"
    text = f"{args.out}: {len(animated)} poses of the camera {camera.name}"
    text += f"; its lens: --camera {option}" if option else ""
    console.result({"file": str(args.out), "camera": camera.name, "pinhole": option, **figures}, text)
    return 0


def _reading(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    names = f"instead of recognising it by name and content: {', '.join(files.FORMATS)}"
    add("--from", dest="source_format", metavar="FORMAT", help=names)
    unit = "of the input: m (default), cm, mm or metres as a number"
    add("--unit", type=_unit, default=1.0, metavar="UNIT", help=unit)
    add("--file-rate", type=float, default=30.0, metavar="HZ", help="of a file that numbers its frames (default 30)")
    renamed(parser, "--fps", "--file-rate", type=float)


def _writing(parser: argparse.ArgumentParser, out: bool = False) -> None:
    add = parser.add_argument
    if out:
        add("-o", "--out", metavar="OUT", help="default: TUM on standard output")
    names = ", ".join(name for name, known in files.FORMATS.items() if known.line)
    add("--to", dest="out_format", metavar="FORMAT", help=f"instead of the one that OUT's name means: {names}")
    add("--out-unit", type=_unit, default=1.0, metavar="UNIT", help="of the output (default m)")
    add("--start-z", type=float, default=-2.25, metavar="Z", help="start of gt.freiburg and gt.sim (office -2.5)")
    add("--force", action="store_true", help="overwrite OUT")


def _unit(text: str) -> float:
    """A unit of length in metres."""
    try:
        return UNITS_M[text] if text in UNITS_M else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected m, cm, mm or metres as a number, found {text!r}") from None


def _loaded(args: argparse.Namespace, file: str) -> files.LoadedTrajectory:
    return files.read_trajectory(file, args.source_format, rate_hz=args.file_rate, unit_m=args.unit)


def _read(args: argparse.Namespace, file: str, console: Console) -> Trajectory:
    loaded = _loaded(args, file)
    console.note(f"{file}: {loaded.read_as.sentence}")
    return loaded.trajectory


def _refuse_to_overwrite(args: argparse.Namespace) -> None:
    """Also finds out the output's format, so that nothing is read for nothing."""
    args.out_format = args.out_format or (files.format_for_name(args.out) if args.out else "tum")
    if args.out:
        _refuse_existing(args.out, args.force)


def _refuse_existing(out: str | os.PathLike[str], force: bool) -> None:
    if os.path.lexists(out) and not force:
        raise InputError("a name that is free", path=out, found="an existing file", hint="--force to overwrite it")


def _write(args: argparse.Namespace, trajectory: Trajectory, console: Console) -> None:
    options = files.FileOptions(args.file_rate, args.out_unit, args.start_z)
    if args.out is None:
        console.result({}, files.trajectory_text(trajectory, args.out_format, options).rstrip("\n"))
        return
    files.write_trajectory(args.out, trajectory, args.out_format, options)
    console.note(f"{args.out}: {files.FORMATS[args.out_format].goes_to}")
