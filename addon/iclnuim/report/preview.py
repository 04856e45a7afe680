"""Pictures of a sequence: a sheet of colour, depth and error of some frames, and a short film."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..dataset.frames import ImagePair, SequenceCamera, find_pairs, read_camera, read_truth
from ..dataset.inspection import carried_residual
from ..errors import InputError
from ..formats.files import atomic_write, make_folder
from ..formats.png import read_depth16, read_rgb8, write_png
from ..geometry.trajectory import Trajectory, sample

_ROWS, _FILM_FRAMES, _FILM_HZ = 6, 300, 15
_ERROR_FULL_M = 0.05


def draw_preview(folder: Path, out: Path, progress: Callable[[int, str], Any]) -> list[Path]:
    """preview.png and preview.mp4 (without OpenCV's encoder preview.gif) in `out`; the files written.

    `progress(total, label)` returns something with advance().
    """
    pairs = find_pairs(folder)
    camera, truth = read_camera(folder, pairs[0].rgb), read_truth(folder)
    spread = [pairs[int(i)] for i in sorted({int(i) for i in np.linspace(0, len(pairs) - 1, _ROWS)})]
    seen = np.concatenate([depth[depth > 0] for depth in (_metres(pair, camera) for pair in spread)])
    # near and far end of the colours, the same for all frames
    reach_m = tuple(np.percentile(seen, (1, 99)).tolist()) if seen.size else (0.0, 1.0)
    rows = [_row(pair, pairs, camera, truth, reach_m) for pair in spread]
    make_folder(out)
    write_png(out / "preview.png", np.ascontiguousarray(np.vstack([_captions(rows[0].shape[1], reach_m), *rows])))
    step = max(1, -(-len(pairs) // _FILM_FRAMES))
    bar = progress(len(pairs[::step]), "film")
    frames = []
    for pair in pairs[::step]:
        depth = _depth_colours(_metres(pair, camera), reach_m)
        frames.append(np.hstack([_halved(read_rgb8(pair.rgb)), _halved(depth)]))
        bar.advance()
    return [out / "preview.png", _film(out, frames)]


def _captions(width: int, reach_m: tuple[float, float]) -> np.ndarray:
    """What the three columns show."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / 100, 0.28), dpi=100, facecolor="black")
    canvas = FigureCanvasAgg(figure)
    error = f"off its neighbour: black 0, yellow {100 * _ERROR_FULL_M:g} cm"
    texts = ("colour", f"depth: red {reach_m[0]:.1f} m, blue {reach_m[1]:.1f} m, black none", error)
    for k, text in enumerate(texts):
        figure.text((k + 0.5) / 3, 0.5, text, color="white", fontsize=min(9, width / 110), ha="center", va="center")
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :width, :3]


def _row(
    pair: ImagePair, pairs: list[ImagePair], camera: SequenceCamera, truth: Trajectory | None, reach_m: tuple
) -> np.ndarray:
    """Colour, depth in colour, and how far the depth of a frame half a second away, carried here, is off."""
    depth_z_m = _metres(pair, camera)
    error = _error_tile(pair, pairs, depth_z_m, camera, truth)
    return np.hstack([_halved(tile) for tile in (read_rgb8(pair.rgb), _depth_colours(depth_z_m, reach_m), error)])


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
    if other is pair or truth is None or len(truth) < 2:
        return tile
    if not truth.stamps_s[0] <= stamps.min() <= stamps.max() <= truth.stamps_s[-1]:
        return tile
    poses = sample(truth, stamps)
    residual = carried_residual(depth_z_m, _metres(other, camera), poses[1].inverse() @ poses[0], camera.pinhole)
    shown = np.isfinite(residual)
    tile[shown] = _colours(np.abs(residual[shown]) / _ERROR_FULL_M, "inferno")
    return tile


def _depth_colours(depth_z_m: np.ndarray, reach_m: tuple[float, float]) -> np.ndarray:
    """Near red, far blue, missing black."""
    near, far = reach_m
    image = _colours(1 - (depth_z_m - near) / max(far - near, 1e-6), "turbo")
    image[depth_z_m == 0] = 0
    return image


def _colours(share: np.ndarray, name: str) -> np.ndarray:
    """0..1 in 256 colours of a matplotlib map."""
    from matplotlib import colormaps

    table = (colormaps[name](np.arange(256))[:, :3] * 255).astype(np.uint8)
    return table[np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8)]


def _halved(image: np.ndarray) -> np.ndarray:
    """2 x 2 means, so that a sheet of three tiles stays small."""
    h, w = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    return image[:h, :w].reshape(h // 2, 2, w // 2, 2, 3).mean((1, 3)).astype(np.uint8)


def _film(out: Path, frames: list[np.ndarray]) -> Path:
    try:
        import cv2

        if not cv2.videoio_registry.getWriterBackends():
            raise ImportError("OpenCV has no encoder")
    except ImportError:
        return _gif(out / "preview.gif", frames)
    height, width = frames[0].shape[:2]

    def write(temporary: Path) -> None:
        writer = cv2.VideoWriter(str(temporary), cv2.VideoWriter.fourcc(*"mp4v"), _FILM_HZ, (width, height))
        for frame in frames:
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
        writer.release()
        if cv2.VideoCapture(str(temporary)).get(cv2.CAP_PROP_FRAME_COUNT) != len(frames):
            raise OSError("the film is not whole; the disk may be full")  # OpenCV does not say so

    atomic_write(out / "preview.mp4", write)
    return out / "preview.mp4"


def _gif(path: Path, frames: list[np.ndarray]) -> Path:
    from PIL import Image

    images = [Image.fromarray(frame).quantize(64) for frame in frames]
    atomic_write(
        path, lambda t: images[0].save(t, save_all=True, append_images=images[1:], duration=1000 // _FILM_HZ, loop=0)
    )
    return path
