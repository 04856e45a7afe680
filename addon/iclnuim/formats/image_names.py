"""Names of images: which files a folder lists, in which order, and which numbers the names have."""

import re
from collections.abc import Sequence
from pathlib import Path, PurePath

#: Longer digits in a name are no number of a frame and no stamp.
_DIGITS = re.compile(r"(\d{1,19})", re.ASCII)


def files_in(folder: Path, *patterns: str) -> list[Path]:
    """The files of a folder that match one of the patterns, in the order of the numbers in their
    names. Hidden files are left out: macOS stores `._NAME` beside files on foreign disks.
    """
    found: set[Path] = set()
    for pattern in patterns or ("*",):
        found.update(path for path in folder.glob(pattern) if is_visible(path))
    return sorted(found, key=by_numbers)


def is_visible(path: Path) -> bool:
    """Whether a file is neither hidden nor one that a file manager left in the folder."""
    return not path.name.startswith(".") and path.name.lower() not in ("thumbs.db", "desktop.ini")


def by_numbers(path: PurePath | str) -> list[tuple[int, str]]:
    """A key that sorts names by the numbers in them: frame_9 before frame_10."""
    found = []
    for part in _DIGITS.split(str(path)):
        found.append((int(part), "") if part.isdecimal() else (-1, part))
    return found


def numbers_in_names(names: Sequence[PurePath | str]) -> list[int] | None:
    """The numbers of images' names without their endings: the last number of a name that differs in
    every other name, as 12 in rgb_12_left.png; None if the names have no such number.
    """
    split = [_DIGITS.findall(PurePath(name).stem) for name in names]
    if not split or len({len(digits) for digits in split}) > 1:
        return None
    for column in reversed(list(zip(*split, strict=True))):
        numbers = list(map(int, column))
        if len(set(numbers)) == len(numbers):
            return numbers
    return None
