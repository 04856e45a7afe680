"""Curves of speed against accuracy: one setting changes in steps, everything else is constant, and
all steps use the same frames in one run.

Times can be compared only within a run: all variants process a frame before the next frame is
loaded.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
from iclnuim.benchmark.odometry.protocol import Frame, Odometer
from iclnuim.benchmark.odometry.registry import BASELINES, odometer
from iclnuim.benchmark.odometry.track import KeyframeReference, Tracker
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import FRAME_RATE_HZ, Trajectory, sample
from iclnuim.sensor.rgb import PaperRgbNoise
from iclnuim.sensor.transfer import srgb8

from ..perturbations.motion import depth_at, exposed
from ..perturbations.segment import Segment
from .outcome import ate_rmse_m

#: Maximum relative difference between depths of one surface.
_EDGE = 0.02


@dataclass(frozen=True)
class Point:
    """One step of a curve for one method: number of frames, of those processed and tracked, ATE,
    and median processing time per frame.

    value: None for a method that does not have the setting, and so has one step only.
    """

    method: str
    curve: str
    value: float | None
    frames: int
    processed: int
    tracked: int
    ate_m: float | None
    ms: float

    @property
    def failed(self) -> bool:
        """Whether more than half of the processed frames were lost."""
        return 2 * self.tracked < self.processed

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(eq=False)
class Variant:
    """A method at one step. halvings: how often each image is halved before it is tracked."""

    method: str
    value: float | None
    tracker: Tracker
    halvings: int = 0
    seconds: list[float] = field(default_factory=list)  # processing time of each frame
    stamps_s: list[float] = field(default_factory=list)
    poses: list[SE3] = field(default_factory=list)

    def add(self, stamp_s: float, frame: Frame) -> None:
        found = self.tracker.add(stamp_s, halved(frame, self.halvings))
        self.seconds.append(found.result.seconds)
        if not found.lost:
            self.stamps_s.append(stamp_s)
            self.poses.append(found.T_world_camera)

    def point(self, curve: str, truth: Trajectory, frames: int) -> Point:
        """ATE over the frames that were tracked."""
        ate_m = None
        if len(self.poses) > 2:
            poses = SE3.from_matrix(np.array([T.matrix for T in self.poses]))
            ate_m = ate_rmse_m(truth, Trajectory(np.array(self.stamps_s), poses))
        ms = 1e3 * float(np.median(self.seconds))
        return Point(
            self.method, curve, self.value, frames, len(self.seconds), len(self.poses), ate_m, ms
        )


@dataclass(eq=False)
class Busy(Variant):
    """A live camera, on a machine `value` times as slow: frames that arrive before the previous one
    is processed are dropped.
    """

    done_s: float = -np.inf

    def add(self, stamp_s: float, frame: Frame) -> None:
        if stamp_s < self.done_s:
            return
        super().add(stamp_s, frame)
        self.done_s = stamp_s + (self.value or 1.0) * self.seconds[-1]


# -- settings of our odometers in steps: (settings of the method, value) -> settings


def levels(settings: Any, value: float) -> Any:
    """Leave out this number of the finest levels."""
    used = [n for n, count in enumerate(settings.iterations) if count]
    if value >= len(used):
        raise InputError(f"fewer than {len(used)} levels left out", found=value)
    left_out = used[: int(value)]
    return replace(
        settings,
        iterations=tuple(0 if n in left_out else c for n, c in enumerate(settings.iterations)),
    )


def iterations(settings: Any, value: float) -> Any:
    """Multiply all numbers of iterations by the value; at least one iteration remains."""
    counts = tuple(max(1, round(value * count)) if count else 0 for count in settings.iterations)
    return replace(settings, iterations=counts)


def pixels(settings: Any, value: float) -> Any:
    """Use fewer pixels: multiply the minimum gradients by the value, or the strides in rows and
    columns.
    """
    if hasattr(settings, "strides"):
        return replace(
            settings, strides=tuple(max(1, round(value * stride)) for stride in settings.strides)
        )
    return replace(settings, min_gradients=tuple(value * g for g in settings.min_gradients))


#: Curve -> function of settings, default values, unit.
SETTINGS: dict[str, tuple[Callable[[Any, float], Any], tuple[float, ...], str]] = {
    "levels": (levels, (0, 1, 2), "finest levels left out"),
    "iterations": (iterations, (0.25, 0.5, 1, 2, 4), "times the default"),
    "pixels": (pixels, (1, 2, 4, 8), "times the minimum gradient or the stride"),
}
#: Further curves -> default values, unit.
OTHERS: dict[str, tuple[tuple[float, ...], str]] = {
    "keyframe": ((0.02, 0.05, 0.1, 0.2, 0.4), "metres to the next keyframe"),
    "resolution": ((640, 320, 160), "width of the images in pixels"),
    "realtime": ((1, 2, 4, 8, 16), "times slower machine, frames dropped while it is busy"),
    "rate": ((15, 30, 60, 120, 240), "frames per second, exposed for half of each"),
}
CURVES = {name: (values, unit) for name, (_, values, unit) in SETTINGS.items()} | OTHERS


def measure(
    curve: str,
    methods: Sequence[str],
    values: Sequence[float],
    segment: Segment,
    progress: Callable[[], object],
) -> list[Point]:
    """Measure all steps of all methods; progress() is called once per frame. Methods without the
    setting have one step.

    Raises InputError if no method has it.
    """
    if curve == "rate":
        points = [point for hz in values for point in _at_rate(methods, hz, segment, progress)]
        return sorted(points, key=lambda p: methods.index(p.method))
    if curve in SETTINGS and not any(map(_has_iterations, methods)):
        raise InputError(
            "rgbd, dvo, icp or icp_rgbd, which have such settings", found=", ".join(methods)
        )
    steps = [(method, value) for method in methods for value in _values(curve, method, values)]
    if not steps:  # only levels can run out
        raise InputError(
            "fewer levels left out than a method has", found=", ".join(f"{v:g}" for v in values)
        )
    variants = [_variant(curve, method, value, segment.camera) for method, value in steps]
    return interleaved(curve, variants, segment.frames, segment.truth, progress)


def length(curve: str, values: Sequence[float], segment: Segment) -> int:
    """Number of frames to process."""
    return (
        sum(len(_stamps_s(segment, hz)) for hz in values)
        if curve == "rate"
        else len(segment.numbers)
    )


def interleaved(
    curve: str,
    variants: list[Variant],
    frames: Callable[[], Iterable[tuple[float, Frame]]],
    truth: Trajectory,
    progress: Callable[[], object],
) -> list[Point]:
    """Process every frame with all variants in turn.

    The first frames are also processed beforehand, so that compiling is not timed.
    """
    first = list(islice(frames(), 3))
    for one in variants:
        again = Tracker(one.tracker.odometer, one.tracker.camera)
        for stamp_s, frame in first:
            again.add(stamp_s, halved(frame, one.halvings))
    total = 0
    for stamp_s, frame in frames():
        total += 1
        for one in variants:
            one.add(stamp_s, frame)
        progress()
    return [one.point(curve, truth, total) for one in variants]


def _values(curve: str, method: str, values: Sequence[float]) -> Sequence[float | None]:
    """The steps that a method has: with fewer levels it can leave out fewer of them."""
    if curve in SETTINGS and not _has_iterations(method):
        return (None,)
    if curve != "levels":
        return values
    fewest = min(sum(map(bool, part.iterations)) for part in _parts(method))
    return [value for value in values if value < fewest]


def _variant(curve: str, method: str, value: float | None, camera: PinholeCamera) -> Variant:
    if value is None:
        return Variant(method, None, Tracker(odometer(method), camera))
    if curve in SETTINGS:
        return Variant(method, value, Tracker(_changed(method, SETTINGS[curve][0], value), camera))
    if curve == "keyframe":
        return Variant(
            method,
            value,
            Tracker(odometer(method), camera, against=KeyframeReference(value, 50.0 * value)),
        )
    if curve == "realtime":
        return Busy(method, value, Tracker(odometer(method), camera))
    halvings = round(float(np.log2(camera.width / value)))
    if halvings < 0 or camera.width != value * 2**halvings:
        raise InputError(f"{camera.width} divided by a power of two", found=value)
    for _ in range(halvings):
        camera = camera.halved()
    return Variant(method, value, Tracker(odometer(method), camera), halvings)


def _has_iterations(method: str) -> bool:
    """Whether it is one of our odometers that align images or planes step by step."""
    return method not in BASELINES and method != "fovis"


def _changed(method: str, change: Callable[[Any, float], Any], value: float) -> Odometer:
    """One of our odometers with changed settings, in all of its groups of settings that have
    iterations.
    """
    kind, preset = _best(method)
    if isinstance(preset, tuple):
        return kind(
            tuple(change(part, value) if hasattr(part, "iterations") else part for part in preset)
        )
    return kind(change(preset, value))


def _best(method: str) -> tuple[Any, Any]:
    """The class of one of our odometers, and its preset: settings, or a tuple with several groups
    of them.
    """
    kind: Any = type(odometer(method))
    return kind, kind.PRESETS["best"]


def _parts(method: str) -> list[Any]:
    """The groups of settings of one of our odometers that have iterations."""
    _, preset = _best(method)
    return [
        part
        for part in (preset if isinstance(preset, tuple) else (preset,))
        if hasattr(part, "iterations")
    ]


def halved(frame: Frame, times: int) -> Frame:
    """The frame at half size, `times` times: 2 x 2 means of grey, and of depth where its four
    pixels belong to one surface; elsewhere depth is missing.
    """
    grey, depth_z_m = frame.grey, frame.depth_z_m
    for _ in range(times):
        h, w = (side // 2 * 2 for side in grey.shape)
        four = np.stack([depth_z_m[y:h:2, x:w:2] for y in (0, 1) for x in (0, 1)])
        whole = (four.min(0) > 0) & (four.max(0) < (1 + _EDGE) * four.min(0))
        depth_z_m = np.where(whole, four.mean(0), 0).astype(np.float32)
        grey = np.mean(
            [grey[y:h:2, x:w:2] for y in (0, 1) for x in (0, 1)], axis=0, dtype=np.float32
        )
    return Frame(grey, depth_z_m, frame.stamp_s)


def _stamps_s(segment: Segment, hz: float) -> np.ndarray:
    first_s, last_s = (segment.stamps_s[segment.numbers[k]] for k in (0, -1))
    return first_s + np.arange(int((last_s - first_s) * hz + 1e-6) + 1) / hz


def _at_rate(
    methods: Sequence[str], hz: float, segment: Segment, progress: Callable[[], object]
) -> list[Point]:
    """Frames at another rate, exposed for half of their period: shorter exposures are sharper and
    noisier (Handa et al., ECCV 2012).
    """
    noise, light_share = PaperRgbNoise(), np.float32(FRAME_RATE_HZ / hz)

    def frames() -> Iterator[tuple[float, Frame]]:
        for stamp_s in _stamps_s(segment, hz):
            light = exposed(segment, stamp_s, 0.5 / hz)
            rng = segment.generator(round(stamp_s * 1e4))
            colour = srgb8(noise.noisy_light(np.maximum(light, 0) * light_share, rng) / light_share)
            yield float(stamp_s), Frame.of(colour, depth_at(segment, stamp_s), float(stamp_s))

    variants = [
        Variant(method, hz, Tracker(odometer(method), segment.camera)) for method in methods
    ]
    dense = Trajectory(_stamps_s(segment, hz), sample(segment.truth, _stamps_s(segment, hz)))
    return interleaved("rate", variants, frames, dense, progress)


def table(points: Sequence[Point]) -> str:
    """One line per point."""
    lines = [f"{'method':<26}{'value':>8}{'tracked':>10}{'ATE [mm]':>10}{'ms':>8}"]
    for p in points:
        ate = "-" if p.ate_m is None else f"{1e3 * p.ate_m:.3f}"
        value = "-" if p.value is None else f"{p.value:g}"
        lines.append(
            f"{p.method:<26}{value:>8}{f'{p.tracked}/{p.frames}':>10}{ate:>10}{p.ms:>8.1f}"
        )
    return "\n".join(lines)
