"""Errors of predicted depth: figures of each image and of all, after an alignment of the prediction
with the truth where its scale is unknown.

Rules. A pixel counts if its true depth is finite, above 0, within the limits and inside the mask.
Where it counts and the prediction is NaN, infinite or 0, or negative without the alignment affine,
the prediction is missing: the pixel is in no figure, and in the share `missing`. Of the alignment
affine, which can turn a prediction negative, a depth that is not above 0 becomes the nearest true
depth of its image, and an inverse depth below that of the farthest true depth becomes the latter:
such pixels are `clamped`. All is computed in float64.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..errors import InputError, within
from ..settings import Settings, setting
from ..shown import Shown, axes_or_new
from .depth_alignment import ALIGNMENTS, DepthAlignment, fit, fit_all
from .depth_boundary import boundary_counts, boundary_f1
from .depth_figures import FIGURES, DepthFigures, DepthSums
from .depth_resize import RESIZES, resized
from .predicted_arrays import PredictedDepth, floating, predicted_depth

if TYPE_CHECKING:
    from ..shown import Axes

DEPTH = "depth"
DISPARITY = "disparity"
#: The quantities that a method can predict, in which it is aligned, too.
QUANTITIES = {
    DEPTH: "metres, or any multiple",
    "inverse-depth": "1 / metre, or any multiple",
    DISPARITY: "pixels: focal length times baseline divided by depth",
}
PER = {"frame": "each image alone", "sequence": "all images together"}
POOLS = {
    "frames": "the mean over images of the figures of each",
    "pixels": "over the pixels of all images",
}
#: Pixels, at equal distances, from which a median or a robust fit of a whole sequence is taken.
_SAMPLED = 1 << 22


@dataclass(frozen=True)
class DepthErrorSettings(Settings):
    """How predicted depth is aligned with the truth, and which figures are computed."""

    group: ClassVar[str] = "settings of depth errors"

    align: str = setting("none", "alignment of the prediction", choices=ALIGNMENTS)
    robust: bool = setting(
        False, "fit scale and affine so that up to half of the pixels may be outliers"
    )
    per: str = setting("frame", "what has one alignment", choices=PER)
    quantity: str = setting(
        DEPTH, "what is predicted, in which scale and shift are fitted", choices=QUANTITIES
    )
    disparity_factor: float | None = setting(
        None,
        "focal length times baseline, for a disparity without alignment",
        unit="px m",
        low=1e-9,
    )
    pool: str = setting("frames", "figures of the whole", choices=POOLS)
    min_depth_m: float = setting(
        0.0, "count true depths above this one", unit="m", low=0.0, option="--min-depth"
    )
    max_depth_m: float | None = setting(
        None, "count true depths up to this one", unit="m", low=1e-9, option="--max-depth"
    )
    resize: str = setting("none", "prediction of another size", choices=RESIZES)
    boundary: bool = setting(True, "also boundary F1")

    def check(self) -> None:
        """Raises InputError for settings that contradict each other."""
        metric = self.quantity == DISPARITY and self.align == "none"
        if metric and self.disparity_factor is None:
            expected = "a focal length times baseline with a disparity that is not aligned"
            raise InputError(expected, setting="disparity_factor", found="none")
        if self.max_depth_m is not None and self.max_depth_m <= self.min_depth_m:
            expected = f"a largest depth above the smallest, {self.min_depth_m:g} m"
            raise InputError(expected, setting="max_depth_m", found=self.max_depth_m)


@dataclass(frozen=True, eq=False)
class DepthImage:
    """One image to compare: true depth (h, w) in metres; predicted (h, w) in its quantity, of any
    size that the settings allow; mask (h, w) bool: the pixels that count, None for all. groups:
    (h, w) numbers of a pixel's group by kind of group, -1 for none.
    """

    name: str
    true_m: np.ndarray
    predicted: np.ndarray
    mask: np.ndarray | None = None
    groups: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class DepthError:
    """The errors of one image: its figures, its alignment, the number of pixels in the figures, the
    share of the pixels that count of which the prediction is missing, and the clamped pixels.
    """

    name: str
    figures: DepthFigures
    alignment: DepthAlignment
    pixels: int
    missing: float
    clamped: int = 0


@dataclass(frozen=True)
class GroupError:
    """Figures over all pixels of a group of a kind: class, distance or angle."""

    name: str
    pixels: int
    figures: DepthFigures


@dataclass(frozen=True, eq=False, repr=False)
class DepthErrors(Shown):
    """Errors of all images. figures: of the whole, as the settings pool them; its fields are
    attributes of the result, too (`errors.abs_rel`). frames: each image; groups: by kind, the
    groups that have pixels; empty: names of images without any pixel to compare.
    """

    frames: tuple[DepthError, ...]
    figures: DepthFigures
    settings: DepthErrorSettings
    groups: Mapping[str, tuple[GroupError, ...]] = field(default_factory=dict)
    empty: tuple[str, ...] = ()

    def __getattr__(self, name: str) -> Any:
        if name in FIGURES:
            return getattr(self.figures, name)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    @property
    def mae_mm(self) -> float:
        """Mean absolute error in millimetres."""
        return 1e3 * self.figures.mae_m

    @property
    def pixels(self) -> int:
        """Pixels in the figures."""
        return sum(frame.pixels for frame in self.frames)

    @property
    def missing(self) -> float:
        """Mean over the images of the share of pixels that the prediction lacks."""
        return float(np.mean([frame.missing for frame in self.frames]))

    @property
    def clamped(self) -> int:
        """Pixels whose aligned value was outside the possible depths."""
        return sum(frame.clamped for frame in self.frames)

    @property
    def scale(self) -> float:
        """Median of the images' scales."""
        return float(np.median([frame.alignment.scale for frame in self.frames]))

    @property
    def shift(self) -> float:
        """Median of the images' shifts, in the predicted quantity's unit after scaling."""
        return float(np.median([frame.alignment.shift for frame in self.frames]))

    def summary(self) -> str:
        figures = self.figures
        words = [f"AbsRel {figures.abs_rel:.4g}", f"delta1 {figures.delta1:.4g}"]
        words += [f"MAE {self.mae_mm:.4g} mm", f"{len(self.frames)} frames"]
        return ", ".join(words)

    def to_dict(self) -> dict[str, Any]:
        """Settings, counts, figures, and `by`, the figures of groups."""
        found: dict[str, Any] = self.settings.to_dict() | {
            "frames": len(self.frames),
            "pixels": self.pixels,
            "missing": self.missing,
            "clamped": self.clamped,
            "scale": self.scale,
            "shift": self.shift,
            **self.figures.to_dict(),
        }
        found["by"] = {
            kind: [{"name": g.name, "pixels": g.pixels, **g.figures.to_dict()} for g in groups]
            for kind, groups in self.groups.items()
        }
        found["empty"] = list(self.empty)
        return found

    def rows(self) -> list[list[object]]:
        """A table: a line of names, and a line per image."""
        found: list[list[object]] = [
            ["frame", "pixels", "missing", "clamped", "scale", "shift", *FIGURES]
        ]
        for frame in self.frames:
            line = [frame.name, frame.pixels, frame.missing, frame.clamped]
            line += [frame.alignment.scale, frame.alignment.shift]
            found.append([*line, *frame.figures.to_dict().values()])
        return found

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw AbsRel of the images in their order; returns the Matplotlib axes."""
        axes = axes_or_new(axes)
        axes.plot([frame.figures.abs_rel for frame in self.frames], ".-", linewidth=0.9)
        axes.set(xlabel="frame", ylabel="AbsRel")
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
        return axes


def depth_error(
    true: np.ndarray,
    predicted: PredictedDepth,
    align: str = "none",
    *,
    robust: bool = False,
    per: str = "frame",
    quantity: str = DEPTH,
    disparity_factor: float | None = None,
    pool: str = "frames",
    min_depth_m: float = 0.0,
    max_depth_m: float | None = None,
    mask: np.ndarray | None = None,
    resize: str = "none",
    boundary: bool = True,
) -> DepthErrors:
    """Errors of predicted depth against true planar depth (h, w) or (n, h, w) in metres, 0, NaN or
    infinite = missing.

    predicted: an array of the same shape, a tensor, or what a model returned: a mapping or an
    object with `depth` and, if any, `mask`. align: none, median, scale or affine, `robust`
    against outliers, `per` frame or sequence. quantity: what is predicted, depth, inverse-depth
    or disparity; disparity_factor: focal length (px) times baseline (m) of a disparity that is not
    aligned. pool: the mean over frames, or over all pixels. mask: (h, w) or (n, h, w) bool, the
    pixels that count, among true depths above min_depth_m, up to max_depth_m. resize: none, nearest
    or bilinear, for a prediction of another size.

    Raises InputError for whole numbers, other shapes, and images that have no pixel in common or do
    not determine the alignment.
    """
    settings = DepthErrorSettings(
        align=align,
        robust=robust,
        per=per,
        quantity=quantity,
        disparity_factor=disparity_factor,
        pool=pool,
        min_depth_m=min_depth_m,
        max_depth_m=max_depth_m,
        resize=resize,
        boundary=boundary,
    )
    true_m = _stacked(floating(true, "true depth (h, w) or (n, h, w) in metres"))
    depth, seen = predicted_depth(predicted)
    depth = _stacked(depth)
    if len(depth) != len(true_m):
        raise InputError(f"{len(true_m)} predicted images", found=depth.shape)
    if mask is not None:
        mask = _stacked(_boolean(mask, "a mask (h, w) or (n, h, w)"))
        if mask.shape not in (true_m.shape, (1, *true_m.shape[1:])):
            raise InputError(f"a mask of shape {true_m.shape}", found=mask.shape)
        mask = np.broadcast_to(mask, true_m.shape)
    if seen is not None:
        seen = _stacked(_boolean(seen, "a mask of the prediction, of its shape"))
        if seen.shape != depth.shape:
            raise InputError(f"a mask of the prediction's shape {depth.shape}", found=seen.shape)

    def images() -> Iterator[DepthImage]:
        for row in range(len(true_m)):
            one = depth[row] if seen is None else np.where(seen[row], depth[row], np.nan)
            inside = None if mask is None else mask[row]
            yield DepthImage(f"image {row}", true_m[row], one, inside)

    return score(images, len(true_m), settings)


def _stacked(array: np.ndarray) -> np.ndarray:
    return array[None] if array.ndim == 2 else array


def _boolean(mask: np.ndarray, expected: str) -> np.ndarray:
    mask = np.asarray(mask)
    if mask.dtype != bool or mask.ndim not in (2, 3):
        raise InputError(f"{expected} of true and false", found=f"{mask.dtype} {mask.shape}")
    return mask


def score(
    images: Callable[[], Iterable[DepthImage]],
    count: int,
    settings: DepthErrorSettings,
    groups: Mapping[str, tuple[str, ...]] | None = None,
) -> DepthErrors:
    """Errors of `count` images. images: a function that gives them one after the other, so that no
    more than one is in memory; it is called twice if there is one alignment per sequence. groups:
    the names of the groups of each kind that the images have.

    Raises InputError, with the image's name, as of depth_error().
    """
    settings.check()
    groups = groups or {}
    alignment = None
    if settings.per == "sequence" and settings.align != "none":
        alignment = _of_sequence(images, count, settings)
    frames = []
    empty = []
    total: DepthSums | None = None
    by: dict[str, DepthSums] = {}
    edges = []
    for image in images():
        with within(image.name):
            pixels = _Pixels.of(image, settings)
            if pixels is None:
                empty.append(image.name)
                continue
            found = pixels.compared(alignment)
        frames.append(found.error(image.name))
        edges.append(found.edges)
        total = found.sums if total is None else total + found.sums
        for kind, names in groups.items():
            sums = found.of_groups(image.groups[kind], len(names))
            by[kind] = by[kind] + sums if kind in by else sums
    if total is None:
        raise InputError("an image with pixels that have true and predicted depth", found="none")
    whole = DepthFigures.mean([frame.figures for frame in frames])
    if settings.pool == "pixels":
        whole = total.figures(0, boundary_f1(np.sum(edges, axis=0)))
    named = {kind: _named(sums, groups[kind]) for kind, sums in by.items()}
    return DepthErrors(tuple(frames), whole, settings, named, tuple(empty))


def _named(sums: DepthSums, names: tuple[str, ...]) -> tuple[GroupError, ...]:
    found = []
    for k in np.flatnonzero(sums.count).tolist():
        found.append(GroupError(names[k], int(sums.count[k]), sums.figures(k)))
    return tuple(found)


def _of_sequence(
    images: Callable[[], Iterable[DepthImage]], count: int, settings: DepthErrorSettings
) -> DepthAlignment:
    """The one alignment of all images."""

    def parts() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for image in images():
            with within(image.name):
                pixels = _Pixels.of(image, settings)
            if pixels is not None:
                yield pixels.x, pixels.y

    if settings.align != "median" and not settings.robust:
        return fit_all(settings.align, parts())
    share = max(1, _SAMPLED // max(1, count))
    sampled = [(x[:: -(-len(x) // share)], y[:: -(-len(y) // share)]) for x, y in parts()]
    if not sampled:
        raise InputError("an image with pixels that have true and predicted depth", found="none")
    x, y = (np.concatenate(values) for values in zip(*sampled, strict=True))
    return fit(settings.align, settings.robust, x, y)


@dataclass(frozen=True, eq=False)
class _Pixels:
    """The pixels of an image of which both depths count: x predicted and y true, in the quantity of
    the alignment, and true_m, (n,) each; both (h, w): which pixels they are.
    """

    settings: DepthErrorSettings
    whole_m: np.ndarray
    both: np.ndarray
    true_m: np.ndarray
    x: np.ndarray
    counted: int

    @classmethod
    def of(cls, image: DepthImage, settings: DepthErrorSettings) -> "_Pixels | None":
        """None if there is no such pixel."""
        true_m = image.true_m.astype(float, copy=False)
        predicted = image.predicted.astype(float)
        if predicted.shape != true_m.shape:
            predicted = resized(predicted, true_m.shape, settings.resize)
        if settings.disparity_factor is not None and settings.quantity == DISPARITY:
            predicted /= settings.disparity_factor
        farthest_m = np.finfo(float).max if settings.max_depth_m is None else settings.max_depth_m
        counts = (true_m > settings.min_depth_m) & (true_m <= farthest_m)
        if image.mask is not None:
            counts &= image.mask
        there = predicted != 0 if settings.align == "affine" else predicted > 0
        both = counts & there & np.isfinite(predicted)
        if not both.any():
            return None
        whole_m = np.where(counts, true_m, np.nan)
        return cls(settings, whole_m, both, true_m[both], predicted[both], int(counts.sum()))

    @property
    def y(self) -> np.ndarray:
        return self.true_m if self.settings.quantity == DEPTH else 1 / self.true_m

    def compared(self, alignment: DepthAlignment | None) -> "_AlignedPixels":
        if alignment is None:
            alignment = fit(self.settings.align, self.settings.robust, self.x, self.y)
        aligned = alignment.apply(self.x)
        clamped = 0
        if self.settings.align == "affine":
            limit = self.true_m.min()
            outside = aligned <= 0
            if self.settings.quantity != DEPTH:
                limit = 1 / self.true_m.max()
                outside = aligned < limit
            clamped = int(outside.sum())
            if clamped:
                aligned[outside] = limit
        depth_m = aligned if self.settings.quantity == DEPTH else 1 / aligned
        return _AlignedPixels(self, alignment, depth_m, clamped)


class _AlignedPixels:
    """An image after its alignment: depth_m (n,) of its pixels, sums, and counts of boundaries."""

    def __init__(
        self, pixels: _Pixels, alignment: DepthAlignment, depth_m: np.ndarray, clamped: int
    ) -> None:
        self._pixels = pixels
        self._alignment = alignment
        self._depth_m = depth_m
        self._clamped = clamped
        self.sums = DepthSums.of(depth_m, pixels.true_m)
        self.edges = np.zeros((3, 1, 1), np.int64)
        if pixels.settings.boundary:
            whole_m = np.full(pixels.both.shape, np.nan)
            whole_m[pixels.both] = depth_m
            self.edges = boundary_counts(whole_m, pixels.whole_m)

    def error(self, name: str) -> DepthError:
        pixels = self._pixels
        count = len(pixels.true_m)
        return DepthError(
            name,
            self.sums.figures(0, boundary_f1(self.edges)),
            self._alignment,
            count,
            (pixels.counted - count) / pixels.counted,
            clamped=self._clamped,
        )

    def of_groups(self, numbers: np.ndarray, count: int) -> DepthSums:
        """Sums by group number (h, w) of 0..count-1; negative: in no group."""
        inside = numbers[self._pixels.both]
        used = inside >= 0
        depth_m = self._depth_m[used]
        return DepthSums.of(depth_m, self._pixels.true_m[used], inside[used], count)
