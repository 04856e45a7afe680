"""What the commands that read a sequence share: the options of its camera, and the notes on what is
assumed and left out.
"""

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.bags import is_bag
from iclnuim.formats.depth_units import UNITS_PER_METRE, check_units
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sequences.camera_files import SequenceCamera
from iclnuim.sequences.frames import ImagePair, depth_lag_s

from .options import option_name

if TYPE_CHECKING:
    from iclnuim.geometry.trajectory import Trajectory
    from iclnuim.sequences.stored_sequence import StoredSequence


#: In less time a hand moves a camera by less than a millimetre.
_NOTED_LAG_S = 0.001


def read_bags(args: Namespace, console: Console) -> None:
    """Unpack the bags among the sequences that a command reads, with progress, and print how each
    is read. The command itself reports what is wrong with them.
    """
    given = vars(args)
    sequences = [given.get("folder"), given.get("source"), *(given.get("folders") or [])]
    for path in sequences:
        if path and is_bag(path):
            from iclnuim.sequences.bag_reader import unpacked

            with suppress(InputError):
                folder, notes = unpacked(path, console.progress)
                for sentence in notes:
                    console.note(f"{path}: {sentence}")
                console.note(f"{path}: unpacked in {folder}, which may be removed afterwards")


def add_camera_options(parser: ArgumentParser) -> None:
    parser.set_defaults(reads_sequences=True)
    help = "default: camera.json of the folder, or the benchmark's camera"
    parser.add_argument("--camera", metavar="WxH,FX,FY,CX,CY", help=help)
    help = "depth units per metre; default: those of camera.json, or 5000"
    parser.add_argument("--units", type=float, metavar="N", help=help)
    add_allow_outside(parser)


def add_allow_outside(parser: ArgumentParser) -> None:
    help = "read images outside the sequence's folder that its lists name"
    parser.add_argument("--allow-outside", action="store_true", help=help)


def opened_with_camera(args: Namespace, folder: Path) -> "StoredSequence":
    """The sequence, with the camera given by the options; with --units alone, its own camera with
    these units.
    """
    from iclnuim.sequences.stored_sequence import StoredSequence

    sequence = StoredSequence(folder, args.allow_outside)
    if args.camera:
        camera = SequenceCamera(PinholeCamera.parse(args.camera), units_from(args))
        return sequence.with_camera(camera)
    if args.units is None:
        return sequence
    units = units_from(args)
    return sequence.with_camera(replace(sequence.camera, depth_units_per_metre=units))


def opened_with_notes(args: Namespace, folder: Path, console: Console) -> "StoredSequence":
    """The sequence with the camera given by the options; see note_sequence."""
    sequence = opened_with_camera(args, folder)
    note_sequence(sequence, console)
    return sequence


def units_from(args: Namespace) -> float:
    """Depth units per metre given by --units, or the default. Raises InputError."""
    return check_units(UNITS_PER_METRE if args.units is None else args.units)


def note_sequence(
    sequence: "StoredSequence", console: Console, poses: "Trajectory | None" = None
) -> None:
    """Print what a command that reads a sequence assumes and leaves out, one note each: a camera
    that no file gives, lens distortion, images in no pair; and a warning if depth does not agree
    with the poses. By default the ground truth of the sequence.
    """
    from iclnuim.sequences.pose_check import doubt, pose_agreement

    folder = sequence.folder
    pairs = sequence.pairs
    camera = sequence.camera
    _note_camera(folder, camera, console)
    _note_unused_images(sequence, console)
    with suppress(InputError):  # what reads the ground truth raises it
        if poses is None:
            truth = sequence.loaded_truth
            if truth is None:
                return
            if truth.by_depth or truth.read_as.lost:
                console.note(f"{folder}: {truth.read_as.sentence}")
            poses = truth.trajectory
        found = pose_agreement(pairs, camera, poses)
        if found.doubtful:
            console.note(f"warning: {folder}: {doubt(found, camera, option_name)}")


def note_depth_lag(pairs: Sequence[ImagePair], names: Iterable[str], console: Console) -> None:
    """Print a note if the images of pairs were not taken at the same time, for methods of these
    names that read both.
    """
    lag_s = depth_lag_s(pairs)
    methods = ", ".join(names)
    if lag_s > _NOTED_LAG_S and methods:
        console.note(
            f"depth images were taken {1000 * lag_s:.3g} ms beside their colour images (median): "
            f"{methods} use both as of the colour image's stamp"
        )


def _note_unused_images(sequence: "StoredSequence", console: Console) -> None:
    """Print a note if images of the sequence are in no pair."""
    folder = sequence.folder
    if missing := sequence.missing_images():
        first = os.path.relpath(missing[0], folder)
        there = f"{len(sequence.pairs)} of {len(sequence.rows)} frames are there"
        lost = f"{len(missing)} images are missing, the first {first}"
        console.note(f"{folder}: {there}, and only these are used; {lost}")
    counts = []
    for kind, paths in sequence.unused_images().items():
        if paths:
            counts.append(f"{len(paths)} in {kind}/ (first: {paths[0].name})")
    if counts:
        unused = "images without a partner, or in no list, are not used"
        console.note(f"{folder}: {unused}: {', '.join(counts)}")


def _note_camera(folder: Path, camera: SequenceCamera, console: Console) -> None:
    """Print a note if no file gave the camera, and what its file says and is not applied."""
    for note in camera.notes:
        console.note(f"{folder}: {note}")
    if camera.assumed:
        c = camera.pinhole
        size = f"{c.width}x{c.height},{c.fx:g},{c.fy:g},{c.cx:g},{c.cy:g}"
        console.note(
            f"{folder}: no camera.json, so the benchmark's camera is assumed: {size}, "
            f"{camera.depth_units_per_metre:g} depth units per metre; "
            "set others with --camera and --units"
        )
