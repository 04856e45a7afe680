"""VSLAM-LAB: rgb_0/, depth_0/, rgb.csv, calibration.yaml, groundtruth.csv; stamps in nanoseconds
(https://github.com/VSLAM-LAB/VSLAM-LAB, Datasets/).
"""

import csv
import io
import re
from pathlib import Path

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError
from ...formats.depth_units import UNITS_PER_METRE, check_units
from ...formats.files import atomic_write_text, read_text
from ...formats.stamps import stamp_text_of_ns
from ..layout import (
    Contents,
    Reader,
    Row,
    SequenceCamera,
    SequenceFormat,
    is_distorted,
    numbers_in,
    pinhole_of,
    truth_at,
    write_truth,
)

_LIST = "rgb.csv"
_CAMERA = "calibration.yaml"
_TRUTH = "groundtruth.csv"
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


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    file = folder / _CAMERA
    if not file.is_file():
        return None
    text = read_text(file)
    pattern = r"(focal_length|principal_point|depth_factor): *\[?([^\]\n]*)\]?"
    values = dict(re.findall(pattern, text))
    numbers = []
    for name in ("focal_length", "principal_point"):
        numbers += values.get(name, "").split(",")
    what = "focal_length: [fx, fy], principal_point: [cx, cy]"
    fx, fy, cx, cy = numbers_in(file, numbers, 4, what)
    units = values.get("depth_factor", str(UNITS_PER_METRE)).strip(" ,")
    (per_metre,) = numbers_in(file, [units], 1, "depth_factor as a number")
    pinhole = pinhole_of(image, fx, fy, cx, cy)
    return SequenceCamera(pinhole, check_units(per_metre), distorted=is_distorted(text))


FORMAT = SequenceFormat(
    "vslam-lab",
    "VSLAM-LAB: rgb_0/, depth_0/, rgb.csv and groundtruth.csv in nanoseconds, calibration.yaml",
    lambda f, kind: f"{kind}_0/{f.number:06}.png",
    _write,
    Reader(lambda folder: (folder / _LIST).is_file(), _rows, _camera, truth_at(_TRUTH)),
    stamps="ns",
)
