"""transforms.json with poses of the OpenGL camera (x right, y up, looks along -z), for nerfstudio
and instant-ngp.

NeRF programs have pixel centres at +0.5, so half a pixel is added to the principal point.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError, within
from ...formats.depth_units import check_units
from ...formats.files import is_file, read_json, write_json
from ...formats.images import image_header
from ...formats.ply import write_ply
from ...geometry import axes
from ...geometry.camera import PinholeCamera
from ...geometry.trajectory import stamps_of_frames
from ...trajectory_files.matrices import APPLIED_SCALE, numbers_of_names
from ...trajectory_files.stamps import seconds_of_names
from ..camera_files import (
    COEFFICIENTS,
    Keys,
    SequenceCamera,
    absent,
    any_of,
    identity,
    names,
    numbers_in,
    one,
    zeros,
)
from ..contents import Contents
from ..format import FormatLimits, Reader, SequenceFormat
from ..frames import Row
from .colmap import HELD_OUT, surface_points

FILE = Path("transforms.json")
_POINTS = "points3D.ply"
_FOLDERS = {RGB: "images"}
#: Depth units per metre that nerfstudio assumes (depth_unit_scale_factor of its Nerfstudio data
#: parser).
_NERFSTUDIO_UNITS = 1000.0
_DEPTH_SCALES = ("integer_depth_scale", "depth_unit_scale_factor")
#: Keys of the camera, of the file or of its frames.
_NUMBERS = (
    *("w", "h", "fl_x", "fl_y", "cx", "cy"),
    *("camera_angle_x", "camera_angle_y", "x_fov", "y_fov"),
    *_DEPTH_SCALES,
)
#: Keys that nerfstudio (its nerfstudio_dataparser.py and data_conventions.md) and instant-ngp
#: (nerf_loader.cu) read, or that their converters write.
KEYS = Keys(
    used=frozenset(_NUMBERS)
    | {"file_path", "depth_file_path", "depth_path", "transform_matrix", APPLIED_SCALE},
    harmless=names(
        "aabb aabb_scale render_aabb render_aabb_to_local up white_transparent black_transparent "
        "fix_premult sharpness sharpness_discard_threshold sharpen importance_sampling "
        "n_extra_learnable_dims enable_depth_loading envmap ply_file_path train_filenames "
        "val_filenames test_filenames colmap_im_id driver_parameters light_dir rotation"
    ),
    noted={
        "applied_transform": identity,
        "scale": one,
        "offset": zeros,
        "orientation_override": any_of("none"),
        "rolling_shutter": zeros,
        "fisheye_crop_radius": zeros,
        "enable_ray_loading": zeros,
        "is_bad": zeros,
    },
    required={
        "camera_model": any_of(
            "opencv", "pinhole", "simple_pinhole", "simple_radial", "radial", "perspective"
        ),
        "is_fisheye": zeros,
        "ftheta_p0": absent,
        "latlong": absent,
        "equirectangular": absent,
        "orthographic": absent,
        "from_mitsuba": zeros,
        "normal_mts_args": absent,
    },
    distortion=COEFFICIENTS,
)
#: Endings of images, which names may lack.
_ENDINGS = (".png", ".jpg", ".jpeg", ".npy")
#: Larger relative differences are another camera,
_SAME = 1e-6
#: and another focal length or depth scale, not the same one with fewer digits.
_ROUNDED = 0.01


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
        **_split(list(rgb.paths)),
        **_points(folder, contents),
        "frames": [_frame(rgb_path, depth_path, pose) for rgb_path, depth_path, pose in rows],
    }
    write_json(folder / FILE, content)


def _split(names: list[str]) -> dict[str, list[str]]:
    """The names for training, and every 8th, which is held out, for validation and test."""
    held_out = sorted(names)[::HELD_OUT]
    train = [name for name in names if name not in held_out]
    split = {"train_filenames": train, "val_filenames": held_out, "test_filenames": held_out}
    return split if train else {}


def _points(folder: Path, contents: Contents) -> dict[str, str]:
    """Write points of the surface, in the world of the poses, if it is known."""
    texts, _ = surface_points(contents)
    if not texts:
        return {}
    values = np.array([text.split() for text in texts], float)
    write_ply(folder / _POINTS, values[:, :3], colours=values[:, 3:].astype(np.uint8))
    return {"ply_file_path": _POINTS}


def _frame(rgb: str, depth: str, pose: list) -> dict:
    # nerfstudio reads depth_file_path, instant-ngp depth_path
    depths = {"depth_file_path": depth, "depth_path": depth}
    return {"file_path": rgb, **depths, "transform_matrix": pose}


def _check(contents: Contents) -> None:
    if contents.truth is None or len(contents.truth) < 2:
        expected = "at least two poses for the format nerf"
        raise InputError(expected, found="fewer", hint="the format tum")


def _content(folder: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What transforms.json says of all frames, and of each.

    Raises InputError without a list of frames.
    """
    content = read_json(folder / FILE)
    frames = content.pop("frames", None)
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise InputError("a list of frames", path=folder / FILE)
    return content, frames


def _rows(folder: Path) -> list[Row]:
    """The frames with a depth image, in the order of their numbers."""
    _, frames = _content(folder)
    names = [frame.get("file_path") for frame in frames]
    for place, name in enumerate(names):
        if not isinstance(name, str):
            found = f"frame {place} without"
            raise InputError("frames with file_path", path=folder / FILE, found=found)
    rows = []
    numbers = numbers_of_names([str(name) for name in names])
    for timed, name, frame in zip(_timed(folder, numbers), names, frames, strict=True):
        depth = frame.get("depth_file_path") or frame.get("depth_path")
        if isinstance(depth, str):
            rows.append(timed._replace(rgb=_image(folder, str(name)), depth=_image(folder, depth)))
    if frames and not rows:
        expected = "frames with file_path, and depth_file_path or depth_path"
        hint = "`iclnuim trajectory` for the poses: without depth this is no RGB-D sequence"
        raise InputError(expected, path=folder / FILE, found="none", hint=hint)
    return sorted(rows)


