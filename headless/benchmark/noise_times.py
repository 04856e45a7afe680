"""Noise models in one run: time of clean and noisy sequences beside that of their files alone, and of each model alone."""

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from iclnuim.dataset.frames import FrameSource, run_frames
from iclnuim.dataset.sequence import SequenceSettings, SequenceWriter, keep_freed_memory, noisy_images
from iclnuim.formats.exr import read_exr
from iclnuim.formats.png import write_png
from iclnuim.sensor.models import DEPTH_MODELS, RGB_MODELS, depth_model, rgb_model
from iclnuim.sensor.randomness import DEPTH, RGB, frame_generator

#: Depth and RGB models as users pair them.
PAIRS = (
    ("none", "none"),
    ("paper", "paper"),
    ("released", "released"),
    ("kinect2012", "paper"),
    ("redwood", "paper"),
)


@dataclass(frozen=True)
class PairTime:
    """Medians over rounds: frames a second (clean and noisy of each: one EXR read, four PNGs written) and processor time
    a frame; both times as multiples of reading those EXRs and writing those PNGs alone, within a round.
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
    """Each of PAIRS on the frames of a run, `rounds` times with noise and without, in turns."""
    source = run_frames(raw, frames)
    return [_pair(raw, source, depth, rgb, rounds, workers, on_round) for depth, rgb in PAIRS]


def model_times_ms(raw: Path, frames: str, repeats: int = 15) -> dict[str, dict[str, float]]:
    """{"depth": {model: median ms a frame}, "rgb": ...}, processor time of one thread."""
    source = run_frames(raw, frames)
    number = source.numbers[len(source.numbers) // 2]
    light, depth_z_m = source.load(number)

    def depth(name: str) -> None:
        depth_model(name).apply(depth_z_m, source.camera, frame_generator(0, number, DEPTH))

    def rgb(name: str) -> None:
        rgb_model(name).apply(light, frame_generator(0, number, RGB))

    works = (("depth", depth, DEPTH_MODELS), ("rgb", rgb, RGB_MODELS))
    keep_freed_memory()  # as where sequences are written
    return {kind: {name: _median_ms(work, name, repeats) for name in names} for kind, work, names in works}


def _median_ms(work: Callable[[str], None], name: str, repeats: int) -> float:
    work(name)  # tables are made once
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        work(name)
        times.append(time.thread_time() - start)
    return 1e3 * float(np.median(times))


def _timed(work: Callable, *arguments: object) -> tuple[float, float]:
    """Seconds by the clock, and of this process and those it began on all cores."""
    clock, cpu = time.perf_counter(), _processor_s()
    work(*arguments)
    return time.perf_counter() - clock, _processor_s() - cpu


def _processor_s() -> float:
    """Of this process to the nanosecond, and of those that ended to the tick (10 ms)."""
    return time.process_time() + sum(os.times()[2:4])


def _pair(
    raw: Path, source: FrameSource, depth: str, rgb: str, rounds: int, workers: int, on_round: Callable[[], None]
) -> PairTime:
    noisy = SequenceSettings(depth_model(depth), rgb_model(rgb), seed=1)
    images = [_images(source, number, noisy) for number in source.numbers]
    times = []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as scratch:
            made = _timed(_make, source, noisy, Path(scratch), workers)
            files = _timed(_files_alone, raw, source.numbers, images, Path(scratch), workers)
        times.append((*made, *files))
        on_round()
    made_s, made_cpu, files_s, files_cpu = np.array(times).T
    return PairTime(
        depth,
        rgb,
        frames_per_s=len(source.numbers) / float(np.median(made_s)),
        cpu_ms=1e3 * float(np.median(made_cpu)) / len(source.numbers),
        ratio=float(np.median(made_s / files_s)),
        cpu_ratio=float(np.median(made_cpu / files_cpu)),
    )


def _images(source: FrameSource, number: int, noisy: SequenceSettings) -> list[np.ndarray]:
    """The four images of a frame: clean colour and depth, noisy colour and depth."""
    light, depth_z_m = source.load(number)
    both = (noisy_images(light, depth_z_m, source.camera, number, s)[:2] for s in (SequenceSettings(), noisy))
    return [image for pair in both for image in pair]


def _make(source: FrameSource, noisy: SequenceSettings, out: Path, workers: int) -> None:
    SequenceWriter(source, {out / "clean": SequenceSettings(), out / "noisy": noisy}).write(workers)


def _files_alone(
    raw: Path, numbers: Sequence[int], images: Sequence[list[np.ndarray]], out: Path, workers: int
) -> None:
    """What cannot be spared: every EXR read, every image written."""

    def one(number: int, four: list[np.ndarray]) -> None:
        read_exr(raw / "exr" / f"{number:06}.exr")
        for k, image in enumerate(four):
            write_png(out / f"{number:06}_{k}.png", image)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(one, numbers, images))
