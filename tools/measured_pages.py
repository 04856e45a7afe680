"""Redraws the measured tables of docs/measured from the cells in docs/measured/cells.jsonl.

    python tools/measured.py                        all pages
    python tools/measured.py --plan                 which cells are missing, commands, core-hours
    python tools/measured.py --take out/benchmark   cells of `iclnuim benchmark` or `iclnuim stress`
                                                    into the file, then all pages
    python tools/measured.py --measure light        measures a table's commands, then all pages
    python tools/measured.py --list                 pages, marks, commands

In a page, what is drawn is between `<!-- measured: MARK -->` and `<!-- end of MARK -->`. Commands
run in the top folder of the checkout, on the sequences that `iclnuim make all` writes to out/.
"""

import json
import re
import shlex
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

from iclnuim.benchmark.experiments.recipes.paper import accuracy_chart
from iclnuim.benchmark.experiments.recipes.paper.keys import PaperKey
from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND as BENCHMARK
from iclnuim.benchmark.experiments.recipes.stress import chart as stress_chart
from iclnuim.benchmark.experiments.recipes.stress.recipe import KIND as STRESS
from iclnuim.benchmark.experiments.recipes.stress.recipe import StressKey
from iclnuim.benchmark.experiments.store import Store, made_by
from iclnuim.report.charts import save
from iclnuim.tools.measured_cells import TABLE, PublishedCell, PublishedCells, Run, rooms_hash
from iclnuim.tools.measured_drawn import DRAWN, NOT_MEASURED, stress_summary
from iclnuim.tools.measured_plan import plan
from iclnuim.tools.measured_tables import COMMAND_TABLES, CommandTable, markdown

TOP = Path(__file__).resolve().parents[1]
PAGES = Path("docs/measured")
CELLS = PAGES / "cells.jsonl"
#: Endings of the marks of a page's single figures, and of the runs of all its cells.
_FACTS = "-facts"
_RUNS = "-cells"
#: Of the largest chart, so that its file stays small; its numbers can still be read.
_STRESS_DPI = 70
_MARKED = re.compile(r"<!-- measured: (.*) -->\n(.*?)<!-- end of \1 -->\n", re.S)
_KEYS = {BENCHMARK: PaperKey, STRESS: StressKey}


def redrawn(text: str, cells: PublishedCells) -> str:
    """A page with the tables of its marks. Raises ValueError for a mark that nothing draws."""
    cells.used.clear()
    return _MARKED.sub(lambda found: _block(found[1], cells), text)


def _block(mark: str, cells: PublishedCells) -> str:
    return f"<!-- measured: {mark} -->\n{drawn(mark, cells)}<!-- end of {mark} -->\n"


def drawn(mark: str, cells: PublishedCells) -> str:
    """What stands at a mark. Raises ValueError if nothing draws it."""
    how = "python tools/measured.py --plan"
    if mark in DRAWN:
        rows = DRAWN[mark](cells)
    elif mark in COMMAND_TABLES:
        rows = cells.table(mark) or []
        how = f"python tools/measured.py --measure {mark}"
    elif mark.endswith(_FACTS):
        page = mark.removesuffix(_FACTS)
        rows = [["what", "measured", "command", "commit"], *cells.facts(page)]
    elif mark.endswith(_RUNS):
        rows = [["command", "machine", "commits"], *_runs(cells)]
    else:
        raise ValueError(f"nothing draws {mark}")
    return markdown(rows) if rows[1:] else f"{NOT_MEASURED}: `{how}`\n"


def _runs(cells: PublishedCells) -> Iterator[list[str]]:
    """The runs of the cells that the page has shown so far, those of a command together."""
    commits: dict[tuple[str, str], list[str]] = {}
    for run in sorted(cells.used, key=astuple):
        commits.setdefault((run.command, run.machine), []).append(run.commit)
    for (command, machine), found in sorted(commits.items()):
        yield [f"`{command}`", machine, ", ".join(found)]


def output_of(command: str) -> Any:
    """The output of a command of iclnuim with --json."""
    print(f"iclnuim {command} --json", file=sys.stderr, flush=True)
    words = [sys.executable, "-m", "iclnuim", *shlex.split(command), "--json"]
    done = subprocess.run(words, cwd=TOP, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"measured: iclnuim {command.split()[0]} ended with exit code {done.returncode}")
    return json.loads(done.stdout)


def measured(table: CommandTable) -> PublishedCell:
    """The cell of a table, from its commands."""
    found = [output_of(command) for command in table.commands]
    command = f"iclnuim {table.commands[0].partition(' --plot')[0]}"
    if len(table.commands) > 1:
        command = f"python tools/measured.py --measure {table.mark}"
    rows = {"rows": table.rows(found)}
    return PublishedCell(_run(made_by(), command), rows, input=rooms_hash())


def _run(recipe: dict[str, Any], command: str) -> Run:
    """The run of a recipe as the store writes it."""
    machine = recipe["machine"]
    commit = (recipe["source_commit"] or "unknown")[:8]
    return Run(commit, f"{machine['cores']} cores, {machine['system']}", command)


def take(cells: PublishedCells, folder: Path) -> int:
    """Put in the cells of a store; returns their number."""
    recipe = json.loads((folder / "recipe.json").read_text())
    kind = recipe["kind"]
    results = Store(folder, kind).read_all(_KEYS[kind])
    cells.add(results, kind, _run(recipe, f"iclnuim {kind}"))
    return len(results)


def pages() -> list[Path]:
    return sorted((TOP / PAGES).glob("*.md"))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--list", action="store_true", help="show pages, marks and commands")
    parser.add_argument("--plan", action="store_true", help="show which cells are missing")
    help = "put the cells of a benchmark's or a stress's folder into the file"
    parser.add_argument(
        "--take", type=Path, metavar="FOLDER", action="append", default=[], help=help
    )
    help = "measure the tables whose marks begin with TEXT"
    parser.add_argument("--measure", metavar="TEXT", help=help)
    args = parser.parse_args(arguments)
    cells = PublishedCells.read(TOP / CELLS)
    if args.list:
        print(listed())
        return 0
    if args.plan:
        print(plan(cells))
        return 0
    for folder in args.take:
        print(f"{folder}: {take(cells, folder)} cells", file=sys.stderr)
    if args.measure is not None:
        chosen = [one for mark, one in COMMAND_TABLES.items() if mark.startswith(args.measure)]
        if not chosen:
            parser.error(f"--measure: no table of a command begins with {args.measure}")
        for table in chosen:
            cells.cells[TABLE, table.mark] = measured(table)
            cells.write(TOP / CELLS)
    cells.write(TOP / CELLS)
    for page in pages():
        page.write_text(redrawn(page.read_text(), cells))
    draw_charts(cells)
    return 0


def draw_charts(cells: PublishedCells) -> None:
    """The pictures that are drawn from the cells of experiments."""
    pictures = TOP / PAGES / "pictures"
    save(accuracy_chart.figure(cells.benchmark()), pictures / "accuracy.png")
    save(stress_chart.figure(stress_summary(cells)), pictures / "stress.png", _STRESS_DPI)


def listed() -> str:
    """The marks of each page, with the commands of those that commands measure."""
    lines = []
    for page in pages():
        for mark, _ in _MARKED.findall(page.read_text()):
            lines.append(f"{PAGES / page.name} {mark}")
            if mark in COMMAND_TABLES:
                lines += [f"    iclnuim {command}" for command in COMMAND_TABLES[mark].commands]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
