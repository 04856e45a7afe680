"""Writes docs/reference/settings.md, a table for every group of declared settings: `python
tools/write_settings_page.py`. With --check it only compares the page.
"""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path

from iclnuim.settings import MISSING, Setting, Settings, declared, plain

PAGE = Path(__file__).resolve().parents[1] / "docs/reference/settings.md"
#: The modules whose groups are on the page, in this order; groups of modules that they import are
#: included.
MODULES = (
    "iclnuim.job",
    "iclnuim.geometry.camera",
    "iclnuim.geometry.scene_axes",
    "iclnuim.dataset.sequence_options",
    "iclnuim.dataset.bags_and_logs",
    "iclnuim.sensor.depth",
    "iclnuim.sensor.rgb",
    "iclnuim.evaluation.associate",
    "iclnuim.evaluation.align",
    "iclnuim.evaluation.relative_error",
    "iclnuim.evaluation.image_error",
    "iclnuim.benchmark.odometry.registry",
    "iclnuim.benchmark.fusion.settings",
    "iclnuim.geometry.handheld_plan",
    "iclnuim.geometry.handheld",
    "iclnuim.headless.farm.farm_settings",
    "iclnuim.benchmark.systems.system",
    "iclnuim.benchmark.perturbations.plan",
)
HEAD = """# Settings

Each setting is declared once, in a dataclass; checks, JSON, options of the command line, the
panel's fields and this page are made from the declaration. This page is written by
`python tools/write_settings_page.py`.
"""


def page() -> str:
    """The text of docs/reference/settings.md."""
    return "\n".join([HEAD, *(_section(group) for group in groups())])


def groups() -> list[type[Settings]]:
    """Every group with declared settings, in the order of MODULES, without groups that repeat the
    settings of another.
    """
    for name in MODULES:
        importlib.import_module(name)
    order = {name: k for k, name in enumerate(MODULES)}
    found = [g for g in _below(Settings) if g.__module__.startswith("iclnuim.")]
    found.sort(
        key=lambda g: (
            order.get(g.__module__, len(order)),
            g.__module__,
            inspect.getsourcelines(g)[1],
        )
    )
    shown: list[Setting] = []
    kept = []
    for group in found:
        settings = list(declared(group).values())
        if any(setting not in shown for setting in settings):
            kept.append(group)
            shown += settings
    return kept


def _below(group: type[Settings]) -> Iterator[type[Settings]]:
    for one in group.__subclasses__():
        yield one
        yield from _below(one)


def _section(group: type[Settings]) -> str:
    summary = (group.__doc__ or "").strip().partition("\n\n")[0]
    title = f"## {group.group[0].upper()}{group.group[1:]} (`{group.__module__}.{group.__name__}`)"
    meanings = []
    for name, setting in declared(group).items():
        for choice, meaning in (setting.choices or {}).items():
            if meaning not in ("", choice):
                meanings.append(f"- `{name}` `{choice}`: {meaning}")
    parts = [title, " ".join(summary.split()), table(group), "\n".join(meanings)]
    return "\n\n".join(part for part in parts if part) + "\n"


def table(group: type) -> str:
    """The settings of a dataclass as a Markdown table, for docs/reference/settings.md."""
    rows = [
        "| setting | option | default | unit | range | what | source |",
        "|---|---|---|---|---|---|---|",
    ]
    for s in declared(group).values():
        reach = s.range.removeprefix("in ").removeprefix("of ")
        if s.choices is not None:
            reach = ", ".join(f"`{choice}`" for choice in s.choices)
        default = ""
        if s.default not in (None, MISSING):
            default = f"`{plain(s.default)}`"
        option = f"`{s.option}`" if s.option else ""
        cells = (f"`{s.name}`", option, default, s.unit, reach, s.help, s.source)
        rows.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(rows)


if __name__ == "__main__":
    if "--check" not in sys.argv:
        PAGE.write_text(page(), "utf-8")
    elif PAGE.read_text("utf-8") != page():
        sys.exit(f"{PAGE} differs from the declarations; try: python tools/write_settings_page.py")
