"""`iclnuim trajectory make --scene FILE --viewpoints ...`: a hand-held walk through somebody's own scene, clear of its surfaces."""

from __future__ import annotations

import argparse
import json
import os
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.blender import output
from iclnuim.errors import InputError, blender_missing
from iclnuim.formats.files import atomic_write_text, read_text
from iclnuim.geometry import trajectory
from iclnuim.geometry.free_space import FreeSpace
from iclnuim.geometry.handheld_recipe import Pace
from iclnuim.geometry.walk import Stop, Walk, plan
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.viewpoints import chosen

from ..console import Console
from ..isolation import survived
from ..scene_options import add_scene_options, reading_from

#: A way round an obstacle is looked for this far beyond the viewpoints.
_DETOUR_M = 2.0


def add_walk_options(parser: argparse.ArgumentParser) -> None:
    """What `trajectory make` needs to know of a scene."""
    # a viewpoint may begin with a minus; argparse would take it for an option
    parser._negative_number_matcher = re.compile(r"^-[\d.]")  # type: ignore[attr-defined]
    parser.add_argument("--scene", metavar="NAME|FILE", help="a walk through this scene instead of recipes")
    parser.add_argument(
        "--viewpoints",
        nargs="+",
        metavar="X,Y,Z[:X,Y,Z]",
        help="places in metres, z up, each with a point to look at; or a file of such lines; or auto:N for N places chosen",
    )
    parser.add_argument("--clearance", type=float, default=0.25, metavar="M", help="from every surface; default: 0.25")
    parser.add_argument("--speed", type=float, default=0.3, metavar="M/S", help="of walking; default: 0.3")
    parser.add_argument("--shake", type=float, default=1.0, metavar="F", help="factor on the hands' shake; default: 1")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the shake; default: 0")
    add_scene_options(parser)


def run(args: argparse.Namespace, console: Console) -> None:
    """Write NAME.txt, the TUM file, and NAME.json, its recipe."""
    if not args.scene or not args.viewpoints or args.recipes:
        raise InputError("--scene and --viewpoints together, and no recipe", hint="--viewpoints auto:6")
    if not (0.01 <= args.clearance <= 10 and 0.01 <= args.speed <= 10 and 0 <= args.shake <= 10):
        raise InputError("--clearance and --speed of 0.01 to 10, --shake of 0 to 10")
    survived(lambda: _walk(args, console), args.scene)


def _walk(args: argparse.Namespace, console: Console) -> int:
    from .trajectory_make import tum_text

    vertices, triangles = _surface(args, console)
    caster = RayCaster(vertices, triangles)
    stops = _stops(args, vertices, caster, console)
    space = FreeSpace.between(*_around(np.array([s.position_m for s in stops])), caster.distance)
    pace = Pace(args.speed, 40.0, 0.9)
    walk = plan(stops, space, args.clearance, Path(args.scene).name, pace, args.seed, args.shake)
    name = (args.out or Path()) / Path(args.scene).stem
    name.parent.mkdir(parents=True, exist_ok=True)
    atomic_write_text(name.with_suffix(".txt"), tum_text(walk.motion.trajectory))
    atomic_write_text(name.with_suffix(".json"), json.dumps(asdict(walk.recipe), indent=2) + "\n")
    _tell(name, walk, console)
    return 0


def _surface(args: argparse.Namespace, console: Console) -> tuple[np.ndarray, np.ndarray]:
    with output.blender_output_in(Path(os.devnull)):
        try:
            from iclnuim.blender import scene, surfaces
        except ImportError as error:
            raise blender_missing("a trajectory through a scene", error) from None
        file = args.scene if args.scene in shipped.SCENE_NAMES else str(Path(args.scene).resolve())
        notes = scene.open_scene(file, reading_from(args))
        found = surfaces.triangles()
    for note in notes:
        console.note(f"note: {note}")
    if not len(found.triangles):
        raise InputError("a scene with surfaces", path=args.scene, found="none")
    return found.vertices, found.triangles


def _around(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A box with room for a way round."""
    return points.min(0) - _DETOUR_M, points.max(0) + _DETOUR_M


def _busy_part(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The box that holds nearly all of the scene's detail: a far backdrop or ground is left out."""
    low, high = np.percentile(vertices, (1, 99), axis=0)
    return np.maximum(low - 0.5, vertices.min(0)), np.minimum(high + 0.5, vertices.max(0))


def _stops(args: argparse.Namespace, vertices: np.ndarray, caster: RayCaster, console: Console) -> list[Stop]:
    texts = args.viewpoints
    if len(texts) == 1 and (auto := re.fullmatch(r"auto(?::(\d+))?", texts[0])):
        space = FreeSpace.between(*_busy_part(vertices), caster.distance)
        stops = chosen(space, caster, int(auto.group(1) or 6), args.clearance, args.seed)
        for stop in stops:
            console.note(f"viewpoint {_point(stop.position_m)}:{_point(stop.look_at_m)}")
        return stops
    if len(texts) == 1 and Path(texts[0]).is_file():
        lines = read_text(texts[0]).splitlines()
        rows = [(k, line.split("#")[0].strip()) for k, line in enumerate(lines, 1)]
        return [_stop(row, path=texts[0], line=k) for k, row in rows if row]
    return [_stop(text) for text in texts]


def _stop(text: str, path: str | None = None, line: int | None = None) -> Stop:
    """`x,y,z`, `x,y,z:x,y,z`, with spaces for commas in files; a seventh number is seconds of rest."""
    try:
        numbers = [float(part) for part in re.split(r"[,:\s]+", text.strip())]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 6, 7) or not np.isfinite(numbers).all():
        raise InputError("a viewpoint X,Y,Z or X,Y,Z:X,Y,Z", path=path, line=line, found=text)
    look_at = tuple(numbers[3:6]) if len(numbers) > 3 else None
    return Stop(tuple(numbers[:3]), look_at, numbers[6] if len(numbers) == 7 else 0.0)


def _point(point_m: tuple | None) -> str:
    return ",".join(f"{x:.2f}" for x in point_m or ())


def _tell(name: Path, walk: Walk, console: Console) -> None:
    figures = asdict(trajectory.statistics(walk.motion.trajectory))
    text = (
        f"{name}.txt: {figures['frames']} poses, {figures['length_m']:.2f} m, "
        f"{figures['mean_speed']:.3f} m/s, {figures['mean_rotation_rate']:.1f} deg/s, "
        f"at least {walk.clearance_m:.3f} m from every surface; its recipe is {name}.json"
    )
    console.result({"file": f"{name}.txt", "recipe": f"{name}.json", "clearance_m": walk.clearance_m, **figures}, text)
