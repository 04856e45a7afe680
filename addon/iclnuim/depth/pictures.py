"""Pictures of depth errors: a curve over the frames of each method, and the error of some frames."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..evaluation.depth_error import DEPTH, DISPARITY
from ..evaluation.depth_resize import resized
from ..report.charts import COLOURS, save
from ..shown import depth_colours, depth_range
from .errors import MethodDepthErrors, TrueDepth, frame_row
from .predictions import Predictions

#: Relative errors of more are shown in the last colour.
_LARGEST = 0.25


def curves_figure(methods: Mapping[str, MethodDepthErrors]) -> Figure:
    """AbsRel of every frame, a curve for each method."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    for k, (name, found) in enumerate(methods.items()):
        frames = found.errors.frames
        values = [frame.figures.abs_rel for frame in frames]
        mean = found.errors.figures.abs_rel
        label = f"{name} ({mean:.4g})"
        axes.plot(values, ".-", linewidth=0.9, color=COLOURS[k % len(COLOURS)], label=label)
    axes.set(xlabel="frame", ylabel="AbsRel")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def draw_errors(
    path: Path,
    predictions: Sequence[Predictions],
    truth: TrueDepth,
    found: Sequence[MethodDepthErrors],
    names: Sequence[str] = (),
) -> None:
    """Write a picture: true depth, and of each method its aligned depth and relative error, of the
    frames `names`, or else of the first method's best, median and worst frame.

    Raises InputError for a frame that does not exist.
    """
    rows = [frame_row(truth.pairs, name) for name in names] or _telling(truth, found[0])
    figure = Figure(figsize=(3.4 * (1 + 2 * len(found)), 2.7 * len(rows)), layout="constrained")
    grid = figure.subplots(len(rows), 1 + 2 * len(found), squeeze=False)
    shown = None
    for line, row in zip(grid, rows, strict=True):
        true_m = truth.depth_m(row)
        near_m, far_m = depth_range(true_m)
        line[0].imshow(depth_colours(true_m, near_m, far_m))
        line[0].set_ylabel(truth.pairs[row].rgb.stem)
        line[0].set_title(f"true depth, {near_m:.2f} to {far_m:.2f} m", size=8)
        for k, (given, one) in enumerate(zip(predictions, found, strict=True)):
            depth_m = _aligned(given, truth, one, row)
            with np.errstate(divide="ignore", invalid="ignore"):
                error = np.where(true_m > 0, (depth_m - true_m) / true_m, np.nan)
            line[1 + 2 * k].imshow(depth_colours(np.nan_to_num(depth_m), near_m, far_m))
            line[1 + 2 * k].set_title(one.method, size=8)
            drawn = line[2 + 2 * k].imshow(error, cmap="RdBu", vmin=-_LARGEST, vmax=_LARGEST)
            line[2 + 2 * k].set_title(f"error, AbsRel {np.nanmean(np.abs(error)):.4g}", size=8)
            shown = drawn
    for axes in grid.ravel():
        axes.set_xticks([])
        axes.set_yticks([])
    if shown is not None:
        figure.colorbar(shown, ax=grid[:, -1], label="(predicted - true) / true")
    save(figure, path)


def _telling(truth: TrueDepth, found: MethodDepthErrors) -> list[int]:
    """Rows of the best, the median and the worst frame."""
    frames = sorted(found.errors.frames, key=lambda frame: frame.figures.abs_rel)
    chosen = [frames[k].name for k in sorted({0, len(frames) // 2, len(frames) - 1})]
    return [frame_row(truth.pairs, name) for name in chosen]


def _aligned(
    predictions: Predictions, truth: TrueDepth, found: MethodDepthErrors, row: int
) -> np.ndarray:
    """The prediction (h, w) of a frame in metres after its alignment; NaN where there is none."""
    settings = found.errors.settings
    shape = truth.depth_m(row).shape
    name = truth.pairs[row].rgb.stem
    of_frame = next((frame for frame in found.errors.frames if frame.name == name), None)
    if of_frame is None or not predictions.has(row):
        return np.full(shape, np.nan)
    values = predictions[row].astype(float)
    if values.shape != shape:
        values = resized(values, shape, settings.resize)
    if settings.quantity == DISPARITY and settings.disparity_factor is not None:
        values /= settings.disparity_factor
    values[~np.isfinite(values) | (values == 0)] = np.nan
    aligned = of_frame.alignment.apply(values)
    return aligned if settings.quantity == DEPTH else 1 / aligned
