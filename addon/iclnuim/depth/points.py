"""Errors of the point maps that a method predicted for the frames of a sequence."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..console import Meter, advance_of
from ..errors import InputError, StrPath
from ..evaluation.depth_resize import nearest_pixels
from ..evaluation.point_error import PointErrors, PointImage, score_points
from ..formats.files import csv_text
from ..sequences.frames import depth_stamps_s, poses_at
from ..shown import Shown
from .errors import TrueDepth
from .predictions import Predictions

FRAMES = {
    "world": "one frame for all images, such as that of the first camera",
    "camera": "each in the frame of its own camera",
}


@dataclass(frozen=True, eq=False, repr=False)
class MethodPointErrors(Shown):
    """Errors of the point maps of one method: its name, errors of all frames, and names of frames
    without a prediction.
    """

    method: str
    errors: PointErrors
    frame: str = "world"
    missing: tuple[str, ...] = ()

    def summary(self) -> str:
        return f"{self.method}: {self.errors.summary()}"

    def to_dict(self) -> dict[str, Any]:
        """As of PointErrors, with the method's name, frame and missing frames."""
        return {
            "method": self.method,
            "frame": self.frame,
            **self.errors.to_dict(),
            "missing_frames": list(self.missing),
        }

    def csv(self) -> str:
        """The figures of every frame as CSV."""
        return csv_text(self.errors.rows())


def point_errors(
    folder: StrPath,
    truth: StrPath,
    align: str = "similarity",
    frame: str = "world",
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    progress: Meter = None,
) -> MethodPointErrors:
    """Compare the point maps (h, w, 3) that a method predicted (.npy, .npz with `points` or
    `world_points`, .exr with R, G, B; files as of depth_errors()) with the points of the sequence
    `truth`, after one alignment of all frames.

    frame: world, in which all maps are in one frame, or camera, each in that of its camera. A map of
    another size than the images is compared at the nearest pixels. Raises InputError for a sequence
    without poses in the frame world, and as of point_error().
    """
    if frame not in FRAMES:
        raise InputError(f"one of {', '.join(FRAMES)}", setting="frame", found=frame)
    there = TrueDepth(truth, (), only, without)
    predictions = Predictions(Path(folder), there.pairs, 1.0, "points")
    poses = poses_at(depth_stamps_s(there.pairs), there.sequence.truth)
    rows = [row for row, _ in enumerate(there.pairs) if predictions.has(row)]
    if frame == "world":
        rows = [row for row in rows if poses[row] is not None]
        if not rows:
            hint = "{frame} camera, if the points are in the cameras' frames"
            raise InputError("frames with true poses", path=truth, found="none", hint=hint)
    advance = advance_of(progress, len(rows) * (1 if align == "none" else 2), predictions.name)
    pinhole = there.camera.pinhole

    def images() -> Iterator[PointImage]:
        for row in rows:
            image = there.image(row, np.zeros(0))
            inside = image.true_m > 0
            if image.mask is not None:
                inside &= image.mask
            points_m = pinhole.unproject(image.true_m.astype(float))
            centre_m = np.zeros(3)
            pose = poses[row]
            if frame == "world" and pose is not None:
                points_m = pose.apply(points_m.reshape(-1, 3)).reshape(points_m.shape)
                centre_m = pose.translation
            points_m[~inside] = np.nan
            predicted = predictions[row]
            if predicted.shape[:2] != points_m.shape[:2]:
                predicted = predicted[nearest_pixels(predicted.shape[:2], points_m.shape[:2])]
            yield PointImage(image.name, points_m, predicted, centre_m)
            advance()

    found = score_points(images, len(rows), align)
    return MethodPointErrors(predictions.name, found, frame, predictions.missing)
