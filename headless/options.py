"""Options shared by all commands."""

import argparse
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.settings import Setting, Settings, declared, find, plain

#: Help of --frames.
FRAMES = "only these frames, as a Python slice (B excluded); default: all"
S = TypeVar("S", bound=Settings)
#: Endings of scene files, for help texts; iclnuim.blender.open.scene decides what is read.
SCENE_KINDS = ".blend .glb .gltf .obj .ply .usd .fbx"


def trajectory_file(text: str) -> str:
    """A file or a folder; if there is none, the file of the built-in trajectory of that name, such
    as `office/kt0`, or `kt2` of the living room.
    """
    return os.fspath(shipped.file_or_trajectory(text))


def add_settings(
    parser: argparse.ArgumentParser,
    group: type[Settings],
    only: Iterable[str] | None = None,
    **defaults: Any,
) -> None:
    """Add an option for every declared setting of a group, or for those named in `only`. The value
    of an option that is not given is None.

    The value is stored under the option's name, so that groups whose settings share a name can
    share a parser. The declaration checks the choices; its error is one line. `defaults`: the
    default shown in the help, where a command has another default than the declaration.
    """
    for name, declaration in declared(group).items():
        if declaration.option and (only is None or name in only):
            _add_setting(parser, declaration, defaults.get(name, declaration.default))


def _add_setting(parser: argparse.ArgumentParser, s: Setting, default: Any) -> None:
    text = s.help
    if s.unit:
        text += f" ({s.unit})"
    is_flag = s.kind is bool and s.default is False
    if default is not None and not is_flag:
        text += f"; default: {plain(default)}"
    if any(choice.startswith("-") for choice in s.choices or ()):
        text += f"; write = before a value that starts with a minus, such as {s.option}=-z"
    how: dict[str, Any] = {"help": text.replace("%", "%%"), "default": None}
    if s.kind is bool:
        how["action"] = "store_true" if is_flag else argparse.BooleanOptionalAction
    else:
        how |= _value(s)
    parser.add_argument(s.option, **how)


def _value(s: Setting) -> dict[str, Any]:
    """The arguments of add_argument for an option that takes a value."""
    how: dict[str, Any] = {"type": s.parse or _reader(s), "metavar": _key(s).upper()}
    if s.choices is not None:
        how["metavar"] = "{" + ",".join(filter(None, [*s.choices, s.others])) + "}"
        how["type"] = s.parse or str
    elif s.kind in (int, float) and not s.parse:
        how["metavar"] = "N"
    if s.length:
        how["nargs"] = s.length
    elif s.length == 0:
        how["action"] = "append"
    return how


def _key(s: Setting) -> str:
    """The attribute under which argparse stores the value of a setting's option: map_size for
    --map-size.
    """
    return s.option.removeprefix("--").replace("-", "_")


def _reader(s: Setting) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        return s.kind(text)

    # argparse: invalid NAME value
    read.__name__ = {int: "whole number", float: "number"}.get(s.kind, "text")
    return read


def given_settings(
    args: argparse.Namespace, group: type[Settings], only: Iterable[str] | None = None
) -> dict[str, Any]:
    """The settings that were given as options: name -> value."""
    (given,) = given_of_groups(args, group)
    return {name: value for name, value in given.items() if only is None or name in only}


def given_of_groups(args: argparse.Namespace, *groups: type[Settings]) -> list[dict[str, Any]]:
    """The settings that were given as options, of each group: name -> value."""
    found = []
    for group in groups:
        keys = {name: _key(declaration) for name, declaration in declared(group).items()}
        values = {name: getattr(args, key, None) for name, key in keys.items()}
        found.append({name: value for name, value in values.items() if value is not None})
    return found


def settings_from(
    args: argparse.Namespace, base: S, only: Iterable[str] | None = None, **derived: Any
) -> S:
    """`base` with the settings that were given as options, and the `derived` ones.

    Raises InputError, which names the option, for an invalid value.
    """
    given = given_settings(args, type(base), only)
    try:
        return replace(base, **{**derived, **given})
    except InputError as error:  # two groups may have a setting of this name, as `method`
        options = {n: s.option for n, s in declared(type(base)).items() if s.option}
        setting = options.get(error.setting or "", error.setting)
        raise InputError(
            error.expected, setting=setting, found=error.found, hint=error.hint
        ) from None


def option_name(setting: str) -> str:
    """The command-line option of a setting, for error messages; a name that is an option already is
    returned unchanged.
    """
    if setting.startswith("--"):
        return setting
    declaration = find(setting)
    if declaration and declaration.option:
        return declaration.option
    return "--" + setting.replace("_", "-")


