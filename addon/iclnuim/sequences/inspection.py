"""Inspection of a user-provided sequence: its images, its camera, its ground truth, and whether depth
fits the poses. Errors and warnings are sentences.
"""

import contextlib
import itertools
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..doubt.depth_against_poses import MISMATCH
from ..doubt.imu_against_poses import imu_agreement
from ..errors import InputError, StrPath, WorkError
from ..evaluation.associate import nearest
from ..formats.depth_units import LARGEST_UNIT
from ..formats.files import is_file
from ..formats.images import METRES, image_header, read_colour8, read_metres
from ..formats.png import PngHeader
from ..geometry.camera import PinholeCamera
from ..geometry.carried_depth import carried_residual
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, frame_rate_hz, sample, trajectory_statistics
from ..shown import Shown
from ..trajectory_files.trajectories import LoadedTrajectory
from .camera_files import SequenceCamera
from .frames import ImagePair, posed, usual_step_s
from .official_archives import archive_of, described
from .pose_check import TOO_LITTLE, doubt, pose_agreement
from .stored_sequence import StoredSequence, opened, read_depth_m

T = TypeVar("T")

#: Number of colour and of depth images whose pixels are read.
_SAMPLES = 24
#: How the images of a kind may be stored.
_EXPECTED = {"rgb": ("8-bit RGB",), "depth": ("16-bit grey", "32-bit grey, metres", "EXR, metres")}
#: Maximum distance of a frame from its pose, as a share of the time between frames.
_SLACK = 0.5
#: Poses belong to a sequence if not more than this share of its frames has none.
_MOST = 0.5
#: Larger residuals are caused by other surfaces, not by errors of the pose.
_SAME_SURFACE_M = 0.3
#: Of unrelated images the median is half of that.
_UNRELATED_M = _SAME_SURFACE_M / 3
_STEP_PX = 6
#: Rates of IMUs are nominal: their clocks differ by less.
_RATE_SLACK = 0.05


@dataclass(repr=False)
class Inspection(Shown):
    """Figures by name, and what was found: errors and warnings as sentences.

    explanations: of poses that do not fit the depth, {kind, parameters}; explained_error: the
    figures with all of them applied, None without any. name_of: as of `IclnuimError.worded`.
    """

    folder: Path
    figures: dict[str, object] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    explanations: list[dict[str, Any]] = field(default_factory=list)
    explained_error: dict[str, float] | None = None
    name_of: Callable[[str], str] = str

    def summary(self) -> str:
        return f"{self.folder}, {len(self.errors)} errors, {len(self.warnings)} warnings"

    def to_dict(self) -> dict[str, Any]:
        """The content of `iclnuim inspect` for JSON."""
        return {
            "folder": str(self.folder),
            "figures": self.figures,
            "errors": self.errors,
            "warnings": self.warnings,
            "explanations": self.explanations,
            "explained_error": self.explained_error,
        }

    def attempt(self, work: Callable[[], T]) -> T | None:
        """The result of work(); after an InputError None, and the message is added to `errors`."""
        try:
            return work()
        except InputError as error:
            self.errors.append(error.worded(self.name_of).removeprefix(f"{self.folder}/"))
            return None

    def images(self, where: list[str], paths: list[Path], sentence: str) -> None:
        """Add a sentence with the number and the names of images to `errors` or `warnings`, if there are
        any.
        """
        if paths:
            where.append(sentence.format(len(paths), first_names([path.name for path in paths])))


def first_names(names: list[str]) -> str:
    """The first three names."""
    return ", ".join(names[:3]) + " ..." * (len(names) > 3)


