"""`iclnuim trajectory make`: hand-held trajectories from their recipes, or one through a scene that
keeps clear of its surfaces.
"""

import json
import re
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import (
    atomic_write_text,
    data_lines,
    make_folder,
    read_json,
    read_text,
)
from iclnuim.geometry import handheld
from iclnuim.geometry import trajectory as trajectories
from iclnuim.geometry.handheld_plan import PlanSettings, Waypoint, plan
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.raycast.scene_route import planned_in_rooms, space_around
from iclnuim.trajectory_files.trajectories import TUM_HEADER

from ..isolation import opened_scene
from ..options import Actions, action, add_scene_options, add_settings, settings_from

NAMES = [*shipped.paper_sequences(), *shipped.HARD_SEQUENCES]
_HEADER = (
    f"{'':16}{'frames':>8}{'length':>9}{'mean':>8}{'max':>7} m/s{'mean':>8}{'max':>7} deg/s   scale"
)


def configure(actions: Actions) -> None:
    help = "make hand-held trajectories from their recipes: same recipe, same bytes"
    example = "iclnuim trajectory make office/kt3 --out paths"
    parser = action(actions, "make", help, example, _make)
    parser.set_defaults(opens="scene")
    add = parser.add_argument
    help = "kt2, office/kt0, a recipe file; default: all"
    add("recipes", nargs="*", metavar="NAME|RECIPE", help=help)
    help = "write below DIR instead of next to the recipe"
    add("-o", "--out", type=Path, metavar="DIR", help=help)
    help = "write nothing; exit with 3 if a file differs from the trajectory that its recipe makes"
    add("--check", action="store_true", help=help)
    help = "make a trajectory through this scene instead of recipes"
    add("--scene", metavar="NAME|FILE", help=help)
    help = (
        "positions in metres, z up, each optionally with a point to look at; "
        "or a file with one per line; or auto:N, which chooses N positions"
    )
    add("--viewpoints", nargs="+", metavar="X,Y,Z[:X,Y,Z]", help=help)
    add_settings(parser, PlanSettings)
    add_scene_options(parser)


def _make(args: Namespace, console: Console) -> None:
    if args.scene or args.viewpoints:
        _make_in_scene(args, console)
        return
    made = []
    for name in NAMES if args.recipes in ([], ["all"]) else args.recipes:
        source, target = _places(name, args.out)
        motion = _motion(source)
        text = tum_text(motion.trajectory)
        if args.check:
            _check_same(target, text)
        else:
            _refuse_other(target)
            make_folder(target.parent, hint="another {out}")
            atomic_write_text(target, text)
        figures = asdict(trajectories.trajectory_statistics(motion.trajectory))
        made.append({"name": name, "file": str(target), "scale": motion.scale, **figures})
    console.result({"trajectories": made}, "\n".join([_HEADER, *map(_row, made)]))


def _motion(recipe: Path) -> handheld.Motion:
    content = read_json(recipe)
    try:
        return handheld.make(handheld.Recipe.from_dict(content))
    except InputError as error:
        place = recipe if error.path is None else f"{recipe}: {error.path}"
        raise error.at(place) from None


def _check_same(target: Path, text: str) -> None:
    if not target.is_file():
        raise WorkError(f"{target}: does not exist, so it cannot be checked")
    if target.read_bytes() != text.encode():
        raise WorkError(f"{target}: differs from the trajectory that its recipe makes")


def _row(made: Mapping[str, Any]) -> str:
    return (
        f"{made['name']:16}{made['frames']:8d}{made['length_m']:9.3f}"
        f"{made['mean_speed']:8.3f}{made['max_speed']:7.3f}    "
        f"{made['mean_rotation_rate']:8.1f}{made['max_rotation_rate']:7.1f}"
        f"         {made['scale']:.4f}"
    )


def _refuse_other(target: Path) -> None:
    """Raises InputError if a file exists that is no trajectory as this command writes it."""
    if not target.exists():
        return
    if not target.is_file() or not target.read_bytes().startswith(TUM_HEADER.encode()):
        expected = "no file, or a trajectory that was made before"
        raise InputError(expected, path=target, found="another file", hint="another {out}")


def tum_text(made: Trajectory) -> str:
    """A TUM file with 1e-6 m and 1e-7 in the quaternion: so few digits that rounding differences
    between processors do not appear.
    """
    quat_xyzw = made.T_world_camera.quat_xyzw
    rows = np.column_stack([made.stamps_s, made.positions_m, quat_xyzw + 0.0]).tolist()
    line = "%.6f %.6f %.6f %.6f %.7f %.7f %.7f %.7f\n"
    text = "".join([line % tuple(row) for row in rows])
    return TUM_HEADER + text.replace("-0.000000 ", "0.000000 ").replace("-0.0000000", "0.0000000")


