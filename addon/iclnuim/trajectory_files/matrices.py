"""Poses as matrices: blocks of text, alone or each after a line with its frame number, as in the
.log files of Redwood's data sets, of the augmented ICL-NUIM data set and of Open3D; the folders of
ScanNet, 7-Scenes and BundleFusion with one file per frame; transforms.json of NeRF programs; Open3D's
camera trajectories.
"""

import itertools
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PurePath

import numpy as np

from ..errors import InputError
from ..formats.files import data_lines, is_number, read_json
from .number_table import NumberTable
from .source import Source
from .stamps import ticks_unless_frames

_MATRIX = "a 4 x 4 matrix"
#: Key of transforms.json: units of length of its poses per metre.
APPLIED_SCALE = "applied_scale"
_BLOCKS = "blocks of a 4x4 matrix that ends in 0 0 0 1"
_NUMBERED = (
    f"{_BLOCKS}, each after a line with its frame number (once, or twice and a third number)"
)
#: Names of files with one pose, without their ending: 12 (ScanNet), frame-000012.pose (7-Scenes).
_POSE_NAME = re.compile(r"(?:frame-)?([0-9]{1,19})(?:\.pose)?")
#: Numbers on the first line of a block, without and with a line of frame numbers.
_LENGTHS_BY_HEAD = ((4,), (1, 3))


def is_blocks(source: Source) -> bool:
    """Whether a file starts with a 4x4 matrix, or with one or three numbers and four after them."""
    rows = source.first_rows
    lengths = [len(row) for row in rows]
    if len(rows) < 4 or not source.starts_with_numbers:
        return False
    if lengths == [4, 4, 4, 4]:
        return all(map(is_number, rows[3])) and [float(field) for field in rows[3]] == [0, 0, 0, 1]
    return lengths[0] in (1, 3) and lengths[1:] == [4, 4, 4]


def block_rows(source: Source) -> NumberTable:
    """(n, 12), or (n, 13) with the frame number first.

    Raises InputError with the line where a block is not as expected.
    """
    lines = data_lines(source.table)
    head = int(source.columns != 4)
    starts = range(0, len(lines), 4 + head)
    blocks = [lines[start : start + 4 + head] for start in starts]
    values = np.array([_block_values(source, block, head) for block in blocks])
    return NumberTable(values, lambda row: (source.path, blocks[row][0][0]))


def _block_values(source: Source, block: list[tuple[int, str]], head: int) -> list[float]:
    """The frame number, if there is one, and the first three rows of the matrix."""
    rows = [line.split(source.delimiter) for _, line in block]
    fields = list(itertools.chain.from_iterable(rows))
    lengths = [len(row) for row in rows]
    expected = _NUMBERED if head else _BLOCKS
    found = "a block of another length"
    words = [field for field in fields if not is_number(field)]
    if words:
        found = repr(words[0].strip()[:40])
    elif lengths[head:] == [4, 4, 4, 4] and lengths[0] in _LENGTHS_BY_HEAD[head]:
        values = np.array(fields, float)
        lost = not np.isfinite(values[-4:]).all()
        whole = lost or np.abs(values[-4:] - (0, 0, 0, 1)).max() <= 1e-6
        if whole and (lengths[0] != 3 or values[0] == values[1]):
            return [*values[:head].tolist(), *values[-16:-4].tolist()]
        found = " ".join(f"{value:g}" for value in (*values[:-16], *values[-4:]))
    raise InputError(expected, path=source.path, line=block[0][0], found=found)


def is_scannet(source: Source) -> bool:
    """Whether a folder has files 0.txt, 1.txt and so on, or frame-000000.pose.txt."""
    return source.path.is_dir() and bool(_pose_files(source.path))


def scannet_rows(source: Source) -> NumberTable:
    """(n, 13): the number in the file's name, and three rows of its matrix.

    Files of lost frames (-inf) are left out.
    """
    paths = _pose_files(source.path)
    found = []
    for number in sorted(paths):
        values = _numbers(paths[number], Source(paths[number]).text.split())
        if np.isfinite(values).all():
            found.append((float(number), *_rows_of(paths[number], values)))
    if not found:
        raise InputError("pose files with finite numbers", path=source.path, found="none")
    return NumberTable(np.array(found), lambda row: (paths[int(found[row][0])], None))


