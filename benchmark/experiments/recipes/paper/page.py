"""What `iclnuim benchmark` shows of its cells: tables, text, JSON, and a page with summary, findings,
tables, and every cell with its trajectory, error over time and heat map.
"""

import base64
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from iclnuim.console import Console
from iclnuim.formats.files import make_folder, read_json
from iclnuim.native_output import native_output_in

from ...cell import Measured
from ...page import Page, Section, png_uri
from ...table import ResultTable
from .best_methods import accuracy_figure, best_methods_table
from .correlation import correlation, correlation_table
from .figures import ate_of, presets_of, surface_of
from .findings import (
    CLOSE,
    FAILS,
    HOLDS,
    MISSING,
    UNDECIDED,
    VOID,
    findings_table,
    verdicts_table,
)
from .keys import HEAT_MM, paper_odometers
from .rules import RULES
from .sources import Sources
from .speed import speed_figure, speed_table
from .tables import BRIEF_COLUMNS, CELL_COLUMNS, all_tables, cell_row, cells_table, has_ours

#: Part of the page for pictures and films. Pictures beyond it are left out, those in colour first.
_PICTURES = 52_000_000
#: So many cells fit a screen.
_SCREEN = 40
#: The columns of the findings beside so few cells.
_BRIEF_FINDINGS = ("no.", "verdict")
_HEAT_TEXT = f"logarithmic: {HEAT_MM[0]:g} mm or less (blue) to {HEAT_MM[1]:g} mm or more (red)"


def tables_of(results: Sequence[Measured]) -> list[ResultTable]:
    """All tables that are made from the measured cells."""
    findings = [findings_table(results, preset) for preset in presets_of(results)]
    *tables, cells = all_tables(results)
    best = best_methods_table(results)
    verdicts = verdicts_table(results)
    return [best, *tables, verdicts, *findings, correlation_table(results), cells]


def text_of(tables: Sequence[ResultTable]) -> str:
    """The tables with a figure of ours; of few cells, these and the verdicts that they allow, in
    brief, instead of the paper's tables.
    """
    *shown, cells = tables
    few = len(cells.rows) <= _SCREEN
    if few:
        found = [table for table in shown if table.name.startswith("findings")]
        brief = [table.varying(_BRIEF_FINDINGS) for table in found]
        shown = [cells.varying(BRIEF_COLUMNS), *brief]
    with_rows = [table.text() for table in shown if table.rows and (few or has_ours(table))]
    undecided = [table.notes[-1] for table in shown if table.notes and not table.rows]
    return "\n\n".join([*with_rows, *undecided])


def values_of(results: Sequence[Measured], tables: Sequence[ResultTable]) -> dict[str, Any]:
    """The result for --json."""
    cells = []
    for result in results:
        figures = {name: v for name, v in result.figures.items() if name != "path"}
        cells.append({"cell": asdict(result.key), "folder": str(result.folder), **figures})
    rows = {}
    for t in tables:
        rows[t.name] = {"title": t.title, "columns": t.columns, "rows": t.rows, "notes": t.notes}
    return {"cells": cells, "tables": rows}


def write_report(
    out: Path,
    results: Sequence[Measured],
    tables: Sequence[ResultTable],
    films: Mapping[str, bytes] | None = None,
) -> Path:
    """Write OUT/report.html from the measured cells and their tables.

    Raises WorkError if it cannot be written or is too large.
    """
    findings = [table for table in tables if table.name.startswith("findings")]
    verdicts = [table for table in tables if table.name == "verdicts"]
    correlations = [table for table in tables if table.name == "correlation"]
    best = [table for table in tables if table.name == "best_methods" and table.rows]
    apart = {"cells", *(table.name for table in (*best, *verdicts, *findings, *correlations))}
    others = [table for table in tables if table.name not in apart and has_ours(table)]
    conditions = "Which method for which condition"
    first = [Section("best", conditions, tables=best, picture=_accuracy(results))] if best else []
    if (chart := speed_figure(results)) is not None:
        speed = "Accuracy and surfaces beside speed and memory"
        how = (
            "Dots are means over the sequences with 95 % intervals; no method beats those on the "
            "line in both."
        )
        first.append(Section("speed", speed, how, [speed_table(results)], picture=png_uri(chart)))
    page = Page(
        title="The ICL-NUIM benchmark, reproduced",
        lead=_about(out),
        sections=[*first, *_sections(findings, verdicts, correlations, others)],
        tiles=_tiles(results, findings[0]),
        data=_data(results, films or {}),
        heat=_heat_gradient(),
    )
    return page.write(out / "report.html")


