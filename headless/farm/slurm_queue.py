"""Queries to Slurm: array size, which of our jobs are still in the queue. Whether a frame is done is never asked there."""

import json
import re
import shutil
import subprocess
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from iclnuim.errors import WorkError
from iclnuim.formats.files import write_json

#: Of a Slurm that is not asked, as its own default has it.
MAX_ARRAY_SIZE = 1001
NAMES = {stage: f"iclnuim-{stage}" for stage in ("light", "frames", "dataset")}


@dataclass(frozen=True)
class Submitted:
    """A job that was handed over: its number, stage, and for an array the frames of each task."""

    job: str
    stage: str
    chunks: tuple[tuple[int, ...], ...] = ()

    @property
    def tasks(self) -> dict[str, tuple[int, ...]]:
        """Task as squeue names it -> its frames."""
        if len(self.chunks) == 1:
            return {self.job: self.chunks[0]}
        return {f"{self.job}_{k}": frames for k, frames in enumerate(self.chunks)} or {self.job: ()}


def there() -> bool:
    """Whether Slurm's commands are on the PATH."""
    return all(shutil.which(name) for name in ("sbatch", "srun", "squeue", "scontrol"))


def max_array_size() -> int:
    """Most tasks of an array: MaxArraySize counts from 0. Raises WorkError where Slurm does not answer."""
    found = re.search(r"^MaxArraySize\s*=\s*(\d+)", _ask("scontrol", "show", "config"), re.M)
    return max(1, int(found[1])) if found else MAX_ARRAY_SIZE


def in_queue(jobs: list[Submitted]) -> dict[str, str]:
    """Tasks of `jobs` that wait or run -> their state. Raises WorkError where Slurm does not answer."""
    if not jobs:
        return {}
    lines = _ask("squeue", "-h", "-r", "-o", "%i %T", "--name", ",".join(NAMES.values())).splitlines()
    states = dict(line.split()[:2] for line in lines if len(line.split()) > 1)
    ours = {task for job in jobs for task in job.tasks}
    return {task: state for task, state in states.items() if task in ours}


def counted(states: dict[str, str]) -> str:
    """`3 running, 10 pending`."""
    return ", ".join(f"{n} {state.lower()}" for state, n in sorted(Counter(states.values()).items(), reverse=True))


def cancel(jobs: list[Submitted]) -> None:
    """Those that were handed over before something failed."""
    with suppress(WorkError):
        if jobs:
            _ask("scancel", *(job.job for job in jobs))


def recorded(raw: Path) -> list[Submitted]:
    """Jobs handed over for a run folder so far; none where nothing is recorded."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        content = json.loads(_file(raw).read_text("utf-8"))
        return [Submitted(j["job"], j["stage"], tuple(map(tuple, j["chunks"]))) for j in content["jobs"]]
    return []


def record(raw: Path, jobs: list[Submitted]) -> None:
    """Beside the logs of the jobs."""
    content = [{"job": j.job, "stage": j.stage, "chunks": [list(c) for c in j.chunks]} for j in jobs]
    _file(raw).parent.mkdir(parents=True, exist_ok=True)
    write_json(_file(raw), {"jobs": content})


def last_error(raw: Path) -> str | None:
    """The error of the task that failed last, from the logs beside the frames."""
    logs = sorted((raw / ".farm/slurm").glob("*_log.err"), key=lambda path: path.stat().st_mtime, reverse=True)
    for log in logs:
        if found := re.findall(r"^(?:[\w.]*\.)?\w*Error: (.+)$", log.read_text("utf-8", "replace"), re.M):
            return f"{log.name}: {found[-1]}"
    return None


def _file(raw: Path) -> Path:
    return raw / ".farm/slurm/submitted.json"


def _ask(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        reason = str(error)
    except subprocess.CalledProcessError as error:
        reason = " ".join(error.stderr.split()) or f"exit code {error.returncode}"
    raise WorkError(f"{command[0]}: {reason}; run this where Slurm's commands work")
