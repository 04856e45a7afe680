"""`iclnuim dataset`, `convert`, `noise`, `inspect` and `pack`: make, convert, check and publish
RGB-D sequences.

`dataset` reads the EXR frames of a run; `convert` and `noise` read any sequence. All three write
any format; `dataset` and `noise` can add sensor noise. `noise calibrate` fits the noise model to a
real sensor. `inspect` reports problems of a sequence and draws it. `pack` writes the archive to
publish.
"""

import json
import tempfile
from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.channels import FURTHER
from iclnuim.console import Console
from iclnuim.errors import InputError, within
from iclnuim.formats.depth_units import UNITS_PER_METRE, metres_from_depth16
from iclnuim.formats.files import (
    check_file,
    data_lines,
    is_stream,
    read_bytes,
    read_text,
    real_path,
    sha256,
)
from iclnuim.formats.image_names import files_in
from iclnuim.formats.png import read_depth16, read_rgb8
from iclnuim.labels.coco import write_coco
from iclnuim.labels.frames import has_classes
from iclnuim.sensor.calibration import (
    DepthCalibration,
    RgbCalibration,
    calibrate_depth,
    calibrate_rgb,
)
from iclnuim.sequences.bags.recorded import LogSettings
from iclnuim.sequences.frame_source import FrameSource, frames_with_poses
from iclnuim.sequences.image_frames import image_frames, original_frames
from iclnuim.sequences.inspection.inspect import inspect_sequence
from iclnuim.sequences.layout import camera_file
from iclnuim.sequences.metadata import write_metadata
from iclnuim.sequences.packing import LICENCES, is_archive, pack, packed_licence, packed_names
from iclnuim.sequences.rendered_frames import run_frames
from iclnuim.sequences.sequence import SequenceWriter
from iclnuim.sequences.sequence_formats import sequence_format
from iclnuim.sequences.sequence_options import SequenceOptions

from ..options import add_out, add_rerun, add_settings, checked_rerun, common, count, settings_from
from ..outputs import refuse_existing
from ..sequence_options import (
    add_camera_options,
    add_sensor_options,
    check_format_units,
    given_or_noted_camera,
    log_settings,
    sequence_options,
    units_from,
)

EXPOSURES = "exposures.txt"
#: Endings of the archive that `pack` writes.
_ARCHIVES = (".tar.gz", ".tgz")
_ABOUT = """
`iclnuim noise calibrate DIR` instead fits the noise models `paper` to a real sensor. DIR contains
exposures.txt (lines `exposure image.png`, two or more images of each exposure of a static scene),
and depth/*.png of a static wall, or wall1/*.png, wall2/*.png ... of walls of different slope.
"""
#: Figure -> its label and unit.
_LABELS = {
    "rate_hz": ("frames per second", ""),
    "duration_s": ("duration", " s"),
    "depth_m": ("depth in metres", ""),
    "depth_missing_share": ("share of pixels without depth", ""),
    "length_m": ("length of the trajectory", " m"),
    "max_speed_m_s": ("maximum speed", " m/s"),
    "depth_fits_poses_mm": ("difference of depth reprojected with the poses", " mm"),
    "depth_fits_poses_percent": ("difference of depth relative to depth", " %"),
}


