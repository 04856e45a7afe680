"""Finding the image pairs, the camera and the ground truth in a folder that somebody made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..evaluation.associate import associate
from ..formats.associations import read_associations, read_image_list
from ..formats.files import read_json, read_text
from ..formats.png import png_header
from ..formats.trajectories import read_trajectory
from ..geometry.camera import PinholeCamera
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from . import other_forms
from .depth_units import UNITS_PER_METRE, check_units

_ASSOCIATIONS = ("associations.txt", "association.txt", "associated.txt", "associate.txt")
_TRUTHS = ("groundtruth.txt", "*.gt.freiburg", "*.gt.sim", "mav0/state_groundtruth_estimate0/data.csv")


@dataclass(frozen=True)
class ImagePair:
    """A colour and a depth image of one moment; the number is the one in the file's name, else the row."""

    number: int
    stamp_s: float
    rgb: Path
    depth: Path


def find_pairs(folder: Path) -> list[ImagePair]:
    """By association file, else by rgb.txt and depth.txt, else by equal names in rgb/ and depth/; euroc's and nerf's forms.

    Raises InputError where there is nothing to pair.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("a folder with a sequence", path=folder, found="a file" if folder.exists() else "nothing")
    rows = _listed(folder) or other_forms.rows(folder) or _by_name(folder)
    if not rows:
        inside = sorted(path.parent.name for path in folder.glob("*/recipe.json"))
        hint = f"a folder inside: {', '.join(inside)}" if inside else "a folder with rgb/*.png and depth/*.png"
        raise InputError("pairs of colour and depth images", path=folder, found="none", hint=hint)
    numbers = [int(rgb.stem) for _, rgb, _ in rows if rgb.stem.isdigit()]
    if len(set(numbers)) < len(rows) or max(numbers) >= 10_000_000:
        numbers = list(range(len(rows)))
    return [ImagePair(number, *row) for number, row in zip(numbers, rows, strict=True)]


def find_associations(folder: Path) -> Path | None:
    """The association file there, if any."""
    return next((folder / name for name in _ASSOCIATIONS if (folder / name).is_file()), None)


def find_truth(folder: Path) -> Path | None:
    """The ground-truth file there, if any."""
    return next((path for pattern in _TRUTHS for path in sorted(folder.glob(pattern))), None)


def read_truth(folder: Path) -> Trajectory | None:
    """Right-handed poses, or None where no ground truth lies there."""
    path = find_truth(folder)
    return other_forms.nerf_truth(folder) if path is None else read_trajectory(path).trajectory


@dataclass(frozen=True)
class SequenceCamera:
    """The pinhole camera, and how many units of the depth images make a metre; `assumed` where nothing told it."""

    pinhole: PinholeCamera
    depth_units_per_metre: float = UNITS_PER_METRE
    assumed: bool = False


def read_camera(folder: Path, image: Path) -> SequenceCamera:
    """camera.json or calibration.txt there, or euroc's or nerf's; else the benchmark's camera where the image has its 640 x 480 pixels."""
    if (folder / "camera.json").is_file():
        settings = read_json(folder / "camera.json")
        units = settings.pop("depth_units_per_metre", UNITS_PER_METRE)
        return SequenceCamera(PinholeCamera.from_dict(settings), check_units(units))
    other = other_forms.camera(folder)
    if other is not None:
        return SequenceCamera(other[0], check_units(other[1]))
    header = png_header(image)
    if (folder / "calibration.txt").is_file():
        return SequenceCamera(_read_calibration(folder / "calibration.txt", header.width, header.height))
    if (header.width, header.height) != (640, 480):
        found = f"images of {header.width} x {header.height} and no camera.json"
        raise InputError("a camera", path=folder, found=found, hint="--camera WIDTHxHEIGHT,FX,FY,CX,CY")
    return SequenceCamera(PinholeCamera(), assumed=True)


def _read_calibration(path: Path, width: int, height: int) -> PinholeCamera:
    """The nine numbers of K; the original's fy < 0 says that y points up."""
    try:
        k = [float(field) for field in read_text(path).split()]
    except ValueError:
        k = []
    if len(k) != 9:
        raise InputError("the nine numbers of K", path=path, hint="--camera")
    return PinholeCamera(width, height, k[0], abs(k[4]), k[2], k[5])


def _listed(folder: Path) -> list[tuple[float, Path, Path]]:
    file = find_associations(folder)
    if file is not None:
        pairs = read_associations(file)
        rows = list(zip(pairs.rgb.stamps_s, pairs.rgb.paths, pairs.depth.paths, strict=True))
    elif (folder / "rgb.txt").is_file() and (folder / "depth.txt").is_file():
        rgb, depth = read_image_list(folder / "rgb.txt"), read_image_list(folder / "depth.txt")
        both = associate(np.array(rgb.stamps_s), np.array(depth.stamps_s))
        rows = [(rgb.stamps_s[i], rgb.paths[i], depth.paths[j]) for i, j in zip(both.first, both.second, strict=True)]
    else:
        return []
    return [(stamp_s, folder / rgb, folder / depth) for stamp_s, rgb, depth in rows]


def _by_name(folder: Path) -> list[tuple[float, Path, Path]]:
    depths = {p.stem: p for p in (folder / "depth").glob("*.png")}
    rgbs = [p for p in (folder / "rgb").glob("*.png") if p.stem in depths]
    if all(p.stem.isdigit() for p in rgbs):
        rgbs.sort(key=lambda p: int(p.stem))
        return [(int(p.stem) / FRAME_RATE_HZ, p, depths[p.stem]) for p in rgbs]
    rgbs.sort()
    return [(i / FRAME_RATE_HZ, p, depths[p.stem]) for i, p in enumerate(rgbs)]
