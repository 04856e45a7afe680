"""Inspection of a user-provided sequence: errors and warnings as sentences."""

import contextlib
import itertools
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..errors import InputError, WorkError
from ..evaluation.associate import nearest
from ..formats.depth_units import LARGEST_UNIT
from ..formats.files import is_file
from ..formats.images import ARRAY, image_header, read_array, read_colour8
from ..formats.png import PngHeader
from ..formats.trajectories import LoadedTrajectory
from ..geometry import axes
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, frame_rate_hz, sample, statistics
from .frames import (
    ImagePair,
    find_pairs,
    find_truth,
    load_truth,
    missing_images,
    read_camera,
    read_depth_m,
    unused_images,
)
from .layout import SequenceCamera, posed, usual_step_s

T = TypeVar("T")

#: Number of colour and of depth images whose pixels are read.
_SAMPLES = 24
#: Maximum distance of a frame from its pose, as a share of the time between frames.
_SLACK = 0.5
#: Larger residuals are caused by other surfaces, not by errors of the pose.
_SAME_SURFACE_M = 0.3
_STEP_PX = 6
#: How the images of a kind may be stored.
_EXPECTED = {"rgb": ("8-bit RGB",), "depth": ("16-bit grey", "32-bit grey, metres")}


@dataclass
class Inspection:
    """Figures by name, and findings: `wrong` are errors, `odd` are warnings."""

    folder: Path
    figures: dict[str, object] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    odd: list[str] = field(default_factory=list)

    def attempt(self, work: Callable[..., T], *arguments: object) -> T | None:
        """The result of work(*arguments).

        After an InputError None; the message is added to `wrong`.
        """
        try:
            return work(*arguments)
        except InputError as error:
            self.wrong.append(str(error).removeprefix(f"{self.folder}/"))
            return None


def inspect_sequence(folder: Path | str) -> Inspection:
    """Inspect a sequence in any known format.

    It never raises an error because of a file's content.
    """
    folder = Path(folder)
    result = Inspection(folder)
    pairs = result.attempt(find_pairs, folder)
    if pairs is None:
        return result
    _count(result, pairs)
    _time(result, pairs)
    headers = _images(result, pairs)
    _brightness(result, pairs)
    camera = result.attempt(read_camera, folder, pairs[0].rgb)
    if camera is not None:
        _camera(result, camera, headers)
        depths = _depth(result, pairs, camera)
    loaded = result.attempt(load_truth, folder)
    if loaded is None:
        if find_truth(folder) is None:
            result.odd.append("no ground truth")
        return result
    truth = loaded.trajectory
    _poses(result, pairs, loaded)
    if camera is not None and depths:
        _handedness(result, depths, truth, camera)
    return result


def _count(result: Inspection, pairs: list[ImagePair]) -> None:
    result.figures["pairs"] = len(pairs)
    unused = unused_images(pairs)
    missing = missing_images(result.folder)
    _report(result.odd, missing, "{} images in the lists do not exist: {}")
    for kind, paths in (("rgb", {p.rgb for p in pairs}), ("depth", {p.depth for p in pairs})):
        result.figures[f"{kind}_images"] = len(paths) + len(unused[kind])
        _report(
            result.odd,
            unused[kind],
            f"{{}} images in {kind}/ have no partner or are in no list: {{}}",
        )


def _report(where: list[str], paths: list[Path], sentence: str) -> None:
    if paths:
        where.append(sentence.format(len(paths), _first([path.name for path in paths])))


def _first(names: list[str]) -> str:
    return ", ".join(names[:3]) + " ..." * (len(names) > 3)


def _time(result: Inspection, pairs: list[ImagePair]) -> None:
    steps = np.diff([p.stamp_s for p in pairs])
    if not len(steps):
        return
    usual = float(np.median(steps))
    rate_hz = frame_rate_hz([p.stamp_s for p in pairs]) if usual > 0 else None
    result.figures["rate_hz"] = rate_hz
    result.figures["duration_s"] = round(pairs[-1].stamp_s - pairs[0].stamp_s, 3)
    if back := int((steps <= 0).sum()):
        result.wrong.append(f"{back} stamps are not after the previous stamp")
    gaps = np.flatnonzero(steps > 1.5 * usual)
    if gaps.size:
        where = pairs[int(gaps[0])].rgb.name
        result.odd.append(
            f"{gaps.size} gaps in time, the longest {steps.max():.3f} s, the first after {where}"
        )


