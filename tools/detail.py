"""What detail costs and what it gives: a room built at several levels, its depth and colour against those of the finest."""

from __future__ import annotations

import io
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from iclnuim import shipped
from iclnuim.blend.builder import build_scene
from iclnuim.blender import light_map, output, scene, surfaces, worker
from iclnuim.dataset.run_folder import read_run
from iclnuim.formats.exr import read_exr
from iclnuim.formats.trajectories import read_trajectory, write_trajectory
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.job import RenderJob
from iclnuim.raycast.caster import RayCaster
from iclnuim.sensor.transfer import srgb_from_light
from iclnuim.worker_events import Event, FrameDone

from .detail_colour import by_lamp

#: Depth beyond this is the painted surroundings: not a matter of triangles.
_FARTHEST_M = 15.0
#: A pixel off by more than this has another surface, or one with another form.
OFF_M = 0.005
Note = Callable[[str], None]


@dataclass(frozen=True)
class Light:
    """Of a lit level: seconds of its bake, seconds of a frame in Cycles (median)."""

    bake_s: float
    frame_s: float


@dataclass(frozen=True)
class Level:
    """A room at a level of detail. Depth errors against the finest level, in metres; off_share: of pixels off by more than OFF_M.

    frame_s: seconds of a frame by a lamp at the camera, one ray a pixel. psnr_db, median_of_255: its colour against the finest's; None for the finest.
    """

    detail: float
    triangles: int
    build_s: float
    mean_m: float
    p99_m: float
    off_share: float
    frame_s: float
    psnr_db: float | None = None
    median_of_255: float | None = None
    light: Light | None = None


def views_of(room: str, count: int) -> Trajectory:
    """`count` poses spread over the room's four shipped paths, 0.1 s apart, as a path of its own."""
    every = [read_trajectory(shipped.trajectory_file(f"{room}/{kt}")).trajectory for kt in shipped.TRAJECTORY_NAMES]
    R, t = (
        np.concatenate([getattr(path.T_world_camera, name) for path in every]) for name in ("rotation", "translation")
    )
    picked = np.linspace(0, len(t) - 1, count + 2).round().astype(int)[1:-1]
    return Trajectory(np.arange(count) / 10.0, SE3(R[picked], t[picked]))


class Room:
    """A shipped room at any level of detail, seen from the same places; files go to `folder`."""

    def __init__(self, name: str, views: Trajectory, camera: PinholeCamera, folder: Path, note: Note) -> None:
        self.name, self.views, self.camera, self.folder, self.note = name, views, camera, folder, note
        self._path = folder / "views.txt"
        write_trajectory(self._path, views, "tum")

    def build(self, detail: float) -> tuple[int, float]:
        """Into the session and a .blend; triangles, and seconds of processor time."""
        # the operator reports "Saved copy as ..." through Python's own stdout
        with output.blender_output_in(self.folder / "build.log"), redirect_stdout(io.StringIO()):
            scene.open_empty()
            begun = time.process_time()
            build_scene(self.name, detail=detail)
            seconds = time.process_time() - begun
            bpy.ops.wm.save_as_mainfile(filepath=str(self._blend(detail)), copy=True)
        return len(surfaces.triangles().triangles), seconds

    def depth(self) -> np.ndarray:
        """(n, h, w) planar metres of the scene in the session, by Embree."""
        found = surfaces.triangles()
        caster = RayCaster(found.vertices, found.triangles)
        poses = self.views.T_world_camera
        return np.stack([caster.depth(self.camera, poses[k]) for k in range(len(self.views))])

    def colour(self) -> tuple[np.ndarray, float]:
        """(n, h, w, 3) scene-linear of the scene in the session, by a lamp at the camera; seconds of a frame."""
        with output.blender_output_in(self.folder / "lamp.log"):
            return by_lamp(self.name, self.views, self.camera, self.folder)

    def lit(self, detail: float, map_size: int, map_samples: int) -> Light:
        """By baked light: seconds of the bake (as it was made), and of a frame."""
        job = RenderJob(
            f"{self.name}/views",
            str(self._blend(detail)),
            str(self._path),
            self.camera,
            map_size=map_size,
            map_samples=map_samples,
        )
        bake_s = light_map.read_recipe(worker.bake_light(job, lambda event: None)[0])["seconds"]
        _, frame_s = frames_of(job, self.folder / f"frames-{detail:g}-{map_size}")
        return Light(float(bake_s), frame_s)

    def _blend(self, detail: float) -> Path:
        return self.folder / f"{self.name}-{detail:g}.blend"


