"""The images of a frame of a sequence that is written: noise, encoding, files, and their hashes.

Each image is encoded once for all files that store it in the same way, and copied if the original
stores it so.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..channels import CHANNELS, CONFIDENCE, DEPTH, RGB
from ..errors import InputError
from ..formats.depth_units import count_invalid, depth16_from_metres, invalid_after_noise
from ..formats.exr import write_exr
from ..formats.files import atomic_write_bytes, read_bytes, sha256
from ..formats.images import ARRAY, EXR, JPEG, image_header, write_array, write_jpeg
from ..formats.png import png_bytes
from ..geometry.camera import PinholeCamera, nearest_pixels
from ..sensor import noise_model
from ..sensor.models import depth_and_confidence
from ..sensor.noise_model import frame_generator
from .format import SequenceFormat, common_units
from .frame_pool import keep_freed_memory
from .frame_source import FrameSource
from .frames import SequenceFrame, missing_is_largest
from .journal import Journal, JournalEntry
from .recipe import form_of_folder
from .sequence_options import SequenceSettings


@dataclass(frozen=True)
class ImageFile:
    """An image to write: its channel, its path, the depth units per metre of its file, and its
    columns if the file has fewer than the image.

    stored: how the image is stored: its channel, with the ending of the path if it is not PNG, the
    units if they are not those of the sequence, and the columns. Files with the same key have the
    same content.
    """

    kind: str
    path: Path
    units: float
    stored: str
    width: int | None = None

    @classmethod
    def of(
        cls, kind: str, path: Path, units: float, usual: float, width: int | None = None
    ) -> "ImageFile":
        """`usual`: the depth units per metre of the sequence."""
        stored = kind
        if path.suffix != ".png":
            stored += path.suffix
        elif kind == DEPTH and units != usual:
            stored += f" {units:g} a metre"
        if width:
            stored += f" {width} wide"
        return cls(kind, path, units, stored, width)

    def write(self, image: np.ndarray) -> bytes:
        """Write the image, depth in metres, in the format of the path's ending; returns the
        content.
        """
        if self.width:
            image = _narrowed(image, self.width)
        if self.path.suffix == JPEG:
            write_jpeg(self.path, image)
        elif self.path.suffix == ARRAY:
            write_array(self.path, np.where(np.isfinite(image) & (image > 0), image, 0))
        elif self.path.suffix == EXR:
            depth_m = np.where(np.isfinite(image) & (image > 0), image, 0)
            write_exr(self.path, {"R": depth_m.astype(np.float32)})
        else:
            if self.kind in CHANNELS:
                image = CHANNELS[self.kind].encode(image, self.units)
            data = png_bytes(image)
            atomic_write_bytes(self.path, data)
            return data
        return read_bytes(self.path)

    def copy(self, data: bytes) -> bytes:
        """Write this content; returns it."""
        atomic_write_bytes(self.path, data)
        return data


class SourceFrame:
    """A frame of a source, read at first use."""

    def __init__(self, source: FrameSource, number: int) -> None:
        self.source = source
        self.number = number

    @cached_property
    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Light (h, w, 3) and depth (h, w) in metres."""
        return self.source.load(self.number)

    @cached_property
    def further(self) -> dict[str, np.ndarray]:
        """The images besides colour and depth by name."""
        return self.source.further.images(self.number) if self.source.further else {}


