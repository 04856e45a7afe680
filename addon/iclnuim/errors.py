"""What can go wrong, said in one line: what, where, expected, found, and what to try."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Callable


class IclnuimError(Exception):
    """Base of every error that a user should read as one line instead of a traceback."""

    exit_code = 3


class InputError(IclnuimError):
    """A file, setting or array that cannot be used as it is (exit code 2).

    The message reads `FILE:LINE: SETTING: expected E, found F; try HINT`; every part but `expected` may be left out. In `expected` and
    `hint`, `{name}` stands for the setting of that name; `worded` puts what a user calls it: an option, or a label in the panel.
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
        self.path, self.line, self.setting, self.expected, self.found, self.hint = (
            path, line, setting, expected, found, hint
        )  # fmt: skip
        super().__init__(self.worded())

    def worded(self, name_of: Callable[[str], str] = str) -> str:
        """The message, with settings called as `name_of` does."""

        def named(text: str) -> str:
            return re.sub(r"\{([a-z_]+)\}", lambda found: name_of(found[1]), text)

        place = "" if self.path is None else f"{os.fspath(self.path)}{'' if self.line is None else f':{self.line}'}: "
        what = "" if self.setting is None else f"{name_of(self.setting)}: "
        text = f"{place}{what}expected {named(self.expected)}"
        if self.found is not None:
            text += f", found {_shortened(self.found)}"
        return text + (f"; try {named(self.hint)}" if self.hint else "")

    def __reduce__(self) -> tuple:
        """As errors from another process arrive: the same in every part."""
        names = ("path", "line", "setting", "found", "hint")
        return functools.partial(type(self), **{name: getattr(self, name) for name in names}), (self.expected,)


class WorkError(IclnuimError):
    """Work that was well described but could not be done: a render, a write, a worker (exit code 3)."""


def _shortened(found: object, limit: int = 200) -> str:
    """One printable line of at most `limit` characters."""
    text = " ".join(str(found).split())
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= limit else text[: limit - 3] + "..."
