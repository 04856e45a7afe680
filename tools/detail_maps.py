"""Measures the benefit of larger light maps: frames of a shipped room with maps of several sizes,
compared with those of the largest.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from iclnuim.blender.light import light_files
from iclnuim.blender.render.job_scene import JobScene
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.job import RenderJob
from iclnuim.trajectory_files.trajectories import write_trajectory

from .detail import difference, views_of
from .rendered import rendered

#: Samples of every light map.
_SAMPLES = 32


@dataclass(frozen=True)
class MapSize:
    """size: width and height in texels. bake_s: recorded when it was baked. psnr_db, median_of_255:
    errors against the largest (None for the largest). folder: the light.
    """

    size: int
    bake_s: float
    frame_s: float
    psnr_db: float | None
    median_of_255: float | None
    folder: Path


def measure_sizes(
    room: str,
    sizes: Sequence[int],
    views: int,
    camera: PinholeCamera,
    note: Callable[[str], None],
    on_step: Callable[[], object],
) -> list[MapSize]:
    """Measure all sizes, smallest first. Light in the cache is not baked again.

    A size that is too small for the charts of the room is left out with a note.
    """
    found: list[MapSize] = []
    largest: np.ndarray | None = None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "views.txt"
        write_trajectory(path, views_of(room, views), "tum")
        for size in sorted(sizes, reverse=True):
            job = RenderJob(room, room, str(path), camera, map_size=size, map_samples=_SAMPLES)
            on_step()
            try:
                light, _ = JobScene(job, lambda event: None).bake()
            except InputError as refusal:
                note(f"{room}, {size} texels: left out: {refusal}")
                continue
            rgb, _, frame_s = rendered(job, Path(folder) / str(size))
            psnr_db = median_of_255 = None
            if largest is None:
                largest = rgb
            else:
                psnr_db, median_of_255 = difference(rgb, largest)
            bake_s = float(light_files.read_recipe(light)["seconds"])
            found.append(MapSize(size, bake_s, frame_s, psnr_db, median_of_255, light))
            note(f"{room}: {found[-1]}")
    return found[::-1]
