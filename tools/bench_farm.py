"""`iclnuim bench farm` and `iclnuim bench chaos`: measure the speed of the farm, and the damage
after kills, stops and a full disk.
"""

import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from iclnuim import job as jobs
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.headless.options import Actions, action, add_plot
from iclnuim.sequences.run_folder import load_trajectory

from .measured_tables import tables

if TYPE_CHECKING:
    from .farm_chaos import Damage

_FARM = "this farm"
_PLAIN = "plain Blender"
#: Samples of path tracing, and machines of the model.
_PATH_SAMPLES = 4
_NODES = 1000


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
    add_plot(chaos)


def _farm(args: Namespace, console: Console) -> None:
    from iclnuim.report import charts

    from . import farm_chart, farm_model, farm_throughput

    min_frames = farm_throughput.min_frames()
    results = []
    models = []
    if args.frames is not None and args.frames < min_frames:
        raise InputError(f"--frames of at least {min_frames} on this machine", found=args.frames)
    for light in [args.light] if args.light else ["baked", "path"]:
        job = jobs.shipped_job(args.sequence).changed(light=light)
        if light == "path":
            job = job.changed(samples=_PATH_SAMPLES, denoise=False)
        frames = args.frames or max(160 if light == "baked" else 64, min_frames)
        measured = farm_throughput.measure_splits(job, frames, console.note)
        best = max(measured, key=lambda split: split.frames_an_hour)
        models.append(farm_model.of(best, frames_a_sequence=len(load_trajectory(job))))
        results += measured
    if args.plot:
        charts.save(farm_chart.figure(results, models, _NODES), args.plot)
    values = {
        "splits": [asdict(result) for result in results],
        "models": [farm_model.figures(m, _NODES) for m in models],
    }
    console.result(values, tables(values, "farm-splits"))


def _chaos(args: Namespace, console: Console) -> int:
    try:
        from . import farm_chaos, farm_chart
    except ImportError:
        need = "bench chaos needs psutil, to find the workers"
        raise WorkError(f"{need}; try: pip install psutil") from None
    from iclnuim.report import charts

    if args.kills < 1:
        raise InputError("at least 1 kill", found=args.kills)
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder)
        rng = np.random.default_rng(0)
        chaos = farm_chaos.Chaos(args.sequence, ("--camera", args.camera), base / "disturbed", rng)
        chaos.run(farm_chaos.kinds(args.kills), console.note)
        ours = chaos.damage(_undisturbed(args, base, console))
        console.note(str(ours))
        damages = {_FARM: ours, _PLAIN: _plain(args, base, console)}
    if args.plot:
        charts.save(farm_chart.damage_figure(damages), args.plot)
    values = {name: asdict(d) for name, d in damages.items()}
    console.result(values, tables(values, "farm-chaos"))
    return 0 if ours.none else 3


def _undisturbed(args: Namespace, base: Path, console: Console) -> Path:
    from .farm_chaos import Chaos

    begun = time.monotonic()
    rng = np.random.default_rng(0)
    undisturbed = Chaos(args.sequence, ("--camera", args.camera), base / "undisturbed", rng)
    undisturbed.complete()
    console.note(f"undisturbed: {time.monotonic() - begun:.0f} s")
    return undisturbed.out


def _plain(args: Namespace, base: Path, console: Console) -> "Damage":
    """The same prepared scene, with its animated camera, by Blender's own animation render."""
    from .plain_blender import PlainBlender

    blend = base / "scene.blend"
    command = [sys.executable, "-m", "iclnuim", "render", args.sequence, "--camera", args.camera]
    command += ["--frames", "0:1", "--out", str(base / "one"), "--blend", str(blend)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise WorkError(f"no scene for plain Blender: {done.stderr.strip()[-300:]}")
    last = len(load_trajectory(jobs.shipped_job(args.sequence))) - 1
    rng = np.random.default_rng(0)
    return PlainBlender(blend, base / "plain", 0, last, rng).run(args.kills, console.note)
