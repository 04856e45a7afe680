"""Comparison of two runs or sequences, file by file: byte for byte, or, if processors or Blender
versions differ, images within a tolerance.
"""

import json
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..channels import CHANNELS, DEPTH, FURTHER, RGB
from ..errors import InputError, StrPath, within
from ..formats.exr import read_exr
from ..formats.files import read_bytes, read_json
from ..formats.images import ARRAY, read_array, read_colour8
from ..formats.png import png_header, read_png
from ..shown import Shown
from .journal import JOURNAL
from .sequence_formats import FORMATS
from .stored_sequence import StoredSequence

#: The largest share of pixels of a frame beyond a channel's tolerance: rounding moves edges.
SHARE = 0.01
_EXR = ".exr"
_PNG = ".png"
_IMAGES = (_EXR, _PNG, ".jpg", ".jpeg", ARRAY)
#: Files that are not compared: recipes, which tell where a folder comes from, and hashes of images.
_ORIGINS = ("recipe.json", "sequence.json", JOURNAL)
#: The start of a file's or folder's name that is a channel's: depth_0, depth0, depth000000.png,
#: semantic_class.
_CHANNEL = re.compile(f"(?:semantic_)?({'|'.join(CHANNELS)})(?![a-z])")


@dataclass(frozen=True, repr=False)
class SequenceComparison(Shown):
    """The differences of two runs or sequences.

    images, other_files: numbers of images and of other files that are in both folders. by_bytes:
    whether bytes were compared, or images within the tolerances of their channels; reason: why.
    different: name of each file that is in both folders and differs -> the channels that differ
    (none if only its header differs, or it is no image that can be read). only_in_one: names of
    files that one folder lacks. largest_share: share 0..1 of pixels beyond the tolerance in the
    worst file; 0 if bytes were compared.
    """

    a: Path
    b: Path
    images: int
    other_files: int
    by_bytes: bool
    reason: str
    different: dict[str, list[str]]
    only_in_one: list[str]
    largest_share: float

    @property
    def same(self) -> bool:
        """Whether no file differs or is in one folder only."""
        return not self.different and not self.only_in_one

    def summary(self) -> str:
        """`clean and other/clean: 120 images, 0 files differ, 0 in one folder only`."""
        counts = f"{len(self.different)} files differ, {len(self.only_in_one)} in one folder only"
        return f"{self.a} and {self.b}: {self.images} images, {counts}"

    def to_dict(self) -> dict[str, Any]:
        """The comparison as `iclnuim compare` prints it with the option for JSON."""
        return {
            "images": self.images,
            "other_files": self.other_files,
            "by_bytes": self.by_bytes,
            "reason": self.reason,
            "different": self.different,
            "only_in_one": self.only_in_one,
            "largest_share": self.largest_share,
            "same": self.same,
        }


def compare_sequences(a: StrPath, b: StrPath, by_tolerance: bool = False) -> SequenceComparison:
    """Compare the files of two runs (EXR frames) or two sequences in any format, except for
    recipes, journals and hidden files.

    Bytes are compared if both folders come from the same Blender on the same kind of processor,
    according to their recipes; otherwise, or with `by_tolerance`, images are compared within the
    tolerances of their channels (channels.py: colour in 8-bit grey values, depth in metres), which
    at most 1 % of the pixels may exceed. PNGs of the same pixels are equal however they are
    compressed.

    Raises InputError if a folder is neither a run nor a sequence, if a recipe is invalid, or if no
    image is in both.
    """
    a = Path(a)
    b = Path(b)
    # the bytes depend on these
    origins = zip(("Blender", "processor features"), _origin(a), _origin(b), strict=True)
    differences = [f"{name}: {x} and {y}" for name, x, y in origins if x != y]
    reason = "requested" if by_tolerance else "; ".join(differences)
    one = _ComparedFiles.of(a)
    other = _ComparedFiles.of(b)
    both = sorted(one.paths.keys() & other.paths.keys())
    images = sum(map(_is_image, both))
    if not images:
        expected = "frames with the same numbers in both folders"
        raise InputError(expected, path=b, found=f"none that {a} has too")
    compared: Callable[[_ComparedFiles, _ComparedFiles, str], _Result] = _other_bytes
    if reason:
        compared = _beyond_tolerance
    with ThreadPoolExecutor() as pool:
        results = list(pool.map(lambda name: compared(one, other, name), both))
    named = zip(both, results, strict=True)
    return SequenceComparison(
        a,
        b,
        images,
        len(both) - images,
        by_bytes=not reason,
        reason=reason or "same kind of processor, same Blender",
        different={name: result.channels for name, result in named if result.differs},
        only_in_one=sorted(one.paths.keys() ^ other.paths.keys()),
        largest_share=max(result.share for result in results),
    )


