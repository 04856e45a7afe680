"""Compares lighting methods (path tracing, baked light) with a reference of many path-traced
samples: seconds per frame, error, and flicker between frames, also as a chart. Errors are
those of display values, 0..1.
"""

import json
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from iclnuim import shipped
from iclnuim.formats.files import sha256
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.job import RenderJob
from iclnuim.sensor.transfer import srgb_from_light
from iclnuim.sequences.run_folder import load_trajectory
from iclnuim.shown import COLOURS
from iclnuim.worker_events import Event, FrameDone, Note, Ready
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .rendered import psnr_db, read_frames

REFERENCE_SAMPLES = 2048
#: Seeds of the two halves of the reference. Their noise must be independent of each other and of
#: that of the compared methods.
_REFERENCE_SEEDS = (11, 12)
_PATH_SAMPLES = (1, 4, 16, 64, 256)
_BAKED_SAMPLES = (1, 2, 4, 8)
#: Path tracing with more samples than this is slow: one frame is timed.
_SLOW_SAMPLES = 16
#: A depth difference beyond this share means another surface.
_SAME_SURFACE = 0.01


@dataclass(frozen=True)
class Method:
    """One lighting method: `family` is a line of the chart, `label` a point on it."""

    family: str
    label: str
    job: RenderJob


@dataclass(frozen=True)
class Error:
    """psnr_db: of each view against the image to which path tracing converges. median: median
    difference of colour values from it.
    """

    psnr_db: tuple[float, ...]
    median: float

    @property
    def mean_psnr_db(self) -> float:
        return float(np.mean(self.psnr_db))


def error(frames: np.ndarray, halves: np.ndarray) -> Error:
    """Error of scene-linear frames (n, h, w, 3) against references (2, n, h, w, 3) with independent
    noise.

    The mean of the product of both differences contains no noise of the references, as the noise of
    the two halves is independent. For the median, that noise (half the difference of the halves) is
    subtracted in quadrature.
    """
    a, b = (srgb_from_light(frames) - srgb_from_light(half) for half in halves)
    whole = srgb_from_light(frames) - srgb_from_light(halves.mean(0))
    median = float(np.median(np.abs(whole)))
    noise = float(np.median(np.abs(a - b))) / 2
    return Error(
        psnr_db=tuple(psnr_db((a * b).mean((1, 2, 3))).tolist()),
        median=float(np.sqrt(max(median**2 - noise**2, 0))),
    )


def carried_difference(
    rgb_a: np.ndarray,
    depth_a_z_m: np.ndarray,
    rgb_b: np.ndarray,
    depth_b_z_m: np.ndarray,
    T_b_a: SE3,
    camera: PinholeCamera,
) -> np.ndarray:
    """(n,) differences, averaged over colours, between pixels of frame a and frame b, sampled
    bilinearly at their projections.

    Scene-linear frames (h, w, 3) and planar depth (h, w) in metres. Pixels without depth, outside
    b, or behind or next to another surface in b are left out.
    """
    points = T_b_a.apply(camera.unproject(depth_a_z_m).reshape(-1, 3))
    pixels = camera.project(points).reshape(camera.height, camera.width, 2).astype(np.float32)
    z = points[:, 2].reshape(camera.height, camera.width)
    x, y = pixels[..., 0].copy(), pixels[..., 1].copy()
    display = srgb_from_light(rgb_b).astype(np.float32)
    b = cv2.remap(display, x, y, cv2.INTER_LINEAR, borderValue=(np.nan,) * 3)
    same = depth_a_z_m > 0
    for extreme in (cv2.erode, cv2.dilate):
        z_b = cv2.remap(extreme(depth_b_z_m, np.ones((2, 2))), x, y, cv2.INTER_NEAREST)
        same &= np.abs(z_b - z) < _SAME_SURFACE * z
    difference = np.abs(b - srgb_from_light(rgb_a)).mean(-1)
    return difference[same & np.isfinite(difference)]


@dataclass(frozen=True)
class LightResult:
    """seconds: median time of a frame at full size. flicker: median difference of a surface point
    between consecutive frames, 0..1.
    """

    method: Method
    seconds: float
    error: Error
    flicker: float


def methods(job: RenderJob, map_sizes: Sequence[int]) -> list[Method]:
    """All methods: path tracing with and without denoising, and baked light with each map size; the
    map size of the job has all sample counts.
    """
    found = []
    for size in map_sizes:
        for n in _BAKED_SAMPLES if size == job.map_size else (job.samples,):
            lit = job.changed(light="baked", samples=n, denoise=False, map_size=size)
            found.append(Method(f"baked, {size} map", f"{n}", lit))
    for family, denoise in (("path traced, denoised", True), ("path traced", False)):
        for n in _PATH_SAMPLES:
            lit = job.changed(light="path", samples=n, denoise=denoise)
            found.append(Method(family, f"{n}", lit))
    return found


