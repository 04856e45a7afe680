"""The folder of a sequence being written, new or resumed: its recipe, its text files, and what a
crash has left.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..formats.depth_units import KINDS
from ..formats.files import locked, make_folder, write_json, writer_has_ended
from ..formats.image_names import files_in
from ..shown import Shown
from .frame_source import FrameSource
from .image_files import paths_of, same_image
from .journal import JournalEntry
from .layout import Contents, SequenceFormat
from .name_forms import RECIPE
from .recipe import format_in_folder, new_recipe, read_recipe, refuse_other_sequence
from .sequence_images import Frame, SequenceImages
from .sequence_options import SequenceSettings


@dataclass(frozen=True, repr=False)
class WrittenSequence(Shown):
    """Folders (one per format), number of frames made now and of frames found finished, and number
    of pixels without depth by kind.
    """

    folders: tuple[Path, ...]
    made: int
    found: int
    invalid_depth: dict[str, int]

    def summary(self) -> str:
        folders = ", ".join(map(str, self.folders))
        return f"{folders}, {self.made} frames made, {self.found} found"

    def to_dict(self) -> dict[str, Any]:
        """The folders as texts, and the counts."""
        return {**vars(self), "folders": list(map(str, self.folders))}


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
        self.finished = frozenset(filter(self.images.are_complete, self.images.places))
        if source.volatile and self.finished:
            self._refuse_changed()
        make_folder(out)
        with locked(out):
            self._begin()

    def contents(self, numbers: tuple[int, ...], format: SequenceFormat) -> Contents:
        """The content of a format's text files for these frames."""
        source = self.source
        return Contents(
            source.camera,
            tuple(self.images.frame(number) for number in numbers),
            source.truth_of(numbers),
            depth_units_per_metre=format.fixed_units or self.images.units,
            truth_file=source.truth_file(numbers),
            channels=source.channels,
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
        new = journal.entries.keys() & self.images.places.keys() - self.finished
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
            folders.update(path.parent for path in paths_of(self.images.places[number]))
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
        recipe = new_recipe(self.images)
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
                old = paths_of(self.images.places[number])
                new = self._made_again(number, Path(folder))
                if not all(same_image(a, b) for a, b in zip(old, new, strict=True)):
                    expected = "the source that this sequence was started from"
                    found = f"another image of frame {number}"
                    raise InputError(expected, path=self.out, found=found, hint="another folder")

    def _made_again(self, number: int, folder: Path) -> list[Path]:
        """The images of a frame as they would be written now, in `folder`."""
        images = self.images
        again = SequenceImages(self.source, folder, images.settings, images.formats)
        paths = paths_of(again.places[number])
        for path in paths:
            make_folder(path.parent)
        again.make(Frame(self.source, number))
        return paths
