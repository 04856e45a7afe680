"""Results of cells that nobody has measured, for tests of tables, findings and reports."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from iclnuim.benchmark.experiments.cells import Cell, all_cells

STATISTICS = ("rmse", "mean", "median", "std", "min", "max")


def result(cell: Cell, ate_m: float, surface_m: float | None = None, **more: object) -> dict:
    """All statistics of an error are that error."""
    made = {
        "cell": cell,
        "frames": 60,
        "lost": 0,
        "degenerate": 0,
        "ate_m": dict.fromkeys(STATISTICS, ate_m),
        **more,
    }
    if surface_m is not None:
        error = dict.fromkeys(STATISTICS, surface_m)
        made["surface"] = {
            "fitted_m": error,
            "given_m": error,
            "quality": {"accuracy_m": surface_m},
        }
    return made


def results(seed: int = 0, seeds: tuple[int, ...] = (0,)) -> list[dict]:
    """Of all cells: random errors between 1 mm and 1 m."""
    rng = np.random.default_rng(seed)
    return [
        result(cell, *(10 ** rng.uniform(-3, 0, 2)).tolist()) for cell in all_cells(seeds=seeds)
    ]


def only(found: list[dict], **words: str) -> list[dict]:
    """Those whose cells have these values."""
    return [
        r for r in found if all(getattr(r["cell"], name) == value for name, value in words.items())
    ]


def with_errors(found: list[dict], factor: float, **words: str) -> list[dict]:
    """The same, the errors of those cells times a factor."""
    changed = {r["cell"] for r in only(found, **words)}
    each = []
    for r in found:
        ate_m = r["ate_m"]["rmse"] * (factor if r["cell"] in changed else 1)
        surface_m = r["surface"]["fitted_m"]["mean"] * (factor if r["cell"] in changed else 1)
        each.append(result(r["cell"], ate_m, surface_m))
    return each


def external(cell: Cell, run: int) -> Cell:
    """Of a system that `iclnuim run` ran on the cell's sequence."""
    return replace(cell, odometer="ORB-SLAM3", preset="final", reference="run", run=run)


def written(out: Path, found: list[dict]) -> Path:
    """As the benchmark leaves them on disk."""
    turn = np.linspace(0, 6, 50)
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    for r in found:
        folder = out / "cells" / r["cell"].name
        folder.mkdir(parents=True)
        path = {
            "stamps_s": (1 + turn).tolist(),
            "truth_m": circle.tolist(),
            "estimate_m": (1.1 * circle).tolist(),
        }
        files = {
            "result": {**r, "cell": asdict(r["cell"])},
            "times": {
                "track_s": 1.5,
                "ms_median": 9.0,
                "ms_95": 12.0,
                "cpu_s": 3.0,
                "peak_mb": 900.0,
            },
            "path": {**path, "error_m": np.full(50, 0.1).tolist()},
        }
        for name, content in files.items():
            (folder / f"{name}.json").write_text(json.dumps(content))
    return out
