"""Every noise model by name, and a user's own as `module:function`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from .depth_others import Kinect2012DepthNoise, NoDepthNoise, RedwoodDepthNoise
from .depth_paper import PaperDepthNoise
from .depth_released import ReleasedDepthNoise
from .own_noise import own_noise
from .parameters import NoiseSettings
from .rgb import NoRgbNoise, PaperRgbNoise, ReleasedRgbNoise

#: In the order in which a saved .blend numbers them: new ones go to the end.
DEPTH_MODELS: dict[str, type[NoiseSettings]] = {
    m.name: m for m in (NoDepthNoise, ReleasedDepthNoise, PaperDepthNoise, Kinect2012DepthNoise, RedwoodDepthNoise)
}
RGB_MODELS: dict[str, type[NoiseSettings]] = {m.name: m for m in (NoRgbNoise, ReleasedRgbNoise, PaperRgbNoise)}

_ARGUMENTS = {"depth": ("depth_z_m", "camera", "rng"), "RGB": ("light", "rng")}


class DepthNoise(Protocol):
    """A depth noise model: (h, w) planar metres, 0 = missing -> the same with noise."""

    name: str

    def apply(self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator) -> np.ndarray: ...

    def to_dict(self) -> dict[str, Any]: ...


class RgbNoise(Protocol):
    """An RGB noise model: (h, w, 3) scene-linear light, 1 = white -> (h, w, 3) uint8."""

    name: str

    def apply(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray: ...

    def to_dict(self) -> dict[str, Any]: ...


def depth_model(name: str, settings: Mapping[str, Any] | None = None) -> DepthNoise:
    """By name or as `module:function`, called as function(depth_z_m, camera, rng). Raises InputError."""
    return _model("depth", name, settings or {}, DEPTH_MODELS)


def rgb_model(name: str, settings: Mapping[str, Any] | None = None) -> RgbNoise:
    """By name or as `module:function`, called as function(light, rng) -> uint8. Raises InputError."""
    return _model("RGB", name, settings or {}, RGB_MODELS)


def _model(kind: str, name: str, settings: Mapping[str, Any], known: Mapping[str, type[NoiseSettings]]) -> Any:
    if ":" in name:
        return own_noise(kind, name, settings, _ARGUMENTS[kind])
    if name not in known:
        raise InputError(f"a {kind} noise model ({', '.join(known)}) or MODULE:FUNCTION", found=name)
    return known[name].from_dict(dict(settings))
