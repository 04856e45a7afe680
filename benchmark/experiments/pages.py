"""Writes tables and heat maps: a picture, and one HTML page with a section for each method."""

import html
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from iclnuim.formats.files import atomic_write_text, write_json

from ..perturbations.plan import SEVERITIES
from .summary import Group, Summary, noticed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Limits of the colour scale of the ATE in millimetres; it is logarithmic.
_COLOURS_MM = (0.1, 100.0)
#: Colours from small to large; they are distinguishable without colour vision and in grey.
_SHADES = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")


def write(summary: Summary, out: Path) -> None:
    """Write stress.json and stress.html into the folder."""
    write_json(out / "stress.json", summary.to_dict())
    atomic_write_text(out / "stress.html", page(summary))


def figure(summary: Summary) -> "Figure":
    """A panel for each method, with a row per perturbation and a column per severity.

    Cells show the ATE as colour and number, or a cross for a failure.
    """
    from matplotlib.colors import LinearSegmentedColormap, LogNorm
    from matplotlib.figure import Figure

    methods, names = summary.methods, summary.perturbations
    columns = min(5, len(methods))
    rows = -(-len(methods) // columns)
    drawing = Figure(
        figsize=(2.6 * columns + 2.2, (0.26 * len(names) + 0.8) * rows + 0.5), layout="constrained"
    )
    panels = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    norm, colours, image = (
        LogNorm(*_COLOURS_MM),
        LinearSegmentedColormap.from_list("ate", _SHADES),
        None,
    )
    for axes, method in zip(panels.flat, methods, strict=False):
        groups = [summary.row(method, p) for p in names]
        values = np.array([[_ate_mm(g) for g in row] for row in groups])
        image = axes.imshow(values, colours, norm, aspect="auto")
        for y, row in enumerate(groups):
            for x, g in enumerate(row):
                if g is not None:
                    axes.text(
                        x,
                        y,
                        _mark(g),
                        ha="center",
                        va="center",
                        fontsize=6.5,
                        color=_ink(_ate_mm(g)),
                    )
        axes.set_title(method.removeprefix("baseline:"), fontsize=9)
        axes.set_xticks(range(SEVERITIES + 1))
        axes.tick_params(labelbottom=True)
        axes.set_yticks(range(len(names)), labels=[n.replace("_", " ") for n in names], fontsize=8)
    for axes in panels.flat[len(methods) :]:
        axes.set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("severity")
    if image is not None:
        drawing.colorbar(
            image,
            ax=panels,
            label="ATE [mm]; \u00d7: failure, !: failure not noticed",
            shrink=0.6,
            extend="both",
        )
    return drawing


def _ate_mm(group: Group | None) -> float:
    if group is None:
        return math.nan
    value_mm = math.inf if group.ate_m is None else 1e3 * group.ate_m
    return float(np.clip(max(value_mm, _COLOURS_MM[1]) if group.failed else value_mm, *_COLOURS_MM))


def _mark(group: Group) -> str:
    failed = "\u00d7" if group.failed or group.ate_m is None else f"{1e3 * group.ate_m:.2g}"
    return failed + ("!" if group.failed and group.false_successes > 0 else "")


def _place(ate_mm: float) -> float:
    """Position 0..1 on the colour scale."""
    low, high = np.log(_COLOURS_MM)
    return float((np.log(ate_mm) - low) / (high - low))


def _ink(ate_mm: float) -> str:
    """Text colour that is readable on the colour of an ATE."""
    return "black" if _place(ate_mm) > 0.55 else "white"


def page(summary: Summary) -> str:
    """The whole page as one file without scripts: an overview, then a section for each method."""
    parts = [_overview(summary), *(_method(summary, method) for method in summary.methods)]
    return _HEAD + "\n".join(parts) + "\n</body>\n</html>\n"


def _overview(summary: Summary) -> str:
    links = "".join(
        f'<th><a href="#{_id(m)}">{_text(m.removeprefix("baseline:"))}</a></th>'
        for m in summary.methods
    )
    rows = []
    for p in summary.perturbations:
        cells = "".join(_break_cell(summary, m, p) for m in summary.methods)
        rows.append(f"<tr><th>{_text(p.replace('_', ' '))}</th>{cells}</tr>")
    for title, values in summary.totals().items():
        rows.append(
            f"<tr class='total'><th>{title}</th>{''.join(f'<td>{v}</td>' for v in values)}</tr>"
        )
    return (
        "<h1>Where methods fail</h1>\n<p>The lowest severity at which at least half of the segments fail. A segment fails if the ATE is above "
        f"{1e3 * summary.plan.bounds.success_m:g} mm, or if less than {summary.plan.bounds.min_coverage:.0%} of the frames have a pose. "
        "A dash means that no severity fails. In the tables below, a number is the median ATE in mm; \u00d7 is a failure; ! means that the method also reports wrong poses as good.</p>\n"
        f"<div class='wide'><table><tr><th></th>{links}</tr>\n{chr(10).join(rows)}</table></div>{_relatives(summary)}"
    )


def _relatives(summary: Summary) -> str:
    rows = [
        f"<tr><th>{_text(ours)}</th><td>{good}</td><td class='left'>{_text(other)}</td><td>{theirs}</td><td>{total}</td>"
        f"<td class='left'>{_text(', '.join(alone).replace('_', ' '))}</td></tr>"
        for ours, other, total, good, theirs, alone in summary.relatives()
    ]
    head = "<tr><th>ours</th><th>succeeds in</th><th>third-party method</th><th>succeeds in</th><th>cells</th><th>only the third-party method succeeds</th></tr>"
    return (
        f"<h2>Comparison with third-party methods</h2><div class='wide'><table>{head}{''.join(rows)}</table></div>"
        if rows
        else ""
    )


def _break_cell(summary: Summary, method: str, name: str) -> str:
    mark = summary.mark(method, name)
    style = f" style='{_style(_COLOURS_MM[1] / 4 ** int(mark))}'" if mark.isdecimal() else ""
    return f"<td{style}>{mark}</td>"


def _method(summary: Summary, method: str) -> str:
    rows = []
    for name in summary.perturbations:
        groups, p = summary.row(method, name), summary.plan.perturbations[name]
        cells = []
        for k, g in enumerate(groups):
            level = p.level(k) if k else "unperturbed"
            if g is None:
                cells.append("<td></td>")
                continue
            tooltip = _text(f"{level}: {g.in_words()}")
            cells.append(f"<td style='{_style(_ate_mm(g))}' title='{tooltip}'>{_mark(g)}</td>")
        rows.append(
            f"<tr><th title='{_text(p.about)}'>{_text(name.replace('_', ' '))}</th>{''.join(cells)}{_verdict(summary, method, name)}</tr>"
        )
    severities = "".join(f"<th>{k}</th>" for k in range(SEVERITIES + 1))
    head = f"<tr><th></th>{severities}<th>fails at</th><th>failure noticed</th><th>diagnosed cause</th></tr>"
    return f"<h2 id='{_id(method)}'>{_text(method)}</h2>\n<div class='wide'><table>{head}\n{chr(10).join(rows)}</table></div>"


def _verdict(summary: Summary, method: str, name: str) -> str:
    """Three cells: the level at which the method fails, whether it notices, and the diagnosed
    cause.
    """
    severity = summary.breaks_at(method, name)
    if severity is None:
        return "<td class='left'>-</td><td></td><td></td>"
    group = summary.row(method, name)[severity]
    assert group is not None
    level = summary.plan.perturbations[name].level(severity) if severity else "unperturbed"
    notice = "" if group.noticed is None else noticed(group)
    return "".join(f"<td class='left'>{_text(text)}</td>" for text in (level, notice, group.cause))


def _style(ate_mm: float) -> str:
    position = _place(ate_mm) * (len(_SHADES) - 1)
    k = min(int(position), len(_SHADES) - 2)
    pair = zip(*(bytes.fromhex(_SHADES[i][1:]) for i in (k, k + 1)), strict=True)
    r, g, b = (round(x + (y - x) * (position - k)) for x, y in pair)
    return f"background:rgb({r},{g},{b});color:{_ink(ate_mm)}"


def _id(method: str) -> str:
    return method.replace(":", "-")


def _text(text: str) -> str:
    return html.escape(text, quote=True)


_HEAD = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>ICL-NUIM: where methods fail</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; color: #111; background: #fff }
h1 { font-size: 1.6rem } h2 { font-size: 1.2rem; margin-top: 2.5rem }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.85rem }
th, td { padding: 0.15rem 0.5rem; text-align: center; border: 1px solid #ddd; white-space: nowrap }
th:first-child { text-align: left } .left { text-align: left; white-space: normal } .total { background: #f4f4f4 }
a { color: #0072b2 }
@media print { h2 { break-before: page } td { print-color-adjust: exact; -webkit-print-color-adjust: exact } }
</style>
</head>
<body>
"""
