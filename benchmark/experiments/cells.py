"""The cells of the benchmark: a sequence, the odometer, and the reference against which frames are
aligned; their names, order and selection.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

from iclnuim import shipped
from iclnuim.benchmark.odometry.registry import ODOMETERS
from iclnuim.errors import InputError

#: Presets of the odometers that the benchmark measures.
PRESETS = ("best", "paper")
NOISES = ("clean", "noisy")
#: In place of a noise: clean frames of the same room rendered without reflections, for finding 11.
LAMBERTIAN = "lambertian"
#: odometer -> its name in tables.
TITLES = {name: entry.title for name, entry in ODOMETERS.items()}
#: Those of the paper that use brightness alone.
PHOTOMETRIC = tuple(name for name, e in ODOMETERS.items() if e.family == "photometric")
#: odometer -> what frames are aligned against, the paper's reference first.
REFERENCES = {name: entry.references for name, entry in ODOMETERS.items()}
#: The reference of a trajectory that an external system wrote.
EXTERNAL = "run"


@dataclass(frozen=True)
class Cell:
    """One measurement. seed: noise seed; 0 is the existing sequence, and clean sequences always
    have 0. For a system of `iclnuim run`,
    odometer is its title, preset the name of its trajectory, reference is EXTERNAL, and `run`
    counts from 1.
    """

    room: str
    trajectory: str
    noise: str
    odometer: str
    preset: str
    reference: str
    seed: int = 0
    run: int = 0

    @property
    def sequence(self) -> str:
        """`living_room/kt0/noisy`; with another seed `living_room/kt0/noisy_3`."""
        return f"{self.room}/{self.trajectory}/{self.noise}" + (
            f"_{self.seed}" if self.seed else ""
        )

    @property
    def name(self) -> str:
        """Folder of the cell, relative to that of all cells."""
        run = f"_{self.run}" if self.run else ""
        return f"{self.sequence}/{self.odometer}_{self.preset}_{self.reference}{run}".replace(
            " ", "-"
        ).replace(":", "-")

    @property
    def external(self) -> bool:
        return self.reference == EXTERNAL

    @property
    def title(self) -> str:
        """Name of the odometer in tables."""
        return TITLES.get(self.odometer, self.odometer)


def all_cells(
    presets: Sequence[str] = ("best",), seeds: Sequence[int] = (0,), references: Sequence[str] = ()
) -> list[Cell]:
    """Cells of both rooms, sequence by sequence, so that the images stay in the file cache.
    references: used for all odometers;
    default: REFERENCES.
    """
    cells = []
    for room, trajectory, noise in product(shipped.SCENE_NAMES, shipped.TRAJECTORY_NAMES, NOISES):
        for seed in seeds if noise == "noisy" else (0,):
            for odometer, preset in product(TITLES, presets):
                for reference in references or REFERENCES[odometer]:
                    cells.append(Cell(room, trajectory, noise, odometer, preset, reference, seed))
    return cells


def lambertian_cells(presets: Sequence[str] = ("best",)) -> list[Cell]:
    """The photometric odometers on the office rendered without reflections."""
    sequences = product(shipped.TRAJECTORY_NAMES, PHOTOMETRIC, presets)
    return [
        Cell("office", kt, LAMBERTIAN, name, preset, REFERENCES[name][0])
        for kt, name, preset in sequences
    ]


def chosen(cells: Iterable[Cell], only: str | None) -> list[Cell]:
    """Select cells with a filter such as `kt0,kt1/icp`: a slash means and, a comma means or. The
    words are compared with room,
    trajectory, noise, odometer, preset and reference.

    Raises InputError for a word that no cell has, and if no cell matches all parts.
    """
    parts = [part.split(",") for part in (only or "").split("/") if part]
    cells = list(cells)
    known = {word for cell in cells for word in _words(cell)}
    if unknown := [word for part in parts for word in part if word not in known]:
        raise InputError(
            f"words of {', '.join(sorted(known))}", setting="only", found=", ".join(unknown)
        )
    found = [cell for cell in cells if all(_words(cell) & set(part) for part in parts)]
    if cells and not found:
        hint = "kt0,kt2/icp for ICP on kt0 and on kt2: a comma means or, a slash means and"
        raise InputError(
            "a filter that matches at least one cell", setting="only", found=only, hint=hint
        )
    return found


def _words(cell: Cell) -> set[str]:
    return {cell.room, cell.trajectory, cell.noise, cell.odometer, cell.preset, cell.reference}
