"""EuRoC's layout with a depth camera: mav0/cam0 (colour), mav0/depth0 (16 bit), mav0/imu0, their
sensor.yaml, state_groundtruth_estimate0; stamps in ns.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError, within
from ...formats.depth_units import UNITS_PER_METRE, check_units
from ...formats.files import atomic_write_text, data_lines, is_file, make_folder, read_text
from ...formats.imu_files import imu_text
from ...formats.yaml_files import read_yaml
from ...geometry.camera import PinholeCamera
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
    pose_of,
)
from ..contents import Contents, write_truth
from ..format import FormatLimits, Reader, SequenceFormat, truth_at
from ..frames import Row, SequenceFrame
from ..imu import SequenceImu, sequence_imu, velocities_of

_ROOT = Path("mav0")
_SENSORS = {RGB: "cam"}
_TRUTH = Path("mav0/state_groundtruth_estimate0/data.csv")
_IMU = Path("mav0/imu0")
#: A folder with this ground truth is one of TUM-VI (tum_vi.py).
TUM_VI = Path("mav0/mocap0/data.csv")
#: Stamps of the images, from which ORB-SLAM3 makes their names.
_TIMES = Path("times.txt")
#: Columns of the ground truth after the poses.
_STATES = (
    ",v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1]"
    ",b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1]"
    ",b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)
#: Depth units per metre that OKVIS2 assumes.
UNITS = 1000.0
_UNITS = "depth_units_per_metre"
#: Folders of the cameras; the first decides.
CAMERAS = ("depth0", "cam0")
#: Keys of EuRoC's sensor.yaml and of those that follow it.
KEYS = Keys(
    used=names(f"T_BS resolution intrinsics {_UNITS}"),
    harmless=names("sensor_type comment rate_hz rostopic cam_overlaps"),
    required={
        "camera_model": any_of("pinhole"),
        "distortion_model": any_of(*WITHOUT_PROJECTION),
    },
    distortion=names("distortion_coefficients"),
)


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    write_sensors(folder, contents, format)
    _write_truth(folder / _TRUTH, contents)


def write_sensors(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    """Write the lists and cameras of both kinds of images, and the readings of an IMU."""
    stems = [Path(path).stem for path in format.images(contents, RGB).paths]
    depth_camera = "depth camera, 16 bit, 0 = missing"
    for sensor, kind, what in (("cam0", RGB, "camera"), ("depth0", DEPTH, depth_camera)):
        rows = ["#timestamp [ns],filename\n"]
        for stem, frame in zip(stems, contents.frames, strict=True):
            rows.append(f"{_stamp(frame, kind, stem)},{stem}.png\n")
        atomic_write_text(folder / _ROOT / sensor / "data.csv", "".join(rows))
        atomic_write_text(folder / _ROOT / sensor / "sensor.yaml", _sensor(contents, what))
    atomic_write_text(folder / _TIMES, "".join(f"{stem}\n" for stem in stems))
    if contents.imu is not None:
        _write_imu(folder / _IMU, contents.imu)


def _stamp(frame: SequenceFrame, kind: str, stem: str) -> str:
    """The stamp of an image, as it is written in the name of the colour image, its stem."""
    own = frame.nanoseconds(kind)
    return stem if own == frame.nanoseconds() else str(own).zfill(len(stem))


def _write_truth(path: Path, contents: Contents) -> None:
    """Write the poses of the body, its velocity, and the biases of the IMU, 0 without one. The body
    is the IMU, or without one the camera.
    """
    kept = contents.truth_file is not None and contents.truth_file[0] == "euroc"
    truth = contents.truth
    if kept or truth is None:
        write_truth(path, contents, "euroc")
    elif contents.imu is None:
        write_truth(path, contents, "euroc")
        _add_states(path, velocities_of(truth), [",0" * 6] * len(truth))
    else:
        of_imu, velocities, biases = contents.imu.states_of(truth)
        write_truth(path, replace(contents, truth=of_imu), "euroc")
        columns = ["," + _numbers(bias) for bias in biases.round(9).tolist()]
        _add_states(path, velocities.round(9), columns)


def _add_states(path: Path, velocities: np.ndarray, biases: list[str]) -> None:
    """Add velocities (n, 3) in m/s and the columns of the biases to the poses of a file."""
    head, *rows = read_text(path).splitlines()
    lines = [head + _STATES]
    for row, velocity, bias in zip(rows, velocities.tolist(), biases, strict=True):
        lines.append(f"{row},{_numbers(velocity)}{bias}")
    atomic_write_text(path, "\n".join(lines) + "\n")


def _numbers(values: list[float]) -> str:
    return ",".join(f"{value + 0.0:.9f}" for value in values)


def _write_imu(folder: Path, imu: SequenceImu) -> None:
    """Write mav0/imu0: the readings, and the sensor.yaml of EuRoC with the noise."""
    stream = imu.stream
    make_folder(folder)
    atomic_write_text(folder / "data.csv", imu_text(stream.stamps_ns, stream.readings))
    noise = "".join(f"{name}: {value:.9g}\n" for name, value in stream.noise.items())
    about = f"IMU, {imu.about}" if imu.about else "IMU"
    text = f"""sensor_type: imu
