"""Previews of a sequence: colour and depth of some frames as an image, with the difference to depth
of another frame where the sequence has poses, and a short film.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..console import Meter, advance_of
from ..errors import InputError
from ..formats.files import atomic_write, make_folder
from ..formats.libraries import first_library
from ..formats.png import write_png
from ..geometry.carried_depth import carried_residual
from ..geometry.trajectory import Trajectory, sample
from ..sequences.camera_files import SequenceCamera
from ..sequences.frames import ImagePair
from ..sequences.stored_sequence import StoredSequence, opened, read_depth_m, read_images
from ..shown import depth_colours, depth_range, ramp

_ROWS = 6
_FILM_FRAMES = 300
_WEB_FRAMES = 150
_FILM_HZ = 15
_ERROR_FULL_M = 0.05
#: The error is relative to a frame this number of frames away: half a second.
_APART = 15


def draw_preview(folder: StoredSequence | Path, out: Path, progress: Meter = None) -> list[Path]:
    """Write preview.png and preview.mp4 to `out`; returns their paths.

    progress: as of render_frames().
    """
    first_library("the film of a preview", "cv2")  # before work that may take long
    sequence = opened(folder)
    pairs = sequence.pairs
    camera = sequence.camera
    spread = sorted({int(i) for i in np.linspace(0, len(pairs) - 1, _ROWS)})
    # the depth range of the colour map is the same for all frames
    range_m = depth_range(np.concatenate([_metres(pairs[i], camera).ravel() for i in spread]))
    rows = [_tiles(pairs[i], camera, range_m) for i in spread]
    truth = sequence.truth
    if truth is not None:
        errors = _error_tiles(truth, pairs, spread, camera)
        rows = [np.hstack(tiles) for tiles in zip(rows, errors, strict=True)]
    make_folder(out)
    picture = np.vstack([_captions(2 if truth is None else 3, rows[0].shape[1], range_m), *rows])
    write_png(out / "preview.png", np.ascontiguousarray(picture))
    filmed = pairs[:: max(1, -(-len(pairs) // _FILM_FRAMES))]
    advance = advance_of(progress, len(filmed), "film")
    frames = []
    for pair in filmed:
        frames.append(_tiles(pair, camera, range_m))
        advance()
    atomic_write(out / "preview.mp4", lambda temporary: _write_film(temporary, frames))
    return [out / "preview.png", out / "preview.mp4"]


def _captions(columns: int, width: int, range_m: tuple[float, float]) -> np.ndarray:
    """Captions of two or three columns; that of depth has a bar of its colours."""
    figure = Figure(figsize=(width / 100, 0.28), dpi=100, facecolor="black")
    canvas = FigureCanvasAgg(figure)
    error = f"depth against a near frame, 0 to {100 * _ERROR_FULL_M:g} cm"
    near_m, far_m = range_m
    texts = (
        (0.5, "colour"),
        (1.22, f"depth  {near_m:.1f} m"),
        (1.84, f"{far_m:.1f} m"),
        (2.5, error),
    )
    size = min(11, width / columns / 28)
    style: dict[str, Any] = {"color": "white", "fontsize": size, "ha": "center", "va": "center"}
    for place, text in texts:
        if place < columns:
            figure.text(place / columns, 0.5, text, **style)
    bar = figure.add_axes((1.45 / columns, 0.25, 0.27 / columns, 0.5))
    bar.imshow(ramp(np.linspace(0, 1, 256)[None]), aspect="auto")
    bar.axis("off")
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :width, :3]


def _metres(pair: ImagePair, camera: SequenceCamera) -> np.ndarray:
    depth = read_depth_m(pair.depth, camera.depth_units_per_metre)
    if depth.shape != (camera.pinhole.height, camera.pinhole.width):
        raise InputError("depth images of the camera's size", path=pair.depth, found=depth.shape)
    return depth


def _tiles(pair: ImagePair, camera: SequenceCamera, range_m: tuple[float, float]) -> np.ndarray:
    """Colour image, and depth by colour."""
    rgb, depth_z_m = read_images(pair, camera)
    return np.hstack([_halved(rgb), _halved(depth_colours(depth_z_m, *range_m))])


def _error_tiles(
    truth: Trajectory, pairs: list[ImagePair], chosen: list[int], camera: SequenceCamera
) -> list[np.ndarray]:
    """Difference to the depth of a frame half a second away, reprojected to this frame; grey where
    it is unknown.
    """
    tiles = []
    for i in chosen:
        tile = np.full((camera.pinhole.height, camera.pinhole.width, 3), 40, np.uint8)
        j = i - _APART
        if j < 0:
            j = min(i + _APART, len(pairs) - 1)
        stamps_s = np.array([pairs[i].stamp_s, pairs[j].stamp_s])
        if truth.stamps_s[0] <= stamps_s.min() < stamps_s.max() <= truth.stamps_s[-1]:
            poses = sample(truth, stamps_s)
            current = _metres(pairs[i], camera)
            other = _metres(pairs[j], camera)
            T_other_current = poses[1].inverse() @ poses[0]
            residual = carried_residual(current, other, T_other_current, camera.pinhole)
            shown = np.isfinite(residual)
            tile[shown] = _colours(np.abs(residual[shown]) / _ERROR_FULL_M, "inferno")
        tiles.append(_halved(tile))
    return tiles


def _colours(share: np.ndarray, name: str) -> np.ndarray:
    """Shares 0..1 as one of 256 colours of a matplotlib colour map."""
    numbers = np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8)
    return colormaps[name](numbers, bytes=True)[..., :3]


def _halved(image: np.ndarray) -> np.ndarray:
    """2 x 2 means, so that an image of three tiles is small."""
    h, w = image.shape[:2]
    even = image[: h // 2 * 2, : w // 2 * 2]
    return even.reshape(h // 2, 2, w // 2, 2, 3).mean((1, 3)).astype(np.uint8)


def write_web_film(folder: Path, path: Path, first: int | None = None) -> None:
    """Write a WebM film of colour and depth for web pages, at a quarter of the width and height,
    with at most 150 frames of a sequence or of its `first` ones.
    """
    sequence = StoredSequence(folder)
    camera = sequence.camera
    pairs = sequence.pairs[:first]
    pairs = pairs[:: -(-len(pairs) // _WEB_FRAMES)]
    range_m = depth_range(_metres(pairs[len(pairs) // 2], camera))
    frames = [_halved(_tiles(pair, camera, range_m)) for pair in pairs]
    atomic_write(path, lambda temporary: _write_film(temporary, frames, "VP80"))


def _write_film(path: Path, frames: list[np.ndarray], code: str = "mp4v") -> None:
    _, cv2 = first_library("a film", "cv2")
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), _FILM_HZ, (width, height))
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    if cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) != len(frames):
        # OpenCV does not report it
        raise OSError("the film is incomplete; the disk may be full, or OpenCV has no encoder")
