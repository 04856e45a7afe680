"""Options that say how a scene file is to be read, shared by all commands that open one."""

from __future__ import annotations

import argparse
from pathlib import Path

from iclnuim.geometry import scene_axes
from iclnuim.geometry.scene_axes import SceneReading

#: For help texts; what is taken is told by iclnuim.blender.import_files.
KINDS = ".blend .glb .gltf .obj .ply .usd .fbx"


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """--up, --units, --mirror, --textures."""
    parser.add_argument(
        "--up",
        metavar="AXIS",
        choices=list(scene_axes.UP),
        help="axis of the scene's file that points up: x y z, or =-y and so on; default: the format's, or a guess that is told",
    )
    units = ", ".join(scene_axes.UNITS_M)
    parser.add_argument(
        "--units", metavar="UNIT", help=f"of the scene's file: {units}, or metres as a number; default: as with --up"
    )
    parser.add_argument(
        "--mirror", metavar="AXIS", choices=scene_axes.MIRRORS, help="axis of the scene's file to mirror; default: none"
    )
    parser.add_argument(
        "--textures",
        metavar="DIR",
        help="a further folder that the scene's textures may come from; default: its own only",
    )


def reading_from(args: argparse.Namespace, before: SceneReading | None = None) -> SceneReading:
    """The reading of the options; what they leave open is as `before` has it. Raises InputError."""
    before = before or SceneReading()
    return SceneReading(
        up=args.up or before.up,
        unit_m=scene_axes.parse_unit(args.units) if args.units else before.unit_m,
        mirror=args.mirror or before.mirror,
        textures=str(Path(args.textures).expanduser().resolve()) if args.textures else before.textures,
    )