@dataclass(frozen=True)
class _ComparedFiles:
    """The compared files of a folder by their path in it."""

    folder: Path
    paths: dict[str, Path]
    #: Depth units per metre by the folder of a sequence; filled when they are needed.
    units: dict[Path, float] = field(default_factory=dict)

    @classmethod
    def of(cls, folder: Path) -> "_ComparedFiles":
        paths = {}
        for path in folder.rglob("*"):
            inside = path.relative_to(folder)
            hidden = any(part.startswith(".") for part in inside.parts)
            if path.is_file() and not hidden and path.name not in _ORIGINS:
                paths[inside.as_posix()] = path
        return cls(folder, paths)

    def values(self, name: str) -> dict[str, np.ndarray] | None:
        """The values of an image by channel, as channels.py describes them: colour 0..255, depth in
        metres, normals -1..1, labels. None if it is not an image that can be read.
        """
        stored = _stored(name, self.paths[name])
        if stored is None or name.endswith(ARRAY):
            return stored
        if name.endswith(_EXR):
            return _displayed(stored)
        ((channel, pixels),) = stored.items()
        units = self._units_per_metre(name) if channel == DEPTH else 1.0
        return {channel: CHANNELS[channel].decode(pixels, units)}

    def _units_per_metre(self, name: str) -> float:
        """The depth units per metre of a depth image, in whose sequence's folder the camera is: one
        of the folders of several formats, or the folder itself.
        """
        top = name.partition("/")[0]
        folder = self.folder / top if top in FORMATS else self.folder
        if folder not in self.units:
            camera = StoredSequence(folder).camera_of(self.paths[name])
            self.units[folder] = camera.depth_units_per_metre
        return self.units[folder]


def _is_image(name: str) -> bool:
    return name.endswith(_IMAGES)


def _channel_of(name: str, path: Path) -> str:
    """The channel of a PNG: that in its name or the nearest folder's, if it is neither colour nor
    depth; else depth if it has one channel of 16 bits, colour otherwise.
    """
    header = png_header(path)
    deep = header.bits == 16
    for part in reversed(name.split("/")):
        if found := _CHANNEL.match(part):
            channel = FURTHER.get(found[1])
            # a normal of 8 bits would be within any tolerance
            if channel and (deep or not channel.tolerance):
                return channel.name
            break
    return DEPTH if deep and header.colour == "grey" else RGB


class _Result(NamedTuple):
    """Whether a file differs, in which channels, and the share of pixels beyond the tolerance."""

    differs: bool
    channels: list[str]
    share: float = 0.0


def _other_bytes(a: _ComparedFiles, b: _ComparedFiles, name: str) -> _Result:
    """The comparison of a file byte for byte. PNGs of the same pixels are equal: another library
    may have compressed them.
    """
    if _same_bytes(a, b, name):
        return _Result(False, [])
    different = _other_channels(a.paths[name], b.paths[name], name)
    same_pixels = name.endswith(_PNG) and different == []
    return _Result(not same_pixels, different or [])


