"""A whole sequence through an odometer: the path, its figures, a table and a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from iclnuim.dataset.images import read_truth
from iclnuim.errors import InputError, WorkError
from iclnuim.evaluation.absolute_error import absolute_error
from iclnuim.formats.trajectories import write_trajectory
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

from .frames import Sequence
from .protocol import Odometer
from .reference import Reference
from .track import Tracked, track


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
        try:
            return None if self.truth is None else absolute_error(self.truth, self.trajectory).translation_m.rmse
        except InputError:
            return None

    def to_dict(self) -> dict:
        ms = np.array([f.result.seconds for f in self.frames[1:]] or [0.0]) * 1e3
        lost, ate = sum(f.lost for f in self.frames), self.ate_rmse_m()
        return {
            "odometer": self.name,
            "frames": len(self.frames),
            "lost": lost,
            "coverage": 1 - lost / len(self.frames),
            "not_converged": sum(not f.result.converged for f in self.frames) - lost,
            "degenerate": sum(f.result.degenerate for f in self.frames),
            "ms_median": float(np.median(ms)),
            "ms_95": float(np.percentile(ms, 95)),
            "ate_rmse_m": ate,
        }


def run_sequence(
    odometer: Odometer,
    folder: Path,
    policy: str = "hold",
    progress: Callable | None = None,
    frames: int | None = None,
    reference: Callable[[Odometer, PinholeCamera], Reference] | None = None,
) -> Run:
    """Track a folder's frames, or the first of them. `progress(total, label)` makes something with advance()."""
    sequence = Sequence(Path(folder))
    view = reference(odometer, sequence.camera.pinhole) if reference else None
    bar = progress(min(len(sequence), frames or len(sequence)), odometer.name) if progress else None
    tracked = []
    for result in track(odometer, sequence.camera.pinhole, sequence.frames(frames), policy, view):
        tracked.append(result)
        if bar:
            bar.advance()
    return Run(odometer.name, tracked, read_truth(folder))


def table(runs: list[Run]) -> str:
    lines = [f"{'odometer':<22}{'frames':>7}{'lost':>6}{'weak':>6}{'ms':>8}{'ms 95%':>8}{'ATE [mm]':>10}"]
    for r in (run.to_dict() for run in runs):
        ate = "-" if r["ate_rmse_m"] is None else f"{r['ate_rmse_m'] * 1e3:.3f}"
        figures = f"{r['frames']:>7}{r['lost']:>6}{r['degenerate']:>6}{r['ms_median']:>8.1f}{r['ms_95']:>8.1f}"
        lines.append(f"{r['odometer']:<22}{figures}{ate:>10}")
    return "\n".join(lines)


def figure(run: Run):
    """Path (first camera's x and z) and residual over time; lost frames marked."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(11, 5), layout="constrained")
    FigureCanvasAgg(drawing)
    path, residual = drawing.subplots(1, 2)
    positions = run.trajectory.positions_m
    path.plot(positions[:, 0], positions[:, 2], color="#0072B2")
    path.set(title=run.name, xlabel="x [m]", ylabel="z [m]")
    path.set_aspect("equal", adjustable="datalim")
    stamps = np.array([f.stamp_s for f in run.frames])
    residual.plot(stamps, [f.result.residual for f in run.frames], color="#D55E00")
    for stamp_s in stamps[[f.lost for f in run.frames]]:
        residual.axvline(stamp_s, color="black", linewidth=0.6)
    residual.set(title="residual; lost frames black", xlabel="time [s]", ylabel="method's own unit")
    return drawing
