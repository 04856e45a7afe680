"""Estimates the cost of a run from figures that tasks measured and stored in the cache, or from
defaults; they also decide the size of chunks.
"""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from math import ceil
from pathlib import Path
from statistics import fmean, median

from iclnuim import shipped
from iclnuim.channels import BASE, exr_bytes
from iclnuim.errors import IclnuimError
from iclnuim.formats.files import sha256, write_json
from iclnuim.job import RenderJob, bake_core_s, shipped_light

from ..planned_work import PlannedWork
from .chunks import own_cores
from .run_plan import RunPlan

#: Figures measured on fewer frames are not stored.
MIN_FRAMES = 3
#: Core-seconds to write a frame of both sequences, living room at 640 x 480
#: (docs/measured/farm.md).
PAIR_CORE_S = 0.1
#: Seconds of a simulated frame, a guess: cloth of 30,000 points. A bake says how long it takes.
SIMULATED_FRAME_S = 2.0
#: Seconds until a worker has prepared its scene, the living room; of a run's own scene once it is
#: measured.
START_S = 15.0


@dataclass(frozen=True)
class FrameCost:
    """frame_core_s: core-seconds per frame. start_s: seconds until a worker has prepared its scene.
    frames: number of measured frames, 0 for defaults.
    """

    frame_core_s: float
    start_s: float = START_S
    frames: int = 0


def default(job: RenderJob) -> FrameCost:
    """Default figures, from the living room, scaled by samples and pixels."""
    vga = job.camera.width * job.camera.height / (640 * 480)
    samples = job.samples or 0
    seconds = 0.35 + 0.2 * samples
    if job.light == "path":
        seconds = 0.3 + 3.0 * samples + 2.0 * bool(job.denoise)
    if not job.exposure.instant:
        seconds *= 8
    return FrameCost(max(0.05, seconds * vga))


def measured(frames_core_s: Sequence[float], starts_s: Sequence[float], cores: int) -> FrameCost:
    """Figures of a task's workers with `cores` cores each.

    The first frame of a worker includes preparation, so its time beyond the median counts as start.
    """
    if not frames_core_s or not starts_s:
        return FrameCost(0.0)
    middle = median(frames_core_s)
    beyond_core_s = max(0.0, sum(frames_core_s) - middle * len(frames_core_s))
    return FrameCost(
        middle, fmean(starts_s) + beyond_core_s / cores / len(starts_s), len(frames_core_s)
    )


