"""Evaluation of views rendered by a mapping system against the true frames of a sequence: PSNR,
SSIM, LPIPS, Depth L1, separately for keyframes and other frames.
"""

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..channels import DEPTH, RGB
from ..console import Meter, advance_of
from ..errors import InputError, StrPath, WorkError
from ..evaluation.image_error import ViewSettings, psnr_db, ssim
from ..formats.files import csv_text, data_lines, is_file, read_text
from ..formats.image_names import by_numbers
from ..formats.images import JPEG, METRES, read_colour8
from ..shown import Shown, axes_or_new
from .camera_files import SequenceCamera, camera_file
from .frames import ImagePair, usual_step_s
from .stored_sequence import StoredSequence, read_depth_m
from .view_doubts import view_doubts

if TYPE_CHECKING:
    from ..shown import Axes

#: Figures of a view -> unit.
FIGURES = {"psnr_db": "dB", "ssim": "", "lpips": "", "depth_l1_m": "m", "depth_missing": ""}
_ENDINGS = {RGB: (".png", JPEG, ".jpeg"), DEPTH: (".png", *METRES)}


@dataclass(frozen=True)
class ViewError:
    """The figures of one view. name: its image's name without the ending; keyframe: whether it is a
    keyframe. psnr_db is inf for equal images; lpips is None if its package is missing. With
    rendered depth: depth_l1_m, the mean |depth - true depth| over pixels with true depth, where a
    hole has depth 0, and depth_missing, the share of holes among these pixels.
    """

    name: str
    keyframe: bool
    psnr_db: float
    ssim: float
    lpips: float | None = None
    depth_l1_m: float | None = None
    depth_missing: float | None = None


