"""Figures for tables and findings by room, trajectory, noise and odometer: ours from the measured
cells, and those printed in the paper.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, TypeAlias

from iclnuim.benchmark.odometry.registry import ODOMETERS
from iclnuim.formats.files import read_json

from ...cell import Measured
from .keys import EXTERNAL, PaperKey

#: (room, noise) -> number of the paper's table.
ATE_TABLES = {
    ("living_room", "clean"): "3",
    ("office", "clean"): "4",
    ("living_room", "noisy"): "5",
    ("office", "noisy"): "6",
}
#: Odometer of the paper -> its authors' own program, a system of `iclnuim run`.
AUTHORS = {"fovis": "libfovis", "dvo": "dvo_core"}
SURFACE_TABLES = {("living_room", "clean"): "2", ("living_room", "noisy"): "7"}


@cache
def paper() -> dict:
    """paper.json: tables by number, findings, and the note on a misprint."""
    return read_json(Path(__file__).parent / "paper.json")


@dataclass(frozen=True)
class Where:
    """A sequence and an odometer. reference: by default the one that the paper used for it."""

    room: str
    trajectory: str
    noise: str
    odometer: str
    reference: str = ""


class Printed:
    """The figures printed in the paper: errors in metres, None if a figure is missing, as for a
    reference that the paper did not use.
    """

    def ate(self, where: Where, statistic: str = "rmse") -> float | None:
        return self._of(ATE_TABLES, where, statistic)

    def surface(self, where: Where, statistic: str = "mean") -> float | None:
        return self._of(SURFACE_TABLES, where, statistic)

    def _of(
        self, numbers: Mapping[tuple[str, str], str], where: Where, statistic: str
    ) -> float | None:
        number = numbers.get((where.room, where.noise))
        if number is None or where.reference not in ("", reference_of(where.odometer)):
            return None
        table = paper()["tables"][number]
        return table.get(where.odometer, {}).get(where.trajectory, {}).get(statistic)


@dataclass(eq=False)
class Ours:
    """The same figures of the measured cells of one preset and one noise seed. model: the reference
    that stands for the paper's model. programs: odometers -> titles of systems that stand in their
    place.
    """

    results: Sequence[Measured]
    preset: str = "best"
    seed: int = 0
    model: str = "model"
    programs: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def _by_key(self) -> dict[PaperKey, Measured]:
        return {result.key: result for result in self.results}

    def result(self, where: Where) -> Measured | None:
        """The result of a cell; None if it was not measured."""
        sequence = (where.room, where.trajectory, where.noise)
        seed = self.seed if where.noise == "noisy" else 0
        if where.odometer in self.programs:
            system = system_key(sequence, self.programs[where.odometer], run=1)
            return None if where.reference or seed else self._by_key.get(system)
        reference = where.reference or reference_of(where.odometer)
        if reference == "model":
            reference = self.model
        key = PaperKey(*sequence, where.odometer, self.preset, reference, seed)
        return self._by_key.get(key)

    def figures(self, where: Where) -> Mapping[str, Any]:
        """The figures of a cell; {} if it was not measured."""
        result = self.result(where)
        return result.figures if result else {}

    def ate(self, where: Where, statistic: str = "rmse") -> float | None:
        return ate_of(self.figures(where), statistic)

    def surface(self, where: Where, statistic: str = "mean") -> float | None:
        return surface_of(self.figures(where), statistic)

    def degenerate(self, where: Where) -> float | None:
        """Share of frames that an odometer reported as under-constrained."""
        figures = self.figures(where)
        return figures["degenerate"] / figures["frames"] if "degenerate" in figures else None


PaperFigures: TypeAlias = Printed | Ours


def reference_of(odometer: str) -> str:
    """The reference that the paper used for an odometer."""
    return ODOMETERS[odometer].references[0]


def system_key(sequence: tuple[str, str, str], title: str, run: int = 0) -> PaperKey:
    """The key of a run of a system on a room, trajectory and noise; run 0 stands for all."""
    return PaperKey(*sequence, title, "final", EXTERNAL, run=run)


def ate_of(figures: Mapping[str, Any], statistic: str = "rmse") -> float | None:
    return figures.get("ate_m", {}).get(statistic)


def surface_of(
    figures: Mapping[str, Any], statistic: str = "mean", how: str = "fitted_m"
) -> float | None:
    """Distance in metres of the surface's vertices to the model, aligned by ICP as in the paper
    (fitted_m), or by the first pose (given_m).
    """
    return figures.get("surface", {}).get(how, {}).get(statistic)


def presets_of(results: Iterable[Measured]) -> list[str]:
    """Presets of the measured cells of our odometers, `best` first; ["best"] if there are none."""
    keys = [r.key for r in results if r.key.odometer in ODOMETERS and not r.key.external]
    return sorted({key.preset for key in keys}) or ["best"]


def seeds_of(results: Iterable[Measured], preset: str) -> list[int]:
    """Noise seeds of the cells of a preset; [0] if there are none."""
    return sorted({r.key.seed for r in results if r.key.preset == preset}) or [0]
