"""Chart and tables of detail: triangles against errors and times, light map sizes against error and
time, and the knee of the curve.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from iclnuim.report.charts import COLOURS
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from .detail import Level, knee
from .detail_maps import MapSize
from .detail_unseen import Unseen

_HEADER = (
    "detail",
    "triangles",
    "mean depth error mm",
    "99 % mm",
    "off > 5 mm",
    "build s",
    "PSNR dB",
    "bake s",
    "frame s",
)
_MAPS = ("map", "bake s", "PSNR dB to the largest", "median of 255", "frame s")


def figure(rooms: dict[str, list[Level]], maps: dict[str, list[MapSize]]) -> Figure:
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


def _times(axes: Axes, levels: Sequence[Level], style: dict) -> None:
    for what, line in (("build_s", ":"), ("bake_s", "-"), ("frame_s", "--")):
        some = [level for level in levels if level.light] if what == "bake_s" else levels
        values = [getattr(level.light if what == "bake_s" else level, what) for level in some]
        label = f"{style['label']}: {what.removesuffix('_s')}" if some else None
        axes.plot(_x(some), values, line, marker=".", color=style["color"], label=label)


def _sizes(axes: Axes, row: Sequence[MapSize], style: dict) -> None:
    compared = [m for m in row if m.psnr_db is not None]
    largest = "".join(f", {m.size}: {m.bake_s:.0f} s" for m in row if m.psnr_db is None)
    axes.plot(
        [m.size for m in compared],
        [m.psnr_db or 0.0 for m in compared],
        "o-",
        color=style["color"],
        label=style["label"] + largest,
    )
    for m in compared:
        axes.annotate(
            f"{m.bake_s:.0f} s",
            (m.size, m.psnr_db),
            xytext=(8, -4),
            textcoords="offset points",
            fontsize=8,
        )


def _x(levels: Sequence[Level]) -> list[float]:
    return [level.triangles / 1000 for level in levels]


def _depth(axes: Axes, levels: Sequence[Level], style: dict, label_at: tuple[int, int]) -> None:
    shown = [level for level in levels if level.mean_m > 0]
    axes.plot(
        _x(shown),
        [1e3 * level.mean_m for level in shown],
        marker="o",
        markerfacecolor="white",
        **style,
    )
    for level in shown:
        axes.annotate(
            f"{level.detail:g}",
            (level.triangles / 1000, 1e3 * level.mean_m),
            xytext=label_at,
            textcoords="offset points",
            fontsize=8,
        )
    axes.margins(y=0.1)
    default = [level for level in shown if level.detail == 1.0]
    axes.plot(_x(default), [1e3 * level.mean_m for level in default], "o", color=style["color"])
    at = levels[knee_of(levels)]
    axes.plot(
        _x([at]),
        [1e3 * at.mean_m],
        "o",
        markersize=14,
        markerfacecolor="none",
        markeredgecolor=style["color"],
    )


def _label(panels: Sequence[Axes]) -> None:
    titles = (
        {
            "ylabel": "mean depth error against the finest level (mm)",
            "yscale": "log",
            "title": "numbers: detail; filled: default; ring: knee",
        },
        {
            "ylabel": "PSNR against the finest level (dB)",
            "title": "colour, lit by a lamp at the camera",
        },
        {"ylabel": "seconds", "yscale": "log", "title": "times"},
        {
            "ylabel": "PSNR against the largest map (dB)",
            "xscale": "log",
            "title": "light map; numbers: time of the bake",
        },
    )
    for axes, texts in zip(panels, titles, strict=False):
        axes.set(
            xlabel="size of the light map (texels)" if "xscale" in texts else "thousand triangles",
            **texts,
        )
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize=8)
    if len(panels) == len(titles):
        _name_sizes(panels[-1])


def _name_sizes(axes: Axes) -> None:
    sizes = sorted({int(x) for line in axes.lines for x in np.asarray(line.get_xdata())})
    axes.margins(x=0.25)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(sizes, labels=map(str, sizes))


def knee_of(levels: Sequence[Level]) -> int:
    """Index of the level at the knee of depth error against triangles."""
    return knee([level.triangles for level in levels], [level.mean_m for level in levels])


def table(levels: Sequence[Level]) -> str:
    """One row per level, in Markdown; the knee is marked."""
    marked = knee_of(levels)
    return "\n".join(
        [
            _line(_HEADER),
            _line(["---"] * len(_HEADER)),
            *(_row(v, k == marked) for k, v in enumerate(levels)),
        ]
    )


def _row(level: Level, is_knee: bool) -> str:
    light = level.light
    return _line(
        (
            f"{level.detail:g}{' (knee)' if is_knee else ''}",
            f"{level.triangles:,}",
            f"{1e3 * level.mean_m:.3f}",
            f"{1e3 * level.p99_m:.2f}",
            f"{level.off_share:.2%}",
            f"{level.build_s:.1f}",
            "" if level.psnr_db is None else f"{level.psnr_db:.1f}",
            f"{light.bake_s:.0f}" if light else "",
            f"{level.frame_s:.3f}",
        )
    )


def maps_table(row: Sequence[MapSize]) -> str:
    """One row per size of the light map, in Markdown."""
    lines = [_line(_MAPS), _line(["---"] * len(_MAPS))]
    for m in row:
        compared = m.psnr_db is not None
        lines.append(
            _line(
                (
                    m.size,
                    f"{m.bake_s:.0f}",
                    f"{m.psnr_db:.1f}" if compared else "",
                    f"{m.median_of_255:.2f}" if compared else "",
                    f"{m.frame_s:.3f}",
                )
            )
        )
    return "\n".join(lines)


def unseen_line(share: Unseen) -> str:
    """A sentence about the parts that are never seen."""
    texels = (
        "" if share.texels is None else f", {share.texels:.1%} of the used texels of the light map"
    )
    return f"{share.room}: no shipped trajectory sees {share.triangles:.1%} of the triangles, {share.surface:.1%} of the surface{texels} ({share.poses} poses)"


def _line(cells: Sequence[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"
