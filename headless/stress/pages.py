"""What came of all cells: a table for the terminal, heat maps as a picture, and one HTML page with a part for each method."""

import html
import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from iclnuim.formats.files import atomic_write_text, write_json
from iclnuim.odometry.registry import BASELINES

from .matrix import CLEAN, Matrix
from .plan import SEVERITIES, Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Odometers of ours -> third-party ones of the same kind.
RELATIVES = {
    "fovis": ("run:fovis",),
    "rgbd": ("baseline:opencv-rgbd", "baseline:open3d-intensity"),
    "dvo": ("run:dvo",),
    "icp": ("baseline:opencv-icp", "baseline:open3d-plane"),
    "icp_rgbd": ("baseline:opencv-rgbd-icp",),
}
#: Ends of the colours of an ATE, in millimetres, on a logarithmic scale.
_COLOURS_MM = (0.1, 100.0)
#: Colours from small to large, told apart also without colour vision and in grey.
_SHADES = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")


@dataclass(frozen=True)
class Group:
    """The cells of a method, a perturbation and a severity, over all stretches. ate_m: median, None where half or more have none.

    succeeded, false_successes, false_alarms, noticed: shares, of stretches, of frames twice, of the stretches with a wrong pose; None where
    there is nothing to count. noticed_after: median frames. nees: mean. cause: the most frequent.
    """

    stretches: int
    ate_m: float | None
    succeeded: float
    coverage: float
    worst_step_m: float | None
    false_successes: float
    false_alarms: float
    alarms: float
    noticed: float | None
    noticed_after: float | None
    nees: float | None
    cause: str

    @classmethod
    def of(cls, cells: list[dict[str, Any]]) -> "Group":
        after = [max(1, c["frames"] - 1) for c in cells]
        wrong = [c for c in cells if c["wrong"]]
        noticed = [c["noticed_after"] for c in wrong if c["noticed_after"] is not None]
        causes = Counter(c["cause"] for c in cells if c["cause"])
        nees = [c["nees"] for c in cells if c["nees"] is not None]
        shares = {k: sum(c[k] for c in cells) / sum(after) for k in ("false_successes", "false_alarms", "alarms")}
        return cls(
            stretches=len(cells),
            ate_m=_median(c["ate_m"] for c in cells),
            succeeded=float(np.mean([c["success"] for c in cells])),
            coverage=float(np.mean([c["coverage"] for c in cells])),
            worst_step_m=_median(c["worst_step_m"] for c in cells),
            **shares,
            noticed=len(noticed) / len(wrong) if wrong else None,
            noticed_after=float(np.median(noticed)) if noticed else None,
            nees=float(np.mean(nees)) if nees else None,
            cause=causes.most_common(1)[0][0] if causes else "",
        )

    @property
    def failed(self) -> bool:
        """Whether half of the stretches or more did not succeed."""
        return self.succeeded <= 0.5

    def in_words(self) -> str:
        """All figures, for a tooltip."""
        parts = [
            f"ATE {_mm(self.ate_m)} mm",
            f"{self.succeeded:.0%} of {self.stretches} stretches succeeded",
            f"coverage {self.coverage:.0%}",
            f"worst step {_mm(self.worst_step_m)} mm",
            f"false successes {self.false_successes:.1%}",
            f"false alarms {self.false_alarms:.1%}",
            f"alarms {self.alarms:.1%}",
        ]
        parts += [] if self.nees is None else [f"NEES {self.nees:.2g}"]
        parts += [] if self.noticed is None else [_noticed(self)]
        return "; ".join([*parts, *([self.cause] if self.cause else [])])


def _median(values: Iterable[float | None]) -> float | None:
    middle = float(np.median([math.inf if v is None else v for v in values]))
    return middle if math.isfinite(middle) else None


def _mm(value_m: float | None) -> str:
    return "-" if value_m is None else f"{1e3 * value_m:.3g}"


def _noticed(group: Group) -> str:
    if not group.noticed:
        return "does not notice"
    return f"notices in {group.noticed:.0%}, after {group.noticed_after:.0f} frames"


