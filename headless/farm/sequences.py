"""Finished frames turned into sequences while others are still being rendered."""

from collections.abc import Callable, Iterable

from iclnuim.dataset.frame_pool import FramePool
from iclnuim.dataset.run_folder import RunFolder
from iclnuim.dataset.sequence import JournalEntry, SequenceWriter


class SequenceStage:
    """`add(number)` a rendered frame at any time; `complete()` waits for all, then writes lists and recipes.

    Images are made on `workers` cores; journals are written, pairs read back, and raw frames dropped on the caller's thread, whenever
    it asks for something. The first error ends the stage and is raised by `close` and by `complete`.
    """

    def __init__(
        self,
        writer: SequenceWriter,
        raw: RunFolder,
        workers: int,
        keep_raw: bool,
        on_frame: Callable[[int], None] = lambda number: None,
    ) -> None:
        self._writer, self._raw, self._keep_raw, self._on_frame = writer, raw, keep_raw, on_frame
        self._pool = FramePool(writer.make, workers, self._made)
        self._lacking = set(writer.missing)

    def add(self, number: int) -> None:
        """A frame whose raw file stands; those whose pairs stand already are dropped."""
        if number in self._lacking:
            self._lacking.remove(number)
            self._pool.add(number)
        else:
            self._drop(number)

    def add_finished(self, numbers: Iterable[int]) -> list[int]:
        """Add those of `numbers` that are rendered already; the frames that the sequences still lack then."""
        there = sorted(set(self._raw.frame_numbers()).intersection(numbers))
        finished = set(there).difference(self._raw.missing(there))
        for number in sorted(finished):
            self.add(number)
        return [n for n in self._writer.missing if n not in finished]

    @property
    def broken(self) -> bool:
        """Whether an error has ended it."""
        self._pool.collect()
        return self._pool.failed

    def close(self) -> None:
        """Finish what was added; raises the first error. Safe to call twice."""
        self._pool.close()

    def complete(self) -> None:
        """All frames are in: lists and recipes. Raises InputError, WorkError."""
        self.close()
        self._writer.complete()

    def _made(self, entries: list[JournalEntry | None]) -> None:
        number = self._writer.note(entries)
        self._drop(number)
        self._on_frame(number)

    def _drop(self, number: int) -> None:
        if not self._keep_raw and self._writer.stands(number):
            self._raw.frame_file(number).unlink(missing_ok=True)
