"""Images of other frames than those that their names say: renumbered, shifted, every k-th, reversed."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from .fit import is_explained

#: Frames by which images may be shifted, and steps between frames.
_SHIFTS = range(-10, 11)
_STEPS = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30)
#: Images that choose the order, and others that test it; at least this share of them has a frame.
_SAMPLES = 8
_MIN_SHARE = 0.5
#: Fewer images can fit by chance.
_MIN_IMAGES = 4


class FrameOrder(NamedTuple):
    """Image k is of frame first + step * k, by `shift` frames after the one that its name says if
    that is the same for all. given, found: the mean errors of the images that test it, of the
    frames that their names say and of these.
    """

    first: int
    step: int
    shift: int | None
    given: float = float("nan")
    found: float = float("nan")

    def frame(self, k: int) -> int:
        """The frame of image k."""
        return self.first + self.step * k

    @property
    def words(self) -> str:
        """What order it is."""
        if self.shift is not None:
            count = f"{abs(self.shift)} frame{'s' * (abs(self.shift) > 1)}"
            return f"images of {count} {'after' if self.shift > 0 else 'before'} their numbers"
        if self.step == -1:
            return (
                f"images in the reversed order, the first of frame number {self.first + 1} of all"
            )
        if self.step == 1:
            return f"images of all frames from number {self.first + 1} on"
        return f"an image for every {self.step} frames, from frame number {self.first + 1} of all"


def other_order(
    error: Callable[[int, int], float], named: Sequence[int | None], frames: int
) -> FrameOrder | None:
    """The order of n images in which they fit the frames far better than as their names say; None
    if there is none.

    error(k, j): of image k as one of frame j, the smaller the better. named (n,): the frame that
    an image's name says, None for none.
    """
    known = {k: frame for k, frame in enumerate(named) if frame is not None}
    if len(known) < _MIN_IMAGES:
        return None
    picked = np.unique(np.linspace(0, len(known) - 1, 2 * _SAMPLES).round().astype(int))
    samples = [list(known)[i] for i in picked.tolist()]
    chooses, tests = samples[::2], samples[1::2]
    tried = []
    for order in _orders(known, frames):
        errors = [error(k, order.frame(k)) for k in chooses if 0 <= order.frame(k) < frames]
        if len(errors) >= _MIN_SHARE * len(chooses):
            tried.append((float(np.mean(errors)), order))
    if not tried:
        return None
    order = min(tried, key=lambda one: one[0])[1]
    inside = [k for k in tests if 0 <= order.frame(k) < frames]
    found = np.array([error(k, order.frame(k)) for k in inside])
    given = np.array([error(k, known[k]) for k in inside])
    if len(inside) < max(2, _MIN_SHARE * len(tests)) or not is_explained(given, found):
        return None
    return order._replace(given=float(given.mean()), found=float(found.mean()))


def _orders(known: dict[int, int], frames: int) -> Iterator[FrameOrder]:
    """Other orders than that of the names: shifts from them, every k-th frame from one on, and all
    frames from the last one, or from that of the last image, back.
    """
    for first in sorted({frames - 1, max(known.values())}):
        yield FrameOrder(first, -1, None)
    places = {frame - k for k, frame in known.items()}
    if len(places) == 1:
        place = next(iter(places))
        for shift in filter(None, _SHIFTS):
            yield FrameOrder(place + shift, 1, shift)
    for step in _STEPS:
        for first in _SHIFTS:
            if any(frame != first + step * k for k, frame in known.items()):
                yield FrameOrder(first, step, None)