@dataclass(frozen=True, eq=False)
class Summary:
    """Groups by method, perturbation and severity; the unperturbed one is CLEAN, 0."""

    plan: Plan
    methods: list[str]
    perturbations: tuple[str, ...]
    cells: dict[tuple[str, str, int], Group]

    @classmethod
    def of(cls, matrix: Matrix) -> "Summary":
        found: dict[tuple[str, str, int], list[dict]] = defaultdict(list)
        for (task, name), figures in matrix.cells().items():
            found[name, task.perturbation, task.severity].append(figures)
        methods = [name for name in matrix.names if any(key[0] == name for key in found)]
        return cls(matrix.plan, methods, matrix.perturbations, {key: Group.of(some) for key, some in found.items()})

    def row(self, method: str, perturbation: str) -> list[Group | None]:
        """Severities 0 to 5."""
        clean = self.cells.get((method, CLEAN, 0))
        return [clean, *(self.cells.get((method, perturbation, k)) for k in range(1, SEVERITIES + 1))]

    def breaks_at(self, method: str, perturbation: str) -> int | None:
        """The mildest severity at which it fails, 0 where it fails unperturbed; None where it never does."""
        return next((k for k, g in enumerate(self.row(method, perturbation)) if g and g.failed), None)

    def mark(self, method: str, perturbation: str) -> str:
        """The severity, a dash for none, nothing where it was not measured."""
        severity = self.breaks_at(method, perturbation)
        return str(severity) if severity is not None else "-" if any(self.row(method, perturbation)[1:]) else ""

    def to_dict(self) -> dict[str, Any]:
        """For --json and OUT/stress.json."""
        keys = ("method", "perturbation", "severity")
        return {"cells": [{**dict(zip(keys, key, strict=True)), **asdict(g)} for key, g in self.cells.items()]}

    def text(self) -> str:
        """From which severity on each method fails, a line for each perturbation, and totals."""
        short = [name.removeprefix("baseline:") for name in self.methods]
        width = max(map(len, (*self.perturbations, "clean: false alarms")))
        lines = [f"{'fails from severity':<{width}}  {'  '.join(short)}"]
        for p in self.perturbations:
            marks = [self.mark(m, p) for m in self.methods]
            cells = [f"{mark:>{len(name)}}" for mark, name in zip(marks, short, strict=True)]
            lines.append(f"{p:<{width}}  {'  '.join(cells)}")
        for title, values in self.totals().items():
            cells = [f"{v:>{len(name)}}" for v, name in zip(values, short, strict=True)]
            lines.append(f"{title:<{width}}  {'  '.join(cells)}")
        for ours, other, total, good, theirs, alone in self.relatives():
            where = f"; it alone in {', '.join(alone)}" if alone else ""
            lines.append(f"{ours} succeeds in {good} of {total} cells, {other} in {theirs}{where}")
        return "\n".join(lines)

    def calibration(self) -> str:
        """Of third-party odometers alone: how much the median error of those that judge it grows, and how many fail at the end.

        A run that fails counts as any growth.
        """
        limits, lines, met = self.plan.calibration, [], 0
        for name in self.perturbations:
            growth = [self._growth(name, k) for k in (1, 2)]
            readers = self._readers(name)
            last = [self.row(m, name)[SEVERITIES] for m in readers]
            failed = sum(g.failed for g in last if g)
            good = growth[0] >= limits.growth_at_1 and growth[1] >= limits.growth_at_2 and 2 * failed > len(readers)
            met += good
            figures = "".join(f"{value:>9.3g}" for value in growth)
            lines.append(
                f"{name:<18}{figures}{f'{failed} of {len(readers)}':>10}  {'' if good else 'too mild'}".rstrip()
            )
        head = f"{'median growth at':<18}{'1':>9}{'2':>9}{'fail at 5':>10}"
        return "\n".join([head, *lines, f"{met} of {len(lines)} perturbations are as strong as asked for"])

    def _readers(self, name: str) -> list[str]:
        """Third-party odometers of this summary that judge a perturbation."""
        blind = self.plan.calibration.depth_alone if self.plan.perturbations[name].judged_by == "colour" else ()
        return [m for m in self.methods if m in BASELINES and m not in blind]

    def _growth(self, name: str, severity: int) -> float:
        """Median over the readers of ATE by unperturbed ATE; NaN where a cell is missing."""
        ratios = []
        for method in self._readers(name):
            clean, group = (self.row(method, name)[k] for k in (0, severity))
            if clean is None or group is None or clean.ate_m is None:
                return math.nan
            ratios.append(math.inf if group.failed or group.ate_m is None else group.ate_m / clean.ate_m)
        return float(np.median(ratios)) if ratios else math.nan

    def relatives(self) -> list[tuple[str, str, int, int, int, list[str]]]:
        """Ours, a third-party relative, perturbed cells that both have, those in which each succeeded, and where the relative alone did."""
        found = []
        for ours, other in ((m, r) for m in self.methods for r in RELATIVES.get(m, ()) if r in self.methods):
            pairs = {key[1:]: (g, self.cells.get((other, *key[1:]))) for key, g in self.cells.items() if key[0] == ours}
            both = {key: (g, h) for key, (g, h) in pairs.items() if h and key[0] != CLEAN}
            good = sum(not g.failed for g, _ in both.values())
            theirs = sum(not h.failed for _, h in both.values())
            alone = [f"{name} {severity}" for (name, severity), (g, h) in both.items() if g.failed and not h.failed]
            found.append((ours, other, len(both), good, theirs, alone))
        return found

    def totals(self) -> dict[str, list[str]]:
        """Of each method, in their order."""
        by_method = {m: [g for (name, p, _), g in self.cells.items() if name == m and p != CLEAN] for m in self.methods}
        cleans = [self.cells.get((m, CLEAN, 0)) for m in self.methods]
        some = [by_method[m] for m in self.methods]
        nees = ["-" if c is None or c.nees is None else f"{c.nees:.2g}" for c in cleans]
        return {
            "clean: ATE [mm]": [_mm(c.ate_m if c else None) for c in cleans],
            "clean: false alarms": ["-" if c is None else f"{c.false_alarms:.1%}" for c in cleans],
            "clean: NEES": nees,
            "succeeded": [_share([g.succeeded for g in groups]) for groups in some],
            "false successes": [_share([g.false_successes for g in groups]) for groups in some],
            "false alarms": [_share([g.false_alarms for g in groups]) for groups in some],
        }


