"""Pictures of a sequence: a sheet of colour, depth and error of some frames, and a short film."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from iclnuim.dataset.consistency import carried_residual
from iclnuim.dataset.images import ImagePair, SequenceCamera, find_pairs, read_camera, read_truth
from iclnuim.errors import InputError
from iclnuim.formats.files import atomic_write
from iclnuim.formats.png import read_depth16, read_rgb8, write_png
from iclnuim.geometry.trajectory import Trajectory, sample

from .console import Console

_ROWS, _FILM_FRAMES, _FILM_HZ = 6, 300, 15
_ERROR_FULL_M = 0.05


def draw_preview(folder: Path, out: Path, console: Console) -> list[Path]:
    """preview.png and preview.mp4 (without OpenCV's encoder preview.gif) in `out`; the files written."""
    out.mkdir(parents=True, exist_ok=True)
    pairs = find_pairs(folder)
    camera, truth = read_camera(folder, pairs[0].rgb), read_truth(folder)
    spread = [pairs[int(i)] for i in sorted({int(i) for i in np.linspace(0, len(pairs) - 1, _ROWS)})]
    sheet = np.vstack([_row(pair, pairs, camera, truth) for pair in spread])
    write_png(out / "preview.png", np.ascontiguousarray(sheet))
    step = max(1, -(-len(pairs) // _FILM_FRAMES))
    progress = console.progress(len(pairs[::step]), "film")
    frames = []
    for pair in pairs[::step]:
        frames.append(np.hstack([_halved(read_rgb8(pair.rgb)), _halved(_depth_colours(_metres(pair, camera)))]))
        progress.advance()
    return [out / "preview.png", _film(out, frames)]


def _row(pair: ImagePair, pairs: list[ImagePair], camera: SequenceCamera, truth: Trajectory | None) -> np.ndarray:
    """Colour, depth in colour, and how far the depth of a frame half a second away, carried here, is off."""
    depth_z_m = _metres(pair, camera)
    tiles = [read_rgb8(pair.rgb), _depth_colours(depth_z_m), _error_tile(pair, pairs, depth_z_m, camera, truth)]
    return np.hstack([_halved(tile) for tile in tiles])


def _metres(pair: ImagePair, camera: SequenceCamera) -> np.ndarray:
    depth = read_depth16(pair.depth) / camera.depth_units_per_metre
    if depth.shape != (camera.pinhole.height, camera.pinhole.width):
        raise InputError("depth images of the camera's size", path=pair.depth, found=depth.shape)
    return depth


def _error_tile(
    pair: ImagePair, pairs: list[ImagePair], depth_z_m: np.ndarray, camera: SequenceCamera, truth: Trajectory | None
) -> np.ndarray:
    tile = np.full((*depth_z_m.shape, 3), 40, np.uint8)
    i = pairs.index(pair)
    other = pairs[i - 15] if i >= 15 else pairs[min(i + 15, len(pairs) - 1)]
    stamps = np.array([pair.stamp_s, other.stamp_s])
    covered = (
        truth is not None and len(truth) > 1 and truth.stamps_s[0] <= stamps.min() <= stamps.max() <= truth.stamps_s[-1]
    )
    if other is pair or not covered:
        return tile
    poses = sample(truth, stamps)
    T_other_here = poses[1].inverse() @ poses[0]
    residual = carried_residual(depth_z_m, _metres(other, camera), T_other_here, camera.pinhole)
    shown = np.isfinite(residual)
    tile[shown] = _colours(np.abs(residual[shown]) / _ERROR_FULL_M, "inferno")
    return tile


def _depth_colours(depth_z_m: np.ndarray) -> np.ndarray:
    """Near red, far blue, missing black."""
    seen = depth_z_m > 0
    image = np.zeros((*depth_z_m.shape, 3), np.uint8)
    if seen.any():
        near, far = np.percentile(depth_z_m[seen], (1, 99))
        image[seen] = _colours(1 - (depth_z_m[seen] - near) / max(far - near, 1e-6), "turbo")
    return image


def _colours(share: np.ndarray, name: str) -> np.ndarray:
    from matplotlib import colormaps

    return (colormaps[name](np.clip(share, 0, 1))[..., :3] * 255).astype(np.uint8)


def _halved(image: np.ndarray) -> np.ndarray:
    """2 x 2 means, so that a sheet of three tiles stays small."""
    h, w = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    return image[:h, :w].reshape(h // 2, 2, w // 2, 2, 3).mean((1, 3)).astype(np.uint8)


def _film(out: Path, frames: list[np.ndarray]) -> Path:
    path = out / "preview.mp4"
    try:
        import cv2
    except ImportError:
        return _gif(out / "preview.gif", frames)
    height, width = frames[0].shape[:2]
    temporary = out / ".preview.tmp.mp4"
    writer = cv2.VideoWriter(str(temporary), cv2.VideoWriter_fourcc(*"mp4v"), _FILM_HZ, (width, height))
    if not writer.isOpened():
        return _gif(out / "preview.gif", frames)
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    temporary.replace(path)
    return path


def _gif(path: Path, frames: list[np.ndarray]) -> Path:
    from PIL import Image

    images = [Image.fromarray(frame).quantize(64) for frame in frames]
    atomic_write(
        path, lambda t: images[0].save(t, save_all=True, append_images=images[1:], duration=1000 // _FILM_HZ, loop=0)
    )
    return path
