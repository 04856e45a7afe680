"""Replica in the format of neural mapping systems: results/frame000000.jpg,
results/depth000000.png, traj.txt with one 4 x 4 matrix per line, cam_params.json. Classes and
instances are semantic_class/semantic_class_0.png, semantic_instance/semantic_instance_0.png.

The lines of traj.txt correspond to the images in the order of their names
(https://github.com/cvg/nice-slam, src/utils/datasets.py).
"""

from pathlib import Path
from typing import Any

from ...channels import INSTANCE, RGB
from ...errors import InputError
from ...formats.depth_units import check_units
from ...formats.files import read_json, write_json
from ...formats.image_names import files_in
from ...formats.images import image_header
from ...formats.trajectories import write_trajectory
from ...geometry.camera import PinholeCamera
from ...geometry.trajectory import Trajectory
from ..known_keys import COEFFICIENTS, Keys, zeros
from ..layout import (
    Contents,
    Reader,
    Row,
    SequenceCamera,
    SequenceFormat,
    SequenceFrame,
    rows_by_name,
)

#: Depth units per metre in the systems' settings for Replica; the range ends at 10 m.
UNITS = 6553.5
_PUBLISHED = PinholeCamera(1200, 680, 600.0, 600.0, 599.5, 339.5)
_LABELS = ("class", INSTANCE)
_TRAJECTORY = "traj.txt"
_CAMERA = "cam_params.json"
_NUMBERS = ("w", "h", "fx", "fy", "cx", "cy", "scale")
#: Keys of cam_params.json.
KEYS = Keys(
    used=frozenset(_NUMBERS),
    noted={"crop_edge": zeros},
    distortion=COEFFICIENTS,
)


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    write_trajectory(folder / _TRAJECTORY, Trajectory(contents.stamps_s, contents.poses), "replica")
    c = contents.camera
    k = {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
    write_json(folder / _CAMERA, {"camera": {**k, "scale": contents.depth_units_per_metre}})


def _rows(folder: Path) -> list[Row]:
    """The frames; a depth image has the number of its colour image."""
    results = folder / "results"
    colours = {path.stem[5:]: path for path in files_in(results, "frame*.jpg", "frame*.png")}
    depths = {path.stem[5:]: path for path in files_in(results, "depth*.png")}
    return rows_by_name(colours, depths)


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    """The camera in cam_params.json in the folder or, as published, in the parent folder; else the
    published camera if the image has its size.
    """
    files = [place / _CAMERA for place in (folder, folder.parent)]
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        header = image_header(image)
        published = (header.width, header.height) == (_PUBLISHED.width, _PUBLISHED.height)
        return SequenceCamera(_PUBLISHED, UNITS) if published else None
    content: Any = read_json(file)
    others = {key: value for key, value in content.items() if key != "camera"}
    content = content.get("camera")
    try:
        values = [float(content[key]) for key in _NUMBERS]
        size = int(values[0]), int(values[1])
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError("a camera with numbers w, h, fx, fy, cx, cy, scale", path=file) from None
    notes = KEYS.notes([content, others], file)
    return SequenceCamera(PinholeCamera(*size, *values[2:6]), check_units(values[6]), notes=notes)


def _image(frame: SequenceFrame, kind: str) -> str:
    if kind in _LABELS:  # as in Semantic-NeRF (Zhi et al., ICCV 2021)
        return f"semantic_{kind}/semantic_{kind}_{frame.number}.png"
    name = "frame{:06}.jpg" if kind == RGB else kind + "{:06}.png"
    return f"results/{name.format(frame.number)}"


FORMAT = SequenceFormat(
    "replica",
    "Replica as NICE-SLAM and its successors read it: results/frame*.jpg, results/depth*.png, "
    "traj.txt, cam_params.json",
    _image,
    _write,
    Reader(
        lambda folder: (folder / _TRAJECTORY).is_file() and (folder / "results").is_dir(),
        _rows,
        _camera,
        lambda folder: folder / _TRAJECTORY,
    ),
    stamps="numbers",
    depth_stamps=False,
    fixed_units=UNITS,
    every_pose=True,
)
