"""Measures noise models: the time of sequences relative to that of their files alone, the time of
each model alone, and its similarity to published noisy frames.

Similarity is the overlap of two histograms of pixels. A bin of the histogram is given by the true
depth or value of a pixel and by its error, or by the fact that the pixel is missing. The overlap is
the share of pixels that both noises put into the same bins: 1 if they are equal, 0 if they have
nothing in common. It measures amount, bias and gaps of the noise by depth and brightness, but not
its correlation between pixels.
"""

import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from iclnuim.errors import InputError
from iclnuim.formats.exr import read_exr
from iclnuim.formats.png import write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.models import DEPTH_MODELS, RGB_MODELS, depth_model, rgb_model, with_depth_noise
from iclnuim.sensor.noise_model import DEPTH, RGB, frame_generator
from iclnuim.sensor.transfer import srgb8
from iclnuim.sequences.frame_images import noisy_images
from iclnuim.sequences.frame_pool import keep_freed_memory
from iclnuim.sequences.frame_source import FrameSource, image_frames, run_frames
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.writer import SequenceWriter
from iclnuim.shown import COLOURS
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: Pairs of depth and RGB models that users combine.
PAIRS = (
    ("none", "none"),
    ("paper", "paper"),
    ("released", "released"),
    ("kinect2012", "paper"),
    ("redwood", "paper"),
    ("d435", "released"),
    ("azure_kinect", "released"),
    ("phone", "released"),
)
#: Bin edges of true depth, and of true 8-bit values.
_DEPTHS_M = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0])
_VALUES = np.array([40, 80, 120, 160, 200])
#: Disparity in steps of the paper's equation 3 is this constant divided by the depth in metres.
_STEPS_M = 351.3
#: Bins of errors: half a disparity step wide up to 6 steps for depth, one value wide up to 12 of
#: 255 for colour.
_BINS = 24
_MISSING = _BINS + 1

_MODELS = {"depth": DEPTH_MODELS, "rgb": RGB_MODELS}
Figures = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class PairTime:
    """Medians over rounds: frames per second (a frame reads one EXR and writes four PNGs, clean and
    noisy) and processor time per frame. ratio, cpu_ratio: both times relative to reading these EXRs
    and writing these PNGs alone, within a round.
    """

    depth: str
    rgb: str
    frames_per_s: float
    cpu_ms: float
    ratio: float
    cpu_ratio: float


def pair_times(
    raw: Path, frames: str, rounds: int, workers: int, on_round: Callable[[], None] = lambda: None
) -> list[PairTime]:
    """Measure each of PAIRS on the frames of a run, `rounds` times, alternating between sequences
    with noise and files alone.
    """
    source = run_frames(raw, frames)
    found = []
    for depth, rgb in PAIRS:
        noisy = SequenceSettings(depth_model(depth), rgb_model(rgb), seed=1)
        images = [_images(source, number, noisy) for number in source.numbers]
        times = []
        for _ in range(rounds):
            with tempfile.TemporaryDirectory() as scratch:
                out = Path(scratch)
                written = {out / "clean": SequenceSettings(), out / "noisy": noisy}
                begun = _clocks()
                SequenceWriter(source, written).write(workers)
                made = _clocks()
                _files_alone(raw, source.numbers, images, out, workers)
                times.append((*(made - begun), *(_clocks() - made)))
            on_round()
        made_s, made_cpu, files_s, files_cpu = np.array(times).T
        count = len(source.numbers)
        found.append(
            PairTime(
                depth=depth,
                rgb=rgb,
                frames_per_s=count / float(np.median(made_s)),
                cpu_ms=1e3 * float(np.median(made_cpu)) / count,
                ratio=float(np.median(made_s / files_s)),
                cpu_ratio=float(np.median(made_cpu / files_cpu)),
            )
        )
    return found


def _images(source: FrameSource, number: int, noisy: SequenceSettings) -> list[np.ndarray]:
    """Clean colour and depth, noisy colour and depth of a frame."""
    light, depth_z_m = source.load(number)
    images: list[np.ndarray] = []
    for settings in (SequenceSettings(), noisy):
        images += noisy_images(light, depth_z_m, source.camera, number, settings)[:2]
    return images


