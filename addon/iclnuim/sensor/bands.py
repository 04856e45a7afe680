"""Rows of an image a few at a time: arrays so small stay in the cache; whole images took three times as long."""

from __future__ import annotations

from collections.abc import Iterator

_ROWS = 48


def bands(height: int) -> Iterator[slice]:
    """Slices that cover the rows 0..height-1 in order."""
    return (slice(top, min(top + _ROWS, height)) for top in range(0, height, _ROWS))
