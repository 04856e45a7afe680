"""The curve of fusion: voxel size against surface error, time and memory, with all sizes on the
same frames in one run.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from iclnuim.benchmark.fusion.mesh import extract
from iclnuim.benchmark.fusion.settings import PRESETS
from iclnuim.benchmark.fusion.surface_error import TrueSurface
from iclnuim.benchmark.fusion.volume import Volume

from ..perturbations.segment import Segment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VALUES = (0.035, 0.0176, 4.5 / 512, 0.004)
#: Truncation distance in voxels; the default distance is the minimum.
_TRUNCATION = 3.0


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

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def measure(
    values: Sequence[float], segment: Segment, surface: TrueSurface, progress: Callable[[], object]
) -> list[FusedPoint]:
    """Fuse along the true poses: every frame is fused into all volumes, then each volume is meshed.

    The first frame is not timed.
    """
    base = PRESETS["best"]
    volumes = []
    for voxel_m in values:
        reach_m = max(base.truncation_m, _TRUNCATION * voxel_m)
        behind_m = max(base.behind_m, 2 * voxel_m)
        settings = base.changed(
            voxel_m=float(voxel_m), truncation_m=reach_m, behind_m=behind_m, max_blocks=400_000
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
    after_first = max(1, len(segment.numbers) - 1)
    return [
        _point(v, float(1e3 * s / after_first), surface)
        for v, s in zip(volumes, seconds, strict=True)
    ]


def _point(volume: Volume, ms: float, surface: TrueSurface) -> FusedPoint:
    started = time.perf_counter()
    mesh = extract(volume)
    meshing_s = time.perf_counter() - started
    distances_m = surface.distance(mesh.points)
    middle, high = (float(v) for v in np.percentile(distances_m, (50, 95)))
    figures = (len(mesh.points), float(distances_m.mean()), middle, high)
    return FusedPoint(volume.settings.voxel_m, *figures, ms, meshing_s, volume.bytes_used / 1e6)


def table(points: Sequence[FusedPoint]) -> str:
    """One line per voxel size."""
    lines = [
        f"{'voxel [mm]':>10}{'mean [mm]':>11}{'median':>9}{'95 %':>9}{'ms':>8}{'meshing [s]':>13}{'MB':>8}{'vertices':>11}"
    ]
    for p in points:
        error = f"{1e3 * p.mean_m:>11.3f}{1e3 * p.median_m:>9.3f}{1e3 * p.p95_m:>9.3f}"
        lines.append(
            f"{1e3 * p.voxel_m:>10.1f}{error}{p.ms:>8.1f}{p.meshing_s:>13.1f}{p.memory_mb:>8.0f}{p.vertices:>11}"
        )
    return "\n".join(lines)


def figure(results: Mapping[str, Sequence[FusedPoint]]) -> "Figure":
    """Mean distance to the true surface over time per frame and over memory, with a line for each
    sequence.
    """
    from iclnuim.report.charts import COLOURS
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(9, 4.2), layout="constrained")
    panels = drawing.subplots(1, 2, sharey=True)
    for axes, name, label in zip(panels, ("ms", "memory_mb"), ("ms per frame", "MB"), strict=True):
        for (sequence, points), colour in zip(
            results.items(), COLOURS * len(results), strict=False
        ):
            x, y = [getattr(p, name) for p in points], [1e3 * p.mean_m for p in points]
            axes.plot(x, y, "o-", color=colour, linewidth=1, label=sequence)
            for p, px, py in zip(points, x, y, strict=True):
                text = f"{1e3 * p.voxel_m:.3g} mm"
                axes.annotate(
                    text,
                    (px, py),
                    xytext=(4, 4),
                    textcoords="offset points",
                    fontsize=8,
                    color=colour,
                )
        axes.set(xscale="log", yscale="log", xlabel=label)
        axes.margins(0.12)
        axes.grid(alpha=0.3, which="both")
    panels[0].set_ylabel("mean distance to the true surface [mm]")
    panels[0].legend(fontsize=8)
    return drawing
