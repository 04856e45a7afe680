"""Poses that apps on phones export: Record3D's metadata.json, Polycam's folder with one JSON a
frame. Both have the OpenGL camera's axes.
"""

import json
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..formats.files import read_json
from ..geometry.trajectory import FIRST_STAMP_S
from .number_table import NumberTable, PoseColumns
from .source import Source
from .stamps import ticks_unless_frames

#: Columns of Record3D's poses, qx qy qz qw x y z.
QUATERNION_FIRST = PoseColumns((4, 5, 6), (0, 1, 2, 3))
_MATRIX = tuple(f"t_{row}{column}" for row in range(3) for column in range(4))


def is_record3d(source: Source) -> bool:
    """Whether a file is JSON with Record3D's list of poses."""
    if source.path.suffix.lower() != ".json" or '"poses"' not in source.text:
        return False
    try:
        content = json.loads(source.text)
    except ValueError:
        return False
    return isinstance(content, dict) and "poses" in content and not content.get("frames")


def record3d_rows(source: Source) -> NumberTable:
    """(n, 8): the stamp of a frame, its quaternion and its position; (n, 7) without stamps."""
    content = read_json(source.path)
    values = _numbers(source.path, content.get("poses"), "poses as rows qx qy qz qw x y z")
    if values.ndim != 2 or values.shape[1:] != (7,):
        expected = "poses as rows qx qy qz qw x y z"
        raise InputError(expected, path=source.path, found=f"an array {values.shape}")
    stamps_s = record3d_stamps(source.path, content)
    if stamps_s is None:
        return NumberTable(values, lambda row: (source.path, None), columns=QUATERNION_FIRST)
    table = np.column_stack([stamps_s, values])
    columns = QUATERNION_FIRST.shifted(1)
    return NumberTable(table, lambda row: (source.path, None), ticks=1.0, columns=columns)


def record3d_stamps(path: Path, content: dict) -> np.ndarray | None:
    """(n,) seconds of the frames of metadata.json: its times, or else by its frames per second;
    None if it has neither. Raises InputError for values that are no numbers.
    """
    poses = content.get("poses")
    count = len(poses) if isinstance(poses, list) else 0
    times = content.get("frameTimestamps")
    if isinstance(times, list) and len(times) == count > 0:
        return _numbers(path, times, "frameTimestamps in seconds").reshape(-1)
    if content.get("fps") is None:
        return None
    rate = _numbers(path, [content["fps"]], "fps as a number")
    if rate.shape != (1,) or not 1e-3 <= rate[0] <= 1e6:
        raise InputError("fps of 0.001 to 1000000", path=path, found=content["fps"])
    return FIRST_STAMP_S + np.arange(count) / rate[0]


def is_polycam(source: Source) -> bool:
    """Whether a folder has files NUMBER.json."""
    if not source.path.is_dir():
        return False
    return any(path.stem.isdecimal() for path in source.path.glob("*.json"))


def polycam_rows(source: Source) -> NumberTable:
    """(n, 13): the number in the file's name, a frame number or a stamp, and three rows of its
    matrix.
    """
    paths = {int(p.stem): p for p in source.path.glob("*.json") if p.stem.isdecimal()}
    if not paths:
        there = "none" if source.path.is_dir() else "no folder"
        raise InputError("a folder with files NUMBER.json", path=source.path, found=there)
    numbers = sorted(paths)
    found = []
    for number in numbers:
        content = read_json(paths[number])
        what = "t_00 to t_23, the rows of a 3 x 4 matrix"
        given = [content.get(key) for key in _MATRIX]
        found.append([float(number), *_numbers(paths[number], given, what).reshape(-1)])
    values = np.array(found)
    ticks = ticks_unless_frames(values[:, 0])
    return NumberTable(values, lambda row: (paths[numbers[row]], None), ticks)


def _numbers(path: Path, values: object, what: str) -> np.ndarray:
    """The values as an array of floats. Raises InputError for anything that is no number."""
    try:
        numbers = np.array(values)
        if numbers.dtype.kind not in "iuf" or not numbers.size:
            raise ValueError
        return numbers.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(what, path=path, found=" ".join(str(values).split())[:60]) from None
