"""Results of cells that nobody has measured, for tests of tables, findings and reports."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from iclnuim.benchmark.experiments.cell import Cell, Measured
from iclnuim.benchmark.experiments.recipes.paper.keys import PaperKey, all_keys
from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND
from iclnuim.benchmark.experiments.store import Store

STATISTICS = ("rmse", "mean", "median", "std", "min", "max")


def result(key: PaperKey, ate_m: float, surface_m: float | None = None, **more: object) -> Measured:
    """All statistics of an error are that error."""
    made = {
        "frames": 60,
        "lost": 0,
        "degenerate": 0,
        "ate_m": dict.fromkeys(STATISTICS, ate_m),
        "times": {"track_s": 1.5, "ms_median": 9.0, "ms_95": 12.0, "cpu_s": 3.0},
        **more,
    }
    if surface_m is not None:
        error = dict.fromkeys(STATISTICS, surface_m)
        quality = {"accuracy_m": surface_m}
        made["surface"] = {"fitted_m": error, "given_m": error, "quality": quality}
    return Measured(key, {}, made)


def results(seed: int = 0, seeds: tuple[int, ...] = (0,)) -> list[Measured]:
    """Of all cells: random errors between 1 mm and 1 m."""
    rng = np.random.default_rng(seed)
    return [result(key, *(10 ** rng.uniform(-3, 0, 2)).tolist()) for key in all_keys(seeds=seeds)]


def only(found: Sequence[Measured], **words: str) -> list[Measured]:
    """Those whose keys have these values."""
    return [r for r in found if all(getattr(r.key, name) == v for name, v in words.items())]


def with_errors(found: list[Measured], factor: float, **words: str) -> list[Measured]:
    """The same, the errors of those cells times a factor."""
    changed = {r.key for r in only(found, **words)}
    each = []
    for r in found:
        times = factor if r.key in changed else 1
        ate_m = r.figures["ate_m"]["rmse"] * times
        each.append(result(r.key, ate_m, r.figures["surface"]["fitted_m"]["mean"] * times))
    return each


def external(key: PaperKey, run: int) -> PaperKey:
    """Of a system that `iclnuim run` ran on the cell's sequence."""
    return replace(key, odometer="ORB-SLAM3", preset="final", reference="run", run=run)


def written(out: Path, found: list[Measured]) -> Path:
    """As the benchmark leaves them on disk."""
    turn = np.linspace(0, 6, 50)
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    path = {
        "stamps_s": (1 + turn).tolist(),
        "truth_m": circle.tolist(),
        "estimate_m": (1.1 * circle).tolist(),
        "error_m": np.full(50, 0.1).tolist(),
    }
    store = Store(out, KIND)
    store.open({"first": None})
    for r in found:
        with store.files(Cell(r.key, {})):
            pass
        store.write(Cell(r.key, {}), {**r.figures, "path": path})
    return out
