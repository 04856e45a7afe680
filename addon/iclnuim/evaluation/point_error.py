"""Errors of predicted point maps: the distance of each pixel's point from the true one, after one
similarity (or one scale) for all images.

The similarity is Umeyama's (evaluation/align.py) on pixels at equal distances, at most a million.
delta1 is that of MoGe (Wang and others, CVPR 2025): the share of points whose error is below a
quarter of the distance of the nearer of both points from the camera.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.se3 import SE3
from ..shown import MM, Shown
from .align import umeyama
from .predicted_arrays import PredictedDepth, floating, predicted_points

POINT_ALIGNMENTS = {
    "none": "both are in the same frame, in metres",
    "scale": "a scale about the origin",
    "similarity": "rotation, translation and scale",
}
_SAMPLED = 1 << 20
_DELTA = 0.25


@dataclass(frozen=True, eq=False)
class PointImage:
    """One image: true_m and predicted points (h, w, 3), NaN = missing, in one frame for all images;
    centre_m (3,): of the camera in the truth's frame.
    """

    name: str
    true_m: np.ndarray
    predicted: np.ndarray
    centre_m: np.ndarray


@dataclass(frozen=True)
class PointFigures:
    """Figures of distances e between predicted and true points in metres: mean_m, median_m, rmse_m;
    abs_rel: mean of e over the distance of the true point from the camera; delta1: share of points
    with e below a quarter of the smaller distance of both points from the camera.
    """

    mean_m: float
    median_m: float
    rmse_m: float
    abs_rel: float
    delta1: float

    def to_dict(self) -> dict[str, float]:
        """The figures by name."""
        return dict(vars(self))


@dataclass(frozen=True)
class PointError:
    """The errors of one image; missing: share of its true points without a prediction."""

    name: str
    figures: PointFigures
    points: int
    missing: float


@dataclass(frozen=True, eq=False, repr=False)
class PointErrors(Shown):
    """Errors of all images: p_true = scale * R p_predicted + t, with (R, t) =
    T_true_predicted, and the mean of each figure over images, whose names are attributes, too.
    """

    frames: tuple[PointError, ...]
    align: str
    T_true_predicted: SE3
    scale: float
    empty: tuple[str, ...] = ()

    @property
    def figures(self) -> PointFigures:
        """The mean of each figure over the images."""
        names = [field.name for field in fields(PointFigures)]
        each = [frame.figures for frame in self.frames]
        return PointFigures(*(float(np.mean([getattr(f, n) for f in each])) for n in names))

    def __getattr__(self, name: str) -> Any:
        if name in {field.name for field in fields(PointFigures)}:
            return getattr(self.figures, name)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def summary(self) -> str:
        figures = self.figures
        words = [f"mean {MM * figures.mean_m:.4g} mm", f"AbsRel {figures.abs_rel:.4g}"]
        return ", ".join([*words, f"scale {self.scale:.4g}", f"{len(self.frames)} frames"])

    def to_dict(self) -> dict[str, Any]:
        """Alignment, counts and figures."""
        return {
            "align": self.align,
            "scale": self.scale,
            "T_true_predicted": self.T_true_predicted.matrix.tolist(),
            "frames": len(self.frames),
            "points": sum(frame.points for frame in self.frames),
            "missing": float(np.mean([frame.missing for frame in self.frames])),
            **self.figures.to_dict(),
            "empty": list(self.empty),
        }

    def rows(self) -> list[list[object]]:
        """A table: a line of names, and a line per image."""
        names = [field.name for field in fields(PointFigures)]
        found: list[list[object]] = [["frame", "points", "missing", *names]]
        for frame in self.frames:
            line = [frame.name, frame.points, frame.missing]
            found.append([*line, *frame.figures.to_dict().values()])
        return found


def point_error(
    true: np.ndarray,
    predicted: PredictedDepth,
    align: str = "similarity",
    *,
    centres: np.ndarray | None = None,
    mask: np.ndarray | None = None,
) -> PointErrors:
    """Errors of predicted point maps against true ones (h, w, 3) or (n, h, w, 3) in metres, NaN =
    missing, all in one frame (the world), after one alignment of all images.

    predicted: an array of the same shape, a tensor, or what a model returned: a mapping or an
    object with `points` or `world_points` and, if any, `mask`. align: none, scale or similarity.
    centres: (n, 3) positions of the cameras, by default the origin, as of points in the camera's
    frame. mask: (h, w) or (n, h, w) bool, the pixels that count. Raises InputError for other
    shapes, whole numbers, and images without a point in common.
    """
    true_m = floating(true, "true points (h, w, 3) or (n, h, w, 3) in metres")
    true_m = true_m[None] if true_m.ndim == 3 else true_m
    points, seen = predicted_points(predicted)
    if true_m.ndim != 4 or points.shape != true_m.shape:
        raise InputError(f"predicted points of shape {true_m.shape}", found=points.shape)
    places = np.zeros((len(true_m), 3)) if centres is None else np.asarray(centres, float)
    if places.shape != (len(true_m), 3):
        raise InputError(f"centres ({len(true_m)}, 3)", found=places.shape)
    counts = np.ones(true_m.shape[:3], bool)
    for one in (mask, seen):
        if one is not None:
            one = np.asarray(one)
            if one.dtype != bool or one.shape not in (counts.shape, counts.shape[1:]):
                raise InputError(
                    f"a mask of shape {counts.shape}", found=f"{one.dtype} {one.shape}"
                )
            counts &= one

    def images() -> Iterator[PointImage]:
        for row in range(len(true_m)):
            whole = true_m[row].astype(float)
            if mask is not None:
                whole[~np.broadcast_to(mask, counts.shape)[row]] = np.nan
            one = points[row].astype(float)
            one[~counts[row]] = np.nan
            yield PointImage(f"image {row}", whole, one, places[row])

    return score_points(images, len(true_m), align)


def score_points(images: Callable[[], Iterable[PointImage]], count: int, align: str) -> PointErrors:
    """Errors of `count` images, which `images` gives one after the other, and is called twice."""
    if align not in POINT_ALIGNMENTS:
        raise InputError(f"one of {', '.join(POINT_ALIGNMENTS)}", setting="align", found=align)
    T = SE3.identity()
    scale = 1.0
    if align != "none":
        T, scale = _fitted(images, count, align)
    frames = []
    empty = []
    for image in images():
        both = _both(image)
        if not both.any():
            empty.append(image.name)
            continue
        true_m = image.true_m[both].astype(float)
        aligned_m = T.apply(scale * image.predicted[both].astype(float))
        counted = int(np.isfinite(image.true_m).all(axis=-1).sum())
        figures = _figures(true_m - image.centre_m, aligned_m - image.centre_m)
        missing = (counted - len(true_m)) / counted
        frames.append(PointError(image.name, figures, len(true_m), missing))
    if not frames:
        raise InputError("an image with true and predicted points", found="none")
    return PointErrors(tuple(frames), align, T, scale, tuple(empty))


def _both(image: PointImage) -> np.ndarray:
    """(h, w) bool: the pixels with both points."""
    return np.isfinite(image.true_m).all(axis=-1) & np.isfinite(image.predicted).all(axis=-1)


def _fitted(
    images: Callable[[], Iterable[PointImage]], count: int, align: str
) -> tuple[SE3, float]:
    share = max(3, _SAMPLED // max(1, count))
    trues = []
    predicted = []
    for image in images():
        places = np.flatnonzero(_both(image))
        places = places[:: max(1, -(-len(places) // share))]
        trues.append(image.true_m.reshape(-1, 3)[places].astype(float))
        predicted.append(image.predicted.reshape(-1, 3)[places].astype(float))
    y = np.concatenate(trues)
    x = np.concatenate(predicted)
    if len(x) < 3:
        raise InputError("at least three pixels with true and predicted points", found=len(x))
    if align == "scale":
        squares = float(np.vdot(x, x))
        if not squares:
            raise InputError("predicted points that are not all 0", found="only 0")
        return SE3.identity(), float(np.vdot(x, y)) / squares
    if not np.ptp(x, axis=0).any():
        raise InputError("predicted points that differ", found="one point")
    return umeyama(x, y, with_scale=True)


def _figures(true_m: np.ndarray, aligned_m: np.ndarray) -> PointFigures:
    """Of points (n, 3) relative to the camera."""
    error_m = np.linalg.norm(aligned_m - true_m, axis=1)
    from_camera_m = np.linalg.norm(true_m, axis=1)
    nearer_m = np.minimum(from_camera_m, np.linalg.norm(aligned_m, axis=1))
    return PointFigures(
        mean_m=float(error_m.mean()),
        median_m=float(np.median(error_m)),
        rmse_m=float(np.sqrt((error_m**2).mean())),
        abs_rel=float((error_m / np.maximum(from_camera_m, np.finfo(float).tiny)).mean()),
        delta1=float((error_m < _DELTA * nearer_m).mean()),
    )
