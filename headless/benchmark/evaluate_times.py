"""`iclnuim bench evaluate`: the time of `iclnuim evaluate ate` beside that of evo_ape on the same two TUM files."""

import argparse
import shutil
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

from iclnuim.errors import WorkError

from ..console import Console
from ..options import Actions, action, count


def configure(actions: Actions) -> None:
    help = "time of trajectory evaluation beside evo_ape, from start to exit"
    parser = action(actions, "evaluate", help, "iclnuim bench evaluate groundtruth.txt estimate.txt", run)
    parser.add_argument("reference", metavar="GT", help="ground truth, a TUM file")
    parser.add_argument("estimate", metavar="EST", help="estimated trajectory, a TUM file")
    parser.add_argument("--rounds", type=count, default=7, metavar="N", help="of which the median counts; default: 7")


def run(args: argparse.Namespace, console: Console) -> int:
    found = commands(args.reference, args.estimate)
    if "evo_ape" not in found:
        console.note("evo_ape is not installed, so its row is left out; try: pip install evo")
    seconds: dict[str, list[float]] = {name: [] for name in found}
    for _ in range(args.rounds):  # interleaved, so that other load on the machine weighs on both
        for name, command in found.items():
            seconds[name].append(_timed(command))
    figures = {name: {"median_s": median(times), "min_s": min(times)} for name, times in seconds.items()}
    ours = figures["iclnuim evaluate ate"]
    rows = [
        f"{name:<22}{row['median_s']:9.3f} s{row['min_s']:9.3f} s{row['median_s'] / ours['median_s']:8.2f}"
        for name, row in figures.items()
    ]
    console.result(
        {"rounds": args.rounds, "times": figures}, "\n".join([f"{'':22}   median    minimum   ratio", *rows])
    )
    return 0


def commands(reference: str, estimate: str) -> dict[str, list[str]]:
    """What is run, by name; evo_ape only where it is installed."""
    found = {"iclnuim evaluate ate": [sys.executable, "-m", "iclnuim", "evaluate", "ate", reference, estimate]}
    evo_ape = shutil.which("evo_ape", path=str(Path(sys.executable).parent)) or shutil.which("evo_ape")
    if evo_ape:
        found["evo_ape"] = [evo_ape, "tum", reference, estimate, "--align", "--t_max_diff", "0.02"]
    return found


def _timed(command: list[str]) -> float:
    started = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise WorkError(f"{Path(command[0]).name} failed: {(done.stderr or done.stdout).strip().splitlines()[-1:]}")
    return time.perf_counter() - started
