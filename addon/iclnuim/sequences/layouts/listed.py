"""Shared parts of formats similar to TUM: images in lists with stamps, a camera in a separate file,
a ground-truth file.
"""

import re
from pathlib import Path

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError, within
from ...evaluation.associate import associate
from ...formats.files import data_lines, is_file, read_text, write_json
from ...formats.image_names import files_in, numbers_in_names
from ...formats.images import METRES
from ...trajectory_files.stamps import seconds_of_names, stamp_of_name
from ..associations import (
    Associations,
    ImageList,
    read_associations,
    read_image_lists,
    write_associations,
    write_image_list,
)
from ..camera_files import (
    CAMERA,
    SequenceCamera,
    camera_file,
    numbers_in,
    pinhole_of,
    pinhole_of_matrix,
)
from ..contents import Contents, write_truth
from ..format import Reader, SequenceFormat
from ..frames import Row, rows_by_name
from ..imu import read_imu_files

_ASSOCIATIONS = ("associations.txt", "association.txt", "associated.txt", "associate.txt")
_TRUTHS = ("groundtruth.txt", "*.gt.freiburg", "*.gt.sim")
_K = "the nine numbers of K, or fx fy cx cy"


def write_lists(
    folder: Path, contents: Contents, format: SequenceFormat, associations: str = _ASSOCIATIONS[0]
) -> None:
    """Write rgb.txt, depth.txt, `associations`, groundtruth.txt.

    Stamps with an original text are written with the same text.
    """
    rgb, depth = (format.images(contents, kind) for kind in (RGB, DEPTH))
    write_image_list(folder / "rgb.txt", rgb)
    write_image_list(folder / "depth.txt", depth)
    write_associations(folder / associations, Associations(rgb, depth))
    write_truth(folder / "groundtruth.txt", contents, "tum")


def write_camera(folder: Path, contents: Contents) -> None:
    """Write camera.json."""
    write_json(folder / CAMERA, contents.full_camera.to_dict())


def rows(folder: Path) -> list[Row]:
    """The pairs of the association file, else of rgb.txt and depth.txt, else of images named by
    stamps, else of equal names in rgb/ and depth/.
    """
    return _listed(folder) or _by_stamp(folder) or _by_name(folder)


def _list_files(folder: Path) -> list[Path]:
    for name in _ASSOCIATIONS:
        if (folder / name).is_file():
            return [folder / name]
    both = [folder / "rgb.txt", folder / "depth.txt"]
    return both if all(path.is_file() for path in both) else []


def found(folder: Path) -> bool:
    """Whether there are lists and their first image exists: a folder of another format may contain
    unused lists.
    """
    if not (files := _list_files(folder)):
        return False
    for _, line in data_lines(read_text(files[0])):
        if len(fields := line.split()) > 1:
            return is_file(folder / fields[1])
    return False


def _listed(folder: Path) -> list[Row]:
    files = _list_files(folder)
    if not files:
        return []
    if len(files) == 1:
        pairs = read_associations(files[0])
        both = zip(_items(folder, pairs.rgb), _items(folder, pairs.depth), strict=True)
        return [_row(one, other) for one, other in both]
    rgb, depth = read_image_lists(*files)
    found_rows = _associated(_items(folder, rgb), _items(folder, depth))
    if not found_rows and found(folder):
        expected = "stamps in depth.txt near those in rgb.txt"
        spans = f"{_span(RGB, rgb)}; {_span(DEPTH, depth)}"
        raise InputError(expected, path=folder, found=spans)
    return found_rows


#: Stamp in seconds, image, and the text of the stamp.
_Item = tuple[float, Path, str]


def _items(folder: Path, images: ImageList) -> list[_Item]:
    written = map(stamp_of_name, images.written or [""] * len(images))
    paths = [folder / path for path in images.paths]
    return list(zip(images.stamps_s, paths, written, strict=True))


def _row(colour: _Item, depth: _Item) -> Row:
    return Row(colour[0], colour[1], depth[1], (colour[2], depth[2]))


