"""The command `iclnuim`: imports the module of the requested command alone, and reports an error as
one line and an exit code: 0 done, 2 invalid input, 3 work failed, 130 interrupted.
"""

import argparse
import importlib
import os
import re
import sys
import traceback
from collections import ChainMap
from collections.abc import Collection, Sequence
from contextlib import suppress
from difflib import get_close_matches
from functools import partial
from itertools import pairwise
from typing import Any, NoReturn

from iclnuim.console import Console
from iclnuim.errors import IclnuimError, InputError, package_missing
from iclnuim.formats.files import check_file, check_picture
from iclnuim.version import __version__

from .completion import complete
from .isolation import run_isolated
from .options import option_name
from .outputs import check_outputs

#: Groups of commands: command -> description. `configure` in commands/NAME.py (`-` becomes `_`)
#: declares its options, and `run` executes it.
GROUPS = {
    "rendering": {
        "make": "bake the light, render the frames, and write a clean and a noisy sequence",
        "render": "render a sequence: EXR frames with RGB and exact depth",
        "bake": "bake the light map of a scene into the cache",
        "dataset": "convert EXR frames to a sequence, with the noise of a sensor model",
        "status": "show what is finished in an output folder, and what is missing",
        "resume": "resume an interrupted run in its output folder",
    },
    "sequences": {
        "convert": "convert a sequence to another format: Replica, ScanNet, COLMAP, ROS bags",
        "noise": "add sensor noise to a sequence; noise calibrate fits noise models to a sensor",
        "inspect": "report problems of any RGB-D sequence; write preview images",
        "pack": "write the archive to publish: files, checksums, licence, preview, recipe",
        "fetch": "fetch a packed sequence from a folder or a web server: verified, resumed",
        "compare": "compare the frames of two folders, byte for byte or within a tolerance",
        "view": "look at sequences, trajectories, surfaces and scenes in a browser",
    },
    "scenes": {
        "trajectory": "work with trajectories: info, convert, plot, make, camera, adopt, resample",
        "surface": "export the surface of the scene, all of it or what a trajectory saw",
    },
    "evaluation": {
        "odometry": "estimate camera motion from colour and depth, with our odometers or others",
        "run": "run any SLAM or odometry system on sequences, and evaluate its trajectories",
        "settings": "write the settings file that a SLAM system needs to read a sequence",
        "fuse": "fuse depth images along a trajectory into a coloured mesh",
        "evaluate": "compute errors against ground truth: trajectory (ate, rpe), surface, views, depth, labels",
    },
    "experiments": {
        "benchmark": "run the paper's experiments on all sequences: tables, findings, one report",
        "stress": "measure where methods fail, on frames with perturbations of increasing severity",
        "experiment": "measure an experiment of your own on sequences: cells, tables, a page",
        "figure": "draw a figure of the paper from our rooms, sequences and measured cells",
        "table": "print a table of the paper: our figures next to the printed ones",
    },
    "installation": {
        "doctor": "report what is installed, what is missing, and how to install it",
        "cache": "say where the cache is and how large, and clear it",
    },
    "development": {
        "task": "run one task of a render farm: light, some frames, or the data set",
        "bench": "measure time and error: rendering, noise, odometry, evaluation",
        "check-depth": "compare the depth of a run with independently cast rays",
        "scene": "build a scene from code; compare it with the official frames",
        "extension": "build the Blender extension as a zip",
    },
}
#: command -> description.
COMMANDS = dict(ChainMap(*reversed(GROUPS.values())))


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    try:
        try:
            return _run(sys.argv[1:] if argv is None else argv)
        finally:
            sys.stdout.flush()  # here, where a closed or full standard output can be handled
    except BrokenPipeError:
        _discard_output()
        return 0
    except OSError as error:
        _discard_output()
        print(f"iclnuim: standard output: {error.strerror or error}", file=sys.stderr)
        return 3


