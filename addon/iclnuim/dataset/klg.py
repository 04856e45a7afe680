"""Logs for ElasticFusion and Kintinuous (.klg): one binary file of all frames.

Little-endian: int32 frames; for each int64 stamp in microseconds, int32 bytes of depth, int32 bytes of colour, depth
(16 bit, millimetres, zlib), colour (RGB, three bytes a pixel, not compressed: their readers tell by its size). The camera
stands in a file of its own, .cal, one line `fx fy cx cy`: ElasticFusion -l X.klg -cal X.cal.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..formats.files import atomic_write, atomic_write_text
from ..formats.png import read_depth16, read_rgb8
from .images import find_pairs, read_camera


def write_klg(folder: Path, file: Path, on_frame: Callable[[int], None] = lambda number: None) -> int:
    """The pairs of a sequence in any PNG form as one log, its camera beside it; their number. Raises as the readers do."""
    pairs = find_pairs(Path(folder))
    camera = read_camera(Path(folder), pairs[0].rgb)
    per_metre, c = camera.depth_units_per_metre, camera.pinhole

    def write(temporary: Path) -> None:
        with open(temporary, "wb") as log:
            log.write(struct.pack("<i", len(pairs)))
            for pair in pairs:
                depth = zlib.compress(_millimetres(read_depth16(pair.depth), per_metre).tobytes(), 1)
                colour = read_rgb8(pair.rgb).tobytes()
                log.write(struct.pack("<qii", round(pair.stamp_s * 1e6), len(depth), len(colour)))
                log.write(depth)
                log.write(colour)
                on_frame(pair.number)

    atomic_write(file, write)
    atomic_write_text(file.with_suffix(".cal"), f"{c.fx:.9g} {c.fy:.9g} {c.cx:.9g} {c.cy:.9g}\n")
    return len(pairs)


def _millimetres(units: np.ndarray, per_metre: float) -> np.ndarray:
    return np.rint(units * (1000 / per_metre)).clip(0, 65535).astype("<u2")