class Comparison:
    """Measures lighting methods on the `views` (frame numbers) of a sequence.

    Errors use the camera `small`, times use that of the job.
    """

    def __init__(
        self,
        job: RenderJob,
        views: Sequence[int],
        small: PinholeCamera,
        note: Callable[[str], None],
    ) -> None:
        self.job = job
        self.views = list(views)
        self.small = small
        self.note = note
        #: (2, n, h, w, 3), two independent halves; rendered once and kept in the cache; an
        #: interrupted render is resumed
        self.references = np.stack([self._reference(seed) for seed in _REFERENCE_SEEDS])

    def run(self, method: Method) -> LightResult:
        firsts = self.views[::2]
        numbers = sorted({*self.views, *(n + 1 for n in firsts)})
        timed = self.views
        if method.job.light == "path" and (method.job.samples or 0) > _SLOW_SAMPLES:
            timed = self.views[:1]
        with tempfile.TemporaryDirectory() as folder:
            small = Path(folder) / "small"
            self._render(replace(method.job, camera=self.small), small, numbers)
            found = error(read_frames(small, self.views)[0], self.references)
            flicker = self._flicker(small, firsts)
            times = self._render(method.job, Path(folder) / "full", timed)
        # the first frame, in which Cycles reads the scene, counts only if it is the only one
        seconds = times[-1] - times[0]
        if len(times) > 3:
            seconds = statistics.median(np.diff(times)[1:-1])
        return LightResult(method, seconds, found, flicker)

    def _reference(self, seed: int) -> np.ndarray:
        from iclnuim.blender.render import run_recipe

        samples = REFERENCE_SAMPLES // len(_REFERENCE_SEEDS)
        job = self.job.changed(light="path", samples=samples, denoise=False, seed=seed)
        job = replace(job, camera=self.small)
        recipe = run_recipe.recipe(job)
        deciding = ("job", "scene_sha256", "trajectory_sha256", "blender")
        key = sha256(json.dumps([recipe[k] for k in deciding], sort_keys=True).encode())
        folder = shipped.cache_folder() / "references" / key[:20]
        self._render(job, folder, self.views)
        return read_frames(folder, self.views)[0]

    def _render(self, job: RenderJob, folder: Path, numbers: list[int]) -> list[float]:
        """Render the missing frames; returns the time of the start, and the times at which each
        frame was reported (while the next one renders).
        """
        from iclnuim.blender.render import worker

        times: list[float] = []

        def listen(event: Event) -> None:
            if isinstance(event, Ready | FrameDone):
                times.append(time.perf_counter())
            if isinstance(event, Note):
                self.note(event.text)

        folder.parent.mkdir(parents=True, exist_ok=True)
        with worker.Session(job, folder, listen) as session:
            session.render(numbers, lambda: False)
        return times

    def _flicker(self, folder: Path, firsts: list[int]) -> float:
        poses = load_trajectory(self.job).T_world_camera
        differences = []
        for n in firsts:
            (rgb_a, rgb_b), (z_a, z_b) = read_frames(folder, (n, n + 1))
            T_b_a = poses[n + 1].inverse() @ poses[n]
            differences.append(carried_difference(rgb_a, z_a, rgb_b, z_b, T_b_a, self.small))
        return float(np.median(np.concatenate(differences)))


def figure(results: Sequence[LightResult]) -> Figure:
    """Left: PSNR (higher is better); right: flicker in 8-bit steps (lower is better)."""
    drawn = Figure(figsize=(12, 4.8), layout="constrained")
    left, right = drawn.subplots(1, 2)
    for k, family in enumerate(dict.fromkeys(r.method.family for r in results)):
        line = [r for r in results if r.method.family == family]
        marker = "o" if len(line) > 1 else "D"
        style = {"color": COLOURS[k % len(COLOURS)], "label": family, "marker": marker}
        seconds = [r.seconds for r in line]
        _draw(left, line, seconds, [r.error.mean_psnr_db for r in line], style)
        _draw(right, line, seconds, [255 * r.flicker for r in line], style)
    left.set_ylabel("PSNR (dB), mean of the views")
    right.set_ylabel("median change of a surface point\nfrom frame to frame (of 255)")
    right.set_yscale("log")
    right.yaxis.set_major_formatter("{x:g}")
    right.yaxis.set_minor_formatter("{x:g}")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xlabel("seconds per frame, 640 x 480 (numbers: samples per pixel)")
        axes.grid(alpha=0.3)
    left.legend(frameon=False)
    return drawn


def _draw(
    axes: Axes,
    line: Sequence[LightResult],
    seconds: Sequence[float],
    values: Sequence[float],
    style: dict[str, Any],
) -> None:
    axes.plot(seconds, values, **style)
    for r, at in zip(line, zip(seconds, values, strict=True), strict=True):
        axes.annotate(r.method.label, at, xytext=(4, 4), textcoords="offset points", fontsize=8)