def _timed(folder: Path, numbers: list[int]) -> list[Row]:
    """Rows without images, with the stamps that are the numbers in names, or of frame numbers."""
    with within(folder / FILE):
        stamps = seconds_of_names(numbers)
    if stamps:
        return [Row(s, None, None, (text, text)) for s, text in zip(*stamps, strict=True)]
    frames = zip(stamps_of_frames(numbers).tolist(), numbers, strict=True)
    return [Row(stamp_s, None, None, number=number) for stamp_s, number in frames]


def _image(folder: Path, name: str) -> Path:
    """The image of this name; if there is none, that of the name with an ending."""
    path = folder / name.replace("\\", "/")
    if path.suffix.lower() in _ENDINGS or not path.name:
        return path
    named = [path.with_name(path.name + ending) for ending in _ENDINGS]
    return next((image for image in named if is_file(image)), path)


def _camera(folder: Path, image: Path) -> SequenceCamera:
    content, frames = _content(folder)
    said = [content, *frames]
    notes = KEYS.notes(said, folder / FILE)
    values = {key: _value(said, key, folder / FILE) for key in _NUMBERS}
    width = values["w"]
    height = values["h"]
    if width is None or height is None:
        header = image_header(image)
        width = float(header.width)
        height = float(header.height)
    across = _focal_lengths(values, "x", width, folder / FILE)
    down = _focal_lengths(values, "y", height, folder / FILE)
    # pixels are square if one direction alone is given
    lengths = [*across.values(), *down.values()]
    if not lengths:
        expected = "numbers fl_x, fl_y, cx, cy, w, h, or camera_angle_x"
        raise InputError(expected, path=folder / FILE, found="no focal length")
    fx = next(iter(across.values()), lengths[0])
    fy = next(iter(down.values()), lengths[0])
    cx = width / 2 if values["cx"] is None else values["cx"]
    cy = height / 2 if values["cy"] is None else values["cy"]
    with within(folder / FILE):
        pinhole = PinholeCamera(int(width), int(height), fx, fy, cx - 0.5, cy - 0.5)
        units = _units(values)
    return SequenceCamera(pinhole, units, notes=(*notes, *_contradictions(across, down)))


def _value(said: list[dict[str, Any]], key: str, path: Path) -> float | None:
    """The number that the file, or its frames, give for a key; None if there is none.

    Raises InputError if they give several.
    """
    given = [values[key] for values in said if values.get(key) is not None]
    found = numbers_in(path, given, len(given), f"a number for {key}")
    if not found:
        return None
    if max(found) - min(found) > _SAME * abs(max(found)):
        seen = f"{key} from {min(found):g} to {max(found):g}"
        raise InputError("frames with the same camera", path=path, found=seen)
    return found[0]


def _focal_lengths(
    values: dict[str, float | None], axis: str, size: float, path: Path
) -> dict[str, float]:
    """The focal lengths in pixels along an axis by the keys that give them; the first counts.

    Angles are those of the whole image of this size.
    """
    found = {}
    pixels = values[f"fl_{axis}"]
    if pixels is not None:
        found[f"fl_{axis}"] = pixels
    for key, unit in ((f"{axis}_fov", math.pi / 180), (f"camera_angle_{axis}", 1.0)):
        angle = values[key]
        if angle is None:
            continue
        if not 0 < angle * unit < math.pi:
            raise InputError(f"{key} of less than half a turn", path=path, found=f"{angle:g}")
        found[key] = size / (2 * math.tan(angle * unit / 2))
    return found


def _contradictions(*lengths: dict[str, float]) -> list[str]:
    """A sentence for each key that gives another focal length than the one that counts."""
    notes = []
    for found in lengths:
        for key, length in found.items():
            first, used = next(iter(found.items()))
            if abs(length - used) > _ROUNDED * used:
                which = f"{first} gives a focal length of {used:g} pixels, which is used"
                notes.append(f"{FILE.name}: {which}; {key} gives {length:g}")
    return notes


def _units(values: dict[str, float | None]) -> float:
    """Depth units per metre. Raises InputError if two keys give different ones."""
    given = [values[key] for key in _DEPTH_SCALES]
    scales = [scale for scale in given if scale is not None] or [1 / _NERFSTUDIO_UNITS]
    if min(scales) <= 0 or max(scales) > (1 + _ROUNDED) * min(scales):
        expected = f"one depth scale above 0 in {' and '.join(_DEPTH_SCALES)}"
        raise InputError(expected, found=" and ".join(f"{scale:g}" for scale in scales))
    return check_units(1 / scales[0])


FORMAT = SequenceFormat(
    "nerf",
    "images/, depth/ and transforms.json, for nerfstudio and instant-ngp",
    lambda frame, kind: f"{_FOLDERS.get(kind, kind)}/{frame.number:06}.png",
    _write,
    Reader(lambda folder: (folder / FILE).is_file(), _rows, _camera, lambda folder: folder / FILE),
    FormatLimits(
        "numbers",
        depth_stamps=False,
        fixed_units=_NERFSTUDIO_UNITS,
        every_pose=True,
        check=_check,
    ),
)
