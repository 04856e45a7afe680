"""Where a sequence's frames come from: the EXR frames of a render run, or the PNG pairs of a sequence."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..formats.exr import read_exr
from ..formats.files import read_bytes, read_json, sha256
from ..formats.png import read_depth16, read_rgb8
from ..formats.trajectories import read_trajectory
from ..geometry.camera import PinholeCamera
from ..geometry.trajectory import Trajectory, frame_slice
from ..sensor.transfer import light_from_srgb8
from .depth_units import metres_from_depth16
from .ground_truth import TruthImages
from .images import EUROC, NERF, ImagePair, SequenceCamera, find_pairs, find_truth, read_camera, read_truth
from .run_folder import RunFolder
from .sequence_formats import SequenceFrame

LoadFrame = Callable[[int], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class FrameSource:
    """Frames to make a sequence of. `numbers` (n,), ascending, name them and seed their noise.

    `load(number)` gives scene-linear RGB (h, w, 3) and planar depth in metres (h, w) as they lie on disk. `stamps_s`
    holds the stamp of every frame there is, also of those not asked for; `truth_of(numbers)` the ground truth to
    write beside those frames, None where there is none. `origin` goes into the recipe. `truth_images`: instances, classes and normals, where the run has them. `names` and
    `truth_file`: what the images are called, and format and bytes of a ground-truth file, where a sequence in the same format keeps them.
    """

    camera: PinholeCamera
    numbers: tuple[int, ...]
    stamps_s: Mapping[int, float]
    load: LoadFrame
    truth_of: Callable[[tuple[int, ...]], Trajectory | None]
    origin: dict
    truth_images: TruthImages | None = None
    names: Mapping[int, SequenceFrame] = field(default_factory=dict)
    truth_file: tuple[str, bytes] | None = None


def run_frames(folder: Path | str, frames: str = "::") -> FrameSource:
    """The EXR frames of a run folder (exr/000000.exr, groundtruth.txt, camera.json, sequence.json).

    `frames` slices the poses of the trajectory; of these, the frames that exist are used. Raises InputError for a
    folder that is none, and for no frames.
    """
    folder = Path(folder)
    there = {int(p.stem) for p in (folder / "exr").glob("*.exr") if p.stem.isdigit()}
    if not there:
        hint = "the folder that `iclnuim render` wrote"
        raise InputError("a run with frames exr/000000.exr ...", path=folder, found="none", hint=hint)
    truth = read_trajectory(folder / "groundtruth.txt", "tum").trajectory
    if max(there) >= len(truth):
        expected = f"frames of the {len(truth)} poses in groundtruth.txt"
        raise InputError(expected, path=folder / "exr", found=f"frame {max(there)}")
    numbers = sorted(there.intersection(frame_slice(frames, len(truth))))
    if not numbers:
        raise InputError(f"frames {frames} to be rendered", path=folder, found="none of them")
    camera = PinholeCamera.from_dict(read_json(folder / "camera.json"))
    return _run_source(folder, camera, truth, numbers, _run_origin(folder))


def frames_of_run(run: RunFolder, truth: Trajectory, numbers: Iterable[int]) -> FrameSource:
    """Frames of a run, also such as are still to be rendered when it is asked what is missing."""
    return _run_source(run.path, run.camera, truth, numbers, {"run": run.recipe})


def _run_source(
    folder: Path, camera: PinholeCamera, truth: Trajectory, numbers: Iterable[int], origin: dict
) -> FrameSource:
    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        return read_frame(folder / "exr" / f"{number:06}.exr", camera)

    stamps_s = dict(enumerate(truth.stamps_s.tolist()))
    more = TruthImages(folder) if origin.get("run", {}).get("job", {}).get("ground_truth") else None
    return FrameSource(camera, tuple(sorted(numbers)), stamps_s, load, lambda some: truth[np.array(some)], origin, more)


def read_frame(path: Path, camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """(h, w, 3) half or float scene-linear RGB and (h, w) float32 planar metres of one EXR frame.

    Raises InputError where a channel is missing, the size is not the camera's, or Z is only half precision.
    """
    channels = read_exr(path)
    missing = [name for name in "RGBZ" if name not in channels]
    if missing:
        found = f"no {', '.join(missing)} among {', '.join(channels)}"
        raise InputError("channels R, G, B and Z", path=path, found=found)
    depth_z_m = channels["Z"]
    height, width = depth_z_m.shape
    if (height, width) != (camera.height, camera.width):
        expected = f"{camera.width} x {camera.height} as camera.json has it"
        raise InputError(expected, path=path, found=f"{width} x {height}")
    if depth_z_m.dtype != np.float32:
        raise InputError("Z as 32-bit float", path=path, found="half, which rounds 4 m to 2 mm")
    return np.stack([channels[c] for c in "RGB"], -1), depth_z_m


def image_frames(folder: Path | str, frames: str = "::", camera: SequenceCamera | None = None) -> FrameSource:
    """The pairs of a sequence that somebody has: rgb/ and depth/ as PNG, with or without lists of them, or EuRoC's or NeRF's layout.

    `frames` slices the pairs. RGB is the 8-bit colour, made linear by the inverse of the sRGB transfer function. Raises
    InputError where there are no pairs, or the camera is neither given nor beside the images.
    """
    folder = Path(folder)
    pairs = sorted(find_pairs(folder), key=lambda pair: pair.number)
    numbers = tuple(pairs[i].number for i in sorted(frame_slice(frames, len(pairs))))
    camera = camera or read_camera(folder, pairs[0].rgb)
    by_number = {pair.number: pair for pair in pairs}
    truth_path = find_truth(folder)
    loaded = read_trajectory(truth_path) if truth_path else None
    truth = loaded.trajectory if loaded else read_truth(folder)

    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        pair, pinhole = by_number[number], camera.pinhole
        image, units = read_rgb8(pair.rgb), read_depth16(pair.depth)
        for path, (height, width) in ((pair.rgb, image.shape[:2]), (pair.depth, units.shape)):
            if (height, width) != (pinhole.height, pinhole.width):
                expected = f"{pinhole.width} x {pinhole.height} as the camera has it"
                raise InputError(expected, path=path, found=f"{width} x {height}", hint="{camera}")
        return light_from_srgb8(image), metres_from_depth16(units, camera.depth_units_per_metre)

    names = "\n".join(f"{p.stamp_s:.9f} {p.rgb.name} {p.depth.name}" for p in pairs)
    kept, stamps_s = _kept_names(folder, pairs), {p.number: p.stamp_s for p in pairs}
    origin = {
        "images": folder.resolve().name,
        "depth_units_per_metre": camera.depth_units_per_metre,
        "list_sha256": sha256(names.encode()),
        "names": "kept" if kept else "by frame number",
    }
    truth_file = (loaded.read_as.format, read_bytes(truth_path)) if loaded and truth_path else None
    return FrameSource(
        camera.pinhole, numbers, stamps_s, load, lambda some: truth, origin, names=kept, truth_file=truth_file
    )


def _kept_names(folder: Path, pairs: list[ImagePair]) -> dict[int, SequenceFrame]:
    """The names of a sequence's images and stamps by frame number; {} for EuRoC's and NeRF's layouts, and where the names could not
    stand in another folder: outside of the sequence, not unique, or with blanks.
    """
    if (folder / EUROC).is_dir() or (folder / NERF).is_file():
        return {}
    try:
        paths = [tuple(image.relative_to(folder).as_posix() for image in (p.rgb, p.depth)) for p in pairs]
    except ValueError:
        return {}
    every = [path for pair in paths for path in pair]
    plain = all(path.endswith(".png") and path.split() == [path] and "#" not in path for path in every)
    if not plain or len(set(every)) < len(every) or any(".." in Path(path).parts for path in every):
        return {}
    named = zip(pairs, paths, strict=True)
    return {p.number: SequenceFrame(p.number, p.stamp_s, rgb, depth, p.written) for p, (rgb, depth) in named}


def _run_origin(folder: Path) -> dict:
    """What decided the frames: the run's own recipe, or hashes of poses and camera where there is none."""
    recipe = folder / "sequence.json"
    if recipe.is_file():
        return {"run": read_json(recipe)}
    hashes = {name: sha256(read_bytes(folder / name)) for name in ("groundtruth.txt", "camera.json")}
    return {"frames": folder.resolve().name, "sha256": hashes}
