"""Which format a trajectory file has, by its name and content."""

import re

import numpy as np

from ..errors import InputError
from . import colmap, pose_folders
from .anchored import starts_as_official
from .files import data_lines
from .number_rows import VSLAM_LAB_STAMP
from .trajectory_source import Source


def is_nerf(source: Source) -> bool:
    """Whether a file is JSON."""
    return source.path.suffix.lower() == ".json" and source.text.lstrip().startswith("{")


def is_pov_camera(source: Source) -> bool:
    """Whether a file has lines of a POV-Ray camera, or the path is a folder."""
    if source.path.is_dir():
        return True
    return any(re.match(r"cam_\w+\s*=", line) for line in source.first_lines)


def is_pov_command(source: Source) -> bool:
    """Whether a line declares val00 and so on."""
    return any(re.search(r"(?i)declare\s*=\s*val\d\d", line) for line in source.first_lines)


def is_freiburg(source: Source) -> bool:
    """Whether a file is named `*.gt.freiburg`, or has frame ids and starts like the official files,
    unless its header contains "right-handed".

    No other file is read as left-handed: poses do not show their handedness, and whole-number
    stamps alone are not sufficient.
    """
    if source.name.endswith(".gt.freiburg"):
        return True
    if source.columns != 8 or "right-handed" in source.header:
        return False
    try:
        rows = [[float(field) for field in line.split()[:4]] for line in source.first_lines]
    except ValueError:
        return False
    return all(row[0].is_integer() for row in rows) and starts_as_official(np.array(rows[0][1:]))


def is_sim(source: Source) -> bool:
    """Whether a file is named `*.gt.sim`, or starts with four numbers."""
    if source.name.endswith(".gt.sim"):
        return True
    return source.columns == 4 and source.starts_with_numbers


def is_vslam_lab(source: Source) -> bool:
    """Whether the first line has the names of VSLAM-LAB's columns."""
    return "".join(source.first_lines[:1]).lower().startswith(VSLAM_LAB_STAMP)


def is_euroc(source: Source) -> bool:
    """Whether a line has a comma."""
    return any("," in line for line in source.first_lines)


def is_pov_matrix(source: Source) -> bool:
    """Whether a file of 3x4 matrices has "pov" in its name or header."""
    return is_kitti(source) and ("pov" in source.name or "pov" in source.header)


def is_kitti(source: Source) -> bool:
    """Whether the first line has the columns of a 3x4 matrix, or a number before them."""
    return source.columns in (12, 13)


def is_replica(source: Source) -> bool:
    """Whether the first line has the numbers of a 4x4 matrix."""
    return source.columns == 16 and source.starts_with_numbers


def is_colmap(source: Source) -> bool:
    """Whether the first line is one of COLMAP's images."""
    return bool(source.first_lines) and colmap.names_an_image(source.first_lines[0])


def is_tartanair(source: Source) -> bool:
    """Whether the first line has seven numbers that end in a unit quaternion, or a lost pose."""
    if source.columns != 7 or not source.starts_with_numbers:
        return False
    quaternion = [float(field) for field in source.first_lines[0].split()[3:]]
    norm = np.linalg.norm(quaternion)
    return bool(abs(norm - 1) < 0.01 or not np.isfinite(norm))


def is_tum(source: Source) -> bool:
    """Whether the first line has 8 columns."""
    return source.columns == 8


#: Format -> whether a file has it, in the order in which they are asked: the first that answers
#: yes is the file's format. A format that is not listed is only read by its name.
SNIFFED = {
    "scannet": pose_folders.is_scannet,
    "nerf": is_nerf,
    "pov-cameras": is_pov_camera,
    "pov-commands": is_pov_command,
    "gt.freiburg": is_freiburg,
    "gt.sim": is_sim,
    "vslam-lab": is_vslam_lab,
    "euroc": is_euroc,
    "pov-matrix": is_pov_matrix,
    "kitti": is_kitti,
    "replica": is_replica,
    "colmap": is_colmap,
    "tartanair": is_tartanair,
    "tum": is_tum,
}


def sniffed(source: Source) -> str:
    """The format of a file or folder. Raises InputError if it is not recognised."""
    for format, has_it in SNIFFED.items():
        if has_it(source):
            return format
    expected = (
        "a trajectory: 8 columns (TUM), 12, 13 or 16 (matrix rows), blocks of 3 lines with 4, "
        "POV-Ray commands, CSV or COLMAP's images.txt"
    )
    if not source.columns:
        raise InputError(expected, path=source.path, found="comments alone")
    found = f"{source.columns} columns"
    line = data_lines(source.text)[0][0]
    raise InputError(expected, path=source.path, line=line, found=found, hint="{from} FORMAT")
