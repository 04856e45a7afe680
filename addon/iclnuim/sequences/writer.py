"""Writes sequences from frames, with noise: in any order, on any number of cores, resumable, with
their recipes and text files.
"""

import contextlib
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..channels import DEPTH, RGB
from ..errors import InputError, StrPath
from ..formats.depth_units import KINDS
from ..formats.files import locked, make_folder, write_json, writer_has_ended
from ..formats.image_names import files_in
from ..formats.images import read_colour8
from ..formats.png import same_pixels
from ..sensor.imu_noise import ImuNoise
from ..sensor.transfer import srgb8
from ..shown import Shown
from .contents import Contents
from .format import SequenceFormat
from .frame_images import FrameMaker, SequenceImages, SourceFrame
from .frame_pool import FramePool, cores
from .frame_source import FrameSource, frames_of_run
from .imu import SequenceImu
from .journal import JournalEntry
from .recipe import RECIPE, format_in_folder, new_recipe, read_recipe, refuse_other_sequence
from .run_folder import RunFolder
from .sequence_formats import sequence_format
from .sequence_options import SequenceOptions, SequenceSettings
from .stored_sequence import read_depth_m


@dataclass(frozen=True, repr=False)
class WrittenSequence(Shown):
    """Folders (one per format), number of frames made now and of frames found finished, and number
    of pixels without depth by kind.
    """

    folders: tuple[Path, ...]
    made: int
    found: int
    invalid_depth: dict[str, int]

    @property
    def lost_depth(self) -> dict[str, int]:
        """The pixels by kind whose depth was set to 0, in words; a background has none."""
        kinds = self.invalid_depth.items()
        lost = {kind: pixels for kind, pixels in kinds if pixels and kind != "background"}
        return {kind.replace("_", " "): pixels for kind, pixels in lost.items()}

    def summary(self) -> str:
        folders = ", ".join(map(str, self.folders))
        return f"{folders}, {self.made} frames made, {self.found} found"

    def to_dict(self) -> dict[str, Any]:
        """The folders as texts, and the counts."""
        return {**vars(self), "folders": list(map(str, self.folders))}


