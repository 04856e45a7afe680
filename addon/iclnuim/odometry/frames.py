"""Frames of a sequence in any TUM-like folder. Right-handed either way: images know no handedness, only poses do."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..dataset.images import ImagePair, SequenceCamera, find_pairs, read_camera
from ..errors import InputError
from ..formats.png import read_depth16, read_rgb8
from .protocol import Frame

#: Per metre; with more, what is farthest in 16 bits of millimetres (65.5 m) would lie behind the camera.
MOST_OFFSET = 0.015


class Sequence:
    """Image pairs of a folder and their camera; frames are read one at a time.

    depth_offset (1/m): what the sensor adds to inverse depth, taken off again. Of a structured-light camera, which
    measures disparity, it is a disparity that is off by a constant. camera: default: what is found in the folder.
    """

    def __init__(self, folder: Path, depth_offset: float = 0.0, camera: SequenceCamera | None = None) -> None:
        if not abs(depth_offset) <= MOST_OFFSET:
            raise InputError(f"a depth offset from {-MOST_OFFSET} to {MOST_OFFSET} per metre", found=depth_offset)
        self.folder, self.depth_offset = Path(folder), depth_offset
        self.pairs: list[ImagePair] = find_pairs(folder)
        present = next((p.rgb for p in self.pairs if p.rgb.is_file()), None)
        if present is None:
            raise InputError("colour images that exist", path=folder, found=self.pairs[0].rgb)
        self.camera: SequenceCamera = camera or read_camera(folder, present)

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
        if self.depth_offset:
            depth /= 1 - self.depth_offset * depth
        return Frame.of(read_rgb8(pair.rgb), depth, pair.stamp_s)
