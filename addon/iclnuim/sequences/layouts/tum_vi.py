"""TUM-VI: EuRoC's mav0 with mocap0 as ground truth, that of the IMU, and in dso/ the camera and the
noise of the IMU as Kalibr writes them.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from ...errors import InputError, within
from ...formats.files import atomic_write_text, is_file, make_folder
from ...formats.yaml_files import read_yaml
from ...geometry.camera import PinholeCamera
from ...geometry.se3 import SE3
from ...sensor.imu import ImuStream
from ...sensor.imu_noise import estimator_figures
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
    zeros,
)
from ..contents import Contents, write_truth_of_body
from ..format import SequenceFormat, truth_at
from ..imu import SequenceImu
from . import euroc

_CAMERA = Path("dso/camchain.yaml")
_IMU = Path("dso/imu_config.yaml")
#: Keys of a camera in Kalibr's camchain.yaml.
_KEYS = Keys(
    used=names("T_cam_imu T_imu_cam resolution intrinsics"),
    harmless=names("cam_overlaps rostopic"),
    noted={"timeshift_cam_imu": zeros},
    required={
        "camera_model": any_of("pinhole"),
        "distortion_model": any_of(*WITHOUT_PROJECTION),
    },
    distortion=names("distortion_coeffs"),
)


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    euroc.write_sensors(folder, contents, format)
    write_truth_of_body(folder / euroc.TUM_VI, contents, "euroc")
    make_folder(folder / _CAMERA.parent)
    atomic_write_text(folder / _CAMERA, _camchain(contents))
    if contents.imu is not None:
        atomic_write_text(folder / _IMU, _imu_config(contents.imu.stream))


def _camchain(contents: Contents) -> str:
    """The colour camera. The body frame is that of the IMU; without one, the camera's."""
    c = contents.camera
    mount = SE3.identity() if contents.imu is None else contents.imu.stream.T_imu_camera
    rows = [[round(value, 9) + 0.0 for value in row] for row in mount.inverse().matrix.tolist()]
    T_cam_imu = "".join(f"\n  - {row}" for row in rows)
    return f"""cam0:
  T_cam_imu:{T_cam_imu}
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [{float(c.fx)!r}, {float(c.fy)!r}, {float(c.cx)!r}, {float(c.cy)!r}]
  resolution: [{c.width}, {c.height}]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.0
"""


def _imu_config(imu: ImuStream) -> str:
    """What estimators are to assume."""
    noise = "".join(f"{name}: {value:.9e}\n" for name, value in estimator_figures(imu).items())
    return f"{noise}rostopic: /imu0\nupdate_rate: {float(imu.rate_hz)!r}\n"


def _said(folder: Path) -> dict[str, Any]:
    """What dso/camchain.yaml says of cam0, in a folder without sensor.yaml of a camera; {} in others:
    those are read as EuRoC's.
    """
    if any(is_file(folder / "mav0" / name / "sensor.yaml") for name in euroc.CAMERAS):
        return {}
    said = read_yaml(folder / _CAMERA).get("cam0") if is_file(folder / _CAMERA) else {}
    if not isinstance(said, dict):
        raise InputError("cam0 with keys and values", path=folder / _CAMERA, found="none")
    return said


def _T_imu_camera(folder: Path) -> SE3 | None:
    """The pose of the camera in the IMU by Kalibr's file, None without one."""
    said = _said(folder)
    if "T_cam_imu" in said:
        return pose_of(said["T_cam_imu"], folder / _CAMERA).inverse()
    return pose_of(said["T_imu_cam"], folder / _CAMERA) if "T_imu_cam" in said else None


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    said = _said(folder)
    if not said:
        return euroc.FORMAT.reader.camera(folder, image)
    file = folder / _CAMERA
    notes = _KEYS.notes([said], file) + mount_notes(_mount(folder), "T_cam_imu")
    values = as_list(said.get("resolution")) + as_list(said.get("intrinsics"))
    what = "resolution: [w, h] and intrinsics: [fx, fy, cx, cy]"
    width, height, *intrinsics = numbers_in(file, values, 6, what)
    with within(file):
        pinhole = PinholeCamera(int(width), int(height), *intrinsics)
    return SequenceCamera(pinhole, euroc.UNITS, notes=notes)


def _mount(folder: Path) -> SE3 | None:
    found = _T_imu_camera(folder)
    return euroc.FORMAT.reader.mount(folder) if found is None else mount_of(found)


def _imu(folder: Path) -> SequenceImu | None:
    found = euroc.FORMAT.reader.imu(folder)
    T_imu_camera = _T_imu_camera(folder)
    if found is None or T_imu_camera is None:
        return found
    return replace(found, stream=replace(found.stream, T_imu_camera=T_imu_camera))


FORMAT = replace(
    euroc.FORMAT,
    name="tum-vi",
    description="TUM-VI: mav0/ as in EuRoC with mocap0 as ground truth, dso/ with Kalibr's files",
    write_texts=_write,
    reader=replace(
        euroc.FORMAT.reader,
        found=lambda folder: (folder / euroc.TUM_VI).is_file(),
        camera=_camera,
        truth=truth_at(euroc.TUM_VI),
        mount=_mount,
        imu=_imu,
    ),
    limits=replace(euroc.FORMAT.limits, remarks=lambda contents: []),
    published_image=None,
)
