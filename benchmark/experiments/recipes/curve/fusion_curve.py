"""The curve of fusion: voxel size against surface error, time and memory, with all sizes on the
same frames in one run.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from iclnuim.benchmark.fusion.mesh import extract
from iclnuim.benchmark.fusion.settings import PRESETS
from iclnuim.benchmark.fusion.surface_error import TrueSurface
from iclnuim.benchmark.fusion.volume import Volume

from ....perturbations.segment import Segment

VALUES = (0.035, 0.0176, 4.5 / 512, 0.004)


@dataclass(frozen=True)
class FusedPoint:
    """voxel_m, and distances of the vertices to the true surface, in metres; ms: time of fusing per
    frame; memory_mb: memory of fusing.
    """

    voxel_m: float
    vertices: int
    mean_m: float
    median_m: float
    p95_m: float
    ms: float
    meshing_s: float
    memory_mb: float


def measure(
    values: Sequence[float], segment: Segment, surface: TrueSurface, progress: Callable[[], object]
) -> list[FusedPoint]:
    """Fuse along the true poses: every frame is fused into all volumes, then each volume is meshed.

    The first frame is not timed.
    """
    base = PRESETS["best"]
    volumes = []
    for voxel_m in values:
        truncation_m, behind_m = base.reach_m(voxel_m)
        settings = base.changed(
            voxel_m=float(voxel_m),
            truncation_m=truncation_m,
            behind_m=behind_m,
            max_blocks=400_000,
        )
        volumes.append(Volume(settings, lambda volume, leaves: None))
    seconds = np.zeros(len(volumes))
    for number in segment.numbers:
        colour, depth_z_m = segment.load(number)
        pose = segment.pose(segment.stamps_s[number])
        for k, volume in enumerate(volumes):
            started = time.perf_counter()
            volume.integrate(depth_z_m, segment.camera, pose, colour)
            seconds[k] += (number != segment.numbers[0]) * (time.perf_counter() - started)
        progress()
    each_ms = 1e3 * seconds / max(1, len(segment.numbers) - 1)
    return [_point(v, float(ms), surface) for v, ms in zip(volumes, each_ms, strict=True)]


def _point(volume: Volume, ms: float, surface: TrueSurface) -> FusedPoint:
    started = time.perf_counter()
    mesh = extract(volume)
    meshing_s = time.perf_counter() - started
    distances_m = surface.distance(mesh.points)
    return FusedPoint(
        voxel_m=volume.settings.voxel_m,
        vertices=len(mesh.points),
        mean_m=float(distances_m.mean()),
        median_m=float(np.median(distances_m)),
        p95_m=float(np.percentile(distances_m, 95)),
        ms=ms,
        meshing_s=meshing_s,
        memory_mb=volume.bytes_used / 1e6,
    )