def _associated(colours: list[_Item], depths: list[_Item]) -> list[Row]:
    """The colour images with the depth images of near stamps, or without one; [] without a pair."""
    stamps_s = [np.array([item[0] for item in items]) for items in (colours, depths)]
    both = associate(stamps_s[0], stamps_s[1])
    partner = dict(zip(both.first.tolist(), both.second.tolist(), strict=True))
    found_rows = []
    for i, colour in enumerate(colours):
        if i in partner:
            found_rows.append(_row(colour, depths[partner[i]]))
        else:
            found_rows.append(Row(colour[0], colour[1], None))
    return found_rows if partner else []


def _span(kind: str, images: ImageList) -> str:
    return f"{kind} {images.stamps_s[0]:.3f}..{images.stamps_s[-1]:.3f} s"


def _images(folder: Path, kind: str) -> dict[str, Path]:
    """The images in rgb/ or depth/ by their names without ending.

    Colour may be JPEG, depth EXR or NumPy; if an image is there in several formats, the PNG is used.
    """
    found: dict[str, Path] = {}
    there = files_in(folder / kind)
    for ending in (".jpeg", ".jpg", ".png") if kind == RGB else (*METRES, ".png"):
        found |= {path.stem: path for path in there if path.suffix.lower() == ending}
    return found


def _by_stamp(folder: Path) -> list[Row]:
    """The pairs of images that are all named by stamps in seconds, with decimals; the stamps of a
    pair may differ.
    """
    rgb, depth = (list(_images(folder, kind).values()) for kind in (RGB, DEPTH))
    if not rgb or not depth:
        return []
    if not all(re.fullmatch(r"\d+\.\d+", path.stem) for path in rgb + depth):
        return []
    return paired_by_stamp(rgb, depth)


def paired_by_stamp(rgb: list[Path], depth: list[Path]) -> list[Row]:
    """The pairs of images whose names are stamps; the stamps of a pair may differ.

    Raises InputError for other names.
    """
    return _associated(sorted(_stamped(rgb)), sorted(_stamped(depth)))


def _stamped(images: list[Path]) -> list[_Item]:
    names = [image.stem for image in images]
    if all(name.isdecimal() for name in names):
        with within(images[0]):
            stamps = seconds_of_names(list(map(int, names)))
        if stamps:
            return list(zip(stamps[0], images, stamps[1], strict=True))
    return [(_stamp_s(image), image, stamp_of_name(image.stem)) for image in images]


def _stamp_s(image: Path) -> float:
    try:
        return float(image.stem)
    except ValueError:
        expected = "images named by their stamps in seconds"
        raise InputError(expected, path=image, found=image.stem) from None


def _by_name(folder: Path) -> list[Row]:
    """The frames of images with equal names. Without numbers in all names, those of both kinds
    count.
    """
    colours = _images(folder, RGB)
    depths = _images(folder, DEPTH)
    both = colours.keys() & depths.keys()
    if numbers_in_names([*(colours.keys() | depths.keys())]) is None:
        colours, depths = ({name: images[name] for name in both} for images in (colours, depths))
    if not both:
        return []
    with within(colours[min(both)]):
        return rows_by_name(colours, depths)


def camera(folder: Path, image: Path) -> SequenceCamera | None:
    """The camera in camera.json, or in calibration.txt: K as in the original, or fx fy cx cy as in
    ETH3D. None if there is neither.
    """
    if there := camera_file(folder):
        return there
    path = folder / "calibration.txt"
    if not path.is_file():
        return None
    values = read_text(path).split()
    if len(values) == 4:
        fx, fy, cx, cy = numbers_in(path, values, 4, _K)
        return SequenceCamera(pinhole_of(image, fx, fy, cx, cy))
    matrix = np.reshape(numbers_in(path, values, 9, _K), (3, 3))
    return SequenceCamera(pinhole_of_matrix(image, path, matrix))


def truth(folder: Path) -> Path | None:
    """The ground-truth file, or None."""
    for pattern in _TRUTHS:
        if files := files_in(folder, pattern):
            return files[0]
    return None


READER = Reader(found, rows, camera, truth, imu=read_imu_files)
