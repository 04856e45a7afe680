"""`iclnuim bake`: a scene's light map into the cache, where every render by baked light finds it."""

import argparse
from dataclasses import replace
from pathlib import Path

from iclnuim import job as jobs
from iclnuim import shipped
from iclnuim.errors import InputError, blender_missing
from iclnuim.worker_events import Note

from ..console import Console
from ..isolation import survived
from ..options import add_scene_options, common, reading_from


def configure(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", metavar="SCENE", help=f"{', '.join(shipped.SCENE_NAMES)}, or a file such as room.blend")
    add_scene_options(parser)
    add("--map-size", type=int, metavar="N", help="side of the light map in texels; default: 2048")
    add("--map-samples", type=int, metavar="N", help="rays a texel and source of light; default: 32")
    add("--seed", type=int, metavar="N", help="of Cycles' samples; default: 0")
    common(parser, "iclnuim bake living_room")


def run(args: argparse.Namespace, console: Console) -> int:
    return survived(lambda: _bake(args, console), args.scene)


def _bake(args: argparse.Namespace, console: Console) -> int:
    try:
        from iclnuim.blender import light_map, worker
    except ImportError as error:
        raise blender_missing("bake", error) from None
    job = _job(args.scene).changed(map_size=args.map_size, map_samples=args.map_samples, seed=args.seed)
    job = replace(job, reading=reading_from(args))
    folder = worker.bake_light(job, lambda event: console.note(event.text) if isinstance(event, Note) else None)
    recipe = light_map.read_recipe(folder)
    text = f"{folder}\n{recipe['texels']} texels, baked in {recipe['seconds']} s"
    console.result({"folder": str(folder), **recipe}, text)
    return 0


def _job(scene: str) -> jobs.RenderJob:
    """Any trajectory does: light does not depend on the camera."""
    if scene in shipped.SCENE_NAMES:
        return jobs.shipped_job(f"{scene}/kt0")
    if not Path(scene).is_file():
        raise InputError(f"a scene: {', '.join(shipped.SCENE_NAMES)}, or a file", path=scene, found="no such file")
    return jobs.shipped_job("living_room/kt0").changed(sequence="scene/light", scene=str(Path(scene).resolve()))
