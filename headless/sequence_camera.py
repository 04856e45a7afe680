"""Options for the camera of a sequence that somebody has, and a word where it had to be assumed."""

from __future__ import annotations

import argparse

from iclnuim.dataset.depth_units import UNITS_PER_METRE, check_units
from iclnuim.dataset.images import SequenceCamera
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera


def add_camera_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--camera", metavar="WxH,FX,FY,CX,CY", help="default: camera.json there, or the benchmark's")
    add("--units", type=float, metavar="N", help="depth units a metre; default: camera.json's, or 5000")


def camera_from(args: argparse.Namespace) -> SequenceCamera | None:
    """The camera of the options; None leaves it to the folder."""
    if args.camera:
        return SequenceCamera(PinholeCamera.parse(args.camera), check_units(args.units or UNITS_PER_METRE))
    if args.units:
        raise InputError("--camera with --units", found="--units alone")
    return None


def words(camera: SequenceCamera) -> str:
    """What is said of a camera that nothing in the folder told."""
    c, units = camera.pinhole, camera.depth_units_per_metre
    return (
        f"no camera.json: the benchmark's camera is taken, {c.width}x{c.height},{c.fx:g},{c.fy:g},{c.cx:g},{c.cy:g},"
        f" {units:g} units a metre; another: --camera"
    )
