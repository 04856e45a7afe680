"""Where a sequence's frames come from: the EXR frames of a render run, or the PNG pairs of a folder that somebody made, in which pairs,
camera and ground truth are found.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..evaluation.associate import associate
from ..formats.associations import read_associations, read_image_list
from ..formats.exr import read_exr
from ..formats.files import data_lines, read_bytes, read_json, read_text, sha256
from ..formats.png import png_header, read_depth16, read_rgb8
from ..formats.trajectories import read_trajectory
from ..geometry import axes
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, frame_slice, stamps_of_frames
from ..sensor.transfer import light_from_srgb8
from .depth_units import UNITS_PER_METRE, check_units, metres_from_depth16
from .ground_truth import TruthImages
from .run_folder import RunFolder
from .sequence_formats import SequenceFrame

_ASSOCIATIONS = ("associations.txt", "association.txt", "associated.txt", "associate.txt")
EUROC, NERF = Path("mav0"), Path("transforms.json")
_TRUTHS = ("groundtruth.txt", "*.gt.freiburg", "*.gt.sim", "mav0/state_groundtruth_estimate0/data.csv")
#: Stamp in seconds, colour image, depth image; and the stamps as the lists write them.
Row = tuple[float, Path, Path] | tuple[float, Path, Path, tuple[str, str]]


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
    load: Callable[[int], tuple[np.ndarray, np.ndarray]]
    truth_of: Callable[[tuple[int, ...]], Trajectory | None]
    origin: dict
    truth_images: TruthImages | None = None
    names: Mapping[int, SequenceFrame] = field(default_factory=dict)
    truth_file: tuple[str, bytes] | None = None


@dataclass(frozen=True)
class ImagePair:
    """A colour and a depth image of one moment; the number is the one in the file's name, else the row."""

    number: int
    stamp_s: float
    rgb: Path
    depth: Path
    #: Stamps of both images as the lists write them; "" where no list gives seconds.
    written: tuple[str, str] = ("", "")


def find_pairs(folder: Path) -> list[ImagePair]:
    """By association file, else by rgb.txt and depth.txt, else by equal names in rgb/ and depth/; euroc's and nerf's layouts.

    Raises InputError where there is nothing to pair.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("a folder with a sequence", path=folder, found="a file" if folder.exists() else "nothing")
    rows = _listed(folder) or _euroc_rows(folder) or _nerf_rows(folder) or _by_name(folder)
    if not rows:
        inside = sorted(path.parent.name for path in folder.glob("*/recipe.json"))
        hint = f"a folder inside: {', '.join(inside)}" if inside else "a folder with rgb/*.png and depth/*.png"
        raise InputError("pairs of colour and depth images", path=folder, found="none", hint=hint)
    numbers = [int(row[1].stem) for row in rows if row[1].stem.isdigit()]
    if len(set(numbers)) < len(rows) or max(numbers) >= 10_000_000:
        numbers = list(range(len(rows)))
    return [ImagePair(number, *row) for number, row in zip(numbers, rows, strict=True)]


def find_truth(folder: Path) -> Path | None:
    """The ground-truth file there, if any."""
    return next((path for pattern in _TRUTHS for path in sorted(folder.glob(pattern))), None)


def read_truth(folder: Path) -> Trajectory | None:
    """Right-handed poses, or None where no ground truth lies there: a trajectory file, or the poses in transforms.json."""
    if (path := find_truth(folder)) is not None:
        return read_trajectory(path).trajectory
    if not (frames := _nerf_rows(folder)):
        return None
    try:
        matrices = np.array([f["transform_matrix"] for f in read_json(folder / NERF)["frames"]], float)
        poses = axes.world_cv_from_world_blender(SE3.from_matrix(matrices))
        return Trajectory(np.array([row[0] for row in frames]), poses)
    except (KeyError, TypeError, ValueError):
        raise InputError("frames with a 4 x 4 transform_matrix", path=folder / NERF) from None


@dataclass(frozen=True)
class SequenceCamera:
    """The pinhole camera, and how many units of the depth images make a metre; `assumed` where no file gives it."""

    pinhole: PinholeCamera
    depth_units_per_metre: float = UNITS_PER_METRE
    assumed: bool = False


def read_camera(folder: Path, image: Path) -> SequenceCamera:
    """camera.json or calibration.txt there, or euroc's or nerf's; else the benchmark's camera where the image has its 640 x 480 pixels."""
    if (folder / "camera.json").is_file():
        settings = read_json(folder / "camera.json")
        units = settings.pop("depth_units_per_metre", UNITS_PER_METRE)
        return SequenceCamera(PinholeCamera.from_dict(settings), check_units(units))
    if (folder / EUROC).is_dir():
        return _euroc_camera(folder / EUROC / "depth0/sensor.yaml")
    if (folder / NERF).is_file():
        return _nerf_camera(folder / NERF)
    header = png_header(image)
    if (
        path := folder / "calibration.txt"
    ).is_file():  # the nine numbers of K; the original's fy < 0 means that y points up
        try:
            fx, _, cx, _, fy, cy, *_ = k = [float(field) for field in read_text(path).split()]
        except ValueError:
            k = []
        if len(k) != 9:
            raise InputError("the nine numbers of K", path=path, hint="{camera}")
        return SequenceCamera(PinholeCamera(header.width, header.height, fx, abs(fy), cx, cy))
    if (header.width, header.height) != (640, 480):
        found = f"images of {header.width} x {header.height} and no camera.json"
        raise InputError("a camera", path=folder, found=found, hint="{camera} WIDTHxHEIGHT,FX,FY,CX,CY")
    return SequenceCamera(PinholeCamera(), assumed=True)


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
    if (recipe := folder / "sequence.json").is_file():
        origin: dict = {"run": read_json(recipe)}
    else:
        hashes = {name: sha256(read_bytes(folder / name)) for name in ("groundtruth.txt", "camera.json")}
        origin = {"frames": folder.resolve().name, "sha256": hashes}
    return _run_source(folder, camera, truth, numbers, origin)


