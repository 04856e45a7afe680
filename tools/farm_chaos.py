"""Chaos test: `make` is repeatedly killed, stopped and left without disk space, and the same
command resumes it; the result is compared with an undisturbed run.
"""

import contextlib
import json
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from iclnuim.errors import WorkError
from iclnuim.sequences.run_folder import read_run
from iclnuim.worker_client import CHILD

#: Number of new frames that must be finished before each disturbance.
FRAMES_BETWEEN = 3
#: Timeout of a worker; it is shorter than the default, as a worker is stopped on purpose.
STUCK_AFTER_S = 10


@dataclass(frozen=True)
class Damage:
    """State after all disturbances. frames: number of requested frames. broken: images that are
    incomplete or differ. lost: images that are missing or empty.

    twice: frames finished more than once. outlived: workers that still run half a minute after
    their command was killed. names: broken or lost files.
    """

    frames: int
    kills: int
    broken: int
    lost: int
    twice: int = 0
    outlived: int = 0
    events: dict[str, int] = field(default_factory=dict)
    names: tuple[str, ...] = ()

    @property
    def none(self) -> bool:
        return not (self.broken or self.lost or self.twice or self.outlived)


def kinds(kills: int) -> list[str]:
    """The sequence of disturbances: kills of a worker, of the parent, and of both in turn, with one
    full disk and one stopped worker in between.
    """
    found = [("worker", "parent", "both")[k % 3] for k in range(kills)]
    found.insert(len(found) // 4, "full")
    found.insert(len(found) // 2, "stop")
    return found


class Chaos:
    """Runs `make SEQUENCE OPTIONS` into `out`, disturbed at random moments drawn from `rng`.

    Raises WorkError if the command does not behave as guaranteed.
    """

    def __init__(
        self, sequence: str, options: tuple[str, ...], out: Path, rng: np.random.Generator
    ) -> None:
        self.out = Path(out)
        self._rng = rng
        self._command = [sys.executable, "-m", "iclnuim", "make", sequence, *options]
        self._command += ["--worker-timeout", str(STUCK_AFTER_S), "--out", str(self.out)]
        self._orphans: list[psutil.Process] = []
        self.happened: Counter[str] = Counter()

    def start(self, **options: Any) -> subprocess.Popen:
        """Start the command."""
        return subprocess.Popen(
            self._command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **options
        )

    def run(self, disturbances: list[str], note: Callable[[str], None]) -> None:
        """Start the command once for each disturbance, then run it to its end."""
        for kind in disturbances:
            self.disturb(kind)
            self.happened[kind] += 1
            count = sum(self.happened.values())
            note(
                f"{count} of {len(disturbances)}: {kind}; {len(finished(self.out))} frames finished"
            )
        self.complete()

    def complete(self) -> None:
        """Run the command undisturbed. Raises WorkError if it fails."""
        parent = self.start()
        errors = parent.communicate()[1]
        if parent.returncode:
            code = f"an undisturbed command ended with code {parent.returncode}"
            raise WorkError(f"{code}: {errors.strip()[-500:]}")

    def disturb(self, kind: str) -> None:
        """Start the command, and disturb it at a random moment after three more frames."""
        if kind == "full":
            self._fill_the_disk()
            return
        parent = self.start()
        self._wait_for_frames(parent)
        time.sleep(self._rng.uniform(0, 0.3))
        workers = children(parent)
        victim = workers[int(self._rng.integers(len(workers)))] if workers else None
        with contextlib.suppress(psutil.NoSuchProcess):
            if kind == "stop" and victim:
                victim.send_signal(signal.SIGSTOP)
            if kind in ("worker", "both") and victim:
                victim.kill()
        if kind in ("parent", "both"):
            parent.kill()
            self._orphans += workers
        else:
            self._recover(kind, parent, victim)
        parent.wait(120)
        if parent.stderr:
            parent.stderr.close()

    def _recover(self, kind: str, parent: subprocess.Popen, victim: psutil.Process | None) -> None:
        """Check that a command that lost a worker continues, and ends cleanly after Ctrl-C."""
        self._wait_for_frames(parent)
        if kind == "stop" and victim and still_there([victim], STUCK_AFTER_S + 20):
            raise WorkError("a stopped worker was not replaced")
        parent.send_signal(signal.SIGINT)
        errors = parent.communicate(timeout=120)[1]
        if parent.returncode not in (0, 130) or "Traceback" in errors:
            raise WorkError(f"code {parent.returncode} after Ctrl-C: {errors.strip()[-500:]}")

    def _fill_the_disk(self) -> None:
        """Limit the size of the command's files to a fraction of a frame.

        The command must report this in one line, with exit code 3.
        """
        camera = read_run(self.out / "raw").camera
        limit = (camera.width * camera.height * 2,) * 2
        parent = self.start(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit))
        errors = parent.communicate(timeout=600)[1]
        if parent.returncode != 3 or "cannot write" not in errors or "Traceback" in errors:
            raise WorkError(f"code {parent.returncode} on a full disk: {errors.strip()[-500:]}")

    def _wait_for_frames(self, parent: subprocess.Popen, seconds: float = 600) -> None:
        """Wait until three more frames are finished, without those of workers whose parent was
        killed.
        """
        orphans = {process.pid for process in self._orphans}
        before = len(finished(self.out))
        until = time.monotonic() + seconds
        while sum(pid not in orphans for _, pid in finished(self.out)[before:]) < FRAMES_BETWEEN:
            if parent.poll() is not None:
                errors = parent.communicate()[1].strip()[-300:]
                ended = f"the command ended (code {parent.returncode})"
                raise WorkError(f"{ended} before it could be disturbed: {errors}")
            if time.monotonic() > until:
                raise WorkError(f"fewer than {FRAMES_BETWEEN} new frames in {seconds:.0f} s")
            time.sleep(0.02)

    def damage(self, undisturbed: Path) -> Damage:
        """Compare the output with that of the same command without disturbances."""
        ours = contents(self.out)
        whole = contents(undisturbed)
        names = sorted(n for n in ours.keys() | whole.keys() if ours.get(n) != whole.get(n))
        times = Counter(number for number, _ in finished(self.out))
        return Damage(
            frames=sum(name.startswith("clean/rgb/") for name in whole),
            kills=sum(self.happened[kind] for kind in ("worker", "parent", "both")),
            broken=len({Path(name).name for name in names if name in ours}),
            lost=len({Path(name).name for name in names if name not in ours}),
            twice=sum(count > 1 for count in times.values()),
            outlived=len(still_there(self._orphans, 30)),
            events=dict(self.happened),
            names=tuple(names),
        )


def finished(out: Path) -> list[tuple[int, int]]:
    """(frame, process that finished it), in the order of the workers' journal."""
    journal = out / "raw/.farm/finished.jsonl"
    if not journal.exists():
        return []
    found = []
    for line in journal.read_text("utf-8", "replace").split("\n")[:-1]:
        with contextlib.suppress(ValueError):
            entry = json.loads(line)
            found.append((entry["frame"], entry["pid"]))
    return found


def contents(out: Path) -> dict[str, bytes]:
    """Every file of both sequences.

    The recorded commit is removed, as it may change between the runs and decides no pixel.
    """
    files = [*(out / "clean").rglob("*"), *(out / "noisy").rglob("*")]
    found = {str(p.relative_to(out)): p.read_bytes() for p in files if p.is_file()}
    for name in ("clean/recipe.json", "noisy/recipe.json"):
        recipe = json.loads(found.get(name, b'{"source": {"run": {}}}'))
        recipe.pop("source_commit", None)
        recipe["source"]["run"].pop("source_commit", None)
        found[name] = json.dumps(recipe).encode()
    return found


def children(parent: subprocess.Popen) -> list[psutil.Process]:
    """The workers of a command, without the processes that write images of its sequences; none if
    the command has ended.
    """
    with contextlib.suppress(psutil.NoSuchProcess):
        return [p for p in psutil.Process(parent.pid).children() if str(CHILD) in p.cmdline()]
    return []


def still_there(processes: list[psutil.Process], seconds: float) -> list[psutil.Process]:
    """The processes that still run after this time."""
    return psutil.wait_procs(processes, timeout=seconds)[1]
