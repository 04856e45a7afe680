"""Odometers on the same frames in one run: time, error, and which of them no other beats in both."""

from collections.abc import Callable
from pathlib import Path

from iclnuim.errors import InputError
from iclnuim.formats.files import read_json
from iclnuim.odometry.registry import odometer
from iclnuim.odometry.run import Sequence, run_together, table

#: Frames through each odometer beforehand, so that compiling and loading are not timed.
WARM_UP = 3


def compare(
    sequence: Sequence,
    names: list[str],
    preset: str = "best",
    frames: int | None = None,
    progress: Callable | None = None,
) -> dict:
    """`sequence`, `preset`, and `runs` (Run.to_dict()). Raises InputError without ground truth."""
    run_together([odometer(name, preset) for name in names], sequence, frames=WARM_UP)
    runs = run_together([odometer(name, preset) for name in names], sequence, progress=progress, frames=frames)
    if runs[0].truth is None:
        raise InputError("a ground truth in the folder", path=sequence.folder)
    name = "/".join(sequence.folder.resolve().parts[-2:])
    return {"sequence": name, "preset": preset, "runs": [run.to_dict() for run in runs]}


def read(path: Path) -> list[dict]:
    """Results that were written with --json, by 0.1.0 too. Raises InputError for another file."""
    results = read_json(path).get("races")
    if not isinstance(results, list):
        raise InputError("what `iclnuim bench odometry --json` printed", path=path)
    for run in (run for result in results for run in result["runs"]):
        run["odometer"] = run["odometer"].replace("peer:", "baseline:")
    return results


def front(runs: list[dict]) -> list[str]:
    """The Pareto front: names of those that no other beats in both median time and error."""
    points = [(d["odometer"], d["ms_median"], d["ate_rmse_m"]) for d in runs if d["ate_rmse_m"] is not None]
    return [n for n, ms, ate in points if not any(m <= ms and a <= ate and (m, a) != (ms, ate) for _, m, a in points)]


def text(result: dict) -> str:
    title = f"{result['sequence']}, preset {result['preset']} of ours"
    return f"{title}\n{table(result['runs'])}\nPareto front: {', '.join(front(result['runs']))}"
