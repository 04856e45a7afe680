"""Time against error of odometers, one panel a sequence."""

from iclnuim.report.charts import COLOURS
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from .odometry_comparison import front


def figure(results: list[dict]) -> Figure:
    """ATE over time a frame: a dot at the median, a line to the 95th percentile, the front dashed."""
    columns = min(len(results), 4)
    rows = -(-len(results) // columns)
    drawing = Figure(figsize=(4.2 * columns + 1.5, 4.0 * rows), layout="constrained")
    FigureCanvasAgg(drawing)
    panels = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for i, result in enumerate(results):
        _panel(panels[i // columns][i % columns], result)
    for axes in panels[-1]:
        axes.set_xlabel("ms a frame: median, line to 95 %")
    for axes in panels[:, 0]:
        axes.set_ylabel("ATE RMSE [mm]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside right upper", fontsize=8)
    return drawing


def _panel(axes: Axes, result: dict) -> None:
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
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
