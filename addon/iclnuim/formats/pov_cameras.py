"""Folders of ICL-NUIM's POV-Ray camera files, one a frame: `cam_pos = [91, 465, -292]';` and so on. LEFT-handed, y up.

z = dir/|dir|, x = up x z normalised, y = z x x; metres in the living room, centimetres in the office (unit_m = 0.01).
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..geometry import axes
from .checks import poses_of_matrices, trajectory_of_frames
from .files import read_text
from .loaded import OUR_WORLD, LoadedTrajectory, ReadOptions, Source, Taken, unit_warning
from .pov_commands import POSITION, ROTATION
from .table import Table

FOLDER = "a folder of POV-Ray camera files (scene_00_0000.txt and so on)"


def sniff(source: Source) -> bool:
    """A folder, or a single camera file."""
    return source.is_folder or any(re.match(r"cam_\w+\s*=", line) for line in source.first_lines)


def read(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """POV world -> our world; the frame number is the last number in the file's name."""
    files = _numbered(source.path) if source.is_folder else [(_number(source.path) or 0, source.path)]
    values = np.array([_camera(path) for _, path in files])
    table = Table(values, lambda row: (files[row][1], None))
    pov = poses_of_matrices(table, values[:, POSITION] * options.unit_m, ROTATION)
    numbers = np.array([float(number) for number, _ in files])
    trajectory = trajectory_of_frames(table, numbers, axes.world_cv_from_pov(pov), options.rate_hz)
    sentence = (
        f"pov-cameras: LEFT-handed poses of POV-Ray camera files (y up), turned into {OUR_WORLD}, "
        f"stamps frame/{options.rate_hz:g} s by the number in the file's name"
    )
    return LoadedTrajectory(trajectory, Taken("pov-cameras", "left", OUR_WORLD, sentence + unit_warning(trajectory)))


def _numbered(folder: Path) -> list[tuple[int, Path]]:
    """(frame number, file) of all text files whose name ends in a number, in the order of the numbers."""
    found = [(number, path) for path in folder.glob("*.txt") if (number := _number(path)) is not None]
    if not found:
        raise InputError(FOLDER, path=folder, found="no such file in it", hint="the trajectory file itself")
    found.sort()
    for (before, first), (number, second) in zip(found, found[1:], strict=False):
        if number == before:
            raise InputError("one camera file a frame", path=second, found=f"frame {number} again, as in {first.name}")
    return found


def _number(path: Path) -> int | None:
    digits = re.search(r"(\d{1,18})$", path.stem, re.ASCII)
    return int(digits[1]) if digits else None


def _camera(path: Path) -> list[float]:
    """Twelve numbers: the camera's x, y, z axes and position in the POV world. Raises InputError naming the file."""
    text = read_text(path, "a POV-Ray camera file")
    position, direction, up = (_vector(path, text, name) for name in ("cam_pos", "cam_dir", "cam_up"))
    z = _normalised(direction)
    x = _normalised(np.cross(_normalised(up), z))
    if not (np.isfinite(z).all() and np.isfinite(x).all()):
        raise InputError(
            "cam_dir and cam_up that span a plane", path=path, found=f"{direction.tolist()} and {up.tolist()}"
        )
    return [*x, *np.cross(z, x), *z, *position]


def _vector(path: Path, text: str, name: str) -> np.ndarray:
    """(3,) finite numbers of `name = [a, b, c]';`."""
    expected = f"{name} = [x, y, z]';"
    item = re.search(rf"^\s*{name}\s*=\s*(.*)$", text, re.MULTILINE)
    if not item:
        raise InputError(expected, path=path, found=f"no {name}")
    line = text.count("\n", 0, item.start(1)) + 1
    inside = re.fullmatch(r"\[(.*)\]\s*'?\s*;?\s*", item[1])
    try:
        values = np.array([float(part) for part in inside[1].split(",")] if inside else [])
    except ValueError:
        values = np.array([])
    if values.shape != (3,) or not np.isfinite(values).all():
        raise InputError(expected, path=path, line=line, found=item[0].strip())
    return values


def _normalised(vector: np.ndarray) -> np.ndarray:
    """Length one; NaN where there is next to no length."""
    length = math.hypot(*vector)
    return vector / length if 1e-9 < length < 1e9 else np.full(3, np.nan)
