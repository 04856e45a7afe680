"""Blender's chatter kept off standard output and standard error. Does not import bpy, whose very import may print."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def blender_output_in(log: Path, errors: bool = True) -> Iterator[None]:
    """Blender prints dozens of lines a frame, from C, on file descriptor 1, and USD its warnings on 2: send those to `log`.

    Python's sys.stdout and sys.stderr stay. errors: False leaves descriptor 2 alone, as in a process whose own log that is.
    """
    _flush()
    names = ("stdout", "stderr")[: 1 + errors]
    saved = {name: (os.dup(number), getattr(sys, name)) for number, name in enumerate(names, 1)}
    sink = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644)
    for number, (name, (descriptor, stream)) in enumerate(saved.items(), 1):
        os.dup2(sink, number)
        if name == "stdout" or _is_on(stream, number):  # a stream in memory is none of Blender's
            setattr(sys, name, os.fdopen(os.dup(descriptor), "w", encoding="utf-8", buffering=1))
    os.close(sink)
    try:
        yield
    finally:
        _flush()
        for number, (name, (descriptor, stream)) in enumerate(saved.items(), 1):
            if getattr(sys, name) is not stream:
                getattr(sys, name).close()
                setattr(sys, name, stream)
            os.dup2(descriptor, number)
            os.close(descriptor)


def _is_on(stream: object, number: int) -> bool:
    with suppress(OSError, AttributeError):
        return stream.fileno() == number  # type: ignore[attr-defined]
    return False


def _flush() -> None:
    """Python's buffers and the C library's, in which Blender's lines may still lie when descriptors change."""
    sys.stdout.flush()
    sys.stderr.flush()
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).fflush(None)
