"""`iclnuim dataset`: the EXR frames of a run to a sequence, clean or with a sensor's noise, in any format."""

import argparse
from pathlib import Path

from iclnuim.dataset.bags_and_logs import write_klg, write_rosbag
from iclnuim.dataset.frames import FrameSource, run_frames
from iclnuim.dataset.sequence import SequenceWriter
from iclnuim.errors import InputError

from ..console import Console
from ..options import common, renamed
from ..sequence_options import add_sensor_options, sequence_options


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("raw", type=Path, metavar="RAW", help="folder of a run, as `iclnuim render` makes it")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the sequence")
    parser.add_argument("--frames", default="::", metavar="A:B:S", help="as a Python slice (B excluded); default: all")
    add_output_options(parser)
    common(parser, "iclnuim dataset out/living_room/kt2/raw noisy --depth-noise released --rgb-noise released")


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """The noise, and in which formats a sequence is written: shared with `iclnuim noise`."""
    add_sensor_options(parser, "none", ("seed", "depth_units", "formats"))
    renamed(parser, "--dialect", "--format", append=True)
    bags, klg = "OUT.bag (ROS 1) and OUT_ros2 (needs rosbags), and OUT.klg", "OUT.klg, the log of ElasticFusion"
    parser.add_argument("--rosbag", action="store_true", help=f"also {bags}")
    parser.add_argument("--klg", action="store_true", help=f"also {klg}, and its camera OUT.cal")
    parser.add_argument("--workers", type=int, metavar="N", help="processes that make images; default: one a core")


def run(args: argparse.Namespace, console: Console) -> None:
    write(run_frames(args.raw, args.frames), args, console)


def write(source: FrameSource, args: argparse.Namespace, console: Console) -> None:
    """Write the sequence args.out, reporting progress: shared with `iclnuim noise`."""
    options = sequence_options(args)
    formats = options.formats
    if (args.klg or args.rosbag) and formats[0] not in ("tum", "icl-nuim"):
        raise InputError("the format tum or icl-nuim first, to make bags and logs of", found=", ".join(formats))
    writer = SequenceWriter(source, {args.out: options.sequence_settings()}, formats)
    console.note(f"{args.out}: {len(writer.missing)} of {len(source.numbers)} frames to write")
    progress = console.progress(len(writer.missing), "dataset")
    written = writer.write(args.workers, lambda number: progress.advance())[0]
    folders = [str(path) for path in (*written.folders, *_logs(written.folders[0], args, console))]
    values = {"folders": folders, "made": written.made, "found": written.found, "invalid_depth": written.invalid_depth}
    text = f"{', '.join(folders)}: {written.made} frames made, {written.found} found finished"
    lost = {kind: count for kind, count in written.invalid_depth.items() if count and kind != "background"}
    if lost:
        kinds = ", ".join(f"{count} {kind.replace('_', ' ')}" for kind, count in lost.items())
        text += f"\ndepths that became 0 (no measurement): {kinds}"
    console.result(values, text)


def _logs(folder: Path, args: argparse.Namespace, console: Console) -> list[Path]:
    """Bags and logs beside the sequence, made of its images. Those that are there stay."""
    beside = args.out.resolve()
    klg, ros1, ros2 = (beside.with_name(beside.name + end) for end in (".klg", ".bag", "_ros2"))
    wanted = [klg, ros1, ros2] if args.rosbag else [klg] if args.klg else []
    for path in wanted:
        there = path.exists()
        console.note(f"{path} exists already and stays as it is" if there else f"{path} is written")
        if not there and path == klg:
            write_klg(folder, klg)
        elif not there:
            write_rosbag(folder, path, 1 if path == ros1 else 2)
    return wanted
