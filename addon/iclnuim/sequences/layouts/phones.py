"""Folders that apps on phones export: Stray Scanner and Record3D, and Polycam's, which is only read.

Depth has fewer pixels than colour, whose camera the files give; that of depth sees the same.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError, WorkError, within
from ...formats.depth_units import UNITS_PER_METRE
from ...formats.files import (
    atomic_write,
    atomic_write_text,
    data_lines,
    is_file,
    is_number,
    read_json,
    read_text,
    write_json,
)
from ...formats.image_names import files_in
from ...formats.images import image_header, read_colour8
from ...formats.libraries import first_library
from ...geometry import axes
from ...geometry.camera import PinholeCamera
from ...trajectory_files.phones import record3d_stamps
from ...trajectory_files.stamps import stamp_text
from ..camera_files import SequenceCamera, camera_file, numbers_in, pinhole_of_matrix
from ..contents import Contents
from ..format import FormatLimits, Reader, SequenceFormat, truth_at
from ..frames import Row, rows_by_name
from . import tum

_UNITS = 1000.0
_METADATA = "metadata.json"
_ODOMETRY = "odometry.csv"
_MATRIX = "camera_matrix.csv"
_VIDEO = "rgb.mp4"
#: Columns of the depth that these phones give.
DEPTH_WIDTH = 256
#: Focal lengths of a phone that focuses differ from frame to frame: by more than this share of them
#: one camera does not fit.
_MAX_FOCUS = 0.02
_CONFIDENCE = "confidence is not applied: depth of every confidence is read"


def _by_stem(folder: Path, *patterns: str) -> dict[str, Path]:
    """The images of a folder by their names, which are numbers."""
    return {path.stem: path for path in files_in(folder, *patterns) if path.stem.isdecimal()}


def _seen_by_depth(
    colour: PinholeCamera, depth: Path, units: float, notes: Sequence[str]
) -> SequenceCamera:
    """The camera of depth images that show what the colour images do."""
    header = image_header(depth)
    pinhole = colour.resized(header.width, header.height)
    same = (colour.width, colour.height) == (header.width, header.height)
    return SequenceCamera(pinhole, units, colour=None if same else colour, notes=tuple(notes))


def _write_stray(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    poses = contents.poses
    rows = zip(contents.frames, poses.translation.tolist(), poses.quat_xyzw.tolist(), strict=True)
    for frame, position, quaternion in rows:
        values = [f"{value + 0.0:.9f}" for value in position]
        values += [f"{value + 0.0:.12f}" for value in quaternion]
        lines.append(", ".join([frame.stamp_text(), f"{frame.number:06}", *values]))
    atomic_write_text(folder / _ODOMETRY, "\n".join(lines) + "\n")
    K = [", ".join(f"{value:.12g}" for value in row) for row in contents.camera.K.tolist()]
    atomic_write_text(folder / _MATRIX, "\n".join(K) + "\n")
    images = [folder / path for path in format.images(contents, RGB).paths]
    if all(map(is_file, images)):  # the texts are written before the images, too
        _write_video(folder / _VIDEO, images, contents)


def _write_video(path: Path, images: Sequence[Path], contents: Contents) -> None:
    """Write the colour images as a video, which is all that the app's tools read, if OpenCV is
    there.
    """
    try:
        _, cv2 = first_library("a video", "cv2")
    except WorkError:
        return
    size = (contents.camera.width, contents.camera.height)

    def write(temporary: Path) -> None:
        code = cv2.VideoWriter_fourcc(*"mp4v")
        video = cv2.VideoWriter(str(temporary), code, max(1.0, contents.rate_hz), size)
        for image in images:
            video.write(read_colour8(image)[..., ::-1].copy())
        video.release()

    atomic_write(path, write)


def _write_record3d(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    c = contents.camera
    small = c.narrowed(DEPTH_WIDTH)
    poses = axes.world_blender_from_world_cv(contents.poses)
    content = {
        "w": c.width,
        "h": c.height,
        "dw": small.width,
        "dh": small.height,
        "K": c.K.T.ravel().tolist(),
        "fps": contents.rate_hz,
        "frameTimestamps": [float(frame.stamp_text()) for frame in contents.frames],
        "poses": (np.hstack([poses.quat_xyzw, poses.translation]).round(12) + 0.0).tolist(),
    }
    write_json(folder / _METADATA, content)


def _remarks(contents: Contents) -> list[str]:
    numbers = [frame.number for frame in contents.frames]
    if numbers == list(range(len(numbers))):
        return []
    return ["its tools expect frames from 0 on without gaps"]


def _named(stem: str, kind: str, ending: str) -> str:
    return f"{kind}/{stem}" + {RGB: ".jpg", DEPTH: ending}.get(kind, ".png")


def _notes(folder: Path) -> list[str]:
    return [_CONFIDENCE] if (folder / "confidence").is_dir() else []


def _stray_rows(folder: Path) -> list[Row]:
    colours = _by_stem(folder / "rgb", "*.jpg", "*.png")
    if not colours and is_file(folder / _VIDEO):
        raise InputError(
            f"the frames of {_VIDEO} as images rgb/000000.jpg, rgb/000001.jpg ...",
            path=folder,
            found="the video alone",
            hint="in this folder: mkdir rgb; ffmpeg -i rgb.mp4 -start_number 0 -q:v 1 rgb/%06d.jpg",
        )
    rows = rows_by_name(colours, _by_stem(folder / "depth", "*.png"))
    stamps = _stray_stamps(folder / _ODOMETRY)
    if not stamps:
        return rows
    numbered = ((row, stamps.get(row.number or 0)) for row in rows)
    return [row._replace(stamp_s=float(s), written=(s, s)) for row, s in numbered if s]


def _stray_stamps(path: Path) -> dict[int, str]:
    """The stamps of odometry.csv in seconds by the number of the frame; {} without these columns."""
    lines = data_lines(read_text(path))
    columns = [name.strip() for name in lines[0][1].split(",")] if lines else []
    if not {"timestamp", "frame"} <= set(columns):
        return {}
    stamp, frame = columns.index("timestamp"), columns.index("frame")
    found = {}
    for number, line in lines[1:]:
        fields = [field.strip() for field in line.split(",")]
        given = [fields[column] for column in (stamp, frame) if column < len(fields)]
        if not all(map(is_number, given)) or not given[-1].isdecimal() or len(given) < 2:
            raise InputError("a timestamp and a frame", path=path, line=number, found=line[:60])
        found[int(given[1])] = given[0]
    return found


def _stray_camera(folder: Path, image: Path) -> SequenceCamera | None:
    if there := camera_file(folder):
        return there
    file = folder / _MATRIX
    values = read_text(file).replace(",", " ").split()
    what = "the nine numbers of the camera matrix of colour"
    K = np.reshape(numbers_in(file, values, 9, what), (3, 3))
    colour = pinhole_of_matrix(image, file, K)
    depth = _first(folder / "depth", "*.png")
    return _seen_by_depth(colour, depth, _UNITS, _notes(folder))


def _first(folder: Path, pattern: str) -> Path:
    for path in _by_stem(folder, pattern).values():
        return path
    raise InputError(f"depth images {pattern}", path=folder, found="none")


def _record3d_rows(folder: Path) -> list[Row]:
    rows = rows_by_name(
        _by_stem(folder / "rgb", "*.jpg", "*.png"), _by_stem(folder / "depth", "*.exr")
    )
    file = folder / _METADATA
    stamps_s = record3d_stamps(file, read_json(file))
    if stamps_s is None:
        return rows
    places = [row.number or 0 for row in rows]
    if len(rows) == len(stamps_s):  # whatever the first number is
        places = list(range(len(rows)))
    found = []
    for row, place in zip(rows, places, strict=True):
        if place < len(stamps_s):
            text = stamp_text(float(stamps_s[place]))
            found.append(row._replace(stamp_s=float(stamps_s[place]), written=(text, text)))
    return found


def _record3d_camera(folder: Path, image: Path) -> SequenceCamera | None:
    if there := camera_file(folder):
        return there
    file = folder / _METADATA
    content: Any = read_json(file)
    given = content.get("K")
    what = "K: the nine numbers of the camera matrix of colour, column by column"
    K = np.reshape(numbers_in(file, given if isinstance(given, list) else [], 9, what), (3, 3)).T
    colour = pinhole_of_matrix(image, file, K)
    notes = _notes(folder)
    per_frame = content.get("perFrameIntrinsicCoeffs")
    if isinstance(per_frame, list) and per_frame:
        rows = [row if isinstance(row, list) else [] for row in per_frame]
        what = "perFrameIntrinsicCoeffs as rows fx fy cx cy"
        every = np.array([numbers_in(file, row, 4, what) for row in rows])
        notes += _focus_notes(file, every[:, 0])
    return _seen_by_depth(colour, _first(folder / "depth", "*.exr"), UNITS_PER_METRE, notes)


def _focus_notes(path: Path, focal_px: np.ndarray) -> list[str]:
    """A sentence if the focal lengths of frames (n,) differ.

    Raises InputError if one camera does not fit them.
    """
    low, high = float(focal_px.min()), float(focal_px.max())
    span = f"focal lengths of {low:.6g} to {high:.6g} pixels"
    if not 0 < high - low <= _MAX_FOCUS * high:
        if high == low:
            return []
        raise InputError("frames of one camera", path=path, found=span)
    return [f"{span} from frame to frame: one camera is used"]


def _keyframes(folder: Path) -> Path:
    return folder / "keyframes" if (folder / "keyframes").is_dir() else folder


def _polycam_folder(folder: Path, kind: str) -> Path:
    """The folder of the optimised images or cameras, if both are there, or of the others."""
    top = _keyframes(folder)
    optimised = all((top / f"corrected_{each}").is_dir() for each in ("images", "cameras"))
    return top / (f"corrected_{kind}" if optimised else kind)


def _polycam_rows(folder: Path) -> list[Row]:
    colours = _by_stem(_polycam_folder(folder, "images"), "*.jpg", "*.png")
    cameras = _by_stem(_polycam_folder(folder, "cameras"), "*.json")
    depths = _by_stem(_keyframes(folder) / "depth", "*.png")
    if not depths:
        raise InputError(
            "keyframes/depth, which LiDAR sessions have",
            path=folder,
            found="none",
            hint="`trajectory` for its poses, keyframes/cameras",
        )
    posed = {name: colours[name] for name in sorted(colours.keys() & cameras.keys())}
    return rows_by_name(posed, depths)


def _polycam_camera(folder: Path, image: Path) -> SequenceCamera | None:
    if there := camera_file(folder):
        return there
    files = list(_by_stem(_polycam_folder(folder, "cameras"), "*.json").values())
    every = []
    for file in files:
        content: Any = read_json(file)
        keys = ("width", "height", "fx", "fy", "cx", "cy")
        every.append(numbers_in(file, [content.get(key) for key in keys], 6, " ".join(keys)))
    values = np.array(every)
    notes = _notes(_keyframes(folder)) + _focus_notes(files[0].parent, values[:, 2])
    width, height, *intrinsics = np.median(values, axis=0).tolist()
    with within(files[0].parent):
        given = PinholeCamera(int(width), int(height), *intrinsics)
    header = image_header(image)
    colour = given.resized(header.width, header.height)
    return _seen_by_depth(colour, _first(_keyframes(folder) / "depth", "*.png"), _UNITS, notes)


_LIMITS = FormatLimits(
    depth_stamps=False, depth_width=DEPTH_WIDTH, every_pose=True, remarks=_remarks
)
STRAY_SCANNER = SequenceFormat(
    "stray-scanner",
    "Stray Scanner, a phone's depth: rgb/ (the frames of rgb.mp4), depth/, confidence/, "
    "odometry.csv, camera_matrix.csv",
    lambda frame, kind: _named(f"{frame.number:06}", kind, ".png"),
    _write_stray,
    Reader(
        lambda folder: is_file(folder / _ODOMETRY) and is_file(folder / _MATRIX),
        _stray_rows,
        _stray_camera,
        truth_at(_ODOMETRY),
    ),
    replace(_LIMITS, fixed_units=_UNITS, confidence=True),
)
RECORD3D = SequenceFormat(
    "record3d",
    "Record3D's export as EXR and JPG, a phone's depth: rgb/, depth/*.exr, metadata.json",
    lambda frame, kind: _named(f"{frame.number:06}", kind, ".exr"),
    _write_record3d,
    Reader(
        lambda folder: is_file(folder / _METADATA) and (folder / "rgb").is_dir(),
        _record3d_rows,
        _record3d_camera,
        truth_at(_METADATA),
    ),
    _LIMITS,
    published_image=lambda frame, kind: _named(str(frame.number), kind, ".exr"),
)
POLYCAM = tum.read_only(
    "polycam",
    "Polycam's raw data: keyframes/ with images/, depth/, cameras/, or the corrected ones",
    Reader(
        lambda folder: (
            _polycam_folder(folder, "cameras").is_dir()
            and _polycam_folder(folder, "images").is_dir()
        ),
        _polycam_rows,
        _polycam_camera,
        lambda folder: _polycam_folder(folder, "cameras"),
    ),
)
