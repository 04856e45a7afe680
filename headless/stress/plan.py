"""A file of perturbations, read and checked, and the functions that their names stand for."""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from iclnuim.errors import InputError
from iclnuim.formats.files import read_text
from iclnuim.settings import MISSING, Settings, parameter, plain, refuse_unknown

from . import corruptions, filters, motion, surfaces
from .stretch import Stretch

#: The scales of perturbations; the first is ours.
SCALES = {name: Path(__file__).with_name(f"{name}.toml") for name in ("perturbations", "corruptions")}
SEVERITIES = 5
#: Perturbation -> function(stretch, level, fixed settings by keyword).
FUNCTIONS: dict[str, Callable[..., Stretch]] = {
    function.__name__: function
    for function in (
        surfaces.bare_wall,
        surfaces.thin_structures,
        filters.flat_texture,
        surfaces.mirror_bars,
        surfaces.glass,
        surfaces.gloss,
        surfaces.moving_object,
        motion.speed,
        motion.dropped_frames,
        filters.black_frames,
        motion.frozen_frames,
        filters.holes,
        filters.range_cut,
        filters.noise,
        filters.low_light,
        filters.exposure_steps,
        filters.exposure_hunting,
        filters.gamma_steps,
        motion.motion_blur,
        motion.rolling_shutter,
        motion.out_of_step,
        filters.misregistered,
        filters.calibration_off,
        filters.guess_off,
        corruptions.gaussian_noise,
        corruptions.shot_noise,
        corruptions.impulse_noise,
        corruptions.speckle_noise,
        corruptions.gaussian_blur,
        corruptions.defocus_blur,
        corruptions.contrast,
        corruptions.brightness,
        corruptions.jpeg_compression,
        corruptions.pixelate,
        corruptions.depth_noise,
        corruptions.depth_edge_erosion,
        corruptions.depth_fixed_mask,
        corruptions.depth_range,
    )
}


@dataclass(frozen=True)
class Bounds(Settings):
    """When a pose is wrong, and when a run succeeds."""

    group = "settings of [bounds] in a file of perturbations"

    step_m: float = parameter(0.02, "error of one step beyond which a pose is wrong", unit="m", low=0.0)
    step_deg: float = parameter(1.0, "the same of its rotation", unit="degrees", low=0.0)
    second_m: float = parameter(0.05, "error over a second beyond which a pose is wrong", unit="m", low=0.0)
    second_deg: float = parameter(2.0, "the same of its rotation", unit="degrees", low=0.0)
    success_m: float = parameter(0.10, "ATE up to which a run succeeds", unit="m", low=0.0)
    min_coverage: float = parameter(0.5, "share of the frames that a run that succeeds has poses of", low=0.0, high=1.0)
    min_fitness: float = parameter(0.3, "Open3D's fitness below which it is taken to say that it failed", low=0.0)


@dataclass(frozen=True)
class Calibration(Settings):
    """When severities are worth their names, by third-party odometers: how much the median error grows at 1 and at 2; at 5 more than half fail."""

    group = "settings of [calibration] in a file of perturbations"

    depth_alone: tuple[str, ...] = parameter(MISSING, "odometers that do not read colour")
    growth_at_1: float = parameter(1.5, "of the error at severity 1, at least", low=1.0)
    growth_at_2: float = parameter(2.0, "the same at severity 2", low=1.0)


@dataclass(frozen=True)
class Perturbation(Settings):
    """What is done to frames, and how much of it at each severity, from 1 on."""

    group = "settings of a perturbation"

    about: str = parameter(MISSING, "what it is, in a phrase")
    unit: str = parameter(MISSING, "of its levels")
    levels: tuple[float, ...] = parameter(MISSING, "a level for each severity")
    judged_by: str = parameter(
        "all",
        "third-party odometers that its severities were chosen by",
        choices={"all": "all of them", "colour": "those that read colour: depth alone is as consistent as it was"},
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.levels) != SEVERITIES:
            raise InputError(f"{SEVERITIES} levels", found=len(self.levels))

    def level(self, severity: int) -> str:
        """`40 % of the view`."""
        return f"{plain(self.levels[severity - 1])} {self.unit}"


@dataclass(frozen=True, eq=False)
class Plan:
    """The whole file and its text: frames of a stretch, seed, starts by sequence, bounds, perturbations by name and their fixed settings."""

    text: str
    frames: int
    seed: int
    starts: Mapping[str, list]
    bounds: Bounds
    calibration: Calibration
    perturbations: Mapping[str, Perturbation]
    fixed: Mapping[str, Mapping[str, float]]

    def apply(self, name: str, severity: int, stretch: Stretch) -> Stretch:
        """The stretch as the perturbation leaves it; severity 0: unchanged."""
        if severity == 0:
            return stretch
        return FUNCTIONS[name](stretch, self.perturbations[name].levels[severity - 1], **self.fixed[name])

    def starts_of(self, sequence: str, length: int) -> list[int]:
        """First frames of the stretches of a sequence of so many frames, those that the file names, or by its shares."""
        shares = sorted({int(share * max(0, length - self.frames)) for share in self.starts["shares"]})
        fixed = list(self.starts.get(sequence, shares))
        return fixed if max(fixed) + self.frames <= length else shares

    def table(self) -> str:
        """One perturbation a line, with its severities."""
        names = list(self.perturbations)
        width, about = max(map(len, names)), max(len(p.about) for p in self.perturbations.values())
        rows = [
            f"{name:<{width}}  {p.about:<{about}}  {'  '.join(f'{plain(v):>5}' for v in p.levels)}  {p.unit}"
            for name, p in self.perturbations.items()
        ]
        return "\n".join(rows)


def read_plan(path: Path = SCALES["perturbations"]) -> Plan:
    """Raises InputError, with the place, where the file does not fit."""
    text = read_text(path, "perturbations (TOML)")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError("TOML", path=path, found=error) from None
    refuse_unknown(content, ("frames", "seed", "starts", "bounds", "calibration", "perturbations"), f"{path}")
    entries = {name: dict(entry) for name, entry in content["perturbations"].items()}
    refuse_unknown(entries, FUNCTIONS, "perturbations")
    fixed = {name: entry.pop("fixed", {}) for name, entry in entries.items()}
    try:
        perturbations = {name: Perturbation.from_dict(entry) for name, entry in entries.items()}
        bounds, calibration = Bounds.from_dict(content["bounds"]), Calibration.from_dict(content["calibration"])
    except InputError as error:
        raise error.at(path) from None
    return Plan(text, content["frames"], content["seed"], content["starts"], bounds, calibration, perturbations, fixed)
