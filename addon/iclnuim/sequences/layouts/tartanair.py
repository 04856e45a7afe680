"""TartanAir: image_left/000000_left.png, depth_left/000000_left_depth.npy in metres, pose_left.txt
in NED axes.

The format has no stamps and no camera (all sequences of TartanAir have the same one), and no value
for missing depth: we use 0 (https://github.com/castacks/tartanair_tools, data_type.md). The lines
of pose_left.txt correspond to the images in the order of their names.
"""

from pathlib import Path

from ...channels import DEPTH, RGB
from ...formats.image_names import files_in
from ...formats.images import image_header
from ...geometry.camera import PinholeCamera
from ...geometry.trajectory import Trajectory
from ...trajectory_files.trajectories import write_trajectory
from ..camera_files import SequenceCamera, camera_file
from ..contents import Contents
from ..format import FormatLimits, Reader, SequenceFormat
from ..frames import Row, SequenceFrame, rows_by_name
from . import listed

#: A field of view of 90 degrees; printed with the principal point at (320, 240), counted from the
#: corner of the image.
PUBLISHED = PinholeCamera(640, 480, 320.0, 320.0, 319.5, 239.5)
_POSES = "pose_left.txt"


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    write_trajectory(folder / _POSES, Trajectory(contents.stamps_s, contents.poses), "tartanair")
    listed.write_camera(folder, contents)


def _rows(folder: Path) -> list[Row]:
    depths = files_in(folder / "depth_left", "*_depth.npy")
    return rows_by_name(
        {path.stem: path for path in files_in(folder / "image_left", "*.png")},
        {path.stem.removesuffix("_depth"): path for path in depths},
    )


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    if there := camera_file(folder):
        return there
    header = image_header(image)
    return SequenceCamera(PUBLISHED) if (header.width, header.height) == (640, 480) else None


def _image(frame: SequenceFrame, kind: str) -> str:
    folder = {RGB: "image"}.get(kind, kind)
    ending = {DEPTH: "_depth.npy"}.get(kind, ".png")
    return f"{folder}_left/{frame.number:06}_left{ending}"


FORMAT = SequenceFormat(
    "tartanair",
    "TartanAir: image_left/, depth_left/ (.npy, metres), pose_left.txt in NED axes",
    _image,
    _write,
    Reader(
        lambda folder: (folder / _POSES).is_file() and (folder / "image_left").is_dir(),
        _rows,
        _camera,
        lambda folder: folder / _POSES,
    ),
    FormatLimits("numbers", depth_stamps=False, fixed_camera=PUBLISHED, every_pose=True),
)
