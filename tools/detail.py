"""Measures cost and benefit of detail: a room is built at several levels, and its depth and colour
are compared with those of the finest level.
"""

import io
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from iclnuim import shipped
from iclnuim.blend.builder import build_scene
from iclnuim.blender import surfaces
from iclnuim.blender.light import light_files
from iclnuim.blender.open import scene
from iclnuim.blender.render.job_scene import JobScene
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.job import RenderJob
from iclnuim.native_output import native_output_in
from iclnuim.raycast.caster import RayCaster
from iclnuim.sensor.transfer import srgb_from_light
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

from .detail_colour import by_lamp
from .rendered import psnr_db, rendered

#: Depth beyond this is the painted surroundings, which do not depend on triangles.
_MAX_DEPTH_M = 15.0
#: A pixel with a larger error shows another surface, or one of another shape.
OFF_M = 0.005
#: Samples of the light map of a lit level.
_MAP_SAMPLES = 2


@dataclass(frozen=True)
class Light:
    """Times of a level with baked light: seconds of the bake, and median seconds per frame in
    Cycles.
    """

    bake_s: float
    frame_s: float


@dataclass(frozen=True)
class DetailLevel:
    """A room at a level of detail. mean_m, p99_m: depth errors against the finest level. off_share:
    share of pixels with an error beyond OFF_M.

    frame_s: seconds per frame lit by a lamp at the camera, one ray per pixel. psnr_db,
    median_of_255: colour against that of the finest level; None for the finest.
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
    """A trajectory of `count` poses, spread over the room's four shipped trajectories, with stamps
    0.1 s apart.
    """
    files = [shipped.trajectory_file(f"{room}/{kt}") for kt in shipped.TRAJECTORY_NAMES]
    poses = [read_trajectory(file).trajectory.T_world_camera for file in files]
    R = np.concatenate([T.rotation for T in poses])
    t = np.concatenate([T.translation for T in poses])
    picked = np.linspace(0, len(t) - 1, count + 2).round().astype(int)[1:-1]
    return Trajectory(np.arange(count) / 10.0, SE3(R[picked], t[picked]))


class Room:
    """A shipped room at any level of detail, seen from the same poses.

    Files are written to `folder`.
    """

    def __init__(self, name: str, views: Trajectory, camera: PinholeCamera, folder: Path) -> None:
        self.name = name
        self.views = views
        self.camera = camera
        self.folder = folder
        self._path = folder / "views.txt"
        write_trajectory(self._path, views, "tum")

    def build(self, detail: float) -> tuple[int, float]:
        """Build the room in the session, and save it as a .blend; returns triangles and seconds of
        processor time.
        """
        # the operator reports "Saved copy as ..." through Python's own stdout
        with native_output_in(self.folder / "build.log"), redirect_stdout(io.StringIO()):
            scene.open_empty()
            begun = time.process_time()
            build_scene(self.name, detail=detail)
            seconds = time.process_time() - begun
            bpy.ops.wm.save_as_mainfile(filepath=str(self._blend(detail)), copy=True)
        return len(surfaces.triangles().triangles), seconds

    def depth(self) -> np.ndarray:
        """(n, h, w) planar depth in metres of the scene in the session, by Embree."""
        found = surfaces.triangles()
        caster = RayCaster(found.vertices, found.triangles)
        poses = self.views.T_world_camera
        return np.stack([caster.depth(self.camera, poses[k]) for k in range(len(self.views))])

    def colour(self) -> tuple[np.ndarray, float]:
        """(n, h, w, 3) scene-linear colour of the scene in the session, lit by a lamp at the
        camera, and seconds per frame.
        """
        with native_output_in(self.folder / "lamp.log"):
            return by_lamp(self.name, self.views, self.camera, self.folder)

    def lit(self, detail: float) -> Light:
        """Times with baked light: seconds of the bake, as recorded then, and per frame."""
        job = RenderJob(
            f"{self.name}/views",
            str(self._blend(detail)),
            str(self._path),
            self.camera,
            map_samples=_MAP_SAMPLES,
        )
        bake_s = light_files.read_recipe(JobScene(job, lambda event: None).bake()[0])["seconds"]
        frame_s = rendered(job, self.folder / f"frames-{detail:g}")[-1]
        return Light(float(bake_s), frame_s)

    def _blend(self, detail: float) -> Path:
        return self.folder / f"{self.name}-{detail:g}.blend"


def measure_levels(
    room: Room,
    levels: Sequence[float],
    lit: Sequence[float],
    on_level: Callable[[DetailLevel], None],
) -> list[DetailLevel]:
    """Measure all levels, coarsest first; those in `lit` also with baked light.

    The others are compared with the finest level.
    """
    found: list[DetailLevel] = []
    finest_z_m = finest_rgb = None
    for detail in sorted({*levels, *lit}, reverse=True):
        triangles, build_s = room.build(detail)
        depth_z_m = room.depth()
        rgb, frame_s = room.colour()
        psnr_db = median_of_255 = None
        if finest_z_m is None or finest_rgb is None:
            finest_z_m = depth_z_m
            finest_rgb = rgb
        else:
            psnr_db, median_of_255 = difference(rgb, finest_rgb)
        mean_m, p99_m, off_share = depth_error(depth_z_m, finest_z_m)
        level = DetailLevel(
            detail=detail,
            triangles=triangles,
            build_s=build_s,
            mean_m=mean_m,
            p99_m=p99_m,
            off_share=off_share,
            frame_s=frame_s,
            psnr_db=psnr_db,
            median_of_255=median_of_255,
            light=room.lit(detail) if detail in lit else None,
        )
        on_level(level)
        found.append(level)
    return found[::-1]


def depth_error(depth_z_m: np.ndarray, finest_z_m: np.ndarray) -> tuple[float, float, float]:
    """Mean and 99th percentile of |dZ| in metres, and the share of pixels with an error beyond
    OFF_M, over pixels where both see the room.
    """
    both = (depth_z_m > 0) & (finest_z_m > 0) & (finest_z_m < _MAX_DEPTH_M)
    off = np.abs(depth_z_m - finest_z_m)[both]
    return float(off.mean()), float(np.percentile(off, 99)), float((off > OFF_M).mean())


def difference(rgb: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Mean PSNR in dB over views (n, h, w, 3), and the median difference of colour values, 0..255;
    both of display values.
    """
    off = srgb_from_light(rgb) - srgb_from_light(other)
    decibels = psnr_db((off**2).mean((1, 2, 3)))
    return float(np.mean(decibels)), float(255 * np.median(np.abs(off)))


def knee(cost: Sequence[float], error: Sequence[float]) -> int:
    """Index of the point of a falling curve that is farthest below the line from its first point to
    its last, with both axes scaled to 0..1.

    Satopaa, Albrecht, Irwin, Raghavan: Finding a kneedle in a haystack, ICDCSW 2011.
    """
    x = np.asarray(cost, float)
    y = np.asarray(error, float)
    x = (x - x.min()) / max(float(np.ptp(x)), 1e-30)
    y = (y - y.min()) / max(float(np.ptp(y)), 1e-30)
    return int(np.argmax(1 - x - y))
