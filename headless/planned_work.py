"""What a command will do, how long it will take, and how much it will write: alone with --dry-run,
and as a note before work of more than a minute.
"""

from argparse import ArgumentParser, Namespace
from dataclasses import asdict, dataclass

from iclnuim.console import Console

#: Work that takes longer is announced.
ANNOUNCED_S = 60.0
#: Core-seconds of a frame: 80 cells of `iclnuim benchmark`, with surfaces, took 3.6 core-hours.
TRACK_CORE_S = 0.07
FUSE_CORE_S = 0.07


@dataclass(frozen=True)
class PlannedWork:
    """work: a phrase. seconds: an estimate of the wall time on this machine. gigabytes: of what is
    written.
    """

    work: str
    seconds: float
    gigabytes: float = 0.0

    def sentence(self) -> str:
        """`882 frames of living_room/kt2: about 3 minutes, 1.1 GB`."""
        if not self.seconds:
            return f"{self.work}: nothing to do"
        disk = f", {self.gigabytes:.1f} GB" if self.gigabytes >= 0.05 else ""
        return f"{self.work}: about {_duration(self.seconds)}{disk}"


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 90 * 60:
        return f"{seconds / 60:.0f} minutes"
    return f"{seconds / 3600:.1f} hours"


def add_dry_run(parser: ArgumentParser) -> None:
    help = "only say what will run, about how long, and how much it writes"
    parser.add_argument("--dry-run", action="store_true", help=help)


def announce(work: PlannedWork, args: Namespace, console: Console) -> bool:
    """Print what is planned, if it is long or only that was requested; returns whether it was."""
    dry_run = getattr(args, "dry_run", False)
    if dry_run:
        console.result(asdict(work), work.sentence())
    elif work.seconds > ANNOUNCED_S:
        console.note(work.sentence())
    return dry_run
