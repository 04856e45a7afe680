"""The first look at a scene without a shipped light map: small path-traced views before a run.

With light "auto", views with 4, 16 and 64 samples are compared with each other, and their times and
differences decide the way to light the run (render_ways.py). The first view is the run's preview.
"""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np

from ... import shipped
from ...errors import InputError
from ...formats import png
from ...formats.files import write_json
from ...geometry.trajectory import Trajectory
from ...job import RenderJob, bake_core_s
from ...render_ways import (
    COMPARED,
    FEW_COMPARED,
    MAP_SIZES,
    PATH_SAMPLES,
    Convergence,
    Quality,
    Way,
    chosen,
    map_psnr_db,
    psnr_db,
    square,
)
from ...sensor.transfer import srgb8
from ...sequences.run_folder import read_run
from .. import compat, surfaces
from ..light import light_map
from ..open import light_choice
from . import camera, frames, settings

#: Core-seconds of a path-traced sample of a pixel where bake_core_s was measured. If a sample takes
#: longer, a bake does too.
_SAMPLE_CORE_S = 3.0 / (640 * 480)
#: Files of the look in the run folder: its first view, and the ways that were compared.
PREVIEW = "preview.png"
RECORD = "first_look.json"
#: Numbers of views, longer sides of the windows of them, and the samples that are compared: more is
#: rendered until it takes its share. A window has the frame's own pixels, because a smaller image is
#: harder to denoise; at the sides of a window noise remains, so that a small one seems worse.
_STEPS = (
    (1, 40, FEW_COMPARED),
    (1, 80, FEW_COMPARED),
    (1, 160, FEW_COMPARED),
    (1, 320, FEW_COMPARED),
    (3, 320, FEW_COMPARED),
    (3, 320, COMPARED),
)
#: Where the windows of three views are, as shares of the free columns and rows.
_PLACES = ((0.5, 0.5), (0.0, 1.0), (1.0, 0.0))
#: Longer side of a window with so few pixels that they take no time.
_TINY_PX = 8
#: The look takes at most this share of the time that it announces, if its smallest view does.
_SHARE = 0.1
#: The preview: its share of the frame's side, but for the smallest and the largest side, and its
#: samples.
_PREVIEW_SHARE = 0.25
_PREVIEW_PX = (80, 320)
_PREVIEW_SAMPLES = 16


@dataclass(frozen=True)
class TracingCost:
    """Core-seconds of a path-traced frame: whatever its size, of each pixel (denoising), and of
    each sample of a pixel. cores: the cores that rendering keeps busy.
    """

    frame_core_s: float
    pixel_core_s: float
    sample_core_s: float
    cores: float

    def of(self, pixels: float, samples: float) -> float:
        """Core-seconds of a frame."""
        return self.frame_core_s + pixels * (self.pixel_core_s + samples * self.sample_core_s)


@dataclass(frozen=True, eq=False)
class Look:
    """preview (h, w, 3) 8-bit sRGB of frame `number`; black: the likely cause if it is black.
    windows (n, h, w, 3) 8-bit sRGB: of the frames `numbers`, with the most samples. ways: what was
    compared, and the one that was chosen for `frame_count` frames; none for a mere preview.
    """

    number: int
    preview: np.ndarray
    black: str | None
    core_s: float = 0.0
    numbers: tuple[int, ...] = ()
    windows: np.ndarray | None = None
    frame_count: int = 0
    quality: str = ""
    ways: tuple[Way, ...] = ()

    @property
    def way(self) -> Way:
        """The way that was chosen."""
        return chosen(self.ways, Quality.of(self.quality))

    def write(self, folder: Path, measured_db: float | None = None) -> str:
        """Write preview.png, and first_look.json if ways were compared, into the run folder.
        Returns the sentence to print. measured_db: of the light map that was baked.
        """
        png.write_png(folder / PREVIEW, self.preview)
        if self.ways:
            write_json(folder / RECORD, self._record(measured_db))
        what = f"preview of frame {self.number}, path traced with {_PREVIEW_SAMPLES} samples"
        return f"{what}: {folder / PREVIEW}"

    def _record(self, measured_db: float | None) -> dict[str, Any]:
        ways = [{key: _short(value) for key, value in asdict(way).items()} for way in self.ways]
        record = {
            "quality": self.quality,
            "frames": self.frame_count,
            "views": list(self.numbers),
            "window": list(self.windows.shape[2:0:-1]) if self.windows is not None else [],
            "core_s": _short(self.core_s),
            "chosen": self.ways.index(self.way),
            "ways": ways,
        }
        return record if measured_db is None else record | {"measured_db": _short(measured_db)}

    def sentence(self) -> str:
        """What was chosen, its time and its PSNR."""
        way = self.way
        quality = Quality.of(self.quality)
        count = f"{self.frame_count} frame{'s' * (self.frame_count != 1)}"
        words = [f"light: {way}, about {_time(way.time_s)} for {count}"]
        if way.bake_s:
            words.append(f" with {_time(way.bake_s)} for the bake")
        words.append(f", {way.psnr_db:.0f} dB: ")
        best = "the cheapest way that holds" if quality.psnr_db is not None else "the best way in"
        if not quality.is_held_by(way):
            of = "best" if quality.psnr_db is not None else "fastest"
            best = f"the {of} way, none holds"
        others = [one for one in self.ways if one.light != way.light]
        words.append(f"{best} {self.quality}")
        if others:
            other = max(others, key=lambda one: (quality.is_held_by(one), -one.core_s))
            words.append(f" ({other}: {_time(other.time_s)}, {other.psnr_db:.0f} dB)")
        return "".join(words) + "; the setting quality, such as 30dB or 10min, asks for another"

    def corrected(self, measured_db: float) -> str:
        """What the light map has, beside what was expected of it."""
        way = self.way
        found = f"{measured_db:.0f} dB, {way.psnr_db:.0f} dB were expected"
        wanted = Quality.of(self.quality)
        if wanted.psnr_db is None or wanted.is_held_by(replace(way, psnr_db=measured_db)):
            return f"light: {way}, has {found}"
        return f"light: {way}, has {found}: it does not hold {self.quality}"


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


