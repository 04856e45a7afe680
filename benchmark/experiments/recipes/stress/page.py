"""The page of `iclnuim stress`: which perturbation breaks which method, what it looks like, the
errors by severity, success beside speed, and every figure of each method.
"""

from pathlib import Path

from iclnuim.settings import plain
from markupsafe import Markup, escape

from ....perturbations.plan import CLEAN
from ...drawn import Dot, DrawnCurve, cost_chart, curves, legend
from ...page import Page, Section
from .tables import Group, Summary, method_name
from .thumbnails import Pictures

_BETTER = "\u2193 is better"


def write_page(summary: Summary, pictures: Pictures, out: Path) -> Path:
    """Write OUT/stress.html and return its path."""
    lead = (
        f"Perturbed are the {summary.base} frames. Errors are the median ATE in mm; \u00d7 is a "
        "failure; ! means that the method also reports wrong poses as good. Dot at a number, a "
        "dot or a line for its figures and name."
    )
    sections = [Section("overview", "Overview", tables=[summary.overview()])]
    sections += _speed(summary)
    sections.append(_severities(summary, pictures))
    for method in summary.methods:
        name = method_name(method)
        sections.append(Section(method.replace(":", "-"), name, tables=[summary.of_method(method)]))
    return Page("ICL-NUIM: where methods fail", lead, sections).write(out / "stress.html")


def _speed(summary: Summary) -> list[Section]:
    """Success against ms a frame; none without perturbed frames."""
    found = summary.speeds()
    if not found:
        return []
    points = [
        (
            method_name(name),
            summary.methods.index(name),
            Dot(
                ms,
                share,
                low,
                high,
                f"{ms:.1f} ms, {share:.1%}, 95 % interval {low:.0%} to {high:.0%}",
            ),
        )
        for name, ms, share, low, high in found
        if ms
    ]
    drawn: Markup | str = ""
    if points:
        across = "time of a frame on one core, ms (\u2190 is better)"
        drawn = cost_chart(points, across, "segments that succeed (\u2191 is better)")
    text = "All methods: the time of a frame, and the share of perturbed segments that succeed."
    return [Section("speed", "Success beside speed", text, [summary.speed()], drawn=drawn)]


def _severities(summary: Summary, pictures: Pictures) -> Section:
    """Each perturbation: its pictures with their values, and the curves of all methods."""
    text = (
        "Colour above depth of one frame, unperturbed and at severities 1 to 5 with their values. "
        "Curves: median ATE by severity, from the smallest to the largest of the segments; \u00d7: "
        "at least half of the segments fail."
    )
    parts = [legend(list(map(method_name, summary.methods)))]
    for name in summary.perturbations:
        about = summary.plan.perturbations[name]
        head = f"<h3>{escape(name)}</h3><p class='soft'>{escape(about.about)}</p>"
        figures = _figures(summary, name, pictures)
        parts.append(
            Markup(f'<article class="severities">{head}{figures}{_curves(summary, name)}</article>')
        )
    return Section("severities", "Errors by severity", text, drawn=Markup("").join(parts))


def _levels(summary: Summary, name: str) -> list[str]:
    about = summary.plan.perturbations[name]
    return ["none", *(plain(level) for level in about.levels)]


def _figures(summary: Summary, name: str, pictures: Pictures) -> str:
    """The pictures of a perturbation; none without sequences."""
    unit = summary.plan.perturbations[name].unit
    found = []
    for severity, level in enumerate(_levels(summary, name)):
        uri = pictures.get((name, severity) if severity else (CLEAN, 0))
        if uri is None:
            continue
        words = f"{severity}: {level} {unit}" if severity else "unperturbed"
        image = f'<img src="{uri}" alt="{escape(name)}, {escape(words)}">'
        found.append(f"<figure>{image}<figcaption>{escape(words)}</figcaption></figure>")
    return f'<div class="thumbs">{"".join(found)}</div>' if found else ""


def _curves(summary: Summary, name: str) -> Markup:
    found = []
    for number, method in enumerate(summary.methods):
        row = enumerate(summary.row(method, name))
        shown = method_name(method)
        points = [_point(shown, k, group) for k, group in row if group is not None]
        found.append(DrawnCurve(shown, number, points))
    ticks = [_short(text) for text in _levels(summary, name)]
    unit = summary.plan.perturbations[name].unit
    return curves(found, ticks, f"severity: {unit}", f"ATE, mm ({_BETTER})")


def _point(method: str, severity: int, group: Group) -> Dot:
    about = f"{method}, severity {severity}: {group.in_words()}"
    if group.failed or not group.ate_m:
        return Dot(severity, None, about=about)
    low, high = (None if v is None else 1e3 * v for v in (group.ate_low_m, group.ate_high_m))
    return Dot(severity, 1e3 * group.ate_m, low, high, about)


def _short(text: str) -> str:
    return text if len(text) < 9 else text[:8]
