"""`iclnuim bench evaluate`: the time of `iclnuim evaluate ate` and of evo_ape on the same files."""

import shutil
import subprocess
import sys
import time
from argparse import Namespace
from pathlib import Path
from statistics import median

from iclnuim.console import Console
from iclnuim.errors import WorkError
from iclnuim.headless.options import Actions, action, count

_OURS = "iclnuim evaluate ate"


def configure(actions: Actions) -> None:
    help = "time of trajectory evaluation next to that of evo_ape, each a whole process"
    example = "iclnuim bench evaluate groundtruth.txt estimate.txt"
    evaluate = action(actions, "evaluate", help, example, _evaluate)
    add = evaluate.add_argument
    add("reference", metavar="GT", help="ground truth, a TUM file")
    add("estimate", metavar="EST", help="estimated trajectory, a TUM file")
    help = "number of repetitions, of which the median is reported; default: 7"
    add("--rounds", type=count, default=7, metavar="N", help=help)


def _evaluate(args: Namespace, console: Console) -> None:
    files = [args.reference, args.estimate]
    commands = {_OURS: [sys.executable, "-m", "iclnuim", "evaluate", "ate", *files]}
    beside = str(Path(sys.executable).parent)
    evo_ape = shutil.which("evo_ape", path=beside) or shutil.which("evo_ape")
    if evo_ape:
        commands["evo_ape"] = [evo_ape, "tum", *files, "--align", "--t_max_diff", "0.02"]
    else:
        console.note("evo_ape is not installed, so its row is left out; try: pip install evo")
    seconds: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(args.rounds):  # interleaved, so that other load on the machine affects both
        for name, command in commands.items():
            seconds[name].append(_seconds(command))
    figures = {}
    for name, times in seconds.items():
        figures[name] = {"median_s": median(times), "min_s": min(times)}
    console.result({"rounds": args.rounds, "times": figures}, _table(figures))


def _seconds(command: list[str]) -> float:
    """The time of a process. Raises WorkError if it fails."""
    started = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True)
    seconds = time.perf_counter() - started
    if done.returncode:
        last = (done.stderr or done.stdout).strip().splitlines()[-1:]
        raise WorkError(f"{Path(command[0]).name} failed: {last}")
    return seconds


def _table(figures: dict[str, dict[str, float]]) -> str:
    ours_s = figures[_OURS]["median_s"]
    rows = [f"{'':22}   median    minimum   ratio"]
    for name, row in figures.items():
        ratio = row["median_s"] / ours_s
        rows.append(f"{name:<22}{row['median_s']:9.3f} s{row['min_s']:9.3f} s{ratio:8.2f}")
    return "\n".join(rows)
