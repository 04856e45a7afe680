"""The dialects euroc and nerf taken back: where their images lie, their camera, their poses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..formats.files import read_json, read_text
from ..formats.table import data_lines
from ..geometry import axes
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from .depth_units import UNITS_PER_METRE

EUROC, NERF = Path("mav0"), Path("transforms.json")

Row = tuple[float, Path, Path]


def rows(folder: Path) -> list[Row]:
    """(stamp in seconds, colour, depth) of every frame; [] where the folder is of neither form."""
    if (folder / EUROC).is_dir():
        return _euroc_rows(folder / EUROC)
    return _nerf_rows(folder) if (folder / NERF).is_file() else []


def camera(folder: Path) -> tuple[PinholeCamera, float] | None:
    """The camera and the depth units a metre; None where the folder is of neither form."""
    if (folder / EUROC).is_dir():
        return _euroc_camera(folder / EUROC / "depth0" / "sensor.yaml")
    return _nerf_camera(folder / NERF) if (folder / NERF).is_file() else None


def nerf_truth(folder: Path) -> Trajectory | None:
    """Poses of transforms.json; None where it is not there. (Those of euroc are a trajectory file like others.)"""
    frames = _nerf_rows(folder) if (folder / NERF).is_file() else []
    if not frames:
        return None
    try:
        matrices = np.array([f["transform_matrix"] for f in read_json(folder / NERF)["frames"]], float)
        poses = axes.world_cv_from_world_blender(SE3.from_matrix(matrices))
        return Trajectory(np.array([stamp_s for stamp_s, _, _ in frames]), poses)
    except (KeyError, TypeError, ValueError):
        raise InputError("frames with a 4 x 4 transform_matrix", path=folder / NERF) from None


def _euroc_rows(mav: Path) -> list[Row]:
    images = [_euroc_images(mav / sensor) for sensor in ("cam0", "depth0")]
    return [(ns / 1e9, images[0][ns], images[1][ns]) for ns in sorted(images[0].keys() & images[1].keys())]


def _euroc_images(sensor: Path) -> dict[int, Path]:
    """Nanoseconds -> image, as data.csv has them."""
    table = sensor / "data.csv"
    try:
        fields = [line.split(",") for _, line in data_lines(read_text(table))]
        return {int(stamp): sensor / "data" / name.strip() for stamp, name in fields}
    except ValueError:
        raise InputError("lines `nanoseconds,image`", path=table) from None


def _euroc_camera(file: Path) -> tuple[PinholeCamera, float]:
    text = read_text(file)
    lists = {name: re.search(rf"^{name}: *\[(.*)\]", text, re.MULTILINE) for name in ("resolution", "intrinsics")}
    try:
        width, height = (int(value) for value in lists["resolution"][1].split(","))  # type: ignore[index]
        fx, fy, cx, cy = (float(value) for value in lists["intrinsics"][1].split(","))  # type: ignore[index]
    except (TypeError, ValueError):
        raise InputError("resolution: [w, h] and intrinsics: [fx, fy, cx, cy]", path=file) from None
    units = re.search(r"^depth_units_per_metre: *([\d.]+)", text, re.MULTILINE)
    return PinholeCamera(width, height, fx, fy, cx, cy), float(units[1]) if units else UNITS_PER_METRE


def _nerf_rows(folder: Path) -> list[Row]:
    found = []
    for place, frame in enumerate(_nerf_frames(folder / NERF)):
        image, depth = (frame.get(key) for key in ("file_path", "depth_file_path"))
        if not isinstance(image, str) or not isinstance(depth, str):
            raise InputError("frames with file_path and depth_file_path", path=folder / NERF, found=f"frame {place}")
        number = int(Path(image).stem) if Path(image).stem.isdigit() else place
        found.append((number / FRAME_RATE_HZ, folder / image, folder / depth))
    return found


def _nerf_frames(file: Path) -> list[dict]:
    frames = read_json(file).get("frames")
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise InputError("a list of frames", path=file)
    return frames


def _nerf_camera(file: Path) -> tuple[PinholeCamera, float]:
    """Their pixel centres lie at +0.5."""
    content = read_json(file)
    try:
        w, h, fx, fy, cx, cy = (float(content[key]) for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"))
        units = 1 / float(content.get("integer_depth_scale", 1 / UNITS_PER_METRE))
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        raise InputError("numbers w, h, fl_x, fl_y, cx, cy, integer_depth_scale", path=file) from None
    return PinholeCamera(int(w), int(h), fx, fy, cx - 0.5, cy - 0.5), units
