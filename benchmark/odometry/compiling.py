"""Times without those in which numba compiles. Compiled code is kept on disk, so compiling is no
part of the time of a method.
"""

import time
from collections.abc import Callable
from typing import Self

from numba.core.event import TimingListener, register, unregister

_COMPILE = "numba:compile"


class WorkClock(TimingListener):
    """A clock in seconds that does not count compiling while it is used as a context.

    announce() is called before anything is compiled.
    """

    def __init__(self, announce: Callable[[], object] = lambda: None) -> None:
        super().__init__()
        self._announce: Callable[[], object] | None = announce

    def __enter__(self) -> Self:
        register(_COMPILE, self)
        return self

    def __exit__(self, *error: object) -> None:
        unregister(_COMPILE, self)

    def on_start(self, event: object) -> None:
        if self._announce:
            self._announce()
            self._announce = None
        super().on_start(event)

    def __call__(self) -> float:
        return time.perf_counter() - self.compiling_s

    @property
    def compiling_s(self) -> float:
        return self.duration if self.done else 0.0
