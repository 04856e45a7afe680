"""`iclnuim status DIR`: reports what is finished in an output folder and what is missing."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.console import Console

from ..farm.run_state import run_state
from ..options import common


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="output folder of `iclnuim render` or `make`")
    help = "frames to count, as a Python slice; default: those of the recorded command"
    add("--frames", metavar="A:B:S", help=help)
    common(parser, "iclnuim status out/living_room/kt2")


def run(args: Namespace, console: Console) -> None:
    state = run_state(args.folder, args.frames)
    missing = f"{state['missing']} missing" if state["missing"] else "nothing is missing"
    lines = [
        f"{state['folder']}: {state['sequence']}, "
        f"{state['finished']} of {state['frames']} frames rendered, "
        f"{state['in_sequences']} of them in the sequences, {missing}",
        f"working on it: {state['locked_by'] or 'no local command'}",
    ]
    if state["queue"] is not None:
        lines.append(f"in Slurm's queue: {state['queue']}; logs: {state['folder']}/.farm/slurm")
    if state["failed"] is not None:
        lines.append(f"the last task that failed: {state['failed']}")
    views = state["held_out"]
    if views:
        lines.append(f"held-out views: {views['finished']} of {views['frames']} rendered")
    elif views is not None:
        lines.append("held-out views: not begun")
    console.result(state, "\n".join(lines))
