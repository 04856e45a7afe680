"""Rendered views that hardly fit: of other frames, with swapped channels, or with depth in another
unit or along the ray.
"""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..channels import DEPTH, RGB
from ..doubt.fit import is_explained
from ..doubt.frame_order import other_order
from ..formats.images import read_colour8
from ..geometry.camera import PinholeCamera
from ..geometry.scene_axes import UNITS_M, unit_name

#: Views of a lower PSNR are in doubt, or if images or frames are left over; and depth that is off
#: by this share.
_DOUBTFUL_DB = 25.0
_DOUBTFUL_DEPTH = 0.02
#: About so many pixels a row are compared, of so many views.
_ACROSS = 80
_VIEWS = 8


class Viewed(Protocol):
    """What the doubts read again."""

    sequence: Any
    paths: dict[str, list[Path | None]]
    every_image: list[Path]

    def depth(self, row: int) -> tuple[np.ndarray, np.ndarray] | None: ...


def view_doubts(found: Any, viewed: Viewed) -> tuple[str, ...]:
    """Sentences on the colour and on the depth of the views, at most one each."""
    return (*_colour(found, viewed), *_depth(viewed))


def _colour(found: Any, viewed: Viewed) -> tuple[str, ...]:
    left_over = found.missing or len(viewed.every_image) != len(viewed.sequence.pairs)
    if not left_over and found.mean()["psnr_db"] >= _DOUBTFUL_DB:
        return ()

    @cache
    def true(row: int) -> np.ndarray:
        return _thin(read_colour8(viewed.sequence.pairs[row].rgb))

    @cache
    def view(place: int) -> np.ndarray:
        return _thin(read_colour8(viewed.every_image[place]))

    def error(place: int, row: int) -> float:
        if view(place).shape != true(row).shape:
            return 255.0**2
        return float(np.square(view(place) - true(row)).mean())

    rows = {path: row for row, path in enumerate(viewed.paths[RGB]) if path is not None}
    named = [rows.get(path) for path in viewed.every_image]
    if _are_swapped(view, true, named):
        return ("views seem to have red and blue swapped, as OpenCV writes them",)
    order = other_order(error, named, len(viewed.sequence.pairs))
    if order is None:
        return ()
    decibels = [10 * np.log10(255.0**2 / max(one, 1e-9)) for one in (order.found, order.given)]
    return (
        f"views seem to be of other frames, renumbered or shifted: with {order.words} the PSNR of "
        f"small images is {decibels[0]:.3g} dB instead of {decibels[1]:.3g} dB",
    )


def _are_swapped(
    view: Callable[[int], np.ndarray],
    true: Callable[[int], np.ndarray],
    named: Sequence[int | None],
) -> bool:
    """Whether red and blue of some views fit far better in each other's place."""
    pairs = [(place, row) for place, row in enumerate(named) if row is not None]
    errors = [
        [np.sqrt(np.square(colour - true(row)).mean()) for colour in (seen, seen[..., ::-1])]
        for place, row in pairs[:: max(1, len(pairs) // _VIEWS)]
        if (seen := view(place)).shape == true(row).shape
    ]
    return bool(errors) and is_explained(*np.array(errors).T)


def _depth(viewed: Viewed) -> tuple[str, ...]:
    rows = [row for row, path in enumerate(viewed.paths[DEPTH]) if path is not None]
    rows = rows[:: max(1, len(rows) // _VIEWS)]
    camera = viewed.sequence.camera.pinhole
    changes = _depth_changes(camera)
    errors: dict[str, list[float]] = {words: [] for words in changes}
    shares = []
    for row in rows:
        both = viewed.depth(row)
        if both is None or both[0].shape != both[1].shape:
            return ()
        rendered, true = both
        valid = (true > 0) & (rendered > 0) & np.isfinite(rendered)
        if not valid.any():
            continue
        shares.append(float(np.median(np.abs(rendered / np.maximum(true, 1e-9) - 1)[valid])))
        for words, factor in changes.items():
            errors[words].append(float(np.median(np.abs(factor * rendered - true)[valid])))
    if not shares or np.mean(shares) < _DOUBTFUL_DEPTH:
        return ()
    as_read_m = np.array(errors.pop(""))
    best = min(errors, key=lambda words: np.mean(errors[words]))
    found_m = np.array(errors[best])
    if not is_explained(as_read_m, found_m):
        return ()
    return (
        f"rendered depth seems to be {best}: its median error is then "
        f"{1e3 * found_m.mean():.3g} mm instead of {1e3 * as_read_m.mean():.3g} mm",
    )


def _depth_changes(camera: PinholeCamera) -> dict[str, np.ndarray]:
    """What depth may be, in words, and the factors (h, w) or () that make it planar metres."""
    found = {"": np.array(1.0)}
    along = "the distance from the camera, along the ray of a pixel"
    found[along] = 1 / np.linalg.norm(camera.rays(), axis=-1)
    for setting, unit_m in UNITS_M.items():
        if unit_m != 1:
            found[f"in {unit_name(unit_m)} ({setting})"] = np.array(unit_m)
    found["metres read as millimetres"] = np.array(1e3)
    found["of five times the depth units per metre"] = np.array(5.0)
    found["of a fifth of the depth units per metre"] = np.array(0.2)
    return found


def _thin(image: np.ndarray) -> np.ndarray:
    """A small image (h, w, 3) of floats: means of blocks."""
    step = max(1, image.shape[1] // _ACROSS)
    rows, columns = image.shape[0] // step, image.shape[1] // step
    blocks = image[: rows * step, : columns * step].reshape(rows, step, columns, step, -1)
    return blocks.mean(axis=(1, 3))
