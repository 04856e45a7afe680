"""Runs one command in its own process group with a time limit, and measures time and memory.

No process of the group is left running.
"""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from iclnuim.errors import WorkError

#: Interval between two measurements of memory.
_SAMPLE_S = 0.05


@dataclass(frozen=True)
class Ended:
    """Wall time and processor time in seconds, peak memory in bytes (sum over its processes,
    sampled every 50 ms), and how it ended:
    "exit 0", "SIGSEGV", "time limit".
    """

    wall_s: float
    cpu_s: float
    peak_bytes: int
    how: str

    def to_dict(self) -> dict:
        return asdict(self)


def run_command(
    command: list[str],
    folder: Path,
    log: Path,
    limit_s: float,
    environment: Mapping[str, str] | None = None,
) -> Ended:
    """Run a command in `folder`, with its output in `log`. Its process group is killed at the time
    limit, and when the command ends.

    Raises WorkError if it cannot be started. KeyboardInterrupt is re-raised after the group is
    killed.
    """
    started = time.monotonic()
    process = _begun(command, folder, log, {**os.environ, **(environment or {})})
    watch = _ProcessWatch(process.pid, started + limit_s)
    try:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    finally:
        wall_s = time.monotonic() - started
        watch.stop()
        _kill(process.pid)
        if process.returncode is None:
            process.wait()
    peak_bytes = watch.peak_bytes or usage.ru_maxrss * 1024
    how = "time limit" if watch.late else _how(process.returncode)
    return Ended(wall_s, usage.ru_utime + usage.ru_stime, peak_bytes, how)


def _begun(
    command: list[str], folder: Path, log: Path, environment: Mapping[str, str]
) -> subprocess.Popen:
    with open(log, "wb") as output:
        try:
            return subprocess.Popen(
                command,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )
        except OSError as error:
            raise WorkError(f"{command[0]}: cannot be started: {error.strerror or error}") from None


def _how(code: int) -> str:
    return f"exit {code}" if code >= 0 else signal.Signals(-code).name


def _kill(group: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


class _ProcessWatch:
    """A thread that samples the memory of a process and its children, and kills the group at the
    deadline.
    """

    def __init__(self, process: int, deadline: float) -> None:
        self.late = False
        self.peak_bytes = 0
        self._process = process
        self._deadline = deadline
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        while not self.late:
            self.peak_bytes = max(self.peak_bytes, _resident_bytes(self._process))
            if self._over.wait(max(0.0, min(_SAMPLE_S, self._deadline - time.monotonic()))):
                return
            self.late = time.monotonic() >= self._deadline
        _kill(self._process)


def _resident_bytes(process: int) -> int:
    """Resident memory of a process and its children, from Linux's /proc; 0 on other systems."""
    total = 0
    left = [process]
    page = os.sysconf("SC_PAGE_SIZE")
    while left:
        place = Path(f"/proc/{left.pop()}")
        with suppress(OSError, ValueError, IndexError):
            total += int((place / "statm").read_text().split()[1]) * page
            for task in (place / "task").iterdir():
                left += map(int, (task / "children").read_text().split())
    return total
