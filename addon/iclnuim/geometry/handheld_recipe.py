"""The recipe of a hand-held trajectory as typed settings, read from JSON (its keys: trajectories/README.md)."""

from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import Any, get_args, get_origin, get_type_hints

from ..errors import InputError

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Viewpoint:
    """A position of the camera and what it looks at (metres, world), how long it rests there, and its roll.

    `hurry` 2 means that the leg to this viewpoint is taken twice as fast as the others. The camera rolls clockwise.
    """

    position_m: tuple[float, float, float]
    look_at_m: tuple[float, float, float]
    dwell_s: float = 0.0
    roll_deg: float = 0.0
    hurry: float = 1.0

    def __post_init__(self) -> None:
        _require(max(map(abs, self.position_m + self.look_at_m)) <= 1e4, "positions within 10 km", self.position_m)
        _require(self.dwell_s >= 0, "a dwell_s >= 0", self.dwell_s)
        _require(abs(self.roll_deg) <= 180, "a roll_deg within -180..180", self.roll_deg)
        _require(0.1 <= self.hurry <= 10, "a hurry of 0.1..10", self.hurry)


@dataclass(frozen=True)
class Pace:
    """Unhurried motion and rotation, whose ratio decides how the time is shared; and how long a start or stop takes."""

    speed_m_s: float
    turn_deg_s: float
    ease_s: float

    def __post_init__(self) -> None:
        _require(1e-3 <= self.speed_m_s <= 1e3, "a speed_m_s of 0.001..1000", self.speed_m_s)
        _require(1e-3 <= self.turn_deg_s <= 1e5, "a turn_deg_s of 0.001..100,000", self.turn_deg_s)
        _require(self.ease_s >= 1e-3, "an ease_s of at least 0.001", self.ease_s)


@dataclass(frozen=True)
class Shake:
    """One band of random motion: RMS over the three axes together; power falls as frequency^-slope."""

    low_hz: float
    high_hz: float
    position_mm: float
    rotation_deg: float
    position_slope: float
    rotation_slope: float

    def __post_init__(self) -> None:
        _require(0 < self.low_hz < self.high_hz < 15, "a band within 0..15 Hz", f"{self.low_hz:g}..{self.high_hz:g} Hz")
        _require(0 <= self.position_mm <= 1000, "a position_mm of 0..1000", self.position_mm)
        _require(0 <= self.rotation_deg <= 45, "a rotation_deg of 0..45", self.rotation_deg)
        for slope in (self.position_slope, self.rotation_slope):
            _require(abs(slope) <= 10, "slopes within -10..10", slope)


@dataclass(frozen=True)
class Recipe:
    """A whole trajectory: the scene it is meant for, its frames at 30 Hz, its length with all shake, what makes it."""

    scene: str
    about: str
    frames: int
    length_m: float
    seed: int
    pace: Pace
    shakes: tuple[Shake, ...]
    viewpoints: tuple[Viewpoint, ...]
    schema_version: int = SCHEMA_VERSION

    def __post_init__(self) -> None:
        _require(self.schema_version == SCHEMA_VERSION, f"schema_version {SCHEMA_VERSION}", self.schema_version)
        _require(2 <= self.frames <= 1_000_000, "2 to 1,000,000 frames", self.frames)
        _require(0 <= self.seed < 2**63, "a seed of 0..2^63 - 1", self.seed)
        _require(self.length_m > 0, "a length_m > 0", self.length_m)
        _require(len(self.viewpoints) >= 2, "two viewpoints or more", len(self.viewpoints))

    @classmethod
    def from_dict(cls, content: object) -> "Recipe":
        """From a JSON object. Raises InputError, naming the key, for unknown or missing keys and unfit values."""
        return _built(cls, content, "recipe")


def _built(kind: Any, value: Any, place: str) -> Any:
    """`value` from JSON as the annotated `kind`: str, int, float, a tuple of these, or one of the dataclasses above."""
    if get_origin(kind) is tuple:
        return _built_tuple(get_args(kind), value, place)
    if is_dataclass(kind):
        return _built_dataclass(kind, value, place)
    if kind is float:
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        _require(numeric and abs(value) <= 1e9, f"a number within 1e9 as {place}", value)
        return float(value)
    _require(isinstance(value, kind) and not isinstance(value, bool), f"{kind.__name__} as {place}", value)
    return value


def _built_tuple(kinds: tuple, value: Any, place: str) -> tuple:
    """tuple[K, ...] of any length, or tuple[K, K, K] of just that."""
    _require(isinstance(value, list), f"a list as {place}", value)
    if kinds[-1] is Ellipsis:
        kinds = kinds[:1] * len(value)
    _require(len(value) == len(kinds), f"{len(kinds)} values as {place}", len(value))
    return tuple(_built(kind, item, f"{place}[{i}]") for i, (kind, item) in enumerate(zip(kinds, value, strict=True)))


def _built_dataclass(kind: Any, value: Any, place: str) -> Any:
    _require(isinstance(value, dict), f"an object as {place}", value)
    kinds = get_type_hints(kind)
    unknown = sorted(set(value) - set(kinds))
    _require(not unknown, f"the keys {', '.join(kinds)} in {place}", ", ".join(unknown))
    missing = [f.name for f in fields(kind) if f.default is MISSING and f.name not in value]
    _require(not missing, f"{', '.join(missing)} in {place}", "none")
    settings = {key: _built(kinds[key], item, f"{place}.{key}") for key, item in value.items()}
    try:
        return kind(**settings)
    except InputError as error:
        raise error.at(place) from None


def _require(fine: object, expected: str, found: object) -> None:
    if not fine:
        raise InputError(expected, found=found)