def race(
    room: str,
    levels: Sequence[float],
    lit: Sequence[float],
    views: int,
    camera: PinholeCamera,
    map_size: int,
    map_samples: int,
    note: Note,
    on_step: Callable[[], object],
) -> list[Level]:
    """All levels, coarsest first; those in `lit` with baked light too. The finest is what the others are held against."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Room(room, views_of(room, views), camera, Path(folder), note)
        found: list[Level] = []
        finest_z_m = finest_rgb = None
        for detail in sorted({*levels, *lit}, reverse=True):
            triangles, build_s = scene.build(detail)
            depth_z_m = scene.depth()
            finest_z_m = depth_z_m if finest_z_m is None else finest_z_m
            rgb, frame_s = scene.colour()
            psnr_db, off = (None, None) if finest_rgb is None else difference(rgb, finest_rgb)
            finest_rgb = rgb if finest_rgb is None else finest_rgb
            light = scene.lit(detail, map_size, map_samples) if detail in lit else None
            found.append(
                Level(detail, triangles, build_s, *depth_error(depth_z_m, finest_z_m), frame_s, psnr_db, off, light)
            )
            note(str(found[-1]))
            on_step()
    return found[::-1]


def frames_of(job: RenderJob, out: Path) -> tuple[np.ndarray, float]:
    """All frames of a job, (n, h, w, 3) scene-linear, and the median seconds of one in Cycles, the first left out."""
    times: list[float] = []

    def listen(event: Event) -> None:
        if isinstance(event, FrameDone):
            times.append(event.cycles or 0.0)

    with worker.Session(job, out, listen) as session:
        session.render("::", lambda: False)
    run = read_run(out)
    frames = [read_exr(run.frame_file(n)) for n in run.frame_numbers()]
    rgb = np.stack([np.stack([f[c] for c in "RGB"], -1) for f in frames]).astype(np.float32)
    return rgb, float(np.median(times[1:]))


def depth_error(depth_z_m: np.ndarray, finest_z_m: np.ndarray) -> tuple[float, float, float]:
    """Mean and 99th percentile of |dZ| in metres, and the share of pixels off by more than OFF_M, where both see the room."""
    both = (depth_z_m > 0) & (finest_z_m > 0) & (finest_z_m < _FARTHEST_M)
    off = np.abs(depth_z_m - finest_z_m)[both]
    return float(off.mean()), float(np.percentile(off, 99)), float((off > OFF_M).mean())


def difference(rgb: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Mean PSNR in dB over views (n, h, w, 3), and the median difference of a colour value, of 255; display values."""
    off = srgb_from_light(rgb) - srgb_from_light(other)
    square = np.maximum((off**2).mean((1, 2, 3)), 1e-9)
    return float(np.mean(-10 * np.log10(square))), float(255 * np.median(np.abs(off)))


def knee(cost: Sequence[float], error: Sequence[float]) -> int:
    """The point of a falling curve that lies farthest below the line from its first point to its last, both axes scaled to 0..1.

    Satopaa, Albrecht, Irwin, Raghavan: Finding a kneedle in a haystack, ICDCSW 2011.
    """
    x, y = (np.asarray(values, float) for values in (cost, error))
    x, y = ((v - v.min()) / max(float(np.ptp(v)), 1e-30) for v in (x, y))
    return int(np.argmax(1 - x - y))
