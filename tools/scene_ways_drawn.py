"""The table and the chart of the ways to light scenes, from the rows that tools/scene_ways.py has
stored.
"""

from collections.abc import Sequence
from itertools import groupby

from matplotlib.figure import Figure

from .measured_tables import Rows, words

_HELD_DB = 40.0
Stored = dict[str, str]


def _scenes(rows: Sequence[Stored]) -> list[tuple[str, list[Stored]]]:
    return [(scene, list(group)) for scene, group in groupby(rows, lambda row: row["scene"])]


def _name(row: Stored) -> str:
    return f"map {row['map_size']}" if row["map_size"] else f"path {row['samples']}"


def scene_ways_table(stored: Sequence[Stored]) -> Rows:
    """A row for each scene: the chosen way as announced and measured, and the fastest that holds."""
    rows = []
    for scene, ways in _scenes(stored):
        chosen = next(way for way in ways if way["chosen"] == "1")
        held = [way for way in ways if float(way["psnr_db"]) >= _HELD_DB]
        announced = (
            f"{float(chosen['announced_core_s']):.1f} s, {float(chosen['announced_db']):.1f}"
        )
        measured = f"{float(chosen['core_s']):.1f} s, {float(chosen['psnr_db']):.1f}"
        fastest = "none"
        if held:
            best = min(held, key=lambda way: float(way["core_s"]))
            factor = float(chosen["core_s"]) / float(best["core_s"])
            fastest = f"{_name(best)}, {factor:.2f}"
        share = float(chosen["look_core_s"]) / float(chosen["announced_core_s"])
        rows.append([scene, _name(chosen), announced, measured, fastest, f"{share:.0%}"])
    return words("scene | chosen | announced, dB | measured, dB | fastest, factor | look", rows)


def scene_blocks_table(stored: Sequence[Stored]) -> Rows:
    """A row for each scene: the error against plain Cycles, by some of the ways."""
    names = ("path 1", "path 4", "path 16")
    rows = []
    for scene, ways in _scenes(stored):
        found = {_name(way): way["blocks_db"] for way in ways}
        if any(found.values()):
            rows.append([scene, *(f"{float(found[name]):.1f}" for name in names)])
    return words(" | ".join(("scene", *names)), rows)


def scene_ways_figure(stored: Sequence[Stored]) -> Figure:
    """Core-seconds against PSNR of every way, a colour for each scene."""
    drawing = Figure(figsize=(8, 5.5), layout="constrained")
    axes = drawing.subplots()
    for number, (scene, ways) in enumerate(_scenes(stored)):
        colour = f"C{number}" if number < 10 else "black"
        for light, marker, style in (("path", "o", "-"), ("baked", "s", "")):
            shown = [way for way in ways if way["light"] == light]
            x, y = ([float(way[key]) for way in shown] for key in ("core_s", "psnr_db"))
            label = scene if light == "path" else None
            axes.plot(x, y, linestyle=style, marker=marker, ms=5, color=colour, label=label)
            for way in shown:
                place = float(way["core_s"]), float(way["psnr_db"])
                if way["chosen"] == "1":
                    axes.plot(*place, "o", ms=12, mfc="none", mec=colour, mew=1.5)
                if light == "baked":
                    axes.annotate(
                        way["map_size"],
                        place,
                        color=colour,
                        textcoords="offset points",
                        xytext=(6, -3),
                        fontsize=8,
                    )
    axes.axhline(_HELD_DB, color="grey", lw=1, ls="--")
    axes.set_xscale("log")
    axes.set_xlabel("core-seconds of 60 frames of 160 x 120")
    axes.set_ylabel("PSNR against 1024 samples [dB]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return drawing
