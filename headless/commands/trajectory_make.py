"""`iclnuim trajectory make`: the hand-held paths kt0..kt3 of both scenes, or one's own, made from their recipes."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.columns import TUM_HEADER
from iclnuim.formats.files import atomic_write_text, read_json
from iclnuim.geometry import handheld, trajectory
from iclnuim.geometry.handheld_recipe import Recipe

from ..console import Console
from ..options import Actions, action
from . import trajectory_walk

NAMES = [f"{scene}/{kt}" for scene in shipped.SCENE_NAMES for kt in shipped.TRAJECTORY_NAMES]


def configure(actions: Actions) -> None:
    """Add the action `make` below `iclnuim trajectory`."""
    text = "make hand-held trajectories from their recipes: same recipe, same bytes"
    parser = action(actions, "make", text, "iclnuim trajectory make office/kt3 --out paths", run)
    parser.add_argument("recipes", nargs="*", metavar="NAME|RECIPE", help="kt2, office/kt0, a recipe file; or all")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write below DIR instead of beside the recipe")
    parser.add_argument("--check", action="store_true", help="write nothing; exit 3 where the file is not what is made")
    trajectory_walk.add_walk_options(parser)


def run(args: argparse.Namespace, console: Console) -> None:
    if args.scene or args.viewpoints:
        trajectory_walk.run(args, console)
        return
    made = []
    for name in args.recipes or NAMES:
        source, target = _places(name, args.out)
        motion = _motion(source)
        _finish(target, tum_text(motion.trajectory), args.check)
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
        return handheld.make(Recipe.from_dict(content))
    except InputError as error:
        error.args = (f"{source}: {error}",)
        raise


def _finish(target: Path, text: str, check: bool) -> None:
    if not check:
        target.parent.mkdir(parents=True, exist_ok=True)
        atomic_write_text(target, text)
    elif not target.is_file():
        raise WorkError(f"{target}: not there to be checked")
    elif target.read_bytes() != text.encode():
        raise WorkError(f"{target}: not what its recipe makes")


def _table(made: list[dict]) -> str:
    head = f"{'':16}{'frames':>8}{'length':>9}{'mean':>8}{'max':>7} m/s{'mean':>8}{'max':>7} deg/s   scale"
    rows = [
        f"{f['name']:16}{f['frames']:8d}{f['length_m']:9.3f}{f['mean_speed']:8.3f}{f['max_speed']:7.3f}    "
        f"{f['mean_rotation_rate']:8.1f}{f['max_rotation_rate']:7.1f}         {f['scale']:.4f}"
        for f in made
    ]
    return "\n".join([head, *rows])
