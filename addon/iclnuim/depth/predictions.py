"""The depth that a method predicted for the frames of a sequence: a folder with a file for each
frame, or one file with an array for all.

A frame's file is DIR/depth/NAME or DIR/NAME, or DIR/NAME/depth, where NAME is the name of its colour
or depth image; where no name fits, files belong to frames by the number in their names. Endings and
contents: .png (16-bit grey, in units), .npy, .npz (the array `depth`, or the only one), .exr (the
channel of `exr_depth`), .tif and .tiff (grey).
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..evaluation.predicted_arrays import DEPTHS, POINTS, predicted_depth, predicted_points
from ..formats.arrays import map_npy, read_npy, read_npz
from ..formats.exr import read_exr
from ..formats.files import is_file, read_bytes
from ..formats.image_names import files_in, numbers_in_names
from ..formats.images import exr_depth
from ..formats.libraries import first_library
from ..formats.png import png_header, read_depth16
from ..sequences.frames import ImagePair

ENDINGS = (".png", ".npy", ".npz", ".exr", ".tif", ".tiff")
_DEPTH = "depth"
_POINTS = "points"
_EXPECTED = {
    _DEPTH: "predicted depth (h, w)",
    _POINTS: "a point map (h, w, 3)",
}
_MAX_PIXELS = 1 << 28


class Predictions:
    """What a method predicted for frames, in the frames' order; `kind` is depth or points.

    name: of the method, that of its folder. missing: names of frames without a file.

    Raises InputError if there is no such folder, or nothing in it belongs to the frames.
    """

    def __init__(
        self,
        folder: Path,
        pairs: Sequence[ImagePair],
        units_per_metre: float,
        kind: str = _DEPTH,
    ) -> None:
        self.folder = folder
        self.name = folder.stem if folder.is_file() else folder.resolve().name
        self.units_per_metre = units_per_metre
        self._kind = kind
        self._expected = _EXPECTED[kind]
        self._pairs = pairs
        stack = _stack(folder, kind)
        self._stack = stack
        self._files: list[Path | None] = [None] * len(pairs)
        if stack is None:
            self._files = _files_of(folder, pairs, kind)
        elif len(self._of_all) != len(pairs):
            expected = f"an array for each of {len(pairs)} frames"
            raise InputError(expected, path=stack, found=len(self._of_all))

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the frames without a prediction."""
        if self._stack is not None:
            return ()
        found = zip(self._pairs, self._files, strict=True)
        return tuple(pair.rgb.stem for pair, file in found if file is None)

    def has(self, row: int) -> bool:
        """Whether there is a prediction for a frame."""
        return self._stack is not None or self._files[row] is not None

    def __getitem__(self, row: int) -> np.ndarray:
        """The values (h, w) or (h, w, 3) of a frame that has some, NaN outside their mask.

        Raises InputError for a file that cannot be read.
        """
        file = self._files[row]
        if file is not None:
            return self._read(file)[0]
        if self._stack is not None and self._stack.suffix == ".npy":
            return np.array(self._read(self._stack, whole=True)[row])  # and the map is closed
        return self._of_all[row]

    @cached_property
    def _of_all(self) -> np.ndarray:
        assert self._stack is not None
        return self._read(self._stack, whole=True)

    def _read(self, path: Path, whole: bool = False) -> np.ndarray:
        """(n, h, w) or (n, h, w, 3), n = 1 but for the file of all frames."""
        values, mask = self._parts(path, whole)
        if values.size > _MAX_PIXELS and not whole:
            raise InputError(self._expected, path=path, found=values.shape)
        if values.ndim == (2 if self._kind == _DEPTH else 3):
            values = values[None]
        if len(values) != 1 and not whole:
            raise InputError(self._expected, path=path, found=f"{len(values)} of them")
        if mask is not None:
            mask = mask.reshape(values.shape[: values.ndim - (self._kind == _POINTS)])
            values = values.astype(np.result_type(values, np.float32))
            values[~mask] = np.nan
        return values

    def _parts(self, path: Path, whole: bool) -> tuple[np.ndarray, np.ndarray | None]:
        ending = path.suffix.lower()
        arrays = predicted_depth if self._kind == _DEPTH else predicted_points
        names = DEPTHS if self._kind == _DEPTH else POINTS
        try:
            if ending == ".npz":
                found = read_npz(path, (*names, "mask", "sky"), self._expected)
                if len(found) == 1 and not set(found) & set(names):
                    found = dict.fromkeys(names[-1:], next(iter(found.values())))
                return arrays(found)
            if ending == ".npy":
                read = map_npy if whole else read_npy
                return arrays(read(path, self._expected))
            if self._kind == _POINTS:
                return arrays(_exr_points(path, self._expected))
            return arrays(_image(path, self.units_per_metre))
        except InputError as error:
            raise error if error.path else error.at(path) from None


