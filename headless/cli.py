"""The command `iclnuim`: finds the module of the command asked for, and turns errors into one line and an exit code.

Exit codes: 0 done, 2 bad input, 3 work failed, 130 interrupted. Only the module that is needed is imported.
"""

import argparse
import importlib
import os
import sys
from contextlib import suppress
from functools import partial
from typing import NoReturn

from iclnuim import __version__
from iclnuim.errors import IclnuimError
from iclnuim.formats.files import check_picture

from .isolation import survived
from .options import Console, option_name

#: command -> what it does. Its options are declared by `configure` of commands/NAME.py, `-` as `_`, or by `configure_NAME` of the module in _SHARED.
COMMANDS = {
    "make": "bake, render, and write a clean and a noisy sequence",
    "render": "render a sequence: EXR frames with RGB and exact depth",
    "status": "what is done in an output folder, and what is missing",
    "resume": "resume what was begun in an output folder",
    "task": "one task of a render farm: light, some frames, or the data set",
    "compare": "are two folders' frames the same, to the byte or by tolerance",
    "bake": "a scene's light map into the cache",
    "dataset": "EXR frames to a sequence, with a sensor's noise",
    "convert": "a sequence that you have in another format: Replica, ScanNet, COLMAP, ROS bags and others",
    "noise": "the same noise on a sequence that you have; noise calibrate fits it to a sensor",
    "inspect": "problems of any RGB-D sequence; preview images",
    "pack": "the archive to publish: files, checksums, licence, preview, recipe",
    "evaluate": "errors against ground truth: trajectory (ate, rpe), surface (surface), rendered views (views)",
    "odometry": "camera motion from colour and depth: our odometers and third-party ones",
    "run": "any system's camera motion on sequences: staged, timed, judged by what it wrote",
    "stress": "where methods fail: frames perturbed step by step, every method on each",
    "fuse": "depth images and a trajectory to a coloured mesh",
    "trajectory": "trajectories: info, convert, plot, make, adopt, resample",
    "scene": "build a scene by code; compare it with the official frames",
    "surface": "the scene as a surface, PLY or OBJ with textures; or what a trajectory saw of it",
    "benchmark": "the paper's experiments on all sequences: tables, findings, one report",
    "figure": "a figure of the paper, of our rooms, sequences and measured cells",
    "table": "a table of the paper from our own files, beside the printed figures",
    "check-depth": "cast the same rays independently and compare the depth",
    "bench": "measurements: time, error, and where they go",
    "extension": "the Blender extension as a zip",
    "doctor": "what is installed, what is missing, and how to install it",
}
_SHARED = dict.fromkeys(("make", "render", "resume", "task"), "runs")
_SHARED |= dict.fromkeys(("dataset", "convert", "noise", "inspect", "pack"), "sequences")


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    argv = sys.argv[1:] if argv is None else argv
    if not argv or argv[0] in ("-h", "--help"):
        width = max(map(len, COMMANDS))
        lines = "\n".join(f"  {name:<{width}}  {text}" for name, text in COMMANDS.items())
        about = "iclnuim COMMAND --help describes a command; iclnuim --version."
        print(f"usage: iclnuim COMMAND ...\n\n{lines}\n\n{about}")
        return 0 if argv else 2
    if argv[0] == "--version":
        print(f"iclnuim {__version__}")
        return 0
    if argv[0] not in COMMANDS:
        print(f"iclnuim: expected a command ({', '.join(COMMANDS)}), found {argv[0]!r}", file=sys.stderr)
        return 2
    command = argv[0]
    try:
        args = parsed(command, argv[1:])
        if getattr(args, "plot", None):
            check_picture(args.plot)  # before work that may be long
        work = partial(args.run, args, Console(getattr(args, "quiet", False), getattr(args, "json", False)))
        opened = getattr(args, getattr(args, "opens", ""), None)  # the file that the command opens in Blender
        return survived(work, str(opened)) if opened else work() or 0
    except IclnuimError as error:
        print(f"iclnuim {command}: {error.worded(option_name)}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"iclnuim {command}: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"iclnuim {command}: {where}{error.strerror or error}", file=sys.stderr)
        return 3


def command() -> NoReturn:
    """`main` as a process: its exit code is the process's."""
    code = main()
    if "bpy" in sys.modules:
        with suppress(OSError):
            sys.stdout.flush()
        os._exit(code)  # Blender as a module may wait at the end for threads of its own that are gone by then
    sys.exit(code)


def parsed(command: str, argv: list[str]) -> argparse.Namespace:
    """The command's options; `run(args, console)` among them is its work."""
    shared = _SHARED.get(command)
    module = importlib.import_module(f".commands.{shared or command.replace('-', '_')}", __package__)
    parser = argparse.ArgumentParser(prog=f"iclnuim {command}", description=COMMANDS[command])
    parser.set_defaults(run=getattr(module, "run", None))
    getattr(module, f"configure_{command}" if shared else "configure")(parser)
    return parser.parse_args(getattr(module, "spelled_out", list)(argv))


if __name__ == "__main__":
    command()
