"""The groups of pixels for which errors are reported, and the pixels that count: by class or object,
by distance, and by the angle between surface normal and viewing ray.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..channels import CHANNELS, INSTANCE
from ..errors import InputError
from ..formats.files import is_file, read_json
from ..formats.png import read_rgb16
from ..labels.frames import CLASS, CLASSES, image_of, read_ids, true_classes
from ..sequences.frames import ImagePair
from ..sequences.run_folder import OBJECTS
from ..sequences.stored_sequence import StoredSequence

NORMAL = "normal"
KINDS = {
    "class": "classes of the sequence, which was made with ground truth",
    "distance": "true depth",
    "angle": "between the surface normal and the viewing ray; needs normals",
}
#: Limits in metres of the groups by distance, and in degrees of those by angle.
DISTANCES_M = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, np.inf)
ANGLES_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
_HINT = "a sequence that was made with {ground_truth}"

#: Returns (h, w) int: the group of each pixel, -1 for none.
Numbers = Callable[[ImagePair, np.ndarray], np.ndarray]


class Groups:
    """The groups of one kind of the frames of a sequence: names and, of a frame, numbers.

    Raises InputError if the sequence has no such ground truth.
    """

    def __init__(self, kind: str, truth: StoredSequence) -> None:
        self.kind = kind
        self.names: tuple[str, ...]
        self.numbers: Numbers
        if kind == "distance":
            self.names = _ranges(DISTANCES_M, "m")
            self.numbers = lambda pair, true_m: _bins(true_m, DISTANCES_M)
        elif kind == "angle":
            self.names = _ranges(ANGLES_DEG, "deg")
            self.numbers = _Angles(truth)
        elif kind == "class":
            known = true_classes(truth.folder)
            classes = [*known.classes, *known.void]
            self.names = tuple(one.name for one in classes)
            self.numbers = _Labels(truth, CLASS, [one.id for one in classes])
        else:
            raise InputError(f"one of {', '.join(KINDS)}", setting="by", found=kind)


def _ranges(limits: Sequence[float], unit: str) -> tuple[str, ...]:
    found = []
    for low, high in zip(limits, limits[1:], strict=False):
        found.append(f"{low:g}-{high:g} {unit}" if np.isfinite(high) else f">{low:g} {unit}")
    return tuple(found)


def _bins(values: np.ndarray, limits: Sequence[float]) -> np.ndarray:
    """The bin of each value, its lower limit outside and its upper one inside; -1 for none."""
    found = np.searchsorted(limits, values, "left") - 1
    return np.where(found < len(limits) - 1, found, -1)


class _Labels:
    """Row of an id in a list of ids, by a kind of image of ids."""

    def __init__(self, truth: StoredSequence, kind: str, ids: Sequence[int]) -> None:
        self._truth = truth
        self._kind = kind
        self._rows = np.full(1 << 16, -1, np.int32)
        self._rows[list(ids)] = np.arange(len(ids))

    def __call__(self, pair: ImagePair, true_m: np.ndarray) -> np.ndarray:
        return self._rows[read_ids(_needed(self._truth, pair, self._kind))]


class _Angles:
    def __init__(self, truth: StoredSequence) -> None:
        self._truth = truth
        rays = truth.camera.pinhole.rays().astype(np.float32)
        self._rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def __call__(self, pair: ImagePair, true_m: np.ndarray) -> np.ndarray:
        pixels = read_rgb16(_needed(self._truth, pair, NORMAL))
        normal = CHANNELS[NORMAL].decode(pixels.astype(np.float32), 1.0)
        cosine = -(normal * self._rays).sum(axis=-1)
        angle_deg = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
        # 0 degrees is in the first bin
        found = _bins(np.maximum(angle_deg, 1e-6), ANGLES_DEG)
        return np.where(pixels.any(axis=-1), found, -1)


def _needed(truth: StoredSequence, pair: ImagePair, kind: str) -> Path:
    image = image_of(truth, pair, kind)
    if image is None:
        expected = f"{kind} images"
        found = f"none of {pair.rgb.name}"
        raise InputError(expected, path=truth.folder, found=found, hint=_HINT)
    return image


class Chosen:
    """Which pixels of a frame count: those of the classes and objects `only`, all if it is empty,
    without those of `without`.

    Raises InputError for a name that is neither a class (classes.csv) nor an object (objects.json).
    """

    def __init__(self, truth: StoredSequence, only: Sequence[str], without: Sequence[str]) -> None:
        self._only = [_test(truth, name) for name in only]
        self._without = [_test(truth, name) for name in without]

    def mask(self, pair: ImagePair) -> np.ndarray | None:
        """(h, w) bool; None if all pixels count."""
        found = None
        for test in self._only:
            found = test(pair) if found is None else found | test(pair)
        for test in self._without:
            found = ~test(pair) if found is None else found & ~test(pair)
        return found


def _test(truth: StoredSequence, name: str) -> Callable[[ImagePair], np.ndarray]:
    """A function that returns which pixels (h, w) of a frame show a class or an object."""
    folder = truth.folder
    classes = true_classes(folder) if is_file(folder / CLASSES) else None
    listed = [] if classes is None else [*classes.classes, *classes.void]
    ids = [one.id for one in listed if one.name == name]
    kind = CLASS
    objects = []
    if not ids and is_file(folder / OBJECTS):
        objects = read_json(folder / OBJECTS).get("objects", [])
        ids = [int(one["id"]) for one in objects if one.get("name") == name]
        kind = INSTANCE
    if not ids:
        names = [one.name for one in listed]
        expected = "a class or an object of the sequence"
        hint = f"one of {', '.join(names)}" if names else _HINT
        raise InputError(expected, path=folder, found=name, hint=hint)
    rows = _Labels(truth, kind, ids)
    return lambda pair: rows(pair, np.zeros(0)) >= 0
