"""`iclnuim run`: runs a system that estimates camera motion, ours or a third-party one, on
sequences, measures its time and memory, and evaluates the trajectories that it wrote.
"""

import signal
import threading
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

from iclnuim.benchmark.experiments.recipes.system.recipe import (
    SystemRuns,
    read_results,
    runs_table,
    system_store,
    write_results,
)
from iclnuim.benchmark.systems.staging import StagedSequence
from iclnuim.benchmark.systems.system import System, built_in, read_system
from iclnuim.console import Console
from iclnuim.errors import InputError

from ..options import FRAMES, add_frames, common, count
from ..planned_work import PlannedWork, add_dry_run, announce
from ..sequence_input import (
    add_camera_options,
    note_depth_lag,
    note_sequence,
    opened_with_camera,
)


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "system",
        metavar="SYSTEM",
        help=f"{', '.join(built_in())}, or your own file SYSTEM.toml: docs/guide/systems.md",
    )
    help = "sequences in any format; errors need their ground truth"
    add("folders", type=Path, nargs="+", metavar="DIR", help=help)
    help = "number of runs on each sequence; medians and quartiles are reported; default: 1"
    add("--runs", type=count, default=1, metavar="N", help=help)
    help = (
        "seconds after which a run and all its processes are killed; default: 60 plus one per frame"
    )
    add("--time-limit", type=seconds, metavar="S", help=help)
    add(
        "-o",
        "--out",
        type=Path,
        default=Path("out/systems"),
        metavar="OUT",
        help="default: out/systems",
    )
    help = "leave the first SECONDS out of the errors; the system sees them all the same"
    add("--skip", type=float, default=0.0, metavar="SECONDS", help=help)
    _add_system_options(parser)
    add_frames(parser, FRAMES)
    add(
        "--stage-only",
        action="store_true",
        help="only write the view and the settings file, and print the command",
    )
    add_camera_options(parser)
    add_dry_run(parser)
    common(
        parser, "iclnuim run orbslam3 out/living_room/kt2/clean --runs 3 --vocabulary ORBvoc.txt"
    )


def _add_system_options(parser: ArgumentParser) -> None:
    """Add the mode and the options of the system, and where it is."""
    add = parser.add_argument
    help = "a mode of the system, such as rgbd-inertial of orbslam3"
    add("--mode", metavar="MODE", help=help)
    help = "an option of the system; may be given several times"
    add("--set", action="append", default=[], metavar="NAME=VALUE", help=help)
    add(
        "--vocabulary",
        metavar="FILE",
        help="the same as --set vocabulary=FILE; .xz and .gz are unpacked",
    )
    add(
        "--program",
        metavar="PATH",
        help="program of the system, or the Python that runs it; default: found on PATH",
    )


def run(args: Namespace, console: Console) -> int:
    """Exit code 0 even if a system failed on some sequences: its rows report the failures.

    3 if it gave no pose at all.
    """
    system = read_system(args.system, _options(args), args.mode)
    file = args.out / "results.json"
    if file.is_file():
        read_results(file)  # an older one is refused before the work
    experiments = _experiments(args, system, console)
    if args.stage_only:
        commands = []
        for e in experiments:
            values = {**e.prepare(), "out": "OUT"}
            commands.append(system.filled(system.settings.command, values))
        console.result({"commands": commands}, "\n".join(map(" ".join, commands)))
        return 0
    if announce(_work(experiments, args.runs), args, console):
        return 0
    results = _results(args, experiments, console)
    console.note(f"{file} written; `iclnuim bench odometry {file}` shows it next to other results")
    console.result({"results": results}, "\n\n".join(runs_table(one).text() for one in results))
    found = [row for row in chain.from_iterable(one["runs"] for one in results) if row["coverage"]]
    return 0 if found else 3


def _experiments(args: Namespace, system: System, console: Console) -> list[SystemRuns]:
    """One for each sequence. Raises InputError for two sequences of one name."""
    store = system_store(args.out)
    experiments = []
    for folder in args.folders:
        stored = opened_with_camera(args, folder)
        sequence = StagedSequence.of(stored, args.frames, args.skip)
        if system.settings.stage.imu:
            sequence.imu_text(system.settings.stage)  # refused before the work
        note_sequence(stored, console)
        note_depth_lag(sequence.pairs, [system.name], console)
        experiments.append(SystemRuns(system, sequence, store))
    if len({e.folder for e in experiments}) < len(experiments):
        raise InputError("sequences of different names", found=", ".join(map(str, args.folders)))
    return experiments


def _results(
    args: Namespace, experiments: Sequence[SystemRuns], console: Console
) -> list[dict[str, Any]]:
    """Make the missing runs; returns the rows of each sequence, which are stored as they come."""
    limits_s = [args.time_limit or 60.0 + len(e.sequence.pairs) for e in experiments]
    there = [e.there(args.runs, s) for e, s in zip(experiments, limits_s, strict=True)]
    total = args.runs * len(experiments)
    if any(there):
        kept = f"{sum(there)} of {total} runs are in {args.out} already"
        console.note(f"{kept}, and are not repeated")
    progress = console.progress(total, f"run {experiments[0].system.name}", "runs")
    results = []
    with _terminated_as_interrupted():
        for e, limit_s in zip(experiments, limits_s, strict=True):
            rows = e.run(args.runs, limit_s, progress.advance)
            results.append({"sequence": e.sequence.name, "preset": None, "runs": rows})
            write_results(args.out, results[-1:])
    return results


def _work(experiments: list[SystemRuns], runs: int) -> PlannedWork:
    """All runs, at the rate of the cameras."""
    frames = sum(len(e.sequence.pairs) for e in experiments)
    seconds = sum(len(e.sequence.pairs) / e.sequence.rate_hz for e in experiments)
    name = experiments[0].system.name
    what = f"{runs} runs of {name} on {len(experiments)} sequences, {frames} frames, in real time"
    return PlannedWork(what, runs * seconds)


def _options(args: Namespace) -> dict[str, str]:
    """The options of the system given by --set, --vocabulary and --program."""
    given = {"vocabulary": args.vocabulary, "program": args.program}
    options = {key: value for key, value in given.items() if value is not None}
    for text in args.set:
        name, sign, value = text.partition("=")
        if not sign or not name:
            raise InputError("NAME=VALUE", setting="--set", found=text)
        options[name] = value
    return options


def seconds(text: str) -> float:
    """The argparse type of --time-limit."""
    value = float(text)
    if not 0 < value < 1e7:
        raise ArgumentTypeError(f"expected a number of seconds above 0, found {text!r}")
    return value


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Treat SIGTERM and SIGHUP like Ctrl-C: the processes of the system are killed, and no
    incomplete run is left.
    """
    numbers = (
        (signal.SIGTERM, signal.SIGHUP)
        if threading.current_thread() is threading.main_thread()
        else ()
    )
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
