"""Settings of a noise model: frozen, typed, every field with unit, range and source; an unknown key is an error."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from typing import Any, ClassVar, TypeVar

from ..errors import InputError

S = TypeVar("S", bound="NoiseSettings")


def parameter(default: Any, unit: str, source: str, low: float = 0.0, high: float = math.inf) -> Any:
    """A dataclass field: a number, a truth value, or a tuple of numbers within low..high."""
    return field(default=default, metadata={"unit": unit, "source": source, "low": low, "high": high})


@dataclass(frozen=True)
class NoiseSettings:
    """Base of every model's settings; `name` is what the user calls the model, `summary` one line on it for lists."""

    name: ClassVar[str] = ""
    summary: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for f in fields(self):
            object.__setattr__(self, f.name, self._checked(f, getattr(self, f.name)))

    @classmethod
    def from_dict(cls: type[S], settings: dict[str, Any]) -> S:
        """Settings by field name; those left out keep their default. Raises InputError for an unknown one."""
        known = [f.name for f in fields(cls)]
        unknown = sorted(set(settings) - set(known))
        if unknown:
            expected = f"settings of the noise model {cls.name!r}: {', '.join(known) or 'it has none'}"
            raise InputError(expected, found=", ".join(unknown))
        return cls(**settings)

    def to_dict(self) -> dict[str, Any]:
        """Every field, for the recipe; from_dict takes it back."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    def _checked(self, f: Any, value: Any) -> Any:
        what = f"{f.name} of the noise model {self.name!r}"
        if isinstance(f.default, bool):
            if not isinstance(value, bool):
                raise InputError(f"{what} as true or false", found=value)
            return value
        if isinstance(f.default, tuple):
            if not isinstance(value, list | tuple) or len(value) != len(f.default):
                raise InputError(f"{what} as {len(f.default)} numbers", found=value)
            return tuple(_number(f, what, v) for v in value)
        return _number(f, what, value)


def _number(f: Any, what: str, value: Any) -> float:
    low, high = f.metadata["low"], f.metadata["high"]
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not (math.isfinite(value) and low <= value <= high)
    ):
        reach = f" in {low:g}..{high:g}" if math.isfinite(low) or math.isfinite(high) else ""
        raise InputError(f"{what} as a number{reach} ({f.metadata['unit']})", found=value)
    return float(value)
