"""Simulations of a user-provided scene: rigid bodies, cloth, soft bodies, particles, dynamic hair,
dynamic paint, simulation zones.

A simulated frame depends on those before it. They are baked once, up to the last frame of a run,
and kept as a copy of the scene in the cache, so that a frame is the same whichever others a process
renders. A longer run bakes them again, to the same frames.
"""

import hashlib
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
from bpy.types import Object, PointCache, Scene

from ... import shipped
from ...errors import InputError, WorkError
from ...formats.files import locked
from .. import compat, surfaces
from ..notes import names_of
from . import scene_paths
from .run_frames import RunFrames
from .simulated import caches, dynamic_hair, evaluated_objects, packed_zones, unbaked_zones

#: Version of the copies: raise it if the same scene is baked otherwise.
_VERSION = 1
#: Bytes of a vertex or particle in a frame of a cache: position, velocity and rotation, at most.
_POINT_BYTES = 64
#: Frames that are evaluated to estimate the time of a bake; the first also prepares the scene.
_TIMED = 3
#: Progress of a bake is reported this often.
_REPORT_S = 10.0


def baked(path: Path, run: RunFrames) -> tuple[Path | None, list[str]]:
    """Bake the simulations of the open scene for a run, unless a copy with them is in the cache.
    Returns the copy to be opened instead, and notes. There is none without simulations, and where
    the cache cannot be written: then the open scene is baked.

    Raises InputError for what Blender cannot bake, WorkError if it needs more than the free disk.
    """
    scene = bpy.context.scene
    with surfaces.as_rendered(scene):
        zones = list(unbaked_zones(scene, packed_zones(path)))
        names = {thing.name for thing, cache in caches(scene) if not cache.is_baked}
        names |= {thing.name for thing in evaluated_objects(scene) if dynamic_hair(thing)}
    names |= {thing.name for thing, _ in zones}
    if not names:
        return None, []
    bake = _Bake(path, run, names, zones)
    decides = [str(path), scene_paths.sha256(path), compat.version_line(), _VERSION]
    key = hashlib.sha256(repr(decides).encode()).hexdigest()[:20]
    folder = shipped.cache_folder() / "simulations" / key
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    if not folder.is_dir():
        return None, [bake.make()]
    with locked(folder, wait=True):
        if (copy := _shortest(folder, run.last)) is not None:
            return copy, []
        _check_space(folder, bake.bytes)
        note = bake.make()
        copy = folder / f"{run.last}.blend"
        try:
            _save(copy)
        except (OSError, RuntimeError):
            return None, [note]
        return copy, [f"{note}, {copy.stat().st_size / 1e6:.1f} MB in the cache"]


def _shortest(folder: Path, last: int) -> Path | None:
    """The smallest copy that is baked up to frame `last` at least."""
    ends = [int(file.stem) for file in folder.glob("*.blend") if file.stem.isdigit()]
    enough = [end for end in ends if end >= last]
    return folder / f"{min(enough)}.blend" if enough else None


def _check_space(folder: Path, need: int) -> None:
    free = shutil.disk_usage(folder).free
    if need > free:
        space = f"need up to {need / 1e9:.2f} GB, {free / 1e9:.2f} GB are free"
        raise WorkError(f"{folder}: simulations {space}", hint="fewer {frames}")


def _save(copy: Path) -> None:
    """Save the open scene as `copy`, whose references are absolute; complete or not at all."""
    bpy.ops.file.make_paths_absolute()
    for thing in bpy.data.objects:
        for modifier in thing.modifiers:
            if modifier.type == "NODES" and modifier.bake_directory:
                modifier.bake_directory = bpy.path.abspath(modifier.bake_directory)
    for leftover in copy.parent.glob("*.tmp.blend"):  # of a process that was killed
        leftover.unlink()
    part = copy.with_name(f"{copy.stem}-{os.getpid()}.tmp.blend")
    try:
        bpy.ops.wm.save_as_mainfile(
            filepath=str(part), copy=True, compress=True, relative_remap=False
        )
        os.replace(part, copy)
    finally:
        part.unlink(missing_ok=True)


