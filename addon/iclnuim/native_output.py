"""Redirects what Blender and other C libraries print from standard output and standard error to a
log.

It does not import bpy, because that import may print.
"""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def native_output_in(log: Path, errors: bool = True) -> Iterator[None]:
    """Send the output of C code to `log`: Blender prints dozens of lines per frame to file
    descriptor 1, and USD prints warnings to 2.

    Python's sys.stdout and sys.stderr are not redirected. errors: if False, descriptor 2 is not
    redirected either, for a process that has its own log there.
    """
    _flush()
    names = ("stdout", "stderr")[: 1 + errors]
    saved = {name: (os.dup(number), getattr(sys, name)) for number, name in enumerate(names, 1)}
    sink = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644)
    for number, (name, (descriptor, stream)) in enumerate(saved.items(), 1):
        os.dup2(sink, number)
        if name == "stdout" or _is_on(
            stream, number
        ):  # Blender does not write to a stream in memory
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
    """Flush Python's buffers and the C library's, which may still contain Blender's lines when
    descriptors change.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).fflush(None)
