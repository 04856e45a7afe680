"""Options that say how a scene file is to be read, shared by all commands that open one."""

import argparse

from iclnuim.geometry.scene_axes import SceneReading, parse_unit

from .options import add_settings, renamed, settings_from

#: For help texts; iclnuim.blender.user_scene decides.
KINDS = ".blend .glb .gltf .obj .ply .usd .fbx"


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """--up, --scene-unit, --mirror, --textures."""
    add_settings(parser, SceneReading)
    renamed(parser, "--units", "--scene-unit", type=parse_unit)


def reading_from(args: argparse.Namespace, before: SceneReading | None = None) -> SceneReading:
    """The reading of the options; what they leave open is as `before` has it. Raises InputError."""
    return settings_from(args, before or SceneReading())
