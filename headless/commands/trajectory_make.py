"""`iclnuim trajectory make`: the hand-held trajectories kt0..kt3 of both scenes, or one's own, made from their recipes; or one through a
user-provided scene, clear of its surfaces.
"""

import argparse
import json
import os
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.blender import output
from iclnuim.errors import InputError, WorkError, blender_missing
from iclnuim.formats.files import atomic_write_text, read_json, read_text
from iclnuim.formats.trajectories import TUM_HEADER
from iclnuim.geometry import handheld, trajectory
from iclnuim.geometry.handheld_plan import FreeSpace, PlanSettings, Waypoint, plan
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.viewpoints import chosen

from ..console import Console
from ..isolation import survived
from ..options import Actions, action, add_scene_options, add_settings, reading_from, settings_from

#: Routes round obstacles are searched this far beyond the viewpoints.
_DETOUR_M = 2.0
NAMES = [f"{scene}/{kt}" for scene in shipped.SCENE_NAMES for kt in shipped.TRAJECTORY_NAMES]


def configure(actions: Actions) -> None:
    """Add the action `make` below `iclnuim trajectory`."""
    text = "make hand-held trajectories from their recipes: same recipe, same bytes"
    parser = action(actions, "make", text, "iclnuim trajectory make office/kt3 --out paths", run)
    parser.add_argument("recipes", nargs="*", metavar="NAME|RECIPE", help="kt2, office/kt0, a recipe file; or all")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write below DIR instead of beside the recipe")
    parser.add_argument("--check", action="store_true", help="write nothing; exit 3 where the file is not what is made")
    # a viewpoint may begin with a minus; argparse would take it for an option
    parser._negative_number_matcher = re.compile(r"^-[\d.]")
    parser.add_argument("--scene", metavar="NAME|FILE", help="a trajectory through this scene instead of recipes")
    places = (
        "places in metres, z up, each with a point to look at; or a file of such lines; or auto:N for N places chosen"
    )
    parser.add_argument("--viewpoints", nargs="+", metavar="X,Y,Z[:X,Y,Z]", help=places)
    add_settings(parser, PlanSettings)
    add_scene_options(parser)


def run(args: argparse.Namespace, console: Console) -> None:
    if args.scene or args.viewpoints:
        _run_in_scene(args, console)
        return
    made = []
    for name in args.recipes or NAMES:
        source, target = _places(name, args.out)
        motion = _motion(source)
        text = tum_text(motion.trajectory)
        if not args.check:
            target.parent.mkdir(parents=True, exist_ok=True)
            atomic_write_text(target, text)
        elif not target.is_file():
            raise WorkError(f"{target}: not there to be checked")
        elif target.read_bytes() != text.encode():
            raise WorkError(f"{target}: not what its recipe makes")
        figures = asdict(trajectory.statistics(motion.trajectory))
        made.append({"name": name, "file": str(target), "scale": motion.scale, **figures})
    console.result({"trajectories": made}, _table(made))


def tum_text(made: trajectory.Trajectory) -> str:
    """A TUM file of 1e-6 m and 1e-7 in the quaternion: few enough digits that processors' last bits do not show."""
    rows = np.column_stack([made.stamps_s, made.positions_m, made.T_world_camera.quat_xyzw + 0.0]).tolist()
    line = "%.9f %.6f %.6f %.6f %.7f %.7f %.7f %.7f\n"
    text = "".join([line % tuple(row) for row in rows])
    return TUM_HEADER + text.replace("-0.000000 ", "0.000000 ").replace("-0.0000000", "0.0000000")


def _places(name: str, out: Path | None) -> tuple[Path, Path]:
    """The recipe's file and the trajectory's, for `kt2`, `office/kt0` or a recipe file."""
    known = f"living_room/{name}" if f"living_room/{name}" in NAMES else name
    if known in NAMES:
        folder = shipped.folder("trajectories")
        return folder / f"{known}.json", (out or folder) / f"{known}.txt"
    source = Path(name)
    if source.suffix != ".json":
        raise InputError(f"one of {', '.join(NAMES)} or a recipe file *.json", found=name)
    return source, (out or source.parent) / f"{source.stem}.txt"


def _motion(source: Path) -> handheld.Motion:
    content = read_json(source)
    try:
        return handheld.make(handheld.Recipe.from_dict(content))
    except InputError as error:
        raise error.at(source if error.path is None else f"{source}: {error.path}") from None


