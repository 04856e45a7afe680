"""The registry of noise models, and user-provided noise as `module:function`."""

import importlib
import inspect
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from .active_stereo import D435DepthNoise
from .appearance import SurfaceAppearance
from .depth import (
    Kinect2012DepthNoise,
    NoDepthNoise,
    PaperDepthNoise,
    RedwoodDepthNoise,
    ReleasedDepthNoise,
)
from .noise_model import NoiseModel
from .phone import PhoneDepthNoise
from .rgb import NoRgbNoise, PaperRgbNoise, ReleasedRgbNoise
from .time_of_flight import AzureKinectDepthNoise

#: A saved .blend stores the number of a model in this order: append new models at the end.
_DEPTH: tuple[type[NoiseModel], ...] = (
    NoDepthNoise,
    ReleasedDepthNoise,
    PaperDepthNoise,
    Kinect2012DepthNoise,
    RedwoodDepthNoise,
    D435DepthNoise,
    AzureKinectDepthNoise,
    PhoneDepthNoise,
)
_RGB: tuple[type[NoiseModel], ...] = (NoRgbNoise, ReleasedRgbNoise, PaperRgbNoise)
DEPTH_MODELS = {model.name: model for model in _DEPTH}
RGB_MODELS = {model.name: model for model in _RGB}

_ARGUMENTS = {"depth": ("depth_z_m", "camera", "rng"), "RGB": ("light", "rng")}


class Noise(Protocol):
    """A noise model of depth, apply(depth_z_m, camera, rng), or of RGB, apply(light, rng), as in
    depth.py and rgb.py.
    """

    name: str

    def apply(self, *args: Any, **kwargs: Any) -> np.ndarray: ...

    def to_dict(self) -> dict[str, Any]: ...


#: A noise model, its name, a function, or its `module:function`.
NamedNoise = str | Noise | Callable[..., np.ndarray]


def depth_model(model: NamedNoise, settings: Mapping[str, Any] | None = None) -> Noise:
    """The depth noise model of this name, or a function or its `module:function`, which is called
    as function(depth_z_m, camera, rng) with planar depth (h, w) in metres. A model stays as it is.
    Raises InputError.
    """
    return _model("depth", model, settings or {}, DEPTH_MODELS)


def rgb_model(model: NamedNoise, settings: Mapping[str, Any] | None = None) -> Noise:
    """The RGB noise model of this name, or a function or its `module:function`, which is called as
    function(light, rng) with scene-linear RGB (h, w, 3) and returns sRGB (h, w, 3) uint8. A model
    stays as it is. Raises InputError.
    """
    return _model("RGB", model, settings or {}, RGB_MODELS)


def with_depth_noise(
    model: Noise,
    depth_z_m: np.ndarray,
    camera: PinholeCamera,
    rng: np.random.Generator,
    seen: np.ndarray | SurfaceAppearance | None,
) -> np.ndarray:
    """Planar depth (h, w) in metres with the noise of a model. `seen`: the frame's scene-linear
    light (h, w, 3) or its appearance, for a model that asks for it. Raises InputError if it is
    missing.
    """
    return depth_and_confidence(model, depth_z_m, camera, rng, seen)[0]


def depth_and_confidence(
    model: Any,
    depth_z_m: np.ndarray,
    camera: PinholeCamera,
    rng: np.random.Generator,
    seen: np.ndarray | SurfaceAppearance | None,
) -> tuple[np.ndarray, np.ndarray | None]:
    """What with_depth_noise returns, and its confidence (h, w) uint8 (0 low, 1 medium, 2 high), None
    from a model that gives none.
    """
    if not getattr(model, "asks_appearance", False):
        return model.apply(depth_z_m, camera, rng), None
    appearance = SurfaceAppearance.of_light(seen) if isinstance(seen, np.ndarray) else seen
    if model.gives_confidence:
        return model.measured(depth_z_m, camera, rng, appearance)
    return model.apply(depth_z_m, camera, rng, appearance), None


def _model(
    kind: str, name: NamedNoise, settings: Mapping[str, Any], known: Mapping[str, type[NoiseModel]]
) -> Any:
    if isinstance(name, str) and ":" in name:
        return _imported_noise(kind, name, settings)
    if isinstance(name, NoiseModel | UserNoise):
        if settings:
            raise InputError(f"{kind} noise by name with its settings", found=repr(name))
        return name
    if callable(name) and not isinstance(name, type):
        where = f"{getattr(name, '__module__', '')}:{getattr(name, '__qualname__', 'function')}"
        return _user_noise(kind, where, name, settings)
    if not isinstance(name, str) or name not in known:
        raise InputError(
            f"a {kind} noise model ({', '.join(known)}) or MODULE:FUNCTION", found=name
        )
    return known[name].from_dict(settings)


@dataclass(frozen=True)
class UserNoise:
    """A user's function with the same signature as a model's `apply`, and settings that are passed
    to it by keyword.
    """

    name: str
    function: Callable[..., np.ndarray] = field(repr=False)
    settings: Mapping[str, Any] = field(default_factory=dict)

    def apply(self, *arguments: Any) -> np.ndarray:
        """Call the function.

        An exception is raised again as InputError, with the line in the user's file.
        """
        try:
            return self.function(*arguments, **self.settings)
        except InputError:
            raise
        except Exception as error:  # a user's function may raise anything
            place = traceback.extract_tb(error.__traceback__)[-1]
            found = f"{type(error).__name__}: {error} (line {place.lineno} of {place.filename})"
            raise InputError(f"the noise {self.name} to run", found=found) from error

    def to_dict(self) -> dict[str, Any]:
        return dict(self.settings)


def _imported_noise(kind: str, name: str, settings: Mapping[str, Any]) -> UserNoise:
    """Import `module:function`. Raises InputError if this fails."""
    module_name, _, function_name = name.partition(":")
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # a user's module may raise anything
        hint = f"a folder with {module_name.split('.')[0]}.py on PYTHONPATH"
        found = f"{name} ({type(error).__name__}: {error})"
        raise InputError(f"{kind} noise as MODULE:FUNCTION", found=found, hint=hint) from error
    function = getattr(module, function_name, None)
    if not callable(function):
        found = "none" if function is None else type(function).__name__
        raise InputError(f"a function {function_name} in the module {module_name}", found=found)
    return _user_noise(kind, name, function, settings)


def _user_noise(
    kind: str, name: str, function: Callable[..., np.ndarray], settings: Mapping[str, Any]
) -> UserNoise:
    """Raises InputError for a function that does not accept the arguments of this kind and the
    settings.
    """
    arguments = _ARGUMENTS[kind]
    try:
        inspect.signature(function).bind(*arguments, **settings)
    except TypeError as error:
        call = ", ".join([*arguments, *(f"{key}=..." for key in settings)])
        called = name.rpartition(":")[2]
        raise InputError(f"a function to call as {called}({call})", found=error) from None
    except ValueError:  # a builtin without a signature: errors are reported when it is called
        pass
    return UserNoise(name, function, dict(settings))
