"""Sources of a sequence's frames: the EXR frames of a render run, or the image pairs of a
user-provided sequence, whose pairs, camera and ground
truth are found here.
"""

import os
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..channels import BASE, DEPTH, FURTHER, RGB, Channel, further_of
from ..errors import InputError, within
from ..evaluation.associate import nearest
from ..evaluation.depth_pairs import depth_residuals
from ..formats.associations import LARGEST_NUMBER
from ..formats.bags import is_bag
from ..formats.depth_units import metres_from_depth16
from ..formats.exr import read_exr
from ..formats.files import (
    data_lines,
    is_file,
    read_bytes,
    read_json,
    read_text,
    real_path,
    sha256,
)
from ..formats.image_names import files_in, numbers_in_names
from ..formats.images import ARRAY, image_header, read_array, read_colour8, seen_by
from ..formats.png import read_depth16
from ..formats.trajectories import FORMATS, LoadedTrajectory, read_trajectory
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, frame_slice
from ..sensor.transfer import linear_from_srgb8
from .ground_truth import FurtherImages
from .layout import Row, SequenceCamera, SequenceFrame, posed, usual_step_s
from .pose_lines import ImagesOfLines, Residuals, numbers_only_count, tied_to_images, tied_to_poses
from .run_folder import RunFolder, read_run
from .sequence_formats import format_of

#: Names, without ending, of further images in a format that stores them beside the depth.
_FURTHER_IMAGE = re.compile(f"({'|'.join(FURTHER)})[0-9]+")
#: Format and bytes of a ground-truth file.
TruthFile = tuple[str, bytes]


