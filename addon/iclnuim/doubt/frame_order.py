"""Images of other frames than those that their names say: renumbered, shifted, every k-th."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .competition import WORTH_SHARE

#: Frames by which images may be shifted, and steps between frames.
_SHIFTS = range(-10, 11)
_STEPS = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30)
#: Images that choose the order, and others that test it; at least this share of them has a frame.
_SAMPLES = 6
_MIN_SHARE = 0.5
#: Fewer images can fit by chance.
_MIN_IMAGES = 4


class FrameOrder(NamedTuple):
    """Image k is of frame first + step * k. given, found: the mean errors of the images that test
    it, of the frames that their names say and of these.
    """

    first: int
    step: int
    given: float
    found: float

    @property
    def words(self) -> str:
        """What order it is."""
        if self.step == 1:
            return f"each image of the frame {self.first:+d} from its place in the list"
        return f"an image for every {self.step} frames, from frame number {self.first + 1} of all"


def other_order(
    error: Callable[[int, int], float], named: Sequence[int | None], frames: int
) -> FrameOrder | None:
    """The order of n images in which they fit the frames far better than as their names say; None
    if there is none.

    error(k, j): of image k as one of frame j, the smaller the better. named (n,): the frame that
    an image's name says, None for none.
    """
    known = [k for k, frame in enumerate(named) if frame is not None]
    if len(named) < _MIN_IMAGES or len(known) < _MIN_IMAGES:
        return None
    picked = np.unique(np.linspace(0, len(known) - 1, 2 * _SAMPLES).round().astype(int))
    samples = [known[i] for i in picked.tolist()]
    chooses, tests = samples[::2], samples[1::2]
    tried = []
    for step in _STEPS:
        for first in _SHIFTS:
            if all(named[k] == first + step * k for k in samples):
                continue
            errors = _errors(error, chooses, first, step, frames)
            if len(errors) >= _MIN_SHARE * len(chooses):
                tried.append((float(np.mean(errors)), step, first))
    if not tried:
        return None
    _, step, first = min(tried)
    inside = [k for k in tests if 0 <= first + step * k < frames]
    if len(inside) < 2:
        return None
    found = float(np.mean(_errors(error, inside, first, step, frames)))
    given = float(np.mean([error(k, frame) for k in inside if (frame := named[k]) is not None]))
    if found > WORTH_SHARE * given:
        return None
    return FrameOrder(first, step, given, found)


def _errors(
    error: Callable[[int, int], float], images: Sequence[int], first: int, step: int, frames: int
) -> list[float]:
    places = [(k, first + step * k) for k in images]
    return [error(k, frame) for k, frame in places if 0 <= frame < frames]
