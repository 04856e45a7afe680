"""The cells of the benchmark: a sequence, what estimates the motion on it, and against what; their names, order and choice."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

from iclnuim import shipped
from iclnuim.errors import InputError

NOISES = ("clean", "noisy")
#: odometer -> what it is called in the paper, in the paper's order.
TITLES = {"dvo": "DVO", "fovis": "FOVIS", "rgbd": "RGB-D", "icp": "ICP", "icp_rgbd": "ICP+RGB-D"}
#: odometer -> what frames are aligned against. The first is the paper's: frame to frame, or a model of all frames before.
REFERENCES = {
    "dvo": ("default", "model"),
    "fovis": ("default",),
    "rgbd": ("default",),
    "icp": ("model", "default"),
    "icp_rgbd": ("model", "default"),
}
#: The reference of a trajectory that another program has written.
EXTERNAL = "run"


@dataclass(frozen=True)
class Cell:
    """One measurement. seed: of the noise, 0 being that of the given sequence; of clean sequences always 0. Of a system that `iclnuim run` ran: odometer
    is its title, preset the name of its trajectory, reference EXTERNAL, and `run` counts from 1.
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
        """`living_room/kt0/noisy`, with another seed `living_room/kt0/noisy_3`."""
        return f"{self.room}/{self.trajectory}/{self.noise}" + (f"_{self.seed}" if self.seed else "")

    @property
    def name(self) -> str:
        """Its folder below that of all cells."""
        run = f"_{self.run}" if self.run else ""
        return f"{self.sequence}/{self.odometer}_{self.preset}_{self.reference}{run}".replace(" ", "-").replace(
            ":", "-"
        )

    @property
    def external(self) -> bool:
        return self.reference == EXTERNAL

    @property
    def title(self) -> str:
        """The odometer as tables call it."""
        return TITLES.get(self.odometer, self.odometer)


def all_cells(
    presets: Sequence[str] = ("best",), seeds: Sequence[int] = (0,), references: Sequence[str] = ()
) -> list[Cell]:
    """Of both rooms, sequence by sequence, so that images are read while they are in memory. references: the same for all odometers;
    default: REFERENCES.
    """
    cells = []
    for room, trajectory, noise in product(shipped.SCENE_NAMES, shipped.TRAJECTORY_NAMES, NOISES):
        for seed in seeds if noise == "noisy" else (0,):
            for odometer, preset in product(TITLES, presets):
                for reference in references or REFERENCES[odometer]:
                    cells.append(Cell(room, trajectory, noise, odometer, preset, reference, seed))
    return cells


def chosen(cells: Iterable[Cell], only: str | None) -> list[Cell]:
    """`kt0,kt1/icp`: cells that have one of the words of each part among room, trajectory, noise, odometer, preset and reference.

    Raises InputError for a word that no cell has, and where no cell has one of each part.
    """
    parts = [part.split(",") for part in (only or "").split("/") if part]
    cells = list(cells)
    known = {word for cell in cells for word in _words(cell)}
    if unknown := [word for part in parts for word in part if word not in known]:
        raise InputError(f"words of {', '.join(sorted(known))}", setting="only", found=", ".join(unknown))
    found = [cell for cell in cells if all(_words(cell) & set(part) for part in parts)]
    if cells and not found:
        hint = "kt0,kt2/icp for ICP on kt0 and on kt2: a comma is or, a slash is and"
        raise InputError("words that some cell has all of", setting="only", found=only, hint=hint)
    return found


def _words(cell: Cell) -> set[str]:
    return {cell.room, cell.trajectory, cell.noise, cell.odometer, cell.preset, cell.reference}
