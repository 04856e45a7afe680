"""What measuring a cell of the paper's experiments needs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from iclnuim.benchmark.fusion.settings import PRESETS, FuseSettings

from .keys import PaperKey

#: Minimum weight of a voxel for the mesh of a noisy sequence: its surface must be seen by this many
#: frames.
_MIN_NOISY_WEIGHT = 3.0
#: Limits of the heat maps' scale in mm. It is logarithmic and the same for all cells.
HEAT_MM = (0.1, 100.0)


@dataclass(frozen=True)
class PaperTask:
    """folder: the sequence. first: use only the first N frames. model: file with the room's
    triangles; None: no surface is measured. trajectory: file written by an external system; None:
    the cell's odometer estimates it. work: folder for data shared by cells, which can be
    recomputed.
    """

    key: PaperKey
    folder: Path
    first: int | None
    model: Path | None
    trajectory: Path | None
    work: Path


class Meter:
    """The library's progress display, which it calls as `progress(total, label)`."""

    def __init__(self, advance: Callable[[int], object]) -> None:
        self._advance = advance

    def __call__(self, total: int = 0, label: str = "") -> "Meter":
        return self

    def advance(self, count: int = 1) -> None:
        self._advance(count)


def fuse_settings(key: PaperKey, first: int | None) -> FuseSettings:
    """The fusion settings: the volume by the cell's preset, `min_weight` by its noise."""
    volume = PRESETS.get(key.preset, PRESETS["best"])
    min_weight = _MIN_NOISY_WEIGHT if key.noise == "noisy" else FuseSettings().min_weight
    return FuseSettings(volume, min_weight, f":{first or ''}")
