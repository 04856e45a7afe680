"""`iclnuim bench`: measurements, each with its figures and where they come from."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from iclnuim import job as jobs
from iclnuim.errors import InputError, WorkError

from ..console import Console
from ..options import action, subcommands


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser, "WHAT")
    render = action(
        actions, "render", "time and error of rendered frames", "iclnuim bench render kt2 --breakdown", _render
    )
    render.add_argument("sequence", nargs="?", default="kt2", metavar="SEQUENCE", help="default: kt2")
    render.add_argument(
        "--breakdown", action="store_true", help="where a frame's time goes: rays, shading, EXR, overhead"
    )
    render.add_argument("--frames", default="::30", metavar="A:B:S", help="default: every 30th")
    render.add_argument("--light", choices=("baked", "path"), default="baked")
    render.add_argument("--samples", type=int, metavar="N")


def _render(args: argparse.Namespace, console: Console) -> int:
    if not args.breakdown:
        raise InputError("--breakdown")
    try:
        from ..benchmark import breakdown
    except ImportError:
        raise WorkError("bench render needs the bpy package; try: pip install bpy") from None
    job = jobs.shipped_job(args.sequence).changed(light=args.light, samples=args.samples)
    result = breakdown.measure(job.changed(denoise=False), args.frames)
    figures = asdict(result)
    console.result(figures, "\n".join(f"{name:<20}{value:9.2f}" for name, value in figures.items()))
    return 0
