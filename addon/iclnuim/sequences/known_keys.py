"""What a file of other programs says of camera, depth and poses: of every key that a reader does
not apply, whether its value changes anything.

Such a key is refused or named, so that nothing that a file says is ignored without a word.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError

DISTORTED = (
    "the lens distortion in the camera's file is ignored: "
    "images are read as those of a pinhole camera"
)


def names(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


#: Names of the coefficients of a distortion,
COEFFICIENTS = names("k1 k2 k3 k4 k5 k6 p1 p2 distortion distortion_params")
#: and of distortion models (of EuRoC, Kalibr, ROS and VSLAM-LAB) that are a pinhole camera if
#: all coefficients are 0; an equidistant one is a fisheye then.
WITHOUT_PROJECTION = (
    *("radial-tangential", "radtan", "radtan4", "radtan5", "radtan8"),
    *("plumb_bob", "rational_polynomial", "none", ""),
)
#: Larger entries of a matrix, or differences from the identity, have an effect.
_SAME = 1e-6

#: Whether a value changes nothing.
Neutral = Callable[[Any], bool]


@dataclass(frozen=True)
class Keys:
    """The keys of a kind of file.

    used: those that the reader applies. harmless: those without an effect on camera, depth and
    poses, whatever their value. noted: not applied; named unless their value is neutral. required:
    those that change the projection or the axes; refused unless their value is neutral. distortion:
    coefficients of a lens distortion, which is ignored with a note. Any other key is named.
    """

    used: frozenset[str]
    harmless: frozenset[str] = frozenset()
    noted: Mapping[str, Neutral] = field(default_factory=dict)
    required: Mapping[str, Neutral] = field(default_factory=dict)
    distortion: frozenset[str] = frozenset()

    def notes(self, said: Iterable[Mapping[str, Any]], path: Path) -> tuple[str, ...]:
        """A sentence for everything that is not applied, of mappings from one file.

        Raises InputError for a value that a pinhole camera cannot have.
        """
        unused: dict[str, str] = {}
        found: list[str] = []
        for key, value in _entries(said):
            if key in self.required and not self.required[key](value):
                expected = "the settings of a pinhole camera"
                raise InputError(expected, path=path, found=f"{key} {short(value)}")
            if key in self.distortion and not zeros(value):
                found = [DISTORTED]
            if key not in self._applied and not self.noted.get(key, absent)(value):
                unused.setdefault(key, f"{key} {short(value)}")
        if unused:
            settings = ", ".join(unused.values())
            found.append(f"{path.name} has settings that are not applied: {settings}")
        return tuple(found)

    @property
    def _applied(self) -> frozenset[str]:
        return self.used | self.harmless | self.distortion | frozenset(self.required)


def _entries(said: Iterable[Mapping[str, Any]]) -> Iterable[tuple[str, Any]]:
    """All keys and values that are not null."""
    for mapping in said:
        for key, value in mapping.items():
            if value is not None:
                yield str(key), value


def short(value: object) -> str:
    """The value as one line of at most 40 characters."""
    text = " ".join(str(value).split())
    return text if len(text) <= 40 else f"{text[:37]}..."


def numbers_of(value: Any) -> np.ndarray | None:
    """The numbers in a value, in lists of any depth, as (n,); None if there is anything else."""
    parts = list(value.values()) if isinstance(value, dict) else value
    try:
        return np.asarray(parts, float).ravel()
    except (TypeError, ValueError, OverflowError):
        return None


def as_list(value: Any) -> list[Any]:
    """A list as it is, any other value as the only one of a list."""
    return value if isinstance(value, list) else [value]


def zeros(value: Any) -> bool:
    """Whether a value contains nothing but zeros, or false."""
    numbers = numbers_of(value)
    return numbers is not None and not numbers.any()


def one(value: Any) -> bool:
    """Whether a value contains nothing but ones."""
    numbers = numbers_of(value)
    return numbers is not None and bool((numbers == 1).all())


def identity(value: Any) -> bool:
    """Whether a value is the matrix of the identity, 3 x 4 or 4 x 4."""
    numbers = numbers_of(value)
    if numbers is None or len(numbers) not in (12, 16):
        return False
    return bool(np.abs(numbers - np.eye(4).ravel()[: len(numbers)]).max() < _SAME)


def absent(value: Any) -> bool:
    """False: the key alone has an effect, or is not known."""
    return False


def any_of(*words: str) -> Neutral:
    """Whether a value is one of the words, which are in lower case."""

    def check(value: Any) -> bool:
        return str(value).strip().lower() in words

    return check
