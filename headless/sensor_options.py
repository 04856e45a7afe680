"""Options of the noise models and of what is written, shared by `dataset`, `noise`, `make` and its tasks."""

import argparse
import json
import sys
from typing import Any

from iclnuim.dataset.sequence_options import SequenceOptions
from iclnuim.errors import InputError

from .options import add_settings, settings_from

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