def inspect_sequence(
    folder: StoredSequence | StrPath, name_of: Callable[[str], str] = str
) -> Inspection:
    """Inspect the sequence in a folder, or one that was opened, in any known format. `name_of`
    returns the name of each setting that an error advises.

    It never raises an error because of a file's content.
    """
    sequence = opened(folder)
    result = Inspection(sequence.folder, name_of=name_of)
    pairs = result.attempt(lambda: sequence.pairs)
    if pairs is None:
        return result
    _count(result, sequence)
    _time(result, pairs)
    _imu(result, sequence)
    headers = inspect_images(result, pairs)
    inspect_brightness(result, pairs)
    camera = result.attempt(lambda: sequence.camera)
    if camera is not None:
        inspect_camera(result, camera, headers)
        depths = inspect_depth(result, pairs, camera)
    loaded = result.attempt(lambda: sequence.loaded_truth)
    if loaded is None:
        if sequence.truth_path is None:
            result.warnings.append("no ground truth")
        return result
    truth = loaded.trajectory
    inspect_poses(result, pairs, loaded)
    _imu_against_poses(result, sequence, truth)
    if camera is not None and depths:
        inspect_distances(result, depths, truth, camera.pinhole)
        inspect_depth_against_poses(result, pairs, camera, truth)
    return result


def _count(result: Inspection, sequence: StoredSequence) -> None:
    pairs = sequence.pairs
    result.figures["pairs"] = len(pairs)
    unused = sequence.unused_images()
    result.images(
        result.warnings, sequence.missing_images(), "{} images in the lists do not exist: {}"
    )
    for kind, paths in (("rgb", {p.rgb for p in pairs}), ("depth", {p.depth for p in pairs})):
        result.figures[f"{kind}_images"] = len(paths) + len(unused[kind])
        alone = f"{{}} images in {kind}/ have no partner or are in no list: {{}}"
        result.images(result.warnings, unused[kind], alone)


def _time(result: Inspection, pairs: list[ImagePair]) -> None:
    steps = np.diff([p.stamp_s for p in pairs])
    if not len(steps):
        return
    usual = float(np.median(steps))
    rate_hz = frame_rate_hz([p.stamp_s for p in pairs]) if usual > 0 else None
    result.figures["rate_hz"] = rate_hz
    result.figures["duration_s"] = round(pairs[-1].stamp_s - pairs[0].stamp_s, 3)
    if back := int((steps <= 0).sum()):
        result.errors.append(f"{back} stamps are not after the previous stamp")
    gaps = np.flatnonzero(steps > 1.5 * usual)
    if gaps.size:
        where = pairs[int(gaps[0])].rgb.name
        result.warnings.append(
            f"{gaps.size} gaps in time, the longest {steps.max():.3f} s, the first after {where}"
        )


def _imu(result: Inspection, sequence: StoredSequence) -> None:
    """Figures of an IMU, if there is one; gaps, and frames without readings on both sides."""
    imu = result.attempt(lambda: sequence.imu)
    if imu is None:
        return
    stamps_s = imu.stream.stamps_s
    first_s, last_s = stamps_s[[0, -1]].tolist()
    figures = {"readings": len(stamps_s), "rate_hz": imu.stream.rate_hz}
    result.figures["imu"] = {**figures, "first_s": first_s, "last_s": last_s}
    outside = (sequence.stamps_s < first_s) | (sequence.stamps_s > last_s)
    if outside.any():
        result.warnings.append(
            f"{outside.sum()} frames are not between the first and the last reading of the IMU"
        )
    steps_s = np.diff(stamps_s)
    if imu.said_rate_hz and abs(imu.said_rate_hz / imu.stream.rate_hz - 1) > _RATE_SLACK:
        said = f"its file says {imu.said_rate_hz:g} Hz"
        result.warnings.append(f"the readings of the IMU come at {imu.stream.rate_hz:g} Hz, {said}")
    gaps = np.flatnonzero(steps_s > 1.5 * np.median(steps_s)) if len(steps_s) else steps_s
    if gaps.size:
        longest = f"the longest {steps_s.max():.3f} s, the first after {stamps_s[gaps[0]]:.3f} s"
        result.warnings.append(f"{gaps.size} gaps in the readings of the IMU, {longest}")