class _Picture(NamedTuple):
    """rgb (h, w, 3) scene-linear, depth_z_m (h, w), times: (2,) seconds and core-seconds."""

    rgb: np.ndarray
    depth_z_m: np.ndarray
    times: np.ndarray


class _Views:
    """Renders previews and windows of the open scene's frames, and adds up what they take.

    spent: (2,) seconds and core-seconds of all renders so far.
    """

    def __init__(self, raw_file: Path) -> None:
        self._raw_file = raw_file
        self.spent = np.zeros(2)

    def preview(self, number: int) -> _Picture:
        """The whole frame, smaller."""
        render = bpy.context.scene.render
        longer_px = max(render.resolution_x, render.resolution_y)
        side_px = min(max(_PREVIEW_SHARE * longer_px, _PREVIEW_PX[0]), _PREVIEW_PX[1])
        percentage = max(1, min(100, round(100 * side_px / longer_px)))
        with compat.temporarily(render, resolution_percentage=percentage):
            return self._render(number, _PREVIEW_SAMPLES)

    def window(self, number: int, samples: int, side_px: int, place: int) -> _Picture:
        """A window of a frame, at one of the places."""
        with compat.temporarily(bpy.context.scene.render, **_border(side_px, _PLACES[place])):
            return self._render(number, samples)

    def _render(self, number: int, samples: int) -> _Picture:
        bpy.context.scene.cycles.samples = samples
        begun = np.array([time.perf_counter(), time.process_time()])
        raw = frames.render(number, self._raw_file, in_memory=True)
        took = np.array([time.perf_counter(), time.process_time()]) - begun
        self.spent += took
        return _Picture(*frames.read(raw, raw), took)

    def series(self, numbers: Sequence[int], side_px: int, compared: tuple[int, ...]) -> "_Series":
        """Render a window of each frame with each number of samples that is compared."""
        shots = [
            [self.window(number, samples, side_px, place) for samples in compared]
            for place, number in enumerate(numbers)
        ]
        rgb = np.array([[shot.rgb for shot in of_number] for of_number in shots])
        times = np.array([[shot.times for shot in of_number] for of_number in shots])
        return _Series(tuple(numbers), compared, rgb, times)


def _border(side_px: int, place: tuple[float, float]) -> dict[str, object]:
    """The settings of a render of a window with this longer side."""
    render = bpy.context.scene.render
    whole = np.array([render.resolution_x, render.resolution_y])
    size = _size(side_px)
    first = np.floor((whole - size) * place)
    # Blender rounds to whole pixels: a quarter of one is added so that it gives exactly these
    low, high = (first + 0.25) / whole, np.minimum((first + size + 0.25) / whole, 1.0)
    return {
        "use_border": True,
        "use_crop_to_border": True,
        "border_min_x": low[0],
        "border_max_x": high[0],
        "border_min_y": low[1],
        "border_max_y": high[1],
    }


