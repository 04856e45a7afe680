"""EDEX, the recordings of cuVSLAM, with one camera and its depth: 00/ (colour), 01/ (depth), stereo.edex
(cameras), frame_metadata.jsonl (images and stamps of each frame), gt.txt (poses).

The poses are relative to that of the first frame, as the reporter of cuVSLAM expects them
(nvidia-isaac/cuVSLAM, tools/python_tools/cuvslam_tools/dataset_preparation).
"""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError, within
from ...formats.depth_units import check_units
from ...formats.files import atomic_write_text, content_of_json, data_lines, read_text
from ...geometry.axes import CV_FROM_BLENDER_CAMERA
from ...geometry.camera import PinholeCamera
from ...geometry.se3 import SE3
from ...geometry.trajectory import Trajectory
from ...trajectory_files.stamps import stamp_text_of_ns
from ...trajectory_files.trajectories import write_trajectory
from ..camera_files import (
    Keys,
    SequenceCamera,
    absent,
    any_of,
    as_list,
    mount_notes,
    mount_of,
    names,
    numbers_in,
    numbers_of,
)
from ..contents import Contents
from ..format import FormatLimits, Reader, SequenceFormat, truth_at
from ..frames import Row, SequenceFrame

_RIG = Path("stereo.edex")
_FRAMES = "frame_metadata.jsonl"
_TRUTH = "gt.txt"
_FOLDERS = {RGB: "00", DEPTH: "01"}
_IDENTITY = np.eye(4)[:3].tolist()
#: Keys of the two parts of stereo.edex, of a camera and of its intrinsics.
KEYS = Keys(
    used=names("cameras frame_metadata transform intrinsics depth_id depth_scale_factor")
    | names("focal principal size"),
    harmless=names(
        "version frame_start frame_end fps points2d points3d rig_positions sequence depth_sequence"
    ),
    noted={"imu": absent, "projection": absent, "rectification": absent},
    required={"distortion_model": any_of("pinhole", "brown", "brown5k", "polynomial")},
    distortion=names("distortion_params"),
)


class _Rig(NamedTuple):
    """stereo.edex: its first camera with depth, the number of that camera, and all that it says."""

    path: Path
    camera: dict[str, Any]
    number: int
    said: list[dict[str, Any]]
    frames: Path


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    images = {kind: format.images(contents, kind).paths for kind in (RGB, DEPTH)}
    lines = []
    for place, frame in enumerate(contents.frames):
        said = {"frame_id": place}
        for key, kind in (("cams", RGB), ("depth", DEPTH)):
            stamp = frame.nanoseconds(kind)
            image = {"id": 0, "filename": images[kind][place], "timestamp": stamp}
            said |= {key: [image]}  # type: ignore[dict-item]
        lines.append(json.dumps(said, separators=(",", ":")) + "\n")
    atomic_write_text(folder / _FRAMES, "".join(lines))
    relative = contents.poses[0].inverse() @ contents.poses
    write_trajectory(folder / _TRUTH, Trajectory(contents.stamps_s, relative), "kitti")
    atomic_write_text(folder / _RIG, _rig_text(contents, images))


def _rig_text(contents: Contents, images: dict[str, tuple[str, ...]]) -> str:
    c = contents.camera
    camera = {
        "transform": _IDENTITY,
        "intrinsics": {
            "distortion_model": "pinhole",
            "distortion_params": [],
            "focal": [c.fx, c.fy],
            "principal": [c.cx, c.cy],
            "size": [c.width, c.height],
        },
        "depth_id": 0,
        "depth_scale_factor": contents.depth_units_per_metre,
    }
    last = len(contents.frames) - 1
    head = {"version": "0.9", "frame_start": 0, "frame_end": last, "cameras": [camera]}
    body = {
        "frame_metadata": _FRAMES,
        "sequence": [[images[RGB][0]]],
        "depth_sequence": [[images[DEPTH][0]]],
        **{key: {} for key in ("points2d", "points3d", "rig_positions")},
    }
    return json.dumps([head, body], indent=1) + "\n"


def _remarks(contents: Contents) -> list[str]:
    if np.abs(contents.poses[0].matrix - np.eye(4)).max() < 1e-9:
        return []
    return ["poses are relative to that of the first frame"]


