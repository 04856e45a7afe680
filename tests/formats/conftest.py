"""A full disk, played by the limit on a file's size."""

import contextlib
import resource
import signal

import pytest


@pytest.fixture
def file_size_limit():
    """`with file_size_limit(n):` lets no file of this process grow beyond n bytes."""

    @contextlib.contextmanager
    def limited(size):
        old = resource.getrlimit(resource.RLIMIT_FSIZE)
        handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, old[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, old)
            signal.signal(signal.SIGXFSZ, handler)

    return limited
