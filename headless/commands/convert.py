"""`iclnuim convert`: writes a sequence in another format."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.channels import FURTHER
from iclnuim.console import Console
from iclnuim.formats.depth_units import UNITS_PER_METRE
from iclnuim.sequences.frame_source import FrameSource, frames_with_poses, original_frames
from iclnuim.sequences.sequence_formats import sequence_format
from iclnuim.sequences.sequence_options import SequenceOptions

from ..options import add_out, add_settings, common
from ..sequence_input import add_camera_options, opened_with_notes
from .sequence_output import SequenceOutput, add_file_options, write_reported


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("source", type=Path, metavar="DIR", help="a sequence in any supported format")
    add_out(parser, "output folder of the converted sequence")
    help = "as a Python slice over the pairs; default: all"
    add("--frames", default="::", metavar="A:B:S", help=help)
    add_camera_options(parser)
    add_settings(
        parser, SequenceOptions, ("formats", "depth_units", "names"), depth_units="those of DIR"
    )
    add_file_options(parser)
    example = "iclnuim convert traj0_frei_png replica --format replica"
    common(parser, example)


def run(args: Namespace, console: Console) -> None:
    source = original_frames(opened_with_notes(args, args.source, console), args.frames)
    own = SequenceOptions(depth_units=source.depth_units_per_metre)
    output = SequenceOutput.of(args, own)
    options = output.options
    kept = options.depth_units
    if "tum" in options.formats and args.depth_units is None and kept != UNITS_PER_METRE:
        expected = f"most readers of TUM expect {UNITS_PER_METRE:g}: --depth-units"
        console.note(f"depth keeps its {kept:g} units a metre; {expected}")
    needing = [name for name in options.formats if sequence_format(name).limits.every_pose]
    if needing:
        source = _posed(source, needing[0], console)
    folders = [*FURTHER, *(f"semantic_{kind}" for kind in FURTHER)]
    if left := [f"{name}/" for name in folders if (args.source / name).is_dir()]:
        limit = "only colour, depth and poses are converted"
        console.note(f"{', '.join(left)} of {args.source} not converted: {limit}")
    write_reported(source, output, args, console)


def _posed(source: FrameSource, format: str, console: Console) -> FrameSource:
    """The frames with a pose, for a format that needs one for each; all where none has a pose."""
    if source.truth_of(source.numbers) is None:
        return source
    posed = frames_with_poses(source)
    if left_out := sorted(set(source.numbers) - set(posed.numbers)):
        first = ", ".join(map(str, left_out[:5]))
        if len(left_out) > 5:
            first += " ..."
        count = f"{len(left_out)} of {len(source.numbers)} frames"
        console.note(f"{format}: {count} have no pose and are left out: {first}")
    return posed if posed.numbers else source
