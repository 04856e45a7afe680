"""What the commands that write sequences share: the options of noise and files, read once, and the
writing.
"""

import sys
from argparse import ArgumentParser, Namespace
from dataclasses import dataclass, replace
from typing import Any, Self

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.files import content_of_json
from iclnuim.sensor.imu_noise import IMU_MODELS, imu_noise
from iclnuim.sequences.bag_writer import BagSettings
from iclnuim.sequences.frame_source import FrameSource
from iclnuim.sequences.sequence_formats import sequence_format
from iclnuim.sequences.sequence_options import SequenceOptions
from iclnuim.sequences.writer import SequenceWriter

from ..options import add_settings, count, given_of_groups

_EXAMPLES = {"depth": '{"sigma_d": 0.1}', "rgb": '{"exposure": 0.5}'}


def add_sensor_options(
    parser: ArgumentParser, default: str, names: tuple[str, ...] = ("seed", "depth_units")
) -> None:
    """Add --depth-noise and --rgb-noise with the default `default`, their settings, and the options
    of the other `names` of SequenceOptions.
    """
    noise = ("depth_noise", "rgb_noise")
    add_settings(parser, SequenceOptions, (*noise, *names), **dict.fromkeys(noise, default))
    parser.set_defaults(**dict.fromkeys(noise, default))
    models = "; ".join(f"{name}: {model.summary}" for name, model in IMU_MODELS.items())
    help = f"noise of the IMU, of which clean readings are none; {models}"
    parser.add_argument("--imu", metavar="{" + ",".join(IMU_MODELS) + "}", help=help)
    for kind, example in _EXAMPLES.items():
        parser.add_argument(
            f"--{kind}-settings", metavar="JSON", help=f"settings of the model, such as {example}"
        )


def add_output_options(parser: ArgumentParser) -> None:
    """Add the options for noise and for the formats in which a sequence is written."""
    add_sensor_options(parser, "none", ("seed", "depth_units", "formats", "names"))
    add_file_options(parser)


def add_file_options(parser: ArgumentParser) -> None:
    add_settings(parser, BagSettings)
    help = "number of processes that write images; default: one per core"
    parser.add_argument("--workers", type=count, metavar="N", help=help)


@dataclass(frozen=True)
class SequenceOutput:
    """What the options say about the sequences that are written: noise, formats and bags."""

    options: SequenceOptions
    logs: BagSettings

    @classmethod
    def of(cls, args: Namespace, base: SequenceOptions | None = None) -> Self:
        """The output given on the command line. base: the settings where no option is given.

        Raises InputError for invalid settings, depth units that no format has, and settings of
        bags that are not written.
        """
        given, logs = given_of_groups(args, SequenceOptions, BagSettings)
        given |= _model_settings(args)
        if imu := getattr(args, "imu", None):
            given["imu_noise"] = imu_noise(imu).name
        options = replace(base or SequenceOptions(), **given)
        _check_units(options, given.get("depth_units"))
        if ":" in options.depth_noise + options.rgb_noise and "" not in sys.path:
            # a user's module is in the working folder, which is not on the command's search path
            sys.path.insert(0, "")
        return cls(options, _checked(BagSettings(**logs)))


def _model_settings(args: Namespace) -> dict[str, Any]:
    """The settings of the noise models, of a command that has them."""
    found = {}
    for name in ("depth_settings", "rgb_settings"):
        if (text := getattr(args, name, None)) is not None:
            found[name] = content_of_json(text, "noise settings in JSON")
    return found


def _check_units(options: SequenceOptions, given: float | None) -> None:
    """Raises InputError if depth units are given, and every format has other units that are
    fixed.
    """
    fixed = {name: sequence_format(name).limits.fixed_units for name in options.formats}
    if given is None or None in fixed.values() or given in fixed.values():
        return
    expected = ", ".join(f"{units:g} for the format {name}" for name, units in fixed.items())
    hint = "the command without it"
    raise InputError(expected, setting="depth_units", found=f"{given:g}", hint=hint)


def _checked(logs: BagSettings) -> BagSettings:
    """Raises InputError for settings of bags that are not written."""
    for name in ("bag_storage", "bag_names", "compress_bags"):
        if not logs.rosbag and getattr(logs, name) != getattr(BagSettings(), name):
            raise InputError(f"{{rosbag}} with {{{name}}}", found="it alone")
    return logs


def write_reported(
    source: FrameSource, output: SequenceOutput, args: Namespace, console: Console
) -> None:
    """Write the sequence args.out by args.workers processes, and report the progress and what was
    written.
    """
    for number in source.numbers[:1]:
        source.load(number)  # images of another size are refused before anything is written
    settings = {args.out: output.options.sequence_settings()}
    writer = SequenceWriter(source, settings, output.options.formats)
    for sentence in writer.losses():
        console.note(sentence)
    console.note(f"{args.out}: {len(writer.missing)} of {len(source.numbers)} frames to write")
    progress = console.progress(len(writer.missing), "dataset")
    written = writer.write(args.workers, lambda number: progress.advance())[0]
    paths = [*written.folders, *output.logs.write(written.folders[0], args.out, console.note)]
    folders = [str(path) for path in paths]
    values = {
        "folders": folders,
        "frames_written": written.made,
        "frames_already_written": written.found,
        "invalid_depth": written.invalid_depth,
    }
    text = f"{', '.join(folders)}: {written.made} frames written, {written.found} already finished"
    lost = [f"{pixels} {kind}" for kind, pixels in written.lost_depth.items()]
    if lost:
        text += f"\ndepth values set to 0 (no measurement): {', '.join(lost)}"
    console.result(values, text)