def _size(side_px: int) -> np.ndarray:
    """(2,) columns and rows of a window with this longer side."""
    render = bpy.context.scene.render
    whole = np.array([render.resolution_x, render.resolution_y])
    return np.maximum(1, np.round(whole * min(1.0, side_px / whole.max())))


@dataclass(frozen=True, eq=False)
class _Series:
    """rgb (views, samples, h, w, 3) scene-linear; times (views, samples, 2) seconds and
    core-seconds.
    """

    numbers: tuple[int, ...]
    samples: tuple[int, ...]
    rgb: np.ndarray
    times: np.ndarray

    @property
    def is_whole(self) -> bool:
        """Whether the windows are whole frames."""
        render = bpy.context.scene.render
        return self.rgb.shape[2:4] == (render.resolution_y, render.resolution_x)

    def convergence(self) -> Convergence:
        images = [srgb8(one) for one in np.moveaxis(self.rgb, 1, 0)]
        return Convergence.of(images, self.samples, bpy.context.scene.cycles.use_denoising)

    def cost(self, frame_core_s: float) -> TracingCost:
        """The cost of frames, of which an image of a few pixels takes frame_core_s."""
        pixels = self.rgb.shape[2] * self.rgb.shape[3]
        seconds, core_s = np.moveaxis(self.times.mean(0), -1, 0)
        sample_core_s = (core_s[-1] - core_s[0]) / (self.samples[-1] - self.samples[0])
        sample_core_s = max(sample_core_s, 1e-9 * pixels)
        fixed = max(core_s[0] - self.samples[0] * sample_core_s - frame_core_s, 0.0)
        cores = max(core_s[-1] / seconds[-1], 1e-3)
        return TracingCost(frame_core_s, fixed / pixels, sample_core_s / pixels, cores)


def preview(job: RenderJob, trajectory: Trajectory, number: int, threads: int | None) -> Look:
    """A small preview of frame `number` of the open scene. Settings, camera and materials of the
    scene are changed: open the scene again to render the job.
    """
    _prepare(job, trajectory, threads)
    with tempfile.TemporaryDirectory() as folder:
        shot = _Views(Path(folder) / "raw.exr").preview(number)
    return Look(number, srgb8(shot.rgb), frames.why_black(shot.rgb, shot.depth_z_m))