def _rig(folder: Path) -> _Rig:
    """The rig. Raises InputError unless a camera has depth."""
    path = folder / _RIG
    content = content_of_json(read_text(path), "EDEX", path)
    parts = content if isinstance(content, list) else []
    if len(parts) < 2 or not all(isinstance(part, dict) for part in parts):
        raise InputError("two objects: of the cameras, and of their files", path=path)
    cameras = as_list(parts[0].get("cameras"))
    with_depth = [
        k for k, c in enumerate(cameras) if isinstance(c, dict) and c.get("depth_id") is not None
    ]
    if not with_depth:
        found = f"{len(cameras)} cameras without it"
        hint = "an RGB-D recording: stereo alone has no depth"
        raise InputError("a camera with depth_id", path=path, found=found, hint=hint)
    camera = cameras[with_depth[0]]
    said = [*parts, camera, camera.get("intrinsics") or {}]
    frames = parts[1].get("frame_metadata")
    if not isinstance(frames, str) or not isinstance(said[-1], dict):
        raise InputError("frame_metadata, the name of a file, and intrinsics", path=path)
    return _Rig(path, camera, with_depth[0], said, folder / frames)


def _rows(folder: Path) -> list[Row]:
    rig = _rig(folder)
    found = []
    for line, text in data_lines(read_text(rig.frames)):
        images = []
        said = _object(rig.frames, line, text)
        for key, number in (("cams", rig.number), ("depth", rig.camera["depth_id"])):
            images.append(_image_of(rig.frames, line, said.get(key), number))
        (colour, ns), (depth, depth_ns) = images
        written = (stamp_text_of_ns(ns), stamp_text_of_ns(depth_ns))
        found.append(Row(ns / 1e9, folder / colour, folder / depth, written))
    return sorted(found, key=lambda row: row.stamp_s)


def _object(path: Path, line: int, text: str) -> dict[str, Any]:
    said = None
    with suppress(InputError):
        said = content_of_json(text)
    if not isinstance(said, dict):
        raise InputError("a JSON object", path=path, line=line, found=text[:60])
    return said


def _image_of(path: Path, line: int, images: Any, number: Any) -> tuple[str, int]:
    """The file of a camera's image in a frame, and its stamp in nanoseconds."""
    for image in as_list(images):
        if isinstance(image, dict) and image.get("id") == number:
            name, stamp = image.get("filename"), image.get("timestamp")
            if isinstance(name, str) and isinstance(stamp, int) and 0 <= stamp < 1 << 63:
                return name, stamp
    expected = f"the file and the stamp in nanoseconds of an image with id {number}"
    raise InputError(expected, path=path, line=line, found=str(images)[:60])


def _camera(folder: Path, image: Path) -> SequenceCamera:
    rig = _rig(folder)
    intrinsics = rig.said[-1]
    values = [v for key in ("size", "focal", "principal") for v in as_list(intrinsics.get(key))]
    what = "size: [w, h], focal: [fx, fy] and principal: [cx, cy]"
    width, height, *pinhole = numbers_in(rig.path, values, 6, what)
    given = [rig.camera.get("depth_scale_factor", 1000.0)]
    (units,) = numbers_in(rig.path, given, 1, "depth_scale_factor as a number")
    notes = [*KEYS.notes(rig.said, rig.path), *mount_notes(_mount(folder), "transform")]
    if (count := len(as_list(rig.said[0]["cameras"]))) > 1:
        notes.append(f"{rig.path.name} has {count} cameras, of which number {rig.number} is read")
    with within(rig.path):
        camera = PinholeCamera(int(width), int(height), *pinhole)
        return SequenceCamera(camera, check_units(units), notes=tuple(notes))


def _mount(folder: Path) -> SE3 | None:
    """The pose of the camera in the rig, which the file gives in OpenGL's axes of both."""
    rig = _rig(folder)
    numbers = numbers_of(rig.camera.get("transform", _IDENTITY))
    if numbers is None or len(numbers) not in (12, 16) or not np.isfinite(numbers).all():
        raise InputError("transform as a 3 x 4 matrix", path=rig.path)
    matrix = np.vstack([numbers[:12].reshape(3, 4), [0, 0, 0, 1]])
    with within(rig.path):
        T = SE3.from_matrix(matrix)
    flip = CV_FROM_BLENDER_CAMERA
    return mount_of(SE3(flip @ T.rotation @ flip, flip @ T.translation))


def _image(frame: SequenceFrame, kind: str) -> str:
    return f"{_FOLDERS.get(kind, kind)}/{frame.number:06}.png"


FORMAT = SequenceFormat(
    "edex",
    "cuVSLAM's EDEX: 00/ (colour), 01/ (depth), stereo.edex, frame_metadata.jsonl in nanoseconds, "
    "gt.txt relative to the first frame",
    _image,
    _write,
    Reader(lambda folder: (folder / _RIG).is_file(), _rows, _camera, truth_at(_TRUTH), _mount),
    FormatLimits("ns", every_pose=True, remarks=_remarks),
)
