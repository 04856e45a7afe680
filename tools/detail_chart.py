"""Chart of detail: triangles against errors and times, light map sizes against error and
time, and the knee of the curve.
"""

from collections.abc import Sequence

import numpy as np
from iclnuim.report.charts import COLOURS
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from .detail import DetailLevel, knee
from .detail_maps import MapSize


def figure(rooms: dict[str, list[DetailLevel]], maps: dict[str, list[MapSize]]) -> Figure:
    """Depth error, colour error and times against triangles; colour error against light map size,
    if it was measured.

    A ring marks the knee, a filled dot the default.
    """
    with_maps = any(maps.values())
    drawn = Figure(figsize=(12, 7.6) if with_maps else (15, 4.6), layout="constrained")
    FigureCanvasAgg(drawn)
    panels = drawn.subplots(*((2, 2) if with_maps else (1, 3))).ravel()
    for k, (room, levels) in enumerate(rooms.items()):
        style = {"color": COLOURS[k], "label": room.replace("_", " ")}
        _depth(panels[0], levels, style, label_at=((5, 4), (-8, -13))[k % 2])
        compared = [level for level in levels if level.psnr_db is not None]
        panels[1].plot(_x(compared), [level.psnr_db for level in compared], marker="o", **style)
        _times(panels[2], levels, style)
        if with_maps:
            _sizes(panels[3], maps[room], style)
    _label(panels)
    return drawn


def _times(axes: Axes, levels: Sequence[DetailLevel], style: dict) -> None:
    lit = [level for level in levels if level.light]
    bake_s = [level.light.bake_s for level in levels if level.light]
    lines = [
        ("build", ":", levels, [level.build_s for level in levels]),
        ("bake", "-", lit, bake_s),
        ("frame", "--", levels, [level.frame_s for level in levels]),
    ]
    for what, line, some, seconds in lines:
        label = f"{style['label']}: {what}" if some else None
        axes.plot(_x(some), seconds, line, marker=".", color=style["color"], label=label)


def _sizes(axes: Axes, row: Sequence[MapSize], style: dict) -> None:
    compared = [m for m in row if m.psnr_db is not None]
    largest = "".join(f", {m.size}: {m.bake_s:.0f} s" for m in row if m.psnr_db is None)
    sizes = [m.size for m in compared]
    psnr_db = [m.psnr_db or 0.0 for m in compared]
    axes.plot(sizes, psnr_db, "o-", color=style["color"], label=style["label"] + largest)
    for m, at in zip(compared, zip(sizes, psnr_db, strict=True), strict=True):
        _annotate(axes, f"{m.bake_s:.0f} s", at, (8, -4))


def _annotate(axes: Axes, text: str, at: tuple[float, float], by: tuple[int, int]) -> None:
    axes.annotate(text, at, xytext=by, textcoords="offset points", fontsize=8)


def _x(levels: Sequence[DetailLevel]) -> list[float]:
    return [level.triangles / 1000 for level in levels]


def _mean_mm(levels: Sequence[DetailLevel]) -> list[float]:
    return [1e3 * level.mean_m for level in levels]


def _depth(
    axes: Axes, levels: Sequence[DetailLevel], style: dict, label_at: tuple[int, int]
) -> None:
    shown = [level for level in levels if level.mean_m > 0]
    axes.plot(_x(shown), _mean_mm(shown), marker="o", markerfacecolor="white", **style)
    for level in shown:
        at = (level.triangles / 1000, 1e3 * level.mean_m)
        _annotate(axes, f"{level.detail:g}", at, label_at)
    axes.margins(y=0.1)
    default = [level for level in shown if level.detail == 1.0]
    axes.plot(_x(default), _mean_mm(default), "o", color=style["color"])
    knee = [levels[knee_of(levels)]]
    ring = {"markersize": 14, "markerfacecolor": "none", "markeredgecolor": style["color"]}
    axes.plot(_x(knee), _mean_mm(knee), "o", **ring)


def _label(panels: Sequence[Axes]) -> None:
    panels[0].set(
        ylabel="mean depth error against the finest level (mm)",
        title="numbers: detail; filled: default; ring: knee",
        yscale="log",
    )
    panels[1].set(
        ylabel="PSNR against the finest level (dB)", title="colour, lit by a lamp at the camera"
    )
    panels[2].set(ylabel="seconds", title="times", yscale="log")
    for axes in panels:
        axes.set(xlabel="thousand triangles")
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize=8)
    for axes in panels[3:]:
        axes.set(
            xlabel="size of the light map (texels)",
            ylabel="PSNR against the largest map (dB)",
            title="light map; numbers: time of the bake",
            xscale="log",
        )
        _name_sizes(axes)


def _name_sizes(axes: Axes) -> None:
    drawn = np.concatenate([np.asarray(line.get_xdata()) for line in axes.lines])
    sizes = np.unique(drawn.astype(int)).tolist()
    axes.margins(x=0.25)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(sizes, labels=map(str, sizes))


def knee_of(levels: Sequence[DetailLevel]) -> int:
    """Index of the level at the knee of depth error against triangles."""
    return knee([level.triangles for level in levels], [level.mean_m for level in levels])