def _images(result: Inspection, pairs: list[ImagePair]) -> list[PngHeader]:
    """Headers of all valid images; every file is read and its checksums are verified."""
    checked = []
    with ThreadPoolExecutor(4) as pool:
        for pair in pairs:
            for kind, path in (("rgb", pair.rgb), ("depth", pair.depth)):
                if is_file(path):
                    checked.append((kind, pool.submit(image_header, path, True)))
    broken = [str(work.exception()) for _, work in checked if work.exception()]
    result.wrong += broken[:5]
    if len(broken) > 5:
        result.wrong.append(f"{len(broken) - 5} more damaged images")
    headers = [(kind, work.result()) for kind, work in checked if not work.exception()]
    for kind, expected in _EXPECTED.items():
        of_kind = [header for k, header in headers if k == kind]
        found = Counter(map(str, of_kind))
        result.figures[f"{kind}_form"] = ", ".join(found)
        if len(found) > 1:
            counts = ", ".join(f"{count} of {each}" for each, count in found.items())
            result.wrong.append(f"{kind} images differ: {counts}")
        if wrong := [each for each in found if not each.endswith(expected)]:
            unreadable = kind == "depth" or any(header.bits != 8 for header in of_kind)
            where = result.wrong if unreadable else result.odd
            where.append(f"{kind} images are {wrong[0]}, not {expected[0]}")
    return [header for _, header in headers]


def _sampled(pairs: list[ImagePair]) -> list[ImagePair]:
    """Pairs at equal distances, of which the images are read."""
    return [pairs[i] for i in sorted({int(i) for i in np.linspace(0, len(pairs) - 1, _SAMPLES)})]


def _brightness(result: Inspection, pairs: list[ImagePair]) -> None:
    """Report black colour images: an error if all inspected ones are."""
    bright: list[tuple[str, bool]] = []
    for pair in _sampled(pairs):
        # reported already, or no package reads JPEG
        with contextlib.suppress(InputError, WorkError):
            bright.append((pair.rgb.name, bool(read_colour8(pair.rgb).any())))
    if black := [name for name, light in bright if not light]:
        where = result.wrong if len(black) == len(bright) else result.odd
        where.append(
            f"{len(black)} of {len(bright)} inspected colour images are black, the first {black[0]}"
        )


def _camera(result: Inspection, camera: SequenceCamera, headers: list[PngHeader]) -> None:
    c = camera.pinhole
    result.figures["camera"] = c.to_dict()
    if camera.assumed:
        units = f"{camera.depth_units_per_metre:g} depth units per metre"
        result.odd.append(f"no camera.json: the benchmark's camera and {units} are used")
    result.odd += camera.notes
    known = {(camera.width, camera.height) for camera in (c, camera.colour or c)}
    if others := {(h.width, h.height) for h in headers} - known:
        sizes = ", ".join(f"{w} x {h}" for w, h in sorted(others))
        result.wrong.append(f"the camera is {c.width} x {c.height}, images are {sizes}")
    if (c.cx, c.cy) == (c.width / 2, c.height / 2):
        result.odd.append(
            "principal point at half the image size: "
            "half a pixel off if pixel centres are at whole numbers"
        )


