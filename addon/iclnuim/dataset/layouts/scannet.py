"""ScanNet in the format of its SensReader, in frames/: color/0.jpg, depth/0.png in millimetres,
pose/0.txt (4 x 4, camera to world), intrinsic/.
"""

from pathlib import Path

import numpy as np

from ...channels import RGB
from ...formats.files import atomic_write_text, make_folder, read_text
from ..layout import (
    Contents,
    Reader,
    Row,
    SequenceCamera,
    SequenceFormat,
    SequenceFrame,
    camera_file,
    numbered_row,
    numbers_in,
    pinhole_of,
)

#: Depth units per metre (depthShift of its .sens files).
UNITS = 1000.0


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    top = folder / "frames"
    for name in ("pose", "intrinsic"):
        make_folder(top / name)
    for frame, matrix in zip(contents.frames, contents.poses.matrix, strict=True):
        atomic_write_text(top / f"pose/{frame.number}.txt", _matrix(matrix))
    K = np.eye(4)
    K[:3, :3] = contents.camera.K
    for kind in ("color", "depth"):
        atomic_write_text(top / f"intrinsic/intrinsic_{kind}.txt", _matrix(K))
        atomic_write_text(top / f"intrinsic/extrinsic_{kind}.txt", _matrix(np.eye(4)))


def _matrix(matrix: np.ndarray) -> str:
    rows = [" ".join(f"{value + 0.0:.12g}" for value in row) for row in matrix.tolist()]
    return "\n".join(rows) + "\n"


def _top(folder: Path) -> Path:
    return folder / "frames" if (folder / "frames").is_dir() else folder


def _rows(folder: Path) -> list[Row]:
    """The pairs, by the numbers in the names."""
    top = _top(folder)
    images = [*top.glob("color/*.jpg"), *top.glob("color/*.png")]
    by_number = {int(image.stem): image for image in images if image.stem.isdecimal()}
    found = []
    for number, image in sorted(by_number.items()):
        found.append(numbered_row(top, number, image, top / f"depth/{image.stem}.png"))
    return found


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    """The camera of the depth images, and that of the colour images if their size differs, as in
    ScanNet's data.
    """
    if there := camera_file(folder):
        return there
    depth = _top(folder) / f"depth/{image.stem}.png"
    cameras = []
    for kind, path in (("depth", depth), ("color", image)):
        file = _top(folder) / f"intrinsic/intrinsic_{kind}.txt"
        if not file.is_file():
            return None
        k = numbers_in(file, read_text(file).split(), 16, "the sixteen numbers of a 4 x 4 matrix")
        cameras.append(pinhole_of(path, k[0], k[5], k[2], k[6]))
    same_size = (cameras[0].width, cameras[0].height) == (cameras[1].width, cameras[1].height)
    return SequenceCamera(cameras[0], UNITS, colour=None if same_size else cameras[1])


def _image(frame: SequenceFrame, kind: str) -> str:
    return (
        f"frames/color/{frame.number}.jpg" if kind == RGB else f"frames/{kind}/{frame.number}.png"
    )


FORMAT = SequenceFormat(
    "scannet",
    "ScanNet's exported frames: frames/color/*.jpg, frames/depth/*.png (mm), frames/pose/*.txt, "
    "frames/intrinsic/",
    _image,
    _write,
    Reader(
        lambda folder: (_top(folder) / "color").is_dir() and (_top(folder) / "pose").is_dir(),
        _rows,
        _camera,
        lambda folder: _top(folder) / "pose",
    ),
    stamps="numbers",
    depth_stamps=False,
    fixed_units=UNITS,
    every_pose=True,
)
