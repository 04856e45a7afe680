"""Whole sequences through one or several odometers: paths, their figures, and a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..dataset.images import read_truth
from ..errors import InputError, WorkError
from ..evaluation.absolute_error import absolute_error
from ..evaluation.relative_error import RelativeErrorSettings, relative_error
from ..formats.trajectories import write_trajectory
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .frames import Sequence
from .protocol import Odometer
from .reference import Reference
from .track import Tracked, Tracker

#: makes a Reference of an odometer and a camera
Referee = Callable[[Odometer, PinholeCamera], Reference]
_SECOND = RelativeErrorSettings(1.0, "seconds")


@dataclass(frozen=True, eq=False)
class Run:
    """All frames of a sequence, tracked or lost. truth: right-handed poses, where the folder has them."""

    name: str
    frames: list[Tracked]
    truth: Trajectory | None

    @property
    def trajectory(self) -> Trajectory:
        """The frames that were tracked, none of those that a policy filled in. WorkError where there are none."""
        kept = [f for f in self.frames if not f.lost]
        if not kept:
            raise WorkError(f"{self.name}: no frame could be tracked: {self.frames[0].result.reason}")
        poses = SE3.from_matrix(np.array([f.T_world_camera for f in kept]))
        return Trajectory(np.array([f.stamp_s for f in kept]), poses)

    def write(self, path: Path) -> None:
        write_trajectory(path, self.trajectory, "tum")

    def losses(self) -> list[str]:
        return [f"{f.stamp_s:.6f} s lost: {f.result.reason}" for f in self.frames if f.lost]

    def ate_rmse_m(self) -> float | None:
        """After SE(3) alignment; None without ground truth, or where it cannot be aligned."""
        return self._error(lambda truth, path: absolute_error(truth, path).translation_m.rmse)

    def rpe_rmse_m(self) -> float | None:
        """Over all stretches of one second; None where there is none."""
        return self._error(lambda truth, path: relative_error(truth, path, _SECOND).translation_m.rmse)

    def _error(self, measure: Callable[[Trajectory, Trajectory], float]) -> float | None:
        try:
            return None if self.truth is None else measure(self.truth, self.trajectory)
        except InputError:
            return None

    def to_dict(self) -> dict:
        ms = np.array([f.result.seconds for f in self.frames[1:]] or [0.0]) * 1e3
        lost = sum(f.lost for f in self.frames)
        return {
            "odometer": self.name,
            "frames": len(self.frames),
            "lost": lost,
            "coverage": 1 - lost / len(self.frames),
            "not_converged": sum(not f.result.converged for f in self.frames) - lost,
            "degenerate": sum(f.result.degenerate for f in self.frames),
            "ms_median": float(np.median(ms)),
            "ms_95": float(np.percentile(ms, 95)),
            "frames_per_s": 1e3 / max(float(ms.mean()), 1e-6) if len(self.frames) > 1 else None,
            "ate_rmse_m": self.ate_rmse_m(),
            "rpe_1s_rmse_m": self.rpe_rmse_m(),
        }


def run_together(
    odometers: Iterable[Odometer],
    sequence: Sequence,
    policy: str = "hold",
    progress: Callable | None = None,
    frames: int | None = None,
    reference: Referee | None = None,
) -> list[Run]:
    """Each frame of a sequence, or of its first `frames`, is read once and given to one odometer after the other.

    So all see the machine at the same moments. `progress(total, label)` makes something with advance(). Without
    `reference` each has what it asks for.
    """
    odometers = list(odometers)
    camera = sequence.camera.pinhole
    trackers = [Tracker(o, camera, policy, reference(o, camera) if reference else None) for o in odometers]
    total, tracked = min(len(sequence), frames or len(sequence)), [[] for _ in odometers]
    bar = progress(total, ", ".join(o.name for o in odometers)) if progress else None
    for stamp_s, frame in sequence.frames(frames):
        for tracker, results in zip(trackers, tracked, strict=True):
            results.append(tracker.add(stamp_s, frame))
        if bar:
            bar.advance()
    truth = read_truth(sequence.folder)
    return [Run(o.name, results, truth) for o, results in zip(odometers, tracked, strict=True)]


def table(runs: list[dict]) -> str:
    """Of Run.to_dict(): times without reading, 1/s from their mean."""
    lines = [
        f"{'odometer':<22}{'frames':>7}{'lost':>6}{'weak':>6}{'ms':>8}{'ms 95%':>8}{'1/s':>7}{'ATE [mm]':>10}{'RPE [mm/s]':>12}"
    ]
    for r in runs:
        ate, rpe = ("-" if r[k] is None else f"{r[k] * 1e3:.3f}" for k in ("ate_rmse_m", "rpe_1s_rmse_m"))
        rate = f"{r['frames_per_s']:.1f}" if r.get("frames_per_s") else "-"
        figures = f"{r['frames']:>7}{r['lost']:>6}{r['degenerate']:>6}{r['ms_median']:>8.1f}{r['ms_95']:>8.1f}"
        lines.append(f"{r['odometer']:<22}{figures}{rate:>7}{ate:>10}{rpe:>12}")
    return "\n".join(lines)
