"""Runs of one or several odometers on a sequence: from frames to trajectories, errors, times and a
table.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from iclnuim.console import Meter, advance_of
from iclnuim.errors import InputError, WorkError
from iclnuim.evaluation.absolute_error import absolute_error
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, frame_slice
from iclnuim.sequences.camera_files import SequenceCamera
from iclnuim.sequences.frames import ImagePair
from iclnuim.sequences.rgbd_sequence import RgbdSequence
from iclnuim.sequences.stored_sequence import StoredSequence, opened
from iclnuim.shown import MM, Shown
from iclnuim.trajectory_files.trajectories import write_trajectory

from .protocol import Frame, Odometer, OdometryStatus, reads_depth_alone
from .registry import odometer
from .track import Reference, Tracked, Tracker

if TYPE_CHECKING:
    from iclnuim.shown import Axes

    from .compiling import WorkClock

#: Per metre. With a larger offset the largest depth of a 16-bit image in millimetres (65.5 m) would
#: be behind the camera.
MAX_OFFSET = 0.015
_SECOND = RelativeErrorSettings(1.0, "seconds")


class Sequence:
    """Image pairs of a sequence, or of its folder, and their camera; frames are read one at a time.

    depth_offset (1/m) is subtracted from inverse depth. A structured-light camera measures
    disparity, and a constant error of its disparity is such an offset. frames: a Python slice of
    the pairs, such as `:60`. Raises InputError if there are no images, no camera is found, or no
    pair can be read with it.
    """

    def __init__(
        self,
        sequence: Path | str | RgbdSequence | StoredSequence,
        depth_offset: float = 0.0,
        frames: str = "::",
    ) -> None:
        if not abs(depth_offset) <= MAX_OFFSET:
            raise InputError(
                f"a depth offset from {-MAX_OFFSET} to {MAX_OFFSET} per metre", found=depth_offset
            )
        self.depth_offset = depth_offset
        if isinstance(sequence, RgbdSequence):
            self.stored = sequence.stored
            pairs = list(sequence.pairs)
        else:
            self.stored = opened(sequence)
            pairs = self.stored.pairs
        self.pairs: list[ImagePair] = [pairs[k] for k in frame_slice(frames, len(pairs))]
        self.folder = self.stored.folder
        self.camera: SequenceCamera = self.stored.camera
        self._require_one()

    def _require_one(self) -> None:
        """Read pairs until one is good, usually the first.

        Raises the InputError of the first one if there is none.
        """
        first = None
        for pair in self.pairs:
            try:
                self.images(pair)
                return
            except InputError as error:
                first = first or error
        assert first is not None
        raise first

    def __len__(self) -> int:
        return len(self.pairs)

    def frames(self, first: int | None = None) -> Iterator[tuple[float, Frame | str]]:
        """(stamp, frame or the reason why it cannot be read) of all pairs, or of the `first`
        ones.
        """
        for pair in self.pairs[:first]:
            yield pair.stamp_s, self._frame(pair)

    def _frame(self, pair: ImagePair) -> Frame | str:
        try:
            rgb, depth_z_m = self.images(pair)
            return Frame.of(rgb, depth_z_m, pair.stamp_s, depth_offset=self.depth_offset)
        except InputError as error:
            return f"image: {error}"

    def images(self, pair: ImagePair) -> tuple[np.ndarray, np.ndarray]:
        """rgb (h, w, 3) uint8 and planar depth (h, w) float32 in metres, without the offset
        correction. Raises InputError.
        """
        return self.stored.images(pair)


@dataclass(frozen=True, eq=False, repr=False)
class OdometryRun(Shown):
    """All frames of a sequence, tracked or lost. truth: right-handed ground-truth poses, if the
    folder has them.
    """

    name: str
    frames: list[Tracked]
    truth: Trajectory | None

    @property
    def trajectory(self) -> Trajectory:
        """The tracked frames only, without the poses that a policy filled in.

        Raises WorkError if there are none.
        """
        tracked = [f for f in self.frames if not f.lost]
        if not tracked:
            raise WorkError(
                f"{self.name}: no frame could be tracked: {self.frames[0].result.reason}"
            )
        poses = SE3.from_matrix(np.array([f.T_world_camera.matrix for f in tracked]))
        return Trajectory(np.array([f.stamp_s for f in tracked]), poses)

    def losses(self) -> list[str]:
        """One line per lost frame: its stamp and the reason."""
        return [f"{f.stamp_s:.6f} s lost: {f.result.reason}" for f in self.frames if f.lost]

    def write(self, path: str | Path) -> None:
        """The trajectory as a TUM file."""
        write_trajectory(path, self.trajectory, "tum")

    def _rmse_m(self, measure: Callable) -> float | None:
        """The RMSE in metres; None without ground truth, or if it cannot be computed."""
        if self.truth is None:
            return None
        try:
            return measure(self.truth, self.trajectory).translation_m.rmse
        except InputError:
            return None

    def summary(self) -> str:
        lost = sum(frame.lost for frame in self.frames)
        words = [self.name, f"{len(self.frames)} frames", f"{lost} lost"]
        ate_m = self._rmse_m(absolute_error) if lost < len(self.frames) else None
        if ate_m is not None:
            words.append(f"ATE {MM * ate_m:.4g} mm")
        return ", ".join(words)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the trajectory, over the ground truth and aligned with it if there is one; returns
        the Matplotlib axes.
        """
        estimate = self.trajectory
        if self.truth is None:
            return estimate.plot(axes, self.name)
        error = absolute_error(self.truth, estimate)
        axes = self.truth.plot(axes, "ground truth")
        return Trajectory(error.stamps_s, error.aligned).plot(axes, self.name)

    def to_dict(self) -> dict[str, Any]:
        """The values that `odometry --json` prints. Times are those of prepare() and align(),
        without reading the images.

        ATE is after SE(3) alignment, RPE over all pairs a second apart; both are None without
        ground truth or if undetermined.
        """
        ms = np.array([f.result.seconds for f in self.frames[1:]] or [0.0]) * 1e3
        lost = sum(f.lost for f in self.frames)
        return {
            "odometer": self.name,
            "frames": len(self.frames),
            "lost": lost,
            "coverage": 1 - lost / len(self.frames),
            "not_converged": sum(not f.result.converged for f in self.frames) - lost,
            "degenerate": sum(f.result.status is OdometryStatus.DEGENERATE for f in self.frames),
            "ms_median": float(np.median(ms)),
            "ms_95": float(np.percentile(ms, 95)),
            "frames_per_s": 1e3 / max(float(ms.mean()), 1e-6) if len(self.frames) > 1 else None,
            "ate_rmse_m": self._rmse_m(absolute_error),
            "rpe_1s_rmse_m": self._rmse_m(partial(relative_error, settings=_SECOND)),
        }


