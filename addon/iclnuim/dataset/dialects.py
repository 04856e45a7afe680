"""The forms a sequence is written in: where the images lie, and the text files beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..formats.associations import Associations, ImageList, write_associations, write_image_list
from ..formats.files import atomic_write_text, write_json
from ..formats.trajectories import WriteOptions, write_trajectory
from ..geometry import axes
from ..geometry.camera import PinholeCamera
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory, sample
from .depth_units import UNITS_PER_METRE
from .orb_slam3 import orb_slam3_settings


@dataclass(frozen=True, eq=False)
class Contents:
    """What the text files tell of: frame numbers and stamps (n,), camera, ground truth (None where there is none)."""

    camera: PinholeCamera
    numbers: tuple[int, ...]
    stamps_s: tuple[float, ...]
    truth: Trajectory | None
    depth_units_per_metre: float = UNITS_PER_METRE


@dataclass(frozen=True)
class Dialect:
    """`rgb` and `depth` give an image's path from number and stamp; `write_texts` writes all that is no image."""

    name: str
    rgb: Callable[[int, float], str]
    depth: Callable[[int, float], str]
    write_texts: Callable[[Path, Contents, Dialect], None]
    check: Callable[[Contents], None] = lambda contents: None

    def lists(self, contents: Contents) -> tuple[ImageList, ImageList]:
        """Colour and depth images with their stamps."""
        rows = list(zip(contents.numbers, contents.stamps_s, strict=True))
        rgb, depth = (tuple(path(n, t) for n, t in rows) for path in (self.rgb, self.depth))
        return ImageList(contents.stamps_s, rgb), ImageList(contents.stamps_s, depth)


def dialect(name: str) -> Dialect:
    """Raises InputError for an unknown one."""
    if name not in DIALECTS:
        raise InputError(f"a dialect among {', '.join(DIALECTS)}", found=name)
    return DIALECTS[name]


def _write_tum(folder: Path, contents: Contents, form: Dialect) -> None:
    """rgb.txt, depth.txt, associations.txt, groundtruth.txt, camera.json; settings for ORB-SLAM3."""
    rgb, depth = form.lists(contents)
    write_image_list(folder / "rgb.txt", rgb)
    write_image_list(folder / "depth.txt", depth)
    write_associations(folder / "associations.txt", Associations(rgb, depth))
    camera = {**contents.camera.to_dict(), "depth_units_per_metre": contents.depth_units_per_metre}
    write_json(folder / "camera.json", camera)
    atomic_write_text(folder / "orb_slam3.yaml", orb_slam3_settings(contents.camera, contents.depth_units_per_metre))
    if contents.truth is not None:
        write_trajectory(folder / "groundtruth.txt", contents.truth, "tum")


def _write_icl_nuim(folder: Path, contents: Contents, form: Dialect) -> None:
    """The original's: depth first with integer ids, left-handed anchored poses without image 0, K with fy negative."""
    rgb, depth = form.lists(contents)
    write_associations(folder / "associations.txt", Associations(rgb, depth, "icl-nuim"), "icl-nuim")
    c = contents.camera
    rows = ((c.fx, 0, c.cx), (0, -c.fy, c.cy), (0, 0, 1))
    atomic_write_text(folder / "calibration.txt", "".join(f"{a:.6f} {b:.6f} {d:.6f}\n" for a, b, d in rows))
    if contents.truth is not None and len(contents.truth) > (contents.truth.stamps_s[0] == 0):
        write_trajectory(folder / "groundtruth.gt.freiburg", contents.truth, "gt.freiburg", WriteOptions())


def _check_icl_nuim(contents: Contents) -> None:
    if contents.depth_units_per_metre != UNITS_PER_METRE:  # no file of this form could say so
        found = f"{contents.depth_units_per_metre:g}"
        raise InputError(f"{UNITS_PER_METRE:g} depth units a metre for the dialect icl-nuim", found=found)
    frames = np.array(contents.stamps_s) * FRAME_RATE_HZ
    if np.abs(frames - np.array(contents.numbers)).max() > 0.01:
        expected = f"stamps at frame numbers / {FRAME_RATE_HZ:g} s for the dialect icl-nuim"
        raise InputError(expected, found="others", hint="the dialect tum")


