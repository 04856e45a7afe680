"""Curves of speed against accuracy: one setting changes in steps, everything else is constant, and
all steps use the same frames in one run.

Times can be compared only within a run: all variants process a frame before the next frame is
loaded.
"""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
from iclnuim.benchmark.fusion.mesh import extract
from iclnuim.benchmark.fusion.settings import PRESETS
from iclnuim.benchmark.fusion.surface_error import TrueSurface
from iclnuim.benchmark.fusion.volume import Volume
from iclnuim.benchmark.odometry.protocol import Frame, Odometer
from iclnuim.benchmark.odometry.registry import ODOMETERS, odometer
from iclnuim.benchmark.odometry.terms.photometric import PhotometricSettings
from iclnuim.benchmark.odometry.terms.plane import IcpSettings
from iclnuim.benchmark.odometry.track import Tracker
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

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


def strides(settings: IcpSettings, value: float) -> IcpSettings:
    """Use fewer pixels: multiply the strides in rows and columns by the value."""
    return replace(settings, strides=tuple(max(1, round(value * n)) for n in settings.strides))


def min_gradients(settings: PhotometricSettings, value: float) -> PhotometricSettings:
    """Use fewer pixels: multiply the minimum gradients by the value."""
    return replace(settings, min_gradients=tuple(value * g for g in settings.min_gradients))


@dataclass(frozen=True)
class Scaling:
    """What a curve changes. changes: by the class of settings, of a preset or of one of its parts;
    methods without such settings have one step.
    """

    values: tuple[float, ...]
    unit: str
    changes: Mapping[type, Callable[[Any, float], Any]] = field(default_factory=dict)


#: Settings of each level of a pyramid.
_BY_LEVEL = (IcpSettings, PhotometricSettings)
CURVES = {
    "levels": Scaling((0, 1, 2), "finest levels left out", dict.fromkeys(_BY_LEVEL, levels)),
    "iterations": Scaling(
        (0.25, 0.5, 1, 2, 4), "times the default", dict.fromkeys(_BY_LEVEL, iterations)
    ),
    "pixels": Scaling(
        (1, 2, 4, 8),
        "times the minimum gradient or the stride",
        {IcpSettings: strides, PhotometricSettings: min_gradients},
    ),
    "resolution": Scaling((640, 320, 160), "width of the images in pixels"),
}
#: A method and its value; None for a method that does not have the setting.
Step = tuple[str, float | None]


def steps_of(curve: str, methods: Sequence[str], values: Sequence[float]) -> list[Step]:
    """All steps of all methods. Methods without the setting have one step.

    Raises InputError if no method has it.
    """
    scaling = CURVES[curve]
    if scaling.changes and not any(_groups(method, scaling) for method in methods):
        known = [name for name in ODOMETERS if _groups(name, scaling)]
        expected = f"an odometer with such settings ({', '.join(known)})"
        raise InputError(expected, found=", ".join(methods))
    found: list[Step] = []
    for method in methods:
        own = _groups(method, scaling)
        if scaling.changes and not own:
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
    variants = [_variant(curve, method, value, segment.camera) for method, value in steps]
    return interleaved(curve, variants, segment.frames, segment.truth, progress)


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
    if CURVES[curve].changes:
        return Variant(method, value, Tracker(changed(method, CURVES[curve], value), camera))
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


def _parts(preset: Any) -> tuple[Any, ...]:
    return preset if isinstance(preset, tuple) else (preset,)


def _groups(method: str, scaling: Scaling) -> list[Any]:
    """The groups of settings of a method that a curve changes."""
    parts = _parts(_preset(method)[1]) if method in ODOMETERS else ()
    return [part for part in parts if type(part) in scaling.changes]


def changed(method: str, scaling: Scaling, value: float) -> Odometer:
    """One of our odometers with changed settings, in all groups that have the setting."""
    kind, preset = _preset(method)
    parts = [
        scaling.changes[type(part)](part, value) if type(part) in scaling.changes else part
        for part in _parts(preset)
    ]
    return kind(tuple(parts) if isinstance(preset, tuple) else parts[0])


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


# -- fusion


#: Sides of a voxel in metres.
VOXELS_M = (0.035, 0.0176, 4.5 / 512, 0.004)


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


def measure_fusion(
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
    return [_fused_point(v, float(ms), surface) for v, ms in zip(volumes, each_ms, strict=True)]


def _fused_point(volume: Volume, ms: float, surface: TrueSurface) -> FusedPoint:
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
