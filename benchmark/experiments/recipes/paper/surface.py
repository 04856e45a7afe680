"""Measures the surface of a cell of the paper's experiments: it is fused along the estimate and
compared with the model; two pictures show it.
"""

import hashlib
import json
import time
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.benchmark.fusion.alignment import first_poses_transform
from iclnuim.benchmark.fusion.mesh import Mesh
from iclnuim.benchmark.fusion.pictures import heat_colours, picture
from iclnuim.benchmark.fusion.quality import SeenBy, SeenSurface, surface_quality, what_was_seen
from iclnuim.benchmark.fusion.sequence import fuse_sequence
from iclnuim.benchmark.fusion.settings import QualitySettings
from iclnuim.benchmark.fusion.surface_error import TrueSurface
from iclnuim.errors import InputError, WorkError
from iclnuim.evaluation.absolute_error import ErrorStatistics
from iclnuim.formats.files import atomic_write, locked, make_folder
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

from .keys import HEAT_MM, Meter, PaperTask, fuse_settings

_WIDTH = 720
_HEIGHT = 540


def measure_surface(
    task: PaperTask, truth: Trajectory, trajectory: Trajectory, folder: Path, meter: Meter
) -> dict[str, Any]:
    """Fuse the surface along the estimate and measure it, aligned with the model by the first pose,
    and by ICP as in the paper.
    """
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


def _motion_of_fit(T: SE3, middle: np.ndarray) -> dict[str, float]:
    """By how much a fit translated the centre of the surface, and rotated it."""
    moved_m = float(np.linalg.norm(T.apply(middle) - middle))
    return {"fit_moved_m": moved_m, "fit_turned_deg": float(np.degrees(so3.angle(T.rotation)))}


def _draw(folder: Path, mesh: Mesh, points: np.ndarray, distances_m: np.ndarray) -> None:
    """surface.jpg in the fused colours, heat.jpg by the distance."""
    heat = heat_colours(distances_m * 1e3, *HEAT_MM)
    for name, colours in (("surface", mesh.colours), ("heat", heat)):
        image = picture(points, mesh.triangles, colours, _WIDTH, _HEIGHT)
        atomic_write(folder / f"{name}.jpg", _jpeg(image))


def _jpeg(image: np.ndarray) -> Callable[[Path], object]:
    import cv2

    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    return lambda path: path.write_bytes(data)


# -- what a trajectory saw of a room: the first cell of a sequence writes it, the others read it

#: Version of the file's content; increase it when the result of what_was_seen() changes.
_VERSION = 2


def cached_seen(
    folder: Path, model: str, surface: TrueSurface, seen_by: SeenBy, settings: QualitySettings
) -> SeenSurface:
    """The result of what_was_seen(), read from the file in `folder` for this model (its name
    contains its hash), camera, poses and settings.

    While one process computes it, other processes wait. If it cannot be stored, each process
    computes it.
    """
    views = SeenBy(seen_by.camera, seen_by.T_world_camera[:: settings.every])
    inputs = json.dumps([_VERSION, model, asdict(views.camera), settings.to_dict()], sort_keys=True)
    key = hashlib.sha256(inputs.encode() + views.T_world_camera.matrix.tobytes()).hexdigest()[:16]
    path = folder / f"{key}.npz"
    try:
        make_folder(folder)
        lock = path.with_suffix(".lock")
        lock.touch()
        with locked(
            lock, wait=True
        ):  # where there are no such locks, two processes may compute the same result
            if (found := _read(path, views)) is None:
                found = what_was_seen(surface, seen_by, settings)
                _write(path, found)
            return found
    except (OSError, WorkError):
        return what_was_seen(surface, seen_by, settings)


def _read(path: Path, views: SeenBy) -> SeenSurface | None:
    """The stored result; None if the file is missing or incomplete."""
    try:
        with np.load(path) as file:
            return SeenSurface(file["points_m"], float(file["area_m2"]), views, file["depth_z_m"])
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def _write(path: Path, seen: SeenSurface) -> None:
    content: dict[str, np.ndarray] = {
        "points_m": seen.points_m,
        "area_m2": np.array(seen.area_m2),
        "depth_z_m": seen.depth_z_m,
    }
    atomic_write(path, lambda temporary: np.savez(temporary, **content))
