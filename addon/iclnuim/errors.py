"""Errors that are reported in one line: where, what, expected, found, and what to try."""

import copy
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: A file or folder, as functions take its name.
StrPath = str | os.PathLike[str]


class IclnuimError(Exception):
    """Base of every error that a user should read as one line instead of a traceback: `MESSAGE; try
    HINT`.

    In a hint, `{name}` is a placeholder for the setting of that name; `worded` replaces it by the
    user's name of it: an option or a label.
    """

    exit_code = 3

    def __init__(self, message: str = "", *, hint: str | None = None) -> None:
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return self.worded()

    def worded(self, name_of: Callable[[str], str] = str) -> str:
        """The message; `name_of` returns the name of each setting."""
        return self.message + self._advice(name_of)

    def _advice(self, name_of: Callable[[str], str]) -> str:
        return f"; try {named(self.hint, name_of)}" if self.hint else ""

    @property
    def template(self) -> str:
        """The message with a placeholder `{name}` for each setting, for a process that replaces
        them with `named`.
        """
        return self.worded("{{{}}}".format)


class InputError(IclnuimError):
    """A file, setting or array that is invalid (exit code 2).

    The message is `FILE:LINE: SETTING: expected E, found F; try HINT`. Every part except `expected`
    is optional. `expected` may also contain placeholders `{name}` for settings.
    """

    exit_code = 2

    def __init__(
        self,
        expected: str,
        *,
        path: StrPath | None = None,
        line: int | None = None,
        setting: str | None = None,
        found: object = None,
        hint: str | None = None,
    ) -> None:
        self.path = path
        self.line = line
        self.setting = setting
        self.expected = expected
        self.found = found
        super().__init__(expected, hint=hint)

    def worded(self, name_of: Callable[[str], str] = str) -> str:
        """The message; `name_of` returns the name of each setting."""
        text = f"expected {named(self.expected, name_of)}"
        if self.setting is not None:
            text = f"{name_of(self.setting)}: {text}"
        if self.path is not None:
            line = "" if self.line is None else f":{self.line}"
            text = f"{os.fspath(self.path)}{line}: {text}"
        if self.found is not None:
            text += f", found {_printable(self.found)}"
        return text + self._advice(name_of)

    def at(self, path: StrPath) -> "InputError":
        """The same error with `path` as its file.

        If the error has a path already, that path is appended as a place inside the file.
        """
        path = path if self.path is None else f"{os.fspath(path)}: {os.fspath(self.path)}"
        moved = copy.copy(self)
        moved.path = path
        return moved


def _printable(found: object) -> str:
    """The text of any object as one printable line of at most 200 characters."""
    line = " ".join(str(found).split())
    for letter in set(line):
        if not letter.isprintable():
            line = line.replace(letter, "?")
    return line if len(line) <= 200 else f"{line[:197]}..."


@contextmanager
def within(path: StrPath) -> Iterator[None]:
    """Add `path` to an InputError of the block that has no path."""
    try:
        yield
    except InputError as error:
        raise error if error.path else error.at(path) from None


class WorkError(IclnuimError):
    """Valid input, but the work failed: a render, a write, a worker (exit code 3)."""


#: Package name -> the distribution that contains it, where its name is another one.
DISTRIBUTIONS = {
    "cv2": "opencv-contrib-python-headless",
    "igl": "libigl",
    "open3d": "open3d-cpu",
}


def package_missing(what: str, error: ModuleNotFoundError) -> WorkError:
    """The error for `what` if the benchmark or another package cannot be imported."""
    name = error.name or "of another version"
    if name == "bpy":
        return blender_missing(what, error)
    if name.startswith("iclnuim."):
        hint = "./setup.sh in a clone of the repository"
        return WorkError(f"{what} needs iclnuim.benchmark, which is not installed here", hint=hint)
    hint = f"pip install {DISTRIBUTIONS.get(name, name)}"
    return WorkError(f"{what} needs the package {name}", hint=hint)


def blender_missing(what: str, error: ImportError) -> WorkError:
    """The error for `what` if Blender's Python package bpy cannot be imported, with a hint for this
    version of Python.
    """
    if isinstance(error, ModuleNotFoundError) and error.name == "bpy":
        return WorkError(f"{what} needs Blender's Python package bpy", hint=how_to_get_bpy())
    text = f"{what} needs Blender's Python package bpy, which cannot be imported: {error}"
    return WorkError(text, hint="iclnuim doctor")


def how_to_get_bpy() -> str:
    """How to install bpy in this Python: 4.5 LTS for Python 3.11, 5.2 LTS for Python 3.13; there is
    no supported bpy for other versions.
    """
    version = {(3, 11): "4.5", (3, 13): "5.2"}.get(sys.version_info[:2])
    if version:
        return f"pip install 'bpy=={version}.*'"
    here = f"Python {sys.version_info[0]}.{sys.version_info[1]}"
    return f"Python 3.11 or 3.13: there is no bpy for {here}"


def named(text: str, name_of: Callable[[str], str] = str) -> str:
    """The text with every placeholder `{name}` of a setting replaced by `name_of(name)`."""
    return re.sub(r"\{([a-z_]+)\}", lambda found: name_of(found[1]), text)
