"""`iclnuim trajectory`: info, convert, plot, make, imu, camera, adopt, resample.

Each action reports the coordinate frames of its input and output.
"""

import os
from argparse import ArgumentParser, Namespace
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from iclnuim.console import Console
from iclnuim.doubt.no_rotations import turns
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.align import METHODS, AlignmentSettings
from iclnuim.geometry import trajectory as trajectories
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.pose_lines import tied_to_poses
from iclnuim.trajectory_files.trajectories import LoadedTrajectory, write_trajectory

from ..isolation import opened_scene
from ..options import (
    SCENE_KINDS,
    Actions,
    action,
    add_scene_options,
    settings_from,
    subcommands,
    trajectory_file,
)
from . import trajectory_changes, trajectory_imu, trajectory_make
from .trajectory_options import FILE, add_reading, check_out, loaded


def configure(parser: ArgumentParser) -> None:
    actions = subcommands(parser)
    _configure_info(actions)
    trajectory_changes.configure(actions)
    _configure_plot(actions)
    trajectory_make.configure(actions)
    trajectory_imu.configure(actions)
    _configure_camera(actions)


def _configure_info(actions: Actions) -> None:
    help = "frames, length, duration, speeds, rotation rates, gaps, and how each file was read"
    example = "iclnuim trajectory info trajectories/living_room/kt2.txt"
    info = action(actions, "info", help, example, _info)
    info.add_argument("files", nargs="+", type=trajectory_file, metavar="FILE", help=FILE)
    add_reading(info)


def _configure_plot(actions: Actions) -> None:
    help = "top view and time plots of position, speed and rotation rate"
    example = "iclnuim trajectory plot kt0.txt kt2.txt -o trajectories.png"
    plot = action(actions, "plot", help, example, _plot, json=False)
    plot.add_argument("files", nargs="+", type=trajectory_file, metavar="FILE", help=FILE)
    help = "the picture (.png, .pdf or .svg); an existing file is overwritten"
    plot.add_argument("-o", "--out", required=True, metavar="PNG", help=help)
    help = "align the others with the first, as evaluate ate does; default: each in its own world"
    plot.add_argument("--align", choices=METHODS, help=help)
    add_reading(plot)


def _configure_camera(actions: Actions) -> None:
    help = "write the animation of a scene's camera as a TUM trajectory"
    example = "iclnuim trajectory camera room.blend -o film.txt"
    camera = action(actions, "camera", help, example, _camera)
    camera.set_defaults(opens="scene")
    add = camera.add_argument
    add("scene", metavar="SCENE", help=f"a file: {SCENE_KINDS}")
    help = "default: the scene's name with .txt, in the working folder"
    add("-o", "--out", type=Path, metavar="OUT", help=help)
    add("--camera-object", metavar="NAME", help="use this camera instead of the active one")
    add("--force", action="store_true", help="overwrite OUT")
    add_scene_options(camera)


def _info(args: Namespace, console: Console) -> None:
    found = []
    for file in args.files:
        one = loaded(args, file, positions_suffice=True)
        figures = asdict(trajectories.trajectory_statistics(one.trajectory))
        found.append({"file": os.fspath(file), "read_as": asdict(one.read_as), **figures})
        if one.read_as.has_rotations and len(one.trajectory) > 1 and not turns(one.trajectory):
            same = "all rotations are the same, as in files of positions alone"
            console.note(f"warning: {file}: {same}")
    console.result({"trajectories": found}, "\n\n".join(map(_info_text, found)))


def _info_text(one: dict[str, Any]) -> str:
    gaps = "none"
    if one["gaps"]:
        gaps = f"{one['gaps']}, the longest step is {one['longest_gap_s']:.3f} s"
    rotation = "none: positions alone"
    if one["read_as"]["has_rotations"]:
        rotation = f"{one['mean_rotation_rate']:.2f} degrees/s on average"
        rotation += f", {one['max_rotation_rate']:.2f} at most"
    return f"""{one["file"]}
  read as   {one["read_as"]["sentence"]}
  frames    {one["frames"]} at {one["rate_hz"]:.6g} Hz
  length    {one["length_m"]:.3f} m
  duration  {one["duration_s"]:.3f} s
  speed     {one["mean_speed"]:.3f} m/s on average, {one["max_speed"]:.3f} at most
  rotation  {rotation}
  gaps      {gaps}"""


def _plot(args: Namespace, console: Console) -> None:
    read = [(file, loaded(args, file)) for file in args.files]
    for file, one in read:
        console.note(f"{file}: {one.read_as.sentence}")
    from iclnuim.report import charts  # Matplotlib takes half a second to import

    if args.align:
        read = [read[0], *((file, _aligned(read[0][1], one, args.align)) for file, one in read[1:])]
    named = [(os.path.basename(file), one) for file, one in read]
    charts.save(charts.trajectories_figure(named), args.out)
    count = "1 trajectory" if len(read) == 1 else f"{len(read)} trajectories"
    console.note(f"{args.out}: {count} drawn; gt.freiburg and gt.sim are rotated z up")


def _aligned(reference: LoadedTrajectory, one: LoadedTrajectory, method: str) -> LoadedTrajectory:
    """The trajectory in the world of the reference, by the alignment of its ATE."""
    settings = AbsoluteErrorSettings(alignment=AlignmentSettings(method))
    tied, estimate = tied_to_poses(reference, one)
    found = absolute_error(tied.trajectory, estimate.trajectory, settings).alignment
    poses = found.apply(estimate.trajectory.T_world_camera)
    moved = Trajectory(estimate.trajectory.stamps_s, poses)
    return replace(estimate, trajectory=moved, read_as=reference.read_as)


def _camera(args: Namespace, console: Console) -> None:
    """Write one pose for each frame of the scene's timeline."""
    out = args.out or Path(f"{Path(args.scene).stem}.txt")
    check_out(out, args.force)
    reading = settings_from(args, SceneReading())
    scene = str(Path(args.scene).resolve())
    with opened_scene("trajectory camera", scene, reading, writes=[out]):
        import bpy
        from iclnuim.blender.render import camera as cameras
        from iclnuim.blender.render.camera_notes import camera_notes

        scene = bpy.context.scene
        camera = cameras.active(scene, args.camera_object)
        chosen = camera if args.camera_object else None
        animated = cameras.trajectory(scene, chosen)
        lens = cameras.pinhole(scene, camera)
        for note in (cameras.timeline_note(scene), *camera_notes(scene, chosen)):
            if note:
                console.note(f"note: {note}")
    write_trajectory(out, animated, "tum")
    figures: dict[str, Any] = {"frames": len(animated)}
    if len(animated) > 1:
        figures = asdict(trajectories.trajectory_statistics(animated))
    text = f"{out}: {len(animated)} poses of the camera {camera.name}"
    option = None
    if lens:
        intrinsics = f"{lens.fx:.6g},{lens.fy:.6g},{lens.cx:.6g},{lens.cy:.6g}"
        option = f"{lens.width}x{lens.height},{intrinsics}"
        text += f"; its lens: --camera {option}"
    console.result({"file": str(out), "camera": camera.name, "pinhole": option, **figures}, text)
