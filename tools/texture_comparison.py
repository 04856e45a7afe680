"""Compares frames with and without filtered textures with frames of many rays a pixel: how much
surface points change from frame to frame, and
the difference from the mean over each pixel's area. Differences are those of display values, 0..1.
"""

import statistics
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from iclnuim.dataset.run_folder import load_trajectory
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.job import RenderJob
from iclnuim.sensor.transfer import srgb_from_light
from iclnuim.worker_events import Event, FrameDone
from matplotlib.figure import Figure

from .light_comparison import carried_difference, read_frames

#: Rays along each side of a pixel of the reference.
RAYS = 4
_HEADER = ("sequence", "textures", "ms/frame", "median change", "mean change", "mean difference")


@dataclass(frozen=True)
class Result:
    """change_median, change_mean: difference of surface points between consecutive frames.
    difference: mean difference from the reference; None
    for the reference itself. ms: median time that Cycles takes for a frame.
    """

    sequence: str
    textures: str
    ms: float
    change_median: float
    change_mean: float
    difference: float | None


def measure(job: RenderJob, firsts: Sequence[int]) -> tuple[list[Result], dict[str, np.ndarray]]:
    """Renders the frames `firsts` and those that follow them. Returns a row per method, and by each
    method the part
    of a frame, half as wide and high (h/2, w/2, 3), in which unfiltered textures differ most from
    the reference.
    """
    numbers = sorted({n + k for n in firsts for k in (0, 1)})
    camera = job.camera
    plain = job.changed(mipmaps=False)
    jobs = {
        "unfiltered": plain,
        "mipmaps": job.changed(mipmaps=True),
        f"{RAYS**2} rays a pixel": replace(plain, camera=_finer(camera)),
    }
    light, times_ms, depth_z_m = {}, {}, None
    for name, each in jobs.items():
        rgb, z, times_ms[name] = _render(each, numbers)
        light[name] = rgb.reshape(
            len(numbers), camera.height, rgb.shape[1] // camera.height, camera.width, -1, 3
        )
        light[name] = light[name].mean((2, 4))
        depth_z_m = z if depth_z_m is None else depth_z_m
    assert depth_z_m is not None
    poses, results, last = load_trajectory(job).T_world_camera, [], f"{RAYS**2} rays a pixel"
    for name, rgb in light.items():
        changes = []
        for n in firsts:
            a, b = numbers.index(n), numbers.index(n + 1)
            T_b_a = poses[n + 1].inverse() @ poses[n]
            changes.append(
                carried_difference(rgb[a], depth_z_m[a], rgb[b], depth_z_m[b], T_b_a, camera)
            )
        change = np.concatenate(changes)
        apart = (
            None
            if name == last
            else float(np.abs(srgb_from_light(rgb) - srgb_from_light(light[last])).mean())
        )
        row = (times_ms[name], float(np.median(change)), float(change.mean()), apart)
        results.append(Result(job.sequence, name, *row))
    return results, _most_different_part(light, last)


def _most_different_part(light: dict[str, np.ndarray], reference: str) -> dict[str, np.ndarray]:
    display = {name: srgb_from_light(rgb) for name, rgb in light.items()}
    apart = np.abs(display["unfiltered"] - display[reference]).mean(-1)
    high, wide = apart.shape[1] // 2, apart.shape[2] // 2
    sums = np.pad(apart.cumsum(1).cumsum(2), ((0, 0), (1, 0), (1, 0)))
    of_parts = (
        sums[:, high:, wide:]
        - sums[:, :-high, wide:]
        - sums[:, high:, :-wide]
        + sums[:, :-high, :-wide]
    )
    frame, top, left = np.unravel_index(of_parts.argmax(), of_parts.shape)
    return {name: rgb[frame, top : top + high, left : left + wide] for name, rgb in display.items()}


def _finer(camera: PinholeCamera) -> PinholeCamera:
    """A camera whose RAYS x RAYS pixels cover each pixel of `camera`."""
    shift = (RAYS - 1) / 2
    return PinholeCamera(
        camera.width * RAYS,
        camera.height * RAYS,
        camera.fx * RAYS,
        camera.fy * RAYS,
        camera.cx * RAYS + shift,
        camera.cy * RAYS + shift,
    )


def _render(job: RenderJob, numbers: Sequence[int]) -> tuple[np.ndarray, np.ndarray, float]:
    from iclnuim.blender.render import worker

    times_s: list[float] = []

    def listen(event: Event) -> None:
        if isinstance(event, FrameDone) and event.cycles is not None:
            times_s.append(event.cycles)

    with tempfile.TemporaryDirectory() as folder:
        with worker.Session(job, Path(folder) / "run", listen) as session:
            session.render(numbers, lambda: False)
        rgb, depth_z_m = read_frames(Path(folder) / "run", numbers)
    return (
        rgb,
        depth_z_m,
        1e3 * statistics.median(times_s[1:]),
    )  # in the first frame, Cycles reads the scene


def table(results: Sequence[Result]) -> str:
    """One row per sequence and method, in Markdown; differences of 255."""
    rows = [
        (
            r.sequence,
            r.textures,
            f"{r.ms:.0f}",
            f"{255 * r.change_median:.2f}",
            f"{255 * r.change_mean:.2f}",
        )
        + ("" if r.difference is None else f"{255 * r.difference:.2f}",)
        for r in results
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in (_HEADER, ("---",) * len(_HEADER), *rows))


def figure(parts: Sequence[dict[str, np.ndarray]]) -> Figure:
    """A row per sequence: the same part of a frame by each method."""
    drawn = Figure(figsize=(12, 3.2 * len(parts)), layout="constrained")
    for axes, by_method in zip(
        drawn.subplots(len(parts), len(parts[0]), squeeze=False), parts, strict=True
    ):
        for ax, (name, display) in zip(axes, by_method.items(), strict=True):
            ax.imshow(display.clip(0, 1), interpolation="nearest")
            ax.set_title(name)
            ax.axis("off")
    return drawn
