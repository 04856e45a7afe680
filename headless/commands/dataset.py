"""`iclnuim dataset`: the EXR frames of a run to a sequence, clean or with a sensor's noise, in any dialect."""

from __future__ import annotations

import argparse
from pathlib import Path

from iclnuim.dataset.dialects import DIALECTS
from iclnuim.dataset.frames import FrameSource, run_frames
from iclnuim.dataset.klg import write_klg
from iclnuim.dataset.rosbag import write_rosbag
from iclnuim.dataset.sequence import SequenceSettings, SequenceWriter, WrittenSequence
from iclnuim.errors import InputError

from ..console import Console
from ..options import common
from ..sensor_options import add_sensor_options, sensor_from


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("raw", type=Path, metavar="RAW", help="folder of a run, as `iclnuim render` makes it")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the sequence")
    parser.add_argument("--frames", default="::", metavar="A:B:S", help="as a Python slice (B excluded); default: all")
    add_sensor_options(parser, "none")
    add_form_options(parser)
    common(parser, "iclnuim dataset out/living_room/kt2/raw noisy --depth-noise released --rgb-noise released")


def add_form_options(parser: argparse.ArgumentParser) -> None:
    """In which forms a sequence is written: shared with `iclnuim noise`."""
    forms = f"{', '.join(DIALECTS)}; several go into a folder each; default: tum"
    parser.add_argument("--dialect", action="append", choices=tuple(DIALECTS), metavar="FORM", help=forms)
    parser.add_argument(
        "--rosbag", action="store_true", help="also OUT.bag (ROS 1) and OUT_ros2 (needs rosbags), and OUT.klg"
    )
    parser.add_argument(
        "--klg", action="store_true", help="also OUT.klg, the log of ElasticFusion, and its camera OUT.cal"
    )
    parser.add_argument("--workers", type=int, metavar="N", help="processes that make images; default: one a core")


def run(args: argparse.Namespace, console: Console) -> int:
    write(run_frames(args.raw, args.frames), sensor_from(args), args, console)
    return 0


def write(source: FrameSource, settings: SequenceSettings, args: argparse.Namespace, console: Console) -> None:
    """Write the sequence args.out, telling of progress: shared with `iclnuim noise`."""
    dialects = args.dialect or ("tum",)
    if (args.klg or args.rosbag) and dialects[0] not in ("tum", "icl-nuim"):
        raise InputError("the dialect tum or icl-nuim first, to make bags and logs of", found=", ".join(dialects))
    writer = SequenceWriter(source, {args.out: settings}, dialects)
    console.note(f"{args.out}: {len(writer.missing)} of {len(source.numbers)} frames to write")
    progress = console.progress(len(writer.missing), "dataset")
    written = writer.write(args.workers, lambda number: progress.advance())
    logs = _logs(written[0].folders[0], args, console)
    console.result(*_report(written[0], logs))


def _logs(folder: Path, args: argparse.Namespace, console: Console) -> list[Path]:
    """Bags and logs beside the sequence, made of its images. Those that are there stay."""
    beside = args.out.resolve()
    klg, ros1, ros2 = (beside.with_name(beside.name + end) for end in (".klg", ".bag", "_ros2"))
    wanted = [(klg, write_klg, ())] * (args.klg or args.rosbag)
    wanted += [(ros1, write_rosbag, (1,)), (ros2, write_rosbag, (2,))] * args.rosbag
    missing = [(path, write, ros) for path, write, ros in wanted if not path.exists()]
    for path, _, _ in wanted:
        if path.exists():
            console.note(f"{path} is there already and stays as it is")
    for path, write, ros in missing:
        console.note(f"{path} is written")
        write(folder, path, *ros)
    return [path for path, _, _ in wanted]


def _report(written: WrittenSequence, logs: list[Path]) -> tuple[dict, str]:
    folders = [str(path) for path in (*written.folders, *logs)]
    values = {"folders": folders, "made": written.made, "found": written.found, "invalid_depth": written.invalid_depth}
    lines = [f"{', '.join(folders)}: {written.made} frames made, {written.found} found finished"]
    lost = {kind: count for kind, count in written.invalid_depth.items() if count and kind != "background"}
    if lost:
        kinds = ", ".join(f"{count} {kind.replace('_', ' ')}" for kind, count in lost.items())
        lines.append(f"depths that became 0 (no measurement): {kinds}")
    return values, "\n".join(lines)
