"""Charts of the farm: throughput by split, the model of many machines, and the damage after kills."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from iclnuim.shown import COLOURS
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .farm_model import Model
from .farm_throughput import Throughput

if TYPE_CHECKING:
    from .farm_chaos import Damage


def figure(results: Sequence[Throughput], models: Sequence[Model], nodes: int) -> Figure:
    """Three panels: frames per hour by split; share of a chunk's time lost to start-up, by its
    length; hours for many sequences, by number of machines.
    """
    drawn = Figure(figsize=(14, 4.4), layout="constrained")
    FigureCanvasAgg(drawn)
    rate, lost, scale = drawn.subplots(1, 3)
    _draw_rates(rate, results)
    for model, colour in zip(models, COLOURS, strict=False):
        _draw_start(lost, model, colour)
        _draw_scaling(scale, model, colour, nodes)
    for axes in (lost, scale):
        axes.legend(frameon=False, fontsize=8)
        axes.grid(alpha=0.3)
    return drawn


def _draw_rates(axes: Axes, results: Sequence[Throughput]) -> None:
    splits = list(dict.fromkeys((r.workers, r.threads) for r in results))
    names = list(dict.fromkeys(r.name for r in results))
    width = 0.8 / len(names)
    for k, name in enumerate(names):
        own = [r for r in results if r.name == name]
        best = max(r.frames_an_hour for r in own)
        beside = (k - (len(names) - 1) / 2) * width
        places = [splits.index((r.workers, r.threads)) + beside for r in own]
        heights = [100 * r.frames_an_hour / best for r in own]
        label = f"{name}: 100 % = {best:.0f} per hour"
        bars = axes.bar(places, heights, width, color=COLOURS[k], label=label)
        axes.bar_label(bars, [f"{100 * r.busy_share:.0f} %\nbusy" for r in own], fontsize=7)
    axes.set_xticks(range(len(splits)), [f"{workers} x {threads}" for workers, threads in splits])
    axes.set(
        xlabel="workers x threads", ylabel="frames per hour, % of the best split", ylim=(0, 140)
    )
    axes.legend(frameon=False, loc="upper left", fontsize=8)


def _draw_start(axes: Axes, model: Model, colour: str) -> None:
    seconds = np.geomspace(1, 3600, 100)
    lost = 100 * model.startup_s / (model.startup_s + seconds)
    axes.plot(seconds, lost, color=colour, label=f"{model.name}: start-up {model.startup_s:.1f} s")
    axes.axvline(model.chunk_s, color="grey", linestyle=":", linewidth=1)
    axes.set(xscale="log", ylim=(0, 100), ylabel="% of time lost to start-up")
    axes.set_xlabel(f"seconds of frames in a chunk (dotted: {model.chunk_s:.0f}, as in the model)")


def _draw_scaling(axes: Axes, model: Model, colour: str, nodes: int) -> None:
    counts = np.unique(np.geomspace(1, 1e5, 80).astype(int))
    hours = [model.seconds(int(n)) / 3600 for n in counts]
    label = f"{model.name}: {model.seconds(nodes) / 3600:.2g} h on {nodes}"
    axes.plot(counts, hours, color=colour, label=label)
    limit = model.stops_scaling()[0]
    if limit <= counts[-1]:
        axes.plot(limit, model.seconds(limit) / 3600, "o", color=colour)
    axes.axvline(nodes, color="grey", linestyle=":", linewidth=1)
    axes.set(xscale="log", yscale="log", ylabel=f"hours for {model.sequences} sequences, by model")
    axes.set_xlabel(f"machines (dotted: {nodes}; dot: more do not help)")


def damage_figure(damages: "Mapping[str, Damage]") -> Figure:
    """Chart of broken and lost frames after the same number of kills."""
    drawn = Figure(figsize=(6.5, 3.2), layout="constrained")
    FigureCanvasAgg(drawn)
    axes = drawn.subplots()
    for k, kind in enumerate(("broken", "lost")):
        values = [getattr(d, kind) for d in damages.values()]
        bars = axes.barh(
            np.arange(len(damages)) + 0.38 * (k - 0.5), values, 0.36, color=COLOURS[k], label=kind
        )
        axes.bar_label(bars, padding=3)
    axes.set_yticks(range(len(damages)), damages)
    axes.invert_yaxis()
    first = next(iter(damages.values()))
    kills = f"{first.kills} kill -9, each followed by the same command"
    axes.set_xlabel(f"frames of {first.frames} after {kills}")
    axes.margins(x=0.1)
    axes.legend(frameon=False, loc="center right")
    return drawn
