"""Blender's chatter kept off standard output. Does not import bpy, whose very import may print."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def blender_output_in(log: Path) -> Iterator[None]:
    """Blender prints dozens of lines a frame, from C, on file descriptor 1: send that to `log`; Python's sys.stdout stays."""
    _flush()
    saved_descriptor, saved_stdout = os.dup(1), sys.stdout
    sink = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644)
    os.dup2(sink, 1)
    os.close(sink)
    sys.stdout = os.fdopen(os.dup(saved_descriptor), "w", encoding="utf-8", buffering=1)
    try:
        yield
    finally:
        sys.stdout.close()
        sys.stdout = saved_stdout
        _flush()
        os.dup2(saved_descriptor, 1)
        os.close(saved_descriptor)


def _flush() -> None:
    """Python's buffer and the C library's, in which Blender's lines may still lie when descriptors change."""
    sys.stdout.flush()
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).fflush(None)
