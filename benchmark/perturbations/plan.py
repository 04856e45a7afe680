"""Reads and checks a file of perturbations, and maps their names to functions."""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from iclnuim.errors import InputError
from iclnuim.formats.files import read_text
from iclnuim.settings import MISSING, Settings, parameter, plain, refuse_unknown

from . import corruptions, filters, lighting, motion, people, ranging, surfaces
from .segment import Segment

#: The scales of perturbations; the first is ours.
SCALES = {
    name: Path(__file__).with_name(f"{name}.toml") for name in ("perturbations", "corruptions")
}
SEVERITIES = 5
#: Perturbation -> function(segment, level, fixed settings by keyword).
FUNCTIONS: dict[str, Callable[..., Segment]] = {
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
        lighting.smoke,
        lighting.flicker,
        lighting.moving_shadows,
        lighting.emitter_dots,
        lighting.lens_dirt,
        people.people,
        ranging.interference,
        ranging.wrapped_phase,
        ranging.few_zones,
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
    """Limits beyond which a pose is wrong, and conditions for the success of a run."""

    group = "settings of [bounds] in a file of perturbations"

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
class Calibration(Settings):
    """Requirements on severities, measured with third-party odometers: minimum growth of the median
    error at 1 and at 2; at 5, more than half fail.
    """

    group = "settings of [calibration] in a file of perturbations"

    depth_alone: tuple[str, ...] = parameter(MISSING, "odometers that do not read colour")
    growth_at_1: float = parameter(1.5, "minimum growth of the error at severity 1", low=1.0)
    growth_at_2: float = parameter(2.0, "the same at severity 2", low=1.0)


@dataclass(frozen=True)
class Perturbation(Settings):
    """A change of frames, with its level at each severity from 1 on."""

    group = "settings of a perturbation"

    about: str = parameter(MISSING, "short description")
    unit: str = parameter(MISSING, "unit of its levels")
    levels: tuple[float, ...] = parameter(MISSING, "a level for each severity")
    judged_by: str = parameter(
        "all",
        "third-party odometers by which its severities were chosen",
        choices={
            "all": "all of them",
            "colour": "those that read colour, as depth stays consistent",
        },
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
    """The content of the file: its text, number of frames of a segment, seed, starts by sequence,
    bounds, perturbations by name, and their fixed settings.
    """

    text: str
    frames: int
    seed: int
    starts: Mapping[str, list]
    bounds: Bounds
    calibration: Calibration
    perturbations: Mapping[str, Perturbation]
    fixed: Mapping[str, Mapping[str, float]]

    def apply(self, name: str, severity: int, segment: Segment) -> Segment:
        """The perturbed segment; unchanged for severity 0."""
        if severity == 0:
            return segment
        return FUNCTIONS[name](
            segment, self.perturbations[name].levels[severity - 1], **self.fixed[name]
        )

    def starts_of(self, sequence: str, length: int) -> list[int]:
        """First frames of the segments of a sequence with `length` frames: those in the file, or
        computed from its shares.
        """
        shares = sorted(
            {int(share * max(0, length - self.frames)) for share in self.starts["shares"]}
        )
        fixed = list(self.starts.get(sequence, shares))
        return fixed if max(fixed) + self.frames <= length else shares

    def table(self) -> str:
        """One line per perturbation, with its severities."""
        names = list(self.perturbations)
        width, about = max(map(len, names)), max(len(p.about) for p in self.perturbations.values())
        rows = [
            f"{name:<{width}}  {p.about:<{about}}  {'  '.join(f'{plain(v):>5}' for v in p.levels)}  {p.unit}"
            for name, p in self.perturbations.items()
        ]
        return "\n".join(rows)


def read_plan(path: Path = SCALES["perturbations"]) -> Plan:
    """Read a plan. Raises InputError, which names the location, if the file is invalid."""
    text = read_text(path, "perturbations (TOML)")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError("TOML", path=path, found=error) from None
    refuse_unknown(
        content, ("frames", "seed", "starts", "bounds", "calibration", "perturbations"), f"{path}"
    )
    entries = {name: dict(entry) for name, entry in content["perturbations"].items()}
    refuse_unknown(entries, FUNCTIONS, "perturbations")
    fixed = {name: entry.pop("fixed", {}) for name, entry in entries.items()}
    try:
        perturbations = {name: Perturbation.from_dict(entry) for name, entry in entries.items()}
        bounds, calibration = (
            Bounds.from_dict(content["bounds"]),
            Calibration.from_dict(content["calibration"]),
        )
    except InputError as error:
        raise error.at(path) from None
    return Plan(
        text,
        content["frames"],
        content["seed"],
        content["starts"],
        bounds,
        calibration,
        perturbations,
        fixed,
    )
