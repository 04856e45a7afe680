"""Frames of a sequence in any TUM-like folder. Right-handed either way: images know no handedness, only poses do."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from iclnuim.dataset.images import ImagePair, SequenceCamera, find_pairs, read_camera
from iclnuim.errors import InputError
from iclnuim.formats.png import read_depth16, read_rgb8

from .protocol import Frame


class Sequence:
    """Image pairs of a folder and their camera; frames are read one at a time."""

    def __init__(self, folder: Path) -> None:
        self.pairs: list[ImagePair] = find_pairs(folder)
        present = next((p.rgb for p in self.pairs if p.rgb.is_file()), None)
        if present is None:
            raise InputError("colour images that exist", path=folder, found=self.pairs[0].rgb)
        self.camera: SequenceCamera = read_camera(folder, present)

    def __len__(self) -> int:
        return len(self.pairs)

    def frames(self, first: int | None = None) -> Iterator[tuple[float, Frame | str]]:
        """Of all pairs or the first ones: (stamp, frame or why it cannot be read)."""
        for pair in self.pairs[:first]:
            try:
                yield pair.stamp_s, self.load(pair)
            except InputError as error:
                yield pair.stamp_s, f"image: {error}"

    def load(self, pair: ImagePair) -> Frame:
        depth = read_depth16(pair.depth).astype(np.float32) / np.float32(self.camera.depth_units_per_metre)
        return Frame.of(read_rgb8(pair.rgb), depth, pair.stamp_s)
