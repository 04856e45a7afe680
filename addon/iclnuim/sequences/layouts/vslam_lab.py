"""VSLAM-LAB: rgb_0/, depth_0/, rgb.csv, calibration.yaml, groundtruth.csv; stamps in nanoseconds
(https://github.com/VSLAM-LAB/VSLAM-LAB, Datasets/).
"""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError, within
from ...formats.depth_units import UNITS_PER_METRE, check_units
from ...formats.files import atomic_write_text, is_file, read_text
from ...formats.yaml_files import read_yaml
from ...geometry.se3 import SE3
from ...trajectory_files.stamps import stamp_text_of_ns
from ..camera_files import (
    WITHOUT_PROJECTION,
    Keys,
    SequenceCamera,
    any_of,
    as_list,
    mount_notes,
    mount_of,
    names,
    numbers_in,
    pinhole_of,
    pose_of,
)
from ..contents import Contents, write_truth
from ..format import FormatLimits, Reader, SequenceFormat, truth_at
from ..frames import Row

_LIST = "rgb.csv"
_CAMERA = "calibration.yaml"
_TRUTH = "groundtruth.csv"
#: Name of the camera that the list and the depth images belong to.
_NAME = "rgb_0"
#: Keys of a camera (VSLAM-LAB's DatasetVSLAMLab_calibration.py).
KEYS = Keys(
    used=names("cam_name focal_length principal_point depth_factor T_BS"),
    harmless=names("cam_type depth_name image_dimension fps"),
    required={
        "cam_model": any_of("pinhole"),
        "distortion_type": any_of(*WITHOUT_PROJECTION),
    },
    distortion=names("distortion_coefficients"),
)
_COLUMNS = ("ts_rgb_0 (ns)", "path_rgb_0", "ts_depth_0 (ns)", "path_depth_0")


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    lines = [",".join(_COLUMNS)]
    for frame in contents.frames:
        rgb = f"{frame.nanoseconds()},{format.image(frame, RGB)}"
        lines.append(f"{rgb},{frame.nanoseconds(DEPTH)},{format.image(frame, DEPTH)}")
    atomic_write_text(folder / _LIST, "\n".join(lines) + "\n")
    atomic_write_text(folder / _CAMERA, _calibration(contents))
    write_truth(folder / _TRUTH, contents, "vslam-lab")


def _calibration(contents: Contents) -> str:
    """The body frame is the camera's."""
    c = contents.camera
    eye = ", ".join(f"{value:.1f}" for value in np.eye(4).ravel().tolist())
    return f"""%YAML 1.2
---
cameras:
  - {{cam_name: rgb_0,
     cam_type: rgb+depth,
     depth_name: depth_0,
     cam_model: pinhole,
     focal_length: [{c.fx!r}, {c.fy!r}],
     principal_point: [{c.cx!r}, {c.cy!r}],
     depth_factor: {contents.depth_units_per_metre!r},
     image_dimension: [{c.width}, {c.height}],
     fps: {contents.rate_hz!r},
     T_BS: [{eye}]
    }}
"""


def _rows(folder: Path) -> list[Row]:
    """The pairs of the list; lines without a depth image are left out."""
    file = folder / _LIST
    found = []
    lines = csv.reader(io.StringIO(read_text(file), newline=""))
    try:
        head = next(lines)
        places = [head.index(name) for name in _COLUMNS]
    except (StopIteration, ValueError, csv.Error):
        raise InputError(f"the columns {', '.join(_COLUMNS)}", path=file, line=1) from None
    try:
        for line in lines:
            if len(line) <= max(places) or not line[places[3]]:
                continue
            a, image, b, depth = (line[place] for place in places)
            texts = stamp_text_of_ns(int(a)), stamp_text_of_ns(int(b))
            found.append(Row(int(a) / 1e9, folder / image, folder / depth, texts))
    except (ValueError, csv.Error):
        raise InputError("whole nanoseconds and paths", path=file, line=lines.line_num) from None
    return sorted(found)


def _said(folder: Path) -> dict[str, Any]:
    """What the file says of the camera of the list; {} without a file."""
    file = folder / _CAMERA
    if not is_file(file):
        return {}
    cameras = read_yaml(file).get("cameras")
    entries = cameras if isinstance(cameras, list) else []
    for entry in entries:
        if isinstance(entry, dict) and entry.get("cam_name", _NAME) == _NAME:
            return entry
    raise InputError(f"the camera {_NAME} in the list cameras", path=file, found="none")


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    file = folder / _CAMERA
    said = _said(folder)
    if not said:
        return None
    notes = KEYS.notes([said], file) + mount_notes(_mount(folder))
    values = as_list(said.get("focal_length")) + as_list(said.get("principal_point"))
    what = "focal_length: [fx, fy], principal_point: [cx, cy]"
    fx, fy, cx, cy = numbers_in(file, values, 4, what)
    units = said.get("depth_factor", UNITS_PER_METRE)
    (per_metre,) = numbers_in(file, [units], 1, "depth_factor as a number")
    with within(file):
        pinhole = pinhole_of(image, fx, fy, cx, cy)
        return SequenceCamera(pinhole, check_units(per_metre), notes=notes)


def _mount(folder: Path) -> SE3 | None:
    """The pose of the camera in the body, which the ground truth follows."""
    return mount_of(pose_of(_said(folder).get("T_BS"), folder / _CAMERA))


FORMAT = SequenceFormat(
    "vslam-lab",
    "VSLAM-LAB: rgb_0/, depth_0/, rgb.csv and groundtruth.csv in nanoseconds, calibration.yaml",
    lambda f, kind: f"{kind}_0/{f.number:06}.png",
    _write,
    Reader(lambda folder: (folder / _LIST).is_file(), _rows, _camera, truth_at(_TRUTH), _mount),
    FormatLimits("ns"),
)
