"""transforms.json with poses of the OpenGL camera (x right, y up, looks along -z), for nerfstudio
and instant-ngp.

NeRF programs have pixel centres at +0.5, so half a pixel is added to the principal point.
"""

from pathlib import Path

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError
from ...formats.depth_units import check_units
from ...formats.files import read_json, write_json
from ...formats.pose_folders import numbers_of_names
from ...geometry import axes
from ...geometry.camera import PinholeCamera
from ...geometry.trajectory import stamps_of_frames
from ..layout import Contents, Reader, Row, SequenceCamera, SequenceFormat

FILE = Path("transforms.json")
_FOLDERS = {RGB: "images"}
#: Depth units per metre that nerfstudio assumes (depth_unit_scale_factor of its Nerfstudio data
#: parser).
_NERFSTUDIO_UNITS = 1000.0
_CAMERA = ("w", "h", "fl_x", "fl_y", "cx", "cy")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    c = contents.camera
    rgb, depth = (format.images(contents, kind) for kind in (RGB, DEPTH))
    poses = axes.world_blender_from_world_cv(contents.poses).matrix
    rows = zip(rgb.paths, depth.paths, poses.tolist(), strict=True)
    content = {
        "camera_model": "OPENCV",
        "w": c.width,
        "h": c.height,
        "fl_x": c.fx,
        "fl_y": c.fy,
        "cx": c.cx + 0.5,
        "cy": c.cy + 0.5,
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        "camera_angle_x": float(2 * np.arctan(c.width / (2 * c.fx))),
        "camera_angle_y": float(2 * np.arctan(c.height / (2 * c.fy))),
        "enable_depth_loading": True,
        "integer_depth_scale": 1 / contents.depth_units_per_metre,
        "frames": [_frame(rgb_path, depth_path, pose) for rgb_path, depth_path, pose in rows],
    }
    write_json(folder / FILE, content)


def _frame(rgb: str, depth: str, pose: list) -> dict:
    # nerfstudio reads depth_file_path, instant-ngp depth_path
    depths = {"depth_file_path": depth, "depth_path": depth}
    return {"file_path": rgb, **depths, "transform_matrix": pose}


def _check(contents: Contents) -> None:
    if contents.truth is None or len(contents.truth) < 2:
        expected = "at least two poses for the format nerf"
        raise InputError(expected, found="fewer", hint="the format tum")


def _remarks(contents: Contents) -> list[str]:
    units = contents.depth_units_per_metre
    if units == _NERFSTUDIO_UNITS:
        return []
    setting = f"depth_unit_scale_factor {1 / units:.6g}"
    return [f"nerfstudio reads the depth right with the setting {setting}"]


def _rows(folder: Path) -> list[Row]:
    images: list[tuple[str, str]] = []
    frames = read_json(folder / FILE).get("frames")
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise InputError("a list of frames", path=folder / FILE)
    for place, frame in enumerate(frames):
        image, depth = (frame.get(key) for key in ("file_path", "depth_file_path"))
        if not isinstance(image, str) or not isinstance(depth, str):
            expected = "frames with file_path and depth_file_path"
            raise InputError(expected, path=folder / FILE, found=f"frame {place}")
        images.append((image, depth))
    found = []
    numbers = numbers_of_names([image for image, _ in images])
    for (image, depth), number in zip(images, numbers, strict=True):
        stamp_s = float(stamps_of_frames(number))
        found.append(Row(stamp_s, folder / image, folder / depth, number=number))
    return sorted(found)


def _camera(folder: Path, image: Path) -> SequenceCamera:
    content = read_json(folder / FILE)
    try:
        w, h, fx, fy, cx, cy = (float(content[key]) for key in _CAMERA)
        scale = content.get("depth_unit_scale_factor", 1 / _NERFSTUDIO_UNITS)
        units = 1 / float(content.get("integer_depth_scale", scale))
        size = int(w), int(h)
        distorted = any(float(content.get(key, 0)) for key in _DISTORTION)
    except (KeyError, TypeError, ValueError, OverflowError, ZeroDivisionError):
        expected = "numbers w, h, fl_x, fl_y, cx, cy, integer_depth_scale and of the distortion"
        raise InputError(expected, path=folder / FILE) from None
    pinhole = PinholeCamera(*size, fx, fy, cx - 0.5, cy - 0.5)
    return SequenceCamera(pinhole, check_units(units), distorted=distorted)


FORMAT = SequenceFormat(
    "nerf",
    "images/, depth/ and transforms.json, for nerfstudio and instant-ngp",
    lambda frame, kind: f"{_FOLDERS.get(kind, kind)}/{frame.number:06}.png",
    _write,
    Reader(lambda folder: (folder / FILE).is_file(), _rows, _camera, lambda folder: folder / FILE),
    _check,
    remarks=_remarks,
    stamps="numbers",
    depth_stamps=False,
    every_pose=True,
)