comment: "{about}"
{_pose_yaml(SE3.identity())}rate_hz: {stream.rate_hz:g}
{noise}"""
    atomic_write_text(folder / "sensor.yaml", text)


def _pose_yaml(T_body_sensor: SE3) -> str:
    """T_BS, the pose of a sensor in the body."""
    data = ", ".join(str(round(value, 9) + 0.0) for value in T_body_sensor.matrix.ravel().tolist())
    return f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{data}]\n"


def _folder(kind: str) -> str:
    return f"mav0/{_SENSORS.get(kind, kind)}0/data"


def _sensor(contents: Contents, what: str) -> str:
    """The body frame is that of the IMU; without one, and by default, the camera's."""
    c = contents.camera
    mount = SE3.identity() if contents.imu is None else contents.imu.stream.T_imu_camera
    return f"""sensor_type: {what.split()[0]}
comment: {what}
{_pose_yaml(mount)}rate_hz: {contents.rate_hz:g}
resolution: [{c.width}, {c.height}]
camera_model: pinhole
intrinsics: [{c.fx:.9g}, {c.fy:.9g}, {c.cx:.9g}, {c.cy:.9g}]
distortion_model: radial-tangential
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
depth_units_per_metre: {contents.depth_units_per_metre:g}
"""


def _rows(folder: Path) -> list[Row]:
    """Pairs of images with equal stamps in nanoseconds in both data.csv, or with equal names if
    depth has its own stamps.
    """
    rgb, depth = (_images(folder / _ROOT / sensor) for sensor in ("cam0", "depth0"))
    named = {path.name: ns for ns, path in depth.items() if ns not in rgb}
    rows = []
    for ns in sorted(rgb):
        of_depth = ns if ns in depth else named.get(rgb[ns].name)
        if of_depth is not None:
            texts = stamp_text_of_ns(ns), stamp_text_of_ns(of_depth)
            rows.append(Row(ns / 1e9, rgb[ns], depth[of_depth], texts))
    return rows


def _images(sensor: Path) -> dict[int, Path]:
    """The images of a sensor's data.csv by their stamps in nanoseconds; names of columns may stand
    in the first line.
    """
    file = sensor / "data.csv"
    lines = data_lines(read_text(file))
    if lines and re.match("[A-Za-z]", lines[0][1]):
        del lines[0]
    found = {}
    for number, line in lines:
        stamp, _, name = (part.strip() for part in line.rstrip(", ").partition(","))
        if not re.fullmatch("[0-9]{1,19}", stamp) or not name or "," in name:
            raise InputError("lines `nanoseconds,image`", path=file, line=number, found=line)
        found[int(stamp)] = sensor / "data" / name
    return found


