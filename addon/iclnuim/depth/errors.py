"""Errors of the depth that methods predicted for the frames of a sequence."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..console import Meter, advance_of
from ..errors import InputError, StrPath
from ..evaluation.depth_alignment import DepthAlignment
from ..evaluation.depth_error import (
    DEPTH,
    DepthErrors,
    DepthErrorSettings,
    DepthImage,
    score,
)
from ..evaluation.depth_resize import resized
from ..formats.depth_units import check_units
from ..formats.files import csv_text
from ..sequences.camera_files import camera_file
from ..sequences.frames import ImagePair
from ..sequences.stored_sequence import StoredSequence, read_depth_m
from ..shown import Shown
from .doubts import SampledFrame, doubts
from .groups import Chosen, Groups
from .predictions import Predictions

if TYPE_CHECKING:
    from ..shown import Axes

#: Frames, and pixels of each, that are looked at for doubts.
_DOUBTED_FRAMES = 8
_DOUBTED_PIXELS = 4096
#: Steps of frame numbers among which a renumbering is looked for.
_STEPS = (-2, -1, 1, 2)


@dataclass(frozen=True, eq=False, repr=False)
class MethodDepthErrors(Shown):
    """Errors of the depth of one method: its name, errors of all frames, names of frames without a
    prediction, and doubts, sentences on what the prediction seems to be instead.
    """

    method: str
    errors: DepthErrors
    missing: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def summary(self) -> str:
        return f"{self.method}: {self.errors.summary()}"

    def to_dict(self) -> dict[str, Any]:
        """As of DepthErrors, with the method's name, missing frames and doubts."""
        return {
            "method": self.method,
            **self.errors.to_dict(),
            "missing_frames": list(self.missing),
            "warnings": list(self.doubts),
        }

    def csv(self) -> str:
        """The figures of every frame as CSV."""
        return csv_text(self.errors.rows())

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw AbsRel of the frames in their order; returns the Matplotlib axes."""
        return self.errors.plot(axes)


class TrueDepth:
    """The depth of the frames of a sequence, in their order, and what errors are reported by.

    Raises InputError for a folder without a sequence, or without the ground truth that is asked
    for.
    """

    def __init__(
        self,
        folder: StrPath,
        by: Sequence[str] = (),
        only: Sequence[str] = (),
        without: Sequence[str] = (),
    ) -> None:
        sequence = StoredSequence(folder)
        self.sequence = sequence
        self.folder = sequence.folder
        self.pairs = sequence.pairs
        self.camera = sequence.camera
        self.groups = {kind: Groups(kind, sequence) for kind in by}
        self._chosen = Chosen(sequence, only, without)

    def predictions(self, folder: StrPath, units_per_metre: float | None = None) -> Predictions:
        """The depth that a method predicted. units_per_metre: of 16-bit images, by default those in
        camera.json of the folder, else of the sequence. Raises InputError.
        """
        folder = Path(folder)
        if units_per_metre is None:
            own = camera_file(folder) if folder.is_dir() else None
            units_per_metre = (own or self.camera).depth_units_per_metre
        return Predictions(folder, self.pairs, check_units(units_per_metre))

    def depth_m(self, row: int) -> np.ndarray:
        """(h, w) float32 metres of a frame, 0 = missing."""
        return read_depth_m(self.pairs[row].depth, self.camera.depth_units_per_metre)

    def image(self, row: int, predicted: np.ndarray) -> DepthImage:
        """A frame with its prediction."""
        pair = self.pairs[row]
        true_m = self.depth_m(row)
        groups = {kind: one.numbers(pair, true_m) for kind, one in self.groups.items()}
        return DepthImage(pair.rgb.stem, true_m, predicted, self._chosen.mask(pair), groups)


def depth_errors(
    folder: StrPath,
    truth: StrPath,
    settings: DepthErrorSettings | None = None,
    by: Sequence[str] = (),
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    units_per_metre: float | None = None,
    progress: Meter = None,
) -> MethodDepthErrors:
    """Compare the depth that a method predicted (depth/predictions.py says how files are named and
    stored) with that of the sequence `truth`, in any format.

    by: class, distance, angle. only, without: names of classes or objects whose pixels count, or do
    not. units_per_metre: of 16-bit PNG and TIFF; by default those in camera.json of `folder`, else
    of `truth`. progress: as of render_frames(). Raises InputError as of depth_error(), and for
    files that cannot be read.
    """
    there = TrueDepth(truth, by, only, without)
    return method_errors(there.predictions(folder, units_per_metre), there, settings, progress)


def method_errors(
    predictions: Predictions,
    truth: TrueDepth,
    settings: DepthErrorSettings | None = None,
    progress: Meter = None,
) -> MethodDepthErrors:
    """As depth_errors(), of predictions and a sequence that are open."""
    settings = settings or DepthErrorSettings()
    rows = [row for row, _ in enumerate(truth.pairs) if predictions.has(row)]
    twice = settings.per == "sequence" and settings.align != "none"
    advance = advance_of(progress, len(rows) * (2 if twice else 1), predictions.name)

    def images() -> Iterator[DepthImage]:
        for row in rows:
            yield truth.image(row, predictions[row])
            advance()

    names = {kind: one.names for kind, one in truth.groups.items()}
    found = score(images, len(rows), settings, names)
    sentences = doubts(
        list(_sampled(truth, predictions, rows, found)),
        settings.quantity == DEPTH,
        settings.align != "none",
    )
    return MethodDepthErrors(predictions.name, found, predictions.missing, tuple(sentences))


def _sampled(
    truth: TrueDepth,
    predictions: Predictions,
    rows: Sequence[int],
    errors: DepthErrors,
) -> Iterator[SampledFrame]:
    """Some pixels of some frames."""
    alignments = {frame.name: frame.alignment for frame in errors.frames}
    rays = np.linalg.norm(truth.camera.pinhole.rays(), axis=-1)
    for at in sorted({int(i) for i in np.linspace(0, len(rows) - 1, _DOUBTED_FRAMES)}):
        row = rows[at]
        true_m = truth.depth_m(row)
        predicted = predictions[row]
        if predicted.shape != true_m.shape:
            predicted = resized(predicted, true_m.shape, errors.settings.resize)
        predicted = predicted.astype(float)
        alignment = alignments.get(truth.pairs[row].rgb.stem, DepthAlignment())
        aligned = alignment.apply(predicted)
        if alignment.scale < 0:  # upside down: only whether it is the inverse can be told
            aligned = predicted
        possible = _possible(predicted) & _possible(aligned)
        used = np.flatnonzero((true_m > 0) & np.isfinite(true_m) & possible)
        used = used[:: max(1, len(used) // _DOUBTED_PIXELS)]
        if not len(used) or rays.shape != true_m.shape:
            continue
        others = {}
        for step in _STEPS:
            if 0 <= row + step < len(truth.pairs):
                other_m = truth.depth_m(row + step)
                others[step] = other_m.ravel()[used].astype(float)
        yield SampledFrame(
            predicted.ravel()[used],
            aligned.ravel()[used],
            true_m.ravel()[used].astype(float),
            rays.ravel()[used],
            others,
        )


def _possible(predicted: np.ndarray) -> np.ndarray:
    return np.isfinite(predicted) & (predicted > 0)


def frame_row(pairs: Sequence[ImagePair], name: str) -> int:
    """The row of the frame with this name or number. Raises InputError."""
    for row, pair in enumerate(pairs):
        if name in (pair.rgb.stem, pair.depth.stem, str(pair.number)):
            return row
    raise InputError("the name or number of a frame", found=name)
