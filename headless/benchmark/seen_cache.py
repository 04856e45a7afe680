"""What a trajectory saw of a room, computed once for all cells of its sequences, clean and noisy: a file that its first cell writes and the others read."""

import hashlib
import json
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim.errors import WorkError
from iclnuim.formats.files import atomic_write, make_folder
from iclnuim.fusion.quality import Seen, SeenBy, what_was_seen
from iclnuim.fusion.settings import QualitySettings
from iclnuim.fusion.surface_error import TrueSurface

#: Of the file's content; more once what_was_seen() finds something else.
_VERSION = 2


def cached_seen(folder: Path, model: str, surface: TrueSurface, seen_by: SeenBy, settings: QualitySettings) -> Seen:
    """As what_was_seen(), of the file in `folder` that was written for this model (its name, which has its hash), camera, poses and settings.

    While one process computes it, others wait for it. Where it cannot be kept, it is computed for each.
    """
    views = SeenBy(seen_by.camera, seen_by.T_world_camera[:: settings.every])
    asked = json.dumps([_VERSION, model, asdict(views.camera), settings.to_dict()], sort_keys=True)
    key = hashlib.sha256(asked.encode() + views.T_world_camera.matrix.tobytes()).hexdigest()[:16]
    path = folder / f"{key}.npz"
    try:
        make_folder(folder)
        with _alone(path.with_suffix(".lock")):
            if (found := _read(path, views)) is None:
                found = what_was_seen(surface, seen_by, settings)
                _write(path, found)
            return found
    except (OSError, WorkError):
        return what_was_seen(surface, seen_by, settings)


def _read(path: Path, views: SeenBy) -> Seen | None:
    """None where it is not there, or not whole."""
    try:
        with np.load(path) as file:
            return Seen(file["points_m"], float(file["area_m2"]), views, file["depth_z_m"])
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def _write(path: Path, seen: Seen) -> None:
    content: dict[str, np.ndarray] = {
        "points_m": seen.points_m,
        "area_m2": np.array(seen.area_m2),
        "depth_z_m": seen.depth_z_m,
    }
    atomic_write(path, lambda temporary: np.savez(temporary, **content))


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """The system frees the lock of a process that was killed. Without such locks (Windows) two may compute the same."""
    with open(path, "w") as file:
        try:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        except ImportError:
            pass
        yield
