"""ICL-NUIM's own files, all LEFT-handed and y up, in metres in the living room and centimetres in
the office (unit_m = 0.01).

POV-Ray's commands have one pose per line: `... +Oscene_00_0012.png ... Declare=val00=...
Declare=val32=...`. The matrix multiplies row vectors: rows 0 to 2 are the images of the camera's x,
y, z axes, row 3 is the position. Camera files, one per frame in a folder, contain `cam_pos = [91,
465, -292]';` and so on; z = dir/|dir|, x = up x z normalised, y = z x x.

The anchored formats gt.freiburg and gt.sim have poses that start at the official files' start.
"""

import math
import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..errors import InputError, within
from ..formats.files import data_lines, read_text
from ..formats.image_names import files_in
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .number_table import NumberTable, read_table
from .source import FileOptions, Source
from .stamps import frame_numbers

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

ANCHORED_WORLD = (
    "the original's anchored frame made right-handed "
    "(the first camera's axes: x right, y down, z forward)"
)
#: Start of the official files: living room, office. Office kt0, whose first image is missing,
#: starts 9 mm away.
OFFICIAL_STARTS_Z_M = (-2.25, -2.5)
START_TOLERANCE_M = 0.02
_MATRICES = "12 columns of a 3x4 matrix, or 13 with the frame number first"
_BLOCKS = "blocks of 3 lines with 4 columns: r00 r01 r02 tx"


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


def starts_as_official(position_m: np.ndarray) -> bool:
    """Whether a first position (3,) is that of the official living-room or office files, within 2
    cm on each axis.
    """
    starts_m = [(0.0, 0.0, z) for z in OFFICIAL_STARTS_Z_M]
    return any(np.abs(position_m - start_m).max() <= START_TOLERANCE_M for start_m in starts_m)


def pov_matrix_rows(source: Source) -> NumberTable:
    """(n, 12) rows of a 3x4 matrix, or (n, 13) with the frame number first."""
    return read_table(source, (12, 13), _MATRICES)


def sim_rows(source: Source) -> NumberTable:
    """(n, 13): the image's number, k + 1 for block k from 0, and three rows of its matrix.

    Raises InputError for the first block that is not on three consecutive lines.
    """
    lines = read_table(source, (4,), _BLOCKS)
    numbers = [number for number, _ in data_lines(source.text)]
    for k in range(0, len(numbers), 3):
        if numbers[k : k + 3] != [numbers[k], numbers[k] + 1, numbers[k] + 2]:
            found = "a block of another length"
            raise InputError(_BLOCKS, path=source.path, line=numbers[k], found=found)
    values = lines.values.reshape(-1, 12)
    images = np.arange(1.0, len(values) + 1)
    return NumberTable(np.column_stack([images, values]), lambda k: (source.path, numbers[3 * k]))


def at_image_1(trajectory: Trajectory, options: FileOptions) -> tuple[np.ndarray, SE3]:
    """Frame numbers and poses of gt.freiburg, where image 1 is at the official start."""
    return _anchored(trajectory, 1, options)


def at_image_0(trajectory: Trajectory, options: FileOptions) -> tuple[np.ndarray, SE3]:
    """Frame numbers and poses of gt.sim, where image 0 would be at the official start.

    Raises InputError if frames are missing, because blocks have no frame number.
    """
    numbers, poses = _anchored(trajectory, 0, options)
    if numbers[-1] != len(numbers):
        found = f"{len(numbers)} frames up to {numbers[-1]}"
        raise InputError("frames 1, 2, 3, ... without a gap to write gt.sim", found=found)
    return numbers, poses


def _anchored(trajectory: Trajectory, anchor: int, options: FileOptions) -> tuple[np.ndarray, SE3]:
    """Frame numbers (n,), 1 or larger, and their right-handed poses, with the pose of image
    `anchor` at (0, 0, start_z_m).

    T(i) = [I, (0, 0, start)] T_pov(anchor)^-1 T_pov(i). If image `anchor` is missing, the first
    written image is used instead. Poses that already start like the official files are not moved.
    """
    numbers = frame_numbers(trajectory.stamps_s, options.rate_hz)
    kept = numbers >= 1
    if not kept.any():
        expected = "poses of image 1 or later (image 0 has none in this format)"
        raise InputError(expected, found="image 0 alone")
    T = trajectory.T_world_camera
    shown = T[kept]
    if not starts_as_official(shown.translation[0]):
        at_anchor = np.flatnonzero(numbers == anchor)
        reference = T[int(at_anchor[0])] if at_anchor.size else shown[0]
        start = SE3(np.eye(3), np.array([0.0, 0.0, options.start_z_m]))
        shown = start @ reference.inverse() @ shown
    return numbers[kept], shown
