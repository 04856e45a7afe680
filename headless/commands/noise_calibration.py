"""`iclnuim noise calibrate`: fits the noise models to recordings of a real sensor."""

import json
from argparse import Namespace
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.console import Console
from iclnuim.errors import InputError, within
from iclnuim.formats.depth_units import metres_from_depth16
from iclnuim.formats.files import data_lines, read_text
from iclnuim.formats.image_names import files_in
from iclnuim.formats.png import read_depth16, read_rgb8
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.boards import BoardRecording
from iclnuim.sensor.calibration import (
    DepthCalibration,
    RgbCalibration,
    calibrate_depth,
    calibrate_rgb,
)
from iclnuim.sensor.camera_fits import LIKE, CameraFit, fit_cameras
from iclnuim.sensor.walls import WHITE_ALBEDO, WallRecording
from iclnuim.sequences.camera_files import camera_file

from ..sequence_input import units_from

EXPOSURES = "exposures.txt"
ALBEDOS = "walls.txt"
WIDTHS = "boards.txt"
ABOUT = """
`iclnuim noise calibrate DIR` instead fits noise models to a real sensor: `paper`, and, if --camera
or camera.json gives the camera, `d435`, `azure_kinect` and `phone`, of which it says which one
resembles the sensor. DIR contains exposures.txt (lines `exposure image.png`, two or more images of
each exposure of a static scene), and depth/*.png of a static flat wall, or wall1/*.png, wall2/*.png
... of walls of different slope, distance and brightness; walls.txt (lines `wall1 0.95`) has the
diffuse reflectance of walls that are not white. board1/*.png ... of a board that faces the camera
before a wall, tilted by a few degrees, show what happens at edges; boards.txt (lines `board1 0.4`)
has their widths in metres.
"""


def calibrate(args: Namespace, console: Console) -> None:
    folder = args.out
    values: dict[str, Any] = {}
    lines: list[str] = []
    if (folder / EXPOSURES).is_file():
        rgb = _rgb(folder / EXPOSURES)
        values["rgb"] = asdict(rgb)
        lines += _rgb_lines(rgb)
    walls = _recorded(folder, ("depth", "wall*"), args)
    if walls:
        camera = _camera(folder, args)
        depth, refused = None, None
        try:
            depth = calibrate_depth(list(walls.values()))
        except InputError as error:
            refused = error
        fits = []
        if camera is not None:
            boards = _boards(folder, _recorded(folder, ("board*",), args), camera, console)
            fits = fit_cameras(_recordings(folder, walls, camera), depth, boards)
        if depth is not None:
            values["depth"] = asdict(depth)
            lines += _depth_lines(depth)
        elif refused and (not fits or fits[0].misfit > LIKE):
            raise refused
        if fits:
            values["cameras"] = [asdict(fit) for fit in fits]
            lines += _camera_lines(fits)
        else:
            hint = "--camera WxH,FX,FY,CX,CY or camera.json in the folder"
            console.note(f"d435, azure_kinect and phone are not fitted without the camera: {hint}")
    if not values:
        expected = f"{EXPOSURES}, depth/*.png or wall*/*.png"
        raise InputError(expected, path=folder, found="none of them")
    console.result(values, "\n".join(lines))


def _rgb_lines(rgb: RgbCalibration) -> list[str]:
    response = rgb.response
    if response == "gamma":
        response += f" {rgb.gamma:.3f}"
    spreads = ", ".join(f"{name} {spread:.2%}" for name, spread in rgb.spreads.items())
    settings = json.dumps({"sigma_c": rgb.sigma_c, "sigma_s": rgb.sigma_s})
    return [
        f"response: {response} (spread of the radiance between exposures: {spreads})",
        f"--rgb-noise paper --rgb-settings '{settings}'",
    ]


def _depth_lines(depth: DepthCalibration) -> list[str]:
    first = f"depth from {depth.frames} frames"
    if depth.fixed_sigma_s:
        first += "; sigma_s_px is assumed, as all walls have the same slope"
    settings = json.dumps({"sigma_d": depth.sigma_d, "sigma_s_px": depth.sigma_s_px})
    return [first, f"--depth-noise paper --depth-settings '{settings}'"]


