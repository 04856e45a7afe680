"""Replica in the format of neural mapping systems: results/frame000000.jpg,
results/depth000000.png, traj.txt with one 4 x 4 matrix per line,
cam_params.json.

The lines of traj.txt correspond to the images in the order of their names
(https://github.com/cvg/nice-slam, src/utils/datasets.py).
"""

from pathlib import Path

from ...channels import RGB
from ...errors import InputError
from ...formats.depth_units import check_units
from ...formats.files import read_json, write_json
from ...formats.images import image_header
from ...formats.trajectories import write_trajectory
from ...geometry.camera import PinholeCamera
from ...geometry.trajectory import Trajectory, stamps_of_frames
from ..layout import Contents, Reader, Row, SequenceCamera, SequenceFormat

#: Depth units per metre in the systems' settings for Replica; the range ends at 10 m.
UNITS = 6553.5
_PUBLISHED = PinholeCamera(1200, 680, 600.0, 600.0, 599.5, 339.5)
_TRAJECTORY, _CAMERA = "traj.txt", "cam_params.json"


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    write_trajectory(folder / _TRAJECTORY, Trajectory(contents.stamps_s, contents.poses), "replica")
    c = contents.camera
    k = {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
    write_json(folder / _CAMERA, {"camera": {**k, "scale": contents.depth_units_per_metre}})


def _rows(folder: Path) -> list[Row]:
    """The pairs in the order of the names; a depth image has the number of its colour image."""
    found = []
    depths = {
        path.stem.removeprefix("depth"): path for path in (folder / "results").glob("depth*.png")
    }
    images = sorted(
        path for ending in ("jpg", "png") for path in (folder / "results").glob(f"frame*.{ending}")
    )
    for place, image in enumerate(images):
        number = image.stem.removeprefix("frame")
        if number not in depths:
            raise InputError(
                f"results/depth{number}.png for {image.name}", path=folder, found="none"
            )
        found.append(Row(float(stamps_of_frames(place)), image, depths[number], number=place))
    return found


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    """The camera in cam_params.json in the folder or, as published, in the parent folder; else the
    published camera if the image has its size.
    """
    file = next(
        (place / _CAMERA for place in (folder, folder.parent) if (place / _CAMERA).is_file()), None
    )
    if file is None:
        header = image_header(image)
        return (
            SequenceCamera(_PUBLISHED, UNITS)
            if (header.width, header.height) == (1200, 680)
            else None
        )
    content = read_json(file).get("camera")
    try:
        values = [float(content[key]) for key in ("w", "h", "fx", "fy", "cx", "cy", "scale")]  # type: ignore[index]
        size = int(values[0]), int(values[1])
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError("a camera with numbers w, h, fx, fy, cx, cy, scale", path=file) from None
    return SequenceCamera(PinholeCamera(*size, *values[2:6]), check_units(values[6]))


FORMAT = SequenceFormat(
    "replica",
    "Replica as NICE-SLAM and its successors read it: results/frame*.jpg, results/depth*.png, traj.txt, cam_params.json",
    lambda f, kind: (
        f"results/frame{f.number:06}.jpg" if kind == RGB else f"results/{kind}{f.number:06}.png"
    ),
    _write,
    Reader(
        lambda folder: (folder / _TRAJECTORY).is_file() and (folder / "results").is_dir(),
        _rows,
        _camera,
        lambda folder: folder / _TRAJECTORY,
    ),
    stamps="rows",
    depth_stamps=False,
    fixed_units=UNITS,
    every_pose=True,
)
