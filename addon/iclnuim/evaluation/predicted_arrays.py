"""What depth networks return, as arrays: an array or tensor of depth, or a mapping or an object with
`depth`, `points` and their mask.

Shapes by the code of MoGe 2 (points (h, w, 3), depth (h, w), mask (h, w) bool, infinite outside the
mask), Depth Anything 3 (depth (n, h, w), sky (n, h, w) bool), VGGT (depth (1, n, h, w, 1) or (n, h,
w, 1), world_points (1, n, h, w, 3) or (n, h, w, 3)): none of these networks was run here.
"""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from ..errors import InputError

#: An array, a tensor, a mapping of names to arrays, or an object with such attributes.
PredictedDepth: TypeAlias = Any
#: Names of depth images and of point maps, the first that is there.
DEPTHS = ("depth", "depth_map", "depth_z_m", "predicted_depth")
POINTS = ("world_points", "points", "pts3d")
_METRES = "dividing by the units per metre (TUM: 5000)"


def predicted_depth(predicted: PredictedDepth) -> tuple[np.ndarray, np.ndarray | None]:
    """Depth (h, w) or (n, h, w) and the mask of its pixels, None without one.

    Raises InputError for anything else.
    """
    named = _named(predicted)
    if named is None:
        return _without_ones(floating(predicted, _EXPECTED)), None
    name = next((name for name in DEPTHS if named.get(name) is not None), None)
    if name is None:
        found = ", ".join(map(str, named)) or "nothing"
        raise InputError(f"a prediction with one of {', '.join(DEPTHS)}", found=found)
    depth = _without_ones(floating(named[name], f"{_EXPECTED} as {name}"))
    return depth, _mask(named, depth)


_EXPECTED = "predicted depth (h, w) or (n, h, w)"


def predicted_points(predicted: PredictedDepth) -> tuple[np.ndarray, np.ndarray | None]:
    """Point maps (n, h, w, 3) and the mask (n, h, w) of their pixels, None without one.

    Raises InputError for anything else.
    """
    expected = "point maps (h, w, 3) or (n, h, w, 3)"
    named = _named(predicted)
    given = predicted
    if named is not None:
        name = next((name for name in POINTS if named.get(name) is not None), None)
        if name is None:
            found = ", ".join(map(str, named)) or "nothing"
            raise InputError(f"a prediction with one of {', '.join(POINTS)}", found=found)
        given = named[name]
    points = floating(given, expected)
    while points.ndim > 4 and points.shape[0] == 1:
        points = points[0]
    if points.ndim == 3:
        points = points[None]
    if points.ndim != 4 or points.shape[-1] != 3:
        raise InputError(expected, found=points.shape)
    mask = None if named is None else _mask(named, points[..., 0])
    return points, mask


def floating(values: Any, expected: str) -> np.ndarray:
    """An array of floating-point numbers, also of a tensor on any device.

    Raises InputError for whole numbers, which are those of an image file in another unit, and for
    arrays without an element.
    """
    array = array_of(values)
    if not array.size or array.ndim < 2:
        raise InputError(expected, found=f"an array {array.shape}")
    if array.dtype.kind != "f":
        expected = f"{expected}, as floating-point numbers"
        raise InputError(expected, found=array.dtype, hint=_METRES)
    return array


def array_of(values: Any) -> np.ndarray:
    """The array of an array, list or tensor; 16-bit brain floats, which numpy lacks, as float32."""
    if hasattr(values, "detach"):
        values = values.detach().cpu()
        if "bfloat16" in str(values.dtype):
            values = values.float()
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as error:
        raise InputError("an array", found=error) from None


def _named(predicted: PredictedDepth) -> Mapping[str, Any] | None:
    """A prediction's parts by name; None for an array or a tensor."""
    if isinstance(predicted, Mapping):
        return predicted
    if isinstance(predicted, np.ndarray | list | tuple) or hasattr(predicted, "__array__"):
        return None
    found = {}
    for name in (*DEPTHS, *POINTS, *_MASKS):
        if hasattr(predicted, name):
            found[name] = getattr(predicted, name)
    return found


#: Masks by name: whether they hold the pixels that count.
_MASKS = {"mask": True, "sky": False}


def _mask(named: Mapping[str, Any], like: np.ndarray) -> np.ndarray | None:
    found = None
    for name, counts in _MASKS.items():
        if named.get(name) is None:
            continue
        mask = _without_ones(array_of(named[name]))
        if mask.dtype.kind not in "bui":
            raise InputError(f"{name} of true and false", found=mask.dtype)
        if mask.shape != like.shape and like.shape != (1, *mask.shape):
            raise InputError(f"{name} of shape {like.shape}", found=mask.shape)
        mask = mask.reshape(like.shape).astype(bool) == counts
        found = mask if found is None else found & mask
    return found


def _without_ones(array: np.ndarray) -> np.ndarray:
    """(h, w) or (n, h, w): without a last axis of 1 channel, and without leading axes of 1.

    Raises InputError for more axes.
    """
    shape = array.shape
    if array.ndim > 2 and shape[-1] == 1:
        array = array[..., 0]
    while array.ndim > 3 and 1 in array.shape[:-2]:
        array = array.squeeze(array.shape.index(1))
    if array.ndim not in (2, 3):
        raise InputError(_EXPECTED, found=shape)
    return array
