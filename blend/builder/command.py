"""`iclnuim scene`: build a scene's .blend by code; compare our rooms with the official frames."""

from __future__ import annotations

import argparse
import functools
import io
import os
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.blender import output
from iclnuim.console import Console
from iclnuim.dataset.frames import read_frame
from iclnuim.errors import InputError, WorkError, blender_missing
from iclnuim.formats.files import atomic_write
from iclnuim.formats.trajectories import write_trajectory
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless.options import action, subcommands
from iclnuim.job import RenderJob
from iclnuim.render import render_frames
from iclnuim.sensor.transfer import srgb8
from iclnuim.shipped import SCENES
from iclnuim.worker_events import Event, Note

from . import build_scene

REPOSITORY = Path(__file__).resolve().parents[2]
SAMPLES = Path(os.environ.get("ICLNUIM_SAMPLES", REPOSITORY.parent / "shared/data/iclnuim"))


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser)
    build = action(
        actions,
        "build",
        "build a scene by code and save it as a .blend",
        "iclnuim scene build living_room",
        _build,
    )
    build.add_argument("name", metavar="NAME", choices=list(SCENES), help=", ".join(SCENES))
    build.add_argument(
        "--seed", type=int, default=0, help="seed of cloth, wood, plaster; default: 0"
    )
    build.add_argument(
        "--detail",
        type=float,
        default=1.0,
        metavar="D",
        help="0.15 to 3: fewer or more triangles, 1 as shipped; see docs/measured/detail.md; default: 1",
    )
    build.add_argument("--out", type=Path, metavar="FILE", help="default: blend/NAME.blend")
    compare = action(
        actions,
        "compare",
        "render the official views of a room beside the official frames",
        "iclnuim scene compare office --out beside/",
        _compare,
    )
    compare.add_argument(
        "name",
        metavar="NAME",
        nargs="?",
        default="living_room",
        choices=list(SCENES),
        help="default: living_room",
    )
    compare.add_argument(
        "--samples-dir",
        type=Path,
        default=SAMPLES,
        metavar="DIR",
        help="the official samples; default: ICLNUIM_SAMPLES",
    )
    compare.add_argument(
        "--out",
        type=Path,
        default=Path("scene_compare"),
        metavar="DIR",
        help="folder for the pictures; default: scene_compare",
    )
    compare.add_argument(
        "--samples",
        type=int,
        metavar="N",
        help="path traced with N samples per pixel; default: as `make` renders, with baked light",
    )


def run(args: argparse.Namespace, console: Console) -> int:
    """Kept for the command's frame; each action carries its own."""
    return args.run(args, console)


def _build(args: argparse.Namespace, console: Console) -> int:
    if not 0.15 <= args.detail <= 3:
        raise InputError("--detail of 0.15..3", found=f"{args.detail:g}")
    out = args.out or REPOSITORY / "blend" / f"{args.name}.blend"
    if not out.parent.is_dir():
        raise InputError(
            "a folder to write into", path=out.parent, found="no such folder", hint="--out FILE"
        )
    with output.blender_output_in(Path(os.devnull)):  # the import of bpy may print
        _scene_room().open_empty()
        build_scene(args.name, seed=args.seed, detail=args.detail)
        from . import stage

        figures = {
            "file": str(out),
            "triangles": stage.triangle_count(),
            "geometry_sha256": stage.geometry_hash(),
        }
        atomic_write(out, _save)
    figures["bytes"] = out.stat().st_size
    console.result(figures, "\n".join(f"{k:16} {v}" for k, v in figures.items()))
    return 0


def _scene_room() -> Any:
    try:
        from iclnuim.blender import scene
    except ImportError as error:
        raise blender_missing("scene", error) from None
    return scene


def _save(path: Path) -> None:
    import bpy

    with redirect_stdout(
        io.StringIO()
    ):  # the operator reports "Saved copy as ..." through Python's own stdout
        bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, copy=True)


def _compare(args: argparse.Namespace, console: Console) -> int:
    likeness, views = _benchmark("scene_likeness"), _benchmark("official_views").VIEWS[args.name]
    if not (args.samples_dir / views.trajectory).is_file():
        raise InputError(
            "the official ICL-NUIM samples",
            path=args.samples_dir,
            found=f"no {views.trajectory}",
            hint="--samples-dir DIR",
        )
    import cv2

    args.out.mkdir(parents=True, exist_ok=True)
    figures, progress = {}, console.progress(len(views.frames), "compare")
    for number, rgb, depth_z_m in _rendered(views, args.samples_dir, args.samples, console):
        bgr, (their_bgr, their_depth) = (
            srgb8(rgb)[..., ::-1].copy(),
            views.official(args.samples_dir, number),
        )
        figures[str(number)] = likeness.measure(bgr, depth_z_m).ratios_to(
            likeness.measure(their_bgr, their_depth)
        )
        picture = cv2.imencode(".png", likeness.side_by_side(bgr, their_bgr))[1].tobytes()
        name = f"{views.sequence}_{number}.png"
        atomic_write(args.out / name, functools.partial(_write, picture))
        progress.advance()
    console.result(figures, _ratio_table(views.sequence, figures))
    return 0


def _write(content: bytes, path: Path) -> None:
    path.write_bytes(content)


def _rendered(
    views: Any, samples_dir: Path, path_samples: int | None, console: Console
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield (number, scene-linear RGB, planar Z) of the official views, rendered like the frames of
    `make`, or path traced with `path_samples`.
    """

    def listen(event: Event) -> None:
        if isinstance(event, Note):  # such as a bake, which takes minutes
            console.note(f"note: {event.text}")

    with tempfile.TemporaryDirectory() as folder:
        poses, file = views.poses(samples_dir)[list(views.frames)], Path(folder) / "poses.txt"
        write_trajectory(file, Trajectory(np.array(views.frames) / 30.0, poses), "tum")
        job = RenderJob("compare", views.scene, str(file))
        if path_samples is not None:
            job = job.changed(light="path").changed(samples=path_samples)
        run = render_frames(job, Path(folder) / "run", on_event=listen)
        for frame, number in enumerate(views.frames):
            yield (number, *read_frame(run.frame_file(frame), run.camera))


def _ratio_table(sequence: str, figures: dict) -> str:
    lines = [
        "ours / official   corners>20  corners>10  gradient  grey   depth quantiles 10 25 50 75 90 %"
    ]
    for number, r in figures.items():
        depths = " ".join(f"{q:.3f}" for q in r["depth_quantiles_m"])
        lines.append(
            f"{sequence} {number:>4}       {r['corners_20']:>9.3f}   {r['corners_10']:>9.3f}   "
            f"{r['gradient']:>7.3f}  {r['grey']:.3f}  {depths}"
        )
    return "\n".join(lines)


def _benchmark(name: str) -> Any:
    import importlib

    try:
        return importlib.import_module(f"iclnuim.tools.{name}")
    except ImportError:
        raise WorkError(
            "scene compare needs OpenCV; try: pip install opencv-contrib-python-headless"
        ) from None