def _image(path: Path, units_per_metre: float) -> np.ndarray:
    """Depth (h, w) of an image file: float in its unit, whole numbers by units per metre."""
    ending = path.suffix.lower()
    if ending == ".exr":
        return exr_depth(path)
    if ending == ".png":
        if png_header(path).bits == 8:
            found = "8 bits, a picture to look at"
            hint = "the values that the method computed, as .npy or a PNG of 16 bits"
            raise InputError("depth with 16 bits or more", path=path, found=found, hint=hint)
        return read_depth16(path) / units_per_metre
    return _tiff(path, units_per_metre)


def _exr_points(path: Path, expected: str) -> np.ndarray:
    """(h, w, 3): x, y, z as R, G, B, as MoGe writes them."""
    if path.suffix.lower() != ".exr":
        raise InputError(f"{expected} as .npy, .npz or .exr", path=path, found=path.suffix)
    channels = read_exr(path)
    if not set("RGB") <= set(channels):
        raise InputError("channels R, G, B of points", path=path, found=", ".join(channels))
    return np.stack([channels[name] for name in "RGB"], -1)


def _tiff(path: Path, units_per_metre: float) -> np.ndarray:
    _, cv2 = first_library("TIFF", "cv2")
    data = np.frombuffer(read_bytes(path, "an image"), np.uint8)
    try:
        values = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error:
        values = None
    expected = "a grey TIFF of floating-point numbers or 16-bit units"
    if values is None:
        raise InputError(expected, path=path, found="pixels that cannot be decoded")
    if values.ndim != 2 or values.dtype not in (np.uint16, np.float32, np.float64):
        raise InputError(expected, path=path, found=f"{values.dtype} {values.shape}")
    return values / units_per_metre if values.dtype == np.uint16 else values


def _stack(folder: Path, kind: str) -> Path | None:
    """The file with an array for all frames; None if there is none."""
    if is_file(folder):
        if folder.suffix.lower() not in (".npy", ".npz"):
            raise InputError("a folder, .npy or .npz", path=folder, found=folder.suffix)
        return folder
    if not folder.is_dir():
        raise InputError(f"a folder of {_EXPECTED[kind]}", path=folder, found="no such folder")
    files = [path for path in files_in(folder) if path.suffix.lower() in ENDINGS]
    if len(files) == 1 and not any((folder / name).is_dir() for name in (_DEPTH, _POINTS)):
        path = files[0]
        if path.suffix == ".npy" and _is_stack(map_npy(path, _EXPECTED[kind]), kind):
            return path
        if path.suffix == ".npz" and numbers_in_names([path]) is None:  # of no frame
            return path
    return None


def _is_stack(values: np.ndarray, kind: str) -> bool:
    """Whether an array has more than one image or point map."""
    shape = [side for side in values.shape if side != 1]
    return len(shape) > (2 if kind == _DEPTH else 3)


def _files_of(folder: Path, pairs: Sequence[ImagePair], kind: str) -> list[Path | None]:
    """The file of each frame: all by name if one has a frame's name, else all by number."""
    place = folder / kind if (folder / kind).is_dir() else folder
    by_name: dict[str, Path] = {}
    for path in files_in(place):
        if path.suffix.lower() in ENDINGS:
            other = by_name.setdefault(path.stem, path)
            if other != path:
                both = f"{other.name} and {path.name}"
                raise InputError("one file of a frame", path=place, found=both)
        elif path.is_dir():
            inside = [f for f in files_in(path, f"{kind}.*") if f.suffix.lower() in ENDINGS]
            by_name |= {path.name: inside[0]} if inside else {}
    found: list[Path | None] = []
    for pair in pairs:
        found.append(by_name.get(pair.rgb.stem) or by_name.get(pair.depth.stem))
    if any(found):
        return found
    numbers = numbers_in_names(list(by_name)) or []
    by_number = dict(zip(numbers, by_name.values(), strict=bool(numbers)))
    found = [by_number.get(pair.number) for pair in pairs]
    unused = len(by_number) - sum(path is not None for path in found)
    if not any(found) or (unused and None in found):
        raise _unlike(place, pairs, numbers, len(by_name))
    return found


def _unlike(
    place: Path, pairs: Sequence[ImagePair], numbers: Sequence[int], count: int
) -> InputError:
    expected = f"files named as the frames, such as {pairs[0].rgb.stem}.npy"
    found = f"none of them in {count} files"
    hint = None
    if numbers:
        of_frames = [pair.number for pair in pairs]
        found = f"numbers {min(numbers)} to {max(numbers)} in {count} files"
        hint = f"the frames' numbers, {min(of_frames)} to {max(of_frames)}, in the names"
    return InputError(expected, path=place, found=found, hint=hint)