def _imu_against_poses(result: Inspection, sequence: StoredSequence, truth: Trajectory) -> None:
    """Report whether the readings of an IMU agree with the poses."""
    figures = result.figures.get("imu")
    imu = sequence.imu if isinstance(figures, dict) else None
    if imu is None or not isinstance(figures, dict):
        return
    found = imu_agreement(imu.stream, truth)
    if found.errors is None:
        return
    figures["rates_differ_rad_s"], figures["forces_differ_m_s2"] = found.errors
    if sentence := found.sentence():
        (result.errors if found.changes else result.warnings).append(sentence)
    if found.changes:
        figures["explanations"] = [
            {"kind": change.kind, "parameters": change.parameters} for change in found.changes
        ]


def inspect_images(result: Inspection, pairs: list[ImagePair]) -> list[PngHeader]:
    """Headers of all valid images; every file is read and its checksums are verified."""
    checked = []
    with ThreadPoolExecutor(4) as pool:
        for pair in pairs:
            for kind, path in (("rgb", pair.rgb), ("depth", pair.depth)):
                if is_file(path):
                    checked.append((kind, pool.submit(image_header, path, True)))
    broken = [str(work.exception()) for _, work in checked if work.exception()]
    result.errors += broken[:5]
    if len(broken) > 5:
        result.errors.append(f"{len(broken) - 5} more damaged images")
    headers = [(kind, work.result()) for kind, work in checked if not work.exception()]
    for kind, expected in _EXPECTED.items():
        of_kind = [header for k, header in headers if k == kind]
        found = Counter(map(str, of_kind))
        result.figures[f"{kind}_format"] = ", ".join(found)
        if len(found) > 1:
            counts = ", ".join(f"{count} of {each}" for each, count in found.items())
            result.errors.append(f"{kind} images differ: {counts}")
        if wrong := [each for each in found if not each.endswith(expected)]:
            unreadable = kind == "depth" or any(header.bits != 8 for header in of_kind)
            where = result.errors if unreadable else result.warnings
            where.append(f"{kind} images are {wrong[0]}, not {expected[0]}")
    return [header for _, header in headers]


def _sampled(pairs: list[ImagePair]) -> list[ImagePair]:
    """Pairs at equal distances, of which the images are read."""
    return [pairs[i] for i in sorted({int(i) for i in np.linspace(0, len(pairs) - 1, _SAMPLES)})]


def inspect_brightness(result: Inspection, pairs: list[ImagePair]) -> None:
    """Report black colour images: an error if all inspected ones are."""
    bright: list[tuple[str, bool]] = []
    for pair in _sampled(pairs):
        # reported already, or no package reads JPEG
        with contextlib.suppress(InputError, WorkError):
            bright.append((pair.rgb.name, bool(read_colour8(pair.rgb).any())))
    if black := [name for name, light in bright if not light]:
        where = result.errors if len(black) == len(bright) else result.warnings
        where.append(
            f"{len(black)} of {len(bright)} inspected colour images are black, the first {black[0]}"
        )


def inspect_camera(result: Inspection, camera: SequenceCamera, headers: list[PngHeader]) -> None:
    c = camera.pinhole
    result.figures["camera"] = c.to_dict()
    if camera.assumed:
        units = f"{camera.depth_units_per_metre:g} depth units per metre"
        result.warnings.append(f"no camera.json: the benchmark's camera and {units} are used")
    result.warnings += camera.notes
    known = {(camera.width, camera.height) for camera in (c, camera.colour or c)}
    if others := {(h.width, h.height) for h in headers} - known:
        sizes = ", ".join(f"{w} x {h}" for w, h in sorted(others))
        result.errors.append(f"the camera is {c.width} x {c.height}, images are {sizes}")
    if (c.cx, c.cy) == (c.width / 2, c.height / 2):
        result.warnings.append(
            "principal point at half the image size: "
            "half a pixel off if pixel centres are at whole numbers"
        )


