"""ICL-NUIM's POV-Ray files: LEFT-handed, y up; metres in the living room, centimetres in the office
(unit_m = 0.01).

Commands have one pose per line: `... +Oscene_00_0012.png ... Declare=val00=... Declare=val32=...`.
The matrix multiplies row vectors: rows 0 to 2 are the images of the camera's x, y, z axes, row 3 is
the position. Camera files, one per frame in a folder, contain `cam_pos = [91, 465, -292]';` and so
on; z = dir/|dir|, x = up x z normalised, y = z x x.
"""

import math
import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..errors import InputError, within
from ..formats.files import data_lines, read_text
from ..formats.image_names import files_in
from .columns import NumberTable
from .source import Source

FOLDER = "a folder of POV-Ray camera files (scene_00_0000.txt and so on)"
COMMAND = "a POV-Ray command with Declare=val00= to Declare=val32="
_NAMES = [f"val{number // 3}{number % 3}" for number in range(12)]
_DECLARE = re.compile(
    r"Declare\s*=\s*(val[0-3][0-2])\s*=\s*([-+]?[\d.]+(?:e[-+]?\d+)?)(?=[\s+]|$)",
    re.IGNORECASE | re.ASCII,
)
_OUTPUT = re.compile(r"\+O\S*?(\d{1,9})\.\w+(?=\s|$)", re.ASCII)
COMMAND_LINE = (
    "povray +Iscene.pov +Oscene_00_%04d.png +W640 +H480 "
    + " ".join(f"Declare={name}=%.12f" for name in _NAMES)
    + "\n"
)


def command_rows(source: Source) -> NumberTable:
    """(n, 13): the number in the image's name (+O), and val00 to val32; (n, 12) without the number
    if not all lines have one.
    """
    lines = [found for found in data_lines(source.text) if "declare" in found[1].lower()]
    if not lines:
        raise InputError(COMMAND, path=source.path, found="no line with Declare")
    values = np.array([_declared(source, number, line) for number, line in lines])
    names = [name[1] for _, line in lines if (name := _OUTPUT.search(line))]
    if len(names) == len(lines):
        values = np.column_stack([np.array(names, float), values])
    return NumberTable(values, lambda row: (source.path, lines[row][0]))


def _declared(source: Source, number: int, line: str) -> list[float]:
    """The twelve values of one command in order.

    Raises InputError naming the first that is missing or no number.
    """
    pairs = _DECLARE.findall(line)
    values = {name.lower(): text for name, text in pairs}
    for name in _NAMES:
        try:
            values[name] = float(values[name])
        except (KeyError, ValueError):
            found_text = re.search(rf"{name}\s*=\s*(\S*)", line, re.IGNORECASE)
            found = f"{name}={found_text[1]}" if found_text else f"no {name}"
            raise InputError(COMMAND, path=source.path, line=number, found=found) from None
    if len(pairs) != 12:
        found = f"{len(pairs)} of them"
        raise InputError(f"{COMMAND}, each once", path=source.path, line=number, found=found)
    return [values[name] for name in _NAMES]


def camera_rows(source: Source) -> NumberTable:
    """(n, 13): the last number in the file's name, the camera's axes and position as val00 to val32
    of a command.
    """
    files = [(_number(source.path) or 0, source.path)]
    if source.path.is_dir():
        files = _numbered(source.path)
    values = np.array([[float(number), *_camera(path)] for number, path in files])
    return NumberTable(values, lambda row: (files[row][1], None))


def _numbered(folder: Path) -> list[tuple[int, Path]]:
    """(frame number, file) of all text files whose name ends in a number, in the order of the
    numbers.
    """
    files: dict[int, Path] = {}
    for path in files_in(folder, "*.txt"):
        number = _number(path)
        if number in files:
            found = f"frame {number} again, as in {files[number].name}"
            raise InputError("one camera file per frame", path=path, found=found)
        if number is not None:
            files[number] = path
    if not files:
        hint = "the trajectory file itself"
        raise InputError(FOLDER, path=folder, found="no such file in it", hint=hint)
    return sorted(files.items())


def _number(path: Path) -> int | None:
    digits = re.search(r"(\d{1,18})$", path.stem, re.ASCII)
    return int(digits[1]) if digits else None


def _camera(path: Path) -> list[float]:
    """Twelve numbers: the camera's x, y, z axes and position in the POV world.

    Raises InputError naming the file.
    """
    text = read_text(path, "a POV-Ray camera file")
    position = _vector(path, text, "cam_pos")
    direction = _vector(path, text, "cam_dir")
    up = _vector(path, text, "cam_up")
    with within(path):
        return [*camera_axes(direction, up).ravel(), *position]


def camera_axes(direction: np.ndarray, up: np.ndarray) -> np.ndarray:
    """(3, 3), in rows: the x, y, z axes of a camera that looks along `direction` (3,) with `up`
    (3,) upwards, in the POV world. Raises InputError.
    """
    z = _normalised(direction)
    x = _normalised(np.cross(_normalised(up), z))
    if not (np.isfinite(z).all() and np.isfinite(x).all()):
        found = f"{direction.tolist()} and {up.tolist()}"
        raise InputError("cam_dir and cam_up that span a plane", found=found)
    return np.array([x, np.cross(z, x), z])


def _vector(path: Path, text: str, name: str) -> np.ndarray:
    """(3,) finite numbers of `name = [a, b, c]';`."""
    expected = f"{name} = [x, y, z]';"
    item = re.search(rf"^\s*{name}\s*=\s*(.*)$", text, re.MULTILINE)
    if not item:
        raise InputError(expected, path=path, found=f"no {name}")
    line = text.count("\n", 0, item.start(1)) + 1
    inside = re.fullmatch(r"\[(.*)\]\s*'?\s*;?\s*", item[1])
    values = np.array([])
    if inside:
        with suppress(ValueError):
            values = np.array([float(part) for part in inside[1].split(",")])
    if values.shape != (3,) or not np.isfinite(values).all():
        raise InputError(expected, path=path, line=line, found=item[0].strip())
    return values


def _normalised(vector: np.ndarray) -> np.ndarray:
    """The unit vector; NaN for a vector that is nearly 0 or too long."""
    length = math.hypot(*vector)
    return vector / length if 1e-9 < length < 1e9 else np.full(3, np.nan)
