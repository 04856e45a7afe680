"""The frames that a sequence is made from: those of a run, or the images of another sequence."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..channels import BASE, DEPTH, RGB, Channel, further_of
from ..errors import InputError, StrPath, within
from ..evaluation.associate import nearest
from ..formats.exr import read_exr
from ..formats.files import data_lines, read_bytes, read_json, read_text, sha256
from ..geometry.camera import PinholeCamera
from ..geometry.trajectory import Trajectory, frame_slice
from ..sensor.imu import ImuOnCamera
from ..sensor.transfer import linear_from_srgb8
from ..trajectory_files.trajectories import FORMATS, read_trajectory
from .frame_hashes import read_hashes, refuse_changed
from .frames import ImagePair, SequenceFrame, posed, usual_step_s
from .imu import SequenceImu
from .run_folder import FurtherImages, RunFolder, read_run
from .stored_sequence import StoredSequence, opened

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
    function of the user, which may have changed since a sequence was started. `imu()`: all readings
    of an IMU, None without any.
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
    originals: Mapping[int, ImagePair] = field(default_factory=dict)
    depth_units_per_metre: float = 0.0
    digest: Callable[[int], str] = lambda number: ""
    volatile: bool = False
    imu: Callable[[], SequenceImu | None] = lambda: None

    def __repr__(self) -> str:
        size = f"{self.camera.width}x{self.camera.height}"
        return f"FrameSource({len(self.numbers)} frames of {size})"

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels of a frame."""
        return (*BASE, *(self.further.channels if self.further else ()))


def frames_with_poses(source: FrameSource) -> FrameSource:
    """The source without frames that have no pose, for formats in which each frame needs one."""
    numbers = np.array(source.numbers)
    stamps_s = np.array([source.stamps_s[number] for number in source.numbers])
    kept = numbers[posed(stamps_s, source.truth_of(source.numbers))]
    return replace(source, numbers=tuple(kept.tolist()))


def run_frames(folder: StrPath, frames: str = "::") -> FrameSource:
    """The EXR frames of a run folder (exr/000000.exr, groundtruth.txt, camera.json, sequence.json).

    `frames` is a slice of the poses of the trajectory; of these, the existing frames are used.
    Raises InputError if the folder is not a run folder or has no such frames, and when a frame is
    loaded that was changed since it was rendered.
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
    source = _run_source(folder, camera, truth, numbers, origin)
    journal = read_hashes(folder)

    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        refuse_changed(folder / "exr" / f"{number:06}.exr", journal.get(number))
        return source.load(number)

    return replace(source, load=load)


def frames_of_run(run: RunFolder, numbers: Iterable[int]) -> FrameSource:
    """Frames of a run, which may not be rendered yet. Poses and stamps are those in the run's
    folder: a run that was started by an earlier release with other stamps keeps them.
    """
    return _run_source(run.path, run.camera, run.truth(), numbers, {"run": run.recipe})


def _run_source(
    folder: Path, camera: PinholeCamera, truth: Trajectory, numbers: Iterable[int], origin: dict
) -> FrameSource:
    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        return read_frame(folder / "exr" / f"{number:06}.exr", camera)

    stamps_s = dict(enumerate(truth.stamps_s.tolist()))
    job = origin.get("run", {}).get("job", {})
    channels = further_of(job)

    def imu() -> SequenceImu | None:
        with within(folder / "sequence.json"):
            return SequenceImu.of_job(ImuOnCamera.from_dict(job.get("imu", {})), truth)

    return FrameSource(
        camera,
        tuple(sorted(numbers)),
        stamps_s,
        load,
        lambda some: truth[np.array(some)],
        origin,
        further=FurtherImages(folder, channels) if channels else None,
        imu=imu,
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


def image_frames(sequence: StoredSequence | StrPath, frames: str = "::") -> FrameSource:
    """The pairs of a stored sequence, or of its folder, in any known format.

    `frames` is a slice of the pairs. RGB is the 8-bit colour, converted to linear by the inverse of
    the sRGB transfer function. Raises InputError if there are no pairs, or no camera.
    """
    sequence = opened(sequence)
    pairs = sorted(sequence.pairs, key=lambda pair: pair.number)
    numbers = tuple(pairs[i].number for i in sorted(frame_slice(frames, len(pairs))))
    camera = sequence.camera
    by_number = {pair.number: pair for pair in pairs}
    truth = _TruthOfSome(sequence, {p.number: p.stamp_s for p in pairs})

    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        colour, depth_z_m = sequence.images(by_number[number])
        return linear_from_srgb8(colour), depth_z_m

    def digest(number: int) -> str:
        pair = by_number[number]
        return sha256(read_bytes(pair.rgb, "an image") + read_bytes(pair.depth, "an image"))

    paths = _kept_paths(sequence)
    return FrameSource(
        camera.pinhole,
        numbers,
        truth.stamps_s,
        load,
        truth.poses,
        _origin(sequence.folder, pairs, camera.depth_units_per_metre, bool(paths)),
        names={p.number: _kept(p, paths.get(p.number, {})) for p in pairs},
        truth_file=truth.file,
        depth_units_per_metre=camera.depth_units_per_metre,
        digest=digest,
        imu=lambda: sequence.imu,
    )


def original_frames(sequence: StoredSequence | StrPath, frames: str = "::") -> FrameSource:
    """Like image_frames; a sequence without noise copies the files byte for byte if it stores
    images in the same way.
    """
    sequence = opened(sequence)
    originals = {pair.number: pair for pair in sequence.pairs}
    return replace(image_frames(sequence, frames), originals=originals)


def _origin(
    folder: Path, pairs: list[ImagePair], units_per_metre: float, names_kept: bool
) -> dict[str, object]:
    names = "\n".join(f"{p.stamp_s:.9f} {p.rgb.name} {p.depth.name}" for p in pairs)
    return {
        "images": folder.resolve().name,
        "depth_units_per_metre": units_per_metre,
        "list_sha256": sha256(names.encode()),
        "names": "kept" if names_kept else "by frame number",
    }


def _kept(pair: ImagePair, paths: Mapping[str, str]) -> SequenceFrame:
    written = {kind: text for kind, text in zip((RGB, DEPTH), pair.written, strict=True) if text}
    return SequenceFrame(pair.number, pair.stamp_s, paths, written)


def _kept_paths(sequence: StoredSequence) -> dict[int, dict[str, str]]:
    """The paths of a sequence's images by frame number and kind; {} if its format does not keep
    names, or if the names cannot be used in another folder: outside the sequence, not unique, or
    with blanks.
    """
    found: dict[int, dict[str, str]] = {}
    folder = sequence.folder
    if not sequence.format.keeps_names:
        return {}
    every: set[str] = set()
    for pair in sequence.pairs:
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


class _TruthOfSome:
    """The ground truth of all frames of a sequence, or of some frames: the poses within half a step
    of one of them.
    """

    def __init__(self, sequence: StoredSequence, stamps_s: dict[int, float]) -> None:
        self.stamps_s = stamps_s
        self._path = sequence.truth_path
        self._loaded = sequence.loaded_truth
        self._is_mounted = sequence.mount is not None
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
