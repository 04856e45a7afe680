"""What frames cost on this kind of machine: measured by tasks and kept in the cache, or stated defaults; for chunks and estimates."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean, median

from iclnuim import shipped
from iclnuim.errors import IclnuimError
from iclnuim.formats.files import sha256, write_json
from iclnuim.job import RenderJob

#: Fewer frames than this say little.
LEAST_FRAMES = 3
#: Core-seconds, living room at 640 x 480 (docs/farm.md): bake of 2048 x 2048 texels with 32 samples each; the pair of sequences of a frame.
BAKE_CORE_S, PAIR_CORE_S = 1110.0, 0.1
START_S = 15.0
#: Bytes of a frame: its EXR a pixel, and its four images (clean and noisy, measured on kt2) a pixel.
EXR_BYTES, PAIR_BYTES = 10.0, 4.6


@dataclass(frozen=True)
class Figures:
    """`frame_core_s`: core-seconds a frame; `start_s`: until a worker's scene stands; `frames`: measured on so many, 0 for defaults."""

    frame_core_s: float
    start_s: float = START_S
    frames: int = 0

    @property
    def source(self) -> str:
        return f"measured on {self.frames} frames" if self.frames else "defaults, nothing measured yet"


def default(job: RenderJob) -> Figures:
    """Of the living room, by samples and pixels."""
    vga = job.camera.width * job.camera.height / (640 * 480)
    seconds = 0.35 + 0.2 * job.samples if job.light == "baked" else 0.3 + 3.0 * job.samples + 2.0 * job.denoise
    if not job.exposure.instant:
        seconds *= 8
    return Figures(max(0.05, seconds * vga))


def measured(frames_core_s: Sequence[float], starts_s: Sequence[float], cores: int) -> Figures:
    """Of a task's workers with `cores` each. A worker's first frame makes ready what the others use: beyond the median it belongs to the start."""
    if not frames_core_s or not starts_s:
        return Figures(0.0)
    middle = median(frames_core_s)
    beyond_core_s = max(0.0, sum(frames_core_s) - middle * len(frames_core_s))
    return Figures(middle, fmean(starts_s) + beyond_core_s / cores / len(starts_s), len(frames_core_s))


def known(job: RenderJob) -> Figures:
    """Measured for such frames, else the defaults."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        content = json.loads(_file(job).read_text("utf-8"))
        return Figures(**content["figures"])
    return default(job)


def keep(job: RenderJob, figures: Figures) -> None:
    """Into the cache, where it can be written; the latest stand."""
    if figures.frames >= LEAST_FRAMES and figures.frame_core_s > 0:
        with suppress(OSError, IclnuimError):
            _file(job).parent.mkdir(parents=True, exist_ok=True)
            write_json(_file(job), {"of": _key(job), "figures": asdict(figures)})


def _file(job: RenderJob) -> Path:
    return shipped.cache_folder() / "figures" / f"{sha256(json.dumps(_key(job)).encode())[:16]}.json"


def _key(job: RenderJob) -> dict:
    """What the time of a frame depends on."""
    names = ("scene", "light", "samples", "denoise", "antialias", "lambertian", "exposure_s", "readout_s")
    return {**{name: getattr(job, name) for name in names}, "size": [job.camera.width, job.camera.height]}
