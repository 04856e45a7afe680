"""The pairs of colour and depth images of a sequence in any known format."""

import os
import re
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from ..channels import DEPTH, FURTHER, RGB
from ..errors import InputError
from ..formats.bags import is_bag
from ..formats.files import is_file, real_path
from ..formats.image_names import files_in
from .associations import LARGEST_NUMBER
from .layout import Row
from .sequence_formats import format_of

#: Names, without ending, of further images in a format that stores them beside the depth.
_FURTHER_IMAGE = re.compile(f"({'|'.join(FURTHER)})[0-9]+")


@dataclass(frozen=True)
class ImagePair:
    """A colour and a depth image of the same time.

    The number is that in the file's name if these numbers increase, else the row.
    """

    number: int
    stamp_s: float
    rgb: Path
    depth: Path
    #: The texts of both images' stamps in the lists; "" if no list has seconds.
    written: tuple[str, str] = ("", "")


def find_pairs(folder: Path) -> list[ImagePair]:
    """The pairs of a sequence in any known format (sequence_formats.py), in the order of time.
    Frames without one of the images are left out.

    Raises InputError if there are no pairs.
    """
    folder = Path(folder)
    rows = find_rows(folder)
    whole = [row for row in rows if row.rgb is not None and row.depth is not None]
    numbers = frame_numbers(whole) or list(range(len(whole)))
    pairs = []
    for number, row in zip(numbers, whole, strict=True):
        if row.rgb is not None and row.depth is not None and row.is_pair:
            pairs.append(ImagePair(number, row.stamp_s, row.rgb, row.depth, row.written))
    if not pairs:
        raise _no_pairs(folder, whole)
    return pairs


def find_rows(folder: Path) -> list[Row]:
    """The frames of a sequence in the order of time, also those without one of the images. Raises
    InputError if there is no such folder.
    """
    if not folder.is_dir() and not is_bag(folder):
        found = "a file" if folder.exists() else "nothing"
        raise InputError("a folder with a sequence, or a ROS bag", path=folder, found=found)
    return format_of(folder).reader.rows(folder)


def _no_pairs(folder: Path, rows: list[Row]) -> InputError:
    inside = sorted(path.parent.name for path in folder.glob("*/recipe.json"))
    found = "none"
    if rows:
        missing = next(path for path in (rows[0].rgb, rows[0].depth) if path and not is_file(path))
        first = os.path.relpath(missing, folder)
        found = f"none in {len(rows)} frames, the first of which has no {first}"
        hint = "the folder that the lists are relative to"
    elif inside:
        hint = f"a folder inside: {', '.join(inside)}"
    elif all(files_in(folder / kind) for kind in ("rgb", "depth")):
        hint = "equal file names in rgb/ (PNG or JPEG) and depth/ (PNG), "
        hint += "or rgb.txt and depth.txt with their stamps"
    else:
        hint = "a folder with rgb/*.png and depth/*.png"
    return InputError("pairs of colour and depth images", path=folder, found=found, hint=hint)


def frame_numbers(rows: list[Row]) -> list[int] | None:
    """The frame numbers of rows; None if they do not increase, or a name has none."""
    numbers: list[int] = []
    for row in rows:
        number = row.number
        if number is None:
            number = _number((row.rgb or row.depth or Path()).stem)
        if number is None or (numbers and number <= numbers[-1]):
            return None
        numbers.append(number)
    return numbers


def _number(stem: str) -> int | None:
    """The number in an image's name, unless it is a stamp."""
    return int(stem) if stem.isdecimal() and int(stem) <= LARGEST_NUMBER else None


def missing_images(folder: Path) -> list[Path]:
    """The images of a sequence's lists that do not exist."""
    found = []
    for row in find_rows(folder):
        found += [path for path in (row.rgb, row.depth) if path and not is_file(path)]
    return found


def unused_images(pairs: list[ImagePair]) -> dict[str, list[Path]]:
    """The images in the folders of the pairs that are in none, by kind: they have no partner, or
    are in no list.
    """
    images = {RGB: [p.rgb for p in pairs], DEPTH: [p.depth for p in pairs]}
    used = set(map(real_path, chain.from_iterable(images.values())))
    found = {}
    for kind, paths in images.items():
        there: set[Path] = set()
        for parent, ending in {(path.parent, path.suffix) for path in paths}:
            there.update(map(real_path, files_in(parent, f"*{ending}")))
        unused = there - used
        found[kind] = sorted(path for path in unused if not _FURTHER_IMAGE.fullmatch(path.stem))
    return found