def common(
    parser: argparse.ArgumentParser, example: str, json: bool = True
) -> argparse.ArgumentParser:
    """Add --quiet, --verbose, --json if the command reports figures, and an example to --help."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = f"example:\n  {example}"
    parser.add_argument("--quiet", action="store_true", help="print no notes and no progress")
    help = "print where in the code an error was raised"
    parser.add_argument("-v", "--verbose", action="store_true", help=help)
    if json:
        help = "print figures as JSON on standard output"
        parser.add_argument("--json", action="store_true", help=help)
    return parser


Actions: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def subcommands(parser: argparse.ArgumentParser, title: str = "ACTION") -> Actions:
    """Add a required choice of actions to the command of `parser`; add each one with `action`."""
    return parser.add_subparsers(metavar=title, required=True, dest="action")


def action(
    actions: Actions,
    name: str,
    help: str,
    example: str,
    run: Callable[[argparse.Namespace, Console], int | None],
    json: bool = True,
) -> argparse.ArgumentParser:
    """Add one action with its own options; `args.run(args, console)` executes it."""
    parser = actions.add_parser(name, help=help, description=help)
    parser.set_defaults(run=run)
    return common(parser, example, json)


def add_rerun(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --rerun, which writes a recording of `what`. Call `checked_rerun` before long work."""
    help = f"write a recording for the viewer Rerun (.rrd; needs the package rerun-sdk): {what}"
    parser.add_argument("--rerun", type=Path, metavar="FILE", help=help)


def checked_rerun(args: argparse.Namespace) -> Path | None:
    """The file of --rerun, None if it is not given.

    Raises InputError for an invalid name, WorkError without the package.
    """
    if args.rerun:
        from iclnuim.report.recording import check_recording

        check_recording(args.rerun)
    return args.rerun


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """Add --up, --scene-unit, --mirror and --textures, which decide how a scene file is read;
    settings_from makes a SceneReading of them.
    """
    add_settings(parser, SceneReading)


def add_plot(parser: argparse.ArgumentParser, what: str = "the results") -> None:
    help = f"draw {what}; .png, .pdf or .svg"
    parser.add_argument("--plot", type=Path, metavar="FILE", help=help)


def numbers(text: str) -> tuple[float, ...]:
    """The argparse type of a list of numbers separated by commas."""
    return tuple(float(part) for part in text.split(","))


def whole_numbers(text: str) -> tuple[int, ...]:
    """The argparse type of a list of whole numbers separated by commas."""
    return tuple(int(part) for part in text.split(","))


def add_frames(parser: argparse.ArgumentParser, help: str, leading: bool = False) -> None:
    """Add --frames as a Python slice; --first N means :N.

    leading: only :N is possible, and `args.first` is N; otherwise `args.frames` is the text.
    """
    add = parser.add_argument
    if leading:
        add("--frames", type=_leading, metavar=":N", dest="first", help=help)
        add("--first", type=count, help=argparse.SUPPRESS)
    else:
        add("--frames", type=_slice, default="::", metavar="A:B:S", help=help)
        add("--first", type=_first, dest="frames", help=argparse.SUPPRESS)


def add_span(parser: argparse.ArgumentParser, help: str, start: int, first: int | None) -> None:
    """Add --frames A:B, which becomes `args.start` (A) and `args.first` (B - A); --start and
    --first give these themselves.
    """
    add = parser.add_argument
    add("--frames", type=_span, action=_Span, default=argparse.SUPPRESS, metavar="A:B", help=help)
    add("--start", type=int, default=start, help=argparse.SUPPRESS)
    add("--first", type=count, default=first, help=argparse.SUPPRESS)


class _Span(argparse.Action):
    """Stores A:B as `start` and `first`."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        namespace.start = values.start
        namespace.first = len(values) or None


def _span(text: str) -> range:
    """The argparse type of --frames A:B; an empty range from A without B."""
    begin, _, end = _slice(text).partition(":")
    start = int(begin or 0)
    stop = int(end or start)
    if start < 0 or stop < start or (end and stop == start):
        raise argparse.ArgumentTypeError(f"expected A:B with A below B, found {text!r}")
    return range(start, stop)


_span.__name__ = "A:B"  # argparse: invalid A:B value


def _slice(text: str) -> str:
    """The argparse type of --frames where a bare number may be meant as one frame or as many."""
    if ":" not in text:
        raise argparse.ArgumentTypeError(
            f"expected frames as A:B:S (a Python slice), found {text!r}; try --frames :{text}"
        )
    return text


def _first(text: str) -> str:
    return f":{count(text)}"


def _leading(text: str) -> int:
    """The argparse type of --frames :N."""
    begin, _, number = _slice(text).partition(":")
    if begin not in ("", "0") or not number.isdecimal() or int(number) < 1:
        raise argparse.ArgumentTypeError(
            f"expected :N, the first N frames, found {text!r}; try --frames :40"
        )
    return int(number)


def add_out(parser: argparse.ArgumentParser, help: str) -> None:
    """Add the output OUT as the last positional argument and as -o; one of them is required."""
    add = parser.add_argument
    # a positional argument that is not given does not replace the value of the option
    add("out", nargs="?", type=_path, default=argparse.SUPPRESS, metavar="OUT", help=help)
    add("-o", "--out", type=Path, metavar="OUT", help="the same")
    parser.set_defaults(out_required=True)


def _path(text: str) -> str | Path:
    """The argparse type of a path; argparse also passes its mark of an argument without a value."""
    if text == argparse.SUPPRESS:
        return text
    return Path(text)


def count(text: str) -> int:
    """The argparse type of a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, found {text!r}")
    return int(text)
