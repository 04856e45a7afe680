"""Options of a sequence: noise models and what is written, the camera of a recorded one, packages that are needed, words that were renamed."""

import argparse
import json
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iclnuim.dataset.depth_units import UNITS_PER_METRE, check_units
from iclnuim.dataset.layout import SequenceCamera
from iclnuim.dataset.sequence_options import SequenceOptions
from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.odometry.registry import PACKAGES

from .options import Console, add_settings, settings_from

if TYPE_CHECKING:
    from iclnuim.odometry.run import Sequence

_EXAMPLES = {"depth": '{"sigma_d": 0.1}', "rgb": '{"exposure": 0.5}'}


def add_sensor_options(
    parser: argparse.ArgumentParser, default: str, names: tuple[str, ...] = ("seed", "depth_units")
) -> None:
    """--depth-noise, --rgb-noise, whose default is `default`, their settings, and the further `names` of SequenceOptions."""
    noise = ("depth_noise", "rgb_noise")
    add_settings(parser, SequenceOptions, (*noise, *names), **dict.fromkeys(noise, default))
    parser.set_defaults(**dict.fromkeys(noise, default))
    for kind, example in _EXAMPLES.items():
        parser.add_argument(f"--{kind}-settings", metavar="JSON", help=f"of the model, such as {example}")


def sequence_options(args: argparse.Namespace) -> SequenceOptions:
    """What the options name. Raises InputError for a value that does not fit."""
    options = settings_from(args, SequenceOptions())
    if ":" in options.depth_noise + options.rgb_noise and "" not in sys.path:
        sys.path.insert(0, "")  # a user's own module lies in the working folder; the command's own path has it not
    return options.changed(depth_settings=_json(args.depth_settings), rgb_settings=_json(args.rgb_settings))


def _json(text: str | None) -> dict[str, Any] | None:
    try:
        return None if text is None else json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError("noise settings as JSON", found=f"{text} ({error.msg})") from None


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


def open_sequence(args: argparse.Namespace, console: Console, folder: Path, depth_offset: float = 0.0) -> "Sequence":
    """The sequence with the camera of the options, or of the folder; a camera that had to be assumed is named."""
    from iclnuim.odometry.run import Sequence

    sequence = Sequence(folder, depth_offset, camera_from(args))
    note_assumed_camera(folder, sequence.camera, console)
    return sequence


def note_assumed_camera(folder: Path, camera: SequenceCamera, console: Console) -> None:
    """A note where no file gave the camera."""
    if camera.assumed:
        c, units = camera.pinhole, camera.depth_units_per_metre
        console.note(
            f"{folder}: no camera.json: the benchmark's camera is taken, {c.width}x{c.height},{c.fx:g},{c.fy:g},"
            f"{c.cx:g},{c.cy:g}, {units:g} units a metre; another: --camera"
        )


def require(what: str, *modules: str) -> None:
    """Raises WorkError, with the command that installs it, where one of the modules is missing."""
    for module in modules:
        if find_spec(module) is None:
            raise WorkError(f"{what} needs {module}; try: pip install {PACKAGES[module]}")


def current_word(word: str, renamed: dict[str, str], console: Console) -> str:
    """`word`, or what it is called now where it starts with an old one; with a note."""
    for old, new in renamed.items():
        if word.startswith(old):
            console.note(f"note: {old} is now called {new}; the old name goes with the next release")
            return new + word.removeprefix(old)
    return word
