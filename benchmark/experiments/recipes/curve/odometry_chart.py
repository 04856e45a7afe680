"""Chart and Pareto front of `iclnuim bench odometry`: ATE over time per frame."""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from iclnuim.report.charts import pareto_front
from matplotlib.figure import Figure

from .error_chart import ErrorChart, look

#: A sequence with its runs, as in the output of --json.
Comparison = Mapping[str, Any]


def front(runs: Sequence[Mapping[str, Any]]) -> list[str]:
    """The Pareto front: names of the runs that no other run beats in both median time and error."""
    known = [run for run in runs if _has_point(run)]
    best = pareto_front([(run["ms_median"], run["ate_rmse_m"]) for run in known])
    return [known[k]["odometer"] for k in best]


def _has_point(run: Mapping[str, Any]) -> bool:
    return run["ate_rmse_m"] is not None and run["ms_median"] is not None


def figure(results: Sequence[Comparison]) -> Figure:
    """A dot at the median and a line to the 95th percentile; for several runs of a system, whose
    times are those of the whole process, a triangle and the quartiles of the ATE.
    """
    chart = ErrorChart([result["sequence"] for result in results], 4, 3.4)
    runs = chain.from_iterable(result["runs"] for result in results)
    methods = list(dict.fromkeys(run["odometer"] for run in runs))
    for result in results:
        axes = chart.panels[result["sequence"]]
        points = []
        for run in filter(_has_point, result["runs"]):
            style = {**look(run["odometer"], methods), "linestyle": ""}
            ms = run["ms_median"]
            ate_mm = 1e3 * run["ate_rmse_m"]
            if "runs" in run:
                style["marker"] = "^"
                ends = [[ms, ms], [1e3 * ate_m for ate_m in run["ate_quartiles_m"]]]
            else:
                ends = [[ms, run["ms_95"]], [ate_mm, ate_mm]]
            axes.plot(*ends, color=style["color"], linewidth=1)
            (chart.shown[run["odometer"]],) = axes.plot(ms, ate_mm, **style)
            points.append((ms, ate_mm))
        chart.front(result["sequence"], points)
    return chart.close("ms per frame: median, line to 95 % (triangles: whole process)")
