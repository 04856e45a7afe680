"""Finished frames turned into sequences while others are still being rendered."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from iclnuim.dataset.run_folder import RunFolder
from iclnuim.dataset.sequence import SequenceWriter


class SequenceStage:
    """`add(number)` a rendered frame at any time; `complete()` waits for all, then writes lists and recipes.

    Images are made on `threads` threads; journals are written, pairs read back, and raw frames dropped on one more. The first error
    ends the stage and is raised by `complete` and by `check`.
    """

    def __init__(
        self,
        writer: SequenceWriter,
        raw: RunFolder,
        threads: int,
        keep_raw: bool,
        on_frame: Callable[[int], None] = lambda number: None,
    ) -> None:
        self._writer, self._raw, self._keep_raw, self._on_frame = writer, raw, keep_raw, on_frame
        self._pool = ThreadPoolExecutor(threads)
        self._made: queue.SimpleQueue[Future | None] = queue.SimpleQueue()
        self._error: BaseException | None = None
        self._lacking = set(writer.missing)
        self._thread = threading.Thread(target=self._note_all, daemon=True)
        self._thread.start()

    def add(self, number: int) -> None:
        """A frame whose raw file stands; those whose pairs stand already are dropped."""
        if number in self._lacking:
            self._lacking.remove(number)
            self._pool.submit(self._writer.make, number).add_done_callback(self._made.put)
        elif not self._keep_raw and self._writer.stands(number):
            self._raw.frame_file(number).unlink(missing_ok=True)

    @property
    def broken(self) -> bool:
        """Whether an error has ended it."""
        return self._error is not None

    def close(self) -> None:
        """Finish what was added; raises the first error. Safe to call twice."""
        self._pool.shutdown(wait=True, cancel_futures=self.broken)
        self._made.put(None)
        self._thread.join()
        if self._error is not None:
            raise self._error

    def complete(self) -> None:
        """All frames are in: lists and recipes. Raises InputError, WorkError."""
        self.close()
        self._writer.complete()

    def _note_all(self) -> None:
        while (done := self._made.get()) is not None:
            if self._error is not None or done.cancelled():
                continue
            try:
                number = self._writer.note(done.result())
                if not self._keep_raw and self._writer.stands(number):
                    self._raw.frame_file(number).unlink(missing_ok=True)
                self._on_frame(number)
            except BaseException as error:
                self._error = error
