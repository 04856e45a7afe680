"""The report as one self-contained HTML file: summary, findings, tables, and every cell with its
trajectory, error over time and heat map.
"""

import base64
import html
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from iclnuim.errors import WorkError
from iclnuim.formats.files import atomic_write_text, read_json

from .cells import TITLES
from .correlation import correlation
from .findings import FAILS, HOLDS, MISSING, UNDECIDED
from .lookup import ate_of, surface_of
from .measure import HEAT_MM
from .paper_tables import CELL_COLUMNS, cell_row, cells_table
from .text_tables import Table

#: Largest size of the file.
MAX_BYTES = 60_000_000
#: Part of it for pictures and films. Pictures beyond it are left out, those in colour first.
_PICTURES = 52_000_000
#: A column with a text longer than this number of characters is set as paragraphs.
_LONG = 40


def write_report(
    out: Path,
    results: Sequence[dict],
    tables: Sequence[Table],
    films: dict[str, bytes] | None = None,
) -> Path:
    """Write OUT/report.html from the measured cells and their tables.

    Raises WorkError if it cannot be written or is too large.
    """
    named = {table.name: table for table in tables}
    findings = [table for name, table in named.items() if name.startswith("findings")]
    apart = {"cells", "correlation", *(table.name for table in findings)}
    parts = {
        "about": html.escape(_about(out)),
        "tiles": _tiles(results, findings[0]),
        "findings": "".join(_section(table, k == 0) for k, table in enumerate(findings)),
        "correlation": _table(named["correlation"]),
        "tables": "".join(_section(table, False) for table in tables if table.name not in apart),
        "heat": _heat_gradient(),
        "data": json.dumps(
            _data(results, films or {}), separators=(",", ":"), sort_keys=True
        ).replace("<", "\\u003c"),
    }
    text = (Path(__file__).parent / "report.html").read_text("utf-8")
    for name, part in parts.items():
        text = text.replace(f"{{{{{name}}}}}", part)
    if len(text.encode()) > MAX_BYTES:
        raise WorkError(
            f"the report would have {len(text) / 1e6:.0f} MB, but the limit is {MAX_BYTES / 1e6:.0f} MB"
        )
    atomic_write_text(out / "report.html", text)
    return out / "report.html"


def _about(out: Path) -> str:
    recipe = read_json(out / "recipe.json") if (out / "recipe.json").is_file() else {}
    first = recipe.get("first")
    frames = f"the first {first} frames of each sequence" if first else "all frames"
    versions = recipe.get("versions") or {}
    made = f"iclnuim {versions.get('iclnuim', '')}, {recipe.get('machine', '')}".strip(", ")
    paper = "Handa, Whelan, McDonald and Davison, ICRA 2014"
    return f"The experiments of {paper}, on our sequences, with our odometers: {frames}. {made}."


def _tiles(results: Sequence[dict], findings: Table) -> str:
    verdicts = Counter(row[5] for row in findings.rows)
    failed = sum("failed" in result for result in results)
    tiles = [(len(results), f"cells measured{f', {failed} failed' if failed else ''}")]
    tiles += [(len({r["cell"].sequence for r in results}), "sequences")]
    tiles += [
        (verdicts[name], f"of {len(findings.rows)} findings: {name}")
        for name in (HOLDS, FAILS, UNDECIDED, MISSING)
    ]
    found = correlation(results)
    texts = [(str(number), text) for number, text in tiles if number]
    if found:
        texts.append((f"{found.rho:.2f}", "rank correlation of trajectory and surface error"))
    return "".join(f"<li><b>{number}</b>{html.escape(text)}</li>" for number, text in texts)


def _section(table: Table, is_open: bool) -> str:
    opened = " open" if is_open else ""
    return (
        f"<details{opened}><summary>{html.escape(table.title)}</summary>{_table(table)}</details>"
    )


