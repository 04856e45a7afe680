"""`iclnuim view X ...`: sequences, trajectories, surfaces and scenes in one page for a browser."""

import os
import sys
import webbrowser
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.formats.meshes import MESH_ENDINGS, read_mesh
from iclnuim.report.view import gather
from iclnuim.report.view.contents import ViewContents, ViewedSurface
from iclnuim.trajectory_files.trajectories import read_trajectory

from ..isolation import isolated_model
from ..options import FRAMES, SCENE_KINDS, add_frames, add_settings, common, settings_from
from ..sequence_input import add_allow_outside

_SCENES = tuple(SCENE_KINDS.split())


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = (
        "folders of sequences or runs, bags; trajectories, which are aligned with the true one; "
        f"surfaces ({', '.join(MESH_ENDINGS)}); scenes by name, or {SCENE_KINDS}"
    )
    add("what", nargs="+", metavar="X", help=help)
    help = "the page; default: view.html in the working folder, overwritten without asking"
    add("-o", "--out", type=Path, metavar="FILE", help=help)
    add_frames(parser, f"{FRAMES.partition(';')[0]}; default: {gather.FRAMES}, evenly chosen")
    add_settings(parser, AlignmentSettings)
    help = "the true surface, a scene or a mesh: the given surfaces are coloured by their error"
    add("--model", metavar="MODEL", help=help)
    add("--max-error", type=float, default=10.0, metavar="MM", help="red; default: 10")
    add("--exact", action="store_true", help="depth in all pixels, however large the file")
    add("--rerun", action="store_true", help="write view.rrd for the viewer Rerun, and start it")
    add_allow_outside(parser)
    add("--no-open", action="store_true", help="do not open the page")
    common(parser, "iclnuim view out/living_room/kt2/noisy out/estimate.txt")


def run(args: Namespace, console: Console) -> None:
    view = _gathered(args)
    out = args.out or Path("view.rrd" if args.rerun else "view.html")
    if args.rerun:
        from iclnuim.report.view.rerun_view import record_view, start_viewer

        record_view(out, view, console.progress)
        notes: list[str] = []
    else:
        from iclnuim.report.view.page import write_page

        notes = write_page(out, view, args.exact, console.progress)
    size = os.path.getsize(out)
    for note in view.notes:
        console.note(f"note: {note}; --frames chooses others")
    for note in notes:
        console.note(f"note: {note}; --exact shows all of it")
    console.result({"file": str(out), "bytes": size}, f"{out}: {size / 1e6:.1f} MB")
    if args.no_open or not has_display():
        return
    if args.rerun:
        start_viewer(out)
    else:
        webbrowser.open(out.resolve().as_uri())


def has_display() -> bool:
    """Whether a window can be opened."""
    if sys.platform.startswith("linux"):
        return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return True


def _gathered(args: Namespace) -> ViewContents:
    """What the page shows."""
    kinds = {text: _kind(text) for text in dict.fromkeys(args.what)}
    names = dict(zip(kinds, _short(list(kinds)), strict=True))
    frames = None if args.frames == "::" else args.frames
    read = [
        gather.read_sequence(text, names[text], frames, args.allow_outside)
        for text, kind in kinds.items()
        if kind == "sequence"
    ]
    files = [text for text, kind in kinds.items() if kind == "trajectory"]
    named = [(names[text], read_trajectory(_path(text), positions_suffice=True)) for text in files]
    settings = AbsoluteErrorSettings(alignment=settings_from(args, AlignmentSettings()))
    surfaces = [
        _surface(args, text, names[text]) for text, kind in kinds.items() if kind == "surface"
    ]
    return gather.gathered(", ".join(names.values()), read, named, settings, surfaces)


def _kind(text: str) -> str:
    """Whether an argument is a "sequence", a "trajectory" or a "surface".

    Raises InputError if there is nothing of that name.
    """
    path = Path(text)
    ending = path.suffix.lower()
    if path.is_dir() or ending in (".bag", ".mcap", ".db3"):
        return "sequence"
    if text in shipped.SCENES or ending in MESH_ENDINGS or ending in _SCENES:
        return "surface"
    if path.exists() or _path(text) != text:
        return "trajectory"
    expected = "a folder, a trajectory, a surface or a scene"
    raise InputError(expected, path=path, found="nothing")


def _path(text: str) -> str:
    from ..options import trajectory_file

    return trajectory_file(text)


def _short(texts: list[str]) -> list[str]:
    """The last part of each path, as many parts as tell it from the others."""
    parts = [Path(text).resolve().parts if os.path.exists(text) else (text,) for text in texts]
    for count in range(1, max(map(len, parts)) + 1):
        names = ["/".join(part[-count:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    return texts


def _surface(args: Namespace, text: str, name: str) -> ViewedSurface:
    if text in shipped.SCENES or Path(text).suffix.lower() not in MESH_ENDINGS:
        points, triangles = _scene(text)
        return ViewedSurface(name, points, triangles)
    points, triangles, colours = read_mesh(text)
    if not args.model:
        return ViewedSurface(name, points, triangles, _bytes(colours))
    from iclnuim.benchmark.fusion.surface_error import TrueSurface

    error = TrueSurface(*_scene(args.model)).error(points)
    name = f"{name}, mean error {1e3 * error.statistics.mean:.3g} mm"
    limits = {"distances_m": error.distances_m, "max_mm": args.max_error}
    return ViewedSurface(name, points, triangles, **limits)


def _scene(name: str) -> tuple[np.ndarray, np.ndarray]:
    model = isolated_model(name)
    return model.points, model.triangles


def _bytes(colours: Any) -> np.ndarray | None:
    """Colours (n, 3 or more) of a mesh file, 0..255, as uint8; None without any."""
    if colours is None or not len(colours) or colours.shape[1] < 3:
        return None
    return np.clip(np.rint(colours[:, :3]), 0, 255).astype(np.uint8)
