"""`iclnuim bench render` and `iclnuim bench textures`: time and error of rendered frames."""

import os
from argparse import Namespace
from dataclasses import asdict, replace
from typing import Any

from iclnuim import job as jobs
from iclnuim.console import Console
from iclnuim.errors import InputError, blender_missing
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.headless.options import Actions, action, add_plot, whole_numbers
from iclnuim.job import RenderJob
from iclnuim.sequences.run_folder import load_trajectory

from .measured_tables import tables


def configure(actions: Actions) -> None:
    _configure_render(actions)
    _configure_textures(actions)


def _configure_render(actions: Actions) -> None:
    help = "time, error and flicker of path tracing and baked light"
    render = action(actions, "render", help, "iclnuim bench render kt2", _render)
    add = render.add_argument
    add("sequence", nargs="?", default="kt2", metavar="SEQUENCE", help="default: kt2")
    add("--frames", default="::160", metavar="A:B:S", help="default: every 160th")
    help = "sizes of light maps in texels; default: 512,1024,2048"
    add("--maps", type=whole_numbers, default=(512, 1024, 2048), metavar="N,N", help=help)
    add("--only", metavar="TEXT", help="only methods whose name contains TEXT, such as `baked`")
    add_plot(render, "time against error")


def _configure_textures(actions: Actions) -> None:
    help = "frames with and without filtered textures, next to frames of many rays a pixel"
    example = "iclnuim bench textures kt2 office/kt0 --plot textures.png"
    textures = action(actions, "textures", help, example, _textures)
    add = textures.add_argument
    add("sequences", nargs="+", metavar="SEQUENCE")
    help = "each with the frame that follows it; default: every 160th"
    add("--frames", default="::160", metavar="A:B:S", help=help)
    size = {"type": PinholeCamera.parse, "default": PinholeCamera()}
    add("--camera", **size, metavar="WxH", help="default: 640x480")
    add_plot(textures, "parts of frames side by side")


def _require_blender(what: str) -> None:
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        raise blender_missing(what, error) from None


def _render(args: Namespace, console: Console) -> None:
    _require_blender("bench render")
    from iclnuim.report import charts

    from . import light_comparison

    job = jobs.shipped_job(args.sequence).changed(map_size=max(args.maps))
    views = list(frame_slice(args.frames, len(load_trajectory(job)) - 1))
    if len(views) < 3:
        raise InputError("at least 3 frames to compare", found=len(views))
    console.note(f"references: {light_comparison.REFERENCE_SAMPLES} samples, {len(views)} views")
    small = PinholeCamera.parse("320x240")
    comparison = light_comparison.Comparison(job, views, small, console.note)
    every = light_comparison.methods(job, args.maps)
    methods = [method for method in every if (args.only or "") in method.family]
    progress = console.progress(len(methods), "bench render", "methods")
    results = []
    for method in methods:
        results.append(comparison.run(method))
        console.note(f"{method.family} {method.label}: {results[-1].seconds:.3f} s a frame")
        progress.advance()
    if args.plot:
        charts.save(light_comparison.figure(results), args.plot)
    values = {"machine": _machine(job), "methods": [asdict(r) for r in results]}
    console.result(values, tables(values, "light"))


def _machine(job: RenderJob) -> dict[str, Any]:
    from iclnuim.blender.render import run_recipe

    recipe = run_recipe.recipe(job)
    return {"cores": os.cpu_count(), **recipe["machine"], "blender": recipe["blender"]}


def _textures(args: Namespace, console: Console) -> None:
    _require_blender("bench textures")
    from iclnuim.report import charts

    from . import texture_comparison

    results = []
    parts = []
    progress = console.progress(len(args.sequences), "bench textures", "sequences")
    for sequence in args.sequences:
        job = replace(jobs.shipped_job(sequence), camera=args.camera)
        firsts = frame_slice(args.frames, len(load_trajectory(job)) - 1)
        rows, part = texture_comparison.measure(job, firsts)
        results += rows
        parts.append(part)
        progress.advance()
    if args.plot:
        charts.save(texture_comparison.figure(parts), args.plot)
    values = {"machine": _machine(job), "rows": [asdict(r) for r in results]}
    console.result(values, tables(values, "textures"))
