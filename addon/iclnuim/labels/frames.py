"""The class and instance images of a sequence with ground truth, and of predictions in a folder."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..channels import DEPTH, INSTANCE, RGB
from ..errors import InputError
from ..formats.files import is_file
from ..formats.image_names import by_numbers, files_in
from ..sequences.frames import ImagePair, SequenceFrame
from ..sequences.stored_sequence import StoredSequence, opened
from .classes import LARGEST_ID, ClassMap, read_true_classes
from .images import read_label_image
from .scores import VOID

CLASS = "class"
CLASSES = "classes.csv"
_HINT = "a sequence that was made with {ground_truth}"
_PNG = "*.png"


@dataclass(frozen=True)
class LabelFrame:
    """A frame of a sequence and its class and instance images; instance is None if the sequence has
    none.
    """

    pair: ImagePair
    classes: Path
    instance: Path | None = None


def read_ids(path: Path) -> np.ndarray:
    """(h, w) uint16: the ids of a label image. Raises InputError for colours."""
    ids = read_label_image(path).ids
    if ids is None:
        raise InputError("labels as grey values", path=path, found="colours")
    return ids


def has_classes(folder: StoredSequence | Path) -> bool:
    """Whether a sequence has a class image of its first frame, and the table of classes."""
    sequence = opened(folder)
    return (
        is_file(sequence.folder / CLASSES)
        and image_of(sequence, sequence.pairs[0], CLASS) is not None
    )


def label_frames(folder: Path) -> list[LabelFrame]:
    """The frames of a sequence that have a class image. Raises InputError if there are none."""
    found = []
    sequence = StoredSequence(folder)
    for pair in sequence.pairs:
        classes = image_of(sequence, pair, CLASS)
        if classes is not None:
            found.append(LabelFrame(pair, classes, image_of(sequence, pair, INSTANCE)))
    if not found:
        raise InputError("class images", path=folder, found="none", hint=_HINT)
    return found


def true_classes(folder: Path) -> ClassMap:
    """The table of classes.csv. Raises InputError."""
    if not is_file(folder / CLASSES):
        raise InputError("a table of classes", path=folder / CLASSES, found="none", hint=_HINT)
    return read_true_classes(folder / CLASSES)


def image_of(sequence: StoredSequence, pair: ImagePair, kind: str) -> Path | None:
    """The image of a kind of ground truth as the sequence's format names it, else named as the
    depth image; None if there is none.
    """
    texts = {RGB: pair.written[0], DEPTH: pair.written[1]}
    frame = SequenceFrame(pair.number, pair.stamp_s, {}, texts)
    folder = sequence.folder
    places = [folder / sequence.format.image(frame, kind)]
    if pair.depth.is_relative_to(folder):
        places.append(folder / pair.depth.relative_to(folder).as_posix().replace(DEPTH, kind))
    return next((place for place in places if is_file(place)), None)


class LabelPredictions:
    """The label images of a kind that a method wrote for frames, found by name or by number: at the
    same place as in the sequence, in class/ or semantic_class/ (or instance), or, for classes, in
    the folder itself.

    Raises InputError if there is no such folder.
    """

    def __init__(self, folder: Path, kind: str, like: str) -> None:
        if not folder.is_dir():
            raise InputError("a folder of label images", path=folder, found="no such folder")
        self.folder = folder
        self._of_instances = kind == INSTANCE
        places = [folder / like, folder / kind, folder / f"semantic_{kind}"]
        if kind == CLASS:
            places.append(folder)
        images: list[Path] = next(filter(None, (files_in(p, _PNG) for p in places)), [])
        self.images = sorted(images, key=lambda path: by_numbers(path.stem))
        self._by_name = {path.stem: path for path in images}
        self._by_number: dict[int, list[Path]] = {}
        for path in images:
            number = re.fullmatch(r"\D*(\d{1,18})", path.stem, re.ASCII)
            if number:
                self._by_number.setdefault(int(number[1]), []).append(path)

    def __bool__(self) -> bool:
        return bool(self._by_name)

    def of_frames(self, frames: list[LabelFrame]) -> list[Path | None]:
        """The image of each frame: all by name if one has a frame's name, else by number.

        Raises InputError if none belongs to a frame, or if numbers leave out frames and images.
        """
        found: list[Path | None] = []
        for frame in frames:
            image = frame.instance if self._of_instances else frame.classes
            names = (image.stem if image else "", frame.pair.rgb.stem)
            found.append(next(filter(None, map(self._by_name.get, names)), None))
        if not any(found):
            found = self._numbered(frames)
        if not any(found):
            raise self._unlike(frames, f"none of them in {len(self._by_name)} PNG images")
        return found

    def _numbered(self, frames: list[LabelFrame]) -> list[Path | None]:
        found: list[Path | None] = []
        for frame in frames:
            images = self._by_number.get(frame.pair.number, [])
            if len(images) > 1:
                names = " and ".join(image.name for image in images[:2])
                raise InputError("one label image of a frame", path=self.folder, found=names)
            found.append(images[0] if images else None)
        unused = len(self._by_number) - sum(image is not None for image in found)
        if any(found) and unused and None in found:
            raise self._unlike(frames, f"numbers of {unused} other frames")
        return found

    def _unlike(self, frames: list[LabelFrame], found: str) -> InputError:
        name = frames[0].pair.rgb.stem
        expected = f"label images named as the frames, such as {name}.png"
        return InputError(expected, path=self.folder, found=found)


def indices_of_truth(truth: ClassMap, classes: ClassMap) -> np.ndarray:
    """(65536,) index in `classes` by the id of a true class; -1 for an id that the truth does not
    list.
    """
    found = np.full(LARGEST_ID + 1, -1, np.int32)
    found[[0, *(kind.id for kind in truth.void)]] = VOID
    for kind in truth.classes:
        found[kind.id] = classes.of_truth(kind)
    return found