def look(
    job: RenderJob,
    trajectory: Trajectory,
    requested: Sequence[int],
    threads: int | None,
    can_bake: bool,
    opening_core_s: float,
) -> Look:
    """Compare the ways to light the requested frames of the open scene, which is changed as by
    preview(). opening_core_s: what it took to open it, which the run pays again.
    """
    maps = _maps(job) if can_bake else ()
    _prepare(job, trajectory, threads)
    count = len(requested)
    numbers = tuple(dict.fromkeys(requested[k] for k in (0, count // 2, count - 1)))
    with tempfile.TemporaryDirectory() as folder:
        views = _Views(Path(folder) / "raw.exr")
        # the first prepares data that all frames share
        first, frame_core_s = (
            views.window(n, 1, _TINY_PX, 0).times[1] for n in (numbers[0], numbers[-1])
        )
        shot = views.preview(numbers[0])
        start_core_s = opening_core_s + max(first - frame_core_s, 0.0)
        plan = _RunWays(job, count, start_core_s, frame_core_s, maps)
        series = _compared(views, numbers, plan)
    return Look(
        numbers[0],
        srgb8(shot.rgb),
        frames.why_black(shot.rgb, shot.depth_z_m),
        core_s=float(views.spent[1]),
        numbers=series.numbers,
        windows=srgb8(series.rgb[:, -1]),
        frame_count=count,
        quality=job.quality,
        ways=tuple(plan.ways(series)),
    )


def _compared(views: _Views, numbers: tuple[int, ...], plan: "_RunWays") -> _Series:
    """The largest series of windows that takes its share of the time that is then announced."""
    (count, side_px, compared), *larger = _STEPS
    series = views.series(numbers[:count], side_px, compared)
    for count, side_px, compared in larger:
        if series.is_whole and (series.numbers, series.samples) == (numbers[:count], compared):
            continue
        announced_core_s = chosen(plan.ways(series), Quality.of(plan.job.quality)).core_s
        cost = series.cost(plan.frame_core_s)
        pixels = float(np.prod(_size(side_px)))
        more_core_s = len(numbers[:count]) * sum(cost.of(pixels, n) for n in compared)
        if views.spent[1] + more_core_s > _SHARE * announced_core_s:
            break
        series = views.series(numbers[:count], side_px, compared)
    return series


def _prepare(job: RenderJob, trajectory: Trajectory, threads: int | None) -> None:
    """Set up the open scene for path-traced views of the job's frames."""
    path = light_choice.with_light(job, "path")
    denoise = compat.has_denoiser() and path.denoise
    settings.apply(path.changed(denoise=denoise, antialias=False), threads)
    camera.keyframe(trajectory.T_world_camera, job.camera)


@dataclass(frozen=True)
class _Map:
    """A light map that a run could have: the size of its texels, and the core-seconds of its bake
    where a sample takes _SAMPLE_CORE_S; 0 if it is in the cache.
    """

    size: int
    texel_m: float
    bake_core_s: float


def _maps(job: RenderJob) -> tuple[_Map, ...]:
    """The maps of the open scene, up to the job's size."""
    with surfaces.rendered_parts() as (found, _):
        vectors = surfaces.joined(found).area_vectors() if found else np.zeros((1, 3))
    side_m = float(np.linalg.norm(vectors, axis=1).sum()) ** 0.5
    maps = []
    for size in (*(s for s in MAP_SIZES if s < job.map_size), job.map_size):
        sized = job.changed(map_size=size)
        is_there = light_map.find(shipped.cache_folder(), sized) is not None
        maps.append(_Map(size, side_m / size, 0.0 if is_there else bake_core_s(sized)))
    return tuple(maps)


@dataclass(frozen=True)
class _RunWays:
    """What a run of `count` frames of a job takes, by any way. start_core_s: until its first frame
    begins. frame_core_s: of a frame of few pixels.
    """

    job: RenderJob
    count: int
    start_core_s: float
    frame_core_s: float
    maps: tuple[_Map, ...]

    def ways(self, series: _Series) -> list[Way]:
        """All ways, from a series of windows."""
        cost = series.cost(self.frame_core_s)
        converges = series.convergence()
        ways = [self._path(samples, cost, converges) for samples in PATH_SAMPLES]
        return ways + [self._baked(one, cost) for one in self.maps]

    def _path(self, samples: int, cost: TracingCost, converges: Convergence) -> Way:
        core_s = self.start_core_s + self.count * cost.of(self._pixels, samples)
        return Way("path", samples, None, core_s, core_s / cost.cores, converges.psnr_db(samples))

    def _baked(self, one: _Map, cost: TracingCost) -> Way:
        slowness = max(1.0, cost.sample_core_s / _SAMPLE_CORE_S)
        bake_core_s = one.bake_core_s * slowness
        frame_core_s = cost.of(self._pixels, 1) - self._pixels * cost.pixel_core_s  # not denoised
        core_s = self.start_core_s + bake_core_s + self.count * frame_core_s
        seconds = (core_s / cost.cores, map_psnr_db(one.texel_m), bake_core_s / cost.cores)
        return Way("baked", 1, one.size, core_s, *seconds)

    @property
    def _pixels(self) -> int:
        return self.job.camera.width * self.job.camera.height


def measured_db(look: Look) -> float:
    """The PSNR of the open scene, lit by its map and with its camera, against the windows of a
    look. The scene's settings are changed.
    """
    assert look.windows is not None
    samples = bpy.context.scene.cycles.samples
    side_px = max(look.windows.shape[1:3])
    with tempfile.TemporaryDirectory() as folder:
        views = _Views(Path(folder) / "raw.exr")
        shots = [views.window(n, samples, side_px, k) for k, n in enumerate(look.numbers)]
    return psnr_db(square(srgb8(np.array([shot.rgb for shot in shots])), look.windows))


def choose(job: RenderJob, out: Path, look: Look | None, can_bake: bool) -> tuple[RenderJob, str]:
    """The job with the way that the look chose, and a sentence about it.

    A run that was started in `out` keeps its light. Without a look, light is baked if it can be,
    but path traced if samples were given.
    """
    if (out / "sequence.json").is_file():
        begun = read_run(out).job
        kept = light_choice.with_light(job, begun.light)
        if job.samples is None:
            kept = kept.changed(samples=begun.samples, map_size=begun.map_size)
        return kept, f"light: {begun.light}, as when this run was started"
    if look is not None:
        lit = light_choice.with_light(job, look.way.light)
        return lit.changed(**look.way.settings), look.sentence()
    light = "baked" if can_bake and job.samples is None else "path"
    lit = light_choice.with_light(job, light)
    return lit, f"light: {light}, {lit.samples} sample{'s' * (lit.samples != 1)}"


def _short(value: Any) -> Any:
    """A number of a record, with four digits."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _time(seconds: float) -> str:
    for unit, size in (("s", 1), ("min", 60)):
        if seconds < 100 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 3600:.0f} h"
