"""What a run will take on a cluster, before it is submitted: core-hours, gigabytes, wall time."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import ceil

from .figures import BAKE_CORE_S, EXR_BYTES, PAIR_BYTES, PAIR_CORE_S, Figures
from .slurm_settings import SlurmSettings
from .tasks import RunPlan


@dataclass(frozen=True)
class Estimate:
    """Of what is still missing. `bake_core_hours` is spent only where the cache has no such light map; wall time without waiting."""

    frames: int
    tasks: int
    frames_a_task: int
    core_hours: float
    bake_core_hours: float
    gigabytes: float
    wall_minutes: float
    task_minutes: float
    light_minutes: float
    dataset_minutes: float
    figures: str

    def to_dict(self) -> dict:
        return asdict(self)

    def text(self) -> str:
        baked = (
            f", {self.bake_core_hours:.2f} of them for the light unless it is cached" if self.bake_core_hours else ""
        )
        return (
            f"{self.frames} frames, {self.tasks} task{'s' * (self.tasks != 1)} of up to {self.frames_a_task}\n"
            f"core-hours   {self.core_hours:.2f}{baked}\n"
            f"gigabytes    {self.gigabytes:.2f}\n"
            f"wall time    {self.wall_minutes:.0f} min, with nobody else in the queue\n"
            f"figures      {self.figures}"
        )


def estimate(plan: RunPlan, chunks: list[int], known: Figures, settings: SlurmSettings) -> Estimate:
    """`chunks`: frames of each task still to be run."""
    frames, most, cpus = sum(chunks), max(chunks, default=0), settings.cpus
    vga = plan.job.camera.width * plan.job.camera.height / (640 * 480)
    texels = plan.job.map_size**2 * plan.job.map_samples / (2048**2 * 32)
    bake_s = BAKE_CORE_S * texels if plan.job.light == "baked" and chunks else 0.0
    pairs_s = PAIR_CORE_S * vga * len(plan.numbers) if plan.sensor is not None else 0.0
    start_s = known.start_s * cpus * (len(chunks) + bool(chunks))
    task_s = known.start_s + known.frame_core_s * most / cpus
    rounds = ceil(len(chunks) / settings.at_once)
    light_s, dataset_s = known.start_s + bake_s / cpus, 10 + pairs_s / cpus
    wall_s = (light_s + rounds * task_s if chunks else 0) + (dataset_s if plan.sensor is not None else 0)
    return Estimate(
        frames=frames,
        tasks=len(chunks),
        frames_a_task=most,
        core_hours=(frames * known.frame_core_s + bake_s + pairs_s + start_s) / 3600,
        bake_core_hours=bake_s / 3600,
        gigabytes=_gigabytes(plan, frames),
        wall_minutes=wall_s / 60,
        task_minutes=task_s / 60,
        light_minutes=light_s / 60,
        dataset_minutes=dataset_s / 60,
        figures=f"{known.frame_core_s:.2f} core-seconds a frame, {known.start_s:.0f} s to start: {known.source}",
    )


def _gigabytes(plan: RunPlan, frames: int) -> float:
    """At its fullest: all raw frames, and the sequences beside them."""
    pixels = plan.job.camera.width * plan.job.camera.height
    pairs = PAIR_BYTES * len(plan.numbers) if plan.sensor is not None else 0.0
    return pixels * (EXR_BYTES * frames + pairs) / 1e9
