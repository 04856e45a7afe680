"""The jobs that were submitted to Slurm for a run folder: their record, and their state in the
queue.
"""

import json
import re
import subprocess
from collections import Counter
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from iclnuim.errors import WorkError
from iclnuim.formats.files import write_json

from .chunks import Chunk

#: Record of the submitted jobs, relative to the run folder, next to their logs.
_SUBMITTED = ".farm/slurm/submitted.json"
#: The last line of a traceback.
_ERROR = re.compile(r"^(?:[\w.]*\.)?\w*Error: (.+)$", re.MULTILINE)
#: stage -> name of its jobs
NAMES = {stage: f"iclnuim-{stage}" for stage in ("simulations", "light", "frames", "dataset")}


@dataclass(frozen=True)
class Submitted:
    """A submitted job: its number, its stage, and for an array the frames of each task."""

    job: str
    stage: str
    chunks: tuple[Chunk, ...] = ()

    @property
    def tasks(self) -> dict[str, Chunk]:
        """Name of a task in squeue -> its frames."""
        if not self.chunks:
            return {self.job: ()}
        if len(self.chunks) == 1:
            return {self.job: self.chunks[0]}
        return {f"{self.job}_{k}": frames for k, frames in enumerate(self.chunks)}


def in_queue(jobs: list[Submitted]) -> dict[str, str]:
    """Tasks of `jobs` that wait or run -> their state.

    Raises WorkError if Slurm does not answer.
    """
    if not jobs:
        return {}
    names = ",".join(NAMES.values())
    lines = query(["squeue", "-h", "-r", "-o", "%i %T", "--name", names]).splitlines()
    states = dict(line.split()[:2] for line in lines if len(line.split()) > 1)
    ours = set().union(*(job.tasks for job in jobs))
    return {task: state for task, state in states.items() if task in ours}


def counted(states: dict[str, str]) -> str:
    """Number of tasks by state, such as `3 running, 10 pending`."""
    counts = sorted(Counter(states.values()).items(), reverse=True)
    return ", ".join(f"{count} {state.lower()}" for state, count in counts)


def recorded(raw: Path) -> list[Submitted]:
    """Jobs submitted so far for a run folder; none if nothing is recorded."""
    jobs = []
    with suppress(OSError, ValueError, KeyError, TypeError):
        for job in json.loads((raw / _SUBMITTED).read_text("utf-8"))["jobs"]:
            jobs.append(Submitted(job["job"], job["stage"], tuple(map(tuple, job["chunks"]))))
    return jobs


def record(raw: Path, jobs: list[Submitted]) -> None:
    """Record the jobs submitted so far."""
    (raw / _SUBMITTED).parent.mkdir(parents=True, exist_ok=True)
    write_json(raw / _SUBMITTED, {"jobs": [asdict(job) for job in jobs]})


def last_error(raw: Path) -> str | None:
    """The error of the task that failed last, from the logs in the run folder."""
    logs = (raw / ".farm/slurm").glob("*_log.err")
    for log in sorted(logs, key=lambda path: path.stat().st_mtime, reverse=True):
        found = _ERROR.findall(log.read_text("utf-8", "replace"))
        if found:
            return f"{log.name}: {found[-1]}"
    return None


def query(command: list[str]) -> str:
    """What one of Slurm's commands prints. Raises WorkError if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
        return done.stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        reason = str(error)
    except subprocess.CalledProcessError as error:
        reason = " ".join(error.stderr.split()) or f"exit code {error.returncode}"
    raise WorkError(f"{command[0]}: {reason}; run this on a machine where Slurm's commands work")
