"""The cells of the paper's experiments: their keys, order and selection, and what measuring one
needs.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from iclnuim import shipped
from iclnuim.benchmark.fusion import settings as fusion
from iclnuim.benchmark.odometry.references import MODELS
from iclnuim.benchmark.odometry.registry import ODOMETERS
from iclnuim.errors import InputError

#: Presets of the odometers that the benchmark measures.
PRESETS = ("best", "paper")
NOISES = ("clean", "noisy")
#: In place of a noise: clean frames of the same room rendered without reflections, for finding 11.
LAMBERTIAN = "lambertian"
#: In place of references: for each odometer the one that the paper used.
PAPER_REFERENCES = "paper"
#: The reference of a trajectory that an external system wrote.
EXTERNAL = "run"


@dataclass(frozen=True)
class PaperKey:
    """One measurement. seed: noise seed; 0 is the existing sequence, and clean sequences always
    have 0. For a system of `iclnuim run`, odometer is its title, preset the name of its trajectory,
    reference is EXTERNAL, and `run` counts from 1.
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
        seed = f"_{self.seed}" if self.seed else ""
        return f"{self.room}/{self.trajectory}/{self.noise}{seed}"

    @property
    def place(self) -> str:
        run = f"_{self.run}" if self.run else ""
        name = f"{self.odometer}_{self.preset}_{self.reference}{run}"
        return f"{self.sequence}/{name}".replace(" ", "-").replace(":", "-")

    @property
    def external(self) -> bool:
        return self.reference == EXTERNAL

    @property
    def against_model(self) -> bool:
        """Whether its frames are aligned against a fused model."""
        return self.reference in MODELS

    @property
    def words(self) -> set[str]:
        """The words by which a filter selects it."""
        return {
            self.room, self.trajectory, self.noise, self.odometer, self.preset, self.reference,
        }  # fmt: skip


def all_keys(
    presets: Sequence[str] = ("best",), seeds: Sequence[int] = (0,), references: Sequence[str] = ()
) -> list[PaperKey]:
    """Keys of all rooms, sequence by sequence, so that the images stay in the file cache.
    references: used for all odometers, or PAPER_REFERENCES; default: those of the registry.
    """
    keys = []
    sequences = [*shipped.paper_sequences(), *shipped.further_sequences()]
    for sequence, noise in product(sequences, NOISES):
        room, _, trajectory = sequence.partition("/")
        for seed in seeds if noise == "noisy" else (0,):
            for (name, entry), preset in product(ODOMETERS.items(), presets):
                of_paper = entry.references[:1] if PAPER_REFERENCES in references else ()
                others = [name for name in references if name != PAPER_REFERENCES]
                for reference in dict.fromkeys([*of_paper, *others]) or entry.references:
                    key = PaperKey(room, trajectory, noise, name, preset, reference, seed=seed)
                    keys.append(key)
    return keys


def lambertian_keys(presets: Sequence[str] = ("best",)) -> list[PaperKey]:
    """The paper's photometric odometers on the office rendered without reflections."""
    keys = []
    for kt, name, preset in product(shipped.TRAJECTORY_NAMES, family("photometric"), presets):
        reference = ODOMETERS[name].references[0]
        keys.append(PaperKey("office", kt, LAMBERTIAN, name, preset, reference))
    return keys


def family(name: str) -> list[str]:
    """The paper's odometers of a family."""
    return [key for key, entry in ODOMETERS.items() if entry.in_paper and entry.family == name]


def paper_odometers() -> list[str]:
    """The paper's five odometers, in the paper's order."""
    return [name for name, entry in ODOMETERS.items() if entry.in_paper]


def chosen(keys: Iterable[PaperKey], only: str | None) -> list[PaperKey]:
    """Select keys with a filter such as `kt0,kt1/icp`: a slash means and, a comma means or. The
    words are compared with room, trajectory, noise, odometer, preset and reference.

    Raises InputError for a word that no key has, and if no key matches all parts.
    """
    parts = [part.split(",") for part in (only or "").split("/") if part]
    keys = list(keys)
    known = set().union(*(key.words for key in keys))
    unknown = [word for word in sum(parts, []) if word not in known]
    if unknown:
        expected = f"words of {', '.join(sorted(known))}"
        raise InputError(expected, setting="only", found=", ".join(unknown))
    found = [key for key in keys if all(key.words & set(part) for part in parts)]
    if keys and not found:
        hint = "kt0,kt2/icp for icp on kt0 and on kt2: a comma means or, a slash means and"
        expected = "a filter that matches at least one cell"
        raise InputError(expected, setting="only", found=only, hint=hint)
    return found


# -- what measuring a cell needs

#: Core-seconds of a frame that is tracked, by preset and the model that it is aligned with, if any,
#: and of one that is fused and compared: the largest mean of an odometer over the shipped cells
#: (tests/benchmark/test_plan.py).
_TRACK_CORE_S = {
    ("best", ""): 0.04,
    ("best", "model"): 0.14,
    ("best", "model-ahead"): 0.14,
    ("paper", ""): 0.14,
    ("paper", "model"): 1.0,
    ("paper", "model-ahead"): 1.4,
}
_FUSE_CORE_S = 0.19
#: Minimum weight of a voxel for the mesh of a noisy sequence: its surface must be seen by this many
#: frames.
_MIN_NOISY_WEIGHT = 3.0
#: Limits of the heat maps' scale in mm. It is logarithmic and the same for all cells.
HEAT_MM = (0.1, 100.0)


@dataclass(frozen=True)
class PaperTask:
    """folder: the sequence. first: use only the first N frames. model: file with the room's
    triangles; None: no surface is measured. trajectory: file written by an external system; None:
    the cell's odometer estimates it. work: folder for data shared by cells, which can be
    recomputed.
    """

    key: PaperKey
    folder: Path
    first: int | None
    model: Path | None
    trajectory: Path | None
    work: Path


class Meter:
    """The library's progress display, which it calls as `progress(total, label)`."""

    def __init__(self, advance: Callable[[int], object]) -> None:
        self._advance = advance

    def __call__(self, total: int = 0, label: str = "") -> "Meter":
        return self

    def advance(self, count: int = 1) -> None:
        self._advance(count)


def fuse_settings(key: PaperKey, first: int | None) -> fusion.FuseSettings:
    """The fusion settings: the volume by the cell's preset, its window by the cell's reference,
    `min_weight` by its noise.
    """
    volume = fusion.PRESETS.get(key.preset, fusion.PRESETS["best"])
    if key.reference == "model-ahead":
        volume = replace(volume, ahead=1.0)
    min_weight = _MIN_NOISY_WEIGHT if key.noise == "noisy" else fusion.FuseSettings().min_weight
    return fusion.FuseSettings(volume, min_weight, f":{first or ''}")


def core_seconds(key: PaperKey, tracks: bool, surface: bool) -> float:
    """Expected core-seconds of a frame of a cell. tracks: its trajectory is estimated; surface: it is
    fused and compared.
    """
    model = key.reference if key.against_model else ""
    track_s = 0.0 if key.external else _TRACK_CORE_S[key.preset, model]
    return tracks * track_s + surface * _FUSE_CORE_S
