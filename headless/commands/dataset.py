"""`iclnuim dataset`: the EXR frames of a run to a TUM sequence, clean or with a sensor's noise."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from iclnuim.dataset import sequence as sequences
from iclnuim.dataset.run_folder import RunFolder, read_run
from iclnuim.errors import InputError
from iclnuim.sensor.models import DEPTH_MODELS, RGB_MODELS

from ..console import Console
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("raw", type=Path, metavar="RAW", help="folder of a run, as `iclnuim render` makes it")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the sequence")
    add_sensor_options(parser, "none")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the noise; default: 0")
    common(parser, "iclnuim dataset out/living_room/kt2/raw noisy --depth-noise released --rgb-noise released", json=False)


def add_sensor_options(parser: argparse.ArgumentParser, default: str) -> None:
    """The noise models and their parameters: shared with `iclnuim make`."""
    own = "or MODULE:FUNCTION"
    parser.add_argument("--depth-noise", default=default, metavar="MODEL", help=f"{', '.join(DEPTH_MODELS)} {own}; default: {default}")
    parser.add_argument("--rgb-noise", default=default, metavar="MODEL", help=f"{', '.join(RGB_MODELS)} {own}; default: {default}")
    parser.add_argument("--depth-settings", default="{}", metavar="JSON", help='parameters of the model, such as {"sigma_d": 0.1}')
    parser.add_argument("--rgb-settings", default="{}", metavar="JSON", help='parameters of the model, such as {"exposure": 0.5}')


def run(args: argparse.Namespace, console: Console) -> int:
    run_folder = read_run(args.raw)
    numbers = run_folder.frame_numbers()
    if not numbers:
        raise InputError("a run with frames", path=args.raw, found="none", hint="iclnuim render")
    fill(run_folder, args.out, sensor_from(args), numbers, console)
    return 0


def sensor_from(args: argparse.Namespace) -> sequences.SensorSettings:
    """The options' noise. Raises InputError for an unknown model or parameter."""
    settings = sequences.SensorSettings(args.depth_noise, args.rgb_noise, _json(args.depth_settings), _json(args.rgb_settings), args.seed or 0)
    settings.to_dict()
    return settings


def fill(run_folder: RunFolder, out: Path, settings: sequences.SensorSettings, numbers: list[int], console: Console) -> None:
    """Write those of the frames that `out` does not hold yet, and the lists of all it holds."""
    sequence = sequences.open_sequence(out, run_folder, settings)
    size = (run_folder.camera.height, run_folder.camera.width)
    missing = sorted(set(numbers) - set(sequence.finished(numbers, size)))
    console.note(f"{out}: {len(missing)} of {len(numbers)} frames to write")
    progress = console.progress(len(missing), out.name)
    lost = sequences.write_frames(run_folder, sequence, settings, missing, lambda number: progress.advance())
    if lost:
        console.note(f"{lost} depths beyond 13.107 m, infinite, negative or NaN became 0 (no measurement)")
    sequences.write_lists(run_folder, sequence)


def _json(text: str) -> dict:
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError("noise parameters as JSON", found=f"{text} ({error.msg})") from None
    if not isinstance(content, dict):
        raise InputError("noise parameters as a JSON object", found=text)
    return content
