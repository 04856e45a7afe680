"""What can go wrong, said in one line: what, where, expected, found, and what to try."""

from __future__ import annotations

import functools
import os


class IclnuimError(Exception):
    """Base of every error that a user should read as one line instead of a traceback."""

    exit_code = 3


class InputError(IclnuimError):
    """A file, option or array that cannot be used as it is (exit code 2).

    The message reads `FILE:LINE: expected E, found F; try HINT`; every part but `expected` may be left out.
    """

    exit_code = 2

    def __init__(
        self,
        expected: str,
        *,
        path: str | os.PathLike[str] | None = None,
        line: int | None = None,
        found: object = None,
        hint: str | None = None,
    ) -> None:
        self.path, self.line, self.expected, self.found, self.hint = path, line, expected, found, hint
        place = "" if path is None else f"{os.fspath(path)}{'' if line is None else f':{line}'}: "
        text = f"{place}expected {expected}"
        if found is not None:
            text += f", found {_shortened(found)}"
        if hint:
            text += f"; try {hint}"
        super().__init__(text)

    def __reduce__(self) -> tuple:
        """As errors from another process arrive: the same in every part."""
        parts = {"path": self.path, "line": self.line, "found": self.found, "hint": self.hint}
        return functools.partial(type(self), **parts), (self.expected,)


class WorkError(IclnuimError):
    """Work that was well described but could not be done: a render, a write, a worker (exit code 3)."""


def _shortened(found: object, limit: int = 200) -> str:
    """One printable line of at most `limit` characters."""
    text = " ".join(str(found).split())
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= limit else text[: limit - 3] + "..."
