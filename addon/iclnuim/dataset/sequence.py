"""Writes a sequence from frames, with noise: in any order, on any number of cores, resumable, with
its recipe.

`frames.jsonl` has one line per finished frame, with the hashes of its images, so that a stopped
sequence can be resumed. recipe.json contains everything that determines the pixels, the versions of
the programs, and counts. The same recipe gives the same bytes.
"""

import contextlib
import json
import os
import platform
import tempfile
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError, WorkError
from ..formats.files import (
    atomic_write,
    atomic_write_text,
    locked,
    make_folder,
    read_bytes,
    read_json,
    sha256,
    write_json,
    writer_has_ended,
)
from ..formats.images import ARRAY, JPEG, image_header, read_colour8, write_array, write_jpeg
from ..formats.libraries import first_library
from ..formats.png import COMPRESSORS, same_pixels, write_png
from ..geometry.camera import PinholeCamera
from ..sensor.models import depth_model, rgb_model
from ..sensor.transfer import srgb8
from ..shipped import source_commit
from ..version import __version__
from . import ground_truth
from .depth_units import KINDS, UNITS_PER_METRE, depth16_from_metres
from .frame_pool import FramePool, cores
from .frames import FrameSource, frames_of_run, read_depth_m
from .layout import DEPTH, RGB, Contents, SequenceFormat, SequenceFrame
from .run_folder import RunFolder, refuse_other, run_key
from .sequence_formats import sequence_format
from .sequence_options import SequenceSettings, noisy_metres

_SCHEMA_VERSION = 1
#: Keys that determine the files; the others may differ when a sequence is resumed.
_IDENTITY = (
    "schema_version",
    "source",
    "camera",
    "depth_noise",
    "rgb_noise",
    "seed",
    "depth_units_per_metre",
)
#: format_in_folder: the format in the folder itself, to which formats in subfolders were added
#: later.
_KEYS = (
    "kind", *_IDENTITY, "formats", "format_in_folder", "versions", "source_commit", "finished", "frames", "invalid_depth_pixels",
)  # fmt: skip


class Place(NamedTuple):
    """The path of an image to write, and its depth units per metre."""

    path: Path
    units: float


#: The files of a frame by kind of image: rgb, depth, and the kinds of ground truth.
Places = dict[str, list[Place]]


@dataclass(frozen=True)
class WrittenSequence:
    """Folders (one per format), number of frames made now and of frames found finished, and number
    of pixels without depth by kind.
    """

    folders: tuple[Path, ...]
    made: int
    found: int
    invalid_depth: dict[str, int]


