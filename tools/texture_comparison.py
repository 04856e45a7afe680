"""Compares frames with and without filtered textures with frames of many rays a pixel: how much
surface points change from frame to frame, and the difference from the mean over each pixel's area.
Differences are those of display values, 0..1.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.job import RenderJob
from iclnuim.sensor.transfer import srgb_from_light
from iclnuim.sequences.run_folder import load_trajectory
from matplotlib.figure import Figure

from .light_comparison import carried_difference
from .rendered import rendered

#: Rays along each side of a pixel of the reference.
RAYS = 4
_REFERENCE = f"{RAYS**2} rays a pixel"


@dataclass(frozen=True)
class TextureResult:
    """change_median, change_mean: difference of surface points between consecutive frames.
    difference: mean difference from the reference; None for the reference itself. ms: median time
    that Cycles takes for a frame.
    """

    sequence: str
    textures: str
    ms: float
    change_median: float
    change_mean: float
    difference: float | None


def measure(
    job: RenderJob, firsts: Sequence[int]
) -> tuple[list[TextureResult], dict[str, np.ndarray]]:
    """Renders the frames `firsts` and those that follow them.

    Returns a row per method, and by each method the part of a frame, half as wide and high
    (h/2, w/2, 3), in which unfiltered textures differ most from the reference.
    """
    numbers = sorted({*firsts, *(n + 1 for n in firsts)})
    camera = job.camera
    plain = job.changed(mipmaps=False)
    jobs = {
        "unfiltered": plain,
        "mipmaps": job.changed(mipmaps=True),
        _REFERENCE: replace(plain, camera=_finer(camera)),
    }
    light = {}
    times_s = {}
    depths_z_m = []
    for name, each in jobs.items():
        with tempfile.TemporaryDirectory() as folder:
            rgb, depth_z_m, times_s[name] = rendered(each, Path(folder) / "run", numbers)
        rays = rgb.shape[1] // camera.height
        rgb = rgb.reshape(len(numbers), camera.height, rays, camera.width, -1, 3)
        light[name] = rgb.mean((2, 4))
        depths_z_m.append(depth_z_m)
    reference = srgb_from_light(light[_REFERENCE])
    results = []
    for name, rgb in light.items():
        change = _changes(job, firsts, numbers, rgb, depths_z_m[0])
        difference = None
        if name != _REFERENCE:
            difference = float(np.abs(srgb_from_light(rgb) - reference).mean())
        one = TextureResult(
            sequence=job.sequence,
            textures=name,
            ms=1e3 * times_s[name],
            change_median=float(np.median(change)),
            change_mean=float(change.mean()),
            difference=difference,
        )
        results.append(one)
    return results, _most_different_part(light)


def _changes(
    job: RenderJob,
    firsts: Sequence[int],
    numbers: list[int],
    rgb: np.ndarray,
    depth_z_m: np.ndarray,
) -> np.ndarray:
    """Differences of surface points between each of `firsts` and the frame that follows it."""
    poses = load_trajectory(job).T_world_camera
    changes = []
    for n in firsts:
        a, b = numbers.index(n), numbers.index(n + 1)
        T_b_a = poses[n + 1].inverse() @ poses[n]
        changes.append(
            carried_difference(rgb[a], depth_z_m[a], rgb[b], depth_z_m[b], T_b_a, job.camera)
        )
    return np.concatenate(changes)


def _most_different_part(light: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    display = {name: srgb_from_light(rgb) for name, rgb in light.items()}
    apart = np.abs(display["unfiltered"] - display[_REFERENCE]).mean(-1)
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


def figure(parts: Sequence[dict[str, np.ndarray]]) -> Figure:
    """A row per sequence: the same part of a frame by each method."""
    drawn = Figure(figsize=(12, 3.2 * len(parts)), layout="constrained")
    grid = drawn.subplots(len(parts), len(parts[0]), squeeze=False)
    for axes, by_method in zip(grid, parts, strict=True):
        for ax, (name, display) in zip(axes, by_method.items(), strict=True):
            ax.imshow(display.clip(0, 1), interpolation="nearest")
            ax.set_title(name)
            ax.axis("off")
    return drawn
