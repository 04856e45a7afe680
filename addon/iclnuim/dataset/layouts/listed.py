"""Shared parts of formats similar to TUM: images in lists with stamps, a camera in a separate file,
a ground-truth file.
"""

import re
from pathlib import Path

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError
from ...evaluation.associate import associate
from ...formats.associations import (
    Associations,
    ImageList,
    read_associations,
    read_image_lists,
    write_associations,
    write_image_list,
)
from ...formats.files import data_lines, is_file, read_text, write_json
from ...formats.stamps import LARGEST_FRAME, SHORTEST_STEP_NS, stamp_text_of_ns
from ...geometry.trajectory import stamps_of_frames
from ..layout import (
    CAMERA,
    Contents,
    Reader,
    Row,
    SequenceCamera,
    SequenceFormat,
    camera_file,
    numbers_in,
    pinhole_of,
    pinhole_of_matrix,
    write_truth,
)

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
        rgb = pairs.rgb
        depth = pairs.depth
        indices = [(i, i) for i in range(len(pairs))]
    else:
        rgb, depth = read_image_lists(*files)
        both = associate(np.array(rgb.stamps_s), np.array(depth.stamps_s))
        indices = list(zip(both.first.tolist(), both.second.tolist(), strict=True))
        if not indices and len(rgb) and len(depth) and found(folder):
            expected = "stamps in depth.txt near those in rgb.txt"
            spans = f"{_span(RGB, rgb)}; {_span(DEPTH, depth)}"
            raise InputError(expected, path=folder, found=spans)
    found_rows = []
    for i, j in indices:
        texts = (_text(rgb, i), _text(depth, j))
        row = Row(rgb.stamps_s[i], folder / rgb.paths[i], folder / depth.paths[j], texts)
        found_rows.append(row)
    return found_rows


def _span(kind: str, images: ImageList) -> str:
    return f"{kind} {images.stamps_s[0]:.3f}..{images.stamps_s[-1]:.3f} s"


def _text(images: ImageList, row: int) -> str:
    return images.written[row] if images.written else ""


def _images(folder: Path, kind: str) -> dict[str, Path]:
    """The images in rgb/ or depth/ by their names without ending.

    Colour may be JPEG; if an image is there in both formats, the PNG is used.
    """
    found: dict[str, Path] = {}
    there = list((folder / kind).glob("*"))
    for ending in (".jpeg", ".jpg", ".png") if kind == RGB else (".png",):
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
    """The pairs of images whose names are stamps in seconds; the stamps of a pair may differ.

    Raises InputError for other names.
    """
    rgb, depth = (sorted(images, key=_stamp_s) for images in (rgb, depth))
    stamps_s = [np.array([_stamp_s(path) for path in images]) for images in (rgb, depth)]
    both = associate(stamps_s[0], stamps_s[1])
    pairs = ((rgb[i], depth[j]) for i, j in zip(both.first, both.second, strict=True))
    return [Row(_stamp_s(one), one, other, (one.stem, other.stem)) for one, other in pairs]


def _stamp_s(image: Path) -> float:
    try:
        return float(image.stem)
    except ValueError:
        expected = "images named by their stamps in seconds"
        raise InputError(expected, path=image, found=image.stem) from None


def _by_name(folder: Path) -> list[Row]:
    """The pairs of equal names.

    If all names end in a number and are otherwise equal, it is the number of the frame, or its
    stamp in nanoseconds.
    """
    depths = _images(folder, DEPTH)
    colours = _images(folder, RGB)
    stems = sorted((stem for stem in colours if stem in depths), key=_parts)
    split = [re.fullmatch(r"(.*?)(\d*)", stem, re.ASCII | re.DOTALL) for stem in stems]
    numbers = [int(name[2]) for name in split if name and name[2]]
    if len(numbers) < len(stems) or len({name[1] for name in split if name}) > 1:
        every = enumerate(stems)
        return [Row(float(stamps_of_frames(i)), colours[n], depths[n]) for i, n in every]
    named = list(zip(numbers, stems, strict=True))
    if max(numbers, default=0) <= LARGEST_FRAME:
        numbered = [(float(stamps_of_frames(number)), number, stem) for number, stem in named]
        return [Row(s, colours[stem], depths[stem], number=n) for s, n, stem in numbered]
    if len(numbers) > 1 and np.median(np.diff(numbers)) < SHORTEST_STEP_NS:
        expected = "images named by frame numbers, stamps in nanoseconds, "
        expected += "or stamps in seconds with decimals"
        hint = "rgb.txt and depth.txt with the stamps of the images"
        raise InputError(expected, path=colours[stems[0]], found="another unit of time", hint=hint)
    found_rows = []
    for stamp_ns, stem in named:
        text = stamp_text_of_ns(stamp_ns)
        found_rows.append(Row(stamp_ns / 1e9, colours[stem], depths[stem], (text, text)))
    return found_rows


def _parts(stem: str) -> list[tuple[int, str]]:
    """A key that sorts names by the numbers in them: frame_9 before frame_10."""
    found = []
    for part in re.split(r"(\d+)", stem, flags=re.ASCII):
        found.append((int(part), "") if part.isdecimal() else (-1, part))
    return found


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
        if files := sorted(folder.glob(pattern)):
            return files[0]
    return None


READER = Reader(found, rows, camera, truth)
