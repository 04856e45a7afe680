"""Caches which part of a room a trajectory saw.

The first cell of a sequence writes the file; the other cells, clean and noisy, read it.
"""

import hashlib
import json
import zipfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim.benchmark.fusion.quality import SeenBy, SeenSurface, what_was_seen
from iclnuim.benchmark.fusion.settings import QualitySettings
from iclnuim.benchmark.fusion.surface_error import TrueSurface
from iclnuim.errors import WorkError
from iclnuim.formats.files import atomic_write, locked, make_folder

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
