"""VSLAM-LAB: rgb_0/, depth_0/, imu_0.csv, rgb.csv, calibration.yaml, groundtruth.csv; stamps in ns
(https://github.com/VSLAM-LAB/VSLAM-LAB, Datasets/).
"""

import csv
import io
from pathlib import Path
from typing import Any

from ...channels import DEPTH, RGB
from ...errors import InputError, within
from ...formats.depth_units import UNITS_PER_METRE, check_units
from ...formats.files import atomic_write_text, is_file, read_text
from ...formats.imu_files import VSLAM_LAB, imu_text
from ...formats.yaml_files import read_yaml
from ...geometry.se3 import SE3
from ...sensor.imu import GRAVITY_M_S2, ImuStream
from ...sensor.imu_noise import estimator_figures
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
from ..contents import Contents, write_truth_of_body
from ..format import FormatLimits, Reader, SequenceFormat, truth_at
from ..frames import Row
from ..imu import SequenceImu, sequence_imu

_LIST = "rgb.csv"
_CAMERA = "calibration.yaml"
_TRUTH = "groundtruth.csv"
_IMU = "imu_0.csv"
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
#: Keys of an IMU's noise, by their names in Kalibr's imu.yaml.
_NOISE = {
    "sigma_g_c": "gyroscope_noise_density",
    "sigma_a_c": "accelerometer_noise_density",
    "sigma_gw_c": "gyroscope_random_walk",
    "sigma_aw_c": "accelerometer_random_walk",
}
_COLUMNS = ("ts_rgb_0 (ns)", "path_rgb_0", "ts_depth_0 (ns)", "path_depth_0")


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    lines = [",".join(_COLUMNS)]
    for frame in contents.frames:
        rgb = f"{frame.nanoseconds()},{format.image(frame, RGB)}"
        lines.append(f"{rgb},{frame.nanoseconds(DEPTH)},{format.image(frame, DEPTH)}")
    atomic_write_text(folder / _LIST, "\n".join(lines) + "\n")
    atomic_write_text(folder / _CAMERA, _calibration(contents))
    if contents.imu is not None:
        stream = contents.imu.stream
        text = imu_text(stream.stamps_ns, stream.readings, VSLAM_LAB)
        atomic_write_text(folder / _IMU, text)
    write_truth_of_body(folder / _TRUTH, contents, "vslam-lab")


def _calibration(contents: Contents) -> str:
    """The body frame is that of the IMU; without one the camera's."""
    c = contents.camera
    imu = None if contents.imu is None else contents.imu.stream
    mount = SE3.identity() if imu is None else imu.T_imu_camera
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
     T_BS: [{_numbers(mount)}]
    }}
{"" if imu is None else _calibration_of(imu)}"""


def _calibration_of(imu: ImuStream) -> str:
    """What estimators need of the IMU: ranges that are never reached, no bias known."""
    figures = estimator_figures(imu)
    noise = "".join(f"     {key}: {figures[name]:.9e},\n" for key, name in _NOISE.items())
    return f"""
imus:
  - {{imu_name: imu_0,
     a_max: 1000.0,
     g_max: 100.0,
     sigma_bg: 0.01,
     sigma_ba: 0.1,
{noise}     a0: [0.0, 0.0, 0.0],
     g0: [0.0, 0.0, 0.0],
     g: {abs(GRAVITY_M_S2[2])},
     s_a: [1.0, 1.0, 1.0],
     fps: {imu.rate_hz!r},
     T_BS: [{_numbers(SE3.identity())}]
    }}
"""


def _numbers(T: SE3) -> str:
    return ", ".join(repr(round(value, 9) + 0.0) for value in T.matrix.ravel().tolist())


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
    for entry in _entries(file, "cameras"):
        if entry.get("cam_name", _NAME) == _NAME:
            return entry
    raise InputError(f"the camera {_NAME} in the list cameras", path=file, found="none")


def _entries(file: Path, list_name: str) -> list[dict[str, Any]]:
    entries = read_yaml(file).get(list_name)
    return [e for e in entries if isinstance(e, dict)] if isinstance(entries, list) else []


def _imu(folder: Path) -> SequenceImu | None:
    """The readings in imu_0.csv, with the place of the first IMU. Its noise in the file is what
    estimators are to assume.
    """
    if not is_file(folder / _IMU):
        return None
    file = folder / _CAMERA
    said = next(iter(_entries(file, "imus") if is_file(file) else []), {})
    about = {"rate_hz": said.get("fps")}
    T_body_imu, T_body_camera = (pose_of(one.get("T_BS"), file) for one in (said, _said(folder)))
    return sequence_imu(folder / _IMU, about, T_body_imu.inverse() @ T_body_camera)


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
    Reader(
        lambda folder: (folder / _LIST).is_file(), _rows, _camera, truth_at(_TRUTH), _mount, _imu
    ),
    FormatLimits("ns", imu=True),
)
