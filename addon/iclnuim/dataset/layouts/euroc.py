"""EuRoC's layout with a depth camera: mav0/cam0 (colour), mav0/depth0 (16 bit), their sensor.yaml,
state_groundtruth_estimate0; stamps in ns.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...channels import RGB
from ...errors import InputError, within
from ...formats.depth_units import UNITS_PER_METRE, check_units
from ...formats.files import atomic_write_text, data_lines, is_file, read_text
from ...formats.stamps import stamp_text_of_ns
from ...formats.yaml_files import read_yaml
from ...geometry.camera import PinholeCamera
from ...geometry.se3 import SE3
from ..known_keys import WITHOUT_PROJECTION, Keys, any_of, names, pose_of
from ..layout import (
    Contents,
    Reader,
    Row,
    SequenceCamera,
    SequenceFormat,
    numbers_in,
    truth_at,
    write_truth,
)

_ROOT = Path("mav0")
_SENSORS = {RGB: "cam"}
_TRUTH = Path("mav0/state_groundtruth_estimate0/data.csv")
_UNITS = "depth_units_per_metre"
#: Larger entries of the pose of a camera in another are no rounding.
_APART = 1e-5
#: Keys of EuRoC's sensor.yaml and of those that follow it.
KEYS = Keys(
    used=names(f"T_BS resolution intrinsics {_UNITS}"),
    harmless=names("sensor_type comment rate_hz"),
    required={
        "camera_model": any_of("pinhole"),
        "distortion_model": any_of(*WITHOUT_PROJECTION),
    },
    distortion=names("distortion_coefficients"),
)


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    rows = ["#timestamp [ns],filename\n"]
    rows += [f"{frame.nanoseconds()},{frame.nanoseconds()}.png\n" for frame in contents.frames]
    for sensor, what in (("cam0", "camera"), ("depth0", "depth camera, 16 bit, 0 = missing")):
        atomic_write_text(folder / _ROOT / sensor / "data.csv", "".join(rows))
        atomic_write_text(folder / _ROOT / sensor / "sensor.yaml", _sensor(contents, what))
    write_truth(folder / _TRUTH, contents, "euroc")


def _sensor(contents: Contents, what: str) -> str:
    """The body frame is the camera's: T_BS is the identity."""
    c = contents.camera
    return f"""sensor_type: {what.split()[0]}
comment: {what}
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: {contents.rate_hz:g}
resolution: [{c.width}, {c.height}]
camera_model: pinhole
intrinsics: [{c.fx:.9g}, {c.fy:.9g}, {c.cx:.9g}, {c.cy:.9g}]
distortion_model: radial-tangential
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
depth_units_per_metre: {contents.depth_units_per_metre:g}
"""


def _rows(folder: Path) -> list[Row]:
    """Pairs of images with equal stamps in nanoseconds in both data.csv."""
    images = []
    for sensor in (folder / _ROOT / "cam0", folder / _ROOT / "depth0"):
        try:
            fields = [line.split(",") for _, line in data_lines(read_text(sensor / "data.csv"))]
            images.append({int(stamp): sensor / "data" / name.strip() for stamp, name in fields})
        except ValueError:
            raise InputError("lines `nanoseconds,image`", path=sensor / "data.csv") from None
    rgb, depth = images
    texts = {ns: stamp_text_of_ns(ns) for ns in rgb.keys() & depth.keys()}
    return [Row(ns / 1e9, rgb[ns], depth[ns], (texts[ns], texts[ns])) for ns in sorted(texts)]


def _camera(folder: Path, image: Path) -> SequenceCamera:
    """The depth camera, and the colour camera if it is another one."""
    sensors = [sensor for name in ("depth0", "cam0") if (sensor := _Sensor.of(folder, name))]
    if not sensors:
        file = folder / _ROOT / "depth0/sensor.yaml"
        raise InputError("the depth camera's file", path=file, found="none")
    first = sensors[0]
    last = sensors[-1]
    notes = []
    for note in itertools.chain.from_iterable(sensor.notes for sensor in sensors):
        if note not in notes:
            notes.append(note)
    apart = first.T_body_camera.inverse() @ last.T_body_camera
    if np.abs(apart.matrix - np.eye(4)).max() > _APART:
        distance_mm = 1000 * float(np.linalg.norm(apart.translation))
        notes.append(
            f"T_BS of cam0 and depth0 differ (positions by {distance_mm:.3g} mm): "
            "colour is read as if it had the pose of the depth camera"
        )
    colour = last.pinhole if last.pinhole != first.pinhole else None
    return SequenceCamera(first.pinhole, first.units, colour=colour, notes=tuple(notes))


@dataclass(frozen=True, eq=False)
class _Sensor:
    """A camera's sensor.yaml."""

    pinhole: PinholeCamera
    units: float
    T_body_camera: SE3
    notes: tuple[str, ...]

    @classmethod
    def of(cls, folder: Path, name: str) -> "_Sensor | None":
        """Read the file of a sensor; None if there is none."""
        file = folder / _ROOT / name / "sensor.yaml"
        if not is_file(file):
            return None
        said = read_yaml(file)
        notes = KEYS.notes([said], file)
        what = "resolution: [w, h] and intrinsics: [fx, fy, cx, cy]"
        values = [*_list(said, "resolution"), *_list(said, "intrinsics")]
        width, height, *intrinsics = numbers_in(file, values, 6, what)
        what = "depth_units_per_metre as a number"
        (per_metre,) = numbers_in(file, [said.get(_UNITS, UNITS_PER_METRE)], 1, what)
        with within(file):
            pinhole = PinholeCamera(int(width), int(height), *intrinsics)
            return cls(pinhole, check_units(per_metre), pose_of(said.get("T_BS"), file), notes)


def _list(said: dict[str, Any], key: str) -> list:
    value = said.get(key)
    return value if isinstance(value, list) else [value]


def _mount(folder: Path) -> SE3 | None:
    """The pose of the depth camera in the frame that the ground truth follows: T_BS of both are
    poses in the body.
    """
    camera = next((s for name in ("depth0", "cam0") if (s := _Sensor.of(folder, name))), None)
    file = folder / _TRUTH.parent / "sensor.yaml"
    T_body_camera = camera.T_body_camera if camera else SE3.identity()
    if is_file(file):
        T_body_camera = pose_of(read_yaml(file).get("T_BS"), file).inverse() @ T_body_camera
    return None if np.array_equal(T_body_camera.matrix, np.eye(4)) else T_body_camera


FORMAT = SequenceFormat(
    "euroc",
    "mav0/cam0, mav0/depth0 and state_groundtruth_estimate0; stamps in nanoseconds",
    lambda frame, kind: f"mav0/{_SENSORS.get(kind, kind)}0/data/{frame.nanoseconds()}.png",
    _write,
    Reader(lambda folder: (folder / _ROOT).is_dir(), _rows, _camera, truth_at(_TRUTH), _mount),
    stamps="ns",
    depth_stamps=False,
)
