"""`iclnuim inspect`: reports problems of a sequence, and draws it."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

from iclnuim.console import Console
from iclnuim.labels.coco import write_coco
from iclnuim.labels.frames import has_classes
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.metadata import write_metadata
from iclnuim.sequences.stored_sequence import StoredSequence

from ..options import add_rerun, checked_rerun, common, option_name
from ..sequence_input import add_allow_outside

#: Figure -> its label and unit.
_LABELS = {
    "rate_hz": ("frames per second", ""),
    "duration_s": ("duration", " s"),
    "imu": ("IMU", ""),
    "depth_m": ("depth in metres", ""),
    "depth_missing_share": ("share of pixels without depth", ""),
    "length_m": ("length of the trajectory", " m"),
    "max_speed_m_s": ("maximum speed", " m/s"),
    "depth_fits_poses_mm": ("difference of depth reprojected with the poses", " mm"),
    "depth_fits_poses_percent": ("difference of depth relative to depth", " %"),
}


def configure(parser: ArgumentParser) -> None:
    help = "a sequence in any supported format"
    parser.add_argument("folder", type=Path, metavar="DIR", help=help)
    help = (
        "write preview.png (colour, depth, error) and preview.mp4 into FOLDER, and classes.png "
        "with their names if the sequence has classes"
    )
    parser.add_argument("--preview", type=Path, metavar="FOLDER", help=help)
    help = "write its classes and instances as annotations of COCO (.json)"
    parser.add_argument("--coco", type=Path, metavar="FILE", help=help)
    help = "write metadata.jsonl into DIR, for the imagefolder of Hugging Face datasets"
    parser.add_argument("--metadata", action="store_true", help=help)
    add_allow_outside(parser)
    add_rerun(parser, "its images, camera and poses")
    example = "iclnuim inspect out/living_room/kt2/noisy --preview pictures"
    common(parser, example).set_defaults(reads_sequences=True)


def run(args: Namespace, console: Console) -> int:
    """Exit code 2 if errors were found, 0 if there are at most warnings."""
    recording = checked_rerun(args)
    sequence = StoredSequence(args.folder, args.allow_outside)
    found = inspect_sequence(sequence, option_name)
    lines = [_figure_line(name, value) for name, value in found.figures.items()]
    lines += [f"ERROR: {sentence}" for sentence in found.errors]
    lines += [f"warning: {sentence}" for sentence in found.warnings]
    if not found.errors:
        lines.append("no errors found")
    console.result(found.to_dict(), "\n".join(lines))
    if args.preview is not None:
        from iclnuim.report.preview import draw_preview

        for path in draw_preview(sequence, args.preview, console.progress):
            console.note(f"{path} written")
        if has_classes(sequence):
            from iclnuim.labels.pictures import draw_classes

            console.note(f"{draw_classes(args.folder, args.preview)} written")
    if args.coco is not None:
        write_coco(args.coco, args.folder, console.progress)
        console.note(f"{args.coco} written")
    if args.metadata:
        console.note(f"{write_metadata(args.folder)} written")
    if recording:
        from iclnuim.report.recording import record_sequence

        record_sequence(recording, sequence, console.progress)
        console.note(f"{recording} written")
    return 2 if found.errors else 0


def _figure_line(name: str, value: Any) -> str:
    label, unit = _LABELS.get(name, (name.replace("_", " "), ""))
    if isinstance(value, dict):
        parts = []
        for key, one in value.items():
            parts.append(f"{key} {one:.6g}" if isinstance(one, float) else f"{key} {one}")
        value = ", ".join(parts)
    return f"{label}: {value}{unit}"