def _camera(folder: Path, image: Path) -> SequenceCamera:
    """The depth camera, and the colour camera if it is another one."""
    files = [file for name in CAMERAS if is_file(file := _sensor_file(folder, name))]
    if not files:
        file = _sensor_file(folder, CAMERAS[0])
        raise InputError("the depth camera's file", path=file, found="none")
    cameras = [_camera_in(file) for file in files]
    depth = cameras[0]
    colour = cameras[-1].pinhole
    notes = [*depth.notes, *cameras[-1].notes, *mount_notes(_mount(folder)), *_apart(folder)]
    return replace(
        depth,
        colour=colour if colour != depth.pinhole else None,
        notes=tuple(dict.fromkeys(notes)),
    )


def _sensor_file(folder: Path, name: str) -> Path:
    return folder / _ROOT / name / "sensor.yaml"


def _camera_in(file: Path) -> SequenceCamera:
    """The camera of one sensor."""
    said = read_yaml(file)
    notes = KEYS.notes([said], file)
    values = as_list(said.get("resolution")) + as_list(said.get("intrinsics"))
    what = "resolution: [w, h] and intrinsics: [fx, fy, cx, cy]"
    width, height, *intrinsics = numbers_in(file, values, 6, what)
    what = "depth_units_per_metre as a number"
    (per_metre,) = numbers_in(file, [said.get(_UNITS, UNITS_PER_METRE)], 1, what)
    with within(file):
        pinhole = PinholeCamera(int(width), int(height), *intrinsics)
        return SequenceCamera(pinhole, check_units(per_metre), notes=notes)


def _T_body(folder: Path, *sensors: str) -> SE3:
    """T_BS, the pose in the body, of the first of these sensors whose file gives it; else the
    identity.
    """
    for sensor in sensors:
        file = _sensor_file(folder, sensor)
        if is_file(file) and "T_BS" in (said := read_yaml(file)):
            return pose_of(said["T_BS"], file)
    return SE3.identity()


def _mount(folder: Path) -> SE3 | None:
    """The pose of the depth camera in the frame that the ground truth follows."""
    T_truth_camera = _T_body(folder, _TRUTH.parent.name).inverse() @ _T_body(folder, *CAMERAS)
    return mount_of(T_truth_camera)


def _apart(folder: Path) -> list[str]:
    """A sentence if the colour camera has another pose than the depth camera."""
    T_depth_colour = mount_of(_T_body(folder, *CAMERAS).inverse() @ _T_body(folder, *CAMERAS[::-1]))
    if T_depth_colour is None:
        return []
    distance_mm = 1000 * float(np.linalg.norm(T_depth_colour.translation))
    differ = f"T_BS of cam0 and depth0 differ (positions by {distance_mm:.3g} mm)"
    return [f"{differ}: colour is read as if it had the pose of the depth camera"]


def _remarks(contents: Contents) -> list[str]:
    """A sentence if an IMU has no true velocities and biases."""
    kept = contents.truth_file is not None and contents.truth_file[0] == "euroc"
    if kept or contents.imu is None or contents.imu.motion is not None:
        return []
    return ["the source has no velocities and biases: they are differences of positions, and 0"]


def _imu(folder: Path) -> SequenceImu | None:
    """The readings in mav0/imu0, and what its sensor.yaml says of the noise; T_BS of both sensors."""
    file = folder / _IMU / "data.csv"
    if not is_file(file):
        return None
    said = read_yaml(about) if is_file(about := _sensor_file(folder, _IMU.name)) else {}
    T_imu_camera = _T_body(folder, _IMU.name).inverse() @ _T_body(folder, *CAMERAS)
    return sequence_imu(file, said, T_imu_camera)


FORMAT = SequenceFormat(
    "euroc",
    "mav0/cam0, mav0/depth0 and state_groundtruth_estimate0; stamps in nanoseconds",
    lambda frame, kind: f"{_folder(kind)}/{frame.nanoseconds():019}.png",
    _write,
    Reader(
        lambda folder: (folder / _ROOT).is_dir() and not (folder / TUM_VI).is_file(),
        _rows,
        _camera,
        truth_at(_TRUTH),
        _mount,
        _imu,
    ),
    FormatLimits("ns", fixed_units=UNITS, imu=True, remarks=_remarks),
    published_image=lambda frame, kind: f"{_folder(kind)}/{frame.nanoseconds()}.png",
)
