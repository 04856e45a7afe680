"""Locks an output folder for one command at a time, also on shared file systems: a lock file with
host, process and heartbeat.
"""

import json
import os
import platform
import threading
import time
import uuid
from contextlib import suppress
from pathlib import Path

from iclnuim.errors import WorkError
from iclnuim.formats.files import not_written, process_is_running

#: The holder touches the lock file every BEAT_S seconds. For other hosts, a file that was not
#: touched for STALE_S is stale.
BEAT_S = 5.0
STALE_S = 90.0


class OutputLock:
    """Lock, used as `with OutputLock(folder):`. Raises WorkError, which names the process that
    holds the lock already.

    The file is created by a hard link, which is atomic on NFS too.
    """

    def __init__(self, folder: Path) -> None:
        self.path = Path(folder) / "lock"
        self._mine = {
            "host": platform.node(),
            "pid": os.getpid(),
            "born": _born(os.getpid()),
            "token": uuid.uuid4().hex,
        }
        self._end = threading.Event()

    def __enter__(self) -> "OutputLock":
        self.path.parent.mkdir(parents=True, exist_ok=True)
        while not self._take():
            holder = self._holder()
            if holder is not None and self._lives(holder):
                process = f"process {holder.get('pid')} on {holder.get('host')}"
                raise WorkError(
                    f"{self.path.parent.parent}: {process} is already using this folder",
                    hint="waiting for it, stopping it, or another {out}",
                )
            if holder is not None:
                self._remove_stale(holder)
        threading.Thread(target=self._beat, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._end.set()
        if self.held():
            self.path.unlink(missing_ok=True)

    def held(self) -> bool:
        """Whether this process still holds the lock, which it may lose if it is suspended for more
        than STALE_S.
        """
        return (self._holder() or {}).get("token") == self._mine["token"]

    def living_holder(self) -> dict | None:
        """Host and process that hold the lock and are alive; None if the lock is free or stale."""
        holder = self._holder()
        if holder and self._lives(holder):
            return holder
        return None

    def _take(self) -> bool:
        draft = self.path.with_name(f".{self.path.name}-{self._mine['token']}")
        content = json.dumps(self._mine) + "\n"
        try:
            draft.write_text(content, "utf-8")
            try:
                os.link(draft, self.path)
            except FileExistsError:
                return False
            except OSError:  # a file system without links
                with open(self.path, "x", encoding="utf-8") as file:
                    file.write(content)
            return True
        except FileExistsError:
            return False
        except OSError as error:
            raise not_written(self.path, error) from error
        finally:
            draft.unlink(missing_ok=True)

    def _holder(self) -> dict | None:
        """The content of the file; {} if it cannot be read, None if it does not exist."""
        try:
            return dict(json.loads(self.path.read_text("utf-8")))
        except FileNotFoundError:
            return None
        except (ValueError, TypeError, OSError):
            return {}

    def _lives(self, holder: dict) -> bool:
        if holder.get("host") == self._mine["host"] and isinstance(holder.get("pid"), int):
            return _born(holder["pid"]) == holder.get("born") is not None
        return self._age_s(self.path) < STALE_S

    def _age_s(self, path: Path) -> float:
        """Seconds since a file was touched, both times from the file server's clock; 0 if it no
        longer exists.
        """
        probe = self.path.with_name(f".clock-{self._mine['token']}")
        try:
            probe.touch()
            return probe.stat().st_mtime - path.stat().st_mtime
        except FileNotFoundError:
            return 0.0
        finally:
            probe.unlink(missing_ok=True)

    def _remove_stale(self, holder: dict) -> None:
        """Remove a stale lock.

        Only one process does this at a time, and it reads the lock again first; otherwise it could
        remove a new holder's lock.
        """
        guard = self.path.with_name(f".{self.path.name}-removal")
        try:
            os.close(os.open(guard, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
        except FileExistsError:  # another process is removing it, or ended while doing so
            time.sleep(0.05)
            if self._age_s(guard) > STALE_S:
                guard.unlink(missing_ok=True)
            return
        try:
            if self._holder() == holder:
                self.path.unlink(missing_ok=True)
        finally:
            guard.unlink(missing_ok=True)

    def _beat(self) -> None:
        while not self._end.wait(BEAT_S):
            with suppress(OSError):
                os.utime(self.path)


def _born(pid: int) -> str | None:
    """Start time of a process on this host, as counted by the kernel; None if it has ended.

    Process numbers are reused, start times are not.
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        if fields[0] != "Z":
            return fields[19]
    except (OSError, IndexError):
        if not Path("/proc/self/stat").exists() and process_is_running(pid):
            return "unknown"
    return None
