"""What can go wrong, said in one line: what, where, expected, found, and what to try."""

import copy
import os
import re
import sys
from collections.abc import Callable


class IclnuimError(Exception):
    """Base of every error that a user should read as one line instead of a traceback: `MESSAGE; try HINT`.

    In a hint, `{name}` stands for the setting of that name; `worded` puts what a user calls it: an option, or a label in the panel.
    """

    exit_code = 3

    def __init__(self, message: str = "", *, hint: str | None = None) -> None:
        self.message, self.hint = message, hint

    def __str__(self) -> str:
        return self.worded()

    def worded(self, name_of: Callable[[str], str] = str) -> str:
        """The message, with settings called as `name_of` does."""
        return self.message + (f"; try {named(self.hint, name_of)}" if self.hint else "")

    @property
    def template(self) -> str:
        """The message with `{name}` for each setting, for a process that words it with `named`."""
        return self.worded("{{{}}}".format)


class InputError(IclnuimError):
    """A file, setting or array that cannot be used as it is (exit code 2).

    The message reads `FILE:LINE: SETTING: expected E, found F; try HINT`; every part but `expected` may be left out. In `expected` too,
    `{name}` stands for a setting.
    """

    exit_code = 2

    def __init__(
        self,
        expected: str,
        *,
        path: str | os.PathLike[str] | None = None,
        line: int | None = None,
        setting: str | None = None,
        found: object = None,
        hint: str | None = None,
    ) -> None:
        self.path, self.line, self.setting, self.expected, self.found = path, line, setting, expected, found
        super().__init__(expected, hint=hint)

    def worded(self, name_of: Callable[[str], str] = str) -> str:
        """The message, with settings called as `name_of` does."""
        place = "" if self.path is None else f"{os.fspath(self.path)}{'' if self.line is None else f':{self.line}'}: "
        what = "" if self.setting is None else f"{name_of(self.setting)}: "
        text = f"{place}{what}expected {named(self.expected, name_of)}"
        if self.found is not None:  # as one printable line of at most 200 characters
            found = "".join(c if c.isprintable() else "?" for c in " ".join(str(self.found).split()))
            text += f", found {found if len(found) <= 200 else found[:197] + '...'}"
        return text + (f"; try {named(self.hint, name_of)}" if self.hint else "")

    def at(self, path: str | os.PathLike[str]) -> "InputError":
        """The same error in that file, or part of one; a path that it has is a place in there."""
        path = path if self.path is None else f"{os.fspath(path)}: {os.fspath(self.path)}"
        moved = copy.copy(self)
        moved.path = path
        return moved


class WorkError(IclnuimError):
    """Work that was well described but could not be done: a render, a write, a worker (exit code 3)."""


def blender_missing(what: str, error: ImportError) -> WorkError:
    """The error of `what` where Blender's Python package bpy could not be imported, with what to do about it in this Python."""
    if isinstance(error, ModuleNotFoundError) and error.name == "bpy":
        return WorkError(f"{what} needs Blender's Python package bpy", hint=how_to_get_bpy())
    text = f"{what} needs Blender's Python package bpy, which cannot be imported: {error}"
    return WorkError(text, hint="iclnuim doctor")


def how_to_get_bpy() -> str:
    """What to do for bpy in this Python: Python 3.11 has 4.5 LTS, Python 3.13 has 5.2 LTS, other versions have none that we support."""
    version = {(3, 11): "4.5", (3, 13): "5.2"}.get(sys.version_info[:2])
    if version:
        return f"pip install 'bpy=={version}.*'"
    return f"Python 3.11 or 3.13: there is no bpy for Python {sys.version_info[0]}.{sys.version_info[1]}"


def named(text: str, name_of: Callable[[str], str] = str) -> str:
    """The text with every `{name}` of a setting replaced by what `name_of` calls it."""
    return re.sub(r"\{([a-z_]+)\}", lambda found: name_of(found[1]), text)
