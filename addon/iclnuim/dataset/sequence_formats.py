"""The formats a sequence is written in: where the images lie, and the text files beside them.

A new format is one entry of FORMATS; the command line, the panel and the pages list what stands there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..formats.associations import Associations, ImageList, write_associations, write_image_list
from ..formats.files import atomic_write, atomic_write_text, write_json
from ..formats.trajectories import write_trajectory
from ..geometry import axes
from ..geometry.camera import PinholeCamera
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory, frame_rate_hz, frames_of_stamps, sample
from . import slam_settings
from .depth_units import UNITS_PER_METRE


@dataclass(frozen=True)
class SequenceFrame:
    """One pair to be written: the frame's number and its stamp in seconds; and what the format tum keeps of a sequence that somebody has,
    by kind of image (rgb, depth): its path in that folder, and its stamp as the lists write it ("" where there is none).
    """

    number: int
    stamp_s: float
    paths: Mapping[str, str] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Contents:
    """What the text files say: frames in order, camera, ground truth (None where there is none), and the format and bytes of a
    ground-truth file, which a sequence in that format keeps as it is.
    """

    camera: PinholeCamera
    frames: tuple[SequenceFrame, ...]
    truth: Trajectory | None
    depth_units_per_metre: float = UNITS_PER_METRE
    truth_file: tuple[str, bytes] | None = None

    @cached_property
    def stamps_s(self) -> np.ndarray:
        """(n,) seconds."""
        return np.array([frame.stamp_s for frame in self.frames])

    @property
    def rate_hz(self) -> float:
        """Frames a second by the stamps; the benchmark's for a single frame."""
        return frame_rate_hz(self.stamps_s)


@dataclass(frozen=True)
class SequenceFormat:
    """`image` gives the path of a frame's image: its rgb, its depth, or a kind of ground truth; `write_texts` writes all that is no image;
    `check` raises InputError for contents that the format cannot hold.
    """

    name: str
    description: str
    image: Callable[[SequenceFrame, str], str]
    write_texts: "Callable[[Path, Contents, SequenceFormat], None]"
    check: Callable[[Contents], object] = lambda contents: None

    def images(self, contents: Contents, kind: str) -> ImageList:
        """All images of a kind with their stamps."""
        frames = contents.frames
        paths, written = (tuple(self.image(f, kind) for f in frames), tuple(f.written.get(kind, "") for f in frames))
        return ImageList(tuple(frame.stamp_s for frame in frames), paths, written)


def sequence_format(name: str) -> SequenceFormat:
    """Raises InputError for an unknown name."""
    if name not in FORMATS:
        raise InputError(f"a sequence format ({', '.join(FORMATS)})", found=name)
    return FORMATS[name]


