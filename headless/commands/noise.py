"""`iclnuim noise`: a sensor's noise on a sequence that somebody has; `noise calibrate` fits it to a real sensor."""

import argparse
import json
from pathlib import Path

from iclnuim.dataset.depth_units import UNITS_PER_METRE, check_units
from iclnuim.dataset.frames import image_frames
from iclnuim.errors import InputError

from ..console import Console
from ..options import common
from ..sequence_options import add_camera_options, camera_from
from . import dataset

_ABOUT = """
`iclnuim noise calibrate DIR` instead fits the noise models `paper` to a real sensor. DIR holds exposures.txt (lines
`exposure image.png`, two or more images of each exposure of a static scene), and depth/*.png of a static wall, or
wall1/*.png, wall2/*.png ... of walls of different slope.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source", metavar="DIR", help="sequence with rgb/ and depth/ as PNG, with lists or without; or `calibrate`"
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the noisy sequence; or what to calibrate from")
    parser.add_argument(
        "--frames", default="::", metavar="A:B:S", help="as a Python slice over the pairs; default: all"
    )
    add_camera_options(parser)
    dataset.add_output_options(parser)
    common(parser, "iclnuim noise traj3_frei_png noisy --depth-noise paper --rgb-noise paper --seed 1")
    parser.description = f"{parser.description}.{_ABOUT}"


def run(args: argparse.Namespace, console: Console) -> int:
    if args.source == "calibrate":
        return _calibrate(args, console)
    if args.depth_noise == args.rgb_noise == "none" and args.rgb_settings in (None, "{}"):
        raise InputError("a noise: --depth-noise, --rgb-noise", found="neither")
    source = image_frames(Path(args.source), args.frames, camera_from(args))
    dataset.write(source, args, console)
    return 0


def _calibrate(args: argparse.Namespace, console: Console) -> int:
    from dataclasses import asdict

    from iclnuim.dataset.calibrating import calibrate_folder

    rgb, depth = calibrate_folder(args.out, check_units(args.units or UNITS_PER_METRE))
    values, lines = {}, []
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
    return 0
