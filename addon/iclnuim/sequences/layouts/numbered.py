"""Numbered triples of colour, depth and pose, as scanners write them, which are only read: 7-Scenes
and BundleFusion (frame-000000.color.png, .depth.png, .pose.txt, info.txt), and Open3D's recorder and
the augmented ICL-NUIM (color/, depth/, camera_intrinsic.json, trajectory.log).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, within
from ...formats.depth_units import check_units
from ...formats.files import is_file, read_json
from ...formats.image_names import files_in
from ...formats.images import image_header
from ...geometry.camera import PinholeCamera
from ..camera_files import (
    Keys,
    SequenceCamera,
    camera_file,
    identity,
    names,
    numbers_in,
    pinhole_of_matrix,
    settings_in,
)
from ..format import Reader
from ..frames import Row, rows_by_name
from . import tum

_UNITS = 1000.0
_INFO = "info.txt"
#: Keys of BundleFusion's info.txt.
INFO = Keys(
    used=names("m_depthShift m_calibrationColorIntrinsic m_calibrationDepthIntrinsic"),
    harmless=names(
        "m_versionNumber m_sensorName m_colorWidth m_colorHeight m_depthWidth m_depthHeight "
        "m_frames.size"
    ),
    noted={"m_calibrationColorExtrinsic": identity, "m_calibrationDepthExtrinsic": identity},
)
#: The Kinect's camera that the page of 7-Scenes gives.
_SEVEN_SCENES = PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0)
_SEVEN_SCENES_NOTE = (
    "no info.txt: the camera of 7-Scenes is used, 585 pixels; its colour is not registered to depth"
)
#: Folders of the recorder and of Redwood's data, whose depth without noise is read if it is there.
_COLOURS = ("color", "colors", "image", "rgb", "*-color")
_DEPTHS = ("depth", "*-depth-clean", "depth_noisy", "*-depth-simulated")
#: Keys of Open3D's camera_intrinsic.json.
INTRINSIC = Keys(
    used=names("width height intrinsic_matrix depth_scale"),
    harmless=names(
        "class_name version_major version_minor color_format depth_format device_name fps "
        "serial_number stream_length_usec"
    ),
)
#: The camera of Redwood's data, Open3D's PrimeSenseDefault.
_PRIMESENSE = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)
_PRIMESENSE_NOTE = "no camera_intrinsic.json: the camera of Redwood's data is used, 525 pixels"


def _of_kind(folder: Path, kind: str) -> dict[str, Path]:
    """The images frame-NUMBER.KIND.png by their numbers."""
    found = files_in(folder, f"frame-*.{kind}.png", f"frame-*.{kind}.jpg")
    return {path.name.split(".")[0]: path for path in found}


def _triples(folder: Path) -> list[Row]:
    return rows_by_name(_of_kind(folder, "color"), _of_kind(folder, "depth"))


def _triples_camera(folder: Path, image: Path) -> SequenceCamera | None:
    if there := camera_file(folder):
        return there
    file = folder / _INFO
    if not is_file(file):
        return _published(image, _SEVEN_SCENES, _SEVEN_SCENES_NOTE)
    said = settings_in(file)
    depth = next(iter(_of_kind(folder, "depth").values()), image)
    cameras = []
    for kind, path in (("Depth", depth), ("Color", image)):
        values = said.get(f"m_calibration{kind}Intrinsic", [])
        what = f"the sixteen numbers of m_calibration{kind}Intrinsic"
        matrix = np.reshape(numbers_in(file, values, 16, what), (4, 4))
        cameras.append(pinhole_of_matrix(path, file, matrix))
    given = said.get("m_depthShift", [str(_UNITS)])
    (units,) = numbers_in(file, given, 1, "m_depthShift as a number")
    colour = None if cameras[0] == cameras[1] else cameras[1]
    with within(file):
        return SequenceCamera(
            cameras[0], check_units(units), colour=colour, notes=INFO.notes([said], file)
        )


def _published(image: Path, camera: PinholeCamera, *notes: str) -> SequenceCamera | None:
    """The published camera, if an image has its size."""
    header = image_header(image)
    if (header.width, header.height) != (camera.width, camera.height):
        return None
    return SequenceCamera(camera, _UNITS, notes=notes)


def _places(folder: Path, patterns: Sequence[str]) -> list[Path]:
    """The folders with images that have one of these names, in this order."""
    named = [place for pattern in patterns for place in sorted(folder.glob(pattern))]
    return [place for place in named if files_in(place, "*.jpg", "*.png")]


def _recorded(folder: Path) -> list[Row]:
    images = []
    for patterns in (_COLOURS, _DEPTHS):
        place = _places(folder, patterns)[0]
        images.append({path.stem: path for path in files_in(place, "*.jpg", "*.png")})
    return rows_by_name(*images)


def _is_recorded(folder: Path) -> bool:
    """Whether a folder has images, and Open3D's file of the camera or a trajectory as Redwood's."""
    if not _places(folder, _COLOURS) or not _places(folder, _DEPTHS):
        return False
    return _intrinsic_file(folder) is not None or _log(folder) is not None


def _intrinsic_file(folder: Path) -> Path | None:
    for pattern in ("camera_intrinsic.json", "camera_*.json", "intrinsic*.json"):
        if found := files_in(folder, pattern):
            return found[0]
    return None


def _log(folder: Path) -> Path | None:
    """The file with the poses: trajectory.log, also of Open3D's reconstruction in scene/, or that of
    a Redwood data set.
    """
    for pattern in ("trajectory.log", "scene/trajectory.log", "*trajectory.log", "*-traj.txt"):
        if found := sorted(folder.glob(pattern)):
            return found[0]
    return None


def _recorded_camera(folder: Path, image: Path) -> SequenceCamera | None:
    if there := camera_file(folder):
        return there
    file = _intrinsic_file(folder)
    others = [f"{place.name}/ is not read" for place in _places(folder, _DEPTHS)[1:]]
    if file is None:
        return _published(image, _PRIMESENSE, _PRIMESENSE_NOTE, *others)
    content: Any = read_json(file)
    matrix = content.get("intrinsic_matrix")
    values = matrix if isinstance(matrix, list) else []
    what = "intrinsic_matrix: the nine numbers of K, column by column"
    K = np.reshape(numbers_in(file, values, 9, what), (3, 3)).T
    given = [content.get("depth_scale", _UNITS)]
    (units,) = numbers_in(file, given, 1, "depth_scale as a number")
    camera = pinhole_of_matrix(image, file, K)
    size = (content.get("width", camera.width), content.get("height", camera.height))
    if size != (camera.width, camera.height):
        found = f"{size[0]} x {size[1]}"
        expected = f"the size of the images, {camera.width} x {camera.height}"
        raise InputError(expected, path=file, found=found)
    with within(file):
        notes = (*INTRINSIC.notes([content], file), *others)
        return SequenceCamera(camera, check_units(units), notes=notes)


TRIPLES = tum.read_only(
    "7-scenes",
    "7-Scenes and BundleFusion: frame-*.color.png, frame-*.depth.png, frame-*.pose.txt, info.txt",
    Reader(
        lambda folder: bool(_of_kind(folder, "depth")),
        _triples,
        _triples_camera,
        lambda folder: folder if any(folder.glob("frame-*.pose.txt")) else None,
    ),
)
OPEN3D = tum.read_only(
    "open3d",
    "Open3D's recorder, and Redwood's data: color/, depth/, camera_intrinsic.json, trajectory.log",
    Reader(_is_recorded, _recorded, _recorded_camera, _log),
)
