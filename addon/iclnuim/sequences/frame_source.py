"""The frames that a sequence is made from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..channels import BASE, Channel
from ..geometry.camera import PinholeCamera
from ..geometry.trajectory import Trajectory
from .ground_truth import FurtherImages
from .image_pairs import ImagePair
from .layout import SequenceFrame, posed

#: Format and bytes of a ground-truth file.
TruthFile = tuple[str, bytes]


@dataclass(frozen=True, eq=False, repr=False)
class FrameSource:
    """Frames from which a sequence is made. `numbers` (n,), ascending, are their numbers, which
    also seed their noise.

    `load(number)` returns scene-linear RGB (h, w, 3) and planar depth in metres (h, w), as stored
    on disk. `stamps_s` has the stamps of all frames of the source, also of those not in `numbers`.
    `truth_of(numbers)` returns the ground truth of these frames, or None. `origin` is written into
    the recipe. `further`: the run's images besides colour and depth, if it has any. `names` and
    `truth_file(numbers)`: names of the images, and format and bytes of a ground-truth file, which a
    sequence in the same format keeps. `originals`: files that a sequence without noise copies byte
    for byte, if it stores images in the same way. `digest(number)`: SHA-256 of a frame's files,
    whose images are made again if it changes; "" if `origin` tells. `volatile`: `load` is a
    function of the user, which may have changed since a sequence was started.
    """

    camera: PinholeCamera
    numbers: tuple[int, ...]
    stamps_s: Mapping[int, float]
    load: Callable[[int], tuple[np.ndarray, np.ndarray]]
    truth_of: Callable[[tuple[int, ...]], Trajectory | None]
    origin: dict
    further: FurtherImages | None = None
    names: Mapping[int, SequenceFrame] = field(default_factory=dict)
    truth_file: Callable[[tuple[int, ...]], TruthFile | None] = lambda numbers: None
    originals: "Mapping[int, ImagePair]" = field(default_factory=dict)
    depth_units_per_metre: float = 0.0
    digest: Callable[[int], str] = lambda number: ""
    volatile: bool = False

    def __repr__(self) -> str:
        size = f"{self.camera.width}x{self.camera.height}"
        return f"FrameSource({len(self.numbers)} frames of {size})"

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels of a frame."""
        return (*BASE, *(self.further.channels if self.further else ()))


def frames_with_poses(source: FrameSource) -> FrameSource:
    """The source without frames that have no pose, for formats in which each frame needs one."""
    numbers = np.array(source.numbers)
    stamps_s = np.array([source.stamps_s[number] for number in source.numbers])
    kept = numbers[posed(stamps_s, source.truth_of(source.numbers))]
    return replace(source, numbers=tuple(kept.tolist()))