@dataclass(frozen=True)
class JournalEntry:
    """Frame number, SHA-256 of both images as PNG, number of depth pixels that became 0 by kind,
    SHA-256 of ground-truth images by kind, and of
    images that are stored in another way, by the key of `_stored_as`. source_sha256:
    FrameSource.digest() of the frame.
    """

    frame: int
    rgb_sha256: str = ""
    depth_sha256: str = ""
    invalid_depth: dict[str, int] = field(default_factory=dict)
    truth_sha256: dict[str, str] = field(default_factory=dict)
    other_sha256: dict[str, str] = field(default_factory=dict)
    source_sha256: str = ""

    def to_line(self) -> str:
        """A line of JSON; the last three items only if they are not empty."""
        optional = ("truth_sha256", "other_sha256", "source_sha256")
        content = {k: v for k, v in asdict(self).items() if v or k not in optional}
        return json.dumps(content) + "\n"

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of all images by the key of `_stored_as`."""
        return {
            RGB: self.rgb_sha256,
            DEPTH: self.depth_sha256,
            **self.truth_sha256,
            **self.other_sha256,
        }


def read_entries(path: Path) -> dict[int, JournalEntry]:
    """The entries of a journal's complete lines, the latest of each frame.

    The file is not changed, because a process may be writing it.
    """
    whole = path.read_bytes().rpartition(b"\n")[0] if path.is_file() else b""
    found = {}
    for line in whole.decode("utf-8", "replace").split("\n"):
        with contextlib.suppress(ValueError, TypeError):
            entry = JournalEntry(**json.loads(line))
            found[entry.frame] = entry
    return found


def write_sequence(
    source: FrameSource,
    out: Path | str,
    settings: SequenceSettings | None = None,
    formats: Iterable[str] = ("tum",),
    workers: int | None = None,
    on_frame: Callable[[int], None] = lambda number: None,
) -> WrittenSequence:
    """Write `source` as a sequence into `out`, or resume the one that was started there; see
    SequenceWriter.
    """
    writer = SequenceWriter(source, {Path(out): settings or SequenceSettings()}, formats)
    return writer.write(workers, on_frame)[0]


class SequenceImages:
    """Makes the images of frames for sequences (folder -> settings) that a SequenceWriter has
    started, in any process. It reads the state of the
    sequences at construction, and writes only images.
    """

    def __init__(
        self,
        source: FrameSource,
        sequences: Mapping[Path, SequenceSettings],
        formats: Iterable[str] = ("tum",),
    ) -> None:
        keep_freed_memory()
        chosen = [sequence_format(name) for name in dict.fromkeys(formats)]
        self.source = source
        self._images = [
            _Images(source, Path(out), settings, chosen) for out, settings in sequences.items()
        ]

    def make(self, number: int) -> list[JournalEntry | None]:
        """Write the missing images of a frame, on any thread. Returns an entry for each sequence,
        None if no image was missing; pass them to
        `SequenceWriter.note` on one thread. Raises InputError for a frame that cannot be read,
        WorkError if an image cannot be written.
        """
        frame = _Frame(self.source, number)
        return [images.make(frame) for images in self._images]


class SequenceWriter:
    """Writes the same frames with one or several settings, folder -> settings (clean and noisy).
    Each frame is read once.

    If there are several formats, each has a separate subfolder. Frames whose images have the hashes
    in the journal are skipped. Raises InputError if a folder contains other files or another
    sequence, WorkError if it cannot be made, or another process is writing it.
    """

    def __init__(
        self,
        source: FrameSource,
        sequences: Mapping[Path, SequenceSettings],
        formats: Iterable[str] = ("tum",),
    ) -> None:
        sequences, formats = (
            {Path(out): settings for out, settings in sequences.items()},
            tuple(dict.fromkeys(formats)),
        )
        if not formats:
            raise InputError("at least one format", found="none")
        chosen = [sequence_format(name) for name in formats]
        self.source = source
        self.targets = [
            _Target(source, out, settings, chosen) for out, settings in sequences.items()
        ]
        self.make = SequenceImages(source, sequences, formats).make
        self.missing = self._missing()

    def _missing(self) -> list[int]:
        return [n for n in self.source.numbers if any(n not in t.finished for t in self.targets)]

    def losses(self) -> list[str]:
        """What is lost when the source is written in these formats, one sentence each."""
        target, units = self.targets[0], self.source.depth_units_per_metre
        each = [
            format.losses(target.contents(self.source.numbers, format), units)
            for format, _ in target.layout
        ]
        return [sentence for sentences in each for sentence in sentences]

    def write(
        self,
        workers: int | None = None,
        on_frame: Callable[[int], None] = lambda number: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> list[WrittenSequence]:
        """Make the missing frames, then lists and recipe of all frames. Returns [] if
        `should_stop()` was true after a frame.

        `on_frame(number)` is called after each frame. The first error stops the work; finished
        frames stay. Raises InputError for a frame that cannot be read, WorkError for one that
        cannot be written, and if another process is writing one of the sequences.
        """

        def noted(entries: list[JournalEntry | None]) -> None:
            on_frame(self.note(entries))
            if should_stop():
                pool.stop()

        with contextlib.ExitStack() as locks:
            for target in self.targets:
                locks.enter_context(locked(target.out))
                target.read_again()
            missing = self._missing()
            with FramePool(self.make, min(workers or cores(), len(missing) or 1), noted) as pool:
                for number in missing:
                    pool.add(number)
            return [] if pool.stopped else self.complete()

    def note(self, entries: list[JournalEntry | None]) -> int:
        """Append the entries of a frame to the journals. Returns the frame's number."""
        new = [
            (target, entry)
            for target, entry in zip(self.targets, entries, strict=True)
            if entry is not None
        ]
        for target, entry in new:
            target.note(entry)
        return new[0][1].frame

    def is_complete(self, number: int) -> bool:
        """Whether the frame's images in every sequence have the hashes in its journal."""
        return all(target.is_complete(number) for target in self.targets)

    def complete(self) -> list[WrittenSequence]:
        """Write lists and recipes, after all frames are made."""
        return [target.completed(self._surface) for target in self.targets]

    def _surface(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour (h, w, 3) uint8 and depth (h, w) in metres of a frame: from the source, without
        noise, or, if a run's frames were deleted, from the
        first sequence, the clean one.
        """
        try:
            light, depth_z_m = self.source.load(number)
            return srgb8(light), depth_z_m
        except InputError:
            target = self.targets[0]
            rgb, depth = (target.places[number][kind][0] for kind in (RGB, DEPTH))
            return read_colour8(rgb.path), read_depth_m(depth.path, depth.units)


def complete_frames(
    source: FrameSource,
    sequences: Mapping[Path, SequenceSettings],
    formats: Iterable[str],
    hashes: bool = True,
) -> set[int]:
    """The frames of the source whose images in every folder have the hashes in the journal, or,
    without `hashes`, exist and are in it. Nothing is
    written.
    """
    chosen, there = [sequence_format(name) for name in formats], []
    for out, settings in sequences.items():
        units = _units(settings, chosen)
        there.append(
            (
                read_entries(out / "frames.jsonl"),
                _places(source, _layout(out, chosen), units),
                units,
            )
        )

    def is_complete(number: int) -> bool:
        if not hashes:
            return all(
                number in entries and all(path.is_file() for path in _paths(places[number]))
                for entries, places, _ in there
            )
        return all(
            _is_complete(source, entries, number, places[number], units)
            for entries, places, units in there
        )

    with ThreadPoolExecutor(4) as pool:
        return {
            n
            for n, good in zip(source.numbers, pool.map(is_complete, source.numbers), strict=True)
            if good
        }


def writer_of(run: RunFolder, numbers: Iterable[int], wanted: dict) -> SequenceWriter:
    """The writer of sequences of a run's frames, which may not be rendered yet. Folders and recipes
    are made now.

    `wanted`, as a worker receives it: {"formats": [format, ...], "variants": {FOLDER: {"depth":
    model, "rgb": model, "seed": n, "depth_units": units per metre, default 5000}}}. Raises
    InputError, WorkError.
    """
    sequences = {}
    for folder, v in wanted["variants"].items():
        models, units = (
            (depth_model(v["depth"]), rgb_model(v["rgb"])),
            v.get("depth_units", UNITS_PER_METRE),
        )
        sequences[Path(folder)] = SequenceSettings(*models, v["seed"], units)
    return SequenceWriter(frames_of_run(run, numbers), sequences, wanted["formats"])


def keep_freed_memory() -> None:
    """Make glibc keep freed memory for the next array. After a large block was freed, glibc does
    not return freed blocks up to that size to the
    system, so they need not be requested again page by page: noise takes two thirds of the time. No
    effect with other C libraries.
    """
    np.empty(30 << 20, np.uint8)


class _Images:
    """One sequence: the paths of its images, the entries of its journal at construction, and how
    images are made.
    """

    def __init__(
        self,
        source: FrameSource,
        out: Path,
        settings: SequenceSettings,
        formats: list[SequenceFormat],
    ) -> None:
        self.source, self.out, self.layout = source, out, _layout(out, formats)
        self.units = _units(settings, formats)
        self.settings = replace(settings, depth_units_per_metre=self.units)
        self.journal = out / "frames.jsonl"
        self.entries = read_entries(self.journal)
        self.places = _places(source, self.layout, self.units)

    def is_complete(self, number: int) -> bool:
        """Whether all images of a frame have the hashes in the journal."""
        return _is_complete(self.source, self.entries, number, self.places[number], self.units)

    def make(self, frame: "_Frame") -> JournalEntry | None:
        if self.is_complete(frame.number):
            return None
        digests, places = self._copied_originals(frame.number)
        invalid: dict[str, int] = {}
        if any(places.values()):
            image, noisy_z_m, invalid = noisy_metres(
                *frame.pixels, self.source.camera, frame.number, self.settings
            )
            images = {RGB: image, DEPTH: noisy_z_m, **frame.truth}
            for kind, files in places.items():
                digests |= _write_images(kind, files, self.units, _encoder(kind, images[kind]))
        main = digests.pop(RGB, ""), digests.pop(DEPTH, "")
        truth = {kind: digests.pop(kind) for kind in ground_truth.KINDS if kind in digests}
        return JournalEntry(
            frame.number, *main, invalid, truth, digests, self.source.digest(frame.number)
        )

    def _copied_originals(self, number: int) -> tuple[dict[str, str], Places]:
        """Copy the originals to the places that store images in the same way.

        Returns SHA-256 by `_stored_as`, and the remaining places.
        """
        places: Places = dict(self.places[number])
        digests: dict[str, str] = {}
        if not self.settings.is_clean or number not in self.source.originals:
            return {}, places
        pair, units = self.source.originals[number], self.source.depth_units_per_metre
        for kind, path in ((RGB, pair.rgb), (DEPTH, pair.depth)):
            how = _stored_as(kind, Place(path, units), units)
            alike = [place for place in places[kind] if _stored_as(kind, place, units) == how]
            if alike and _is_plain(path, kind, self.source.camera):
                digests |= _write_images(kind, alike, self.units, partial(_copy, path))
                places[kind] = [place for place in places[kind] if place not in alike]
        return digests, places


class _Target(_Images):
    """One sequence being written, new or resumed, with its journal."""

    def __init__(
        self,
        source: FrameSource,
        out: Path,
        settings: SequenceSettings,
        formats: list[SequenceFormat],
    ) -> None:
        super().__init__(source, out, settings, formats)
        for format in formats:
            format.checked(self.contents(source.numbers, format))
        self.recipe = self._checked_recipe()
        self.finished = frozenset(n for n in self.places if self.is_complete(n))
        if source.volatile and self.finished:
            self._refuse_changed(formats)
        make_folder(out)
        with locked(out):
            self._begin()

    def _begin(self) -> None:
        """Write the recipe, make the folders of images, and remove what a crash has left."""
        write_json(self.out / "recipe.json", self.recipe)
        data = self.journal.read_bytes() if self.journal.is_file() else b""
        if not data.endswith(b"\n") and data:
            # remove a line truncated by a crash, in place: if the file were rewritten, a kill could
            # lose all entries
            os.truncate(self.journal, data.rfind(b"\n") + 1)
        images = (
            place.path
            for n in self.source.numbers
            for places in self.places[n].values()
            for place in places
        )
        for folder in sorted({self.out, *(path.parent for path in images)}):
            make_folder(folder)
            for leftover in folder.glob(".*.tmp.*"):
                if writer_has_ended(leftover):
                    leftover.unlink(missing_ok=True)

    def read_again(self) -> None:
        """Read the journal again: another process may have made frames since construction."""
        self.entries |= read_entries(self.journal)
        new = self.entries.keys() & self.places.keys() - self.finished
        self.finished |= {n for n in new if self.is_complete(n)}

    def note(self, entry: JournalEntry) -> None:
        """Append one line to the journal. Raises WorkError if it cannot be written."""
        try:
            with open(self.journal, "a", encoding="utf-8") as file:
                file.write(entry.to_line())
        except OSError as error:
            raise WorkError(f"{self.journal}: cannot write: {error.strerror or error}") from None
        self.entries[entry.frame] = entry

    def completed(self, surface: Callable[[int], tuple[np.ndarray, np.ndarray]]) -> WrittenSequence:
        """Write text files and recipe, after all requested frames are made. The journal is
        rewritten with one line per frame, in order: the same
        frames give the same file, however often the work was interrupted.
        """
        numbers = tuple(sorted(self.finished.union(self.source.numbers)))
        for format, folder in self.layout:
            format.write_texts(
                folder, replace(self.contents(numbers, format), surface=surface), format
            )
            if self.source.truth_images:
                self.source.truth_images.write_tables(folder)
        folders = tuple(folder for _, folder in self.layout)
        every = [self.entries[n].invalid_depth for n in numbers]
        counts = {kind: sum(counts.get(kind, 0) for counts in every) for kind in KINDS}
        atomic_write_text(
            self.journal, "".join(self.entries[n].to_line() for n in sorted(self.entries))
        )
        frames = {"count": len(numbers), "first": numbers[0], "last": numbers[-1]}
        counted = {
            **self.recipe,
            "finished": True,
            "frames": frames,
            "invalid_depth_pixels": counts,
        }
        for folder in {self.out, *folders}:
            write_json(folder / "recipe.json", counted)
        found = len(self.finished.intersection(self.source.numbers))
        return WrittenSequence(folders, len(self.source.numbers) - found, found, counts)

    def _checked_recipe(self) -> dict:
        """The recipe of the sequence while it is unfinished, new or resumed. Nothing is written.

        Raises InputError if the path is a file, or the folder contains other files or a sequence of
        another recipe.
        """
        name, module = first_library("PNG", *COMPRESSORS)
        library = str(getattr(module, "ZLIB_RUNTIME_VERSION", None) or module.__version__)
        versions = {
            "iclnuim": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            name: library,
        }
        recipe = {
            "schema_version": _SCHEMA_VERSION,
            "kind": "sequence",
            "source": self.source.origin,
            "camera": self.source.camera.to_dict(),
            **self.settings.to_dict(),
            "formats": [format.name for format, _ in self.layout],
            "versions": versions,
            "source_commit": source_commit(),
            "finished": False,
        }
        out, file = self.out, self.out / "recipe.json"
        if file.is_file():
            old = read_recipe(file)
            _refuse_other_sequence(file, old, recipe)
            if len(self.layout) > 1 and (here := _format_in_folder(old)):
                recipe["format_in_folder"] = here
        elif out.exists() and (
            not out.is_dir() or any(not p.name.startswith(".") for p in out.iterdir())
        ):
            found = "other files" if out.is_dir() else "a file"
            raise InputError(
                "an empty folder or a sequence to resume",
                path=out,
                found=found,
                hint="another folder",
            )
        return recipe

    def _refuse_changed(self, formats: list[SequenceFormat]) -> None:
        """Raises InputError if the source now gives other images of the first or the last finished
        frame.
        """
        for number in sorted({min(self.finished), max(self.finished)}):
            with tempfile.TemporaryDirectory() as folder:
                again = self._made_again(number, Path(folder), formats)
                pairs = zip(_paths(self.places[number]), _paths(again.places[number]), strict=True)
                if not all(_same_image(old, new) for old, new in pairs):
                    expected = "the source that this sequence was started from"
                    raise InputError(
                        expected,
                        path=self.out,
                        found=f"another image of frame {number}",
                        hint="another folder",
                    )

    def _made_again(self, number: int, folder: Path, formats: list[SequenceFormat]) -> _Images:
        """The images of a frame as they would be written now, in `folder`."""
        again = _Images(self.source, folder, self.settings, formats)
        for path in _paths(again.places[number]):
            make_folder(path.parent)
        again.make(_Frame(self.source, number))
        return again

    def contents(self, numbers: tuple[int, ...], format: SequenceFormat) -> Contents:
        """The content of a format's text files for these frames."""
        frames, truth = (
            tuple(_frame(self.source, n) for n in numbers),
            self.source.truth_of(numbers),
        )
        units = format.fixed_units or self.units
        return Contents(self.source.camera, frames, truth, units, self.source.truth_file(numbers))


class _Frame:
    """A frame of a source, read at first use."""

    def __init__(self, source: FrameSource, number: int) -> None:
        self.source, self.number = source, number

    @cached_property
    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Light (h, w, 3) and depth (h, w) in metres."""
        return self.source.load(self.number)

    @cached_property
    def truth(self) -> dict[str, np.ndarray]:
        return self.source.truth_images.images(self.number) if self.source.truth_images else {}


def _layout(out: Path, formats: list[SequenceFormat]) -> list[tuple[SequenceFormat, Path]]:
    """Formats and their folders: a single format is in `out` itself, several formats are in a
    subfolder each.
    """
    return [(format, out if len(formats) == 1 else out / format.name) for format in formats]


def _units(settings: SequenceSettings, formats: list[SequenceFormat]) -> float:
    """Depth units per metre: the requested ones, unless all formats have the same fixed units."""
    fixed = {format.fixed_units for format in formats}
    return (
        fixed.pop() or settings.depth_units_per_metre
        if len(fixed) == 1
        else settings.depth_units_per_metre
    )


def _places(
    source: FrameSource, layout: list[tuple[SequenceFormat, Path]], units: float
) -> dict[int, Places]:
    """The colour, depth and ground-truth files of every frame, one per format."""
    kinds = (RGB, DEPTH, *(ground_truth.KINDS if source.truth_images else ()))
    found = {}
    for frame in (_frame(source, number) for number in source.stamps_s):
        found[frame.number] = {
            k: [
                Place(folder / format.image(frame, k), format.fixed_units or units)
                for format, folder in layout
            ]
            for k in kinds
        }
    return found


def _frame(source: FrameSource, number: int) -> SequenceFrame:
    return source.names.get(number) or SequenceFrame(number, source.stamps_s[number])


def _paths(places: Places) -> list[Path]:
    return [place.path for of_kind in places.values() for place in of_kind]


def _same_image(a: Path, b: Path) -> bool:
    """Whether two image files of the same format are equal; PNGs may be compressed in different
    ways.
    """
    return a.read_bytes() == b.read_bytes() or (a.suffix == ".png" and same_pixels(a, b))


def _stored_as(kind: str, place: Place, units: float) -> str:
    """A key of how an image is stored: its kind, with its ending if it is not PNG, and its scale if
    it is not that of the sequence. Files with the
    same key have the same content.
    """
    scale = (
        f" {place.units:g} a metre"
        if kind == DEPTH and place.units != units and place.path.suffix == ".png"
        else ""
    )
    return kind + ("" if place.path.suffix == ".png" else place.path.suffix) + scale


def _encoder(kind: str, image: np.ndarray) -> Callable[[Place], None]:
    """A function that writes the image to a place, in the format of its ending; depth is given in
    metres.
    """

    def write(place: Place) -> None:
        if place.path.suffix == JPEG:
            write_jpeg(place.path, image)
        elif place.path.suffix == ARRAY:
            write_array(place.path, np.where(np.isfinite(image) & (image > 0), image, 0))
        else:
            write_png(
                place.path, depth16_from_metres(image, place.units) if kind == DEPTH else image
            )

    return write


def _write_images(
    kind: str, places: list[Place], units: float, write: Callable[[Place], None]
) -> dict[str, str]:
    """Write an image to all its places; it is encoded once for each key of `_stored_as`.

    Returns SHA-256 by key.
    """
    found: dict[str, Place] = {}
    for place in places:
        key = _stored_as(kind, place, units)
        if key not in found:
            write(place)
            found[key] = place
            continue
        place.path.unlink(missing_ok=True)
        try:
            os.link(found[key].path, place.path)
        except OSError:  # a file system without links
            write(place)
    return {key: sha256(read_bytes(place.path)) for key, place in found.items()}


def _copy(original: Path, place: Place) -> None:
    data = read_bytes(original, "an image")
    atomic_write(place.path, lambda temporary: temporary.write_bytes(data))


def _is_plain(path: Path, kind: str, camera: PinholeCamera) -> bool:
    """Whether a file can be copied: valid, of the camera's size, and 8-bit RGB, 16-bit grey, or
    metres. Raises InputError if it is damaged.
    """
    header = image_header(path, whole=True)
    right = {"RGB": 8} if kind == RGB else {"grey": 16, "grey, metres": 32}
    return (header.width, header.height) == (camera.width, camera.height) and right.get(
        header.colour
    ) == header.bits


def _is_complete(
    source: FrameSource,
    entries: Mapping[int, JournalEntry],
    number: int,
    files: Places,
    units: float,
) -> bool:
    """Whether all images of a frame have the hashes in the journal, and were made from the same
    files of the source.
    """
    entry = entries.get(number)
    if entry is None or (entry.source_sha256 and entry.source_sha256 != source.digest(number)):
        return False
    try:
        return all(
            sha256(place.path.read_bytes()) == entry.digests.get(_stored_as(kind, place, units))
            for kind, places in files.items()
            for place in places
        )
    except OSError:
        return False


def read_recipe(path: Path) -> dict:
    """Read a sequence's recipe.

    Raises InputError for another kind, a newer schema or unknown keys.
    """
    recipe = read_json(path)
    version = recipe.get("schema_version")
    if recipe.get("kind") != "sequence" or not isinstance(version, int):
        raise InputError(
            "the recipe of a sequence", path=path, found=recipe.get("kind", "another file")
        )
    if version > _SCHEMA_VERSION:
        raise InputError(f"a recipe of schema {_SCHEMA_VERSION} or older", path=path, found=version)
    if "dialects" in recipe:  # as 0.1.0 named them
        recipe["formats"] = recipe.pop("dialects")
    unknown = sorted(set(recipe) - set(_KEYS))
    if unknown:
        raise InputError("the keys of a sequence's recipe", path=path, found=", ".join(unknown))
    return recipe


def _refuse_other_sequence(file: Path, old: dict, new: dict) -> None:
    """Raises InputError if the recipes differ.

    If the noise model differs, only its name is reported, not all of its settings.
    """
    there, requested = _identity(old), _identity(new)
    here, wanted_here = _format_in_folder(old), _format_in_folder(new)
    if here and wanted_here:  # their files may have the same names
        there["format"], requested["format"] = here, wanted_here
    models = [
        key
        for key in requested
        if key.endswith("_noise model") and there.get(key) != requested[key]
    ]
    settings = tuple(key.removesuffix("model") for key in models)
    reported = [key for key in requested if key in models or not key.startswith(settings)]
    old, new = ({key: values.get(key) for key in reported} for values in (there, requested))
    refuse_other("sequence", file, old, new, "another folder")


def _format_in_folder(recipe: dict) -> str:
    """The format whose files are in the sequence's folder itself; "" if each format has a
    subfolder.
    """
    formats = recipe.get("formats", ())
    return formats[0] if len(formats) == 1 else recipe.get("format_in_folder", "")


def _identity(recipe: dict) -> dict:
    """The values that determine the pixels, with each noise setting separately.

    A run is represented by its key.
    """
    identity = {"iclnuim": recipe.get("versions", {}).get("iclnuim")}
    for key in _IDENTITY:
        value = recipe.get(key)
        noise = value if key.endswith("_noise") and isinstance(value, dict) else None
        identity |= (
            {key: value}
            if noise is None
            else {f"{key} {name}": each for name, each in noise.items()}
        )
    run = recipe.get("source", {}).get("run")
    if isinstance(run, dict) and isinstance(run.get("job"), dict):
        identity["source"] = run_key(run)
    return identity
