"""What the commands that read a sequence share: the options of its camera, and the notes on what is
assumed and left out.
"""

import os
from argparse import ArgumentParser, Namespace
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.bags import is_bag
from iclnuim.formats.depth_units import UNITS_PER_METRE, check_units
from iclnuim.formats.files import is_file
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sequences.layout import SequenceCamera

from .options import option_name

if TYPE_CHECKING:
    from iclnuim.geometry.trajectory import Trajectory
    from iclnuim.sequences.image_pairs import ImagePair


def read_bags(args: Namespace, console: Console) -> None:
    """Unpack the bags among the sequences that a command reads, with progress, and print how each
    is read. The command itself reports what is wrong with them.
    """
    given = vars(args)
    sequences = [given.get("folder"), given.get("source"), *(given.get("folders") or [])]
    for path in sequences:
        if path and is_bag(path):
            from iclnuim.sequences.bags.sequence import unpacked

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


def camera_from(args: Namespace, folder: Path) -> SequenceCamera | None:
    """The camera given by the options; with --units alone, that of `folder` with these units.

    None where none is given: the folder then decides.
    """
    if args.camera:
        return SequenceCamera(PinholeCamera.parse(args.camera), units_from(args))
    if args.units is None:
        return None
    return replace(_camera_of(folder), depth_units_per_metre=units_from(args))


def given_or_noted_camera(args: Namespace, console: Console, folder: Path) -> SequenceCamera:
    """The camera given by the options, else that of `folder`; see note_sequence."""
    camera = camera_from(args, folder) or _camera_of(folder)
    note_sequence(folder, camera, console)
    return camera


def _camera_of(folder: Path) -> SequenceCamera:
    from iclnuim.sequences.image_pairs import find_pairs
    from iclnuim.sequences.stored_images import read_camera

    images = [pair.rgb for pair in find_pairs(folder)]
    return read_camera(folder, next(filter(is_file, images), images[0]))


def units_from(args: Namespace) -> float:
    """Depth units per metre given by --units, or the default. Raises InputError."""
    return check_units(UNITS_PER_METRE if args.units is None else args.units)


def note_sequence(
    folder: Path,
    camera: SequenceCamera | None,
    console: Console,
    poses: "Trajectory | None" = None,
) -> None:
    """Print what a command that reads a sequence assumes and leaves out, one note each: a camera
    that no file gives, lens distortion, images in no pair; and a warning if depth does not agree
    with the poses. By default the camera and the ground truth of the folder.
    """
    from iclnuim.sequences.image_pairs import find_pairs
    from iclnuim.sequences.inspection.pose_check import doubt, pose_agreement
    from iclnuim.sequences.sequence_poses import load_truth

    pairs = find_pairs(folder)
    camera = camera or _camera_of(folder)
    _note_camera(folder, camera, console)
    _note_unused_images(folder, pairs, console)
    with suppress(InputError):  # what reads the ground truth raises it
        if poses is None:
            truth = load_truth(folder)
            if truth is None:
                return
            if truth.by_depth or truth.read_as.lost:
                console.note(f"{folder}: {truth.read_as.sentence}")
            poses = truth.trajectory
        found = pose_agreement(pairs, camera, poses)
        if found.doubtful:
            console.note(f"warning: {folder}: {doubt(found, camera, option_name)}")


def _note_unused_images(folder: Path, pairs: "list[ImagePair]", console: Console) -> None:
    """Print a note if images of the sequence are in no pair."""
    from iclnuim.sequences.image_pairs import find_rows, missing_images, unused_images

    if missing := missing_images(folder):
        first = os.path.relpath(missing[0], folder)
        there = f"{len(pairs)} of {len(find_rows(folder))} frames are there"
        lost = f"{len(missing)} images are missing, the first {first}"
        console.note(f"{folder}: {there}, and only these are used; {lost}")
    counts = []
    for kind, paths in unused_images(pairs).items():
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