def model_times_ms(raw: Path, frames: str, repeats: int = 15) -> dict[str, dict[str, float]]:
    """{"depth": {model: median ms per frame}, "rgb": ...}: processor time of one thread."""
    source = run_frames(raw, frames)
    frame = FrameImages.of(source, source.numbers[len(source.numbers) // 2])

    def median_ms(kind: str, name: str) -> float:
        times = []
        for _ in range(repeats + 1):  # the first run is not counted, as it makes tables
            start = time.thread_time()
            frame.with_noise(kind, name, 0)
            times.append(time.thread_time() - start)
        return 1e3 * float(np.median(times[1:]))

    keep_freed_memory()  # as the writer of sequences does
    return _of_every_model(median_ms)


def _of_every_model(figure: Callable[[str, str], float]) -> dict[str, dict[str, float]]:
    found = {}
    for kind, names in _MODELS.items():
        found[kind] = {name: figure(kind, name) for name in names}
    return found


@dataclass(frozen=True, eq=False)
class FrameImages:
    """The images of a frame: scene-linear colour and planar depth."""

    number: int
    camera: PinholeCamera
    light: np.ndarray
    depth_z_m: np.ndarray

    @classmethod
    def of(cls, source: FrameSource, number: int) -> "FrameImages":
        light, depth_z_m = source.load(number)
        return cls(number, source.camera, light, depth_z_m)

    def image(self, kind: str) -> np.ndarray:
        """The depth in metres, or the 8-bit colour."""
        if kind == "depth":
            return self.depth_z_m
        return srgb8(self.light)

    def with_noise(self, kind: str, name: str, seed: int) -> np.ndarray:
        """The image with the noise of a model."""
        if kind == "depth":
            rng = frame_generator(seed, self.number, DEPTH)
            model = depth_model(name)
            return with_depth_noise(model, self.depth_z_m, self.camera, rng, self.light)
        return rgb_model(name).apply(self.light, frame_generator(seed, self.number, RGB))


def _clocks() -> np.ndarray:
    """Wall time and processor time in seconds.

    Processor time has a resolution of 1 ns for this process and of 10 ms for ended child processes.
    """
    return np.array([time.perf_counter(), time.process_time() + sum(os.times()[2:4])])


def _files_alone(
    raw: Path, numbers: Sequence[int], images: Sequence[list[np.ndarray]], out: Path, workers: int
) -> None:
    """The necessary work: read every EXR, write every image."""

    def one(number: int, four: list[np.ndarray]) -> None:
        read_exr(raw / "exr" / f"{number:06}.exr")
        for k, image in enumerate(four):
            write_png(out / f"{number:06}_{k}.png", image)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(one, numbers, images))


# -- similarity


def overlaps(clean: Path, noisy: Path) -> dict[str, dict[str, float]]:
    """{"depth": {model: overlap}, "rgb": ...}: the overlap of each model, run on `clean`, with
    `noisy`, which has the same frames.

    Raises InputError if they have no frame number in common.
    """
    sources = image_frames(clean), image_frames(noisy)
    numbers = sorted(set(sources[0].numbers).intersection(sources[1].numbers))
    if not numbers:
        raise InputError(f"frames of {noisy}", path=clean, found="none of their numbers")
    clean_frames, noisy_frames = ([FrameImages.of(s, n) for n in numbers] for s in sources)

    def overlap(kind: str, name: str) -> float:
        """Overlap of the histograms over all frames."""
        cells = depth_cells if kind == "depth" else value_cells
        first = second = np.zeros(4096)
        for frame, published in zip(clean_frames, noisy_frames, strict=True):
            true = frame.image(kind)
            ours = frame.with_noise(kind, name, 1)
            first = first + np.bincount(cells(true, published.image(kind)), minlength=4096)
            second = second + np.bincount(cells(true, ours), minlength=4096)
        return float(np.minimum(first, second).sum() / first.sum())

    return _of_every_model(overlap)


def depth_cells(clean_z_m: np.ndarray, noisy_z_m: np.ndarray) -> np.ndarray:
    """(h, w) planar depth in metres -> (n,) bins of the n pixels whose true depth is known."""
    seen = clean_z_m > 0
    clean, noisy = clean_z_m[seen].astype(float), noisy_z_m[seen].astype(float)
    steps = _STEPS_M / np.maximum(noisy, 0.01) - _STEPS_M / clean
    error = np.where(noisy < 0.6 * clean, _MISSING, _binned(steps / 0.5))
    return np.digitize(clean, _DEPTHS_M) * 64 + error.astype(int)


def value_cells(clean: np.ndarray, noisy: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 -> (n,) bins, separate for each channel."""
    error = _binned(noisy.astype(int) - clean)
    return (np.arange(3) * 512 + np.digitize(clean, _VALUES) * 64 + error).astype(int).ravel()


def _binned(error: np.ndarray) -> np.ndarray:
    """Errors, clipped to -12..12 -> bins 0..24."""
    return np.clip(np.rint(error), -_BINS // 2, _BINS // 2) + _BINS // 2


# -- chart


def figure(pairs: Sequence[PairTime], times_ms: Figures, overlaps: Figures | None) -> Figure:
    """Left: time of each model, and its overlap if `overlaps` is given. Right: time of clean and
    noisy frames relative to their files alone.
    """
    drawn = Figure(figsize=(11, 4.4), layout="constrained")
    left, right = drawn.subplots(1, 2)
    _draw_models(left, times_ms, overlaps)
    names = [f"{p.depth} + {p.rgb}" for p in pairs]
    bars = right.barh(names, [p.cpu_ratio for p in pairs], color=COLOURS[4], height=0.6)
    right.bar_label(bars, [f"{p.cpu_ms:.0f} ms" for p in pairs], padding=3, fontsize=9)
    right.invert_yaxis()
    right.axvline(1, color="black", linewidth=0.8)
    right.set_xlabel(
        "processor time of clean + noisy relative to\nreading the EXR and writing the PNGs alone"
    )
    right.set_xlim(0, 1.15 * max(p.cpu_ratio for p in pairs))
    return drawn


def _draw_models(axes: Axes, times_ms: Figures, overlaps: Figures | None) -> None:
    for kind, label, colour in (("depth", "depth", COLOURS[0]), ("rgb", "RGB", COLOURS[1])):
        times = times_ms[kind]
        names = [f"{label} {name}" for name in times]
        bars = axes.barh(names, list(times.values()), color=colour, height=0.6)
        texts = [f"{ms:.1f} ms" for ms in times.values()]
        if overlaps:
            texts = [
                f"{text}, overlap {overlaps[kind][name]:.2f}"
                for text, name in zip(texts, times, strict=True)
            ]
        axes.bar_label(bars, texts, padding=3, fontsize=9)
    axes.invert_yaxis()
    axes.set_xlabel("ms per frame, 640 x 480, one thread")
    axes.set_xlim(0, 1.7 * max(max(t.values()) for t in times_ms.values()))
