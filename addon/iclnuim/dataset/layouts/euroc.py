"""EuRoC's layout with a depth camera: mav0/cam0 (colour), mav0/depth0 (16 bit), their sensor.yaml,
state_groundtruth_estimate0; stamps in ns.
"""

import re
from pathlib import Path

from ...channels import RGB
from ...errors import InputError
from ...formats.depth_units import UNITS_PER_METRE, check_units
from ...formats.files import atomic_write_text, data_lines, read_text
from ...formats.stamps import stamp_text_of_ns
from ...geometry.camera import PinholeCamera
from ..layout import (
    Contents,
    Reader,
    Row,
    SequenceCamera,
    SequenceFormat,
    is_distorted,
    numbers_in,
    truth_at,
    write_truth,
)

_ROOT = Path("mav0")
_SENSORS = {RGB: "cam"}
_TRUTH = Path("mav0/state_groundtruth_estimate0/data.csv")


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
    file = folder / _ROOT / "depth0/sensor.yaml"
    text = read_text(file)
    lists = dict(re.findall(r"^(resolution|intrinsics): *\[(.*)\]", text, re.MULTILINE))
    try:
        width, height = (int(value) for value in lists["resolution"].split(","))
        fx, fy, cx, cy = (float(value) for value in lists["intrinsics"].split(","))
    except (KeyError, ValueError):
        raise InputError("resolution: [w, h] and intrinsics: [fx, fy, cx, cy]", path=file) from None
    units = re.findall(r"^depth_units_per_metre: *([\d.]+)", text, re.MULTILINE)
    what = "depth_units_per_metre as a number"
    (per_metre,) = numbers_in(file, units[:1] or [str(UNITS_PER_METRE)], 1, what)
    camera = PinholeCamera(width, height, fx, fy, cx, cy)
    return SequenceCamera(camera, check_units(per_metre), distorted=is_distorted(text))


FORMAT = SequenceFormat(
    "euroc",
    "mav0/cam0, mav0/depth0 and state_groundtruth_estimate0; stamps in nanoseconds",
    lambda frame, kind: f"mav0/{_SENSORS.get(kind, kind)}0/data/{frame.nanoseconds()}.png",
    _write,
    Reader(lambda folder: (folder / _ROOT).is_dir(), _rows, _camera, truth_at(_TRUTH)),
    stamps="ns",
    depth_stamps=False,
)