def _share(values: list[float]) -> str:
    return f"{np.mean(values):.1%}" if values else "-"


def write(summary: Summary, out: Path) -> None:
    """stress.json and stress.html in the folder."""
    write_json(out / "stress.json", summary.to_dict())
    atomic_write_text(out / "stress.html", page(summary))


def figure(summary: Summary) -> "Figure":
    """A panel for each method: perturbations down, severities across, ATE as colour and number; a cross where it fails."""
    from matplotlib.colors import LinearSegmentedColormap, LogNorm
    from matplotlib.figure import Figure

    methods, names = summary.methods, summary.perturbations
    columns = min(5, len(methods))
    rows = -(-len(methods) // columns)
    drawing = Figure(figsize=(2.6 * columns + 2.2, (0.26 * len(names) + 0.8) * rows + 0.5), layout="constrained")
    panels = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    norm, colours, image = LogNorm(*_COLOURS_MM), LinearSegmentedColormap.from_list("ate", _SHADES), None
    for axes, method in zip(panels.flat, methods, strict=False):
        groups = [summary.row(method, p) for p in names]
        values = np.array([[_ate_mm(g) for g in row] for row in groups])
        image = axes.imshow(values, colours, norm, aspect="auto")
        for y, row in enumerate(groups):
            for x, g in enumerate(row):
                if g is not None:
                    axes.text(x, y, _mark(g), ha="center", va="center", fontsize=6.5, color=_ink(_ate_mm(g)))
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
            image, ax=panels, label="ATE [mm]; \u00d7: fails, !: without noticing", shrink=0.6, extend="both"
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
    """0..1 on the scale of colours."""
    low, high = np.log(_COLOURS_MM)
    return float((np.log(ate_mm) - low) / (high - low))


def _ink(ate_mm: float) -> str:
    """A text's colour on that of an ATE."""
    return "black" if _place(ate_mm) > 0.55 else "white"


def page(summary: Summary) -> str:
    """All in one file, without scripts: an overview, then a part for each method."""
    parts = [_overview(summary), *(_method(summary, method) for method in summary.methods)]
    return _HEAD + "\n".join(parts) + "\n</body>\n</html>\n"


def _overview(summary: Summary) -> str:
    links = "".join(f'<th><a href="#{_id(m)}">{_text(m.removeprefix("baseline:"))}</a></th>' for m in summary.methods)
    rows = []
    for p in summary.perturbations:
        cells = "".join(_break_cell(summary, m, p) for m in summary.methods)
        rows.append(f"<tr><th>{_text(p.replace('_', ' '))}</th>{cells}</tr>")
    for title, values in summary.totals().items():
        rows.append(f"<tr class='total'><th>{title}</th>{''.join(f'<td>{v}</td>' for v in values)}</tr>")
    return (
        "<h1>Where methods fail</h1>\n<p>The mildest severity at which half of the stretches or more fail: ATE above "
        f"{1e3 * summary.plan.bounds.success_m:g} mm, or poses for less than {summary.plan.bounds.min_coverage:.0%} of the frames. "
        "A dash: none of the five. In the tables below a number is the median ATE in mm; \u00d7: it fails, !: and calls poses good that are wrong.</p>\n"
        f"<div class='wide'><table><tr><th></th>{links}</tr>\n{chr(10).join(rows)}</table></div>{_relatives(summary)}"
    )


def _relatives(summary: Summary) -> str:
    rows = [
        f"<tr><th>{_text(ours)}</th><td>{good}</td><td class='left'>{_text(other)}</td><td>{theirs}</td><td>{total}</td>"
        f"<td class='left'>{_text(', '.join(alone).replace('_', ' '))}</td></tr>"
        for ours, other, total, good, theirs, alone in summary.relatives()
    ]
    head = "<tr><th>ours</th><th>succeeds in</th><th>third-party relative</th><th>succeeds in</th><th>cells</th><th>it alone</th></tr>"
    return (
        f"<h2>Beside third-party relatives</h2><div class='wide'><table>{head}{''.join(rows)}</table></div>"
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
            level = p.level(k) if k else "as rendered"
            if g is None:
                cells.append("<td></td>")
                continue
            told = _text(f"{level}: {g.in_words()}")
            cells.append(f"<td style='{_style(_ate_mm(g))}' title='{told}'>{_mark(g)}</td>")
        rows.append(
            f"<tr><th title='{_text(p.about)}'>{_text(name.replace('_', ' '))}</th>{''.join(cells)}{_verdict(summary, method, name)}</tr>"
        )
    severities = "".join(f"<th>{k}</th>" for k in range(SEVERITIES + 1))
    head = f"<tr><th></th>{severities}<th>breaks at</th><th>does it notice</th><th>what its diagnostics say</th></tr>"
    return f"<h2 id='{_id(method)}'>{_text(method)}</h2>\n<div class='wide'><table>{head}\n{chr(10).join(rows)}</table></div>"


def _verdict(summary: Summary, method: str, name: str) -> str:
    """What breaks it, from when on, whether it notices."""
    severity = summary.breaks_at(method, name)
    if severity is None:
        return "<td class='left'>-</td><td></td><td></td>"
    group = summary.row(method, name)[severity]
    assert group is not None
    level = summary.plan.perturbations[name].level(severity) if severity else "as rendered"
    noticed = "" if group.noticed is None else _noticed(group)
    return "".join(f"<td class='left'>{_text(text)}</td>" for text in (level, noticed, group.cause))


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