@dataclass(frozen=True, eq=False, repr=False)
class FrameSource:
    """Frames from which a sequence is made. `numbers` (n,), ascending, are their numbers, which
    also seed their noise.

    `load(number)` returns scene-linear RGB (h, w, 3) and planar depth in metres (h, w), as stored
    on disk. `stamps_s` has the stamps of all frames of the source, also of those not in `numbers`.
    `truth_of(numbers)` returns the ground truth of these frames, or None. `origin` is written into
    the recipe. `further`: the run's images besides colour and depth, if it has any. `names` and
    `truth_file(numbers)`: names of the images, and format and bytes of a ground-truth file, which a
    sequence in the same format keeps. `originals`: files that a sequence without noise copies byte
    for byte, if it stores images in the same way. `digest(number)`: SHA-256 of a frame's files,
    whose images are made again if it changes; "" if `origin` tells. `volatile`: `load` is a
    function of the user, which may have changed since a sequence was started.
    """

    camera: PinholeCamera
    numbers: tuple[int, ...]
    stamps_s: Mapping[int, float]
    load: Callable[[int], tuple[np.ndarray, np.ndarray]]
    truth_of: Callable[[tuple[int, ...]], Trajectory | None]
    origin: dict
    further: FurtherImages | None = None
    names: Mapping[int, SequenceFrame] = field(default_factory=dict)
    truth_file: Callable[[tuple[int, ...]], TruthFile | None] = lambda numbers: None
    originals: "Mapping[int, ImagePair]" = field(default_factory=dict)
    depth_units_per_metre: float = 0.0
    digest: Callable[[int], str] = lambda number: ""
    volatile: bool = False

    def __repr__(self) -> str:
        size = f"{self.camera.width}x{self.camera.height}"
        return f"FrameSource({len(self.numbers)} frames of {size})"

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels of a frame."""
        return (*BASE, *(self.further.channels if self.further else ()))


@dataclass(frozen=True)
class ImagePair:
    """A colour and a depth image of the same time.

    The number is that in the file's name if these numbers increase, else the row.
    """

    number: int
    stamp_s: float
    rgb: Path
    depth: Path
    #: The texts of both images' stamps in the lists; "" if no list has seconds.
    written: tuple[str, str] = ("", "")


def find_pairs(folder: Path) -> list[ImagePair]:
    """The pairs of a sequence in any known format (sequence_formats.py), in the order of time.
    Frames without one of the images are left out.

    Raises InputError if there are no pairs.
    """
    folder = Path(folder)
    rows = find_rows(folder)
    whole = [row for row in rows if row.rgb is not None and row.depth is not None]
    numbers = _frame_numbers(whole) or list(range(len(whole)))
    pairs = []
    for number, row in zip(numbers, whole, strict=True):
        if row.rgb is not None and row.depth is not None and row.is_pair:
            pairs.append(ImagePair(number, row.stamp_s, row.rgb, row.depth, row.written))
    if not pairs:
        raise _no_pairs(folder, whole)
    return pairs


def find_rows(folder: Path) -> list[Row]:
    """The frames of a sequence in the order of time, also those without one of the images. Raises
    InputError if there is no such folder.
    """
    if not folder.is_dir() and not is_bag(folder):
        found = "a file" if folder.exists() else "nothing"
        raise InputError("a folder with a sequence, or a ROS bag", path=folder, found=found)
    return format_of(folder).reader.rows(folder)


def _no_pairs(folder: Path, rows: list[Row]) -> InputError:
    inside = sorted(path.parent.name for path in folder.glob("*/recipe.json"))
    found = "none"
    if rows:
        missing = next(path for path in (rows[0].rgb, rows[0].depth) if path and not is_file(path))
        first = os.path.relpath(missing, folder)
        found = f"none in {len(rows)} frames, the first of which has no {first}"
        hint = "the folder that the lists are relative to"
    elif inside:
        hint = f"a folder inside: {', '.join(inside)}"
    elif all(files_in(folder / kind) for kind in ("rgb", "depth")):
        hint = "equal file names in rgb/ (PNG or JPEG) and depth/ (PNG), "
        hint += "or rgb.txt and depth.txt with their stamps"
    else:
        hint = "a folder with rgb/*.png and depth/*.png"
    return InputError("pairs of colour and depth images", path=folder, found=found, hint=hint)


def _frame_numbers(rows: list[Row]) -> list[int] | None:
    """The frame numbers of rows; None if they do not increase, or a name has none."""
    numbers: list[int] = []
    for row in rows:
        number = row.number
        if number is None:
            number = _number((row.rgb or row.depth or Path()).stem)
        if number is None or (numbers and number <= numbers[-1]):
            return None
        numbers.append(number)
    return numbers


def _numbers_in_names(rows: list[Row]) -> list[int] | None:
    """The numbers in the names of colour images, None if they do not increase; stamps with decimals
    are none.
    """
    names = [row.rgb.name for row in rows if row.rgb and "." not in row.rgb.stem]
    numbers = numbers_in_names(names)
    return numbers if numbers and len(names) == len(rows) and numbers == sorted(numbers) else None


def missing_images(folder: Path) -> list[Path]:
    """The images of a sequence's lists that do not exist."""
    found = []
    for row in find_rows(folder):
        found += [path for path in (row.rgb, row.depth) if path and not is_file(path)]
    return found


def unused_images(pairs: list[ImagePair]) -> dict[str, list[Path]]:
    """The images in the folders of the pairs that are in none, by kind: they have no partner, or
    are in no list.
    """
    images = {RGB: [p.rgb for p in pairs], DEPTH: [p.depth for p in pairs]}
    used = set(map(real_path, chain.from_iterable(images.values())))
    found = {}
    for kind, paths in images.items():
        there: set[Path] = set()
        for parent, ending in {(path.parent, path.suffix) for path in paths}:
            there.update(map(real_path, files_in(parent, f"*{ending}")))
        unused = there - used
        found[kind] = sorted(path for path in unused if not _FURTHER_IMAGE.fullmatch(path.stem))
    return found


def rendered_job(folder: Path) -> dict:
    """The job of the run that a sequence was made from, according to its recipe.json; {} for images
    of other origin.

    Raises InputError if the recipe is not JSON."""
    path = Path(folder) / "recipe.json"
    found: object = read_json(path) if is_file(path) else {}
    for key in ("source", "run", "job"):
        found = found.get(key) if isinstance(found, dict) else None
    return found if isinstance(found, dict) else {}