def write_sequence(
    source: FrameSource,
    out: StrPath,
    settings: SequenceSettings | None = None,
    formats: Iterable[str] = ("tum",),
    workers: int | None = None,
    on_frame: Callable[[int], object] = lambda number: None,
) -> WrittenSequence:
    """Write `source` as a sequence into `out`, or resume the one that was started there; see
    SequenceWriter.
    """
    writer = SequenceWriter(source, {Path(out): settings or SequenceSettings()}, formats)
    return writer.write(workers, on_frame)[0]


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
        names = tuple(dict.fromkeys(formats))
        if not names:
            raise InputError("at least one format", found="none")
        chosen = [sequence_format(name) for name in names]
        self.source = source
        self.folders = []
        for out, settings in sequences.items():
            self.folders.append(SequenceFolder(source, Path(out), settings, chosen))
        self.make = FrameMaker(source, [folder.images for folder in self.folders]).make
        self.missing = self._missing()

    def _missing(self) -> list[int]:
        folders = self.folders
        return [n for n in self.source.numbers if any(n not in f.finished for f in folders)]

    def losses(self) -> list[str]:
        """What is lost when the source is written in these formats, one sentence each."""
        return self.folders[0].losses()

    def write(
        self,
        workers: int | None = None,
        on_frame: Callable[[int], object] = lambda number: None,
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
            for folder in self.folders:
                locks.enter_context(locked(folder.out))
                folder.read_again()
            missing = self._missing()
            workers = min(workers or cores(), len(missing) or 1)
            with FramePool(self.make, workers, noted) as pool:
                for number in missing:
                    pool.add(number)
            return [] if pool.stopped else self.complete()

    def note(self, entries: list[JournalEntry | None]) -> int:
        """Append the entries of a frame to the journals. Returns the frame's number."""
        made = [entry for entry in entries if entry is not None]
        for folder, entry in zip(self.folders, entries, strict=True):
            if entry is not None:
                folder.note(entry)
        return made[0].frame

    def is_complete(self, number: int) -> bool:
        """Whether the frame's images in every sequence have the hashes in its journal."""
        return all(folder.images.are_complete(number) for folder in self.folders)

    def complete(self) -> list[WrittenSequence]:
        """Write lists and recipes, after all frames are made."""
        return [folder.complete(self._surface) for folder in self.folders]

    def _surface(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour (h, w, 3) uint8 and depth (h, w) in metres of a frame: from the source, without
        noise, or, if a run's frames were deleted, from the first sequence, the clean one.
        """
        try:
            light, depth_z_m = self.source.load(number)
            return srgb8(light), depth_z_m
        except InputError:
            files = {file.kind: file for file in reversed(self.folders[0].images.files[number])}
            depth = files[DEPTH]
            return read_colour8(files[RGB].path), read_depth_m(depth.path, depth.units)


#: Colour (h, w, 3) uint8 and depth (h, w) in metres of a frame.
Surface = Callable[[int], tuple[np.ndarray, np.ndarray]]


class SequenceFolder:
    """One sequence being written. `finished`: the frames whose images were complete at
    construction, or made by another process since.

    Raises InputError if the folder contains other files or another sequence, or if a format cannot
    represent the frames; WorkError if it cannot be made, or another process is writing it.
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
        self.images = SequenceImages(source, out, settings, formats)
        for format in self.images.formats:
            format.checked(self.contents(source.numbers, format))
        self.recipe = self._checked_recipe()
        self.finished = frozenset(filter(self.images.are_complete, self.images.files))
        if source.volatile and self.finished:
            self._refuse_changed()
        make_folder(out)
        with locked(out):
            self._begin()

    @cached_property
    def imu(self) -> SequenceImu | None:
        """All readings of the source's IMU, with noise. Raises InputError for noise without any."""
        settings = self.images.settings
        imu = self.source.imu()
        if imu is None:
            if settings.imu != ImuNoise():
                hint = "a run or a sequence that was made with {imu}"
                raise InputError("frames with an IMU for its noise", found="none", hint=hint)
            return None
        return imu.noisy(settings.imu, settings.seed)

    def contents(self, numbers: tuple[int, ...], format: SequenceFormat) -> Contents:
        """The content of a format's text files for these frames."""
        source = self.source
        frames = tuple(self.images.frame(number) for number in numbers)
        stamps_s = np.array([frame.stamp_s for frame in frames])
        return Contents(
            source.camera,
            frames,
            source.truth_of(numbers),
            depth_units_per_metre=format.limits.fixed_units or self.images.units,
            truth_file=source.truth_file(numbers),
            channels=source.channels,
            imu=None if self.imu is None else self.imu.around(stamps_s),
        )

    def losses(self) -> list[str]:
        """What is lost when the source is written in these formats, one sentence each."""
        found = []
        for format in self.images.formats:
            contents = self.contents(self.source.numbers, format)
            found += format.losses(contents, self.source.depth_units_per_metre)
        return found

    def read_again(self) -> None:
        """Read the journal again: another process may have made frames since construction."""
        journal = self.images.journal
        journal.read_again()
        new = journal.entries.keys() & self.images.files.keys() - self.finished
        self.finished |= {number for number in new if self.images.are_complete(number)}

    def note(self, entry: JournalEntry) -> None:
        """Add a frame that was made to the journal. Raises WorkError if it cannot be written."""
        self.images.journal.add(entry)

    def complete(self, surface: Surface) -> WrittenSequence:
        """Write text files and recipe, after all requested frames are made."""
        folders = self._write_texts(surface)
        numbers = self._numbers
        self.images.journal.sort()
        entries = [self.images.journal.entries[number] for number in numbers]
        invalid = {kind: sum(e.invalid_depth.get(kind, 0) for e in entries) for kind in KINDS}
        recipe = {
            **self.recipe,
            "finished": True,
            "frames": {"count": len(numbers), "first": numbers[0], "last": numbers[-1]},
            "invalid_depth_pixels": invalid,
        }
        for folder in {self.out, *folders}:
            write_json(folder / RECIPE, recipe)
        found = len(self.finished.intersection(self.source.numbers))
        return WrittenSequence(folders, len(self.source.numbers) - found, found, invalid)

    @property
    def _numbers(self) -> tuple[int, ...]:
        """The requested frames, and those that were made before."""
        return tuple(sorted(self.finished.union(self.source.numbers)))

    def _write_texts(self, surface: Surface | None = None) -> tuple[Path, ...]:
        """Write lists, camera and ground truth of all frames; returns the folders."""
        folders = tuple(self.images.folder_of(format) for format in self.images.formats)
        further = self.source.further
        for format, folder in zip(self.images.formats, folders, strict=True):
            contents = replace(self.contents(self._numbers, format), surface=surface)
            format.write_texts(folder, contents, format)
            if further and (surface is not None or further.has_objects):
                further.write_tables(folder)
        return folders

    def _begin(self) -> None:
        """Write the recipe, make the folders of images, and remove what a crash has left. The text
        files are written here too: if the work is interrupted, the frames that are there can be
        used.
        """
        write_json(self.out / RECIPE, self.recipe)
        self.images.journal.repair()
        folders = {self.out}
        for number in self.source.numbers:
            folders.update(path.parent for path in self.images.paths(number))
        for folder in sorted(folders):
            make_folder(folder)
            for leftover in folder.glob(".*.tmp.*"):
                if writer_has_ended(leftover):
                    leftover.unlink(missing_ok=True)
        if not self.finished.issuperset(self.source.numbers):
            self._write_texts()

    def _checked_recipe(self) -> dict:
        """The recipe of the sequence while it is unfinished, new or resumed. Nothing is written.

        Raises InputError if the path is a file, or the folder contains other files or a sequence of
        another recipe.
        """
        recipe = new_recipe(self.source, self.images.settings, self.images.formats)
        file = self.out / RECIPE
        if file.is_file():
            begun = read_recipe(file)
            refuse_other_sequence(file, begun, recipe)
            if len(self.images.formats) > 1 and (here := format_in_folder(begun)):
                recipe["format_in_folder"] = here
        elif self.out.exists():
            found = ""
            if not self.out.is_dir():
                found = "a file"
            elif files_in(self.out):
                found = "other files"
            if found:
                expected = "an empty folder or a sequence to resume"
                raise InputError(expected, path=self.out, found=found, hint="another folder")
        return recipe

    def _refuse_changed(self) -> None:
        """Raises InputError if the source now gives other images of the first or the last finished
        frame.
        """
        for number in sorted({min(self.finished), max(self.finished)}):
            with tempfile.TemporaryDirectory() as folder:
                old = self.images.paths(number)
                new = self._made_again(number, Path(folder))
                if not all(same_image(a, b) for a, b in zip(old, new, strict=True)):
                    expected = "the source that this sequence was started from"
                    found = f"another image of frame {number}"
                    raise InputError(expected, path=self.out, found=found, hint="another folder")

    def _made_again(self, number: int, folder: Path) -> list[Path]:
        """The images of a frame as they would be written now, in `folder`."""
        images = self.images
        again = SequenceImages(self.source, folder, images.settings, images.formats)
        paths = again.paths(number)
        for path in paths:
            make_folder(path.parent)
        again.make(SourceFrame(self.source, number))
        return paths


def same_image(a: Path, b: Path) -> bool:
    """Whether two image files of the same format are equal; PNGs may be compressed in different
    ways.
    """
    return a.read_bytes() == b.read_bytes() or (a.suffix == ".png" and same_pixels(a, b))


def complete_frames(
    source: FrameSource,
    sequences: Mapping[Path, SequenceSettings],
    formats: Iterable[str],
    hashes: bool = True,
) -> set[int]:
    """The frames of the source whose images in every folder have the hashes in the journal, or,
    without `hashes`, exist and are in it. Nothing is written.
    """
    every = images_of(source, sequences, formats)

    def is_complete(number: int) -> bool:
        if hashes:
            return all(images.are_complete(number) for images in every)
        return all(images.exist(number) for images in every)

    with ThreadPoolExecutor(4) as pool:
        complete = pool.map(is_complete, source.numbers)
        return {n for n, good in zip(source.numbers, complete, strict=True) if good}


def writer_of(run: RunFolder, numbers: Iterable[int], wanted: dict) -> SequenceWriter:
    """The writer of sequences of a run's frames, which may not be rendered yet. Folders and recipes
    are made now.

    `wanted`, as a worker receives it: {"formats": [format, ...], "variants": {FOLDER: settings of
    SequenceOptions}}. Raises InputError, WorkError.
    """
    sequences = {}
    for folder, options in wanted["variants"].items():
        sequences[Path(folder)] = SequenceOptions.from_dict(options).sequence_settings()
    return SequenceWriter(frames_of_run(run, numbers), sequences, wanted["formats"])


def images_of(
    source: FrameSource, sequences: Mapping[Path, SequenceSettings], formats: Iterable[str]
) -> list[SequenceImages]:
    """The images of sequences, folder -> settings, as their journals describe them now."""
    chosen = [sequence_format(name) for name in dict.fromkeys(formats)]
    return [SequenceImages(source, Path(out), s, chosen) for out, s in sequences.items()]
