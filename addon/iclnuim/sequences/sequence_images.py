"""The images of one sequence: where they are, which are finished, and how a frame's are made."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ..channels import DEPTH, RGB
from ..formats.files import sha256
from .frame_source import FrameSource
from .image_files import (
    Place,
    Places,
    can_be_copied,
    copier,
    encoder,
    paths_of,
    stored_as,
    write_images,
)
from .journal import Journal, JournalEntry
from .layout import SequenceFormat, SequenceFrame
from .name_forms import form_of_folder, named
from .sequence_options import SequenceSettings, noisy_metres


class Frame:
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
    """The images of a sequence in a folder, made from `source` with `settings`. A single format is
    in the folder itself, several formats are in a subfolder each.
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
        form = form_of_folder(out, settings.names)
        self.formats = named(formats, form)
        self.units = _units(settings, self.formats)
        self.settings = replace(settings, depth_units_per_metre=self.units, names=form)
        self.journal = Journal(out)
        self.places = {number: self._places_of(number) for number in source.stamps_s}

    def folder_of(self, format: SequenceFormat) -> Path:
        """The folder of a format's files."""
        return self.out if len(self.formats) == 1 else self.out / format.name

    def frame(self, number: int) -> SequenceFrame:
        """The number and stamp of a frame, and its names in a user-provided sequence."""
        kept = self.source.names.get(number)
        return kept or SequenceFrame(number, self.source.stamps_s[number])

    def _places_of(self, number: int) -> Places:
        frame = self.frame(number)
        found: Places = {channel.name: [] for channel in self.source.channels}
        for format in self.formats:
            units = format.fixed_units or self.units
            for kind, places in found.items():
                places.append(Place(self.folder_of(format) / format.image(frame, kind), units))
        return found

    def exist(self, number: int) -> bool:
        """Whether all images of a frame exist and are in the journal."""
        if number not in self.journal.entries:
            return False
        return all(path.is_file() for path in paths_of(self.places[number]))

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
            for kind, places in self.places[number].items():
                for place in places:
                    made = digests.get(stored_as(kind, place, self.units))
                    if sha256(place.path.read_bytes()) != made:
                        return False
        except OSError:
            return False
        return True

    def make(self, frame: Frame) -> JournalEntry | None:
        """Write the images of a frame. Returns its entry for the journal; None if they are
        complete.
        """
        number = frame.number
        if self.are_complete(number):
            return None
        digests, places = self._copied_originals(number)
        invalid: dict[str, int] = {}
        if any(places.values()):
            light, depth_z_m = frame.pixels
            image, noisy_z_m, invalid = noisy_metres(
                light, depth_z_m, self.source.camera, number, self.settings
            )
            images = {RGB: image, DEPTH: noisy_z_m, **frame.further}
            for kind, files in places.items():
                digests |= write_images(kind, files, self.units, encoder(kind, images[kind]))
        rgb = digests.pop(RGB, "")
        depth = digests.pop(DEPTH, "")
        further = {kind: digests.pop(kind) for kind in places if kind in digests}
        source = self.source.digest(number)
        return JournalEntry(
            number, rgb, depth, invalid, further, other_sha256=digests, source_sha256=source
        )

    def _copied_originals(self, number: int) -> tuple[dict[str, str], Places]:
        """Copy the originals to the places that store images in the same way.

        Returns SHA-256 by `stored_as`, and the remaining places.
        """
        places: Places = dict(self.places[number])
        digests: dict[str, str] = {}
        pair = self.source.originals.get(number)
        if pair is None or not self.settings.is_clean:
            return digests, places
        units = self.source.depth_units_per_metre
        for kind, path in ((RGB, pair.rgb), (DEPTH, pair.depth)):
            how = stored_as(kind, Place(path, units), units)
            alike = [place for place in places[kind] if stored_as(kind, place, units) == how]
            if alike and can_be_copied(path, kind, self.source.camera):
                digests |= write_images(kind, alike, self.units, copier(path))
                places[kind] = [place for place in places[kind] if place not in alike]
        return digests, places


def _units(settings: SequenceSettings, formats: Sequence[SequenceFormat]) -> float:
    """Depth units per metre: the requested ones, unless all formats have the same fixed units."""
    fixed = {format.fixed_units for format in formats}
    if len(fixed) > 1:
        return settings.depth_units_per_metre
    return fixed.pop() or settings.depth_units_per_metre