def films(
    sources: Sources, results: Sequence[Measured], first: int | None, console: Console
) -> dict[str, bytes]:
    """The films OUT/films/SEQUENCE.webm of the measured sequences that exist, by sequence; missing
    films are made.
    """
    from iclnuim.report.preview import write_web_film

    keys = {r.key.sequence: r.key for r in results if not r.key.seed}
    folders = {name: sources.folder(key) for name, key in keys.items()}
    there = {name: folder for name, folder in folders.items() if folder.is_dir()}
    progress = console.progress(len(there), "films", "films")
    found = {}
    for name, folder in there.items():
        path = sources.out / "films" / f"{name}.webm"
        if not path.is_file():
            make_folder(path.parent)
            with native_output_in(Path(os.devnull)):  # OpenCV's FFmpeg writes to standard error
                write_web_film(folder, path, first)
        found[name] = path.read_bytes()
        progress.advance()
    return found


def _sections(
    findings: Sequence[ResultTable],
    verdicts: Sequence[ResultTable],
    correlations: Sequence[ResultTable],
    others: Sequence[ResultTable],
) -> list[Section]:
    question = "Does a better trajectory mean a better surface?"
    dots = "A dot is a cell with a measured surface."
    beside = "The paper's tables: our figures next to the printed ones"
    how = (
        "Click a column's name to sort. Click a sequence to show its trajectory, its error over "
        "time and its heat map. Errors in mm."
    )
    decided = [table for table in findings if table.rows]
    missing = " ".join(dict.fromkeys(table.notes[-1] for table in findings if not table.rows))
    of_paper = "The findings of section VI"
    by_method = verdicts if decided else []
    cells = Section("cells", "All cells", how, part="cells")
    sections = [
        Section("findings", of_paper, missing, [*by_method, *decided], folded=True),
        Section("main", question, dots, [t for t in correlations if t.rows], part="chart"),
        Section("tables", beside, tables=others, folded=True),
    ]
    whole = any(len(table.rows) == len(RULES) for table in decided)
    return [*sections, cells] if whole else [cells, *reversed(sections)]


def _accuracy(results: Sequence[Measured]) -> str:
    """The chart of the ATE of every method."""
    return png_uri(accuracy_figure(results))


def _about(out: Path) -> str:
    recipe = read_json(out / "recipe.json") if (out / "recipe.json").is_file() else {}
    first = recipe.get("first")
    frames = f"the first {first} frames of each sequence" if first else "all frames"
    version = (recipe.get("versions") or {}).get("iclnuim", "")
    system = (recipe.get("machine") or {}).get("system", "")
    made = f"iclnuim {version}, {system}".strip(", ")
    paper = "Handa, Whelan, McDonald and Davison, ICRA 2014"
    return f"The experiments of {paper}, on our sequences, with our odometers: {frames}. {made}."


