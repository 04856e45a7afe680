"""Measures one cell of the benchmark in a separate process: the motion, ATE and RPE, the surface
fused along it, its error, and two pictures.

    python -m iclnuim.benchmark.experiments.measure TASK.json

It writes a complete folder or none. On standard output it prints the number of frames done since
the last line. It ends when its parent ends.
"""

import json
import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from iclnuim.benchmark.fusion.settings import PRESETS, FuseSettings, QualitySettings
from iclnuim.dataset.frames import read_truth
from iclnuim.errors import IclnuimError, InputError, WorkError
from iclnuim.evaluation.absolute_error import AbsoluteError, ErrorStatistics, absolute_error
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.formats.files import atomic_write, whole_folder, write_json
from iclnuim.formats.trajectories import read_trajectory, write_trajectory
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

from .cells import Cell
from .seen_cache import cached_seen

if TYPE_CHECKING:
    from iclnuim.benchmark.fusion.mesh import Mesh

#: Minimum weight of a voxel for the mesh of a noisy sequence: its surface must be seen by this many
#: frames.
_MIN_NOISY_WEIGHT = 3.0
#: Limits of the heat maps' scale in mm. It is logarithmic and the same for all cells.
HEAT_MM = (0.1, 100.0)
#: Number of trajectory points stored for charts.
_DRAWN = 300
_WIDTH, _HEIGHT = 720, 540
_SECOND = RelativeErrorSettings(1.0, "seconds")


@dataclass(frozen=True)
class Task:
    """folder: the sequence. first: use only the first N frames. model: file with the room's
    triangles; None: no surface is measured.
    trajectory: file written by an external system; None: the cell's odometer estimates it. recipe:
    everything that decides the result. work: folder for data shared by cells, which can be
    recomputed.
    """

    cell: Cell
    folder: str
    out: str
    first: int | None
    model: str | None
    trajectory: str | None
    recipe: dict
    work: str

    @classmethod
    def read(cls, path: Path) -> "Task":
        content = json.loads(path.read_text("utf-8"))
        return cls(**{**content, "cell": Cell(**content["cell"])})


class Meter:
    """Reports the number of processed frames to the parent.

    The library calls it as `progress(total, label)`.
    """

    def __init__(self, total: int = 0, label: str = "") -> None:
        self.reported_s, self.done = 0.0, 0

    def advance(self, count: int = 1) -> None:
        self.done += count
        if time.monotonic() - self.reported_s > 0.5:
            self.flush()

    def flush(self) -> None:
        sys.stdout.write(f"{self.done}\n")
        sys.stdout.flush()
        self.reported_s, self.done = time.monotonic(), 0