def _rgb(file: Path) -> RgbCalibration:
    images: dict[float, list[np.ndarray]] = {}
    for number, line in data_lines(read_text(file)):
        fields = line.split()
        try:
            exposure = float(fields[0])
            path = file.parent / fields[1]
        except (ValueError, IndexError):
            expected = "lines `exposure image.png`"
            raise InputError(expected, path=file, line=number, found=line) from None
        images.setdefault(exposure, []).append(read_rgb8(path))
    shapes = {image.shape for image in chain(*images.values())}
    if len(shapes) != 1:
        raise InputError("images of one size", path=file, found=sorted(shapes))
    with within(file):
        return calibrate_rgb(list(images), [np.stack(stack) for stack in images.values()])


def _recorded(folder: Path, names: tuple[str, ...], args: Namespace) -> dict[str, np.ndarray]:
    """Name of a folder -> frames (n, h, w) in metres, of all folders with such names."""
    own = camera_file(folder)
    units = own.depth_units_per_metre if own and args.units is None else units_from(args)
    found = {}
    for place in files_in(folder, *names):
        frames = [read_depth16(path) for path in files_in(place, "*.png")]
        if len({frame.shape for frame in frames}) > 1:
            raise InputError("depth images of one size", path=place, found="several")
        if frames:
            found[place.name] = metres_from_depth16(np.stack(frames), units)
    return found


def _camera(folder: Path, args: Namespace) -> PinholeCamera | None:
    if args.camera:
        return PinholeCamera.parse(args.camera)
    own = camera_file(folder)
    return own.pinhole if own else None


def _recordings(
    folder: Path, walls: dict[str, np.ndarray], camera: PinholeCamera
) -> list[WallRecording]:
    """Raises InputError for images of another size than the camera's, and for wrong reflectances."""
    _check_size(folder, walls, camera)
    albedos = dict.fromkeys(walls, WHITE_ALBEDO)
    if (folder / ALBEDOS).is_file():
        expected = "lines `wall1 0.95`: a folder of images, and its reflectance of 0..1"
        albedos |= _numbers(folder / ALBEDOS, walls, 1.0, expected)
    return [WallRecording(frames, camera, albedos[name]) for name, frames in walls.items()]


def _boards(
    folder: Path, boards: dict[str, np.ndarray], camera: PinholeCamera, console: Console
) -> list[BoardRecording]:
    """Those whose edges can be measured; a note says why others cannot. Raises InputError for
    images of another size than the camera's, and for missing widths.
    """
    _check_size(folder, boards, camera)
    if not boards:
        return []
    expected = "lines `board1 0.4` for each board: a folder of images, and its width in metres"
    widths_m = _numbers(folder / WIDTHS, boards, np.inf, expected)
    if missing := boards.keys() - widths_m.keys():
        raise InputError(expected, path=folder / WIDTHS, found=f"none for {min(missing)}")
    found = []
    for name, frames in boards.items():
        try:
            found.append(BoardRecording(frames, camera, widths_m[name]).checked())
        except InputError as error:
            console.note(f"{name} is not used: {error}")
    return found


def _check_size(folder: Path, recorded: dict[str, np.ndarray], camera: PinholeCamera) -> None:
    for name, frames in recorded.items():
        if frames.shape[1:] != (camera.height, camera.width):
            expected = f"images of the camera's size {camera.width}x{camera.height}"
            raise InputError(expected, path=folder / name, found=frames.shape[:0:-1])


def _numbers(
    file: Path, recorded: dict[str, np.ndarray], most: float, expected: str
) -> dict[str, float]:
    """Name of a folder -> a number above 0 and up to `most`."""
    found = {}
    for number, line in data_lines(read_text(file)):
        name, _, text = line.partition(" ")
        try:
            value = float(text)
        except ValueError:
            value = 0.0
        if name not in recorded or not 0 < value <= most or value == np.inf:
            raise InputError(expected, path=file, line=number, found=line)
        found[name] = value
    return found


def _camera_lines(fits: list[CameraFit]) -> list[str]:
    best = fits[0]
    like = ", ".join(f"{fit.model} {fit.misfit:.2g}" for fit in fits)
    lines = [f"misfit of noise, correlation and missing pixels (0: as recorded): {like}"]
    if best.misfit > LIKE:
        return [*lines, "no model resembles this sensor; nearest:", _option(best)]
    lines.append(_option(best))
    if best.not_determined:
        lines.append(f"not determined by these recordings: {', '.join(best.not_determined)}")
    return lines


def _option(fit: CameraFit) -> str:
    settings = {name: float(f"{value:.5g}") for name, value in fit.settings.items()}
    return f"--depth-noise {fit.model} --depth-settings '{json.dumps(settings)}'"
