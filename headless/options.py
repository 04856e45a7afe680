"""Options that every command shares."""

from __future__ import annotations

import argparse
from collections.abc import Callable


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
