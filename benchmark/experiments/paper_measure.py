"""Measures one cell of the paper's experiments: the motion, ATE and RPE, the surface fused along
it, its error, and two pictures.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from iclnuim.benchmark.fusion.settings import PRESETS, FuseSettings, QualitySettings
from iclnuim.dataset.frames import read_truth
from iclnuim.errors import InputError, WorkError
from iclnuim.evaluation.absolute_error import AbsoluteError, ErrorStatistics, absolute_error
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.formats.files import atomic_write
from iclnuim.formats.trajectories import read_trajectory, write_trajectory
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

from .paper_keys import PaperKey
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
_WIDTH = 720
_HEIGHT = 540
_SECOND = RelativeErrorSettings(1.0, "seconds")


@dataclass(frozen=True)
class PaperTask:
    """folder: the sequence. first: use only the first N frames. model: file with the room's
    triangles; None: no surface is measured. trajectory: file written by an external system; None:
    the cell's odometer estimates it. work: folder for data shared by cells, which can be
    recomputed.
    """

    key: PaperKey
    folder: Path
    first: int | None
    model: Path | None
    trajectory: Path | None
    work: Path


class Meter:
    """The library's progress display, which it calls as `progress(total, label)`."""

    def __init__(self, advance: Callable[[int], object]) -> None:
        self._advance = advance

    def __call__(self, total: int = 0, label: str = "") -> "Meter":
        return self

    def advance(self, count: int = 1) -> None:
        self._advance(count)


def measure(task: PaperTask, folder: Path, advance: Callable[[int], object]) -> dict[str, Any]:
    """The figures of a cell, with `times` (core-seconds, and ms per frame) and `path`, data for
    charts; if the odometer failed, with the reason as `failed`.

    Writes trajectory.txt and, with a surface, surface.jpg and heat.jpg into the folder.
    """
    started = time.process_time()
    times: dict[str, float] = {}
    figures: dict[str, Any] = {}
    truth = read_truth(task.folder)
    if truth is None:
        raise InputError("a ground truth in the folder", path=task.folder, found="none")
    try:
        trajectory = _motion(task, Meter(advance), figures, times)
        write_trajectory(folder / "trajectory.txt", trajectory, "tum")
        error = absolute_error(truth, trajectory)
        figures |= _trajectory_figures(truth, trajectory, error)
        figures["path"] = _drawn(truth, error, task.first)
        if task.model:
            figures["surface"] = _surface(task, truth, trajectory, folder, Meter(advance))
            times |= figures["surface"].pop("times")
    except (InputError, WorkError) as problem:
        figures["failed"] = problem.worded()
    return {**figures, "times": times | {"cpu_s": time.process_time() - started}}


def _motion(
    task: PaperTask, meter: Meter, figures: dict[str, Any], times: dict[str, float]
) -> Trajectory:
    """The estimated trajectory.

    The odometer's counts of frames (lost, degenerate ...) are added to the figures.
    """
    from iclnuim.benchmark.odometry.run import Sequence, run_odometers

    key = task.key
    sequence = Sequence(task.folder)
    if task.trajectory:
        frames = min(len(sequence), task.first or len(sequence))
        trajectory = read_trajectory(task.trajectory).trajectory
        figures |= {"frames": frames, "coverage": len(trajectory) / frames}
        return trajectory
    from iclnuim.benchmark.fusion.reference import make_reference
    from iclnuim.benchmark.odometry.registry import odometer

    against = partial(make_reference, key.reference, preset=key.preset)
    started = time.process_time()
    odometers = [odometer(key.odometer, key.preset)]
    (run,) = run_odometers(odometers, sequence, progress=meter, frames=task.first, against=against)
    found = run.to_dict()
    times["track_s"] = time.process_time() - started
    times |= {name: found[name] for name in ("ms_median", "ms_95")}
    counts = ("frames", "lost", "coverage", "not_converged", "degenerate")
    figures |= {name: found[name] for name in counts}
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


def _drawn(truth: Trajectory, error: AbsoluteError, first: int | None) -> dict[str, Any]:
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
    task: PaperTask, truth: Trajectory, trajectory: Trajectory, folder: Path, meter: Meter
) -> dict[str, Any]:
    """Fuse the surface along the estimate and measure it, aligned with the model by the first pose,
    and by ICP as in the paper.
    """
    from iclnuim.benchmark.fusion.alignment import first_poses_transform
    from iclnuim.benchmark.fusion.quality import SeenBy, surface_quality
    from iclnuim.benchmark.fusion.sequence import fuse_sequence
    from iclnuim.benchmark.fusion.surface_error import TrueSurface

    started = time.process_time()
    fused = fuse_sequence(task.folder, trajectory, fuse_settings(task.key, task.first), meter)
    fused_s = time.process_time()
    with np.load(str(task.model)) as model:
        surface = TrueSurface(model["points"], model["triangles"])
    points = fused.mesh.points.astype(float)
    T_given = first_poses_transform(trajectory, truth)
    given_m = surface.distance(T_given.apply(points))
    found: dict[str, Any] = {
        "given_m": ErrorStatistics.of(given_m).to_dict(),
        "vertices": len(points),
    }
    T = T_given
    distances_m = given_m
    try:
        T = surface.aligned(points, T_given)
        distances_m = surface.distance(T.apply(points))
        found |= _motion_of_fit(T @ T_given.inverse(), T_given.apply(points.mean(0)))
    except InputError as problem:
        found["not_fitted"] = problem.worded()
    found["fitted_m"] = ErrorStatistics.of(distances_m).to_dict()
    seen_by = SeenBy(fused.camera.pinhole, truth.T_world_camera[: task.first])
    settings = QualitySettings()
    model_name = Path(str(task.model)).name
    seen = cached_seen(task.work / "seen", model_name, surface, seen_by, settings)
    triangles = fused.mesh.triangles
    quality = surface_quality(surface, points, triangles, T_given, seen, settings=settings)
    found["quality"] = quality.to_dict()
    _draw(folder, fused.mesh, T.apply(points), distances_m)
    times = {"fuse_s": fused_s - started, "surface_s": time.process_time() - fused_s}
    return {**found, "times": times}


def fuse_settings(key: PaperKey, first: int | None) -> FuseSettings:
    """The fusion settings: the volume by the cell's preset, `min_weight` by its noise."""
    volume = PRESETS.get(key.preset, PRESETS["best"])
    min_weight = _MIN_NOISY_WEIGHT if key.noise == "noisy" else FuseSettings().min_weight
    return FuseSettings(volume, min_weight, f":{first or ''}")


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
