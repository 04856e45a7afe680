"""Ours and the peers' odometers on the same frames in one run: time, error, and who is beaten by nobody."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from iclnuim.errors import InputError
from iclnuim.formats.files import read_json
from iclnuim.odometry.frames import Sequence
from iclnuim.odometry.peers import NAMES
from iclnuim.odometry.registry import OURS, odometer
from iclnuim.odometry.report import run_together, table

#: Frames through each odometer beforehand, so that compiling and loading are not timed.
WARM_UP = 3


def names() -> list[str]:
    return [*OURS, *NAMES]


def race(
    sequence: Sequence,
    which: Iterable[str],
    preset: str = "best",
    frames: int | None = None,
    progress: Callable | None = None,
) -> dict:
    """`sequence`, `preset`, and `runs` (Run.to_dict()). Raises InputError without ground truth."""
    which = list(which)
    run_together([odometer(name, preset) for name in which], sequence, frames=WARM_UP)
    runs = run_together([odometer(name, preset) for name in which], sequence, progress=progress, frames=frames)
    if runs[0].truth is None:
        raise InputError("a ground truth in the folder", path=sequence.folder)
    name = "/".join(sequence.folder.resolve().parts[-2:])
    return {"sequence": name, "preset": preset, "runs": [run.to_dict() for run in runs]}


def read(path: Path) -> list[dict]:
    """Races that were written with --json."""
    races = read_json(path).get("races")
    if not isinstance(races, list):
        raise InputError("what `iclnuim bench odometry --json` printed", path=path)
    return races


def front(runs: list[dict]) -> list[str]:
    """Names of those that no other beats in both median time and error."""
    points = [(d["odometer"], d["ms_median"], d["ate_rmse_m"]) for d in runs if d["ate_rmse_m"] is not None]
    return [n for n, ms, ate in points if not any(m <= ms and a <= ate and (m, a) != (ms, ate) for _, m, a in points)]


def text(race: dict) -> str:
    title = f"{race['sequence']}, preset {race['preset']} of ours"
    return f"{title}\n{table(race['runs'])}\nPareto front: {', '.join(front(race['runs']))}"
