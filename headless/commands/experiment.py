"""`iclnuim experiment`: measures an experiment of your own, or one of those in
benchmark/experiments/recipes, on sequences, and writes tables and a page.
"""

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import locked, make_folder
from iclnuim.sequences.frame_pool import cores
from iclnuim.settings import declared, plain

from ..method_options import open_sequence, require
from ..options import FRAMES, add_frames, common, count
from ..sequence_input import add_camera_options

if TYPE_CHECKING:
    from iclnuim.benchmark.experiments.experiment import Experiment
    from iclnuim.benchmark.experiments.inputs import Input


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = (
        "an experiment of --list, or your own: a Python file or folder (docs/guide/experiments.md)"
    )
    add("name", nargs="?", metavar="NAME", help=help)
    add("folders", type=Path, nargs="*", metavar="DIR", help="sequences with ground truth")
    add("--list", action="store_true", help="only list the experiments and their settings")
    help = "a setting of the experiment; may be given several times"
    add("--set", action="append", default=[], metavar="NAME=VALUE", help=help)
    help = "folder of the cells, by which the command resumes; default: out/NAME"
    add("-o", "--out", type=Path, metavar="OUT", help=help)
    help = "number of processes; default: one per core. With one, times can be compared"
    add("--workers", type=count, metavar="N", help=help)
    help = "tables and page of the cells that are there; measure nothing"
    add("--report-only", action="store_true", help=help)
    add_frames(parser, FRAMES)
    add_camera_options(parser)
    common(parser, "iclnuim experiment loading.py out/living_room/kt2/clean --set repeats=5")


def run(args: Namespace, console: Console) -> int:
    """Exit code 3 if a cell could not be measured; all other cells are measured."""
    require(console, "experiment", "numba", "cv2")
    from iclnuim.benchmark.experiments.store import Store

    known = _known(args.name)
    if args.list or not args.name:
        console.result(*_listed(known))
        return 0
    kind = known[args.name]
    name = Path(args.name).stem
    experiment = kind(**_settings(kind, args.set))
    inputs = _inputs(args, console)
    store = Store(args.out or Path("out") / name, name)
    make_folder(store.out, hint="another {out}")
    problems: list[str] = []
    if not args.report_only:
        with locked(store.out):
            problems = experiment.run(inputs, store, args.workers or cores(), console)
    for problem in problems:
        console.note(problem)
    results = store.read(experiment.cells(inputs))
    if not results:
        raise WorkError(f"{store.out}: no measured cells")
    console.note(f"{experiment.write(store, results)} written")
    cells = [{**vars(one.key), **one.figures} for one in results]
    console.result(
        {"cells": cells}, "\n\n".join(table.text() for table in experiment.tables(results))
    )
    return 3 if problems else 0


def _known(name: str | None) -> "Mapping[str, type[Experiment]]":
    """The experiments by name, with the user's own. Raises InputError if it is none of them."""
    from iclnuim.benchmark.experiments.experiment import own_experiment
    from iclnuim.benchmark.experiments.recipes import experiments

    known = experiments()
    if name is None or name in known:
        return known
    if Path(name).exists():
        return known | {name: own_experiment(Path(name))}
    expected = f"an experiment ({', '.join([*known, 'a Python file or folder'])})"
    raise InputError(expected, found=name)


def _listed(known: "Mapping[str, type[Experiment]]") -> tuple[dict[str, Any], str]:
    """The experiments with their settings, as values and as text."""
    values = {}
    lines = []
    for name, kind in known.items():
        settings = declared(kind)
        values[name] = {"about": kind.about(), "settings": kind().to_dict()}
        lines.append(f"{name}: {kind.about()}")
        lines += [f"  {s.name}={plain(s.default)}  {s.help}" for s in settings.values()]
    others = (
        "iclnuim benchmark, stress, run and bench curve are experiments with commands of their own"
    )
    return values, "\n".join([*lines, others])


def _settings(kind: "type[Experiment]", given: list[str]) -> dict[str, Any]:
    """The settings of --set. Raises InputError for another name, or a value that is none."""
    known = declared(kind)
    values = {}
    for text in given:
        name, sign, value = text.partition("=")
        if not sign or name not in known:
            expected = f"NAME=VALUE with NAME of {', '.join(known) or 'no settings'}"
            raise InputError(expected, setting="--set", found=text)
        setting = known[name]
        try:
            values[name] = (setting.parse or setting.kind)(value)
        except ValueError:
            values[name] = value  # the experiment says what it expects
    return values


def _inputs(args: Namespace, console: Console) -> "list[Input]":
    """The opened sequences. Raises InputError if there is none, or two have one name."""
    from iclnuim.benchmark.experiments.inputs import Input, rendered_name

    found = {}
    for folder in args.folders:
        sequence = open_sequence(args, console, folder, frames=args.frames)
        name = rendered_name(folder)
        found[name] = Input.of(sequence, name)
    if not found or len(found) < len(args.folders):
        names = ", ".join(map(str, args.folders)) or "none"
        raise InputError("sequences with different names", found=names)
    return list(found.values())
