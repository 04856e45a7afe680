"""`iclnuim noise`: a sensor's noise on a sequence that somebody has; `noise calibrate` fits it to a real sensor."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim.dataset.depth_units import UNITS_PER_METRE, check_units, metres_from_depth16
from iclnuim.dataset.frames import image_frames
from iclnuim.errors import InputError
from iclnuim.formats.files import data_lines, read_text
from iclnuim.formats.png import read_depth16, read_rgb8
from iclnuim.sensor.calibration import DepthCalibration, RgbCalibration, calibrate_depth, calibrate_rgb

from ..console import Console
from ..options import common
from ..sequence_options import add_camera_options, camera_from
from . import dataset

EXPOSURES = "exposures.txt"
_ABOUT = """
`iclnuim noise calibrate DIR` instead fits the noise models `paper` to a real sensor. DIR holds exposures.txt (lines
`exposure image.png`, two or more images of each exposure of a static scene), and depth/*.png of a static wall, or
wall1/*.png, wall2/*.png ... of walls of different slope.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    text = "sequence with rgb/ and depth/ as PNG, with lists or without; or `calibrate`"
    parser.add_argument("source", metavar="DIR", help=text)
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the noisy sequence; or what to calibrate from")
    text = "as a Python slice over the pairs; default: all"
    parser.add_argument("--frames", default="::", metavar="A:B:S", help=text)
    add_camera_options(parser)
    dataset.add_output_options(parser)
    common(parser, "iclnuim noise traj3_frei_png noisy --depth-noise paper --rgb-noise paper --seed 1")
    parser.description = f"{parser.description}.{_ABOUT}"


def run(args: argparse.Namespace, console: Console) -> None:
    if args.source == "calibrate":
        _calibrate(args, console)
        return
    if args.depth_noise == args.rgb_noise == "none" and args.rgb_settings in (None, "{}"):
        raise InputError("a noise: --depth-noise, --rgb-noise", found="neither")
    source = image_frames(Path(args.source), args.frames, camera_from(args))
    dataset.write(source, args, console)


def _calibrate(args: argparse.Namespace, console: Console) -> None:
    folder, units, values, lines = args.out, check_units(args.units or UNITS_PER_METRE), {}, []
    rgb = _calibrate_rgb(folder / EXPOSURES) if (folder / EXPOSURES).is_file() else None
    walls = [d for d in (folder / "depth", *sorted(folder.glob("wall*"))) if d.is_dir() and any(d.glob("*.png"))]
    depth = _calibrate_depth(walls, units) if walls else None
    if rgb is None and depth is None:
        raise InputError(f"{EXPOSURES}, depth/*.png or wall*/*.png", path=folder, found="none of them")
    if rgb is not None:
        values["rgb"] = asdict(rgb)
        settings = json.dumps({"sigma_c": rgb.sigma_c, "sigma_s": rgb.sigma_s})
        spreads = ", ".join(f"{name} {spread:.2%}" for name, spread in rgb.spreads.items())
        gamma = f" {rgb.gamma:.3f}" if rgb.response == "gamma" else ""
        lines.append(f"response: {rgb.response}{gamma} (spread of the light between exposures: {spreads})")
        lines.append(f"--rgb-noise paper --rgb-settings '{settings}'")
    if depth is not None:
        values["depth"] = asdict(depth)
        settings = json.dumps({"sigma_d": depth.sigma_d, "sigma_s_px": depth.sigma_s_px})
        assumed = "; sigma_s_px assumed, as the walls are of one slope" if depth.fixed_sigma_s else ""
        lines.append(f"depth from {depth.frames} frames{assumed}")
        lines.append(f"--depth-noise paper --depth-settings '{settings}'")
    console.result(values, "\n".join(lines))


def _calibrate_rgb(file: Path) -> RgbCalibration:
    images: dict[float, list[np.ndarray]] = {}
    for number, line in data_lines(read_text(file)):
        fields = line.split()
        try:
            exposure, path = float(fields[0]), file.parent / fields[1]
        except (ValueError, IndexError):
            raise InputError("lines `exposure image.png`", path=file, line=number, found=line) from None
        images.setdefault(exposure, []).append(read_rgb8(path))
    shapes = {image.shape for stack in images.values() for image in stack}
    if len(shapes) != 1:
        raise InputError("images of one size", path=file, found=sorted(shapes))
    return calibrate_rgb(list(images), [np.stack(stack) for stack in images.values()])


def _calibrate_depth(walls: list[Path], units_per_metre: float) -> DepthCalibration:
    stacks = []
    for wall in walls:
        frames = [read_depth16(path) for path in sorted(wall.glob("*.png"))]
        if len({frame.shape for frame in frames}) != 1:
            raise InputError("depth images of one size", path=wall, found="several")
        stacks.append(metres_from_depth16(np.stack(frames), units_per_metre))
    return calibrate_depth(stacks, sigma_s_px=0.5)
