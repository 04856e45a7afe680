"""`iclnuim bench farm` and `iclnuim bench chaos`: measure the speed of the farm, and the damage
after kills, stops and a full disk.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from iclnuim import job as jobs
from iclnuim.console import Console
from iclnuim.dataset.run_folder import load_trajectory
from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.options import Actions, action, add_plot
from iclnuim.job import RenderJob

if TYPE_CHECKING:
    from .farm_chaos import Damage

_FARM = "this farm"
_PLAIN = "plain Blender"


def configure(actions: Actions) -> None:
    _configure_farm(actions)
    _configure_chaos(actions)


def _configure_farm(actions: Actions) -> None:
    help = (
        "frames per hour by workers and threads, time lost to start-up, "
        "and a model of many machines"
    )
    farm = action(actions, "farm", help, "iclnuim bench farm kt2 --plot farm.png", _farm)
    add = farm.add_argument
    add("sequence", nargs="?", default="kt2", metavar="SEQUENCE", help="default: kt2")
    add("--light", choices=("baked", "path"), help="default: both")
    help = "frames per split; default: 160 baked, 64 path-traced"
    add("--frames", type=int, metavar="N", help=help)
    add("--samples", type=int, default=4, metavar="N", help="samples of path tracing; default: 4")
    help = "number of repetitions, of which the fastest is reported; default: 1"
    add("--repeat", type=int, default=1, metavar="N", help=help)
    add("--camera", metavar="WxH", help="default: 640x480")
    add("--nodes", type=int, default=1000, metavar="N", help="machines of the model; default: 1000")
    help = "sequences of the model; default: 10000"
    add("--sequences", type=int, default=10_000, metavar="N", help=help)
    add_plot(farm)


def _configure_chaos(actions: Actions) -> None:
    help = (
        "damage after repeated kills, stops and a full disk during `make`, "
        "and after the same kills of plain Blender"
    )
    example = "iclnuim bench chaos kt2 --kills 30 --plot chaos.png"
    chaos = action(actions, "chaos", help, example, _chaos)
    add = chaos.add_argument
    add("sequence", nargs="?", default="kt2", metavar="SEQUENCE", help="default: kt2")
    add("--kills", type=int, default=30, metavar="N", help="default: 30")
    add("--camera", default="640x480", metavar="WxH", help="default: 640x480")
    help = "random seed of the moments and the victims; default: 0"
    add("--seed", type=int, default=0, metavar="N", help=help)
    help = "output of an undisturbed `make` with the same settings; default: made by this command"
    add("--undisturbed", type=Path, metavar="DIR", help=help)
    help = "folder for the output, which is kept; default: a temporary folder"
    add("--work", type=Path, metavar="DIR", help=help)
    add("--no-plain", action="store_true", help="leave plain Blender out")
    add_plot(chaos)


def _farm(args: argparse.Namespace, console: Console) -> None:
    from iclnuim.report import charts

    from . import farm_chart, farm_model, farm_throughput

    min_frames = farm_throughput.min_frames()
    results = []
    models = []
    if args.frames is not None and args.frames < min_frames:
        raise InputError(f"--frames of at least {min_frames} on this machine", found=args.frames)
    for light in [args.light] if args.light else ["baked", "path"]:
        job = _job(args, light)
        frames = args.frames or max(160 if light == "baked" else 64, min_frames)
        measured = farm_throughput.measure_splits(job, frames, args.repeat, console.note)
        known = {"sequences": args.sequences, "frames_a_sequence": len(load_trajectory(job))}
        models.append(farm_model.of(farm_throughput.best(measured), **known))
        results += measured
    if args.plot:
        charts.save(farm_chart.figure(results, models, args.nodes), args.plot)
    values = {
        "splits": [asdict(result) for result in results],
        "models": [farm_model.figures(m, args.nodes) for m in models],
    }
    texts = [farm_chart.table(results), *(farm_model.summary(m, args.nodes) for m in models)]
    console.result(values, "\n".join(texts))


def _job(args: argparse.Namespace, light: str) -> RenderJob:
    if args.repeat < 1 or args.samples < 1:
        found = min(args.repeat, args.samples)
        raise InputError("--repeat and --samples of at least 1", found=found)
    camera = PinholeCamera.parse(args.camera) if args.camera else None
    job = jobs.shipped_job(args.sequence).changed(light=light, camera=camera)
    if light == "path":
        job = job.changed(samples=args.samples, denoise=False)
    return job


def _chaos(args: argparse.Namespace, console: Console) -> int:
    try:
        from . import farm_chaos, farm_chart
    except ImportError:
        need = "bench chaos needs psutil, to find the workers"
        raise WorkError(f"{need}; try: pip install psutil") from None
    from iclnuim.report import charts

    if args.kills < 1:
        raise InputError("at least 1 kill", found=args.kills)
    with _work_folder(args.work) as base:
        rng = np.random.default_rng(args.seed)
        chaos = farm_chaos.Chaos(args.sequence, ("--camera", args.camera), base / "disturbed", rng)
        chaos.run(farm_chaos.kinds(args.kills), console.note)
        ours = chaos.damage(args.undisturbed or _undisturbed(args, base, console))
        damages = {_FARM: ours}
        console.note(farm_chart.damage_table(damages))
        if not args.no_plain:
            damages[_PLAIN] = _plain(args, base, console)
    if args.plot:
        charts.save(farm_chart.damage_figure(damages), args.plot)
    values = {name: asdict(d) for name, d in damages.items()}
    console.result(values, farm_chart.damage_table(damages))
    return 0 if ours.none else 3


@contextmanager
def _work_folder(kept: Path | None) -> Iterator[Path]:
    if kept is None:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder)
        return
    if kept.exists() and any(kept.iterdir()):
        raise InputError("an empty folder", path=kept, hint="another --work")
    kept.mkdir(parents=True, exist_ok=True)
    yield kept


def _undisturbed(args: argparse.Namespace, base: Path, console: Console) -> Path:
    from .farm_chaos import Chaos

    begun = time.monotonic()
    rng = np.random.default_rng(0)
    undisturbed = Chaos(args.sequence, ("--camera", args.camera), base / "undisturbed", rng)
    undisturbed.complete()
    console.note(f"undisturbed: {time.monotonic() - begun:.0f} s")
    return undisturbed.out


def _plain(args: argparse.Namespace, base: Path, console: Console) -> Damage:
    """The same prepared scene, with its animated camera, by Blender's own animation render."""
    from .plain_blender import PlainBlender

    blend = base / "scene.blend"
    command = [sys.executable, "-m", "iclnuim", "render", args.sequence, "--camera", args.camera]
    command += ["--frames", "0:1", "--out", str(base / "one"), "--blend", str(blend)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise WorkError(f"no scene for plain Blender: {done.stderr.strip()[-300:]}")
    last = len(load_trajectory(jobs.shipped_job(args.sequence))) - 1
    rng = np.random.default_rng(args.seed)
    return PlainBlender(blend, base / "plain", 0, last, rng).run(args.kills, console.note)