def _places(name: str, out: Path | None) -> tuple[Path, Path]:
    """Files of the recipe and the trajectory, for `kt2`, `office/kt0` or a recipe file."""
    known = f"living_room/{name}" if f"living_room/{name}" in NAMES else name
    if known in NAMES:
        folder = shipped.folder("trajectories")
        return folder / f"{known}.json", (out or folder) / f"{known}.txt"
    source = Path(name)
    if source.suffix != ".json":
        raise InputError(f"one of {', '.join(NAMES)} or a recipe file *.json", found=name)
    return source, (out or source.parent) / f"{source.stem}.txt"


def _make_in_scene(args: Namespace, console: Console) -> None:
    """Plan a trajectory through a scene; write it as NAME.txt (TUM) and its recipe as NAME.json."""
    if not args.scene or not args.viewpoints or args.recipes:
        expected = "--scene and --viewpoints together, and no recipe"
        raise InputError(expected, hint="--viewpoints auto:6")
    settings = settings_from(args, PlanSettings())
    vertices, triangles = _surface(args, console)
    count = _count_to_choose(args.viewpoints)
    scene = Path(args.scene).name
    if count is None:
        waypoints = _waypoints(args.viewpoints)
        space = space_around(waypoints, vertices, triangles)
        made = plan(waypoints, space, scene, settings)
    else:
        made, notes = planned_in_rooms(vertices, triangles, count, scene, settings)
        for note in notes:
            console.note(note)
    name = (args.out or Path()) / Path(args.scene).stem
    recipe = json.dumps(asdict(made.recipe), indent=2) + "\n"
    _write_both(name, recipe, tum_text(made.motion.trajectory))
    figures = asdict(trajectories.trajectory_statistics(made.motion.trajectory))
    text = (
        f"{name}.txt: {figures['frames']} poses, {figures['length_m']:.2f} m, "
        f"{figures['mean_speed']:.3f} m/s, {figures['mean_rotation_rate']:.1f} deg/s, "
        f"at least {made.clearance_m:.3f} m from every surface; its recipe is {name}.json"
    )
    names = {"file": f"{name}.txt", "recipe": f"{name}.json"}
    console.result({**names, "clearance_m": made.clearance_m, **figures}, text)


def _surface(args: Namespace, console: Console) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) in metres and triangles (m, 3) of the scene."""
    file = args.scene
    if file not in shipped.SCENE_NAMES:
        file = str(Path(file).resolve())
    reading = settings_from(args, SceneReading())
    what = "a trajectory through a scene"
    reads = [Path(given) for given in args.viewpoints or ()]
    with opened_scene(what, file, reading, reads, [args.out or Path()]) as notes:
        from iclnuim.blender import surfaces

        found = surfaces.triangles()
    for note in notes:
        console.note(f"note: {note}")
    if not len(found.triangles):
        raise InputError("a scene with surfaces", path=args.scene, found="none")
    return found.vertices, found.triangles


def _count_to_choose(texts: list[str]) -> int | None:
    """The number of viewpoints of `auto` or `auto:N`; None if they are given."""
    auto = re.fullmatch(r"auto(?::(\d+))?", texts[0])
    if auto is None or len(texts) > 1:
        return None
    return int(auto[1] or 6)


def _write_both(name: Path, recipe: str, trajectory: str) -> None:
    """Write NAME.json and NAME.txt, unless one exists with other content."""
    texts = {name.with_suffix(".json"): recipe, name.with_suffix(".txt"): trajectory}
    for file, text in texts.items():
        if file.exists() and file.read_bytes() != text.encode():
            found = "a file with other content"
            raise InputError("a new file name", path=file, found=found, hint="another {out}")
    make_folder(name.parent, hint="another {out}")
    for file, text in texts.items():
        atomic_write_text(file, text)


def _waypoints(texts: list[str]) -> list[Waypoint]:
    if len(texts) == 1 and Path(texts[0]).is_file():
        rows = data_lines(read_text(texts[0]))
        if not rows:
            raise InputError("viewpoints", path=texts[0], found="comments alone")
        return [_waypoint(row, path=texts[0], line=k) for k, row in rows]
    return [_waypoint(text) for text in texts]


def _waypoint(text: str, path: str | None = None, line: int | None = None) -> Waypoint:
    """Parse `x,y,z` or `x,y,z:x,y,z`; files may have spaces instead of commas.

    A seventh number is a pause in seconds.
    """
    text = text.strip()
    try:
        numbers = [float(part) for part in re.split(r"[,:\s]+", text)]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 6, 7) or not np.isfinite(numbers).all():
        raise InputError("a viewpoint X,Y,Z or X,Y,Z:X,Y,Z", path=path, line=line, found=text)
    x, y, z, *rest = numbers
    if not rest:
        return Waypoint((x, y, z))
    return Waypoint((x, y, z), (rest[0], rest[1], rest[2]), *rest[3:])