def _same_bytes(a: _ComparedFiles, b: _ComparedFiles, name: str) -> bool:
    return read_bytes(a.paths[name]) == read_bytes(b.paths[name])


def _beyond_tolerance(a: _ComparedFiles, b: _ComparedFiles, name: str) -> _Result:
    """The comparison of an image within the tolerances of its channels, of another file, or one
    that cannot be decoded, byte for byte.
    """
    if _same_bytes(a, b, name):
        return _Result(False, [])
    one = a.values(name)
    other = b.values(name)
    if one is None or other is None:
        return _Result(True, [])
    shares = _shares(one, other)
    beyond = [channel for channel, share in shares.items() if share > SHARE]
    return _Result(bool(beyond), beyond, max(shares.values()))


def _origin(folder: Path) -> tuple[str, str]:
    """Blender's version and the processor's features in the recipe of the run in this folder, or of
    the run from which this sequence comes.
    """
    for name, inside in (("sequence.json", ()), ("recipe.json", ("source", "run"))):
        if (folder / name).is_file():
            with within(folder / name):
                run = _object_in(read_json(folder / name), *inside)
                features = _object_in(run, "machine").get("features", ["unknown"])
                if not isinstance(features, list):
                    raise InputError("a list as features", found=json.dumps(features))
                return str(run.get("blender", "unknown")), " ".join(map(str, features))
    raise InputError(
        "a run (sequence.json) or a sequence (recipe.json)", path=folder, found="neither"
    )


def _object_in(content: dict, *keys: str) -> dict:
    """The object under nested keys; {} where a key is absent.

    Raises InputError for another value.
    """
    for key in keys:
        content = content.get(key, {})
        if not isinstance(content, dict):
            raise InputError(f"a JSON object as {key}", found=json.dumps(content))
    return content


def _other_channels(a: Path, b: Path, name: str) -> list[str] | None:
    """Names of the channels that are not bitwise equal; None if a file is not an image that can be
    read.
    """
    one = _stored(name, a)
    other = _stored(name, b)
    if one is None or other is None:
        return None
    different = []
    for channel in one | other:
        both = channel in one and channel in other
        if not (both and np.array_equal(one[channel], other[channel], equal_nan=True)):
            different.append(channel)
    return different


def _stored(name: str, path: Path) -> dict[str, np.ndarray] | None:
    """The stored values of an image by channel; None if it is not an image that can be read."""
    if not _is_image(name):
        return None
    try:
        if name.endswith(_EXR):
            channels = read_exr(path)
            return channels if len(channels) > 1 else {DEPTH: next(iter(channels.values()))}
        if name.endswith(ARRAY):
            return {DEPTH: read_array(path)}
        if name.endswith(_PNG):
            return {_channel_of(name, path): read_png(path)}
        return {RGB: read_colour8(path)}
    except InputError:
        return None


def _shares(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> dict[str, float]:
    """Channel -> share of pixels that differ by more than its tolerance; 1 if one file lacks the
    channel, or the sizes differ.
    """
    tolerances = {}
    for name, channel in CHANNELS.items():
        tolerances[name] = tolerances[channel.exr_name or name] = channel.tolerance
    shares = {}
    for name in a | b:
        shares[name] = 1.0
        if name in a and name in b and a[name].shape == b[name].shape:
            near = np.isclose(
                a[name], b[name], rtol=0.0, atol=tolerances.get(name, 0.0), equal_nan=True
            )
            shares[name] = float((~near).mean())
    return shares


def _displayed(exr: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The values of a frame by channel; colour is clipped to a display's range."""
    found = {}
    for channel in CHANNELS.values():
        # not an image of the same channels, as classes are of instances
        if exr.keys() >= channel.exr.keys():
            image = channel.read(exr, lambda: np.zeros(0))
            found[channel.exr_name or channel.name] = channel.displayed(image)
            for name in channel.exr:
                del exr[name]
    return found | {name: values.astype(float) for name, values in exr.items()}
