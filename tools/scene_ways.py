"""Measures the ways to light a scene against path tracing with many samples and, in blocks of
pixels, against plain Cycles, and what the first look announced of them. Adds the rows of one scene
to docs/measured/own_scenes_ways.csv.

    python tools/scene_ways.py NAME SCENE TRAJECTORY [--scene-unit M] [--map-size 256 ...]

Frames have 160 x 120 pixels; a run has the first 60. The error is that of two frames that the
look did not use. Times are core-seconds, so that other processes on the machine do not count.
"""

import csv
import json
import tempfile
import time
from argparse import ArgumentParser
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim import checkout
from iclnuim.formats.files import csv_text
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.job import RenderJob
from iclnuim.render_ways import psnr_db, square
from iclnuim.sensor.transfer import srgb8
from iclnuim.sequences.run_folder import load_trajectory

checkout.load("iclnuim.tools", "measuring scenes")
from iclnuim.tools.rendered import read_frames  # noqa: E402
from iclnuim.tools.scene_plain import blocks, plain_frames  # noqa: E402

FILE = Path(__file__).resolve().parents[1] / "docs/measured/own_scenes_ways.csv"
COLUMNS = [
    "scene",
    "light",
    "samples",
    "map_size",
    "core_s",
    "psnr_db",
    "announced_core_s",
    "announced_db",
    "chosen",
    "look_core_s",
    "blocks_db",
]
_FRAMES = 60
_SAMPLES = (1, 2, 4, 8, 16, 32, 64)


def main() -> None:
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("name")
    parser.add_argument("scene", type=Path)
    parser.add_argument("trajectory", type=Path)
    parser.add_argument("--scene-unit", type=float, metavar="M")
    parser.add_argument("--map-size", type=int, nargs="*", default=[])
    parser.add_argument("--truth", type=int, default=1024, metavar="SAMPLES")
    args = parser.parse_args()
    reading = SceneReading(unit_m=args.scene_unit) if args.scene_unit else SceneReading()
    files = str(args.scene.resolve()), str(args.trajectory.resolve())
    lens = PinholeCamera.parse("160x120")
    job = RenderJob(args.name, *files, camera=lens, light="auto", reading=reading)
    with tempfile.TemporaryDirectory() as folder:
        rows = list(measured(job, args.map_size, args.truth, Path(folder)))
    there = list(csv.DictReader(FILE.open(newline=""))) if FILE.exists() else []
    kept = [list(row.values()) for row in there if row["scene"] != args.name]
    FILE.write_text(csv_text([COLUMNS, *kept, *rows]))


def measured(
    job: RenderJob, map_sizes: Sequence[int], truth: int, folder: Path
) -> Iterable[list[Any]]:
    """The rows of a scene."""
    count = min(_FRAMES, len(load_trajectory(job)))
    unseen = [count // 3, 2 * count // 3]
    _rendered(job, folder / "look", range(count), [])
    look = json.loads((folder / "look/first_look.json").read_text())
    path = job.changed(light="path")
    true, _ = _rendered(
        path.changed(samples=truth, seed=job.seed + 1), folder / "truth", [], unseen
    )
    true = srgb8(true)
    plain = blocks(plain_frames(job, unseen))
    ways = [path.changed(samples=samples) for samples in _SAMPLES]
    ways += [job.changed(light="baked", samples=1, map_size=size) for size in map_sizes]
    for number, way in enumerate(ways):
        rgb, (start_core_s, frame_core_s) = _rendered(way, folder / str(number), [], unseen)
        size = way.map_size if way.light == "baked" else None
        found = (way.light, way.samples, size)
        announced = next(w for w in look["ways"] if _key(w) == found)
        core_s = start_core_s + count * frame_core_s
        figures = (core_s, psnr_db(square(srgb8(rgb), true)))
        expected = (announced["core_s"], announced["psnr_db"])
        is_chosen = look["ways"][look["chosen"]] == announced
        shown = [f"{value:.4g}" for value in (*figures, *expected)]
        yield [
            job.sequence,
            *("" if v is None else v for v in found),
            *shown,
            int(is_chosen),
            look["core_s"],
            f"{psnr_db(square(blocks(rgb), plain)):.4g}",
        ]


def _key(way: dict[str, Any]) -> tuple[str, int, int | None]:
    return way["light"], way["samples"], way["map_size"]


def _rendered(
    job: RenderJob, out: Path, requested: Sequence[int], numbers: Sequence[int]
) -> tuple[np.ndarray, tuple[float, float]]:
    """Frames of scene-linear RGB, and the core-seconds until the first is finished, without one frame,
    and of each other frame.
    """
    from iclnuim.blender.render import worker

    begun = time.process_time()
    with worker.Session(job, out, lambda event: None, requested=requested) as session:
        times = [begun]
        for number in numbers:
            session.render([number], lambda: False)
            times.append(time.process_time())
    if not numbers:
        return np.empty(0), (0.0, 0.0)
    took = np.diff(times)
    frame_core_s = float(took[1:].mean())
    return read_frames(out, numbers)[0], (float(took[0]) - frame_core_s, frame_core_s)


if __name__ == "__main__":
    main()