def main(argv: list[str] | None = None) -> int:
    """Exit code 0, even if the odometer failed, as that is a result.

    Exit code 3, with a line on standard error, if nothing could be measured.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()
    task = Task.read(Path((argv or sys.argv[1:])[0]))
    try:
        measure(task, Meter())
    except (IclnuimError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 3
    return 0


def _end_with_parent() -> None:
    """End this process when standard input closes: it is a pipe that the parent keeps open while it
    runs.
    """
    while os.read(0, 1):
        pass
    os._exit(130)


def measure(task: Task, meter: Meter) -> None:
    """Write recipe.json, result.json, times.json (core-seconds, and ms per frame) and, if they
    exist, trajectory.txt, path.json, surface.jpg and heat.jpg.
    """
    with whole_folder(Path(task.out)) as folder:
        times: dict[str, float] = {}
        result: dict[str, Any] = {}
        truth = read_truth(Path(task.folder))
        if truth is None:
            raise InputError("a ground truth in the folder", path=task.folder, found="none")
        try:
            trajectory = _motion(task, truth, meter, result, times)
            write_trajectory(folder / "trajectory.txt", trajectory, "tum")
            error = absolute_error(truth, trajectory)
            result |= _trajectory_figures(truth, trajectory, error)
            write_json(folder / "path.json", _drawn(truth, trajectory, error, task.first))
            if task.model:
                result |= _surface(task, truth, trajectory, folder, meter, times)
        except (InputError, WorkError) as problem:
            result["failed"] = problem.worded() if isinstance(problem, InputError) else str(problem)
        meter.flush()
        write_json(folder / "recipe.json", task.recipe)
        write_json(folder / "result.json", {"cell": asdict(task.cell), **result})
        write_json(folder / "times.json", times | _usage())


def _usage() -> dict[str, float]:
    """Core-seconds and, where the system reports it, peak memory of this process."""
    found = {"cpu_s": time.process_time()}
    with suppress(ImportError):
        import resource

        found["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return found


def _motion(task: Task, truth: Trajectory, meter: Meter, result: dict, times: dict) -> Trajectory:
    """The estimated trajectory.

    The odometer's counts of frames (lost, degenerate ...) are added to `result`.
    """
    from iclnuim.benchmark.odometry.run import Sequence

    cell, sequence = task.cell, Sequence(task.folder)
    frames = min(len(sequence), task.first or len(sequence))
    if task.trajectory:
        trajectory = read_trajectory(task.trajectory).trajectory
        result |= {"frames": frames, "coverage": len(trajectory) / frames}
        return trajectory
    from iclnuim.benchmark.fusion.reference import make_reference
    from iclnuim.benchmark.odometry.registry import odometer
    from iclnuim.benchmark.odometry.run import run_together

    against = partial(make_reference, cell.reference, preset=cell.preset)
    started, one = time.process_time(), odometer(cell.odometer, cell.preset)
    run = run_together(
        [one], sequence, progress=lambda *about: meter, frames=task.first, against=against
    )[0]
    figures = run.to_dict()
    times |= {
        "track_s": time.process_time() - started,
        "ms_median": figures["ms_median"],
        "ms_95": figures["ms_95"],
    }
    result |= {
        name: figures[name]
        for name in ("frames", "lost", "coverage", "not_converged", "degenerate")
    }
    return run.trajectory


def _trajectory_figures(truth: Trajectory, trajectory: Trajectory, error: AbsoluteError) -> dict:
    """Six statistics of the ATE after SE(3) alignment, and of the RPE over one second (None if the
    trajectory is shorter).
    """
    try:
        rpe = relative_error(truth, trajectory, _SECOND).translation_m.to_dict()
    except InputError:
        rpe = None
    return {"ate_m": error.translation_m.to_dict(), "rpe_1s_m": rpe}


def _drawn(
    truth: Trajectory, trajectory: Trajectory, error: AbsoluteError, first: int | None
) -> dict:
    """Data for charts, of some of the frames: positions of truth and estimate in metres, and the
    error in metres over time.
    """
    rows = np.unique(np.linspace(0, len(error.stamps_s) - 1, _DRAWN).astype(int))
    until = np.searchsorted(truth.stamps_s, error.stamps_s[-1], side="right")
    whole = truth.positions_m[: until if first else None]
    shown = np.unique(np.linspace(0, len(whole) - 1, _DRAWN).astype(int))
    return {
        "stamps_s": np.round(error.stamps_s[rows], 4).tolist(),
        "truth_m": np.round(whole[shown], 4).tolist(),
        "estimate_m": np.round(error.aligned.translation[rows], 4).tolist(),
        "error_m": np.round(error.translation_error_m[rows], 6).tolist(),
    }


def _surface(
    task: Task, truth: Trajectory, trajectory: Trajectory, folder: Path, meter: Meter, times: dict
) -> dict[str, Any]:
    """Fuse the surface along the estimate and measure it, aligned with the model by the first pose,
    and by ICP as in the paper.
    """
    from iclnuim.benchmark.fusion.mesh import fuse_sequence
    from iclnuim.benchmark.fusion.quality import SeenBy, surface_quality
    from iclnuim.benchmark.fusion.surface_error import TrueSurface, first_poses_transform

    started = time.process_time()
    fused = fuse_sequence(task.folder, trajectory, fuse_settings(task), lambda *about: meter)
    times["fuse_s"] = time.process_time() - started
    started = time.process_time()
    with np.load(str(task.model)) as model:
        surface = TrueSurface(model["points"], model["triangles"])
    points = fused.mesh.points.astype(float)
    T_given = first_poses_transform(trajectory, truth)
    given_m = surface.distance(T_given.apply(points))
    result: dict[str, Any] = {
        "given_m": ErrorStatistics.of(given_m).to_dict(),
        "vertices": len(points),
    }
    T, distances_m = T_given, given_m
    try:
        T = surface.aligned(points, T_given)
        distances_m = surface.distance(T.apply(points))
        result |= _motion_of_fit(T @ T_given.inverse(), T_given.apply(points.mean(0)))
    except InputError as problem:
        result["not_fitted"] = problem.worded()
    result["fitted_m"] = ErrorStatistics.of(distances_m).to_dict()
    seen_by = SeenBy(fused.camera.pinhole, truth.T_world_camera[: task.first])
    settings = QualitySettings()
    seen = cached_seen(
        Path(task.work) / "seen", Path(str(task.model)).name, surface, seen_by, settings
    )
    quality = surface_quality(
        surface, points, fused.mesh.triangles, T_given, seen, settings=settings
    )
    result["quality"] = quality.to_dict()
    _draw(folder, fused.mesh, T.apply(points), distances_m)
    times["surface_s"] = time.process_time() - started
    return {"surface": result}


def fuse_settings(task: Task) -> FuseSettings:
    """The fusion settings: the volume by the cell's preset, `min_weight` by its noise."""
    volume = PRESETS.get(task.cell.preset, PRESETS["best"])
    min_weight = _MIN_NOISY_WEIGHT if task.cell.noise == "noisy" else FuseSettings().min_weight
    return FuseSettings(volume, min_weight, f":{task.first or ''}")


def _motion_of_fit(T: SE3, middle: np.ndarray) -> dict[str, float]:
    """By how much a fit translated the centre of the surface, and rotated it."""
    moved_m = float(np.linalg.norm(T.apply(middle) - middle))
    return {"fit_moved_m": moved_m, "fit_turned_deg": float(np.degrees(so3.angle(T.rotation)))}


def _draw(folder: Path, mesh: "Mesh", points: np.ndarray, distances_m: np.ndarray) -> None:
    """surface.jpg in the fused colours, heat.jpg by the distance."""
    from iclnuim.benchmark.fusion.pictures import heat_colours, picture

    heat = heat_colours(distances_m * 1e3, *HEAT_MM)
    for name, colours in (("surface", mesh.colours), ("heat", heat)):
        image = picture(points, mesh.triangles, colours, _WIDTH, _HEIGHT)
        atomic_write(folder / f"{name}.jpg", _jpeg(image))


def _jpeg(image: np.ndarray) -> Callable[[Path], object]:
    import cv2

    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    return lambda path: path.write_bytes(data)


if __name__ == "__main__":
    sys.exit(main())
