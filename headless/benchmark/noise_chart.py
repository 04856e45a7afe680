"""Noise models as a chart and as tables: time a frame against likeness to published noisy frames; cost beside the files."""

from collections.abc import Mapping, Sequence

from iclnuim.report.charts import COLOURS
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .noise_times import PairTime

Figures = Mapping[str, Mapping[str, float]]


def figure(pairs: Sequence[PairTime], times_ms: Figures, overlaps: Figures | None) -> Figure:
    """Left, with `overlaps`: each model's time and overlap; right: clean and noisy frames over their files alone."""
    drawn = Figure(figsize=(11, 4.4) if overlaps else (5.5, 4.4), layout="constrained")
    FigureCanvasAgg(drawn)
    if overlaps:
        left, right = drawn.subplots(1, 2, width_ratios=(1.25, 1))
        _draw_models(left, times_ms, overlaps)
    else:
        right = drawn.subplots()
    _draw_pairs(right, pairs)
    return drawn


def _draw_models(axes: Axes, times_ms: Figures, overlaps: Figures) -> None:
    for kind, label, colour, marker, below in (
        ("depth", "depth", COLOURS[0], "o", -12),
        ("rgb", "RGB", COLOURS[1], "s", 6),
    ):
        points = {name: (times_ms[kind][name], overlaps[kind][name]) for name in times_ms[kind]}
        axes.plot(*zip(*points.values(), strict=True), marker, color=colour, label=label)
        for name, point in points.items():
            axes.annotate(name, point, xytext=(5, below), textcoords="offset points", fontsize=9, color=colour)
    axes.set(xlabel="ms a frame, 640 x 480, one thread", ylabel="overlap with the noise of the official frames")
    axes.set_xlim(0, 1.25 * max(max(t.values()) for t in times_ms.values()))
    axes.set_ylim(0, 1.08)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")


def _draw_pairs(axes: Axes, pairs: Sequence[PairTime]) -> None:
    names = [f"{p.depth}\n+ {p.rgb}" for p in pairs]
    axes.bar(names, [p.cpu_ratio for p in pairs], color=COLOURS[4], width=0.6)
    axes.axhline(1, color="black", linewidth=0.8)
    axes.axhline(1.6, color=COLOURS[1], linewidth=1, linestyle="--")
    for k, p in enumerate(pairs):
        axes.annotate(f"{p.cpu_ratio:.2f}\n{p.cpu_ms:.0f} ms", (k, 0.5), ha="center", fontsize=9)
    axes.set_ylabel("processor time of clean + noisy over that\nof EXR read and PNGs written alone")
    axes.tick_params(axis="x", labelsize=8)


def table(pairs: Sequence[PairTime], times_ms: Figures, overlaps: Figures | None) -> str:
    """Two tables in Markdown: pairs, then models."""
    rows = [("depth + RGB", "frames/s", "over files alone", "processor ms a frame", "over files alone")]
    for p in pairs:
        times = (f"{p.frames_per_s:.1f}", f"{p.ratio:.2f}", f"{p.cpu_ms:.0f}", f"{p.cpu_ratio:.2f}")
        rows.append((f"{p.depth} + {p.rgb}", *times))
    models = [("model", "ms a frame", "overlap with the official noise")]
    for kind, by_name in times_ms.items():
        for name, ms in by_name.items():
            models.append((f"{kind} {name}", f"{ms:.1f}", f"{overlaps[kind][name]:.3f}" if overlaps else ""))
    return "\n\n".join("\n".join(map(_line, [t[0], ["---"] * len(t[0]), *t[1:]])) for t in (rows, models))


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
