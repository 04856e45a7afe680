"""ScanNet in the format of its SensReader, in frames/: color/0.jpg, depth/0.png in millimetres,
pose/0.txt (4 x 4, camera to world), intrinsic/.
"""

from pathlib import Path

import numpy as np

from ...channels import RGB
from ...formats.files import atomic_write_text, make_folder, read_text
from ...formats.image_names import files_in
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
from ..contents import Contents
from ..format import FormatLimits, Reader, SequenceFormat
from ..frames import Row, SequenceFrame, rows_by_name

#: Keys of the files intrinsic/extrinsic_*.txt, which are their names,
EXTRINSICS = Keys(names(""), noted={"extrinsic_color": identity, "extrinsic_depth": identity})
#: and of a scan's file, scene0000_00.txt, whose intrinsics are also in intrinsic/.
SCAN = Keys(
    used=names(""),
    harmless=names(
        "appVersionId colorHeight colorWidth depthHeight depthWidth fx_color fx_depth fy_color "
        "fy_depth mx_color mx_depth my_color my_depth numColorFrames numDepthFrames "
        "numIMUmeasurements sceneType serverVersionId deviceId deviceName sceneLabel userName"
    ),
    noted={"axisAlignment": identity, "colorToDepthExtrinsics": identity},
)
#: Depth units per metre (depthShift of its .sens files).
UNITS = 1000.0


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    top = folder / "frames"
    for name in ("pose", "intrinsic"):
        make_folder(top / name)
    images = format.images(contents, RGB).paths
    for image, matrix in zip(images, contents.poses.matrix, strict=True):
        atomic_write_text(top / f"pose/{Path(image).stem}.txt", _matrix(matrix))
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
    """The frames, by the numbers in the names."""
    top = _top(folder)
    return rows_by_name(
        _by_number(files_in(top / "color", "*.jpg", "*.png")),
        _by_number(files_in(top / "depth", "*.png")),
    )


def _by_number(images: list[Path]) -> dict[str, Path]:
    return {image.stem: image for image in images if image.stem.isdecimal()}


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    """The camera of the depth images, and that of the colour images if it is another one, as in
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
        cameras.append(pinhole_of_matrix(path, file, _matrix_of(file)))
    colour = None if cameras[0] == cameras[1] else cameras[1]
    return SequenceCamera(cameras[0], UNITS, colour=colour, notes=_notes(folder))


def _matrix_of(file: Path) -> np.ndarray:
    """(4, 4)."""
    values = read_text(file).split()
    what = "the sixteen numbers of a 4 x 4 matrix"
    return np.reshape(numbers_in(file, values, 16, what), (4, 4))


def _notes(folder: Path) -> tuple[str, ...]:
    """What the extrinsics, and the scan's own file, say and is not applied."""
    found: list[str] = []
    top = _top(folder)
    for file in sorted(top.glob("intrinsic/extrinsic_*.txt")):
        found += EXTRINSICS.notes([{file.stem: _matrix_of(file).ravel().tolist()}], file)
    for file in sorted({*folder.glob("scene*_*.txt"), *top.glob("scene*_*.txt")}):
        found += SCAN.notes([settings_in(file)], file)
    return tuple(found)


def _image(frame: SequenceFrame, kind: str) -> str:
    return _named(f"{frame.number:06}", kind)


def _named(stem: str, kind: str) -> str:
    return f"frames/color/{stem}.jpg" if kind == RGB else f"frames/{kind}/{stem}.png"


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
    FormatLimits("numbers", depth_stamps=False, fixed_units=UNITS, every_pose=True),
    published_image=lambda frame, kind: _named(str(frame.number), kind),
)
