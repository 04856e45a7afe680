"""Settings that determine a sequence: SequenceOptions as plain values (for the command line, the
panel, workers and recipes), and SequenceSettings as noise models.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from ..errors import InputError
from ..formats.depth_units import (
    UNITS_PER_METRE,
    check_units,
)
from ..sensor.imu_noise import ImuNoise, imu_noise
from ..sensor.models import DEPTH_MODELS, RGB_MODELS, Noise, depth_model, rgb_model
from ..sensor.noise_model import NoiseModel
from ..settings import Choices, Settings, setting
from .format import NAME_FORMS, SORTED, UNRECORDED
from .sequence_formats import FORMATS


def _summaries(models: Mapping[str, type[NoiseModel]]) -> Choices:
    return {name: model.summary for name, model in models.items()}


@dataclass(frozen=True)
class SequenceSettings:
    """The settings that determine the pixels of a sequence, given its frames.

    `seed` also applies to user-provided noise. names: the form of the images' names. imu: the noise
    of the readings, if the source has an IMU.
    """

    depth: Noise = field(default_factory=lambda: depth_model("none"))
    rgb: Noise = field(default_factory=lambda: rgb_model("none"))
    seed: int = 0
    depth_units_per_metre: float = UNITS_PER_METRE
    names: str = SORTED
    imu: ImuNoise = field(default_factory=ImuNoise)

    def __post_init__(self) -> None:
        if (
            isinstance(self.seed, bool)
            or not isinstance(self.seed, int)
            or not 0 <= self.seed < 2**63
        ):
            raise InputError("a seed as a whole number from 0 up", found=self.seed)
        check_units(self.depth_units_per_metre)
        if self.names not in (*NAME_FORMS, UNRECORDED):
            raise InputError(f"names {' or '.join(NAME_FORMS)}", found=self.names)

    @property
    def is_clean(self) -> bool:
        """Whether the images are stored unchanged: no noise, no other exposure."""
        return {"model": self.depth.name, **self.depth.to_dict()} == {
            "model": "none"
        } and self.rgb == rgb_model("none")

    def to_dict(self) -> dict:
        names = {"names": self.names} if self.names else {}
        imu = {}
        if self.imu != ImuNoise():
            imu["imu_noise"] = {"model": self.imu.name, **self.imu.to_dict()}
        return {
            "depth_noise": {"model": self.depth.name, **self.depth.to_dict()},
            "rgb_noise": {"model": self.rgb.name, **self.rgb.to_dict()},
            "seed": self.seed,
            "depth_units_per_metre": self.depth_units_per_metre,
            **names,
            **imu,
        }


@dataclass(frozen=True)
class SequenceOptions(Settings):
    """Noise models by name with their settings, seed, depth units and formats.
    `sequence_settings` makes the noise models.
    """

    group: ClassVar[str] = "a sequence"

    depth_noise: str = setting(
        "none",
        "noise model of depth: of a RealSense (d435), of time of flight (azure_kinect), of a phone's "
        "LiDAR (phone); as in the original noisy frames (released) or in papers (paper, kinect2012, "
        "redwood)",
        choices=lambda: _summaries(DEPTH_MODELS),
        others="MODULE:FUNCTION",
    )
    rgb_noise: str = setting(
        "none",
        "noise model of colour",
        choices=lambda: _summaries(RGB_MODELS),
        others="MODULE:FUNCTION",
        label="RGB Noise",
    )
    depth_settings: dict[str, Any] = field(default_factory=dict)
    rgb_settings: dict[str, Any] = field(default_factory=dict)
    imu_noise: str = "none"
    seed: int = setting(0, "seed of the noise", low=0, high=2**63 - 1)
    depth_units: float = setting(
        UNITS_PER_METRE,
        "units per metre of the depth images",
        unit="1/m",
        low=1.0,
        high=1e6,
        label="Depth",
    )
    formats: tuple[str, ...] = setting(
        ("tum",),
        "format of the files; several formats are written into a folder each",
        choices=lambda: {name: format.description for name, format in FORMATS.items()},
        option="--format",
    )
    names: str = setting(SORTED, "form of the images' names", choices=lambda: NAME_FORMS)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("depth_settings", "rgb_settings"):
            if not isinstance(getattr(self, name), dict):
                raise InputError("a JSON object", setting=name, found=getattr(self, name))

    def sequence_settings(self) -> SequenceSettings:
        """The settings with noise. Raises InputError for an unknown model or parameter."""
        depth = depth_model(self.depth_noise, self.depth_settings)
        rgb = rgb_model(self.rgb_noise, self.rgb_settings)
        imu = imu_noise(self.imu_noise)
        return SequenceSettings(depth, rgb, self.seed, self.depth_units, self.names, imu)

    def to_dict(self) -> dict[str, Any]:
        """The inverse of from_dict; without the noise of an IMU if there is none."""
        values = super().to_dict()
        if self.imu_noise == "none":
            del values["imu_noise"]
        return values

    def without_noise(self) -> SequenceSettings:
        """The settings of the corresponding clean sequence."""
        return SequenceSettings(
            seed=self.seed, depth_units_per_metre=self.depth_units, names=self.names
        )