@dataclass(frozen=True, repr=False)
class ViewErrors(Shown):
    """The figures of all existing views; `missing`: names of frames without a view; warnings: what
    makes the views fit far better.
    """

    views: tuple[ViewError, ...]
    missing: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def mean(self, keyframe: bool | None = None) -> dict[str, float]:
        """Means over all views, over keyframes (True), or over the others (False).

        Figures that no view has are left out; {} without views.
        """
        chosen = [view for view in self.views if keyframe is None or view.keyframe == keyframe]
        found = {}
        for name in FIGURES:
            values = [getattr(view, name) for view in chosen if getattr(view, name) is not None]
            if values:
                found[name] = float(np.mean(values))
        return found

    def summary(self) -> str:
        words = [f"{name} {value:.4g}" for name, value in self.mean().items()]
        return ", ".join([f"{len(self.views)} views", *words])

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw PSNR over the views in their order; returns the Matplotlib axes."""
        axes = axes_or_new(axes)
        axes.plot([view.psnr_db for view in self.views], ".-", linewidth=0.9)
        axes.set(xlabel="view", ylabel="PSNR (dB)")
        axes.grid(alpha=0.3)
        return axes

    def to_dict(self) -> dict[str, Any]:
        """Counts and means by group. Infinite values (equal images) are None."""
        groups: dict[str, bool | None] = {"all": None}
        if any(view.keyframe for view in self.views):
            groups |= {"keyframes": True, "others": False}
        found: dict = {"views": len(self.views), "missing": list(self.missing)}
        found["warnings"] = list(self.warnings)
        for group, keyframe in groups.items():
            count = sum(keyframe is None or view.keyframe == keyframe for view in self.views)
            found[group] = {"views": count}
            for name, value in self.mean(keyframe).items():
                found[group][name] = value if np.isfinite(value) else None
        return found

    def csv(self) -> str:
        """A CSV table with one line per view."""
        rows: list[list[object]] = [["view", "keyframe", *FIGURES]]
        for view in self.views:
            rows.append([view.name, int(view.keyframe), *(getattr(view, name) for name in FIGURES)])
        return csv_text(rows)


def view_errors(
    folder: StrPath,
    truth: StrPath,
    keyframes: StrPath | None = None,
    settings: ViewSettings | None = None,
    progress: Meter = None,
) -> ViewErrors:
    """Compare rendered images in `folder` with the frames of the sequence `truth`, in any format.
    Images have the names of the frames.

    The rendered colour of rgb/000012.png is rgb/000012 or 000012 in `folder`, as .png or .jpg. Its
    depth, if any, is depth/000012, as .png in the units of camera.json in `folder` or else of
    `truth`, or as .npy in metres. keyframes: a file with one line per keyframe, which starts with
    its image's name, its frame number or its stamp, for example a trajectory of keyframes.
    progress: as of render_frames().

    Raises InputError if there is no view, images differ in size, or a keyframe is not a frame of
    the sequence; WorkError if LPIPS cannot start.
    """
    folder = Path(folder)
    truth = Path(truth)
    settings = settings or ViewSettings()
    sequence = StoredSequence(truth)
    pairs = sequence.pairs
    if not folder.is_dir():
        raise InputError("a folder of rendered views", path=folder, found="no such folder")
    camera = sequence.camera
    own = camera_file(folder) or camera
    chosen = set() if keyframes is None else read_keyframes(Path(keyframes), pairs)
    perceptual = _lpips() if settings.lpips and has_lpips() else lambda image, colour: None
    views = []
    missing = []
    on_view = advance_of(progress, len(pairs), "evaluate", "views")
    for row, pair in enumerate(pairs):
        rgb = _find(folder, truth, pair.rgb, RGB)
        on_view()
        if rgb is None:
            missing.append(pair.rgb.stem)
            continue
        colour, depth_z_m = sequence.images(pair)
        image = read_colour8(rgb)
        _check_size(rgb, image, camera)
        depth = _find(folder, truth, pair.depth, DEPTH)
        l1_m, holes = _depth_error(depth, depth_z_m, own)
        view = ViewError(
            pair.rgb.stem,
            row in chosen,
            psnr_db(image, colour),
            ssim(image, colour, settings.ssim_window),
            lpips=perceptual(image, colour),
            depth_l1_m=l1_m,
            depth_missing=holes,
        )
        views.append(view)
    if not views:
        expected = f"views named as the images of {truth}, such as {pairs[0].rgb.name}"
        raise InputError(expected, path=folder, found="none of them")
    found = ViewErrors(tuple(views), tuple(missing))
    return replace(found, warnings=view_doubts(found, _ViewFiles(folder, sequence, own)))


def read_keyframes(path: Path, pairs: Sequence[ImagePair]) -> set[int]:
    """Indices of the pairs listed in a file. Raises InputError for a line that is not a frame."""
    names = {pair.rgb.stem: row for row, pair in enumerate(pairs)}
    numbers = {pair.number: row for row, pair in enumerate(pairs)}
    stamps_s = np.array([pair.stamp_s for pair in pairs])
    found = set()
    for line, text in data_lines(read_text(path)):
        word = text.replace(",", " ").split()[0]
        is_file_name = word.endswith((*_ENDINGS[RGB], *METRES))
        row = names.get(Path(word).stem if is_file_name else word)
        if row is None and word.isdecimal():
            row = numbers.get(int(word))
        if row is None:
            row = _by_stamp(word, stamps_s)
        if row is None:
            expected = "the name, number or stamp of a frame"
            raise InputError(expected, path=path, line=line, found=word)
        found.add(row)
    return found


def _by_stamp(word: str, stamps_s: np.ndarray) -> int | None:
    try:
        off_s = np.abs(stamps_s - float(word))
    except ValueError:
        return None
    row = int(off_s.argmin())
    return row if off_s[row] <= 0.5 * usual_step_s(stamps_s) else None


def _find(folder: Path, truth: Path, image: Path, kind: str) -> Path | None:
    """The file of the view of a true image: at the same relative path, in rgb/ or depth/, or, for
    colour, in the folder itself.
    """
    places = [folder / kind / image.stem]
    if image.is_relative_to(truth):
        places.insert(0, folder / image.relative_to(truth).with_suffix(""))
    if kind == RGB:
        places.append(folder / image.stem)
    for place in places:
        for ending in _ENDINGS[kind]:
            file = place.with_name(place.name + ending)
            if is_file(file):
                return file
    return None


def _check_size(path: Path, image: np.ndarray, camera: SequenceCamera) -> None:
    c = camera.pinhole
    if image.shape[:2] != (c.height, c.width):
        found = f"{image.shape[1]} x {image.shape[0]}"
        raise InputError(f"{c.width} x {c.height}, as the true image", path=path, found=found)


def _depth_error(
    path: Path | None, truth_m: np.ndarray, camera: SequenceCamera
) -> tuple[float | None, float | None]:
    """depth_l1_m and depth_missing; None without a depth image, or if no pixel has true depth."""
    valid = truth_m > 0
    if path is None or not valid.any():
        return None, None
    depth_z_m = read_depth_m(path, camera.depth_units_per_metre)
    _check_size(path, depth_z_m, camera)
    depth = np.where(np.isfinite(depth_z_m) & (depth_z_m > 0), depth_z_m, 0)[valid].astype(float)
    return float(np.abs(depth - truth_m[valid]).mean()), float((depth == 0).mean())


class _ViewFiles:
    """Views and true frames, read again where the views are in doubt."""

    def __init__(self, folder: Path, sequence: StoredSequence, camera: SequenceCamera) -> None:
        self.sequence = sequence
        self.camera = camera
        self.paths = {
            kind: [
                _find(folder, sequence.folder, pair.rgb if kind == RGB else pair.depth, kind)
                for pair in sequence.pairs
            ]
            for kind in (RGB, DEPTH)
        }
        parents = {path.parent for path in self.paths[RGB] if path is not None}
        there = {path for parent in parents for path in parent.iterdir() if path.is_file()}
        images = [path for path in there if path.suffix.lower() in _ENDINGS[RGB]]
        self.every_image = sorted(images, key=lambda path: by_numbers(path.stem))

    def depth(self, row: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Rendered and true depth (h, w) in metres of a frame; None without a rendered one."""
        path = self.paths[DEPTH][row]
        if path is None:
            return None
        rendered = read_depth_m(path, self.camera.depth_units_per_metre)
        true = read_depth_m(
            self.sequence.pairs[row].depth, self.sequence.camera.depth_units_per_metre
        )
        return rendered, true


def has_lpips() -> bool:
    """Whether the package lpips is installed, and PyTorch, which it needs."""
    return all(importlib.util.find_spec(name) for name in ("lpips", "torch"))


@cache
def _lpips() -> Callable[[np.ndarray, np.ndarray], float]:
    """A function that computes LPIPS of two images (h, w, 3) uint8 (Zhang et al., CVPR 2018), with
    AlexNet, by its package. Raises WorkError.
    """
    import lpips
    import torch

    try:
        network: Any = lpips.LPIPS(net="alex", verbose=False).eval()
    except Exception as error:  # of any kind: the weights are downloaded at first use
        raise WorkError(f"LPIPS cannot start: {error}", hint="--no-lpips") from None

    def distance(image: np.ndarray, truth: np.ndarray) -> float:
        both = torch.from_numpy(np.stack([image, truth]).astype(np.float32) / 127.5 - 1)
        with torch.no_grad():
            return float(network(*both.permute(0, 3, 1, 2)[:, None]))

    return distance