@dataclass(frozen=True)
class _Bake:
    """Bakes the simulations of the open scene, of the objects `names`, in memory."""

    path: Path
    run: RunFrames
    names: set[str]
    zones: list[tuple[Object, Any]]

    @property
    def bytes(self) -> int:
        """The size of all caches, at most."""
        points = 0
        with surfaces.as_rendered(bpy.context.scene) as depsgraph:
            for name in self.names:
                evaluated = bpy.data.objects[name].evaluated_get(depsgraph)
                points += len(getattr(evaluated.data, "vertices", ())) or 1
                points += sum(system.settings.count for system in evaluated.particle_systems)
        return points * (self.run.last + 1) * _POINT_BYTES

    def make(self) -> str:
        """Bake. Returns a note. Raises InputError for what Blender cannot bake."""
        begun = time.perf_counter()
        scene = bpy.context.scene
        last = self.run.last + 1  # exposures reach beyond the last frame
        end = max(scene.frame_start, last)  # particles and zones end there
        with surfaces.as_rendered(scene), compat.temporarily(scene, frame_end=end):
            with self._progress(scene):
                left = _bake_caches(scene, last) | _bake_hair(scene, last)
                left |= _bake_zones(self.zones)
            left |= {thing.name for thing, cache in caches(scene) if not cache.is_baked}
        if left:
            hint = "baking them in Blender (Scene > Bake All Dynamics) and saving the file"
            wanted = "simulations that can be baked"
            raise InputError(wanted, path=self.path, found=names_of(left), hint=hint)
        seconds = time.perf_counter() - begun
        return f"{self._label}: baked up to frame {self.run.last} in {seconds:.1f} s"

    @property
    def _label(self) -> str:
        return f"simulations ({names_of(self.names)})"

    @contextmanager
    def _progress(self, scene: Scene) -> Iterator[None]:
        """Report the time and the size before the block, and the time left during it."""
        first = scene.frame_start
        per_frame_s = _seconds_a_frame(scene)
        hair = sum(len(dynamic_hair(thing)) for thing in evaluated_objects(scene))
        rounds = hair + bool(self.zones) + any(caches(scene))
        frames = rounds * max(1, self.run.last - first + 1)
        megabytes = max(0.1, self.bytes / 1e6)
        seconds = max(1.0, per_frame_s * frames)
        self.run.begin(seconds)
        takes = f"about {seconds:.0f} s and up to {megabytes:.1f} MB"
        self.run.report(f"{self._label}: a bake up to frame {self.run.last} takes {takes}")
        begun = reported = time.monotonic()
        done = 0

        def advance(*_: object) -> None:
            nonlocal done, reported
            done += 1
            now = time.monotonic()
            if now - reported > _REPORT_S:
                reported = now
                left_s = (now - begun) / done * max(0, frames - done)
                self.run.report(f"simulations: {done}/{frames} frames, {left_s:.0f} s left")

        bpy.app.handlers.frame_change_post.append(advance)
        try:
            yield
        finally:
            bpy.app.handlers.frame_change_post.remove(advance)


def _seconds_a_frame(scene: Scene) -> float:
    """The time that a frame takes, from the first ones."""
    before = scene.frame_current
    for frame in range(scene.frame_start, scene.frame_start + _TIMED):
        begun = time.perf_counter()
        scene.frame_set(frame)
    seconds = time.perf_counter() - begun
    scene.frame_set(before)
    return seconds


def _bake_caches(scene: Scene, last: int) -> set[str]:
    """Bake all point caches up to frame `last`. Returns names of objects whose are not baked."""
    for _, cache in caches(scene):
        _open_until(cache, last)
    bpy.ops.ptcache.bake_all(bake=True)
    return {thing.name for thing, cache in caches(scene) if not cache.is_baked}


def _open_until(cache: PointCache, last: int) -> None:
    """Keep a cache in memory, up to frame `last` unless it is baked."""
    if cache.use_disk_cache:
        cache.use_disk_cache = False  # also reads a finished cache into memory
    if not cache.is_baked:
        cache.frame_end = max(cache.frame_start + 1, last)


def _bake_hair(scene: Scene, last: int) -> set[str]:
    """Fill the caches of dynamic hair. Returns names of objects with others.

    Blender does not draw baked hair from a file; hair in a cache that is full but not called baked,
    it does.
    """
    left = set()
    for thing in evaluated_objects(scene):
        for system in dynamic_hair(thing):
            cache = system.cloth.point_cache
            _open_until(cache, last)
            with bpy.context.temp_override(object=thing, point_cache=cache):
                if not cache.is_baked:
                    bpy.ops.ptcache.bake(bake=True)
                if not cache.is_baked:
                    left.add(thing.name)
                bpy.ops.ptcache.free_bake()
    return left


def play_hair(scene: Scene, last: int) -> None:
    """Show all frames up to the one after `last` once, if there is dynamic hair: Blender 5.2 reads
    the cache of its frames in their order only.
    """
    if not any(map(dynamic_hair, evaluated_objects(scene))):
        return
    before = scene.frame_current
    for frame in range(last + 2):
        scene.frame_set(frame)
    scene.frame_set(before)


def _bake_zones(zones: list[tuple[Object, Any]]) -> set[str]:
    """Bake simulation zones, over the timeline. Returns names of objects with zones not baked."""
    things = [thing for thing, _ in zones]
    for thing, modifier in zones:
        if not hasattr(modifier, "bake_target"):  # before Blender 4.3
            return {thing.name}
        modifier.bake_target = "PACKED"
        for entry in modifier.bakes:
            entry.bake_target = "INHERIT"
    if things:
        with bpy.context.temp_override(selected_objects=things, object=things[0]):
            bpy.ops.object.simulation_nodes_cache_bake(selected=True)
    return set()