def known(job: RenderJob) -> FrameCost:
    """The figures measured for frames of this kind, else the defaults."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        return FrameCost(**json.loads(_file(job).read_text("utf-8"))["figures"])
    return default(job)


def keep(job: RenderJob, figures: FrameCost) -> None:
    """Store figures in the cache, if it is writable; they replace earlier ones."""
    if figures.frames >= MIN_FRAMES and figures.frame_core_s > 0:
        with suppress(OSError, IclnuimError):
            _file(job).parent.mkdir(parents=True, exist_ok=True)
            write_json(_file(job), {"settings": _key(job), "figures": asdict(figures)})


def _file(job: RenderJob) -> Path:
    key = sha256(json.dumps(_key(job)).encode())[:16]
    return shipped.cache_folder() / "figures" / f"{key}.json"


def _key(job: RenderJob) -> dict:
    """The settings that decide the time of a frame."""
    names = [
        "scene",
        "light",
        "samples",
        "denoise",
        "antialias",
        "lambertian",
        "exposure_s",
        "readout_s",
    ]
    size = [job.camera.width, job.camera.height]
    return {**{name: getattr(job, name) for name in names}, "size": size}


@dataclass(frozen=True)
class CostEstimate:
    """Estimate for the missing work. bake_core_hours: spent only if the cache does not have the
    light map. wall_minutes: without waiting in the queue. simulations_minutes: a guess, in addition
    to all others; 0 if the scene has no simulations.
    """

    frames: int
    tasks: int
    frames_per_task: int
    core_hours: float
    bake_core_hours: float
    gigabytes: float
    wall_minutes: float
    task_minutes: float
    simulations_minutes: float
    light_minutes: float
    dataset_minutes: float
    basis: str

    def text(self) -> str:
        tasks = f"{self.tasks} task{'s' * (self.tasks != 1)} of up to {self.frames_per_task}"
        bake = ""
        if self.bake_core_hours:
            bake = f", {self.bake_core_hours:.2f} of them to bake the light, unless it is cached"
        before = ""
        if self.simulations_minutes:
            guess = f"a guess of {SIMULATED_FRAME_S:.0f} s a frame"
            what = f"{self.simulations_minutes:.0f} min of simulations, {guess}"
            before = f"\n             after {what}, if the scene has any that are not cached"
        return (
            f"{self.frames} frames, {tasks}\n"
            f"core-hours   {self.core_hours:.2f}{bake}\n"
            f"gigabytes    {self.gigabytes:.2f}\n"
            f"wall time    {self.wall_minutes:.0f} min, without waiting in the queue{before}\n"
            f"figures      {self.basis}"
        )


def estimate(plan: RunPlan, chunks: list[int], known: FrameCost) -> CostEstimate:
    """Estimate the cost of the missing work. chunks: number of frames of each task."""
    job = plan.job
    cpus = plan.slurm.cpus
    frames = sum(chunks)
    largest = max(chunks, default=0)
    bake_s = 0.0
    if job.light != "path" and chunks and not shipped_light(job):
        bake_s = bake_core_s(job)
    start_s = known.start_s * cpus * (len(chunks) + bool(chunks))
    task_s = known.start_s + known.frame_core_s * largest / cpus
    light_s = known.start_s + bake_s / cpus
    wall_s = 0.0
    if chunks:
        wall_s += light_s + ceil(len(chunks) / plan.slurm.at_once) * task_s
    pairs_s = _pairs_core_s(plan)
    dataset_s = 10 + pairs_s / cpus
    if plan.sequences is not None:
        wall_s += dataset_s
    source = "defaults, as nothing is measured yet"
    if known.frames:
        source = f"measured on {known.frames} frames"
    return CostEstimate(
        frames=frames,
        tasks=len(chunks),
        frames_per_task=largest,
        core_hours=(frames * known.frame_core_s + bake_s + pairs_s + start_s) / 3600,
        bake_core_hours=bake_s / 3600,
        gigabytes=_gigabytes(plan, frames),
        wall_minutes=wall_s / 60,
        task_minutes=task_s / 60,
        simulations_minutes=_simulated_s(plan, known) / 60 if chunks else 0.0,
        light_minutes=light_s / 60,
        dataset_minutes=dataset_s / 60,
        basis=f"{known.frame_core_s:.2f} core-seconds per frame, {known.start_s:.0f} s to start: "
        + source,
    )


def _pairs_core_s(plan: RunPlan) -> float:
    """The images of all sequences."""
    if plan.sequences is None:
        return 0.0
    pixels = plan.job.camera.width * plan.job.camera.height
    return len(plan.numbers) * PAIR_CORE_S * pixels / (640 * 480)


def _simulated_s(plan: RunPlan, known: FrameCost) -> float:
    """The bake of simulations, from the scene's start to the last frame."""
    if not plan.may_simulate:
        return 0.0
    return known.start_s + SIMULATED_FRAME_S * (max(plan.numbers) + 1)


def local_estimate(plan: RunPlan, frames: int, cores: int) -> CostEstimate:
    """Estimate the cost of `frames` missing frames on this machine."""
    chunks = [frames] if frames else []
    slurm = replace(plan.slurm, cpus=cores, at_once=1)
    return estimate(replace(plan, slurm=slurm), chunks, known(plan.job))


def _gigabytes(plan: RunPlan, frames: int) -> float:
    """The size of `frames` raw frames and of all sequences."""
    channels = (*BASE, *plan.job.further)
    bytes_a_pixel: float = frames * exr_bytes(channels)
    image_bytes = sum(channel.png_bytes for channel in channels)
    bytes_a_pixel += len(plan.variants()) * len(plan.numbers) * image_bytes
    return plan.job.camera.width * plan.job.camera.height * bytes_a_pixel / 1e9


def local_work(plans: Sequence[RunPlan]) -> PlannedWork:
    """The missing frames of runs on this machine, one after another. A raw frame is removed once
    all sequences of its run have it, unless it is kept.
    """
    cores = len(own_cores())
    missing = 0
    minutes = 0.0
    gigabytes = 0.0
    for plan in plans:
        if frames := plan.unwritten():
            missing += frames
            minutes += local_estimate(plan, frames, cores).wall_minutes
            raw_stays = plan.keep_raw or plan.sequences is None
            gigabytes += local_estimate(plan, frames * raw_stays, cores).gigabytes
    where = f"{len(plans)} sequences"
    if len(plans) == 1:
        where = f"{plans[0].job.sequence}, in {plans[0].out}"
    if any(plan.job.light == "auto" for plan in plans):
        where += ", if its light is baked (a first look chooses the light)"
    total = sum(len(plan.numbers) for plan in plans)
    what = f"{missing} of {total} frames to render on {cores} cores, {where}"
    return PlannedWork(what, 60 * minutes, gigabytes)