def configure_dataset(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("raw", type=Path, metavar="RAW", help="folder of a run, as `iclnuim render` writes it")
    add_out(parser, "output folder of the sequence")
    help = "as a Python slice (B excluded); default: all"
    add("--frames", default="::", metavar="A:B:S", help=help)
    _add_output_options(parser)
    example = (
        "iclnuim dataset out/living_room/kt2/raw noisy --depth-noise released --rgb-noise released"
    )
    common(parser, example).set_defaults(run=_dataset)


def _add_output_options(parser: ArgumentParser) -> None:
    """Add the options for noise and for the formats in which a sequence is written."""
    add_sensor_options(parser, "none", ("seed", "depth_units", "formats", "names"))
    _add_file_options(parser)


def _add_file_options(parser: ArgumentParser) -> None:
    add_settings(parser, LogSettings)
    help = "number of processes that write images; default: one per core"
    parser.add_argument("--workers", type=count, metavar="N", help=help)


def _dataset(args: Namespace, console: Console) -> None:
    _write(run_frames(args.raw, args.frames), sequence_options(args), args, console)


def _write(
    source: FrameSource, options: SequenceOptions, args: Namespace, console: Console
) -> None:
    """Write the sequence args.out, reporting progress."""
    logs = log_settings(args)
    for number in source.numbers[:1]:
        source.load(number)  # images of another size are refused before anything is written
    writer = SequenceWriter(source, {args.out: options.sequence_settings()}, options.formats)
    for sentence in writer.losses():
        console.note(sentence)
    console.note(f"{args.out}: {len(writer.missing)} of {len(source.numbers)} frames to write")
    progress = console.progress(len(writer.missing), "dataset")
    written = writer.write(args.workers, lambda number: progress.advance())[0]
    paths = [*written.folders, *logs.write(written.folders[0], args.out, console.note)]
    folders = [str(path) for path in paths]
    values = {
        "folders": folders,
        "made": written.made,
        "found": written.found,
        "invalid_depth": written.invalid_depth,
    }
    text = f"{', '.join(folders)}: {written.made} frames written, {written.found} already finished"
    lost = []
    for kind, pixels in written.invalid_depth.items():
        if pixels and kind != "background":
            lost.append(f"{pixels} {kind.replace('_', ' ')}")
    if lost:
        text += f"\ndepth values set to 0 (no measurement): {', '.join(lost)}"
    console.result(values, text)


def configure_convert(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("source", type=Path, metavar="DIR", help="a sequence in any supported format")
    add_out(parser, "output folder of the converted sequence")
    help = "as a Python slice over the pairs; default: all"
    add("--frames", default="::", metavar="A:B:S", help=help)
    add_camera_options(parser)
    add_settings(
        parser, SequenceOptions, ("formats", "depth_units", "names"), depth_units="those of DIR"
    )
    _add_file_options(parser)
    example = "iclnuim convert traj0_frei_png replica --format replica"
    common(parser, example).set_defaults(run=_convert)


def _convert(args: Namespace, console: Console) -> None:
    camera = given_or_noted_camera(args, console, args.source)
    source = original_frames(args.source, args.frames, camera)
    options = settings_from(args, SequenceOptions(depth_units=source.depth_units_per_metre))
    check_format_units(args, options)
    kept = options.depth_units
    if "tum" in options.formats and args.depth_units is None and kept != UNITS_PER_METRE:
        expected = f"most readers of TUM expect {UNITS_PER_METRE:g}: --depth-units"
        console.note(f"depth keeps its {kept:g} units a metre; {expected}")
    needing = [name for name in options.formats if sequence_format(name).every_pose]
    if needing:
        source = _posed(source, needing[0], console)
    folders = [*FURTHER, *(f"semantic_{kind}" for kind in FURTHER)]
    if left := [f"{name}/" for name in folders if (args.source / name).is_dir()]:
        limit = "only colour, depth and poses are converted"
        console.note(f"{', '.join(left)} of {args.source} not converted: {limit}")
    _write(source, options, args, console)


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


def configure_noise(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = "sequence with rgb/ and depth/ as PNG, with lists or without; or `calibrate`"
    add("source", metavar="DIR", help=help)
    help = "output folder of the noisy sequence; or the recordings to calibrate from"
    add_out(parser, help)
    help = "as a Python slice over the pairs; default: all"
    add("--frames", default="::", metavar="A:B:S", help=help)
    add_camera_options(parser)
    _add_output_options(parser)
    example = "iclnuim noise traj3_frei_png noisy --depth-noise paper --rgb-noise paper --seed 1"
    common(parser, example).set_defaults(run=_noise)
    parser.description = f"{parser.description}.{_ABOUT}"


def _noise(args: Namespace, console: Console) -> None:
    if args.source == "calibrate":
        _calibrate(args, console)
        return
    if args.depth_noise == args.rgb_noise == "none" and args.rgb_settings in (None, "{}"):
        raise InputError("a noise model: --depth-noise or --rgb-noise", found="neither")
    camera = given_or_noted_camera(args, console, Path(args.source))
    source = image_frames(Path(args.source), args.frames, camera)
    _write(source, sequence_options(args), args, console)


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


def configure_inspect(parser: ArgumentParser) -> None:
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
    add_rerun(parser, "its images, camera and poses")
    example = "iclnuim inspect out/living_room/kt2/noisy --preview pictures"
    common(parser, example).set_defaults(run=_inspect, reads_sequences=True)


def _inspect(args: Namespace, console: Console) -> int:
    """Exit code 2 if errors were found, 0 if there are at most warnings."""
    recording = checked_rerun(args)
    found = inspect_sequence(args.folder)
    values = {
        "folder": str(found.folder),
        "figures": found.figures,
        "wrong": found.wrong,
        "odd": found.odd,
    }
    lines = [_figure_line(name, value) for name, value in found.figures.items()]
    lines += [f"ERROR: {sentence}" for sentence in found.wrong]
    lines += [f"warning: {sentence}" for sentence in found.odd]
    if not found.wrong:
        lines.append("no errors found")
    console.result(values, "\n".join(lines))
    if args.preview is not None:
        from iclnuim.report.preview import draw_preview

        for path in draw_preview(args.folder, args.preview, console.progress):
            console.note(f"{path} written")
        if has_classes(args.folder):
            from iclnuim.labels.pictures import draw_classes

            console.note(f"{draw_classes(args.folder, args.preview)} written")
    if args.coco is not None:
        write_coco(args.coco, args.folder, console.progress)
        console.note(f"{args.coco} written")
    if args.metadata:
        console.note(f"{write_metadata(args.folder)} written")
    if recording:
        from iclnuim.report.recording import record_sequence

        record_sequence(recording, args.folder, console.progress)
        console.note(f"{recording} written")
    return 2 if found.wrong else 0


def _figure_line(name: str, value: Any) -> str:
    label, unit = _LABELS.get(name, (name.replace("_", " "), ""))
    if isinstance(value, dict):
        parts = []
        for key, one in value.items():
            parts.append(f"{key} {one:.6g}" if isinstance(one, float) else f"{key} {one}")
        value = ", ".join(parts)
    return f"{label}: {value}{unit}"


def configure_pack(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="a finished sequence")
    add("-o", "--out", type=Path, metavar="FILE", help="a .tar.gz; default: DIR.tar.gz")
    help = (
        f"{', '.join(LICENCES)}, or the name of any other; required for other images than renders "
        "of our rooms, which are under CC-BY-4.0"
    )
    add("--licence", default="", metavar="NAME", help=help)
    add("--author", default="", help="name of the author in the archive")
    add("--no-preview", action="store_true", help="leave out preview.png and preview.mp4")
    example = "iclnuim pack out/living_room/kt2/noisy -o kt2_noisy.tar.gz"
    common(parser, example).set_defaults(run=_pack)


def _check_archive(args: Namespace, out: Path) -> None:
    """Raises InputError for another kind of archive, one inside the folder, and, if the user did
    not name it, for a file of another origin.
    """
    if not out.name.endswith(_ARCHIVES) and not is_stream(out):
        expected = f"an archive named *{' or *'.join(_ARCHIVES)}"
        raise InputError(expected, path=out, found=out.suffix or "no ending")
    if real_path(out).is_relative_to(real_path(args.folder)):
        expected = "an archive outside the folder that is packed"
        raise InputError(expected, path=out, found="a file in it", hint="another {out}")
    if not args.out and out.exists() and not is_archive(out):
        refuse_existing(out, "-o FILE")
    check_file(out)


def _pack(args: Namespace, console: Console) -> None:
    folder = args.folder if args.folder.name else real_path(args.folder)  # `.` has no name
    out = args.out or folder.with_name(f"{real_path(folder).name}.tar.gz")
    licence = packed_licence(args.folder, args.licence)
    _check_archive(args, out)
    extra: dict[str, bytes] = {}
    if not args.no_preview:
        from iclnuim.report.preview import draw_preview

        with tempfile.TemporaryDirectory() as scratch:
            drawn = draw_preview(args.folder, Path(scratch), console.progress)
            extra = {path.name: read_bytes(path) for path in drawn}
    progress = console.progress(len(packed_names(args.folder)) + 2 + len(extra), "pack", "files")

    def on_file(name: str) -> None:
        progress.advance()

    count = pack(args.folder, out, licence, args.author, extra, on_file)
    digest = sha256(read_bytes(out))
    size = out.stat().st_size
    values = {"archive": str(out), "files": count, "bytes": size, "sha256": digest}
    values["licence"] = licence
    text = f"{out}: {count} files, {size / 1e6:.1f} MB, under {licence}, SHA-256 {digest}"
    console.result(values, text)
