"""Texts for users about the open scene."""

from collections.abc import Iterable
from typing import Any

_MAX_NAMES = 5
_MAX_CHARACTERS = 160


def names_of(things: Iterable[Any]) -> str:
    """The names of datablocks, or the names given, in order; only the first ones of many."""
    names = sorted(getattr(thing, "name", thing) for thing in things)
    shown = ", ".join(names[:_MAX_NAMES])[:_MAX_CHARACTERS]
    if len(names) > _MAX_NAMES:
        return f"{shown} and {len(names) - _MAX_NAMES} more"
    return shown