def inspect_depth(
    result: Inspection, pairs: list[ImagePair], camera: SequenceCamera
) -> list[tuple[float, np.ndarray]]:
    """Check the range and holes of depth in some frames.

    Returns these depth images with their stamps.
    """
    c = camera.pinhole
    depths: list[tuple[float, np.ndarray]] = []
    others: list[str] = []
    not_finite = 0
    for pair in _sampled(pairs):
        with contextlib.suppress(InputError):  # reported already
            depth = read_depth_m(pair.depth, camera.depth_units_per_metre)
            not_finite += _not_finite(pair.depth)
            if depth.shape == (c.height, c.width):
                depths.append((pair.depth_stamp_s, depth))
            else:
                others.append(f"{pair.depth.name} is {depth.shape[1]} x {depth.shape[0]}")
    if others:
        several = f"{len(others)} of {len(depths) + len(others)} inspected depth images"
        size = f"the camera's size {c.width} x {c.height}"
        result.errors.append(f"{several} are not of {size}: {others[0]}")
        if not depths:
            return []
    if not_finite:
        count = f"{not_finite} depths of {len(depths)} inspected images"
        result.warnings.append(f"{count} are NaN or infinite: they are read as missing")
    largest_m = np.float32(LARGEST_UNIT) / np.float32(camera.depth_units_per_metre)
    if pairs[0].depth.suffix.lower() in METRES:
        largest_m = np.float32(np.inf)
    seen = [depth[depth > 0] for _, depth in depths]
    if not any(len(one) for one in seen):
        result.errors.append("no depth in any of the inspected images")
        return []
    pixels = len(depths) * c.width * c.height
    _range(result, np.concatenate(seen), pixels, camera.depth_units_per_metre, largest_m)
    return depths


def _not_finite(path: Path) -> int:
    """The number of depths of an image of metres that are NaN or infinite."""
    if path.suffix.lower() not in METRES:
        return 0
    return int(np.count_nonzero(~np.isfinite(read_metres(path))))


def _range(
    result: Inspection, seen: np.ndarray, pixels: int, per_metre: float, largest_m: np.floating
) -> None:
    """Check the depths `seen` (n,) in metres of this number of pixels."""
    low, middle, high = np.percentile(seen, (0.1, 50, 99.9)).tolist()
    missing = 1 - seen.size / pixels
    result.figures["depth_m"] = {
        "nearest": round(low, 3),
        "median": round(middle, 3),
        "farthest": round(high, 3),
    }
    result.figures["depth_missing_share"] = round(missing, 4)
    if not 0.25 <= middle <= 25:
        found = f"median depth of {middle:.3f} m with {per_metre:g} units per metre"
        for units in (1000.0, 5000.0):
            other_m = middle * per_metre / units
            if 0.25 <= other_m <= 25 and units != per_metre:
                found += f": {units:g} units per metre would give {other_m:.2f} m"
                break
        result.errors.append(found)
    if (at_end := float((seen == largest_m).mean())) > 1e-4:
        result.errors.append(
            f"{at_end:.2%} of the depths are 65535: depth was clipped at the end of the range"
        )
    if missing > 0.5:
        result.warnings.append(f"{missing:.0%} of the depth is missing")


def inspect_poses(result: Inspection, pairs: list[ImagePair], loaded: LoadedTrajectory) -> None:
    truth = loaded.trajectory
    stamps = np.array([p.stamp_s for p in pairs])
    figures = trajectory_statistics(truth)
    result.figures["poses"] = figures.frames
    result.figures["length_m"] = round(figures.length_m, 3)
    result.figures["max_speed_m_s"] = round(figures.max_speed, 3)
    if archive := archive_of(loaded):
        result.figures["published_as"] = described(archive, loaded)
    without = np.flatnonzero(~posed(stamps, truth))
    if without.size:
        names = first_names([pairs[int(i)].rgb.name for i in without])
        sentence = f"{without.size} frames without a pose: {names}"
        if without.size > _MOST * len(stamps):
            times = f"{stamps[0]:.3f} to {stamps[-1]:.3f} s, those of poses are "
            times += f"{truth.stamps_s[0]:.3f} to {truth.stamps_s[-1]:.3f} s"
            result.errors.append(f"{sentence}; stamps of images are {times}")
        else:
            result.warnings.append(sentence)
    if loaded.read_as.lost:
        lost = f"{loaded.read_as.lost} of {loaded.row_count} rows have no finite pose"
        result.warnings.append(f"{lost} and are left out")
    if loaded.by_depth:
        result.warnings.append(loaded.by_depth)
    if idle := _without_frame(loaded, stamps):
        result.warnings.append(f"{idle} poses without a frame")
    if figures.max_speed > 5:
        result.warnings.append(f"a jump: the camera moves at up to {figures.max_speed:.1f} m/s")


