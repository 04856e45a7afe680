"""`iclnuim trajectory camera SCENE`: the animation of a scene's camera as a TUM trajectory."""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path

from iclnuim.blender import output
from iclnuim.errors import InputError, blender_missing
from iclnuim.formats.trajectories import write_trajectory
from iclnuim.geometry import trajectory

from ..console import Console
from ..isolation import survived
from ..options import Actions, action, renamed
from ..scene_options import KINDS, add_scene_options, reading_from


def configure(actions: Actions) -> None:
    """Add the action `camera` below `iclnuim trajectory`."""
    text = "the animation of a scene's camera as a TUM trajectory"
    parser = action(actions, "camera", text, "iclnuim trajectory camera room.blend -o path.txt", run)
    parser.add_argument("scene", metavar="SCENE", help=f"a file: {KINDS}")
    parser.add_argument("-o", "--out", type=Path, metavar="OUT", help="default: the scene's name with .txt, here")
    parser.add_argument("--camera-object", metavar="NAME", help="another camera than the active one")
    renamed(parser, "--camera", "--camera-object")
    parser.add_argument("--force", action="store_true", help="overwrite OUT")
    add_scene_options(parser)


def run(args: argparse.Namespace, console: Console) -> None:
    """Write the poses, one for each frame of the scene's timeline."""
    args.out = args.out or Path(f"{Path(args.scene).stem}.txt")
    if os.path.lexists(args.out) and not args.force:
        raise InputError("a name that is free", path=args.out, found="an existing file", hint="--force to overwrite it")
    survived(lambda: _save(args, console), args.scene)


def _save(args: argparse.Namespace, console: Console) -> int:
    with output.blender_output_in(Path(os.devnull)):
        try:
            import bpy
            from iclnuim.blender import camera as cameras
            from iclnuim.blender import scene
        except ImportError as error:
            raise blender_missing("trajectory camera", error) from None
        scene.open_scene(str(Path(args.scene).resolve()), reading_from(args))
        camera = cameras.active(bpy.context.scene, args.camera_object)
        path = cameras.trajectory(bpy.context.scene, camera if args.camera_object else None)
        lens = cameras.pinhole(bpy.context.scene, camera)
    write_trajectory(args.out, path, "tum")
    figures = asdict(trajectory.statistics(path)) if len(path) > 1 else {"frames": len(path)}
    option = (
        None if lens is None else f"{lens.width}x{lens.height},{lens.fx:.6g},{lens.fy:.6g},{lens.cx:.6g},{lens.cy:.6g}"
    )
    text = f"{args.out}: {len(path)} poses of the camera {camera.name}" + (
        f"; its lens: --camera {option}" if option else ""
    )
    console.result({"file": str(args.out), "camera": camera.name, "pinhole": option, **figures}, text)
    return 0
