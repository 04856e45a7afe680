"""Options that every command shares."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from iclnuim.formats.files import check_picture


def common(parser: argparse.ArgumentParser, example: str, json: bool = True) -> argparse.ArgumentParser:
    """Add --quiet, --json where the command reports figures, and an example under --help."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = f"example:\n  {example}"
    parser.add_argument("--quiet", action="store_true", help="no notes, no progress")
    if json:
        parser.add_argument("--json", action="store_true", help="figures as JSON on standard output")
    return parser


def subcommands(parser: argparse.ArgumentParser, title: str = "ACTION") -> argparse._SubParsersAction:
    """A required choice of actions below a command; each is made with `action`."""
    return parser.add_subparsers(metavar=title, required=True, dest="action")


def action(
    actions: argparse._SubParsersAction, name: str, help: str, example: str, run: Callable, json: bool = True
) -> argparse.ArgumentParser:
    """One action with its own options; `args.run(args, console)` does the work."""
    parser = actions.add_parser(name, help=help, description=help)
    parser.set_defaults(run=run)
    return common(parser, example, json)


def check_pictures(args: argparse.Namespace) -> None:
    """Before work that may be long: InputError where its picture (plot, chart) could not be written after it."""
    for name in ("plot", "chart"):
        if getattr(args, name, None):
            check_picture(getattr(args, name))


def count(text: str) -> int:
    """The type of an option that is a number from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a number from 1 up, found {text!r}")
    return int(text)