def _tiles(results: Sequence[Measured], findings: ResultTable) -> list[tuple[str, str]]:
    verdicts = Counter(row[5] for row in findings.rows)
    failed = sum("failed" in result.figures for result in results)
    tiles = [(len(results), "cells measured"), (failed, "cells failed")]
    tiles.append((len({r.key.sequence for r in results}), "sequences"))
    verdicts[MISSING] = len(RULES) - len(findings.rows)
    for name in (HOLDS, FAILS, CLOSE, UNDECIDED, VOID, MISSING):
        tiles.append((verdicts[name], f"of {len(RULES)} findings: {name}"))
    texts = [(str(number), text) for number, text in tiles if number]
    if found := correlation(results):
        texts.append((f"{found.rho:.2f}", "rank correlation of trajectory and surface error"))
    return texts


def _data(results: Sequence[Measured], films: Mapping[str, bytes]) -> dict[str, Any]:
    """The data that the page's script draws."""
    table = cells_table(results)
    cells = [_row(result) for result in results]
    left = _PICTURES - sum(map(len, films.values())) * 4 // 3
    for found, result, name in _pictures(cells, results):
        path = result.folder / f"{name}.jpg"
        if path.is_file() and len(text := _inline("image/jpeg", path.read_bytes())) <= left:
            found[f"{name}_jpg"] = text
            left -= len(text)
    columns = range(len(CELL_COLUMNS))
    return {
        "columns": CELL_COLUMNS,
        "numeric": [table.is_number(j) for j in columns],
        "several": [CELL_COLUMNS[j] for j in columns if len(set(table.column(j))) > 1],
        "cells": cells,
        "colours": _colours(results),
        "films": {sequence: _inline("video/webm", film) for sequence, film in films.items()},
        "heat_text": _HEAT_TEXT,
    }


def _pictures(
    cells: Sequence[dict], results: Sequence[Measured]
) -> Iterator[tuple[dict, Measured, str]]:
    """The heat maps of all cells before their surfaces in colour."""
    for name in ("heat", "surface"):
        for cell, result in zip(cells, results, strict=True):
            yield cell, result, name


def _row(result: Measured) -> dict[str, Any]:
    key = result.key
    row = cell_row(result)
    return {
        "name": key.place,
        "sequence": key.sequence,
        "room": key.room,
        "noise": key.noise,
        "odometer": key.odometer,
        "row": row,
        "search": " ".join((key.place, *row)).lower(),
        "ate": _mm(ate_of(result.figures)),
        "surface": _mm(surface_of(result.figures)),
        "failed": result.figures.get("failed", ""),
        "path": result.figures.get("path"),
        "more": _more(result),
    }


def _mm(length_m: float | None) -> float | None:
    return None if length_m is None else 1e3 * length_m


def _more(result: Measured) -> dict[str, str]:
    """Further figures of a cell, by name."""
    more = {}
    surface = result.figures.get("surface", {})
    times = result.figures["times"]
    if "fit_moved_m" in surface:
        moved_mm = 1e3 * surface["fit_moved_m"]
        more["ICP alignment"] = f"{moved_mm:.2f} mm, {surface['fit_turned_deg']:.3f} degrees"
    if "track_s" in times:
        each = f"{1e3 * times['track_s'] / result.figures['frames']:.1f} ms a frame"
        more["tracking"] = f"{each} on one core, {times['track_s']:.1f} s in all"
    return {**more, "cell": f"{times['cpu_s']:.0f} s on one core"}


def _colours(results: Sequence[Measured]) -> dict[str, str]:
    """Odometer -> colour in the charts; the paper's five come first."""
    from iclnuim.shown import COLOURS

    five = paper_odometers()
    names = [*five, *sorted({r.key.odometer for r in results} - set(five))]
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}


def _heat_gradient() -> str:
    """The heat maps' colour scale from low to high, as a CSS gradient."""
    import numpy as np
    from iclnuim.benchmark.fusion.pictures import heat_colours
    from matplotlib.colors import to_hex

    colours = heat_colours(np.geomspace(*HEAT_MM, 17), *HEAT_MM)
    return f"linear-gradient(to right, {', '.join(to_hex(c / 255) for c in colours)})"


def _inline(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
