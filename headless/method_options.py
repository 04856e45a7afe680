"""What commands that run methods need: the opened sequence, and the methods and packages that are
installed.
"""

from argparse import Namespace
from importlib.util import find_spec
from pathlib import Path

from iclnuim.benchmark.odometry.registry import PACKAGES, odometer
from iclnuim.benchmark.odometry.run import Sequence
from iclnuim.console import Console
from iclnuim.errors import IclnuimError, WorkError

from .sequence_input import note_sequence, opened_with_camera

#: For an odometer about 10 s on two free cores, a minute where they are shared.
COMPILING = "compiling, once: 10 s to a minute"
#: Columns of odometry_table() that are short.
COLUMNS = (
    "degen.: frames whose alignment is under-constrained; ms: median of a frame's time, then its "
    "95th percentile; 1/s: frames per second"
)


def open_sequence(
    args: Namespace,
    console: Console,
    folder: Path,
    depth_offset: float = 0.0,
    frames: str = "::",
) -> Sequence:
    """Open the sequence with the camera given by the options, or with that of the folder.

    frames: a Python slice of its pairs. Notes report what is assumed, left out and in doubt.
    """
    sequence = Sequence(opened_with_camera(args, folder), depth_offset, frames)
    note_sequence(sequence.stored, console)
    return sequence


def require(console: Console, what: str, *modules: str) -> None:
    """Raises WorkError, with the command that installs it, if one of the modules is missing. What
    numba compiles is announced, and is no part of a rate or a time left.
    """
    for module in modules:
        if find_spec(module) is None:
            raise WorkError(f"{what} needs {module}; try: pip install {PACKAGES[module]}")
    if "numba" in modules:
        from iclnuim.benchmark.odometry.compiling import WorkClock

        clock = WorkClock(lambda: console.note(COMPILING))
        console.clock = console.at_end.enter_context(clock)


def installed(names: list[str], preset: str, console: Console) -> list[str]:
    """The odometers that have the preset and whose packages are installed; a note reports each one
    that is left out.

    Raises InputError or WorkError if none is left.
    """
    found = []
    for name in names:
        try:
            odometer(name, preset)
            found.append(name)
        except IclnuimError as error:
            if name == names[-1] and not found:
                raise
            console.note(f"left out: {error}")
    return found
