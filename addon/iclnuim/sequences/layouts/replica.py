"""Replica in the format of neural mapping systems: results/frame000000.jpg,
results/depth000000.png, traj.txt with one 4 x 4 matrix per line, cam_params.json. Classes and
instances are semantic_class/semantic_class_0.png, semantic_instance/semantic_instance_0.png.

The lines of traj.txt correspond to the images in the order of their names
(https://github.com/cvg/nice-slam, src/utils/datasets.py). replica-v2 is one part of the data of
vMAP, imap/00 for training or imap/01 for novel views, which SplaTAM reads as ReplicaV2:
rgb/rgb_0.png, depth/depth_0.png, traj_w_c.txt.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from ...channels import INSTANCE, RGB
from ...errors import InputError
from ...formats.depth_units import check_units
from ...formats.files import read_json, write_json
from ...formats.image_names import files_in
from ...formats.images import image_header
from ...geometry.camera import PinholeCamera
from ...geometry.trajectory import Trajectory
from ...trajectory_files.trajectories import write_trajectory
from ..camera_files import COEFFICIENTS, Keys, SequenceCamera, zeros
from ..contents import Contents
from ..format import FormatLimits, Reader, SequenceFormat, truth_at
from ..frames import Row, SequenceFrame, rows_by_name

#: Depth units per metre in the systems' settings for Replica; the range ends at 10 m.
UNITS = 6553.5
_PUBLISHED = PinholeCamera(1200, 680, 600.0, 600.0, 599.5, 339.5)
_LABELS = ("class", INSTANCE)
_TRAJECTORY = "traj.txt"
_V2_TRAJECTORY = "traj_w_c.txt"
_CAMERA = "cam_params.json"
_NUMBERS = ("w", "h", "fx", "fy", "cx", "cy", "scale")
#: Keys of cam_params.json.
KEYS = Keys(
    used=frozenset(_NUMBERS),
    noted={"crop_edge": zeros},
    distortion=COEFFICIENTS,
)


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    name = _TRAJECTORY if format.name == "replica" else _V2_TRAJECTORY
    write_trajectory(folder / name, Trajectory(contents.stamps_s, contents.poses), "replica")
    c = contents.camera
    k = {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
    write_json(folder / _CAMERA, {"camera": {**k, "scale": contents.depth_units_per_metre}})


def _rows(folder: Path) -> list[Row]:
    """The frames; a depth image has the number of its colour image."""
    results = folder / "results"
    if results.is_dir():
        colours = files_in(results, "frame*.jpg", "frame*.png")
        depths = files_in(results, "depth*.png")
    else:
        colours = files_in(folder / "rgb", "rgb_*.png")
        depths = files_in(folder / "depth", "depth_*.png")
    return rows_by_name(_numbered(colours), _numbered(depths))


def _numbered(images: list[Path]) -> dict[str, Path]:
    """The images by what follows the letters in their names."""
    return {path.stem.lstrip("framedpthgb_"): path for path in images}


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


def _image_of_v2(frame: SequenceFrame, kind: str) -> str:
    """Without zeros: rgb_0.png is the name of the first image in SplaTAM."""
    return _image(frame, kind) if kind in _LABELS else f"{kind}/{kind}_{frame.number}.png"


def _remarks_of_v2(contents: Contents) -> list[str]:
    if contents.frames[0].number == 0:
        return []
    return ["SplaTAM looks for rgb_0.png in imap/00, and frame 0 is not among these"]


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
        truth_at(_TRAJECTORY),
    ),
    FormatLimits("numbers", depth_stamps=False, fixed_units=UNITS, every_pose=True),
)
V2 = replace(
    FORMAT,
    name="replica-v2",
    description="a part of Replica as vMAP and SplaTAM's novel views read it: rgb/rgb_*.png, "
    "depth/depth_*.png, traj_w_c.txt, cam_params.json",
    image=_image_of_v2,
    reader=Reader(
        lambda folder: (folder / _V2_TRAJECTORY).is_file() and (folder / "rgb").is_dir(),
        _rows,
        _camera,
        truth_at(_V2_TRAJECTORY),
    ),
    limits=replace(FORMAT.limits, fixed_units=1000.0, remarks=_remarks_of_v2),
)
