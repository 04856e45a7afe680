"""A user's own noise: a Python function named as `module:function`; whatever goes wrong in it is told in one line."""

from __future__ import annotations

import importlib
import inspect
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import InputError


@dataclass(frozen=True)
class OwnNoise:
    """A function of the same signature as a model's `apply`, and settings handed to it by keyword."""

    name: str
    function: Callable[..., np.ndarray] = field(repr=False)
    settings: Mapping[str, Any] = field(default_factory=dict)

    def apply(self, *arguments: Any) -> np.ndarray:
        """What the function returns. Raises InputError, with the place in the user's file, for what it raises."""
        try:
            return self.function(*arguments, **self.settings)
        except InputError:
            raise
        except Exception as error:  # whatever a user's function may raise
            place = traceback.extract_tb(error.__traceback__)[-1]
            found = f"{type(error).__name__}: {error} (line {place.lineno} of {place.filename})"
            raise InputError(f"the noise {self.name} to run", found=found) from error

    def to_dict(self) -> dict[str, Any]:
        return dict(self.settings)


def own_noise(kind: str, name: str, settings: Mapping[str, Any], arguments: tuple[str, ...]) -> OwnNoise:
    """`module:function`, which must take `arguments` and the settings. Raises InputError where it cannot be had."""
    module_name, _, function_name = name.partition(":")
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # whatever stands in a user's file
        hint = f"a folder with {module_name.split('.')[0]}.py on PYTHONPATH"
        found = f"{name} ({type(error).__name__}: {error})"
        raise InputError(f"{kind} noise as MODULE:FUNCTION", found=found, hint=hint) from error
    function = getattr(module, function_name, None)
    if not callable(function):
        found = "none" if function is None else type(function).__name__
        raise InputError(f"a function {function_name} in the module {module_name}", found=found)
    try:
        inspect.signature(function).bind(*arguments, **settings)
    except TypeError as error:
        call = ", ".join([*arguments, *(f"{key}=..." for key in settings)])
        raise InputError(f"a function to call as {function_name}({call})", found=error) from None
    except ValueError:  # a builtin without a signature: it will show
        pass
    return OwnNoise(name, function, dict(settings))