def _depth(
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
                depths.append((pair.stamp_s, depth))
            else:
                others.append(f"{pair.depth.name} is {depth.shape[1]} x {depth.shape[0]}")
    if others:
        several = f"{len(others)} of {len(depths) + len(others)} inspected depth images"
        size = f"the camera's size {c.width} x {c.height}"
        result.wrong.append(f"{several} are not of {size}: {others[0]}")
        if not depths:
            return []
    if not_finite:
        count = f"{not_finite} depths of {len(depths)} inspected images"
        result.odd.append(f"{count} are NaN or infinite: they are read as missing")
    largest_m = np.float32(LARGEST_UNIT) / np.float32(camera.depth_units_per_metre)
    if pairs[0].depth.suffix == ARRAY:
        largest_m = np.float32(np.inf)
    seen = [depth[depth > 0] for _, depth in depths]
    if not any(len(one) for one in seen):
        result.wrong.append("no depth in any of the inspected images")
        return []
    pixels = len(depths) * c.width * c.height
    _range(result, np.concatenate(seen), pixels, camera.depth_units_per_metre, largest_m)
    return depths


def _not_finite(path: Path) -> int:
    """The number of depths of an array of metres that are NaN or infinite."""
    if path.suffix != ARRAY:
        return 0
    return int(np.count_nonzero(~np.isfinite(read_array(path))))


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
        result.wrong.append(found)
    if (at_end := float((seen == largest_m).mean())) > 1e-4:
        result.wrong.append(
            f"{at_end:.2%} of the depths are 65535: depth was clipped at the end of the range"
        )
    if missing > 0.5:
        result.odd.append(f"{missing:.0%} of the depth is missing")


def _poses(result: Inspection, pairs: list[ImagePair], loaded: LoadedTrajectory) -> None:
    truth = loaded.trajectory
    stamps = np.array([p.stamp_s for p in pairs])
    figures = statistics(truth)
    result.figures["poses"] = figures.frames
    result.figures["length_m"] = round(figures.length_m, 3)
    result.figures["max_speed_m_s"] = round(figures.max_speed, 3)
    without = np.flatnonzero(~posed(stamps, truth))
    if without.size:
        names = _first([pairs[int(i)].rgb.name for i in without])
        result.odd.append(f"{without.size} frames without a pose: {names}")
    if loaded.read_as.lost:
        lost = f"{loaded.read_as.lost} of {loaded.row_count} rows have no finite pose"
        result.odd.append(f"{lost} and are left out")
    if loaded.by_depth:
        result.odd.append(loaded.by_depth)
    if idle := _without_frame(loaded, stamps):
        result.odd.append(f"{idle} poses without a frame")
    if figures.max_speed > 5:
        result.odd.append(f"a jump: the camera moves at up to {figures.max_speed:.1f} m/s")


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


def _handedness(
    result: Inspection,
    depths: list[tuple[float, np.ndarray]],
    truth: Trajectory,
    camera: SequenceCamera,
) -> None:
    first, last = truth.stamps_s[[0, -1]]
    depths = [(stamp_s, depth) for stamp_s, depth in depths if first <= stamp_s <= last]
    if len(depths) < 2 or len(truth) < 2:
        return
    poses = sample(truth, np.array([stamp_s for stamp_s, _ in depths]))
    as_read_m = _fit_m(depths, poses, camera.pinhole)
    mirrored_m = _fit_m(depths, axes.mirrored_y(poses), camera.pinhole)
    if not np.isfinite([as_read_m, mirrored_m]).all():
        return
    result.figures["depth_fits_poses_mm"] = round(1000 * as_read_m, 2)
    result.figures["depth_fits_mirrored_poses_mm"] = round(1000 * mirrored_m, 2)
    between = "the residual between depth images is"
    measured = f"{between} {1000 * as_read_m:.1f} mm with the poses as read"
    if mirrored_m < 0.6 * as_read_m and as_read_m > 0.004:
        mirrored = f"{1000 * mirrored_m:.1f} mm with the poses mirrored in y"
        result.wrong.append(
            f"{measured}, {mirrored}: they are probably left-handed; read them as gt.freiburg"
        )
    elif as_read_m > 0.05:
        result.wrong.append(f"{measured}: poses, depth and camera do not match")


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


def carried_residual(
    depth_a_z_m: np.ndarray,
    depth_b_z_m: np.ndarray,
    T_b_a: SE3,
    camera: PinholeCamera,
    step_px: int = 1,
) -> np.ndarray:
    """Measured minus expected z in b, in metres, of every `step_px`-th row and column of a; NaN
    where one of them has no depth.
    """
    points = camera.unproject(depth_a_z_m)[::step_px, ::step_px]
    shape = points.shape[:2]
    points = T_b_a.apply(points.reshape(-1, 3))
    pixels = np.rint(np.nan_to_num(camera.project(points), nan=-1.0).clip(-1, 1e6)).astype(int)
    inside = (pixels >= 0).all(1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
    inside &= depth_a_z_m[::step_px, ::step_px].ravel() > 0
    residual = np.full(len(points), np.nan)
    measured = depth_b_z_m[pixels[inside, 1], pixels[inside, 0]]
    residual[inside] = np.where(measured > 0, measured - points[inside, 2], np.nan)
    return residual.reshape(shape)
