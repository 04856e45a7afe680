"""`iclnuim noise`: adds sensor noise to a sequence; `noise calibrate` fits the noise model to a
real sensor.
"""

import json
from argparse import ArgumentParser, Namespace
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
from iclnuim.sensor.calibration import (
    DepthCalibration,
    RgbCalibration,
    calibrate_depth,
    calibrate_rgb,
)
from iclnuim.sequences.camera_files import camera_file
from iclnuim.sequences.frame_source import image_frames

from ..options import add_out, common
from ..sequence_input import add_camera_options, opened_with_notes, units_from
from .sequence_output import SequenceOutput, add_output_options, write_reported

EXPOSURES = "exposures.txt"
_ABOUT = """
`iclnuim noise calibrate DIR` instead fits the noise models `paper` to a real sensor. DIR contains
exposures.txt (lines `exposure image.png`, two or more images of each exposure of a static scene),
and depth/*.png of a static wall, or wall1/*.png, wall2/*.png ... of walls of different slope.
"""


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = "sequence with rgb/ and depth/ as PNG, with lists or without; or `calibrate`"
    add("source", metavar="DIR", help=help)
    help = "output folder of the noisy sequence; or the recordings to calibrate from"
    add_out(parser, help)
    help = "as a Python slice over the pairs; default: all"
    add("--frames", default="::", metavar="A:B:S", help=help)
    add_camera_options(parser)
    add_output_options(parser)
    example = "iclnuim noise traj3_frei_png noisy --depth-noise paper --rgb-noise paper --seed 1"
    common(parser, example)
    parser.description = f"{parser.description}.{_ABOUT}"


def run(args: Namespace, console: Console) -> None:
    if args.source == "calibrate":
        _calibrate(args, console)
        return
    if args.depth_noise == args.rgb_noise == "none" and args.rgb_settings in (None, "{}"):
        raise InputError("a noise model: --depth-noise or --rgb-noise", found="neither")
    sequence = opened_with_notes(args, Path(args.source), console)
    source = image_frames(sequence, args.frames)
    write_reported(source, SequenceOutput.of(args), args, console)


def _calibrate(args: Namespace, console: Console) -> None:
    folder = args.out
    rgb = depth = None
    if (folder / EXPOSURES).is_file():
        rgb = _calibrate_rgb(folder / EXPOSURES)
    walls = [
        wall for wall in (folder / "depth", *files_in(folder, "wall*")) if files_in(wall, "*.png")
    ]
    if walls:
        own = camera_file(folder) if args.units is None else None
        depth = _calibrate_depth(walls, own.depth_units_per_metre if own else units_from(args))
    if rgb is None and depth is None:
        expected = f"{EXPOSURES}, depth/*.png or wall*/*.png"
        raise InputError(expected, path=folder, found="none of them")
    values: dict[str, Any] = {}
    lines = []
    if rgb is not None:
        values["rgb"] = asdict(rgb)
        lines += _rgb_lines(rgb)
    if depth is not None:
        values["depth"] = asdict(depth)
        lines += _depth_lines(depth)
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


def _calibrate_rgb(file: Path) -> RgbCalibration:
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


def _calibrate_depth(walls: list[Path], units_per_metre: float) -> DepthCalibration:
    stacks = []
    for wall in walls:
        frames = [read_depth16(path) for path in files_in(wall, "*.png")]
        if len({frame.shape for frame in frames}) != 1:
            raise InputError("depth images of one size", path=wall, found="several")
        stacks.append(metres_from_depth16(np.stack(frames), units_per_metre))
    return calibrate_depth(stacks, sigma_s_px=0.5)