def _table(table: Table) -> str:
    numbers = [table.is_number(j) for j in range(len(table.columns))]
    longs = [
        max((len(row[j]) for row in table.rows), default=0) > _LONG
        for j in range(len(table.columns))
    ]
    head = "".join(
        _cell("th", text, {"n": n}) for text, n in zip(table.columns, numbers, strict=True)
    )
    rows = []
    for i, row in enumerate(table.rows):
        cells = []
        for j, text in enumerate(row):
            marks = {"n": numbers[j], "b": (i, j) in table.bold, "text": longs[j]}
            if table.columns[j] == "verdict":
                marks |= {"verdict": True, f"v-{text.split()[0]}": True}
            cells.append(_cell("td", text, marks, table.columns[j]))
        rows.append(f"<tr>{''.join(cells)}</tr>")
    notes = "".join(f'<p class="soft">{html.escape(note)}</p>' for note in table.notes)
    label = html.escape(table.title, quote=True)
    kind = ' class="cards"' if any(longs) else ""
    grid = f"<table{kind}><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{label}">{grid}</div>{notes}'
    )


def _cell(tag: str, text: str, marks: dict[str, bool], column: str = "") -> str:
    names = " ".join(name for name, given in marks.items() if given)
    scope = ' scope="col"' if tag == "th" else f' data-name="{html.escape(column)}"'
    kind = f' class="{names}"' if names else ""
    return f"<{tag}{scope}{kind}>{html.escape(text)}</{tag}>"


def _data(results: Sequence[dict], films: dict[str, bytes]) -> dict:
    """The data that the page's script draws."""
    table, left = cells_table(results), _PICTURES - sum(map(len, films.values())) * 4 // 3
    pictures: list[dict[str, str]] = [{} for _ in results]
    for name, key in (("heat", "heat"), ("surface", "surface_picture")):
        for found, result in zip(pictures, results, strict=True):
            path = result["folder"] / f"{name}.jpg"
            if (
                path.is_file()
                and (text := _inline("image/jpeg", path.read_bytes()))
                and len(text) <= left
            ):
                found[key], left = text, left - len(text)
    cells = [{**_row(result), **found} for result, found in zip(results, pictures, strict=True)]
    return {
        "columns": CELL_COLUMNS,
        "numeric": [table.is_number(j) for j in range(len(CELL_COLUMNS))],
        "several": [
            n for j, n in enumerate(CELL_COLUMNS) if len({row[j] for row in table.rows}) > 1
        ],
        "cells": cells,
        "colours": _colours(results),
        "films": {sequence: _inline("video/webm", film) for sequence, film in films.items()},
        "heat_text": f"logarithmic: {HEAT_MM[0]:g} mm or less (blue) to {HEAT_MM[1]:g} mm or more (red)",
    }


def _row(result: dict) -> dict:
    cell, row = result["cell"], cell_row(result)
    path = result["folder"] / "path.json"
    ate_m, surface_m = ate_of(result), surface_of(result)
    surface, times, more = result.get("surface", {}), result["times"], {}
    if "fit_moved_m" in surface:
        more["ICP alignment"] = (
            f"{1e3 * surface['fit_moved_m']:.2f} mm, {surface['fit_turned_deg']:.3f} degrees"
        )
    if "track_s" in times:
        more["tracking"] = (
            f"{times['track_s']:.1f} s on one core, {times['ms_median']:.1f} ms per frame"
        )
    if "peak_mb" in times:
        more["process"] = f"{times['cpu_s']:.0f} s on one core, {times['peak_mb']:.0f} MB"
    return {
        "name": cell.name,
        "sequence": cell.sequence,
        "room": cell.room,
        "noise": cell.noise,
        "title": cell.title,
        "row": row,
        "search": " ".join((cell.name, *row)).lower(),
        "ate": None if ate_m is None else 1e3 * ate_m,
        "surface": None if surface_m is None else 1e3 * surface_m,
        "failed": result.get("failed", ""),
        "path": read_json(path) if path.is_file() else None,
        "more": more,
    }


def _colours(results: Sequence[dict]) -> dict[str, str]:
    """Title -> colour in the charts; our five odometers come first."""
    from iclnuim.report.charts import COLOURS

    titles = [*TITLES.values(), *sorted({r["cell"].title for r in results} - set(TITLES.values()))]
    return {title: COLOURS[k % len(COLOURS)] for k, title in enumerate(titles)}


def _heat_gradient() -> str:
    """The heat maps' colour scale from low to high, as a CSS gradient."""
    import numpy as np
    from iclnuim.benchmark.fusion.pictures import heat_colours
    from matplotlib.colors import to_hex

    distances_mm = np.geomspace(*HEAT_MM, 17)
    return f"linear-gradient(to right, {', '.join(to_hex(c / 255) for c in heat_colours(distances_mm, *HEAT_MM))})"


def _inline(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
