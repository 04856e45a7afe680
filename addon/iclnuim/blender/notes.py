"""Texts for users about the open scene."""

from collections.abc import Iterable


def names_of(things: Iterable) -> str:
    names = sorted(t if isinstance(t, str) else t.name for t in things)
    shown = ", ".join(names[:5])
    return shown[:160] + (f" and {len(names) - 5} more" if len(names) > 5 else "")
