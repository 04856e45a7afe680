"""ICL-NUIM's `*.gt.sim`: blocks of three lines `r00 r01 r02 tx`, a blank line between; LEFT-handed (y up).

Anchored at image 0, and without an index: block k, from 0, belongs to image k + 1.
"""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..geometry import axes
from ..geometry.trajectory import Trajectory
from .checks import poses_of_matrices, trajectory_of_frames
from .freiburg import ANCHORED_WORLD, anchored
from .loaded import LoadedTrajectory, ReadOptions, Source, Taken
from .matrix_rows import POSITION, ROTATION, matrix_columns
from .table import Table, data_lines, read_table
from .written import WriteOptions

COLUMNS = "blocks of 3 lines with 4 columns: r00 r01 r02 tx"
GOES_TO = "gt.sim: blocks for images 1, 2, ..., LEFT-handed y-up poses, placed so that image 0 is the original's start"


def sniff(source: Source) -> bool:
    """Named `*.gt.sim`, or lines of four numbers."""
    return source.name.endswith(".gt.sim") or (source.columns == 4 and source.starts_with_numbers)


def read(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """Left-handed poses become right-handed by axes.mirrored_y; stamp = (k + 1) / rate."""
    table = _blocks(source)
    left = poses_of_matrices(table, table.values[:, POSITION] * options.unit_m, ROTATION)
    numbers = np.arange(1.0, len(left) + 1)
    trajectory = trajectory_of_frames(table, numbers, axes.mirrored_y(left), options.rate_hz)
    sentence = (
        f"gt.sim: LEFT-handed y-up poses made right-handed by mirroring y, block k taken as image k+1, "
        f"stamps (k+1)/{options.rate_hz:g} s, in {ANCHORED_WORLD}; anchored at image 0, up to 8 mm off gt.freiburg"
    )
    return LoadedTrajectory(trajectory, Taken("gt.sim", "left", ANCHORED_WORLD, sentence))


def write(trajectory: Trajectory, options: WriteOptions) -> str:
    """The text of a gt.sim file. Raises InputError where frames are missing, since blocks carry no number."""
    numbers, left = anchored(trajectory, 0, options)
    if numbers[-1] != len(numbers):
        raise InputError(
            "frames 1, 2, 3, ... without a gap to write gt.sim", found=f"{len(numbers)} frames up to {numbers[-1]}"
        )
    row = "%.12f %.12f %.12f %.9f\n"
    return "\n".join([(row * 3) % tuple(block) for block in matrix_columns(left, options.unit_m).tolist()])


def _blocks(source: Source) -> Table:
    """(n, 12). Raises InputError for the first block that does not stand on three lines one below the other."""
    lines = read_table(source.path, source.text, (4,), COLUMNS)
    numbers = [number for number, _ in data_lines(source.text)]
    for k in range(0, len(numbers), 3):
        if numbers[k : k + 3] != [numbers[k], numbers[k] + 1, numbers[k] + 2]:
            raise InputError(COLUMNS, path=source.path, line=numbers[k], found="a block of another length")
    return Table(lines.values.reshape(-1, 12), lambda k: (source.path, numbers[3 * k]))