def frames_of_run(run: RunFolder, numbers: Iterable[int]) -> FrameSource:
    """Frames of a run, also such as are still to be rendered when it is asked what is missing. Poses and stamps are those of the run's
    folder: one that an earlier release began, with other stamps, goes on with its own.
    """
    return _run_source(run.path, run.camera, run.truth(), numbers, {"run": run.recipe})


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
    kept = {}
    for pair, named in zip(pairs, paths, strict=True):
        by_kind = (dict(zip(("rgb", "depth"), texts, strict=True)) for texts in (named, pair.written))
        kept[pair.number] = SequenceFrame(pair.number, pair.stamp_s, *by_kind)
    return kept


def _listed(folder: Path) -> list[Row]:
    file = next((folder / name for name in _ASSOCIATIONS if (folder / name).is_file()), None)
    if file is not None:
        pairs = read_associations(file)
        rgb, depth, indices = pairs.rgb, pairs.depth, [(i, i) for i in range(len(pairs))]
    elif (folder / "rgb.txt").is_file() and (folder / "depth.txt").is_file():
        rgb, depth = read_image_list(folder / "rgb.txt"), read_image_list(folder / "depth.txt")
        both = associate(np.array(rgb.stamps_s), np.array(depth.stamps_s))
        indices = list(zip(both.first.tolist(), both.second.tolist(), strict=True))
    else:
        return []
    texts = [images.written or ("",) * len(images) for images in (rgb, depth)]
    return [
        (rgb.stamps_s[i], folder / rgb.paths[i], folder / depth.paths[j], (texts[0][i], texts[1][j]))
        for i, j in indices
    ]


def _by_name(folder: Path) -> list[Row]:
    depths = {p.stem: p for p in (folder / "depth").glob("*.png")}
    rgbs = sorted(p for p in (folder / "rgb").glob("*.png") if p.stem in depths)
    numbered = all(p.stem.isdigit() for p in rgbs)
    stamps_s = stamps_of_frames([int(p.stem) if numbered else i for i, p in enumerate(rgbs)]).tolist()
    return sorted((stamp_s, p, depths[p.stem]) for stamp_s, p in zip(stamps_s, rgbs, strict=True))


def _euroc_rows(folder: Path) -> list[Row]:
    """By nanoseconds, as both data.csv have them; [] where the folder has not EuRoC's layout."""
    if not (folder / EUROC).is_dir():
        return []
    images = []
    for sensor in (folder / EUROC / "cam0", folder / EUROC / "depth0"):
        try:
            fields = [line.split(",") for _, line in data_lines(read_text(sensor / "data.csv"))]
            images.append({int(stamp): sensor / "data" / name.strip() for stamp, name in fields})
        except ValueError:
            raise InputError("lines `nanoseconds,image`", path=sensor / "data.csv") from None
    rgb, depth = images
    return [(ns / 1e9, rgb[ns], depth[ns]) for ns in sorted(rgb.keys() & depth.keys())]


def _euroc_camera(file: Path) -> SequenceCamera:
    text = read_text(file)
    lists = dict(re.findall(r"^(resolution|intrinsics): *\[(.*)\]", text, re.MULTILINE))
    try:
        width, height = (int(value) for value in lists["resolution"].split(","))
        fx, fy, cx, cy = (float(value) for value in lists["intrinsics"].split(","))
    except (KeyError, ValueError):
        raise InputError("resolution: [w, h] and intrinsics: [fx, fy, cx, cy]", path=file) from None
    units = re.search(r"^depth_units_per_metre: *([\d.]+)", text, re.MULTILINE)
    per_metre = check_units(float(units[1]) if units else UNITS_PER_METRE)
    return SequenceCamera(PinholeCamera(width, height, fx, fy, cx, cy), per_metre)


def _nerf_rows(folder: Path) -> list[Row]:
    """[] where there is no transforms.json."""
    if not (folder / NERF).is_file():
        return []
    found: list[Row] = []
    frames = read_json(folder / NERF).get("frames")
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise InputError("a list of frames", path=folder / NERF)
    for place, frame in enumerate(frames):
        image, depth = (frame.get(key) for key in ("file_path", "depth_file_path"))
        if not isinstance(image, str) or not isinstance(depth, str):
            raise InputError("frames with file_path and depth_file_path", path=folder / NERF, found=f"frame {place}")
        number = int(Path(image).stem) if Path(image).stem.isdigit() else place
        found.append((float(stamps_of_frames(number)), folder / image, folder / depth))
    return found


def _nerf_camera(file: Path) -> SequenceCamera:
    """Their pixel centres lie at +0.5."""
    content = read_json(file)
    try:
        w, h, fx, fy, cx, cy = (float(content[key]) for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"))
        units = 1 / float(content.get("integer_depth_scale", 1 / UNITS_PER_METRE))
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        raise InputError("numbers w, h, fl_x, fl_y, cx, cy, integer_depth_scale", path=file) from None
    return SequenceCamera(PinholeCamera(int(w), int(h), fx, fy, cx - 0.5, cy - 0.5), check_units(units))