def _without_frame(loaded: LoadedTrajectory, stamps_s: np.ndarray) -> int:
    """The number of poses that belong to no frame; 0 for those of a motion tracker, which has a
    higher rate than the frames.
    """
    if loaded.is_counted:
        return loaded.row_count - loaded.read_as.lost - len(loaded.trajectory)
    usual = usual_step_s(stamps_s)
    poses_s = loaded.trajectory.stamps_s
    poses_s = poses_s[(poses_s > stamps_s[0] - usual) & (poses_s < stamps_s[-1] + usual)]
    idle = nearest(poses_s, np.sort(stamps_s))[1] > _SLACK * usual + 1e-9
    return int(idle.sum()) if len(loaded.trajectory) <= 1.5 * len(stamps_s) else 0


def inspect_depth_against_poses(
    result: Inspection, pairs: list[ImagePair], camera: SequenceCamera, truth: Trajectory
) -> None:
    """Report whether the depth images agree with the poses."""
    found = pose_agreement(pairs, camera, truth)
    if not np.isfinite(found.residual):
        _report_unrelated(result)
        return
    result.figures["depth_fits_poses_percent"] = round(100 * found.residual, 3)
    if sentence := doubt(found, camera):
        is_wrong = found.changes or found.residual > MISMATCH
        (result.errors if is_wrong else result.warnings).append(sentence)
    elif not found.told:
        result.figures["depth_against_poses"] = TOO_LITTLE
    for change in found.changes:
        result.explanations.append({"kind": change.kind, "parameters": change.parameters})
    if found.changes:
        percent = round(100 * found.explained, 3)
        result.explained_error = {"depth_fits_poses_percent": percent}


def _report_unrelated(result: Inspection) -> None:
    """Report depth images that fit each other as badly as unrelated ones, and cannot be compared by
    their surfaces.
    """
    distance_mm = result.figures.get("depth_fits_poses_mm")
    if isinstance(distance_mm, float) and distance_mm > 1000 * _UNRELATED_M:
        result.warnings.append(
            f"successive depth images differ by {distance_mm:g} mm with the poses, and have too "
            "few smooth surfaces to tell why: is their byte order right?"
        )


def inspect_distances(
    result: Inspection,
    depths: list[tuple[float, np.ndarray]],
    truth: Trajectory,
    camera: PinholeCamera,
) -> None:
    """Report the distance between successive ones of some depth images, with their stamps."""
    first, last = truth.stamps_s[[0, -1]]
    depths = [(stamp_s, depth) for stamp_s, depth in depths if first <= stamp_s <= last]
    if len(depths) < 2 or len(truth) < 2:
        return
    distance_m = _fit_m(depths, sample(truth, np.array([stamp_s for stamp_s, _ in depths])), camera)
    if np.isfinite(distance_m):
        result.figures["depth_fits_poses_mm"] = round(1000 * distance_m, 2)


def _fit_m(depths: list[tuple[float, np.ndarray]], T: SE3, camera: PinholeCamera) -> float:
    """Median distance along z in metres between each of n depth images, transformed by the poses
    (n,), and the next; NaN without overlap.
    """
    found = []
    for i, ((_, a), (_, b)) in enumerate(itertools.pairwise(depths)):
        T_next_this = T[i + 1].inverse() @ T[i]
        found.append(carried_residual(a, b, T_next_this, camera, _STEP_PX).ravel())
    every = np.abs(np.concatenate(found))
    every = every[every < _SAME_SURFACE_M]  # NaN is not
    return float(np.median(every)) if every.size > 100 else float("nan")
