"""`iclnuim scene`: build a scene's .blend by code; compare our rooms with the official frames."""

import io
import os
import tempfile
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError, blender_missing
from iclnuim.formats.files import atomic_write
from iclnuim.formats.png import write_png
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless.options import action, subcommands
from iclnuim.job import RenderJob
from iclnuim.native_output import native_output_in
from iclnuim.render import render_frames
from iclnuim.sensor.transfer import srgb8
from iclnuim.sequences.frame_source import read_frame
from iclnuim.shipped import SCENES
from iclnuim.trajectory_files.trajectories import write_trajectory
from iclnuim.worker_events import Event, Note

if TYPE_CHECKING:
    from .official_views import OfficialViews

REPOSITORY = Path(__file__).resolve().parents[1]
SAMPLES = Path(os.environ.get("ICLNUIM_SAMPLES", REPOSITORY.parent / "shared/data/iclnuim"))
_HEADER = (
    "ours / official   corners>20  corners>10  gradient  grey   depth quantiles 10 25 50 75 90 %"
)


def configure(parser: ArgumentParser) -> None:
    actions = subcommands(parser)
    names = list(SCENES)
    help = "build a scene by code and save it as a .blend"
    build = action(actions, "build", help, "iclnuim scene build living_room", _build)
    add = build.add_argument
    add("name", metavar="NAME", choices=names, help=", ".join(names))
    add("--seed", type=int, default=0, help="seed of cloth, wood, plaster; default: 0")
    help = (
        "0.15 to 3: fewer or more triangles, 1 as shipped; see docs/measured/detail.md; default: 1"
    )
    add("--detail", type=float, default=1.0, metavar="D", help=help)
    add("--out", type=Path, metavar="FILE", help="default: blend/NAME.blend")

    help = "render the official views of a room beside the official frames"
    compare = action(
        actions, "compare", help, "iclnuim scene compare office --out beside/", _compare
    )
    add = compare.add_argument
    room = {"nargs": "?", "default": "living_room", "choices": names}
    add("name", metavar="NAME", **room, help="default: living_room")
    help = "folder for the pictures; default: scene_compare"
    add("--out", type=Path, default=Path("scene_compare"), metavar="DIR", help=help)
    help = "path traced with N samples per pixel; default: as `make` renders, with baked light"
    add("--samples", type=int, metavar="N", help=help)


def _build(args: Namespace, console: Console) -> None:
    if not 0.15 <= args.detail <= 3:
        raise InputError("--detail of 0.15..3", found=f"{args.detail:g}")
    out = args.out or REPOSITORY / "blend" / f"{args.name}.blend"
    if not out.parent.is_dir():
        expected = "a folder to write into"
        raise InputError(expected, path=out.parent, found="no such folder", hint="--out FILE")
    with native_output_in(Path(os.devnull)):  # the import of bpy may print
        _blender_scene().open_empty()
        from iclnuim.blend.builder import build_scene, stage

        build_scene(args.name, seed=args.seed, detail=args.detail)
        figures = {
            "file": str(out),
            "triangles": stage.triangle_count(),
            "geometry_sha256": stage.geometry_hash(),
        }
        atomic_write(out, _save)
    figures["bytes"] = out.stat().st_size
    console.result(figures, "\n".join(f"{k:16} {v}" for k, v in figures.items()))


def _blender_scene() -> ModuleType:
    try:
        from iclnuim.blender.open import scene
    except ImportError as error:
        raise blender_missing("scene", error) from None
    return scene


def _save(path: Path) -> None:
    import bpy

    # the operator reports "Saved copy as ..." through Python's own stdout
    with redirect_stdout(io.StringIO()):
        bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, copy=True)


def _compare(args: Namespace, console: Console) -> None:
    try:
        from . import official_views, scene_likeness
    except ImportError:
        package = "opencv-contrib-python-headless"
        raise WorkError(f"scene compare needs OpenCV; try: pip install {package}") from None
    if args.name not in official_views.VIEWS:
        known = ", ".join(official_views.VIEWS)
        raise InputError(f"a scene with official frames ({known})", found=args.name)
    views = official_views.VIEWS[args.name]
    if not (SAMPLES / views.trajectory).is_file():
        raise InputError(
            "the official ICL-NUIM samples",
            path=SAMPLES,
            found=f"no {views.trajectory}",
            hint="their folder as ICLNUIM_SAMPLES",
        )
    args.out.mkdir(parents=True, exist_ok=True)
    figures = {}
    progress = console.progress(len(views.frames), "compare")
    for number, rgb, depth_z_m in _rendered(views, args.samples, console):
        bgr = srgb8(rgb)[..., ::-1].copy()
        official_bgr, official_z_m = views.official(SAMPLES, number)
        ours = scene_likeness.measure(bgr, depth_z_m)
        figures[str(number)] = ours.ratios_to(scene_likeness.measure(official_bgr, official_z_m))
        picture = scene_likeness.side_by_side(bgr, official_bgr)[..., ::-1]
        write_png(args.out / f"{views.sequence}_{number}.png", picture)
        progress.advance()
    console.result(figures, _ratio_table(views.sequence, figures))


def _rendered(
    views: "OfficialViews", path_samples: int | None, console: Console
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield (number, scene-linear RGB, planar Z) of the official views, rendered like the frames of
    `make`, or path traced with `path_samples`.
    """

    def listen(event: Event) -> None:
        if isinstance(event, Note):  # such as a bake, which takes minutes
            console.note(f"note: {event.text}")

    with tempfile.TemporaryDirectory() as folder:
        poses = views.poses(SAMPLES)[list(views.frames)]
        file = Path(folder) / "poses.txt"
        write_trajectory(file, Trajectory(np.array(views.frames) / 30.0, poses), "tum")
        job = RenderJob("compare", views.scene, str(file))
        if path_samples is not None:
            job = job.changed(light="path").changed(samples=path_samples)
        run = render_frames(job, Path(folder) / "run", on_event=listen)
        for frame, number in enumerate(views.frames):
            yield (number, *read_frame(run.frame_file(frame), run.camera))


def _ratio_table(sequence: str, figures: dict[str, dict[str, Any]]) -> str:
    lines = [_HEADER]
    for number, r in figures.items():
        depths = " ".join(f"{q:.3f}" for q in r["depth_quantiles_m"])
        lines.append(
            f"{sequence} {number:>4}       {r['corners_20']:>9.3f}   {r['corners_10']:>9.3f}   "
            f"{r['gradient']:>7.3f}  {r['grey']:.3f}  {depths}"
        )
    return "\n".join(lines)