def _discard_output() -> None:
    """Lose what is still to be printed, so that Python does not try it again at its end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(argv: list[str]) -> int:
    if "_ARGCOMPLETE" in os.environ:
        complete(COMMANDS, _configure)
    if not argv or argv[0] in ("-h", "--help"):
        print(_usage())
        return 0 if argv else 2
    command = argv[0]
    if command in ("-V", "--version"):
        print(f"iclnuim {__version__}")
        return 0
    if command not in COMMANDS:
        meant = _meant(command, COMMANDS) or "iclnuim --help, which lists them"
        print(f"iclnuim: expected a command, found {command!r}; try {meant}", file=sys.stderr)
        return 2
    try:
        return _run_command(argv)
    except IclnuimError as error:
        if {"-v", "--verbose"} & set(argv):
            traceback.print_exc()
        print(f"iclnuim {command}: {error.worded(option_name)}", file=sys.stderr)
        return error.exit_code
    except ModuleNotFoundError as error:
        print(f"iclnuim {command}: {package_missing(command, error)}", file=sys.stderr)
        return 3
    except KeyboardInterrupt as error:
        print(f"iclnuim {': '.join([command, 'interrupted', *error.args])}", file=sys.stderr)
        return 130
    except BrokenPipeError:
        raise
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"iclnuim {command}: {where}{error.strerror or error}", file=sys.stderr)
        return 3


def _meant(word: str, known: Collection[str]) -> str:
    """The known words that resemble a mistyped one, joined by `or`; empty if there are none."""
    others = [other for other in dict.fromkeys(known) if other != word]
    return " or ".join(get_close_matches(word, others, n=2))


def _usage() -> str:
    width = max(map(len, COMMANDS))
    lines = []
    for title, group in GROUPS.items():
        lines.append(f"\n{title}:")
        lines += [f"  {name:<{width}}  {text}" for name, text in group.items()]
    about = "iclnuim COMMAND --help describes a command; iclnuim -V prints the version."
    return "\n".join(["usage: iclnuim COMMAND ...", *lines, "", about])


def _run_command(argv: list[str]) -> int:
    _refuse_empty(argv)
    args = parsed(argv[0], argv[1:])
    given = vars(args)
    check_outputs(args)
    if given.get("plot"):
        check_picture(args.plot)  # before work that may take long
    if given.get("csv"):
        check_file(args.csv)
    console = Console(given.get("quiet", False), given.get("json", False))
    if given.get("reads_sequences"):
        from .sequence_input import read_bags

        read_bags(args, console)
    work = partial(args.run, args, console)
    opened = given.get(given.get("opens", ""))  # the file that the command opens in Blender
    with console.at_end:
        if opened:
            return run_isolated(work, str(opened))
        return work() or 0


def command() -> NoReturn:
    """Entry point of the console script: runs `main` and ends the process with its exit code."""
    code = main()
    if "bpy" in sys.modules:
        with suppress(OSError):
            sys.stdout.flush()
        os._exit(code)  # at exit, bpy may wait for Blender's threads, which no longer exist
    sys.exit(code)


#: Options that there are no more -> what does the same.
_INSTEAD = {"--klg": "--rosbag, or png_to_klg, which makes a log of a tum sequence"}
#: A value, not an option: a number or an axis with a minus.
_NEGATIVE = re.compile(r"-([\d.]|[xyz]$)")
#: Coordinates such as -1.4,0,1.5, of which argparse knows only that they begin with a minus.
_COORDINATES = re.compile(r"^(?=-[\d.]+,)")


class _Parser(argparse.ArgumentParser):
    """Reports an invalid command line in one line, without the usage."""

    words: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        self.words = args or ()
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        if "; try " not in message:
            used = _used(self, self.words)
            hint = self._joined(message) or _misspelt(message, used) or f"{used.prog} --help"
            message += f"; try {hint}"
        self.exit(2, f"{self.prog}: {message}\n")

    def _joined(self, message: str) -> str:
        """`--frames=-3:` if the option's value, a number or an axis, was taken for another option
        because it starts with a minus.
        """
        if not message.endswith(": expected one argument"):
            return ""
        names = message.removeprefix("argument ").partition(":")[0].split("/")
        for option, value in pairwise(self.words):
            abbreviated = len(option) > 1 and any(name.startswith(option) for name in names)
            if abbreviated and _NEGATIVE.match(value):
                return f"{option}={value}"
        return ""


def _used(parser: argparse.ArgumentParser, words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of the action among the words, or that of a command without actions."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word in words:
                if word in action.choices:
                    return action.choices[word]
    return parser


def _misspelt(message: str, parser: argparse.ArgumentParser) -> str:
    """The options of the parser that resemble the first one that is unknown, or what does the same
    as one that there is no more.
    """
    _, _, unknown = message.partition("unrecognized arguments: ")
    option = unknown.partition(" ")[0].partition("=")[0]
    if option in _INSTEAD:
        return _INSTEAD[option]
    known: list[str] = []
    for action in parser._actions:
        if action.help != argparse.SUPPRESS:
            known += action.option_strings
    return _meant(option, known) if option.startswith("-") else ""


def _refuse_empty(argv: list[str]) -> None:
    """Raises InputError for an empty argument, such as that of a shell variable that is not set."""
    for before, argument in pairwise(argv):
        option, given, value = argument.partition("=")
        if not argument or (given and not value and option.startswith("--")):
            where = option or before
            raise InputError(
                f"a value after {where}",
                found="an empty one",
                hint="setting the shell variable, if it is one",
            )


def _module_of(command: str) -> Any:
    return importlib.import_module(f".commands.{command.replace('-', '_')}", __package__)


def _configure(parser: argparse.ArgumentParser, command: str) -> None:
    """Declare the options of a command."""
    module = _module_of(command)
    parser.set_defaults(run=getattr(module, "run", None))
    module.configure(parser)


def parsed(command: str, argv: list[str]) -> argparse.Namespace:
    """The parsed options of the command; their attribute `run(args, console)` executes it."""
    module = _module_of(command)
    parser = _Parser(prog=f"iclnuim {command}", description=COMMANDS[command])
    _configure(parser, command)
    # a word that begins with a space is never taken for an option
    words = [_COORDINATES.sub(" ", word) for word in argv]
    if hasattr(module, "default_action") and (action := module.default_action(words)):
        words = [action, *words]
    try:  # options may stand between the positional arguments: odometry icp --preset paper DIR
        return parser.parse_intermixed_args(words)
    except TypeError:  # argparse: not with actions, as `evaluate ate` has them
        return parser.parse_args(words)


if __name__ == "__main__":
    command()
