"""The preview of a user-provided scene: one small frame, path traced and denoised.

Its render time decides between baked and path-traced light.
"""

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ... import shipped
from ...errors import InputError
from ...formats import png
from ...geometry.trajectory import Trajectory
from ...job import RenderJob, bake_core_s
from ...sensor.transfer import srgb8
from ...sequences.run_folder import read_run
from .. import compat
from ..light import light_map
from ..open import light_choice
from . import camera, frames, settings

#: Core-seconds of a path-traced sample of 640 x 480 pixels where bake_core_s was measured. If a
#: sample takes longer, a bake does too.
_SAMPLE_CORE_S = 3.0
#: Name of the preview in the run folder.
PREVIEW = "preview.png"
#: Its longer side: a quarter of the pixels of a 640 x 480 frame.
_SIDE_PX = 320
#: Its maximum number of samples, and the time for them; at least two samples are rendered.
_MAX_SAMPLES = 16
_SAMPLES_S = 5.0


@dataclass(frozen=True, eq=False)
class Look:
    """rgb (h, w, 3): scene-linear, of frame `number`; black: the likely cause if it is black.
    Estimates from its render time, in seconds: path_s and baked_s for a frame of the job, bake_s
    for the bake.
    """

    rgb: np.ndarray
    black: str | None
    number: int
    samples: int
    path_s: float
    baked_s: float
    bake_s: float

    def write(self, folder: Path) -> str:
        """Write preview.png into the run folder. Returns the sentence to print."""
        png.write_png(folder / PREVIEW, srgb8(self.rgb))
        what = f"preview of frame {self.number}, path traced with {self.samples} samples"
        return f"{what}: {folder / PREVIEW}"


@dataclass(frozen=True)
class FirstFrame:
    """The number of the first frame of a new run of a scene; None for a run that was begun."""

    scene: str
    number: int | None

    def refuse_black(self, number: int, black: str | None) -> None:
        """Raises InputError if this first frame is black, for the likely cause `black`; a run that
        was begun goes on, because depth may be all that is wanted.
        """
        if black and number == self.number:
            expected = "a first frame that is not black"
            again = "the same command again, which renders in the dark"
            raise InputError(expected, path=self.scene, found=black, hint=again)


def look(job: RenderJob, trajectory: Trajectory, number: int, threads: int | None) -> Look:
    """Render a small preview of frame `number` of the open scene. Settings, camera and materials of
    the scene are changed: open the scene again to render the job.
    """
    path = light_choice.with_light(job, "path")
    settings.apply(path.changed(denoise=compat.has_denoiser(), antialias=False), threads)
    camera.keyframe(trajectory.T_world_camera, job.camera)
    render = bpy.context.scene.render
    cycles = bpy.context.scene.cycles
    percentage = max(1, min(100, 100 * _SIDE_PX // max(render.resolution_x, render.resolution_y)))
    frames_per_preview = 1e4 / percentage**2
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.exr"

        def timed(samples: int, percentage: int) -> np.ndarray:
            """Render; returns (2,) seconds and core-seconds."""
            cycles.samples = samples
            render.resolution_percentage = percentage
            begun = np.array([time.perf_counter(), time.process_time()])
            frames.render(number, raw)
            return np.array([time.perf_counter(), time.process_time()]) - begun

        timed(1, max(1, percentage // 8))  # this prepares data that all frames share
        one = timed(1, percentage)
        samples = max(2, min(_MAX_SAMPLES, int(_SAMPLES_S / one[0])))
        several = timed(samples, percentage)
        rgb, depth_z_m = frames.read(raw, raw)
    sample = frames_per_preview * np.maximum(several - one, 0) / (samples - 1)
    sample_s, sample_core_s = sample
    baked_s = frames_per_preview * one[0]
    vga = job.camera.width * job.camera.height / (640 * 480)
    slowness = max(1.0, sample_core_s / vga / _SAMPLE_CORE_S)
    cores = max(several[1], 1e-3) / several[0]
    return Look(
        rgb=rgb,
        black=frames.why_black(rgb, depth_z_m),
        number=number,
        samples=samples,
        path_s=baked_s + ((path.samples or 1) - 1) * sample_s,
        baked_s=baked_s,
        bake_s=bake_core_s(job) * slowness / cores,
    )


def choose(job: RenderJob, out: Path, look: Look | None, frame_count: int) -> tuple[RenderJob, str]:
    """The job with baked light or path tracing, whichever takes less time for this number of
    frames, and a sentence about the choice.

    A run that was started in `out` keeps its light.
    """
    if (out / "sequence.json").is_file():
        light = read_run(out).recipe["job"]["light"]
        return light_choice.with_light(job, light), f"light: {light}, as when this run was started"
    if look is None or light_map.find(shipped.cache_folder(), job):
        sentence = "light: baked, found in the cache" if look else "light: baked"
        return light_choice.with_light(job, "baked"), sentence
    baked_s = look.bake_s + frame_count * look.baked_s
    path_s = frame_count * look.path_s
    light = "path" if path_s <= baked_s else "baked"
    other = "baked" if light == "path" else "path"
    name = "path traced" if light == "path" else light
    baked = f"{_time(baked_s)} baked, including {_time(look.bake_s)} for the bake"
    many = f"{frame_count} frame{'s' * (frame_count != 1)}"
    times = f"{many}: about {_time(path_s)} path traced, {baked}"
    override = f"the setting light {other} overrides this"
    sentence = f"light: {name}, which takes less time ({times}); {override}"
    return light_choice.with_light(job, light), sentence


def _time(seconds: float) -> str:
    for unit, size in (("s", 1), ("min", 60)):
        if seconds < 100 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 3600:.0f} h"