def sequence_name(folder: Path) -> str:
    """The name of a sequence in results: for example `living_room/kt2/clean` if its recipe contains
    the sequence, else its last two folders.

    Raises InputError if the recipe is not JSON."""
    folder = Path(folder).resolve()
    sequence = rendered_job(folder).get("sequence")
    if isinstance(sequence, str) and sequence:
        return f"{sequence}/{folder.name}"
    return "/".join(folder.parts[-2:])


def _number(stem: str) -> int | None:
    """The number in an image's name, unless it is a stamp."""
    return int(stem) if stem.isdecimal() and int(stem) <= LARGEST_NUMBER else None


def find_truth(folder: Path) -> Path | None:
    """The ground truth of a sequence, or None: a file or folder that read_trajectory can read."""
    return format_of(folder).reader.truth(folder)


def load_truth(folder: Path, **options: Any) -> LoadedTrajectory | None:
    """The ground truth of a sequence as right-handed poses of its camera, and how its file was
    read, or None. options: those of read_trajectory.
    """
    path = find_truth(folder)
    if path is None:
        return None
    loaded = load_poses(folder, path, **options)
    mount = format_of(folder).reader.mount(folder)
    if mount is None:
        return loaded
    own = loaded.trajectory
    poses = Trajectory(own.stamps_s, own.T_world_camera @ mount)
    how = f"{loaded.read_as.sentence}; poses of the camera by T_BS of its file"
    return replace(loaded, trajectory=poses, read_as=replace(loaded.read_as, sentence=how))


def read_truth(folder: Path) -> Trajectory | None:
    """The ground truth of a sequence as right-handed poses of its camera, or None."""
    loaded = load_truth(folder)
    return None if loaded is None else loaded.trajectory


def load_poses(folder: Path, path: Path | str, **options: Any) -> LoadedTrajectory:
    """Poses of a sequence's frames from any file; without stamps and frame numbers in the file, the
    line of each frame is found (pose_lines.py). options: those of read_trajectory. Raises
    InputError if the line cannot be told.
    """
    loaded = read_trajectory(path, **options)
    if not (loaded.is_counted or loaded.is_numbered):
        return loaded
    images = _images_of_lines(folder)
    if loaded.is_numbered and not numbers_only_count(loaded, images):
        return loaded
    with within(path):
        return tied_to_images(loaded, images)


def tied_to_sequence(
    folder: Path, truth: LoadedTrajectory, estimate: LoadedTrajectory
) -> tuple[LoadedTrajectory, LoadedTrajectory]:
    """The ground truth of a sequence, and an estimate with the stamps of its images or poses.

    Raises InputError if an estimate without stamps has another number of rows than both.
    """
    if estimate.is_counted:
        images = _images_of_lines(folder)
        if len(images.stamps_s) == estimate.row_count:
            return truth, tied_to_images(estimate, images)
    return tied_to_poses(truth, estimate)


def _images_of_lines(folder: Path) -> ImagesOfLines:
    rows = find_rows(folder)
    numbers = _frame_numbers(rows) or _numbers_in_names(rows)
    stamps_s = np.array([row.stamp_s for row in rows])
    return ImagesOfLines(stamps_s, numbers, _residuals_of(folder, rows))


def _residuals_of(folder: Path, rows: list[Row]) -> Residuals:
    """A function that compares the depth of some frames with readings of their poses."""

    def residuals(frames: np.ndarray, readings: list[SE3]) -> list[float]:
        pairs = [rows[frame] for frame in frames.tolist()]
        first = next((row.rgb for row in rows if row.is_pair), None)
        if first is None:
            return [float("nan")] * len(readings)
        camera = read_camera(folder, first)

        def load(frame: int) -> np.ndarray | None:
            depth = pairs[frame].depth
            if depth is None:
                return None
            with suppress(InputError):
                return read_depth_m(depth, camera.depth_units_per_metre)
            return None

        return depth_residuals(load, readings, camera.pinhole)

    return residuals


