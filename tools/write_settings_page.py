"""Writes docs/reference/settings.md, a table for every group of declared settings: `python
tools/write_settings_page.py`. With --check it only compares the page.
"""

import importlib
import inspect
import re
import sys
from collections import Counter
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
    "iclnuim.sequences.sequence_options",
    "iclnuim.sequences.bag_writer",
    "iclnuim.sensor.depth",
    "iclnuim.sensor.active_stereo",
    "iclnuim.sensor.time_of_flight",
    "iclnuim.sensor.phone",
    "iclnuim.sensor.rgb",
    "iclnuim.sensor.imu_noise",
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

Each setting is declared once, in a dataclass, where Python takes it as a keyword; the
option, the panel's field and this page (`python tools/write_settings_page.py`) follow from it. A
setting without a default must be given, or is chosen as the last column says.
"""


def page() -> str:
    """The text of docs/reference/settings.md."""
    return "\n".join([HEAD, _contents(), *(_section(group) for group in groups())])


def _contents() -> str:
    titles = [_title(group) for group in groups()]
    anchors = [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]
    links = (f"[{title}](#{anchor})" for title, anchor in zip(titles, anchors, strict=True))
    return " · ".join(links) + "\n"


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


def _title(group: type[Settings]) -> str:
    title = re.sub(r"^settings of (the )?", "", group.group)
    kind = {
        "iclnuim.sensor.depth": " of depth",
        "iclnuim.sensor.rgb": " of colour",
        "iclnuim.sensor.imu_noise": " of an IMU",
    }
    return f"{title[0].upper()}{title[1:]}{kind.get(group.__module__, '')}"


def _section(group: type[Settings]) -> str:
    summary = (group.__doc__ or "").strip().partition("\n\n")[0]
    settings = list(declared(group).values())
    place = f"`{group.__module__}.{group.__name__}`. "
    sources = [s.source for s in settings if s.source]
    shared = [s for s, times in Counter(sources).items() if times > 1]
    parts = [
        f"## {_title(group)}",
        place + " ".join(summary.split()),
        table(settings, shared),
        "\n".join(f"- [{number}] {source}" for number, source in enumerate(shared, 1)),
        "\n".join(filter(None, map(_meanings, settings))),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _meanings(setting: Setting) -> str:
    """What the choices of a setting mean, one line."""
    told = {c: m for c, m in (setting.choices or {}).items() if m not in ("", c)}
    if not told:
        return ""
    meanings = "; ".join(f"`{choice}` {meaning}" for choice, meaning in told.items())
    return f"- `{setting.name}`: {meanings}"


def table(settings: list[Setting], shared: list[str]) -> str:
    """Settings as a Markdown table; sources that several of them share are numbers."""
    rows = ["| setting | option | default | range | what |", "|---|---|---|---|---|"]
    for s in settings:
        reach = s.range.removeprefix("in ").removeprefix("of ")
        if s.choices is not None:
            reach = ", ".join(f"`{choice}`" for choice in s.choices)
        default = ""
        if s.default not in (None, MISSING):
            default = f"`{plain(s.default)}`"
        option = ""
        if s.option:
            option = f"`{s.option}`"
        what = s.help
        if s.source in shared:
            what += f" [{shared.index(s.source) + 1}]"
        elif s.source:
            what += f" ({s.source})"
        number, more, _ = reach.partition(" or more")
        reach = " ".join(filter(None, (number, s.unit, more.strip())))
        cells = (f"`{s.name}`", option, default, reach, what)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


if __name__ == "__main__":
    if "--check" not in sys.argv:
        PAGE.write_text(page(), "utf-8")
    elif PAGE.read_text("utf-8") != page():
        sys.exit(f"{PAGE} differs from the declarations; try: python tools/write_settings_page.py")
