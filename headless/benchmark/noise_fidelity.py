"""How near a noise model comes to noisy frames that were published: the overlap of what their noise does to pixels.

A pixel of a noisy image falls into a cell: how deep or bright it truly is, and how far it is off, or that it is missing.
The overlap is the share of pixels that two noises put into the same cells: 1 where they do the same, 0 where they have
nothing in common. It sees amount, bias and gaps of the noise by depth and brightness, not how it hangs together from
pixel to pixel.
"""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from iclnuim.dataset.frames import image_frames
from iclnuim.errors import InputError
from iclnuim.sensor.models import DEPTH_MODELS, RGB_MODELS, depth_model, rgb_model
from iclnuim.sensor.randomness import DEPTH, RGB, frame_generator
from iclnuim.sensor.transfer import srgb8

#: Borders of the groups of true depth (m) and of true 8-bit value.
_DEPTHS_M, _VALUES = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0]), np.array([40, 80, 120, 160, 200])
#: Disparity in steps of the paper's equation 3 is this over metres.
_STEPS_M = 351.3
#: Errors are told apart to half a disparity step up to 6 steps, and to one value up to 12 of 255.
_BINS = 24
_MISSING = _BINS + 1

Cells = Callable[[np.ndarray, np.ndarray], np.ndarray]


def overlaps(clean: Path, noisy: Path) -> dict[str, dict[str, float]]:
    """{"depth": {model: overlap}, "rgb": ...} of each model run on `clean`, with `noisy`, which shows the same frames.

    Raises InputError where they have no frame number in common.
    """
    sources = image_frames(clean), image_frames(noisy)
    numbers = sorted(set(sources[0].numbers).intersection(sources[1].numbers))
    if not numbers:
        raise InputError(f"frames of {noisy}", path=clean, found="none of their numbers")
    camera = sources[0].camera
    (lights, depths), (noisy_lights, noisy_depths) = (
        zip(*(source.load(n) for n in numbers), strict=True) for source in sources
    )

    def depth(name: str) -> float:
        model = depth_model(name)
        made = (model.apply(z, camera, frame_generator(1, n, DEPTH)) for n, z in zip(numbers, depths, strict=True))
        return _overlap(depth_cells, depths, noisy_depths, made)

    def rgb(name: str) -> float:
        model = rgb_model(name)
        made = (model.apply(x, frame_generator(1, n, RGB)) for n, x in zip(numbers, lights, strict=True))
        return _overlap(value_cells, [srgb8(x) for x in lights], [srgb8(x) for x in noisy_lights], made)

    return {"depth": {name: depth(name) for name in DEPTH_MODELS}, "rgb": {name: rgb(name) for name in RGB_MODELS}}


def _overlap(
    cells: Cells, clean: Iterable[np.ndarray], theirs: Iterable[np.ndarray], ours: Iterable[np.ndarray]
) -> float:
    """Of the histograms over all frames."""
    first, second = (
        np.bincount(np.concatenate([cells(a, b) for a, b in zip(clean, noisy, strict=True)]), minlength=4096)
        for noisy in (theirs, ours)
    )
    return float(np.minimum(first, second).sum() / first.sum())


def depth_cells(clean_z_m: np.ndarray, noisy_z_m: np.ndarray) -> np.ndarray:
    """(h, w) planar metres -> (n,) cells of the n pixels that truly have depth."""
    seen = clean_z_m > 0
    clean, noisy = clean_z_m[seen].astype(float), noisy_z_m[seen].astype(float)
    steps = _STEPS_M / np.maximum(noisy, 0.01) - _STEPS_M / clean
    error = np.where(noisy < 0.6 * clean, _MISSING, _binned(steps / 0.5))
    return np.digitize(clean, _DEPTHS_M) * 64 + error.astype(int)


def value_cells(clean: np.ndarray, noisy: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 -> (n,) cells, each channel of its own."""
    error = _binned(noisy.astype(int) - clean)
    return (np.arange(3) * 512 + np.digitize(clean, _VALUES) * 64 + error).astype(int).ravel()


def _binned(error: np.ndarray) -> np.ndarray:
    """-12..12 and beyond -> 0..24."""
    return np.clip(np.rint(error), -_BINS // 2, _BINS // 2) + _BINS // 2
