"""Reads and checks the file of perturbations."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.errors import InputError
from iclnuim.formats.files import read_text
from iclnuim.settings import MISSING, Settings, parameter, plain, refuse_unknown

from .registry import functions
from .segment import Segment

FILE = Path(__file__).with_name("perturbations.toml")
SEVERITIES = 5
FUNCTIONS = functions()
#: The frames that are perturbed: as rendered, or with the sensor's noise.
CLEAN, NOISY = "clean", "noisy"
BASES = (NOISY, CLEAN)
#: Where a perturbation acts: on the room and its light, before the sensor's noise; on what the
#: sensor gives, after it; or it is the noise itself, in the place of the base's.
SCENE, SENSOR, NOISE = "scene", "sensor", "noise"
_ACTS_ON = {
    SCENE: "the room and its light",
    SENSOR: "what the sensor gives",
    NOISE: "the sensor's noise",
}
#: The perturbation that is the noise of the base NOISY at this level.
_BASE_NOISE = ("noise", 1.0)


@dataclass(frozen=True)
class Bounds(Settings):
    """Limits beyond which a pose is wrong, and conditions for the success of a run."""

    group = "bounds of a stress cell"

    step_m: float = parameter(
        0.02, "error of one step beyond which a pose is wrong", unit="m", low=0.0
    )
    step_deg: float = parameter(1.0, "the same for its rotation", unit="degrees", low=0.0)
    second_m: float = parameter(
        0.05, "error over one second beyond which a pose is wrong", unit="m", low=0.0
    )
    second_deg: float = parameter(2.0, "the same for its rotation", unit="degrees", low=0.0)
    success_m: float = parameter(0.10, "ATE up to which a run succeeds", unit="m", low=0.0)
    min_coverage: float = parameter(
        0.5, "minimum share of frames with a pose for a run to succeed", low=0.0, high=1.0
    )
    min_fitness: float = parameter(
        0.3, "fitness of Open3D below which its alignment counts as failed", low=0.0
    )


@dataclass(frozen=True)
class Perturbation(Settings):
    """A change of frames, with its level at each severity from 1 on."""

    group = "settings of a perturbation"

    about: str = parameter(MISSING, "short description")
    unit: str = parameter(MISSING, "unit of its levels")
    levels: tuple[float, ...] = parameter(MISSING, "a level for each severity")
    acts_on: str = parameter(SCENE, "where it acts", choices=_ACTS_ON)
    puts_in: bool = parameter(False, "it puts an object into the scene, which a mask shows")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.levels) != SEVERITIES:
            raise InputError(f"{SEVERITIES} levels", found=len(self.levels))

    def level(self, severity: int) -> str:
        """`40 % of the view`."""
        return f"{plain(self.levels[severity - 1])} {self.unit}"


@dataclass(frozen=True, eq=False)
class Plan:
    """The content of the file: its text, number of frames of a segment, seed, starts by sequence,
    perturbations by name, and their fixed settings; and the bounds of a cell.
    """

    text: str
    frames: int
    seed: int
    starts: Mapping[str, list]
    perturbations: Mapping[str, Perturbation]
    fixed: Mapping[str, Mapping[str, float]]
    bounds: Bounds = Bounds()

    def apply(self, name: str, severity: int, segment: Segment, base: str = CLEAN) -> Segment:
        """The perturbed segment; only the base's noise, if it has one, for severity 0. segment: as
        rendered.
        """
        if base == CLEAN:
            return self._perturbed(name, severity, segment)
        acts_on = self.perturbations[name].acts_on if severity else SCENE
        if acts_on == SCENE:
            return with_base_noise(self._perturbed(name, severity, segment))
        if acts_on == SENSOR:
            segment = with_base_noise(segment)
        return self._perturbed(name, severity, segment)

    def _perturbed(self, name: str, severity: int, segment: Segment) -> Segment:
        if severity == 0:
            return segment
        level = self.perturbations[name].levels[severity - 1]
        return FUNCTIONS[name](segment, level, **self.fixed[name])

    def put_in(self, name: str, severity: int, segment: Segment, number: int) -> np.ndarray:
        """(h, w) whether a pixel shows what the perturbation puts into the scene: its depth is not
        that of the room, or its colour does not depend on that of the room. segment: as rendered.
        """
        colours = []
        for value in (0, 255):
            plain = _painted(segment, value)
            colour, depth_z_m = self._perturbed(name, severity, plain).load(number)
            colours.append(colour)
        same = (colours[0] == colours[1]).all(-1)
        return np.asarray(same | (depth_z_m != segment.load(number)[1]))

    def starts_of(self, sequence: str, length: int) -> list[int]:
        """First frames of the segments of a sequence with `length` frames: those in the file, or
        computed from its shares.
        """
        free = max(0, length - self.frames)
        shares = sorted({int(share * free) for share in self.starts["shares"]})
        fixed = list(self.starts.get(sequence, shares))
        return fixed if max(fixed) + self.frames <= length else shares

    def table(self) -> str:
        """One line per perturbation, with its severities."""
        width = max(map(len, self.perturbations))
        about = max(len(p.about) for p in self.perturbations.values())
        rows = []
        for name, p in self.perturbations.items():
            levels = "  ".join(f"{plain(level):>5}" for level in p.levels)
            rows.append(f"{name:<{width}}  {p.about:<{about}}  {levels}  {p.unit}")
        return "\n".join(rows)


def _painted(segment: Segment, value: int) -> Segment:
    """The segment with every value of its colour the same."""
    return segment.with_colour(lambda number, colour: np.full_like(colour, value))


def with_base_noise(segment: Segment) -> Segment:
    """The segment with the noise of the base NOISY."""
    name, level = _BASE_NOISE
    return FUNCTIONS[name](segment, level)


def read_plan(path: Path = FILE) -> Plan:
    """Read a plan. Raises InputError, which names the location, if the file is invalid."""
    text = read_text(path, "perturbations (TOML)")
    try:
        content: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError("TOML", path=path, found=error) from None
    keys = ("frames", "seed", "starts", "perturbations")
    refuse_unknown(content, keys, f"{path}")
    entries = content["perturbations"]
    refuse_unknown(entries, FUNCTIONS, "perturbations")
    fixed = {name: entry.pop("fixed", {}) for name, entry in entries.items()}
    try:
        perturbations = {name: Perturbation.from_dict(entry) for name, entry in entries.items()}
    except InputError as error:
        raise error.at(path) from None
    return Plan(
        text=text,
        frames=content["frames"],
        seed=content["seed"],
        starts=content["starts"],
        perturbations=perturbations,
        fixed=fixed,
    )
