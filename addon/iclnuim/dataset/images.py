"""Finding the image pairs, the camera and the ground truth in a folder that somebody made."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..evaluation.associate import associate
from ..formats.associations import read_associations, read_image_list
from ..formats.files import data_lines, read_json, read_text
from ..formats.png import png_header
from ..formats.trajectories import read_trajectory
from ..geometry import axes
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from .depth_units import UNITS_PER_METRE, check_units

_ASSOCIATIONS = ("associations.txt", "association.txt", "associated.txt", "associate.txt")
EUROC, NERF = Path("mav0"), Path("transforms.json")
_TRUTHS = ("groundtruth.txt", "*.gt.freiburg", "*.gt.sim", "mav0/state_groundtruth_estimate0/data.csv")


#: Stamp in seconds, colour image, depth image; and the stamps as the lists write them.
Row = tuple[float, Path, Path] | tuple[float, Path, Path, tuple[str, str]]


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
    """Right-handed poses, or None where no ground truth lies there."""
    path = find_truth(folder)
    return _nerf_truth(folder) if path is None else read_trajectory(path).trajectory


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
    if (folder / "calibration.txt").is_file():
        return SequenceCamera(_read_calibration(folder / "calibration.txt", header.width, header.height))
    if (header.width, header.height) != (640, 480):
        found = f"images of {header.width} x {header.height} and no camera.json"
        raise InputError("a camera", path=folder, found=found, hint="{camera} WIDTHxHEIGHT,FX,FY,CX,CY")
    return SequenceCamera(PinholeCamera(), assumed=True)


def _read_calibration(path: Path, width: int, height: int) -> PinholeCamera:
    """The nine numbers of K; the original's fy < 0 means that y points up."""
    try:
        k = [float(field) for field in read_text(path).split()]
    except ValueError:
        k = []
    if len(k) != 9:
        raise InputError("the nine numbers of K", path=path, hint="{camera}")
    return PinholeCamera(width, height, k[0], abs(k[4]), k[2], k[5])


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
    rgbs = [p for p in (folder / "rgb").glob("*.png") if p.stem in depths]
    numbered = all(p.stem.isdigit() for p in rgbs)
    numbers = (int(p.stem) if numbered else i for i, p in enumerate(sorted(rgbs)))
    return sorted((number / FRAME_RATE_HZ, p, depths[p.stem]) for number, p in zip(numbers, sorted(rgbs), strict=True))


def _nerf_truth(folder: Path) -> Trajectory | None:
    """Poses of transforms.json; None where it is not there. (Those of euroc are a trajectory file like others.)"""
    frames = _nerf_rows(folder)
    if not frames:
        return None
    try:
        matrices = np.array([f["transform_matrix"] for f in read_json(folder / NERF)["frames"]], float)
        poses = axes.world_cv_from_world_blender(SE3.from_matrix(matrices))
        return Trajectory(np.array([row[0] for row in frames]), poses)
    except (KeyError, TypeError, ValueError):
        raise InputError("frames with a 4 x 4 transform_matrix", path=folder / NERF) from None


def _euroc_rows(folder: Path) -> list[Row]:
    """[] where the folder has not EuRoC's layout."""
    mav = folder / EUROC
    if not mav.is_dir():
        return []
    images = [_euroc_images(mav / sensor) for sensor in ("cam0", "depth0")]
    return [(ns / 1e9, images[0][ns], images[1][ns]) for ns in sorted(images[0].keys() & images[1].keys())]


def _euroc_images(sensor: Path) -> dict[int, Path]:
    """Nanoseconds -> image, as data.csv has them."""
    table = sensor / "data.csv"
    try:
        fields = [line.split(",") for _, line in data_lines(read_text(table))]
        return {int(stamp): sensor / "data" / name.strip() for stamp, name in fields}
    except ValueError:
        raise InputError("lines `nanoseconds,image`", path=table) from None


def _euroc_camera(file: Path) -> SequenceCamera:
    text = read_text(file)
    lists = dict(re.findall(r"^(resolution|intrinsics): *\[(.*)\]", text, re.MULTILINE))
    try:
        width, height = (int(value) for value in lists["resolution"].split(","))
        fx, fy, cx, cy = (float(value) for value in lists["intrinsics"].split(","))
    except (KeyError, ValueError):
        raise InputError("resolution: [w, h] and intrinsics: [fx, fy, cx, cy]", path=file) from None
    units = re.search(r"^depth_units_per_metre: *([\d.]+)", text, re.MULTILINE)
    return SequenceCamera(
        PinholeCamera(width, height, fx, fy, cx, cy), check_units(float(units[1]) if units else UNITS_PER_METRE)
    )


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
        found.append((number / FRAME_RATE_HZ, folder / image, folder / depth))
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