_CAMERA_HINT = (
    "a camera.json in this folder with width, height, fx, fy, cx, cy, "
    "or {camera} WIDTHxHEIGHT,FX,FY,CX,CY"
)


def read_camera(folder: Path, image: Path) -> SequenceCamera:
    """The camera in the sequence's files; else the benchmark's camera if the image has 640 x 480
    pixels.
    """
    with within(folder):
        there = format_of(folder).reader.camera(folder, image)
    if there is not None:
        return there
    header = image_header(image)
    if (header.width, header.height) != (640, 480):
        found = f"images of {header.width} x {header.height} and no camera.json"
        raise InputError("a camera", path=folder, found=found, hint=_CAMERA_HINT)
    return SequenceCamera(PinholeCamera(), assumed=True)


def read_depth_m(path: Path, units_per_metre: float) -> np.ndarray:
    """Read (h, w) float32 planar metres, 0 = missing, from a 16-bit PNG or an array of metres,
    whose NaN and infinity are missing depth.

    Raises InputError.
    """
    if path.suffix == ARRAY:
        depth_z_m = read_array(path)
        return np.where(np.isfinite(depth_z_m), depth_z_m, np.float32(0))
    return metres_from_depth16(read_depth16(path), units_per_metre)


def read_images(pair: ImagePair, camera: SequenceCamera) -> tuple[np.ndarray, np.ndarray]:
    """Read colour (h, w, 3) uint8 and planar depth (h, w) float32 in metres of a pair, both of the
    camera's size. Raises InputError.
    """
    colour = read_colour8(pair.rgb)
    depth_z_m = read_depth_m(pair.depth, camera.depth_units_per_metre)
    c = camera.pinhole
    for path, image, of in ((pair.rgb, colour, camera.colour or c), (pair.depth, depth_z_m, c)):
        if image.shape[:2] != (of.height, of.width):
            expected = f"{of.width} x {of.height} as in the camera"
            found = f"{image.shape[1]} x {image.shape[0]}"
            hint = "{camera} with the size of the images"
            raise InputError(expected, path=path, found=found, hint=hint)
    if camera.colour is not None:
        colour = seen_by(colour, camera.colour.K, c.K, c.width, c.height)
    return colour, depth_z_m


def run_frames(folder: Path | str, frames: str = "::") -> FrameSource:
    """The EXR frames of a run folder (exr/000000.exr, groundtruth.txt, camera.json, sequence.json).

    `frames` is a slice of the poses of the trajectory; of these, the existing frames are used.
    Raises InputError if the folder is not a run folder or has no such frames.
    """
    folder = Path(folder)
    there = {int(p.stem) for p in (folder / "exr").glob("*.exr") if p.stem.isdecimal()}
    if not there:
        hint = "the folder that `iclnuim render` wrote"
        raise InputError(
            "a run with frames exr/000000.exr ...", path=folder, found="none", hint=hint
        )
    truth = read_trajectory(folder / "groundtruth.txt", "tum").trajectory
    if max(there) >= len(truth):
        expected = f"frames of the {len(truth)} poses in groundtruth.txt"
        raise InputError(expected, path=folder / "exr", found=f"frame {max(there)}")
    numbers = sorted(there.intersection(frame_slice(frames, len(truth))))
    if not numbers:
        raise InputError(f"frames {frames} to be rendered", path=folder, found="none of them")
    with within(folder / "camera.json"):
        camera = PinholeCamera.from_dict(read_json(folder / "camera.json"))
    if (folder / "sequence.json").is_file():
        origin: dict = {"run": read_run(folder).recipe}
    else:
        files = ("groundtruth.txt", "camera.json")
        hashes = {name: sha256(read_bytes(folder / name)) for name in files}
        origin = {"frames": folder.resolve().name, "sha256": hashes}
    return _run_source(folder, camera, truth, numbers, origin)


