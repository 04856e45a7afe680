"""Accuracy beside speed: what each method costs under each condition, as a table and as a chart."""

from collections.abc import Sequence
from statistics import geometric_mean, median
from typing import TYPE_CHECKING

from ...cell import Measured
from ...intervals import log_interval
from ...table import ResultTable, shown
from .best_methods import Condition, errors_by_condition, method_name
from .figures import surface_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Columns of panels of the chart.
_COLUMNS = 2


def _costs(results: Sequence[Measured]) -> dict[tuple[Condition, str], dict[str, list[float]]]:
    """Condition and method -> the figures of its cells: ms a frame, core-seconds, MB."""
    found: dict[tuple[Condition, str], dict[str, list[float]]] = {}
    for result in results:
        key = result.key
        of = found.setdefault(((key.room, key.noise), method_name(key)), {})
        times = result.figures.get("times", {})
        cell = {name: times.get(name) for name in ("cpu_s", "peak_mb")}
        if "track_s" in times:
            cell["track_ms"] = 1e3 * times["track_s"] / result.figures["frames"]
        for name, value in cell.items():
            if value is not None:
                of.setdefault(name, []).append(value)
    return found


def _surfaces(results: Sequence[Measured]) -> dict[tuple[Condition, str], dict[str, list[float]]]:
    """Condition and method -> the surface errors of its cells in metres, by trajectory."""
    found: dict[tuple[Condition, str], dict[str, list[float]]] = {}
    for result in results:
        key = result.key
        surface_m = surface_of(result.figures)
        if surface_m is not None:
            of = found.setdefault(((key.room, key.noise), method_name(key)), {})
            of.setdefault(key.trajectory, []).append(surface_m)
    return found


def speed_table(results: Sequence[Measured]) -> ResultTable:
    """One row per condition and method, the most accurate first; medians over sequences and
    seeds.
    """
    costs = _costs(results)
    surfaces = _surfaces(results)
    rows = []
    for condition, errors in errors_by_condition(results).items():
        ranked = sorted((geometric_mean(of.values()), name) for name, of in errors.items())
        for ate_m, name in ranked:
            own = costs[condition, name]
            mid = {figure: median(values) for figure, values in own.items()}
            there = surfaces.get((condition, name), {})
            whole = there.keys() >= errors[name].keys()
            surface_m = median(sum(there.values(), [])) if whole else None
            texts = (
                shown(ate_m, ".3g", 1e3),
                shown(surface_m, ".3g", 1e3),
                shown(mid.get("track_ms"), ".1f"),
                shown(mid.get("cpu_s"), ".0f"),
                shown(mid.get("peak_mb"), ".0f"),
            )
            rows.append((" ".join(condition).replace("_", " "), name, *texts))
    columns = ("condition", "method", "ATE mm", "surface mm", "ms a frame", "core-s", "MB")
    notes = (
        "ATE: geometric mean over the sequences. Medians: surface, processor time of a tracked "
        "frame on one core, core-seconds and largest memory of a cell. A dash: not measured; "
        "of a surface, not on all of the sequences.",
    )
    return ResultTable("speed", "Accuracy beside speed.", columns, tuple(rows), notes=notes)


def speed_figure(results: Sequence[Measured]) -> "Figure | None":
    """A panel for each condition: ATE with its 95 % interval over the sequences against ms a frame,
    and a line through the methods that none beats in both. None without times.
    """
    from iclnuim.report.charts import pareto_panel, spread_labels
    from matplotlib.figure import Figure

    costs = _costs(results)
    panels = {}
    for condition, errors in errors_by_condition(results).items():
        points = []
        for name, of in errors.items():
            times = costs[condition, name].get("track_ms")
            if times:
                points.append((name, median(times), *log_interval(list(of.values()))))
        if points:
            panels[condition] = points
    if not panels:
        return None
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    drawing = Figure(figsize=(5.4 * columns, 3.6 * rows), layout="constrained")
    grid = drawing.subplots(rows, columns, squeeze=False).flat
    for axes, (condition, points) in zip(grid, panels.items(), strict=False):
        in_mm = [(p[0], p[1], 1e3 * p[2], 1e3 * p[3], 1e3 * p[4]) for p in points]
        pareto_panel(axes, in_mm)
        axes.set(title=", ".join(condition).replace("_", " "))
        axes.set_ylabel("ATE RMSE [mm], \u2193 is better", fontsize=8)
    for axes in list(drawing.axes)[len(panels) :]:
        axes.set_visible(False)
    drawing.supxlabel("processor time of a frame on one core [ms], \u2190 is better", fontsize=9)
    spread_labels(drawing)
    return drawing
