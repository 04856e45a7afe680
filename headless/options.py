"""What every command shares: its options, and its output: results on standard output, notes and progress on standard error."""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from iclnuim.errors import InputError
from iclnuim.geometry.scene_axes import SceneReading, parse_unit
from iclnuim.settings import Setting, Settings, declared, find, plain

S = TypeVar("S", bound=Settings)
#: Scene files, for help texts; iclnuim.blender.scene decides.
SCENE_KINDS = ".blend .glb .gltf .obj .ply .usd .fbx"


class Console:
    """`quiet` drops notes and progress; `json` turns results into one JSON object on standard output."""

    def __init__(self, quiet: bool = False, json: bool = False) -> None:
        self.quiet, self.as_json = quiet, json

    def result(self, values: dict, text: str) -> None:
        """The figures a command was asked for: `values` with --json, `text` without."""
        print(json.dumps(values, indent=2, allow_nan=False) if self.as_json else text, flush=True)

    def note(self, text: str) -> None:
        """Something worth knowing beside the result."""
        if not self.quiet:
            print(text, file=sys.stderr, flush=True)

    def progress(self, total: int, label: str, unit: str = "frames") -> "Progress":
        return Progress(total, label, unit, enabled=not self.quiet)


class Progress:
    """Done, rate and time left: one line redrawn on a terminal, a plain line every ten seconds in a log."""

    def __init__(self, total: int, label: str, unit: str, enabled: bool) -> None:
        self.total, self.label, self.unit, self.enabled = total, label, unit, enabled
        self.done, self.started, self.last = 0, time.monotonic(), 0.0
        self.terminal = sys.stderr.isatty()

    def begin(self) -> None:
        """Start the clock: what came before was preparation, which tells nothing about the time left."""
        if not self.done:
            self.started = time.monotonic()

    def advance(self, count: int = 1) -> None:
        self.done += count
        now = time.monotonic()
        if self.enabled and (now - self.last > (0.1 if self.terminal else 10.0) or self.done >= self.total):
            self.last = now
            rate = self.done / max(now - self.started, 1e-9)
            left = str(timedelta(seconds=max(0, round((self.total - self.done) / rate)))).removeprefix("0:")
            text = f"{self.label}: {self.done}/{self.total} {self.unit}, {rate:.3g}/s, {left} left"
            end = "\n" if not self.terminal or self.done >= self.total else ""
            print(("\r\x1b[K" if self.terminal else "") + text, end=end, file=sys.stderr, flush=True)


def add_settings(
    parser: argparse.ArgumentParser, group: type[Settings], only: Iterable[str] | None = None, **defaults: Any
) -> None:
    """An option for every declared setting of a group, or for those named in `only`; an option that is not given is None.

    Its value is kept under the option's name, so that groups whose settings share a name can share a parser. Choices are checked by
    the declaration, whose error is one line.
    `defaults`: what the help calls the default where a command has another one than the declaration.
    """
    for name, declaration in declared(group).items():
        if declaration.option and (only is None or name in only):
            _add_setting(parser, declaration, defaults.get(name, declaration.default))


def _add_setting(parser: argparse.ArgumentParser, s: Setting, default: Any) -> None:
    unit = f" ({s.unit})" if s.unit else ""
    text = f"{s.help}{unit}".replace("%", "%%")
    if s.kind is bool and s.default is False:
        parser.add_argument(s.option, action="store_true", default=None, help=text)
        return
    text += "" if default is None else f"; default: {plain(default)}".replace("%", "%%")
    if s.kind is bool:
        parser.add_argument(s.option, action=argparse.BooleanOptionalAction, default=None, help=text)
        return
    kind: Callable[[str], Any] = s.parse or (str if s.choices is not None else _reader(s))
    meta = "N" if s.kind in (int, float) and not s.parse else _key(s).upper()
    if s.choices is not None:
        meta = "{" + ",".join([*s.choices, *([s.others] if s.others else [])]) + "}"
    if any(choice.startswith("-") for choice in s.choices or ()):
        text += f"; with = before a minus, such as {s.option}=-z"
    more: dict[str, Any] = {} if s.length is None else {"nargs": s.length} if s.length else {"action": "append"}
    parser.add_argument(s.option, type=kind, metavar=meta, help=text, **more)


def _key(s: Setting) -> str:
    """Where argparse keeps the value of a setting's option: map_size of --map-size."""
    return s.option.removeprefix("--").replace("-", "_")


