"""Options that the actions of `iclnuim trajectory` share."""

from argparse import ArgumentParser, Namespace

from iclnuim.errors import StrPath
from iclnuim.formats.files import check_file
from iclnuim.geometry.scene_axes import parse_unit
from iclnuim.trajectory_files import trajectories as files

from ..outputs import refuse_existing

FILE = "a trajectory file, a folder of POV-Ray camera files, or a built-in one (living_room/kt2)"


def add_reading(parser: ArgumentParser) -> None:
    """Add the options that decide how a trajectory file is read; `loaded` reads it."""
    add = parser.add_argument
    known = ", ".join(files.FORMATS)
    help = f"format of the input; default: recognised by name and content: {known}"
    add("--from", dest="source_format", metavar="FORMAT", help=help)
    help = "unit of the input: m (default), cm, mm, in, ft or a number of metres"
    add("--unit", type=parse_unit, default=1.0, metavar="UNIT", help=help)
    help = "frame rate of a file that numbers its frames instead of giving stamps (default 30)"
    add("--file-rate", type=float, default=30.0, metavar="HZ", help=help)


def loaded(args: Namespace, file: str, positions_suffice: bool = False) -> files.LoadedTrajectory:
    return files.read_trajectory(
        file,
        args.source_format,
        rate_hz=args.file_rate,
        unit_m=args.unit,
        positions_suffice=positions_suffice,
    )


def check_out(out: StrPath, force: bool) -> None:
    """Raises InputError if the file exists, unless `force` is true, or cannot be written."""
    if not force:
        refuse_existing(out, "--force to overwrite it")
    check_file(out)
