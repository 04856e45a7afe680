"""Figures for tables and findings by room, trajectory, noise and odometer: ours from the measured
cells, and those printed in the paper.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Protocol

from iclnuim.formats.files import read_json

from .cells import REFERENCES, TITLES, Cell

#: (room, noise) -> number of the paper's table.
ATE_TABLES = {
    ("living_room", "clean"): "3",
    ("office", "clean"): "4",
    ("living_room", "noisy"): "5",
    ("office", "noisy"): "6",
}
SURFACE_TABLES = {("living_room", "clean"): "2", ("living_room", "noisy"): "7"}


@cache
def paper() -> dict:
    """paper.json: tables by number, findings, and the note on a misprint."""
    return read_json(Path(__file__).parent / "paper.json")


class Figures(Protocol):
    """Access to errors in metres; None if a figure is missing.

    The default reference is the one that the paper used for the odometer.
    """

    def ate(
        self,
        room: str,
        trajectory: str,
        noise: str,
        odometer: str,
        statistic: str = "rmse",
        reference: str = "",
    ) -> float | None: ...

    def surface(
        self,
        room: str,
        trajectory: str,
        noise: str,
        odometer: str,
        statistic: str = "mean",
        reference: str = "",
    ) -> float | None: ...

    def degenerate(self, room: str, trajectory: str, noise: str, odometer: str) -> float | None:
        """Share of frames that an odometer reported as under-constrained."""
        ...


class Printed:
    """The figures printed in the paper; None for a reference that the paper did not use."""

    def _of(
        self, table: str | None, trajectory: str, odometer: str, statistic: str, reference: str
    ) -> float | None:
        if table is None or reference not in ("", *REFERENCES[odometer][:1]):
            return None
        return paper()["tables"][table].get(odometer, {}).get(trajectory, {}).get(statistic)

    def ate(
        self,
        room: str,
        trajectory: str,
        noise: str,
        odometer: str,
        statistic: str = "rmse",
        reference: str = "",
    ) -> float | None:
        return self._of(ATE_TABLES.get((room, noise)), trajectory, odometer, statistic, reference)

    def surface(
        self,
        room: str,
        trajectory: str,
        noise: str,
        odometer: str,
        statistic: str = "mean",
        reference: str = "",
    ) -> float | None:
        return self._of(
            SURFACE_TABLES.get((room, noise)), trajectory, odometer, statistic, reference
        )

    def degenerate(self, room: str, trajectory: str, noise: str, odometer: str) -> float | None:
        return None


@dataclass(eq=False)
class Ours:
    """The figures of the measured cells of one preset and one noise seed."""

    results: Sequence[dict]
    preset: str = "best"
    seed: int = 0
    _by_cell: dict[Cell, dict] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._by_cell = {result["cell"]: result for result in self.results}

    def result(
        self, room: str, trajectory: str, noise: str, odometer: str, reference: str = ""
    ) -> dict:
        """The result of a cell; {} if it was not measured."""
        seed = self.seed if noise == "noisy" else 0
        cell = Cell(
            room,
            trajectory,
            noise,
            odometer,
            self.preset,
            reference or REFERENCES[odometer][0],
            seed,
        )
        return self._by_cell.get(cell, {})

    def ate(
        self,
        room: str,
        trajectory: str,
        noise: str,
        odometer: str,
        statistic: str = "rmse",
        reference: str = "",
    ) -> float | None:
        return ate_of(self.result(room, trajectory, noise, odometer, reference), statistic)

    def surface(
        self,
        room: str,
        trajectory: str,
        noise: str,
        odometer: str,
        statistic: str = "mean",
        reference: str = "",
    ) -> float | None:
        return surface_of(self.result(room, trajectory, noise, odometer, reference), statistic)

    def degenerate(self, room: str, trajectory: str, noise: str, odometer: str) -> float | None:
        result = self.result(room, trajectory, noise, odometer)
        return result["degenerate"] / result["frames"] if "degenerate" in result else None


def ate_of(result: dict, statistic: str = "rmse") -> float | None:
    return result.get("ate_m", {}).get(statistic)


def surface_of(result: dict, statistic: str = "mean", how: str = "fitted_m") -> float | None:
    """Distance in metres of the surface's vertices to the model, aligned by ICP as in the paper
    (fitted_m), or by the first pose (given_m).
    """
    return result.get("surface", {}).get(how, {}).get(statistic)


def presets_of(results: Iterable[dict]) -> list[str]:
    """Presets of the measured cells of our odometers, `best` first."""
    return sorted(
        {
            r["cell"].preset
            for r in results
            if r["cell"].odometer in TITLES and not r["cell"].external
        }
    )


def seeds_of(results: Iterable[dict], preset: str) -> list[int]:
    """Noise seeds of the cells of a preset; [0] if there are none."""
    return sorted({r["cell"].seed for r in results if r["cell"].preset == preset}) or [0]
