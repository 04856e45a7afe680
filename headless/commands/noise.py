"""`iclnuim noise`: adds sensor noise to a sequence; `noise calibrate` fits the noise model to a
real sensor.
"""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.sequences.frame_source import image_frames

from ..options import add_out, common
from ..sequence_input import add_camera_options, opened_with_notes
from .noise_calibration import ABOUT, calibrate
from .sequence_output import SequenceOutput, add_output_options, write_reported


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
    parser.description = f"{parser.description}.{ABOUT}"


def run(args: Namespace, console: Console) -> None:
    if args.source == "calibrate":
        calibrate(args, console)
        return
    no_images = args.depth_noise == args.rgb_noise == "none" and args.rgb_settings in (None, "{}")
    if no_images and args.imu in (None, "none"):
        raise InputError("a noise model: --depth-noise, --rgb-noise or --imu", found="none of them")
    sequence = opened_with_notes(args, Path(args.source), console)
    source = image_frames(sequence, args.frames)
    write_reported(source, SequenceOutput.of(args), args, console)