def _write_tum(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    """rgb.txt, depth.txt, associations.txt, groundtruth.txt, camera.json; settings for ORB-SLAM3. Stamps that are to be kept are written
    as they were, to the character.
    """
    rgb, depth = (format.images(contents, kind) for kind in ("rgb", "depth"))
    write_image_list(folder / "rgb.txt", rgb)
    write_image_list(folder / "depth.txt", depth)
    write_associations(folder / "associations.txt", Associations(rgb, depth))
    units = {"depth_units_per_metre": contents.depth_units_per_metre}
    write_json(folder / "camera.json", contents.camera.to_dict() | units)
    settings = slam_settings.orb_slam3(contents.camera, contents.rate_hz, contents.depth_units_per_metre)
    atomic_write_text(folder / "orb_slam3.yaml", settings)
    _write_truth(folder / "groundtruth.txt", contents, "tum")


def _write_truth(path: Path, contents: Contents, format: str) -> None:
    """A ground-truth file, where there is ground truth."""
    kept_format, data = contents.truth_file or ("", b"")
    if kept_format == format:
        atomic_write(path, lambda temporary: temporary.write_bytes(data))
    elif contents.truth is not None:
        write_trajectory(path, contents.truth, format)


def _write_icl_nuim(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    """The original's: depth first with integer ids, left-handed anchored poses without image 0, K with fy negative."""
    rgb, depth = (format.images(contents, kind) for kind in ("rgb", "depth"))
    write_associations(folder / "associations.txt", Associations(rgb, depth, "icl-nuim"), "icl-nuim")
    c = contents.camera
    rows = ((c.fx, 0, c.cx), (0, -c.fy, c.cy), (0, 0, 1))
    atomic_write_text(folder / "calibration.txt", "".join(f"{a:.6f} {b:.6f} {d:.6f}\n" for a, b, d in rows))
    if contents.truth is not None and len(contents.truth) > (frames_of_stamps(contents.truth.stamps_s)[0] < 0.5):
        _write_truth(folder / "groundtruth.gt.freiburg", contents, "gt.freiburg")


def _check_icl_nuim(contents: Contents) -> None:
    if contents.depth_units_per_metre != UNITS_PER_METRE:  # no file of this format could hold them
        found = f"{contents.depth_units_per_metre:g}"
        raise InputError(f"{UNITS_PER_METRE:g} depth units a metre for the format icl-nuim", found=found)
    numbers = np.array([frame.number for frame in contents.frames])
    if np.abs(frames_of_stamps(contents.stamps_s) - numbers).max() > 0.01:
        expected = f"stamps of frame numbers, 1 + number / {FRAME_RATE_HZ:g} s, for the format icl-nuim"
        raise InputError(expected, found="others", hint="the format tum")


def _write_euroc(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    """mav0/cam0 (colour), mav0/depth0 (16 bit), their sensor.yaml, and state_groundtruth_estimate0; stamps in ns."""
    for sensor, what in (("cam0", "camera"), ("depth0", "depth camera, 16 bit, 0 = missing")):
        rows = [f"{ns},{ns}.png\n" for ns in map(_nanoseconds, contents.frames)]
        table = "#timestamp [ns],filename\n" + "".join(rows)
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
rate_hz: {contents.rate_hz:g}
resolution: [{c.width}, {c.height}]
camera_model: pinhole
intrinsics: [{c.fx:.9g}, {c.fy:.9g}, {c.cx:.9g}, {c.cy:.9g}]
distortion_model: radial-tangential
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
depth_units_per_metre: {contents.depth_units_per_metre:g}
"""


def _write_nerf(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    """transforms.json: poses of the OpenGL camera (x right, y up, looks along -z) in our z-up world.

    NeRF programs count pixel centres at +0.5, so the principal point lies half a pixel further.
    """
    c, truth = contents.camera, _truth_for_nerf(contents)
    rgb, depth = (format.images(contents, kind) for kind in ("rgb", "depth"))
    poses = axes.world_blender_from_world_cv(sample(truth, contents.stamps_s)).matrix
    rows = zip(rgb.paths, depth.paths, poses.tolist(), strict=True)
    content = {
        "camera_model": "OPENCV",
        **{"w": c.width, "h": c.height, "fl_x": c.fx, "fl_y": c.fy, "cx": c.cx + 0.5, "cy": c.cy + 0.5},
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        "camera_angle_x": float(2 * np.arctan(c.width / (2 * c.fx))),
        "camera_angle_y": float(2 * np.arctan(c.height / (2 * c.fy))),
        "enable_depth_loading": True,
        "integer_depth_scale": 1 / contents.depth_units_per_metre,
        # nerfstudio reads depth_file_path, instant-ngp depth_path
        "frames": [{"file_path": a, "depth_file_path": b, "depth_path": b, "transform_matrix": m} for a, b, m in rows],
    }
    write_json(folder / "transforms.json", content)


def _truth_for_nerf(contents: Contents) -> Trajectory:
    if contents.truth is None or len(contents.truth) < 2:
        raise InputError("at least two poses for the format nerf", found="fewer", hint="the format tum")
    return contents.truth


def _nanoseconds(frame: SequenceFrame) -> int:
    """By the shortest decimal that stands for the stamp: 1305031102.175304 s has no ...303936 ns in it."""
    return round(Decimal(repr(frame.stamp_s)) * 10**9)


_ALL = (
    SequenceFormat(
        "tum",
        "rgb/, depth/, their lists, associations.txt, groundtruth.txt, camera.json, orb_slam3.yaml",
        lambda f, kind: f.paths.get(kind) or f"{kind}/{f.number:06}.png",
        _write_tum,
    ),
    SequenceFormat(
        "icl-nuim",
        "as the original: integer ids, depth first, left-handed *.gt.freiburg, calibration.txt",
        lambda f, kind: f"{kind}/{f.number}.png",
        _write_icl_nuim,
        _check_icl_nuim,
    ),
    SequenceFormat(
        "euroc",
        "mav0/cam0, mav0/depth0 and state_groundtruth_estimate0; stamps in nanoseconds",
        lambda f, kind: f"mav0/{'cam' if kind == 'rgb' else kind}0/data/{_nanoseconds(f)}.png",
        _write_euroc,
    ),
    SequenceFormat(
        "nerf",
        "images/, depth/ and transforms.json, for nerfstudio and instant-ngp",
        lambda f, kind: f"{'images' if kind == 'rgb' else kind}/{f.number:06}.png",
        _write_nerf,
        _truth_for_nerf,
    ),
)
#: name -> format
FORMATS = {format.name: format for format in _ALL}