def _write_euroc(folder: Path, contents: Contents, form: Dialect) -> None:
    """mav0/cam0 (colour), mav0/depth0 (16 bit), their sensor.yaml, and state_groundtruth_estimate0; stamps in ns."""
    for sensor, what in (("cam0", "camera"), ("depth0", "depth camera, 16 bit, 0 = missing")):
        names = [(_nanoseconds(t), f"{_nanoseconds(t)}.png") for t in contents.stamps_s]
        table = "#timestamp [ns],filename\n" + "".join(f"{ns},{name}\n" for ns, name in names)
        atomic_write_text(folder / "mav0" / sensor / "data.csv", table)
        atomic_write_text(folder / "mav0" / sensor / "sensor.yaml", _euroc_sensor(contents, what))
    if contents.truth is not None:
        state = folder / "mav0" / "state_groundtruth_estimate0"
        state.mkdir(parents=True, exist_ok=True)
        write_trajectory(state / "data.csv", contents.truth, "euroc")


def _euroc_sensor(contents: Contents, what: str) -> str:
    """The body frame is the camera's: T_BS is the identity."""
    c = contents.camera
    return f"""sensor_type: {what.split()[0]}
comment: {what}
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: {_rate_hz(contents.stamps_s):g}
resolution: [{c.width}, {c.height}]
camera_model: pinhole
intrinsics: [{c.fx:.9g}, {c.fy:.9g}, {c.cx:.9g}, {c.cy:.9g}]
distortion_model: radial-tangential
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
depth_units_per_metre: {contents.depth_units_per_metre:g}
"""


def _write_nerf(folder: Path, contents: Contents, form: Dialect) -> None:
    """transforms.json: poses of the OpenGL camera (x right, y up, looks along -z) in our z-up world.

    NeRF programs count pixel centres at +0.5, so the principal point lies half a pixel further.
    """
    c, truth = contents.camera, contents.truth
    rgb, depth = form.lists(contents)
    poses = axes.world_blender_from_world_cv(sample(truth, np.array(contents.stamps_s))).matrix
    rows = zip(rgb.paths, depth.paths, poses.tolist(), strict=True)
    content = {
        "camera_model": "OPENCV",
        "w": c.width,
        "h": c.height,
        "fl_x": c.fx,
        "fl_y": c.fy,
        "cx": c.cx + 0.5,
        "cy": c.cy + 0.5,
        "k1": 0.0,
        "k2": 0.0,
        "p1": 0.0,
        "p2": 0.0,
        "camera_angle_x": float(2 * np.arctan(c.width / (2 * c.fx))),
        "camera_angle_y": float(2 * np.arctan(c.height / (2 * c.fy))),
        "enable_depth_loading": True,
        "integer_depth_scale": 1 / contents.depth_units_per_metre,
        # nerfstudio reads depth_file_path, instant-ngp depth_path
        "frames": [{"file_path": a, "depth_file_path": b, "depth_path": b, "transform_matrix": m} for a, b, m in rows],
    }
    write_json(folder / "transforms.json", content)


def _check_nerf(contents: Contents) -> None:
    if contents.truth is None or len(contents.truth) < 2:
        raise InputError("at least two poses for the dialect nerf", found="fewer", hint="the dialect tum")


def _nanoseconds(stamp_s: float) -> int:
    return round(stamp_s * 1e9)


def _rate_hz(stamps_s: tuple[float, ...]) -> float:
    return float(1 / np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else FRAME_RATE_HZ


#: name -> dialect
DIALECTS = {
    d.name: d
    for d in (
        Dialect("tum", lambda n, t: f"rgb/{n:06}.png", lambda n, t: f"depth/{n:06}.png", _write_tum),
        Dialect(
            "icl-nuim", lambda n, t: f"rgb/{n}.png", lambda n, t: f"depth/{n}.png", _write_icl_nuim, _check_icl_nuim
        ),
        Dialect(
            "euroc",
            lambda n, t: f"mav0/cam0/data/{_nanoseconds(t)}.png",
            lambda n, t: f"mav0/depth0/data/{_nanoseconds(t)}.png",
            _write_euroc,
        ),
        Dialect("nerf", lambda n, t: f"images/{n:06}.png", lambda n, t: f"depth/{n:06}.png", _write_nerf, _check_nerf),
    )
}
