"""ICL-NUIM's own anchored formats: left-handed poses that start at the official files' start."""

import numpy as np

from ..errors import InputError
from ..formats.files import data_lines
from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .columns import NumberTable, read_table
from .source import FileOptions, Source
from .stamps import frame_numbers
from .writer import Given

ANCHORED_WORLD = (
    "the original's anchored frame made right-handed "
    "(the first camera's axes: x right, y down, z forward)"
)
#: Start of the official files: living room, office. Office kt0, whose first image is missing,
#: starts 9 mm away.
OFFICIAL_STARTS_Z_M = (-2.25, -2.5)
START_TOLERANCE_M = 0.02
_BLOCKS = "blocks of 3 lines with 4 columns: r00 r01 r02 tx"


def starts_as_official(position_m: np.ndarray) -> bool:
    """Whether a first position (3,) is that of the official living-room or office files, within 2
    cm on each axis.
    """
    starts_m = [(0.0, 0.0, z) for z in OFFICIAL_STARTS_Z_M]
    return any(np.abs(position_m - start_m).max() <= START_TOLERANCE_M for start_m in starts_m)


def block_rows(source: Source) -> NumberTable:
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


def at_image_1(trajectory: Trajectory, options: FileOptions) -> Given:
    """Frame numbers and poses of gt.freiburg, where image 1 is at the official start."""
    return _anchored(trajectory, 1, options)


def at_image_0(trajectory: Trajectory, options: FileOptions) -> Given:
    """Poses of gt.sim, where image 0 would be at the official start.

    Raises InputError if frames are missing, because blocks have no frame number.
    """
    numbers, left = _anchored(trajectory, 0, options)
    if numbers[-1] != len(numbers):
        found = f"{len(numbers)} frames up to {numbers[-1]}"
        raise InputError("frames 1, 2, 3, ... without a gap to write gt.sim", found=found)
    return None, left


def _anchored(trajectory: Trajectory, anchor: int, options: FileOptions) -> tuple[list[int], SE3]:
    """n frame numbers, starting at 1 or later, and their left-handed poses, with the pose of image
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
    return numbers[kept].tolist(), axes.mirrored_y(shown)