class SequenceImages:
    """The images of a sequence in a folder, made from `source` with `settings`: where they are,
    which are finished, and how a frame's are made. A single format is in the folder itself, several
    formats are in a subfolder each.

    kinds: the channels of a frame; files: those of each frame of the source by its number.
    """

    def __init__(
        self,
        source: FrameSource,
        out: Path,
        settings: SequenceSettings,
        formats: Sequence[SequenceFormat],
    ) -> None:
        self.source = source
        self.out = out
        self.kinds = tuple(channel.name for channel in source.channels)
        form = form_of_folder(out, settings.names)
        self.formats = [format.named(form) for format in formats]
        self.units = common_units(self.formats, settings.depth_units_per_metre)
        self.settings = replace(settings, depth_units_per_metre=self.units, names=form)
        self.journal = Journal(out)
        self.files = {number: self._files_of(number) for number in source.stamps_s}

    def folder_of(self, format: SequenceFormat) -> Path:
        """The folder of a format's files."""
        return self.out if len(self.formats) == 1 else self.out / format.name

    def frame(self, number: int) -> SequenceFrame:
        """The number and stamp of a frame, and its names in a user-provided sequence."""
        kept = self.source.names.get(number)
        return kept or SequenceFrame(number, self.source.stamps_s[number])

    def paths(self, number: int) -> list[Path]:
        """All files of a frame."""
        return [file.path for file in self.files[number]]

    def _files_of(self, number: int) -> tuple[ImageFile, ...]:
        frame = self.frame(number)
        found = []
        has_confidence = getattr(self.settings.depth, "gives_confidence", False)
        for kind in (*self.kinds, CONFIDENCE):
            for format in self.formats:
                if kind == CONFIDENCE and not (has_confidence and format.limits.confidence):
                    continue
                path = self.folder_of(format) / format.image(frame, kind)
                units = format.limits.fixed_units or self.units
                width = format.limits.depth_width if kind in (DEPTH, CONFIDENCE) else None
                if width and width >= self.source.camera.width:
                    width = None
                found.append(ImageFile.of(kind, path, units, self.units, width))
        return tuple(found)

    def exist(self, number: int) -> bool:
        """Whether all images of a frame exist and are in the journal."""
        return number in self.journal.entries and all(p.is_file() for p in self.paths(number))

    def are_complete(self, number: int) -> bool:
        """Whether all images of a frame have the hashes in the journal, and were made from the same
        files of the source.
        """
        entry = self.journal.entries.get(number)
        if entry is None:
            return False
        if entry.source_sha256 and entry.source_sha256 != self.source.digest(number):
            return False
        digests = entry.digests
        try:
            for file in self.files[number]:
                if sha256(file.path.read_bytes()) != digests.get(file.stored):
                    return False
        except OSError:
            return False
        return True

    def make(self, frame: SourceFrame) -> JournalEntry | None:
        """Write the images of a frame. Returns its entry for the journal; None if they are
        complete.
        """
        number = frame.number
        if self.are_complete(number):
            return None
        by_content: dict[str, list[ImageFile]] = {}
        for file in self.files[number]:
            by_content.setdefault(file.stored, []).append(file)
        digests = self._copied_originals(number, by_content)
        invalid: dict[str, int] = {}
        if len(digests) < len(by_content):
            light, depth_z_m = frame.pixels
            camera = self.source.camera
            noisy = noisy_metres(light, depth_z_m, camera, number, self.settings)
            invalid = noisy.invalid
            images = {RGB: noisy.rgb, DEPTH: noisy.depth_z_m, **frame.further}
            if noisy.confidence is not None:
                images[CONFIDENCE] = noisy.confidence
            for stored, files in by_content.items():
                if stored not in digests:
                    digests[stored] = _written(files, ImageFile.write, images[files[0].kind])
        return self._entry(number, digests, invalid)

    def _copied_originals(
        self, number: int, by_content: dict[str, list[ImageFile]]
    ) -> dict[str, str]:
        """Copy the originals to the files that store images in the same way.

        Returns SHA-256 by ImageFile.stored.
        """
        digests: dict[str, str] = {}
        pair = self.source.originals.get(number)
        if pair is None or not self.settings.is_clean:
            return digests
        units = self.source.depth_units_per_metre
        for kind, path in ((RGB, pair.rgb), (DEPTH, pair.depth)):
            stored = ImageFile.of(kind, path, units, self.units).stored
            if stored in by_content and can_be_copied(path, kind, self.source.camera):
                data = read_bytes(path, "an image")
                digests[stored] = _written(by_content[stored], ImageFile.copy, data)
        return digests

    def _entry(self, number: int, digests: dict[str, str], invalid: dict[str, int]) -> JournalEntry:
        """`digests`: SHA-256 by ImageFile.stored."""
        rgb = digests.pop(RGB, "")
        depth = digests.pop(DEPTH, "")
        further = {kind: digests.pop(kind) for kind in self.kinds if kind in digests}
        source = self.source.digest(number)
        return JournalEntry(
            number, rgb, depth, invalid, further, other_sha256=digests, source_sha256=source
        )


