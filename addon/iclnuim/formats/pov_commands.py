"""ICL-NUIM's POV-Ray commands, one pose a line: `... +Oscene_00_0012.png ... Declare=val00=... Declare=val32=...`.

A row-vector matrix, LEFT-handed, y up: rows 0 to 2 are the images of the camera's x, y, z axes, row 3 is the position;
metres in the living room, centimetres in the office (unit_m = 0.01).
"""

from __future__ import annotations

import re

import numpy as np

from ..errors import InputError
from ..geometry import axes
from ..geometry.trajectory import Trajectory
from .checks import poses_of_matrices, trajectory_of_frames
from .loaded import OUR_WORLD, LoadedTrajectory, ReadOptions, Source, Taken, unit_warning
from .table import Table, data_lines
from .written import WriteOptions, frame_numbers

COMMAND = "a POV-Ray command with Declare=val00= to Declare=val32="
GOES_TO = "pov-commands: LEFT-handed poses in the POV world (y up), the frame number in the image's name"
#: Where r00 r01 ... r22 stand among val00 val01 ... val32, and the position.
ROTATION, POSITION = [0, 3, 6, 1, 4, 7, 2, 5, 8], slice(9, 12)

_NAMES = [f"val{row}{column}" for row in range(4) for column in range(3)]
_DECLARE = re.compile(
    r"Declare\s*=\s*(val[0-3][0-2])\s*=\s*([-+]?[\d.]+(?:e[-+]?\d+)?)(?=[\s+]|$)", re.IGNORECASE | re.ASCII
)
_OUTPUT = re.compile(r"\+O\S*?(\d{1,9})\.\w+(?=\s|$)", re.ASCII)
_LINE = (
    "povray +Iscene.pov +Oscene_00_%04d.png +W640 +H480 " + " ".join(f"Declare={name}=%.12f" for name in _NAMES) + "\n"
)


def sniff(source: Source) -> bool:
    return any(re.search(r"declare\s*=\s*val\d\d", line, re.IGNORECASE) for line in source.first_lines)


def read(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """POV world -> our world; the frame number is the image's (+O) where all lines have one, else the line's from 0."""
    lines = [(number, line) for number, line in data_lines(source.text) if "declare" in line.lower()]
    if not lines:
        raise InputError(COMMAND, path=source.path, found="no line with Declare")
    values = np.array([_declared(source, number, line) for number, line in lines])
    table = Table(values, lambda row: (source.path, lines[row][0]))
    numbers, counted = _frame_numbers([line for _, line in lines])
    pov = poses_of_matrices(table, values[:, POSITION] * options.unit_m, ROTATION)
    trajectory = trajectory_of_frames(table, numbers, axes.world_cv_from_pov(pov), options.rate_hz)
    sentence = (
        f"pov-commands: LEFT-handed poses in the POV world (y up), turned into {OUR_WORLD}, "
        f"stamps frame/{options.rate_hz:g} s by the number of {counted}"
    )
    return LoadedTrajectory(trajectory, Taken("pov-commands", "left", OUR_WORLD, sentence + unit_warning(trajectory)))


def write(trajectory: Trajectory, options: WriteOptions) -> str:
    """One render command a line; the scene's name is to be filled in by whoever renders."""
    numbers = frame_numbers(trajectory, options.rate_hz)
    pov = axes.pov_from_world_cv(trajectory.T_world_camera)
    rows = np.concatenate([np.swapaxes(pov.rotation, 1, 2), pov.translation[:, None] / options.unit_m], axis=1) + 0.0
    return "".join(
        [_LINE % (number, *row) for number, row in zip(numbers.tolist(), rows.reshape(-1, 12).tolist(), strict=True)]
    )


def _declared(source: Source, number: int, line: str) -> list[float]:
    """The twelve values of one command in order. Raises InputError naming the first that is missing or no number."""
    pairs = _DECLARE.findall(line)
    values = {name.lower(): text for name, text in pairs}
    for name in _NAMES:
        try:
            values[name] = float(values[name])
        except (KeyError, ValueError):
            stands = re.search(rf"{name}\s*=\s*(\S*)", line, re.IGNORECASE)
            found = f"{name}={stands[1]}" if stands else f"no {name}"
            raise InputError(COMMAND, path=source.path, line=number, found=found) from None
    if len(pairs) != 12:
        raise InputError(f"{COMMAND}, each once", path=source.path, line=number, found=f"{len(pairs)} of them")
    return [values[name] for name in _NAMES]


def _frame_numbers(lines: list[str]) -> tuple[np.ndarray, str]:
    """(n,) and what they were taken from."""
    names = [_OUTPUT.search(line) for line in lines]
    if all(names):
        return np.array([float(name[1]) for name in names if name]), "the image's name"
    return np.arange(float(len(lines))), "the line, from 0"
