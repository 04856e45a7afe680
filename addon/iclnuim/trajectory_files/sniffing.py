"""Which format a trajectory file has, by its name and content."""

import re

import numpy as np

from ..errors import InputError
from ..formats.bags import is_bag
from ..formats.files import data_lines, is_number
from . import colmap, matrices, named_rows, phones
from .icl_nuim import starts_as_official
from .number_rows import VSLAM_LAB_STAMP
from .source import Source


def is_rosbag(source: Source) -> bool:
    """Whether the path is that of a bag, which may be a folder."""
    return is_bag(source.path)


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
    """Whether a file is named `*.gt.sim`, or starts with a rotation and a position."""
    if source.name.endswith(".gt.sim"):
        return True
    rows = source.first_rows[:3]
    fields = sum(rows, [])
    if [len(row) for row in rows] != [4, 4, 4] or not all(map(is_number, fields)):
        return False
    rotation = np.array(fields, float).reshape(3, 4)[:, :3]
    if not np.abs(rotation).max() < 2:
        return False
    return bool(np.abs(rotation @ rotation.T - np.eye(3)).max() < 0.1)


def is_vslam_lab(source: Source) -> bool:
    """Whether the first line has the names of VSLAM-LAB's columns."""
    return source.header.lstrip("# \n").startswith(VSLAM_LAB_STAMP)


def is_euroc(source: Source) -> bool:
    """Whether commas separate the columns, of which the first is a number."""
    return source.delimiter == "," and is_number(source.first_rows[0][0])


def is_pov_matrix(source: Source) -> bool:
    """Whether a file of 3x4 matrices has "pov" in its name or header."""
    return is_kitti(source) and ("pov" in source.name or "pov" in source.header)


def is_kitti(source: Source) -> bool:
    """Whether the first line has the columns of a 3x4 matrix, or a number before them."""
    return source.columns in (12, 13)


def is_replica(source: Source) -> bool:
    """Whether the first line has the numbers of a 4x4 matrix, or a number before them."""
    if not source.starts_with_numbers or source.columns not in (16, 17):
        return False
    last = [float(field) for field in source.first_rows[0][-4:]]
    return source.columns == 16 or last == [0, 0, 0, 1] or not np.isfinite(last).all()


def is_colmap(source: Source) -> bool:
    """Whether the first line is one of COLMAP's images."""
    lines = source.first_lines
    return bool(lines) and colmap.names_an_image(lines[0]) and is_number(lines[0].split()[0])


def is_tartanair(source: Source) -> bool:
    """Whether a file of poses without stamps has a name that TartanAir's programs use, or is beside
    TartanAir's images.
    """
    if not is_unstamped(source):
        return False
    if re.search(r"pose_(left|right)|^pose_(gt|est|[lr]cam_\w+)\.txt$", source.name):
        return True
    beside = source.path.parent.glob
    return any(next(beside(name), None) for name in _TARTANAIR_FOLDERS)


def is_unstamped(source: Source) -> bool:
    """Whether the first line has seven numbers that end in a unit quaternion, or a lost pose."""
    if source.columns != 7 or not source.starts_with_numbers:
        return False
    norm = np.linalg.norm([float(field) for field in source.first_rows[0][3:]])
    return bool(abs(norm - 1) < 0.01 or not np.isfinite(norm))


def is_positions(source: Source) -> bool:
    """Whether the first two lines have three numbers, or a stamp and three."""
    lengths = {len(row) for row in source.first_rows}
    return source.starts_with_numbers and (lengths == {3} or lengths == {4})


def is_tum(source: Source) -> bool:
    """Whether the first line has 8 columns."""
    return source.columns == 8


_TARTANAIR_FOLDERS = ("image_left", "depth_left", "image_lcam_*", "depth_lcam_*")
#: Format -> whether a file has it, in the order in which they are asked: the first that answers
#: yes is the file's format. A format that is not listed is only read by its name.
SNIFFED = {
    "rosbag": is_rosbag,
    "scannet": matrices.is_scannet,
    "polycam": phones.is_polycam,
    "open3d": matrices.is_open3d,
    "record3d": phones.is_record3d,
    "nerf": is_nerf,
    "pov-cameras": is_pov_camera,
    "pov-commands": is_pov_command,
    "colmap": is_colmap,
    "gt.freiburg": is_freiburg,
    "matrix-blocks": matrices.is_blocks,
    "gt.sim": is_sim,
    "tartanair": is_tartanair,
    "named-columns": named_rows.is_named,
    "vslam-lab": is_vslam_lab,
    "pov-matrix": is_pov_matrix,
    "kitti": is_kitti,
    "replica": is_replica,
    "tum-unstamped": is_unstamped,
    "positions": is_positions,
    "euroc": is_euroc,
    "tum": is_tum,
}


def sniffed(source: Source) -> str:
    """The format of a file or folder. Raises InputError if it is not recognised."""
    for format, has_it in SNIFFED.items():
        if has_it(source):
            return format
    expected = (
        "a trajectory: 8 columns (TUM), 12, 13, 16 or 17 (matrix rows), 7 (without stamps), 3 or 4 "
        "(positions), blocks of a matrix, POV-Ray commands, CSV, COLMAP's images.txt, or a header "
        "that names the columns"
    )
    if not source.columns:
        raise InputError(expected, path=source.path, found="comments alone")
    found = f"{source.columns} columns"
    hint = "{from} FORMAT"
    if source.columns in (6, 7):
        hint += ", or quaternions instead of angles if the last three columns are roll, pitch, yaw"
    if not source.starts_with_numbers:
        found = repr(source.first_lines[0][:60])
    line = data_lines(source.text)[0][0]
    raise InputError(expected, path=source.path, line=line, found=found, hint=hint)
