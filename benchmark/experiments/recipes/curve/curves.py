"""Curves of speed against accuracy: one setting changes in steps, everything else is constant, and
all steps use the same frames in one run.

Times can be compared only within a run: all variants process a frame before the next frame is
loaded.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
from iclnuim.benchmark.odometry.protocol import Frame, Odometer
from iclnuim.benchmark.odometry.references import KeyframeReference
from iclnuim.benchmark.odometry.registry import ODOMETERS, odometer
from iclnuim.benchmark.odometry.track import Tracker
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import FRAME_RATE_HZ, Trajectory, sample
from iclnuim.sensor.rgb import PaperRgbNoise
from iclnuim.sensor.transfer import srgb8

from ....perturbations.motion import depth_at, exposed
from ....perturbations.segment import Segment
from ...outcome import ate_rmse_m

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
        return Point(
            method=self.method,
            curve=curve,
            value=self.value,
            frames=frames,
            processed=len(self.seconds),
            tracked=len(self.poses),
            ate_m=ate_m,
            ms=1e3 * float(np.median(self.seconds)),
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


# -- settings of our odometers in steps: (group of settings, value) -> changed group


def levels(settings: Any, value: float) -> Any:
    """Leave out this number of the finest levels."""
    used = [n for n, count in enumerate(settings.iterations) if count]
    if value >= len(used):
        raise InputError(f"fewer than {len(used)} levels left out", found=value)
    counts = list(settings.iterations)
    for n in used[: int(value)]:
        counts[n] = 0
    return replace(settings, iterations=tuple(counts))


def iterations(settings: Any, value: float) -> Any:
    """Multiply all numbers of iterations by the value; at least one iteration remains."""
    counts = tuple(count and max(1, round(value * count)) for count in settings.iterations)
    return replace(settings, iterations=counts)


def pixels(settings: Any, value: float) -> Any:
    """Use fewer pixels: multiply the minimum gradients by the value, or the strides in rows and
    columns.
    """
    if hasattr(settings, "strides"):
        strides = tuple(max(1, round(value * stride)) for stride in settings.strides)
        return replace(settings, strides=strides)
    return replace(settings, min_gradients=tuple(value * g for g in settings.min_gradients))


@dataclass(frozen=True)
class Setting:
    """What a curve changes. change: function of a group of settings and a value, for odometers that
    have one of the fields, level by level; other methods have one step.
    """

    values: tuple[float, ...]
    unit: str
    change: Callable[[Any, float], Any] | None = None
    fields: tuple[str, ...] = ()

    def changes(self, group: Any) -> bool:
        """Whether a group of settings has it."""
        return any(isinstance(getattr(group, name, None), tuple) for name in self.fields)


CURVES = {
    "levels": Setting((0, 1, 2), "finest levels left out", levels, ("iterations",)),
    "iterations": Setting((0.25, 0.5, 1, 2, 4), "times the default", iterations, ("iterations",)),
    "pixels": Setting(
        (1, 2, 4, 8),
        "times the minimum gradient or the stride",
        pixels,
        ("strides", "min_gradients"),
    ),
    "keyframe": Setting((0.02, 0.05, 0.1, 0.2, 0.4), "metres to the next keyframe"),
    "resolution": Setting((640, 320, 160), "width of the images in pixels"),
    "realtime": Setting((1, 2, 4, 8, 16), "times slower machine, frames dropped while it is busy"),
    "rate": Setting((15, 30, 60, 120, 240), "frames per second, exposed for half of each"),
}
#: A method and its value; None for a method that does not have the setting.
Step = tuple[str, float | None]


def steps_of(curve: str, methods: Sequence[str], values: Sequence[float]) -> list[Step]:
    """All steps of all methods. Methods without the setting have one step.

    Raises InputError if no method has it.
    """
    setting = CURVES[curve]
    if setting.change and not any(_groups(method, setting) for method in methods):
        known = [name for name in ODOMETERS if _groups(name, setting)]
        expected = f"an odometer with such settings ({', '.join(known)})"
        raise InputError(expected, found=", ".join(methods))
    found: list[Step] = []
    for method in methods:
        own = _groups(method, setting)
        if setting.change and not own:
            found.append((method, None))
            continue
        fewest = min((sum(map(bool, g.iterations)) for g in own), default=0)
        found += [(method, v) for v in values if curve != "levels" or v < fewest]
    if not found:  # only levels can run out
        given = ", ".join(f"{v:g}" for v in values)
        raise InputError("fewer levels left out than a method has", found=given)
    return found


def measure(
    curve: str, steps: Sequence[Step], segment: Segment, progress: Callable[[], object]
) -> list[Point]:
    """Measure all steps; progress() is called once per frame."""
    if curve != "rate":
        variants = [_variant(curve, method, value, segment.camera) for method, value in steps]
        return interleaved(curve, variants, segment.frames, segment.truth, progress)
    points: dict[Step, Point] = {}
    for hz in dict.fromkeys(value for _, value in steps if value is not None):
        methods = [method for method, value in steps if value == hz]
        found = _at_rate(methods, hz, segment, progress)
        points |= {(point.method, point.value): point for point in found}
    return [points[step] for step in steps]


def length(curve: str, values: Sequence[float], segment: Segment) -> int:
    """Number of frames to process."""
    if curve != "rate":
        return len(segment.numbers)
    return sum(len(_stamps_s(segment, hz)) for hz in values)


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


def _variant(curve: str, method: str, value: float | None, camera: PinholeCamera) -> Variant:
    if value is None:
        return Variant(method, None, Tracker(odometer(method), camera))
    if CURVES[curve].change:
        return Variant(method, value, Tracker(changed(method, CURVES[curve], value), camera))
    if curve == "keyframe":
        reference = KeyframeReference(value, 50.0 * value)
        return Variant(method, value, Tracker(odometer(method), camera, against=reference))
    if curve == "realtime":
        return Busy(method, value, Tracker(odometer(method), camera))
    halvings = round(float(np.log2(camera.width / value)))
    if halvings < 0 or camera.width != value * 2**halvings:
        raise InputError(f"{camera.width} divided by a power of two", found=value)
    for _ in range(halvings):
        camera = camera.halved()
    return Variant(method, value, Tracker(odometer(method), camera), halvings)


def _preset(method: str) -> tuple[Any, Any]:
    """The class of one of our odometers, and its preset: settings, or a tuple with several groups
    of them.
    """
    kind: Any = type(odometer(method))
    return kind, kind.PRESETS["best"]


def _groups(method: str, setting: Setting) -> list[Any]:
    """The groups of settings of a method that a curve changes."""
    if setting.change is None or method not in ODOMETERS:
        return []
    _, preset = _preset(method)
    groups = preset if isinstance(preset, tuple) else (preset,)
    return [group for group in groups if setting.changes(group)]


def changed(method: str, setting: Setting, value: float) -> Odometer:
    """One of our odometers with changed settings, in all groups that have the setting."""
    kind, preset = _preset(method)
    change = setting.change
    assert change is not None
    if not isinstance(preset, tuple):
        return kind(change(preset, value))
    groups = list(preset)
    for k, group in enumerate(groups):
        if setting.changes(group):
            groups[k] = change(group, value)
    return kind(tuple(groups))


def halved(frame: Frame, times: int) -> Frame:
    """The frame at half size, `times` times: 2 x 2 means of grey, and of depth where its four
    pixels belong to one surface; elsewhere depth is missing.
    """
    grey = frame.grey
    depth_z_m = frame.depth_z_m
    for _ in range(times):
        four = np.stack(_of_each_four(depth_z_m))
        whole = (four.min(0) > 0) & (four.max(0) < (1 + _EDGE) * four.min(0))
        depth_z_m = np.where(whole, four.mean(0), 0).astype(np.float32)
        grey = np.mean(_of_each_four(grey), axis=0, dtype=np.float32)
    return Frame(grey, depth_z_m, frame.stamp_s)


def _of_each_four(image: np.ndarray) -> list[np.ndarray]:
    """The four pixels of each square of 2 x 2 pixels, as four images."""
    h = image.shape[0] // 2 * 2
    w = image.shape[1] // 2 * 2
    return [image[y:h:2, x:w:2] for y, x in np.ndindex(2, 2)]


def _stamps_s(segment: Segment, hz: float) -> np.ndarray:
    first_s = segment.stamps_s[segment.numbers[0]]
    last_s = segment.stamps_s[segment.numbers[-1]]
    return first_s + np.arange(int((last_s - first_s) * hz + 1e-6) + 1) / hz


def _at_rate(
    methods: Sequence[str], hz: float, segment: Segment, progress: Callable[[], object]
) -> list[Point]:
    """Frames at another rate, exposed for half of their period: shorter exposures are sharper and
    noisier (Handa et al., ECCV 2012).
    """
    noise = PaperRgbNoise()
    light_share = np.float32(FRAME_RATE_HZ / hz)

    def frames() -> Iterator[tuple[float, Frame]]:
        for stamp_s in _stamps_s(segment, hz):
            light = exposed(segment, stamp_s, 0.5 / hz)
            rng = segment.generator(round(stamp_s * 1e4))
            colour = srgb8(noise.noisy_light(np.maximum(light, 0) * light_share, rng) / light_share)
            yield float(stamp_s), Frame.of(colour, depth_at(segment, stamp_s), float(stamp_s))

    camera = segment.camera
    variants = [Variant(method, hz, Tracker(odometer(method), camera)) for method in methods]
    stamps_s = _stamps_s(segment, hz)
    dense = Trajectory(stamps_s, sample(segment.truth, stamps_s))
    return interleaved("rate", variants, frames, dense, progress)
