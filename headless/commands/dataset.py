"""`iclnuim dataset`: writes the EXR frames of a run as a sequence, with the noise of a sensor model."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.console import Console
from iclnuim.sequences.frame_source import run_frames

from ..options import add_out, common
from .sequence_output import SequenceOutput, add_output_options, write_reported


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("raw", type=Path, metavar="RAW", help="folder of a run, as `iclnuim render` writes it")
    add_out(parser, "output folder of the sequence")
    help = "as a Python slice (B excluded); default: all"
    add("--frames", default="::", metavar="A:B:S", help=help)
    add_output_options(parser)
    example = (
        "iclnuim dataset out/living_room/kt2/raw noisy --depth-noise released --rgb-noise released"
    )
    common(parser, example)


def run(args: Namespace, console: Console) -> None:
    write_reported(run_frames(args.raw, args.frames), SequenceOutput.of(args), args, console)