def _table(made: list[dict]) -> str:
    head = f"{'':16}{'frames':>8}{'length':>9}{'mean':>8}{'max':>7} m/s{'mean':>8}{'max':>7} deg/s   scale"
    rows = [
        f"{f['name']:16}{f['frames']:8d}{f['length_m']:9.3f}{f['mean_speed']:8.3f}{f['max_speed']:7.3f}    "
        f"{f['mean_rotation_rate']:8.1f}{f['max_rotation_rate']:7.1f}         {f['scale']:.4f}"
        for f in made
    ]
    return "\n".join([head, *rows])


def _run_in_scene(args: argparse.Namespace, console: Console) -> None:
    """Write NAME.txt, the TUM file, and NAME.json, its recipe."""
    if not args.scene or not args.viewpoints or args.recipes:
        raise InputError("--scene and --viewpoints together, and no recipe", hint="--viewpoints auto:6")
    settings = settings_from(args, PlanSettings())
    survived(lambda: _make_in_scene(args, settings, console), args.scene)


def _make_in_scene(args: argparse.Namespace, settings: PlanSettings, console: Console) -> int:
    vertices, triangles = _surface(args, console)
    caster = RayCaster(vertices, triangles)
    waypoints = _waypoints(args, vertices, caster, settings, console)
    places = np.array([w.position_m for w in waypoints])
    space = FreeSpace.between(places.min(0) - _DETOUR_M, places.max(0) + _DETOUR_M, caster.distance)
    made = plan(waypoints, space, Path(args.scene).name, settings)
    name = (args.out or Path()) / Path(args.scene).stem
    name.parent.mkdir(parents=True, exist_ok=True)
    atomic_write_text(name.with_suffix(".txt"), tum_text(made.motion.trajectory))
    atomic_write_text(name.with_suffix(".json"), json.dumps(asdict(made.recipe), indent=2) + "\n")
    figures = asdict(trajectory.statistics(made.motion.trajectory))
    text = (
        f"{name}.txt: {figures['frames']} poses, {figures['length_m']:.2f} m, "
        f"{figures['mean_speed']:.3f} m/s, {figures['mean_rotation_rate']:.1f} deg/s, "
        f"at least {made.clearance_m:.3f} m from every surface; its recipe is {name}.json"
    )
    console.result({"file": f"{name}.txt", "recipe": f"{name}.json", "clearance_m": made.clearance_m, **figures}, text)
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


def _waypoints(
    args: argparse.Namespace, vertices: np.ndarray, caster: RayCaster, settings: PlanSettings, console: Console
) -> list[Waypoint]:
    texts = args.viewpoints
    if len(texts) == 1 and (auto := re.fullmatch(r"auto(?::(\d+))?", texts[0])):
        low, high = np.percentile(vertices, (1, 99), axis=0)  # a far backdrop or ground is left out
        low, high = np.maximum(low - 0.5, vertices.min(0)), np.minimum(high + 0.5, vertices.max(0))
        space = FreeSpace.between(low, high, caster.distance)
        found = chosen(space, caster, int(auto.group(1) or 6), settings.clearance_m, settings.seed)
        for waypoint in found:
            console.note(f"viewpoint {_point(waypoint.position_m)}:{_point(waypoint.look_at_m)}")
        return found
    if len(texts) == 1 and Path(texts[0]).is_file():
        lines = read_text(texts[0]).splitlines()
        rows = [(k, line.split("#")[0].strip()) for k, line in enumerate(lines, 1)]
        return [_waypoint(row, path=texts[0], line=k) for k, row in rows if row]
    return [_waypoint(text) for text in texts]


def _waypoint(text: str, path: str | None = None, line: int | None = None) -> Waypoint:
    """`x,y,z`, `x,y,z:x,y,z`, with spaces for commas in files; a seventh number is seconds of rest."""
    try:
        numbers = [float(part) for part in re.split(r"[,:\s]+", text.strip())]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 6, 7) or not np.isfinite(numbers).all():
        raise InputError("a viewpoint X,Y,Z or X,Y,Z:X,Y,Z", path=path, line=line, found=text)
    x, y, z, *rest = numbers
    look_at_m = (rest[0], rest[1], rest[2]) if rest else None
    return Waypoint((x, y, z), look_at_m, rest[3] if len(rest) == 4 else 0.0)


def _point(point_m: tuple | None) -> str:
    return ",".join(f"{x:.2f}" for x in point_m or ())
