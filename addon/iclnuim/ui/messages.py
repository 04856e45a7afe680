"""Errors as words: what every operator does with the errors of the library."""

from __future__ import annotations

import functools
from collections.abc import Callable

from ..errors import IclnuimError
from . import session
from .work import in_panel_words


def in_words(execute: Callable) -> Callable:
    """An operator's `execute` whose IclnuimError is shown in the panel and the status bar, and cancels the operator."""

    @functools.wraps(execute)
    def wrapped(self, context):
        work = session.current.work
        if work.phase == "failed":  # its words were of the step before
            work.phase, work.message = "idle", ""
        try:
            execute(self, context)
        except IclnuimError as error:
            text = in_panel_words(str(error))
            if not session.current.work.busy:
                session.current.work.phase, session.current.work.message = "failed", text
            self.report({"WARNING"}, text)
            return {"CANCELLED"}
        return {"FINISHED"}

    return wrapped
