"""Completion of commands, options, sequences and files in a shell, by argcomplete:
`eval "$(register-python-argcomplete iclnuim)"`.
"""

import argparse
import os
import shlex
from collections.abc import Callable, Mapping

from iclnuim import shipped

#: Arguments that may be the name of a built-in sequence or scene.
_SEQUENCES = (
    "sequence", "trajectory", "file", "files", "source", "reference", "poses", "truth", "seen_by",
)  # fmt: skip
_SCENES = ("scene", "model")
_ODOMETERS = ("method",)


def complete(
    commands: Mapping[str, str], configure: Callable[[argparse.ArgumentParser, str], None]
) -> None:
    """Print the possible words and exit. Only the options of the command that stands in the line
    are declared.
    """
    import argcomplete

    line = os.environ["COMP_LINE"][: int(os.environ["COMP_POINT"])]
    with_commands = argparse.ArgumentParser(prog="iclnuim")
    actions = with_commands.add_subparsers()
    for name, text in commands.items():
        parser = actions.add_parser(name, help=text)
        if name in _words(line)[1:2]:
            configure(parser, name)
            _name_sequences(parser)
    argcomplete.autocomplete(with_commands)


def _words(line: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError:  # an open quote
        return line.split()


def _name_sequences(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for one in action.choices.values():
                _name_sequences(one)
        elif names := _names(action.dest):
            action.completer = CompletedNames(names)  # type: ignore[attr-defined]


def _names(argument: str) -> list[str]:
    if argument in _SCENES:
        return list(shipped.SCENE_NAMES)
    if argument in _ODOMETERS:
        from iclnuim.benchmark.odometry.registry import ODOMETERS

        return list(ODOMETERS)
    if argument not in _SEQUENCES:
        return []
    names = shipped.sequence_names()
    short = [name.partition("/")[2] for name in names if name.startswith("living_room/")]
    return [*short, *names, "all"]


class CompletedNames:
    """Completes names of what is built in, and files."""

    def __init__(self, names: list[str]) -> None:
        self._names = names

    def __call__(self, prefix: str, **others: object) -> list[str]:
        from argcomplete.completers import FilesCompleter

        own = [name for name in self._names if name.startswith(prefix)]
        return [*own, *FilesCompleter()(prefix)]