def _pose_files(folder: Path) -> dict[int, Path]:
    """The files of a folder with one pose by their numbers."""
    named = ((_POSE_NAME.fullmatch(path.stem), path) for path in folder.glob("*.txt"))
    return {int(name[1]): path for name, path in named if name}


def numbers_of_names(names: Sequence[str]) -> list[int]:
    """The frame numbers or stamps at the ends of images' names, without their endings; if they are
    not all there and distinct, the places in the list.
    """
    found = [re.search(r"(\d{1,19})$", PurePath(name).stem, re.ASCII) for name in names]
    numbers = [int(number[1]) for number in found if number]
    return numbers if len(set(numbers)) == len(names) else list(range(len(names)))


def nerf_rows(source: Source) -> NumberTable:
    """(n, 13): the number or stamp at the end of the image's name, or else the frame's index in the
    list, and three rows of its matrix, with positions in metres: those of the file divided by its
    applied_scale.
    """
    content = read_json(source.path)
    frames = content.get("frames")
    valid = isinstance(frames, list) and all(isinstance(frame, dict) for frame in frames)
    if not frames or not valid:
        raise InputError("a list of frames", path=source.path)
    scale = _applied_scale(source.path, content)
    numbers = numbers_of_names([str(frame.get("file_path")) for frame in frames])
    found = []
    for number, frame in zip(numbers, frames, strict=True):
        matrix = frame.get("transform_matrix")
        rows = matrix if isinstance(matrix, list) else []
        flat = itertools.chain.from_iterable(row for row in rows if isinstance(row, list))
        values = _numbers(source.path, list(flat))
        if len(values) == 12 and len(rows) == 3:
            values = np.append(values, (0, 0, 0, 1))
        pose = _rows_of(source.path, values)
        pose[3::4] = [position / scale for position in pose[3::4]]
        found.append((float(number), *pose))
    values = np.array(sorted(found))
    ticks = ticks_unless_frames(values[:, 0])
    return NumberTable(values, lambda row: (source.path, None), ticks)


def _applied_scale(path: Path, content: dict) -> float:
    """How many units of the positions a metre has, which nerfstudio's converters write."""
    given = content.get(APPLIED_SCALE, 1.0)
    with suppress(TypeError, ValueError, OverflowError):
        if 1e-6 <= float(given) <= 1e6:
            return float(given)
    raise InputError(f"{APPLIED_SCALE} of 1e-6 to 1e6", path=path, found=given)


def is_open3d(source: Source) -> bool:
    """Whether a file is JSON with the class of Open3D's camera trajectories."""
    return source.path.suffix.lower() == ".json" and '"PinholeCameraTrajectory"' in source.text


def open3d_rows(source: Source) -> NumberTable:
    """(n, 12): three rows of each world-to-camera matrix; in the file it is column by column."""
    content = read_json(source.path)
    matrices = content.get("extrinsic")  # of the first versions, with one camera
    cameras = content.get("parameters", [])
    if isinstance(cameras, list) and all(isinstance(camera, dict) for camera in cameras):
        matrices = [camera.get("extrinsic") for camera in cameras] or matrices
    if not matrices or not isinstance(matrices, list):
        raise InputError("a list of parameters with extrinsic", path=source.path)
    found = []
    for matrix in matrices:
        values = _numbers(source.path, matrix if isinstance(matrix, list) else [])
        if len(values) == 16:
            values = values.reshape(4, 4).T.ravel()
        found.append(_rows_of(source.path, values))
    return NumberTable(np.array(found), lambda row: (source.path, None))


def _numbers(path: Path, values: list) -> np.ndarray:
    try:
        return np.array([float(value) for value in values])
    except (TypeError, ValueError, OverflowError):
        raise InputError(_MATRIX, path=path, found=str(values)) from None


def _rows_of(path: Path, values: np.ndarray) -> list[float]:
    """The first three rows of a matrix.

    Raises InputError unless there are 16 numbers that end in 0 0 0 1.
    """
    whole = len(values) == 16 and np.isfinite(values).all()
    if not whole or np.abs(values[12:] - (0, 0, 0, 1)).max() >= 1e-6:
        found = " ".join(f"{value:g}" for value in values)
        raise InputError(f"{_MATRIX} that ends in 0 0 0 1", path=path, found=found)
    return values[:12].tolist()
