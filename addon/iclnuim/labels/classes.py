"""The numbering of classes in label images: ours, NYU40, ScanNet's 20, Replica's 101, or a table
of the user, and which of its classes the classes of the ground truth are.

A table is CSV with a line of column names: id (or class_id) and class (or name); optional: red,
green, blue (labels in colour), thing (0 or 1: whether its instances are segments of their own),
truth (names of true classes or NYU40 labels that are this class, separated by |), nyu40.
"""

import csv
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import read_text
from .images import LabelImage
from .scores import VOID

#: The tables in class_maps/.
BUILT_IN = ("ours", "nyu40", "scannet20", "replica")
OURS = "ours"
#: Classes of user-provided scenes that are not in our table are numbered from here on, in
#: alphabetical order.
FIRST_OWN = 1000
LARGEST_ID = (1 << 16) - 1
#: Names of no class.
_NO_CLASS = ("unlabelled", "unlabeled", "undefined", "unknown", "void", "ignore", "none")
#: Classes that are not things, if the table does not say so: they have no instances.
_STUFF = ("wall", "floor", "ceiling")
_COLOUR = ("red", "green", "blue")
_UNKNOWN = -1


@dataclass(frozen=True)
class LabelClass:
    """A class of a table: its number and colour in label images, its name and NYU40 label ("" if
    the table has none), and words for true classes that are this class.
    """

    id: int
    name: str
    nyu40: str = ""
    truth: tuple[str, ...] = ()
    is_thing: bool = True
    colour: tuple[int, ...] | None = None


@dataclass(frozen=True, eq=False)
class Indices:
    """Classes of pixels as row of the table + 1, VOID for none (h, w) int32, and the number of
    pixels by each id or colour that the table does not have; these are VOID, too.
    """

    values: np.ndarray
    unknown: dict[str, int]


