"""Which light map belongs to which scene file, noted in the cache: so a window can tell without opening the scene."""

from __future__ import annotations

import functools
import hashlib
import json
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from .. import __version__
from ..errors import IclnuimError
from ..formats.files import read_bytes, read_json, sha256, write_json
from ..job import RenderJob
from . import compat, light_map, scene


@dataclass(frozen=True)
class KnownMap:
    """A light map in the cache: its folder, size on disk in bytes, age in seconds."""

    folder: Path
    size_bytes: int
    age_s: float


def note(cache: Path, job: RenderJob, folder: Path) -> None:
    """Remember that `folder` holds the light of the job's scene. A cache that cannot be written stays without the note."""
    with suppress(IclnuimError, OSError):
        (cache / "light/known").mkdir(parents=True, exist_ok=True)
        write_json(_note_file(cache, job), {"map": folder.name})


def find(cache: Path, job: RenderJob) -> KnownMap | None:
    """The map noted for the job's scene, settings and Blender; None where there is none, or not any more."""
    try:
        folder = cache / "light" / str(read_json(_note_file(cache, job))["map"])
        if not light_map.is_whole(folder):
            return None
        files = [path.stat() for path in folder.iterdir()]
    except (IclnuimError, OSError, KeyError):
        return None
    return KnownMap(folder, sum(f.st_size for f in files), time.time() - max(f.st_mtime for f in files))


def _note_file(cache: Path, job: RenderJob) -> Path:
    decides = [
        _scene_hash(job.scene),
        job.reading.to_dict(),
        job.map_size,
        job.map_samples,
        job.seed,
        job.lambertian,
        compat.version_line(),
        __version__,
    ]
    return cache / "light/known" / f"{hashlib.sha256(json.dumps(decides).encode()).hexdigest()[:20]}.json"


def _scene_hash(name: str) -> str:
    """Of the scene's own file alone: what lies beside it is known only once it is open."""
    if scene.is_shipped(name):
        return _shipped_hash(name)
    path = Path(name)
    return _file_hash(path, path.stat().st_mtime_ns)


@functools.lru_cache(maxsize=4)
def _shipped_hash(name: str) -> str:
    return scene.scene_sha256(name)


@functools.lru_cache(maxsize=4)
def _file_hash(path: Path, changed_ns: int) -> str:
    return sha256(read_bytes(path))