def frames_of_run(run: RunFolder, numbers: Iterable[int]) -> FrameSource:
    """Frames of a run, which may not be rendered yet. Poses and stamps are those in the run's
    folder: a run that was started by an earlier release
    with other stamps keeps them.
    """
    return _run_source(run.path, run.camera, run.truth(), numbers, {"run": run.recipe})


def _run_source(
    folder: Path, camera: PinholeCamera, truth: Trajectory, numbers: Iterable[int], origin: dict
) -> FrameSource:
    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        return read_frame(folder / "exr" / f"{number:06}.exr", camera)

    stamps_s = dict(enumerate(truth.stamps_s.tolist()))
    channels = further_of(origin.get("run", {}).get("job", {}))
    return FrameSource(
        camera,
        tuple(sorted(numbers)),
        stamps_s,
        load,
        lambda some: truth[np.array(some)],
        origin,
        further=FurtherImages(folder, channels) if channels else None,
    )


def read_frame(path: Path, camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """Read (h, w, 3) half or float scene-linear RGB and (h, w) float32 planar metres of one EXR
    frame.

    Raises InputError if a channel is missing, the size is not the camera's, or Z has only half
    precision.
    """
    channels = read_exr(path)
    missing = [name for name in "RGBZ" if name not in channels]
    if missing:
        found = f"no {', '.join(missing)} among {', '.join(channels)}"
        raise InputError("channels R, G, B and Z", path=path, found=found)
    depth_z_m = channels["Z"]
    height, width = depth_z_m.shape
    if (height, width) != (camera.height, camera.width):
        expected = f"{camera.width} x {camera.height} as in camera.json"
        raise InputError(expected, path=path, found=f"{width} x {height}")
    if depth_z_m.dtype != np.float32:
        raise InputError("Z as 32-bit float", path=path, found="half, which rounds 4 m to 2 mm")
    return np.stack([channels[c] for c in "RGB"], -1), depth_z_m


def image_frames(
    folder: Path | str, frames: str = "::", camera: SequenceCamera | None = None
) -> FrameSource:
    """The pairs of a user-provided sequence in any known format, with or without lists.

    `frames` is a slice of the pairs. RGB is the 8-bit colour, converted to linear by the inverse of
    the sRGB transfer function. Raises InputError if there are no pairs, or the camera is neither
    given nor in the folder.
    """
    folder = Path(folder)
    pairs = sorted(find_pairs(folder), key=lambda pair: pair.number)
    numbers = tuple(pairs[i].number for i in sorted(frame_slice(frames, len(pairs))))
    camera = camera or read_camera(folder, pairs[0].rgb)
    by_number = {pair.number: pair for pair in pairs}
    truth = _TruthOfSome(folder, {p.number: p.stamp_s for p in pairs})

    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        colour, depth_z_m = read_images(by_number[number], camera)
        return linear_from_srgb8(colour), depth_z_m

    def digest(number: int) -> str:
        pair = by_number[number]
        return sha256(read_bytes(pair.rgb, "an image") + read_bytes(pair.depth, "an image"))

    paths = _kept_paths(folder, pairs)
    return FrameSource(
        camera.pinhole,
        numbers,
        truth.stamps_s,
        load,
        truth.poses,
        _origin(folder, pairs, camera, bool(paths)),
        names={p.number: _kept(p, paths.get(p.number, {})) for p in pairs},
        truth_file=truth.file,
        depth_units_per_metre=camera.depth_units_per_metre,
        digest=digest,
    )


def _origin(
    folder: Path, pairs: list[ImagePair], camera: SequenceCamera, names_kept: bool
) -> dict[str, object]:
    names = "\n".join(f"{p.stamp_s:.9f} {p.rgb.name} {p.depth.name}" for p in pairs)
    return {
        "images": folder.resolve().name,
        "depth_units_per_metre": camera.depth_units_per_metre,
        "list_sha256": sha256(names.encode()),
        "names": "kept" if names_kept else "by frame number",
    }


def original_frames(
    folder: Path | str, frames: str = "::", camera: SequenceCamera | None = None
) -> FrameSource:
    """Like image_frames; a sequence without noise copies the files byte for byte if it stores
    images in the same way.
    """
    source = image_frames(folder, frames, camera)
    return replace(source, originals={pair.number: pair for pair in find_pairs(Path(folder))})


class _TruthOfSome:
    """The ground truth of all frames of a sequence, or of some frames: the poses within half a step
    of one of them.
    """

    def __init__(self, folder: Path, stamps_s: dict[int, float]) -> None:
        self.stamps_s = stamps_s
        self._path = find_truth(folder)
        self._loaded = load_truth(folder)
        self._is_mounted = format_of(folder).reader.mount(folder) is not None
        self._reach_s = 0.5 * usual_step_s(np.array(list(stamps_s.values())))

    def _rows(self, numbers: tuple[int, ...]) -> np.ndarray:
        """The indices of the poses that belong to the frames; of all frames, all poses."""
        assert self._loaded is not None
        own = self._loaded.trajectory.stamps_s
        if len(numbers) == len(self.stamps_s):
            return np.arange(len(own))
        chosen = np.sort([self.stamps_s[number] for number in numbers])
        return np.flatnonzero(nearest(own, chosen)[1] <= self._reach_s + 1e-6)

    def poses(self, numbers: tuple[int, ...]) -> Trajectory | None:
        if not self._loaded:
            return None
        rows = self._rows(numbers)
        return self._loaded.trajectory[rows] if len(rows) else None

    def file(self, numbers: tuple[int, ...]) -> TruthFile | None:
        """Format and bytes of the ground-truth file; of some frames, its comments and their lines.

        None if it does not have one pose of the camera per line.
        """
        if self._loaded is None or self._path is None or self._is_mounted:
            return None
        format = self._loaded.read_as.format
        rows = self._rows(numbers)
        first_pose = FORMATS[format].reader.first_pose
        if first_pose is None or not len(rows):
            return None
        data = read_bytes(self._path)
        if len(rows) == len(self._loaded.trajectory):
            return format, data
        text = read_text(self._path).replace("\r\n", "\n").replace("\r", "\n")
        lines = [number for number, _ in data_lines(text)][first_pose:]
        if len(lines) != len(self._loaded.trajectory):  # lines that repeat a stamp were left out
            return None
        dropped = set(lines).difference(lines[row] for row in rows)
        lines_of_text = text.removesuffix("\n").split("\n")  # as data_lines() counts them
        kept = [f"{line}\n" for k, line in enumerate(lines_of_text, 1) if k not in dropped]
        return format, "".join(kept).encode()


def frames_with_poses(source: FrameSource) -> FrameSource:
    """The source without frames that have no pose, for formats in which each frame needs one."""
    numbers = np.array(source.numbers)
    stamps_s = np.array([source.stamps_s[number] for number in source.numbers])
    kept = numbers[posed(stamps_s, source.truth_of(source.numbers))]
    return replace(source, numbers=tuple(kept.tolist()))


def _kept(pair: ImagePair, paths: Mapping[str, str]) -> SequenceFrame:
    written = {kind: text for kind, text in zip((RGB, DEPTH), pair.written, strict=True) if text}
    return SequenceFrame(pair.number, pair.stamp_s, paths, written)


def _kept_paths(folder: Path, pairs: list[ImagePair]) -> dict[int, dict[str, str]]:
    """The paths of a sequence's images by frame number and kind; {} if its format does not keep
    names, or if the names cannot be used in another folder: outside the sequence, not unique, or
    with blanks.
    """
    found: dict[int, dict[str, str]] = {}
    if not format_of(folder).keeps_names:
        return {}
    every: set[str] = set()
    for pair in pairs:
        found[pair.number] = {}
        for kind, image in ((RGB, pair.rgb), (DEPTH, pair.depth)):
            if not image.is_relative_to(folder):
                return {}
            path = image.relative_to(folder).as_posix()
            plain = path.endswith(".png") and path.split() == [path] and "#" not in path
            if not plain or path in every or ".." in Path(path).parts:
                return {}
            every.add(path)
            found[pair.number][kind] = path
    return found
