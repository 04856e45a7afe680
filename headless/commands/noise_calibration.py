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
ABOUT = """
`iclnuim noise calibrate DIR` instead fits noise models to a real sensor: `paper`, and, if --camera
or camera.json gives the camera, `d435`, `azure_kinect` and `phone`, of which it says which one
resembles the sensor. DIR contains exposures.txt (lines `exposure image.png`, two or more images of
each exposure of a static scene), and depth/*.png of a static flat wall, or wall1/*.png, wall2/*.png
... of walls of different slope, distance and brightness; walls.txt (lines `wall1 0.95`) has the
diffuse reflectance of walls that are not white.
"""


def calibrate(args: Namespace, console: Console) -> None:
    folder = args.out
    values: dict[str, Any] = {}
    lines: list[str] = []
    if (folder / EXPOSURES).is_file():
        rgb = _rgb(folder / EXPOSURES)
        values["rgb"] = asdict(rgb)
        lines += _rgb_lines(rgb)
    walls = _walls(folder, args)
    if walls:
        camera = _camera(folder, args)
        fits = [] if camera is None else fit_cameras(_recordings(folder, walls, camera))
        try:
            depth = calibrate_depth(list(walls.values()))
            values["depth"] = asdict(depth)
            lines += _depth_lines(depth)
        except InputError:
            if not fits or fits[0].misfit > LIKE:
                raise
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


def _walls(folder: Path, args: Namespace) -> dict[str, np.ndarray]:
    """Name of a wall -> frames (n, h, w) in metres."""
    own = camera_file(folder)
    units = own.depth_units_per_metre if own and args.units is None else units_from(args)
    walls = {}
    for wall in (folder / "depth", *files_in(folder, "wall*")):
        frames = [read_depth16(path) for path in files_in(wall, "*.png")]
        if len({frame.shape for frame in frames}) > 1:
            raise InputError("depth images of one size", path=wall, found="several")
        if frames:
            walls[wall.name] = metres_from_depth16(np.stack(frames), units)
    return walls


def _camera(folder: Path, args: Namespace) -> PinholeCamera | None:
    if args.camera:
        return PinholeCamera.parse(args.camera)
    own = camera_file(folder)
    return own.pinhole if own else None


def _recordings(
    folder: Path, walls: dict[str, np.ndarray], camera: PinholeCamera
) -> list[WallRecording]:
    """Raises InputError for images of another size than the camera's, and for wrong reflectances."""
    albedos = dict.fromkeys(walls, WHITE_ALBEDO)
    if (folder / ALBEDOS).is_file():
        albedos |= _albedos(folder / ALBEDOS, walls)
    size = (camera.height, camera.width)
    for name, frames in walls.items():
        if frames.shape[1:] != size:
            expected = f"images of the camera's size {camera.width}x{camera.height}"
            raise InputError(expected, path=folder / name, found=frames.shape[:0:-1])
    return [WallRecording(frames, camera, albedos[name]) for name, frames in walls.items()]


def _albedos(file: Path, walls: dict[str, np.ndarray]) -> dict[str, float]:
    found = {}
    for number, line in data_lines(read_text(file)):
        name, _, text = line.partition(" ")
        try:
            albedo = float(text)
        except ValueError:
            albedo = 0.0
        if name not in walls or not 0 < albedo <= 1:
            expected = "lines `wall1 0.95`: a folder of images, and its reflectance of 0..1"
            raise InputError(expected, path=file, line=number, found=line)
        found[name] = albedo
    return found


def _camera_lines(fits: list[CameraFit]) -> list[str]:
    best = fits[0]
    like = ", ".join(f"{fit.model} {fit.misfit:.2g}" for fit in fits)
    lines = [f"misfit of noise, correlation and missing pixels (0: as recorded): {like}"]
    if best.misfit > LIKE:
        return [*lines, "no model resembles this sensor; nearest:", _option(best)]
    lines.append(_option(best))
    if best.not_determined:
        lines.append(f"not determined by these walls: {', '.join(best.not_determined)}")
    return lines


def _option(fit: CameraFit) -> str:
    settings = {name: float(f"{value:.5g}") for name, value in fit.settings.items()}
    return f"--depth-noise {fit.model} --depth-settings '{json.dumps(settings)}'"
