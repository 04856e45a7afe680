"""`iclnuim bake`: bakes the light map of a scene into the cache, where every render with baked
light finds it.
"""

import os
from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path

from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError, blender_missing
from iclnuim.formats.files import make_folder
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.job import RenderJob, bake_core_s, shipped_job, shipped_light
from iclnuim.native_output import native_output_in
from iclnuim.worker_events import Event, Note

from ..farm.chunks import own_cores
from ..isolation import put_up_wall
from ..options import add_scene_options, add_settings, common, settings_from
from ..planned_work import PlannedWork, add_dry_run, announce

#: The settings of a job that decide its light map.
_LIGHT_MAP = ("map_size", "map_samples", "seed")
#: Three colours as half floats.
_BYTES_A_TEXEL = 6


def configure(parser: ArgumentParser) -> None:
    help = f"{', '.join(shipped.SCENE_NAMES)}, or a file such as room.blend"
    parser.add_argument("scene", metavar="SCENE", help=help)
    add_scene_options(parser)
    add_settings(parser, RenderJob, _LIGHT_MAP)
    add_dry_run(parser)
    common(parser, "iclnuim bake living_room").set_defaults(opens="scene")


def run(args: Namespace, console: Console) -> None:
    job = _job(args)
    if args.dry_run:
        announce(_work(job), args, console)
        return
    cache = shipped.cache_folder()
    make_folder(cache)
    put_up_wall(job.scene, job.reading, (), [cache])
    try:
        with native_output_in(Path(os.devnull)):  # importing bpy may print
            from iclnuim.blender.light import light_files
            from iclnuim.blender.render.job_scene import JobScene
    except ImportError as error:
        raise blender_missing("bake", error) from None

    def listen(event: Event) -> None:
        if isinstance(event, Note):
            console.note(event.text)

    folder, _ = JobScene(job, listen).bake()
    recipe = light_files.read_recipe(folder)
    text = f"{folder}\n{recipe['texels']} texels, baked in {recipe['seconds']} s"
    console.result({"folder": str(folder), **recipe}, text)


def _work(job: RenderJob) -> PlannedWork:
    """The bake of a light map that is not in the cache: nothing for one that is shipped."""
    if shipped_light(job) is not None:
        return PlannedWork("the light map is shipped with the room", 0.0)
    what = f"light map, {job.map_size} texels wide, {job.map_samples} samples, unless it is cached"
    size = job.map_size**2 * _BYTES_A_TEXEL
    return PlannedWork(what, bake_core_s(job) / len(own_cores()), size / 1e9)


def _first_sequence(scene: str) -> str:
    return next(name for name in shipped.sequence_names() if name.startswith(f"{scene}/"))


def _job(args: Namespace) -> RenderJob:
    """A job with any trajectory of the scene, as its light does not depend on the camera."""
    if args.scene in shipped.SCENE_NAMES:
        job = shipped_job(_first_sequence(args.scene))
    elif Path(args.scene).is_file():
        job = shipped_job("living_room/kt0")
        job = job.changed(sequence="scene/light", scene=str(Path(args.scene).resolve()))
    else:
        expected = f"a scene: {', '.join(shipped.SCENE_NAMES)}, or a file"
        raise InputError(expected, path=args.scene, found="no such file")
    job = settings_from(args, job, _LIGHT_MAP)
    return replace(job, reading=settings_from(args, SceneReading()))
