"""TUM-VI: EuRoC's mav0 with mocap0 as ground truth, that of the IMU, and in dso/ the camera and the
noise of the IMU as Kalibr writes them.
"""

from dataclasses import replace
from pathlib import Path

from ...formats.files import atomic_write_text, make_folder
from ...geometry.se3 import SE3
from ...sensor.imu import ImuStream
from ...sensor.imu_noise import estimator_figures
from ..contents import Contents, write_truth_of_body
from ..format import SequenceFormat, truth_at
from . import euroc

_CAMERA = Path("dso/camchain.yaml")
_IMU = Path("dso/imu_config.yaml")


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


FORMAT = replace(
    euroc.FORMAT,
    name="tum-vi",
    description="TUM-VI: mav0/ as in EuRoC with mocap0 as ground truth, dso/ with Kalibr's files",
    write_texts=_write,
    reader=replace(
        euroc.FORMAT.reader,
        found=lambda folder: (folder / euroc.TUM_VI).is_file(),
        truth=truth_at(euroc.TUM_VI),
    ),
    limits=replace(euroc.FORMAT.limits, remarks=lambda contents: []),
    published_image=None,
)
