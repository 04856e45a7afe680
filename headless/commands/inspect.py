"""`iclnuim inspect`: what is wrong with a sequence that somebody has; `--preview` draws it."""

import argparse
from pathlib import Path

from iclnuim.dataset.inspection import inspect_sequence

from ..console import Console
from ..options import common

#: Labels of the figures, and their units.
_LABELS = {
    "rate_hz": ("frames a second", ""),
    "duration_s": ("duration", " s"),
    "depth_m": ("depth in metres", ""),
    "depth_missing_share": ("share of pixels without depth", ""),
    "length_m": ("length of the trajectory", " m"),
    "max_speed_m_s": ("fastest", " m/s"),
    "depth_fits_poses_mm": ("depth carried by the poses meets depth to", " mm"),
    "depth_fits_mirrored_poses_mm": ("by the poses mirrored in y to", " mm"),
}


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="sequence in TUM's format, or in the original's")
    text = "write preview.png (colour, depth, error) and preview.mp4 into FOLDER"
    parser.add_argument("--preview", type=Path, metavar="FOLDER", help=text)
    common(parser, "iclnuim inspect out/living_room/kt2/noisy --preview pictures")


def run(args: argparse.Namespace, console: Console) -> int:
    """Exit code 2 where something is wrong, 0 where things are at most odd."""
    found = inspect_sequence(args.folder)
    values = {"folder": str(found.folder), "figures": found.figures, "wrong": found.wrong, "odd": found.odd}
    lines = []
    for name, value in found.figures.items():
        label, unit = _LABELS.get(name, (name.replace("_", " "), ""))
        if isinstance(value, dict):
            value = ", ".join(f"{key} {f'{v:.6g}' if isinstance(v, float) else v}" for key, v in value.items())
        lines.append(f"{label}: {value}{unit}")
    lines += [f"WRONG: {sentence}" for sentence in found.wrong] + [f"odd: {sentence}" for sentence in found.odd]
    console.result(values, "\n".join(lines + ([] if found.wrong else ["nothing wrong found"])))
    if args.preview is not None:
        from iclnuim.report.preview import draw_preview

        for path in draw_preview(args.folder, args.preview, console.progress):
            console.note(f"{path} written")
    return 2 if found.wrong else 0