class FrameMaker:
    """Makes the images of frames for sequences that a SequenceWriter has started, in any process.
    It writes only images.
    """

    def __init__(self, source: FrameSource, sequences: Sequence[SequenceImages]) -> None:
        keep_freed_memory()
        self.source = source
        self._sequences = sequences

    def make(self, number: int) -> list[JournalEntry | None]:
        """Write the missing images of a frame, on any thread. Returns an entry for each sequence,
        None if no image was missing; pass them to `SequenceWriter.note` on one thread. Raises
        InputError for a frame that cannot be read, WorkError if an image cannot be written.
        """
        frame = SourceFrame(self.source, number)
        return [images.make(frame) for images in self._sequences]


def _narrowed(image: np.ndarray, width: int) -> np.ndarray:
    """The image with so many columns and rows in proportion, each pixel that at its centre."""
    height = max(2, round(image.shape[0] * width / image.shape[1]))
    rows = nearest_pixels(image.shape[0], height)
    return image[np.ix_(rows, nearest_pixels(image.shape[1], width))]


def _written(
    files: Sequence[ImageFile],
    write: Callable[[ImageFile, Any], bytes],
    content: np.ndarray | bytes,
) -> str:
    """Write an image to files of the same content: into the first, to which the others are linked.

    Returns SHA-256.
    """
    first, *others = files
    digest = sha256(write(first, content))
    for other in others:
        other.path.unlink(missing_ok=True)
        try:
            os.link(first.path, other.path)
        except OSError:  # a file system without links
            write(other, content)
    return digest


def can_be_copied(path: Path, kind: str, camera: PinholeCamera) -> bool:
    """Whether a file is valid, of the camera's size, and 8-bit RGB, 16-bit grey, or metres. Raises
    InputError if it is damaged.
    """
    header = image_header(path, whole=True)
    stored = (header.bits, header.colour)
    right = stored == (8, "RGB")
    if kind == DEPTH:
        right = stored in ((16, "grey"), (32, "grey, metres")) and not missing_is_largest(path)
    return right and (header.width, header.height) == (camera.width, camera.height)


def noisy_images(
    rgb: np.ndarray,
    depth_z_m: np.ndarray,
    camera: PinholeCamera,
    number: int,
    settings: SequenceSettings,
) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """The images of one frame: (h, w, 3) uint8 colour, (h, w) uint16 depth, and the number of depth
    pixels that became 0, by kind.

    The result depends only on the arguments. Raises InputError if user-provided noise returns
    another shape or type.
    """
    noisy = noisy_metres(rgb, depth_z_m, camera, number, settings)
    depth16 = depth16_from_metres(noisy.depth_z_m, settings.depth_units_per_metre)
    return noisy.rgb, depth16, noisy.invalid


@dataclass(frozen=True, eq=False)
class NoisyFrame:
    """Colour (h, w, 3) uint8, depth (h, w) in metres, float, the number of depth pixels that became
    0, by kind, and the confidence (h, w) uint8 of a model that gives one.
    """

    rgb: np.ndarray
    depth_z_m: np.ndarray
    invalid: dict[str, int]
    confidence: np.ndarray | None


def noisy_metres(
    rgb: np.ndarray,
    depth_z_m: np.ndarray,
    camera: PinholeCamera,
    number: int,
    settings: SequenceSettings,
) -> NoisyFrame:
    """Like noisy_images, with depth in metres."""
    units = settings.depth_units_per_metre
    invalid = count_invalid(depth_z_m, units)
    image = settings.rgb.apply(rgb, frame_generator(settings.seed, number, noise_model.RGB))
    rng = frame_generator(settings.seed, number, noise_model.DEPTH)
    noisy_z_m, confidence = depth_and_confidence(settings.depth, depth_z_m, camera, rng, rgb)
    _check(settings.rgb.name, image, rgb.shape, np.dtype(np.uint8))
    _check(settings.depth.name, noisy_z_m, depth_z_m.shape, np.floating)
    invalid |= invalid_after_noise(depth_z_m, noisy_z_m, units)
    return NoisyFrame(image, noisy_z_m, invalid, confidence)


def _check(name: str, array: object, shape: tuple[int, ...], kind: type | np.dtype) -> None:
    if isinstance(array, np.ndarray) and array.shape == shape:
        right = np.issubdtype(array.dtype, kind)
    else:
        right = False
    if not right:
        numbers = "float" if kind is np.floating else kind
        found = f"{getattr(array, 'shape', '')} {getattr(array, 'dtype', type(array))}"
        raise InputError(f"an array {shape} of {numbers} from the noise {name}", found=found)
