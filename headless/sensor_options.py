"""Options of the noise models, shared by `dataset`, `noise` and `make`."""

from __future__ import annotations

import argparse
import json
import sys

from iclnuim.dataset.depth_units import UNITS_PER_METRE
from iclnuim.dataset.sequence import SequenceSettings
from iclnuim.errors import InputError
from iclnuim.sensor.models import DEPTH_MODELS, RGB_MODELS, depth_model, rgb_model


def add_sensor_options(parser: argparse.ArgumentParser, default: str, seed: bool = True) -> None:
    """--depth-noise, --rgb-noise, their settings; --seed and --depth-units but for `make` and its tasks."""
    for kind, models, example in (
        ("depth", DEPTH_MODELS, '{"sigma_d": 0.1}'),
        ("rgb", RGB_MODELS, '{"exposure": 0.5}'),
    ):
        choices = f"{', '.join(models)} or MODULE:FUNCTION; default: {default}"
        parser.add_argument(f"--{kind}-noise", default=default, metavar="MODEL", help=choices)
        parser.add_argument(f"--{kind}-settings", default="{}", metavar="JSON", help=f"of the model, such as {example}")
    if seed:
        parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the noise; default: 0")
        units = f"units a metre of the depth images that are written; default: {UNITS_PER_METRE:g}"
        parser.add_argument("--depth-units", type=float, default=UNITS_PER_METRE, metavar="N", help=units)


def sensor_from(args: argparse.Namespace) -> SequenceSettings:
    """The settings that the options name. Raises InputError for an unknown model or parameter."""
    if ":" in args.depth_noise + args.rgb_noise and "" not in sys.path:
        sys.path.insert(0, "")  # a user's own module lies in the working folder; the command's own path has it not
    depth = depth_model(args.depth_noise, _json(args.depth_settings))
    rgb = rgb_model(args.rgb_noise, _json(args.rgb_settings))
    return SequenceSettings(depth, rgb, args.seed or 0, getattr(args, "depth_units", UNITS_PER_METRE))


def _json(text: str) -> dict:
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError("noise settings as JSON", found=f"{text} ({error.msg})") from None
    if not isinstance(content, dict):
        raise InputError("noise settings as a JSON object", found=text)
    return content
