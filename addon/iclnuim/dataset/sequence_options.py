"""What decides a sequence, in plain values: declared once for the command line, the panel, workers and the records of runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from ..errors import InputError
from ..sensor.models import DEPTH_MODELS, RGB_MODELS, depth_model, rgb_model
from ..sensor.noise_model import NoiseModel
from ..settings import Choices, Settings, setting
from .depth_units import UNITS_PER_METRE
from .noisy_frame import SequenceSettings
from .sequence_formats import FORMATS


def _summaries(models: Mapping[str, type[NoiseModel]]) -> Choices:
    return {name: model.summary for name, model in models.items()}


def _formats() -> Choices:
    return {name: format.description for name, format in FORMATS.items()}


@dataclass(frozen=True)
class SequenceOptions(Settings):
    """Noise models by name with their settings, seed, depth units and formats. `sequence_settings` makes the models of them."""

    group: ClassVar[str] = "a sequence"

    depth_noise: str = setting(
        "none", "noise model of depth", choices=lambda: _summaries(DEPTH_MODELS), others="MODULE:FUNCTION"
    )
    rgb_noise: str = setting(
        "none",
        "noise model of colour",
        choices=lambda: _summaries(RGB_MODELS),
        others="MODULE:FUNCTION",
        label="RGB noise",
    )
    depth_settings: dict[str, Any] = field(default_factory=dict)
    rgb_settings: dict[str, Any] = field(default_factory=dict)
    seed: int = setting(0, "seed of the noise", low=0, high=2**63 - 1)
    depth_units: float = setting(UNITS_PER_METRE, "units per metre of the depth images", unit="1/m", low=1.0, high=1e6)
    formats: tuple[str, ...] = setting(
        ("tum",), "format of the files; several go into a folder each", choices=_formats, option="--format"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("depth_settings", "rgb_settings"):
            if not isinstance(getattr(self, name), dict):
                raise InputError("a JSON object", setting=name, found=getattr(self, name))

    def sequence_settings(self) -> SequenceSettings:
        """With noise. Raises InputError for an unknown model or parameter."""
        depth, rgb = depth_model(self.depth_noise, self.depth_settings), rgb_model(self.rgb_noise, self.rgb_settings)
        return SequenceSettings(depth, rgb, self.seed, self.depth_units)

    def without_noise(self) -> SequenceSettings:
        """The clean sequence beside it."""
        return SequenceSettings(seed=self.seed, depth_units_per_metre=self.depth_units)
