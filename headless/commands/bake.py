"""`iclnuim bake`: bakes the light map of a scene into the cache, where every render with baked
light finds it.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from iclnuim import job as jobs
from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError, blender_missing
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.worker_events import Note

from ..options import add_scene_options, common, settings_from


def configure(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "scene",
        metavar="SCENE",
        help=f"{', '.join(shipped.SCENE_NAMES)}, or a file such as room.blend",
    )
    add_scene_options(parser)
    add(
        "--map-size",
        type=int,
        metavar="N",
        help="width and height of the light map in texels; default: 2048",
    )
    add("--map-samples", type=int, metavar="N", help="rays per texel and light source; default: 32")
    add("--seed", type=int, metavar="N", help="random seed of Cycles; default: 0")
    common(parser, "iclnuim bake living_room").set_defaults(opens="scene")


def run(args: argparse.Namespace, console: Console) -> None:
    try:
        from iclnuim.blender.light import light_map
        from iclnuim.blender.render import worker
    except ImportError as error:
        raise blender_missing("bake", error) from None
    job = jobs.shipped_job(
        f"{args.scene if args.scene in shipped.SCENE_NAMES else 'living_room'}/kt0"
    )
    if (
        args.scene not in shipped.SCENE_NAMES
    ):  # with any trajectory, as light does not depend on the camera
        if not Path(args.scene).is_file():
            expected = f"a scene: {', '.join(shipped.SCENE_NAMES)}, or a file"
            raise InputError(expected, path=args.scene, found="no such file")
        job = job.changed(sequence="scene/light", scene=str(Path(args.scene).resolve()))
    job = job.changed(map_size=args.map_size, map_samples=args.map_samples, seed=args.seed)
    job = replace(job, reading=settings_from(args, SceneReading()))
    folder, _ = worker.bake_light(
        job, lambda event: console.note(event.text) if isinstance(event, Note) else None
    )
    recipe = light_map.read_recipe(folder)
    text = f"{folder}\n{recipe['texels']} texels, baked in {recipe['seconds']} s"
    console.result({"folder": str(folder), **recipe}, text)