@dataclass(frozen=True, eq=False)
class ClassMap:
    """A table of classes, in the order of the file. Number 0, black and the names of no class
    (unlabelled, void ...) are VOID unless the table has a class of that number or colour.
    """

    name: str
    classes: tuple[LabelClass, ...]
    void: tuple[LabelClass, ...] = ()

    @cached_property
    def is_thing(self) -> np.ndarray:
        """(n + 1,) bool by index; False for VOID."""
        return np.array([False, *(kind.is_thing for kind in self.classes)])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(n + 1,) names by index."""
        return (_NO_CLASS[0], *(kind.name for kind in self.classes))

    def indices(self, ids: np.ndarray) -> Indices:
        """The classes of ids, integers of any shape."""
        known = (ids >= 0) & (ids <= LARGEST_ID)
        found = np.where(known, self._of_id[np.where(known, ids, 0)], _UNKNOWN)
        return _without_unknown(found, ids, str)

    def of_image(self, image: LabelImage, path: StrPath) -> Indices:
        """The classes of a label image: by colour if both have colours, else by id.

        Raises InputError for an image in colour if the table has no colours.
        """
        if image.colours is not None and len(self._colours[0]):
            return self._of_colours(image.colours)
        if image.ids is None:
            expected = "labels as grey values or indices into a palette"
            hint = "{classes} with a table that has columns red, green, blue"
            raise InputError(expected, path=path, found="colours", hint=hint)
        return self.indices(image.ids)

    def of_truth(self, kind: LabelClass) -> int:
        """The index of a true class: that of its name, else of its NYU40 label; VOID if there is
        none.
        """
        for word in (kind.name, kind.nyu40):
            if word in self._of_word:
                return self._of_word[word]
        return VOID

    @cached_property
    def _of_word(self) -> dict[str, int]:
        found: dict[str, int] = {}
        for index, kind in enumerate(self.classes, 1):
            found |= dict.fromkeys(kind.truth, index)
        return {kind.name: index for index, kind in enumerate(self.classes, 1)} | found

    @cached_property
    def _of_id(self) -> np.ndarray:
        """(65536,) int32 index by id."""
        found = np.full(LARGEST_ID + 1, _UNKNOWN, np.int32)
        found[[0, *(kind.id for kind in self.void)]] = VOID
        found[[kind.id for kind in self.classes]] = np.arange(1, len(self.classes) + 1)
        return found

    @cached_property
    def _colours(self) -> tuple[np.ndarray, np.ndarray]:
        """Codes of the colours in ascending order, and the index of each; empty without colours."""
        found: dict[int, int] = {}
        kinds = [*((VOID, kind) for kind in self.void), *enumerate(self.classes, 1)]
        for index, kind in kinds:
            if kind.colour:
                found[int(_codes(np.array(kind.colour)))] = index
        if found:
            found.setdefault(0, VOID)
        codes = sorted(found)
        return np.array(codes, np.int64), np.array([found[code] for code in codes], np.int32)

    def _of_colours(self, colours: np.ndarray) -> Indices:
        codes, indices = self._colours
        pixels = _codes(colours)
        at = np.searchsorted(codes, pixels).clip(max=len(codes) - 1)
        found = np.where(codes[at] == pixels, indices[at], _UNKNOWN)
        return _without_unknown(found, pixels, "#{:06x}".format)


def class_map(name: str, truth: ClassMap) -> ClassMap:
    """The table of this name or file. Ours has the classes of the ground truth, too."""
    if name != OURS:
        return read_class_map(name)
    listed = {kind.id: kind for kind in (*read_class_map(OURS).classes, *truth.classes)}
    return replace(truth, name=OURS, classes=tuple(listed[number] for number in sorted(listed)))


def read_class_map(name: StrPath) -> ClassMap:
    """Read one of the tables of BUILT_IN, or a file. Raises InputError, also for an empty table."""
    found = read_true_classes(name)
    if not found.classes:
        raise InputError("a table of classes", path=name, found="none")
    return found


def read_true_classes(name: StrPath) -> ClassMap:
    """The same for classes.csv of a sequence, which is empty if its scene names no class."""
    path = Path(name)
    if name in BUILT_IN:
        path = Path(__file__).parent / "class_maps" / f"{name}.csv"
    elif not path.is_file():
        expected = f"{', '.join(BUILT_IN)}, or a table (.csv)"
        raise InputError(expected, path=path, found="no such file")
    classes: list[LabelClass] = []
    void: list[LabelClass] = []
    for line, row in _rows(path):
        kind = _class(row, path, line)
        (void if kind.name.lower() in _NO_CLASS else classes).append(kind)
    _check(path, [*classes, *void])
    return ClassMap(str(name), tuple(classes), tuple(void))


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """The line of each row, and its values by column. Raises InputError."""
    lines = csv.reader(read_text(path).splitlines())
    try:
        columns = [name.strip().lower() for name in next(lines, [])]
        if not {"id", "class_id"} & {*columns} or not {"class", "name"} & {*columns}:
            found = ", ".join(columns) or "none"
            raise InputError("columns id and class in the first line", path=path, found=found)
        for fields in lines:
            if len(fields) > len(columns):
                expected = f"{len(columns)} columns"
                raise InputError(expected, path=path, line=lines.line_num, found=len(fields))
            if any(field.strip() for field in fields):
                yield lines.line_num, dict(zip(columns, map(str.strip, fields), strict=False))
    except csv.Error as error:
        raise InputError("a table (CSV)", path=path, line=lines.line_num, found=error) from None


def _class(row: dict[str, str], path: Path, line: int) -> LabelClass:
    def number(text: str, name: str, largest: int) -> int:
        if not (text.isascii() and text.isdigit() and len(text) < 6 and int(text) <= largest):
            expected = f"{name} of 0 to {largest}"
            raise InputError(expected, path=path, line=line, found=text or "nothing")
        return int(text)

    name = row.get("class") or row.get("name") or ""
    if not name:
        raise InputError("the name of a class", path=path, line=line, found="nothing")
    thing = row.get("thing") or str(int(name not in _STUFF))
    colour = None
    if any(row.get(part) for part in _COLOUR):
        colour = tuple(number(row.get(part, ""), part, 255) for part in _COLOUR)
    words = row.get("truth", "").split("|")
    return LabelClass(
        number(row.get("id") or row.get("class_id") or "", "an id", LARGEST_ID),
        name,
        row.get("nyu40", ""),
        tuple(filter(None, map(str.strip, words))),
        bool(number(thing, "thing", 1)),
        colour,
    )


def _check(path: Path, kinds: list[LabelClass]) -> None:
    """Raises InputError if an id, a name, a colour or a word of the truth is there twice."""
    listed: dict[str, list] = {"id": [], "class": [], "colour": [], "truth": []}
    for kind in kinds:
        listed["id"].append(kind.id)
        listed["class"].append(kind.name)
        listed["truth"] += dict.fromkeys(kind.truth)
        if kind.colour:
            listed["colour"].append(kind.colour)
    for column, values in listed.items():
        value, count = Counter(values).most_common(1)[0] if values else (None, 0)
        if count > 1:
            raise InputError(f"each {column} once", path=path, found=f"{value} {count} times")


def _without_unknown(found: np.ndarray, values: np.ndarray, text: Callable[[int], str]) -> Indices:
    unknown = found == _UNKNOWN
    counts = dict(zip(*np.unique(values[unknown], return_counts=True), strict=True))
    named = {text(int(value)): int(count) for value, count in counts.items()}
    return Indices(np.where(unknown, VOID, found).astype(np.int32), named)


def _codes(colours: np.ndarray) -> np.ndarray:
    """Colours (..., 3) as whole numbers 0xrrggbb."""
    return colours.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])
