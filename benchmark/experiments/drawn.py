"""Charts of a page as SVG in the page's colours, so that they are legible on light and dark ones;
the name of a method is shown where the pointer is.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from markupsafe import Markup, escape

#: Colours of methods in page.html; a further round of them is dashed.
COLOURS = 7
_DASHES = ("none", "6 3", "2 3")
_WIDTH, _HEIGHT = 460, 250
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 26, 40
#: Height of a line of labels, and width of a letter.
_LINE, _LETTER = 13.0, 6.2


@dataclass(frozen=True)
class Dot:
    """A figure at a place, between two ends of its interval. value: None for a failure, which is
    drawn at the top.
    """

    at: float
    value: float | None
    low: float | None = None
    high: float | None = None
    about: str = ""


@dataclass(frozen=True)
class DrawnCurve:
    """The points of a method; the number is that of its colour."""

    name: str
    number: int
    points: Sequence[Dot]


def style(number: int) -> str:
    """CSS of the line of a method."""
    dash = _DASHES[number // COLOURS % len(_DASHES)]
    return f"stroke:var(--c{number % COLOURS});stroke-dasharray:{dash}"


def legend(names: Sequence[str]) -> Markup:
    """The line of each method beside its name, by its number."""
    items = [
        f'<li><svg viewBox="0 0 26 8"><path class="curve" d="M0 4H26" style="{style(k)}"/></svg>'
        f"{escape(name)}</li>"
        for k, name in enumerate(names)
    ]
    return Markup(f'<ul class="legend">{"".join(items)}</ul>')


def curves(found: Sequence[DrawnCurve], ticks: Sequence[str], across: str, up: str) -> Markup:
    """Curves over the places 0, 1, ... that `ticks` name, on a logarithmic scale; across, up: what
    the axes say.
    """
    values = [v for c in found for p in c.points for v in (p.value, p.low, p.high) if v]
    first = math.floor(math.log10(min(values, default=1.0)))
    last = max(math.ceil(math.log10(max(values, default=1.0))), first + 1)
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM

    def x(at: float) -> float:
        return _LEFT + 14 + (right - _LEFT - 28) * at / max(1, len(ticks) - 1)

    def y(value: float) -> float:
        return bottom - (bottom - _TOP) * (math.log10(value) - first) / (last - first)

    parts = [_horizontal(y(10.0**p), f"{10.0**p:g}") for p in range(first, last + 1)]
    parts.append(_text(_LEFT - 6, 13, "fails", "end"))
    parts += [_text(x(k), bottom + 15, tick, "middle") for k, tick in enumerate(ticks)]
    parts += _named_axes(across, up)
    for curve in found:
        parts.append(f'<g style="{style(curve.number)}"><title>{escape(curve.name)}</title>')
        places = [(x(p.at), 9.0 if p.value is None else y(p.value)) for p in curve.points]
        for (a, one), (b, other) in pairwise(zip(places, curve.points, strict=True)):
            fails = one.value is None or other.value is None
            faint = ' opacity="0.35"' if fails else ""
            line = f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}"
            parts.append(f'<path class="curve" d="{line}"{faint}/>')
        for place, point in zip(places, curve.points, strict=True):
            parts.append(_marked(place, point, y))
        parts.append("</g>")
    return _svg(parts, f"{up} by {across}", _HEIGHT)


def cost_chart(points: Sequence[tuple[str, int, Dot]], across: str, up: str) -> Markup:
    """The shares of methods (name, number of the colour, point) over a logarithmic cost, each dot
    with its name.
    """
    costs = [math.log10(p.at) for _, _, p in points]
    left, last = math.floor(min(costs)), max(math.ceil(max(costs)), math.floor(min(costs)) + 1)
    height = max(_HEIGHT, int(_LINE * len(points)) + 120)
    bottom = height - _BOTTOM

    def x(cost: float) -> float:
        return _LEFT + 10 + (_WIDTH - _LEFT - 120) * (math.log10(cost) - left) / (last - left)

    def y(value: float) -> float:
        return bottom - (bottom - _TOP) * value

    parts = [_horizontal(y(k / 4), f"{25 * k} %") for k in range(5)]
    for power in range(left, last + 1):
        parts.append(_text(x(10.0**power), bottom + 15, f"{10.0**power:g}", "middle"))
    parts += _named_axes(across, up, height)
    places = [(x(p.at), y(p.value or 0.0)) for _, _, p in points]
    for (name, number, point), place in zip(points, places, strict=True):
        parts.append(f'<g style="{style(number)}"><title>{escape(name)}: {escape(point.about)}')
        parts.append(f"</title>{_marked(place, point, y)}</g>")
    bars = [(x(p.at), y(p.high or 0.0), y(p.low or 0.0)) for _, _, p in points]
    for (name, _, _), dot, (left_px, y_px) in zip(
        points, places, _labels([n for n, _, _ in points], places, bars), strict=True
    ):
        if abs(y_px - dot[1]) > _LINE / 2:
            line = f"M{dot[0]:.1f} {dot[1]:.1f}L{left_px:.1f} {y_px:.1f}"
            parts.append(f'<path class="axis" d="{line}"/>')
        parts.append(_text(left_px, y_px + 4, name, "start"))
    return _svg(parts, f"{up} by {across}", height)


def _labels(
    names: Sequence[str],
    places: Sequence[tuple[float, float]],
    bars: Sequence[tuple[float, float, float]],
) -> list[tuple[float, float]]:
    """Where each name begins: the nearest place beside its dot that covers no other name and no
    interval (x, top, bottom).
    """
    taken = [(x - 5, x + 5, top, bottom) for x, top, bottom in bars]
    found = []
    for name, (x, y) in zip(names, places, strict=True):
        width = _LETTER * len(name)
        for step in sorted(range(-12, 13), key=abs):
            at = y + step * _LINE / 2
            free = [
                left
                for left in (x + 9, x - 9 - width)
                if left > _LEFT
                and not any(
                    left < b and left + width > a and at - _LINE / 2 < d and at + _LINE / 2 > c
                    for a, b, c, d in taken
                )
            ]
            if free:
                break
        left = free[0] if free else x + 9
        taken.append((left, left + width, at - _LINE / 2, at + _LINE / 2))
        found.append((left, at))
    return found


def _marked(place: tuple[float, float], point: Dot, y: Callable[[float], float]) -> str:
    """A dot with its interval, or a cross for a failure."""
    x, at = place
    about = f"<title>{escape(point.about)}</title>"
    if point.value is None:
        cross = f"M{x - 4:.1f} {at - 4:.1f}l8 8m0 -8l-8 8"
        return f'<path class="curve" style="stroke-dasharray:none" d="{cross}">{about}</path>'
    bar = ""
    if point.low is not None and point.high is not None:
        ends = f"M{x:.1f} {y(point.low):.1f}V{y(point.high):.1f}"
        bar = f'<path class="curve" style="stroke-dasharray:none;stroke-width:1" d="{ends}"/>'
    return f'{bar}<circle class="dot" cx="{x:.1f}" cy="{at:.1f}" r="3.4">{about}</circle>'


def _horizontal(y: float, text: str) -> str:
    line = f'<path class="axis" d="M{_LEFT} {y:.1f}H{_WIDTH - _RIGHT}"/>'
    return line + _text(_LEFT - 6, y + 4, text, "end")


def _named_axes(across: str, up: str, height: int = _HEIGHT) -> list[str]:
    middle = (_TOP + height - _BOTTOM) / 2
    turned = f'transform="rotate(-90 12 {middle:.0f})"'
    return [
        _text((_LEFT + _WIDTH - _RIGHT) / 2, height - 8, across, "middle"),
        _text(12, middle, up, "middle", turned),
    ]


def _text(x: float, y: float, text: str, anchor: str, more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" {more}>{escape(text)}</text>'


def _svg(parts: Sequence[str], about: str, height: int) -> Markup:
    box = f'viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="{escape(about)}"'
    return Markup(f"<svg {box}>{''.join(parts)}</svg>")