def run_odometers(
    odometers: Iterable[Odometer | str] | Odometer | str,
    sequence: Sequence | RgbdSequence | Path | str,
    policy: str = "hold",
    progress: Meter = None,
    frames: int | None = None,
    against: Callable[[Odometer, PinholeCamera], Reference] | None = None,
) -> list[OdometryRun]:
    """Run one or several odometers, or those of these names with their preset `best`, on a sequence
    (or its folder), or on its first `frames`.

    Each frame is read once and passed to one odometer after the other, so that all run under the
    same machine load. progress: as of render_frames(). `against` returns the reference that frames
    are aligned against, by default the one that each odometer declares. Raises InputError for an
    object that is not an odometer.
    """
    if isinstance(odometers, str) or not isinstance(odometers, Iterable):
        odometers = [odometers]
    methods = [odometer(one) if isinstance(one, str) else one for one in odometers]
    for o in methods:
        if not all(hasattr(o, part) for part in ("name", "reference", "prepare", "align")):
            raise InputError(
                "odometers, as iclnuim.odometer(name) makes them (iclnuim.Odometer)", found=repr(o)
            )
    from .compiling import WorkClock

    sequence = sequence if isinstance(sequence, Sequence) else Sequence(sequence)
    truth = sequence.stored.truth  # before the work: an error must not discard a finished run
    camera = sequence.camera.pinhole
    trackers = []
    for o in methods:
        reference = against(o, camera) if against else None
        trackers.append(Tracker(o, camera, policy, reference))
    tracked: list[list[Tracked]] = [[] for _ in methods]
    total = min(len(sequence), frames or len(sequence))
    advance = advance_of(progress, total, ", ".join(o.name for o in methods))
    with WorkClock() as clock:
        for pair, (_, frame) in zip(sequence.pairs, sequence.frames(frames), strict=False):
            for tracker, results in zip(trackers, tracked, strict=True):
                of_depth = reads_depth_alone(tracker.odometer)
                stamp_s = pair.depth_stamp_s if of_depth else pair.stamp_s
                results.append(timed(tracker, stamp_s, frame, clock))
            advance()
    named = zip(methods, tracked, strict=True)
    return [OdometryRun(method.name, results, truth) for method, results in named]


def timed(tracker: Tracker, stamp_s: float, frame: Frame | str, clock: "WorkClock") -> Tracked:
    """The tracked frame, with its time without compiling."""
    before_s = clock.compiling_s
    found = tracker.add(stamp_s, frame)
    seconds = found.result.seconds - (clock.compiling_s - before_s)
    return replace(found, result=replace(found.result, seconds=seconds))


def odometry_table(runs: Iterable[OdometryRun | dict]) -> str:
    """A text table of runs or their to_dict(), one row each. ms and frames per second exclude
    reading the images; ATE and RPE over 1 s are RMSE.

    Rows of `iclnuim run` may lack values: their ms are those of the whole process. Their notes are
    printed below the row.
    """
    lines = [
        f"{'odometer':<26}" + "".join(f"{column.title:>{column.width}}" for column in _COLUMNS)
    ]
    for run in runs:
        row = run.to_dict() if isinstance(run, OdometryRun) else run
        lines.append(f"{row['odometer']:<26}" + "".join(column.cell(row) for column in _COLUMNS))
        lines += [f"    {note}" for note in row.get("notes", ())]
    return "\n".join(lines)


class _Column(NamedTuple):
    """A column of odometry_table(); key: of to_dict()."""

    title: str
    width: int
    key: str
    format: str = "d"
    factor: float = 1

    def cell(self, row: dict) -> str:
        value = row.get(self.key)
        text = "-" if value is None else format(value * self.factor, self.format)
        return f"{text:>{self.width}}"


_COLUMNS = (
    _Column("frames", 7, "frames"),
    _Column("lost", 6, "lost"),
    _Column("degen.", 8, "degenerate"),
    _Column("ms", 8, "ms_median", ".1f"),
    _Column("ms 95%", 8, "ms_95", ".1f"),
    _Column("1/s", 7, "frames_per_s", ".1f"),
    _Column("ATE [mm]", 10, "ate_rmse_m", ".3f", 1e3),
    _Column("RPE [mm/s]", 12, "rpe_1s_rmse_m", ".3f", 1e3),
)