def _reader(s: Setting) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        return s.kind(text)

    read.__name__ = {int: "whole number", float: "number"}.get(s.kind, "text")  # argparse: invalid NAME value
    return read


def given_settings(
    args: argparse.Namespace, group: type[Settings], only: Iterable[str] | None = None
) -> dict[str, Any]:
    """The settings that options name, by their names."""
    keys = {n: _key(s) for n, s in declared(group).items() if only is None or n in only}
    return {n: getattr(args, key) for n, key in keys.items() if getattr(args, key, None) is not None}


def settings_from(args: argparse.Namespace, base: S, only: Iterable[str] | None = None) -> S:
    """`base` with the settings that options name. Raises InputError, naming the option, for a value that does not fit."""
    options = {n: s.option for n, s in declared(type(base)).items() if s.option}
    given = given_settings(args, type(base), only)
    try:
        return replace(base, **given)
    except InputError as error:
        setting = options.get(error.setting or "", error.setting)
        raise InputError(error.expected, setting=setting, found=error.found, hint=error.hint) from None


def renamed(parser: argparse.ArgumentParser, old: str, new: str, **how: Any) -> None:
    """Option `old` is still understood as `new`, with a note on standard error; `how` as add_argument has it (type, nargs, ...).

    To be called after `new` was added, with the same `dest` in `how` where `new` has one of its own, and append=True where it may be
    given several times.
    """
    dest = how.pop("dest", new.lstrip("-").replace("-", "_"))
    how = {"action": _Renamed, "default": argparse.SUPPRESS, "help": argparse.SUPPRESS, **how}
    parser.add_argument(old, dest=dest, new=new, **how)


class _Renamed(argparse.Action):
    """Stores the value (True where the option takes none), and prints the option's new name."""

    def __init__(self, option_strings: Sequence[str], dest: str, new: str, append: bool = False, **how: Any) -> None:
        super().__init__(option_strings, dest, **how)
        self.new, self.append = new, append

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option_string: Any = None
    ) -> None:
        Console().note(f"note: {option_string} is now called {self.new}; the old name goes with the next release")
        value = True if self.nargs == 0 else values
        setattr(namespace, self.dest, [*(getattr(namespace, self.dest) or ()), value] if self.append else value)


def option_name(setting: str) -> str:
    """What the command line calls a setting, for error messages; an option stays."""
    if setting.startswith("--"):
        return setting
    declaration = find(setting)
    return declaration.option if declaration and declaration.option else "--" + setting.replace("_", "-")


def common(parser: argparse.ArgumentParser, example: str, json: bool = True) -> argparse.ArgumentParser:
    """Add --quiet, --json where the command reports figures, and an example under --help."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = f"example:\n  {example}"
    parser.add_argument("--quiet", action="store_true", help="no notes, no progress")
    if json:
        parser.add_argument("--json", action="store_true", help="figures as JSON on standard output")
    return parser


Actions: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def subcommands(parser: argparse.ArgumentParser, title: str = "ACTION") -> Actions:
    """A required choice of actions below the command of `parser`; each is made with `action`."""
    return parser.add_subparsers(metavar=title, required=True, dest="action")


def action(
    actions: Actions, name: str, help: str, example: str, run: Callable, json: bool = True
) -> argparse.ArgumentParser:
    """One action with its own options; `args.run(args, console)` does the work."""
    parser = actions.add_parser(name, help=help, description=help)
    parser.set_defaults(run=run)
    return common(parser, example, json)


def add_rerun(parser: argparse.ArgumentParser, what: str) -> None:
    """--rerun, a recording of `what`; `checked_rerun` before long work."""
    help = f"write a recording of {what} for the viewer Rerun (.rrd; pip install iclnuim[rerun])"
    parser.add_argument("--rerun", type=Path, metavar="FILE", help=help)


def checked_rerun(args: argparse.Namespace) -> Path | None:
    """Where the recording goes, if one is asked for. Raises InputError for a name that does not fit, WorkError without its package."""
    if args.rerun:
        from iclnuim.report.recording import check_recording

        check_recording(args.rerun)
    return args.rerun


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """How a scene file is to be read: --up, --scene-unit, --mirror, --textures; settings_from makes a SceneReading of them."""
    add_settings(parser, SceneReading)
    renamed(parser, "--units", "--scene-unit", type=parse_unit)


def count(text: str) -> int:
    """The type of an option that is a number from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a number from 1 up, found {text!r}")
    return int(text)
