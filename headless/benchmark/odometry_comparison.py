"""Odometers on the same frames in one run: time, error, and which of them no other beats in both; as text and as a chart."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.errors import InputError
from iclnuim.formats.files import read_json
from iclnuim.odometry.registry import odometer
from iclnuim.odometry.run import Sequence, run_together, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


def figure(results: list[dict]) -> "Figure":
    """ATE over time a frame: a dot at the median, a line to the 95th percentile, the front dashed."""
    from iclnuim.report.charts import COLOURS
    from matplotlib.figure import Figure

    columns = min(len(results), 4)
    rows = -(-len(results) // columns)
    drawing = Figure(figsize=(4.2 * columns + 1.5, 4.0 * rows), layout="constrained")
    panels = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, result in zip(panels.flat, results, strict=False):
        best, not_beaten = [], front(result["runs"])
        for i, d in enumerate(result["runs"]):
            if d["ate_rmse_m"] is None:
                continue
            ate_mm, marker = d["ate_rmse_m"] * 1e3, "s" if d["odometer"].startswith("baseline:") else "o"
            colour = COLOURS[i % len(COLOURS)]
            axes.plot([d["ms_median"], d["ms_95"]], [ate_mm, ate_mm], color=colour, linewidth=1)
            axes.plot(d["ms_median"], ate_mm, marker, color=colour, label=d["odometer"], linestyle="")
            if d["odometer"] in not_beaten:
                best.append((d["ms_median"], ate_mm))
        axes.plot(*zip(*sorted(best), strict=True), "--", color="grey", linewidth=0.8)
        axes.set(xscale="log", yscale="log", title=result["sequence"])
        axes.set_xticks([5, 10, 20, 50, 100, 200], labels=["5", "10", "20", "50", "100", "200"])
        axes.xaxis.set_minor_formatter("")
        axes.yaxis.set_minor_formatter("")
        axes.grid(alpha=0.3)
    for axes in panels[-1]:
        axes.set_xlabel("ms a frame: median, line to 95 %")
    for axes in panels[:, 0]:
        axes.set_ylabel("ATE RMSE [mm]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside right upper", fontsize=8)
    return drawing
