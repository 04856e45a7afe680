"""The images of a sequence as the source of another one."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..channels import DEPTH, RGB
from ..errors import StrPath
from ..formats.files import read_bytes, sha256
from ..geometry.trajectory import frame_slice
from ..sensor.transfer import linear_from_srgb8
from .frame_source import FrameSource
from .image_pairs import ImagePair, find_pairs
from .layout import SequenceCamera, SequenceFrame
from .sequence_formats import format_of
from .stored_images import read_camera, read_images
from .truth_of_some import TruthOfSome


def image_frames(
    folder: StrPath, frames: str = "::", camera: SequenceCamera | None = None
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
    truth = TruthOfSome(folder, {p.number: p.stamp_s for p in pairs})

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


def original_frames(
    folder: StrPath, frames: str = "::", camera: SequenceCamera | None = None
) -> FrameSource:
    """Like image_frames; a sequence without noise copies the files byte for byte if it stores
    images in the same way.
    """
    source = image_frames(folder, frames, camera)
    return replace(source, originals={pair.number: pair for pair in find_pairs(Path(folder))})


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
