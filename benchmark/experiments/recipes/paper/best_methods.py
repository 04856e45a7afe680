"""Which method has the least trajectory error under which condition: a room, clean or noisy."""

from collections.abc import Mapping, Sequence
from statistics import geometric_mean, median
from typing import TYPE_CHECKING

from ...cell import Measured
from ...table import ResultTable, mm
from .figures import ate_of
from .keys import PaperKey

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Columns of panels of the chart.
_COLUMNS = 2
#: An ATE counts from this share of the frames on: one of the frames that were easy is no result.
_COVERED = 0.9
#: Room and noise.
Condition = tuple[str, str]
#: Method -> its ATE in metres on each sequence, the median over runs and noise seeds.
Errors = Mapping[str, Mapping[str, float]]


def errors_by_condition(
    results: Sequence[Measured],
) -> dict[Condition, dict[str, dict[str, float]]]:
    """Condition -> method -> ATE in metres on each sequence. Only methods that have an error on all
    of the condition's sequences, of nearly all frames.
    """
    runs: dict[Condition, dict[str, dict[str, list[float]]]] = {}
    for result in results:
        key = result.key
        ate_m = ate_of(result.figures)
        covers = result.figures.get("coverage", 1.0) >= _COVERED
        if ate_m is not None and covers:
            of_method = runs.setdefault((key.room, key.noise), {}).setdefault(method_name(key), {})
            of_method.setdefault(key.trajectory, []).append(ate_m)
    found = {}
    for condition, of_methods in sorted(runs.items()):
        longest = max(map(len, of_methods.values()))
        whole = {name: of for name, of in of_methods.items() if len(of) == longest}
        found[condition] = {name: _medians(of) for name, of in whole.items()}
    return found


def _medians(runs: Mapping[str, list[float]]) -> dict[str, float]:
    return {sequence: median(ate_m) for sequence, ate_m in runs.items()}


def method_name(key: PaperKey) -> str:
    """`icp`; with what is not the default: `icp, paper, model`."""
    words = [key.odometer, *({key.preset} - {"best"}), *({key.reference} - {"default"})]
    return words[0] if key.external else ", ".join(words)


def means(errors: Errors) -> list[tuple[float, str]]:
    """The geometric mean of the ATE over the sequences in metres, and the method; least first."""
    return sorted((geometric_mean(of.values()), name) for name, of in errors.items())


def _times(ratio: float) -> str:
    return f"{ratio:.2f}" if ratio < 10 else f"{ratio:,.0f}"


def best_methods_table(results: Sequence[Measured]) -> ResultTable:
    """A row for each condition with several methods: the best one, the next, and the worst."""
    rows = []
    for (room, noise), errors in errors_by_condition(results).items():
        ranked = means(errors)
        if len(ranked) < 2:
            continue
        best_m, best = ranked[0]
        places = []
        for mean_m, name in (ranked[1], ranked[-1]):
            places.append(f"{name}: {_times(mean_m / best_m)} times")
        sequences = len(errors[best])
        rows.append((f"{room.replace('_', ' ')}, {noise}", best, mm(best_m), *places, sequences))
    texts = tuple(tuple(map(str, row)) for row in rows)
    columns = ("condition", "best method", "ATE mm", "next", "worst", "sequences")
    title = "The method with the least trajectory error, by condition"
    notes = (
        "Geometric mean of the ATE over the sequences; of runs and of noise seeds the median.",
        f"Without trajectories that cover less than {_COVERED:.0%} of the frames.",
    )
    return ResultTable("best_methods", title, columns, texts, notes=notes)


def accuracy_figure(results: Sequence[Measured]) -> "Figure":
    """A chart of the ATE: a panel for each condition, with the most accurate method on top, a dot for each sequence and a line at the mean. Needs at least one cell
    with an ATE.
    """
    from iclnuim.shown import COLOURS
    from matplotlib.figure import Figure

    conditions = errors_by_condition(results)
    columns = min(_COLUMNS, len(conditions))
    rows = -(-len(conditions) // columns)
    most = max(map(len, conditions.values()))
    size = (5.0 * columns, (0.24 * most + 0.9) * rows)
    drawing = Figure(figsize=size, layout="constrained")
    panels = drawing.subplots(rows, columns, sharex=True, squeeze=False).flat
    for axes in panels[len(conditions) :]:
        axes.set_visible(False)
    for axes in panels[len(conditions) - columns : len(conditions)]:
        axes.tick_params(labelbottom=True)
    for axes, (condition, errors) in zip(panels, conditions.items(), strict=False):
        ranked = means(errors)
        for y, (mean_m, name) in enumerate(ranked):
            errors_mm = [1e3 * ate_m for ate_m in errors[name].values()]
            axes.plot(errors_mm, [y] * len(errors_mm), "o", color=COLOURS[0], markersize=4)
            axes.plot(1e3 * mean_m, y, "|", color=COLOURS[1], markersize=13, markeredgewidth=2)
        axes.set_yticks(range(len(ranked)), labels=[name for _, name in ranked], fontsize=8)
        axes.set(title=", ".join(condition).replace("_", " "), xscale="log")
        axes.set_ylim(len(ranked) - 0.5, -0.5)
        axes.grid(alpha=0.3, axis="x")
    drawing.supxlabel("ATE RMSE [mm]: a dot for each sequence, a line at the mean", fontsize=9)
    return drawing
