"""Writes sequences from frames, with noise: in any order, on any number of cores, resumable, with
their recipes.
"""

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from ..channels import DEPTH, RGB
from ..errors import InputError, StrPath
from ..formats.files import locked
from ..formats.images import read_colour8
from ..sensor.transfer import srgb8
from .frame_pool import FramePool, cores, keep_freed_memory
from .frame_source import FrameSource
from .journal import JournalEntry
from .rendered_frames import frames_of_run
from .run_folder import RunFolder
from .sequence_folder import SequenceFolder, WrittenSequence
from .sequence_formats import sequence_format
from .sequence_images import Frame, SequenceImages
from .sequence_options import SequenceOptions, SequenceSettings
from .stored_images import read_depth_m


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
        frame = Frame(self.source, number)
        return [images.make(frame) for images in self._sequences]


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
            places = self.folders[0].images.places[number]
            depth = places[DEPTH][0]
            return read_colour8(places[RGB][0].path), read_depth_m(depth.path, depth.units)


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
