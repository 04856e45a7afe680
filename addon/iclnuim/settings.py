"""Declarations of settings: default, unit, range, choices, help and source. Each setting is
declared once.

A group of settings is a frozen dataclass derived from `Settings` whose fields are made with
`setting`. This module checks values and converts them to and from JSON. The options of the command
line (headless/options.py), the panel's properties (ui/properties.py) and the tables in
docs/reference/settings.md are made from the same declarations.

    @dataclass(frozen=True)
    class LightSettings(Settings):
        map_size: int = setting(2048, "side of the light map", unit="texels", low=16, high=16384)
"""

import dataclasses
import math
import sys
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from numbers import Integral, Real
from typing import Any, ClassVar, Self

from .errors import InputError

#: value -> its meaning, shown to users
Choices = Mapping[str, str]

_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
_NUMBERS: dict[type, Any] = {int: Integral, float: Real}


@dataclass(frozen=True)
class Setting:
    """The declaration of one setting, as `declared` returns it.

    kind: bool, int, float or str. For a tuple, `length` is its number of elements (0: one or more,
    or none if the default is empty) and `kind` the type of each. optional: None is allowed; `help`
    describes its meaning. option: the option of the command line, empty if there is none. parse:
    converts the option's text, if `kind` cannot. label: the label in the panel, which shows value *
    shown[1] in the unit shown[0]. others: a description of values that are allowed in addition to
    `choices`.
    """

    name: str
    kind: type
    default: Any
    help: str
    option: str
    label: str
    optional: bool
    length: int | None
    shown: tuple[str, float]
    list_choices: Callable[[], Choices] | None
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    source: str = ""
    others: str = ""
    parse: Callable[[str], Any] | None = None

    @property
    def choices(self) -> Choices | None:
        """The allowed values and their meanings; None if the setting has no list of values."""
        return None if self.list_choices is None else self.list_choices()

    @property
    def range(self) -> str:
        """The range for messages: `in 16..16384`, `of 0 or more`, or an empty text."""
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"in {plain(self.low)}..{plain(self.high)}"
        if math.isfinite(self.low):
            return f"of {plain(self.low)} or more"
        return f"of at most {plain(self.high)}" if math.isfinite(self.high) else ""

    def checked(self, value: Any) -> Any:
        """The value converted to the setting's type.

        Raises InputError, with the setting's name, for an invalid value.
        """
        if value is None and self.optional:
            return None
        if self.length is not None:
            return tuple(self._one(v) for v in self._listed(value))
        return self._one(value)

    def _listed(self, value: Any) -> list | tuple:
        """The value if it has a number of elements that is allowed."""
        fits = isinstance(value, list | tuple)
        if self.length:
            if not fits or len(value) != self.length:
                raise InputError(f"{self.length} numbers", setting=self.name, found=value)
        elif not fits or not (value or self.default == ()):
            raise InputError("a list of one or more", setting=self.name, found=value)
        return value

    def _one(self, value: Any) -> Any:
        choices = self.choices
        if choices is not None and not (self.others and isinstance(value, str)):
            if not isinstance(value, self.kind) or value not in choices:
                raise InputError(f"one of {', '.join(choices)}", setting=self.name, found=value)
            return value
        if not self._fits(value):
            unit = self.unit and f"({self.unit})"
            words = filter(None, (_KINDS[self.kind], self.range, unit))
            raise InputError(" ".join(words), setting=self.name, found=value)
        return self.kind(value)

    def _fits(self, value: Any) -> bool:
        if self.kind is bool or self.kind is str:
            return isinstance(value, self.kind)
        if isinstance(value, bool) or not isinstance(value, _NUMBERS[self.kind]):
            return False
        return abs(value) <= sys.float_info.max and self.low <= value <= self.high


def setting(
    default: Any, help: str, *, choices: Callable[[], Choices] | Choices | None = None, **about: Any
) -> Any:
    """A dataclass field that is a declared setting. `help` is a phrase without the default;
    `source` is the paper and its section.

    choices: value -> meaning, or a function that returns it (a registry). option: the option of the
    command line if it is not `--` and the name with dashes; "" for none. label: the label in the
    panel if it is not the name. others: other values that are allowed instead of a choice, such as
    MODULE:FUNCTION; the code that uses the setting checks them. parse: text -> value, if the option
    accepts more than a number. shown: the unit that the panel shows, and the factor to it. unit,
    low, high: as in Setting.
    """
    listed = choices if callable(choices) or choices is None else lambda: choices
    return dataclasses.field(
        default=default, metadata={"setting": {"help": help, "list_choices": listed, **about}}
    )


#: A setting without an option of the command line. `setting(MISSING, ...)` declares a setting that
#: must be given.
parameter = partial(setting, option="")
MISSING: Any = dataclasses.MISSING


def same_as(group: type, name: str) -> Any:
    """A dataclass field with the same declaration as the setting `name` of another group."""
    field = next(f for f in dataclasses.fields(group) if f.name == name)
    return dataclasses.field(default=field.default, metadata=field.metadata)


def declared(group: type) -> dict[str, Setting]:
    """Name -> declaration, for all settings of a dataclass in their order.

    Fields that were not made with `setting` are left out.
    """
    return _declarations(group)


@cache
def _declarations(group: type) -> dict[str, Setting]:
    hints = typing.get_type_hints(group)
    fields = [f for f in dataclasses.fields(group) if "setting" in f.metadata]
    return {f.name: _declaration(f, hints[f.name]) for f in fields}


def _declaration(field: Any, hint: Any) -> Setting:
    about = dict(field.metadata["setting"])
    parts = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    kind = next(part for part in parts if part is not type(None))
    length = None
    if typing.get_origin(kind) is tuple:
        elements = typing.get_args(kind)
        kind = elements[0]
        length = 0 if elements[-1] is Ellipsis else len(elements)
    words: dict[str, Any] = {
        "name": field.name,
        "kind": kind,
        "default": field.default,
        "option": "--" + field.name.replace("_", "-"),
        "label": field.name.replace("_", " ").title(),
        "optional": type(None) in parts,
        "length": length,
        "shown": (about.get("unit", ""), 1.0),
    }
    return Setting(**words | about)


@dataclass(frozen=True)
class Settings:
    """Base of all groups of settings: frozen, checked at construction, converted to and from JSON.

    `group` is its name in errors.
    """

    group: ClassVar[str] = "settings"

    def __post_init__(self) -> None:
        for name, declaration in declared(type(self)).items():
            try:
                object.__setattr__(self, name, declaration.checked(getattr(self, name)))
            except InputError as error:
                if declaration.option:
                    raise
                group = self.group.removeprefix("settings of ")
                expected = f"{name} of {group} as {error.expected}"
                raise InputError(expected, found=error.found) from None

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Make the settings from a mapping of names to values. Settings left out get their
        defaults. A nested group is a mapping too.

        Raises InputError for an unknown or missing name or an invalid value; the error's path is
        the name of the nested group.
        """
        fields = dataclasses.fields(cls)
        hints = typing.get_type_hints(cls)
        refuse_unknown(content, [f.name for f in fields], cls.group)
        needed = [f.name for f in fields if f.default is MISSING and f.default_factory is MISSING]
        if missing := [name for name in needed if name not in content]:
            raise InputError(f"{cls.group} with {', '.join(missing)}", found="none")
        return cls(**{name: _inner(hints[name], value, name) for name, value in content.items()})

    def to_dict(self) -> dict[str, Any]:
        """Every setting by name, ready for JSON; the inverse of from_dict."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name, value in values.items():
            if isinstance(value, tuple):
                values[name] = list(value)
        return values

    def changed(self, **settings: Any) -> Self:
        """A copy with other values; None means unchanged."""
        given = {name: value for name, value in settings.items() if value is not None}
        return dataclasses.replace(self, **given)


def _inner(kind: Any, value: Any, place: str) -> Any:
    """The value of a field; a mapping is converted if the field's type is a group of settings or a
    tuple of groups.
    """
    group = typing.get_args(kind)[0] if typing.get_origin(kind) is tuple else kind
    if not (isinstance(group, type) and issubclass(group, Settings)):
        return value
    if group is not kind:
        if not isinstance(value, list):
            raise InputError(f"a list as {place}", found=value)
        return tuple(_inner(group, item, f"{place}[{k}]") for k, item in enumerate(value))
    try:
        return group.from_dict(value)
    except InputError as error:
        raise error.at(place) from None


def find(name: str) -> Setting | None:
    """The declaration of the setting `name` that has an option, among the loaded groups.

    None if there is none, or if several differ.
    """
    groups = list(Settings.__subclasses__())
    found = []
    while groups:
        group = groups.pop(0)
        groups += group.__subclasses__()
        found += [s for s in declared(group).values() if s.name == name and s.option]
    return found[0] if len({(s.option, s.label) for s in found}) == 1 else None


def refuse_unknown(content: object, known: Iterable[str], group: str) -> None:
    """Raises InputError if `content` is not a mapping or has an unknown key."""
    known = list(known)
    expected = f"{group}: {', '.join(known) or 'there are none'}"
    if not isinstance(content, Mapping):
        raise InputError(expected, found=content)
    unknown = sorted(set(content) - set(known))
    if unknown:
        raise InputError(expected, found=", ".join(unknown))


def plain(value: Any) -> str:
    """A value as text, for help texts and tables."""
    if isinstance(value, tuple):
        return " ".join(map(plain, value)) or "none"
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else str(value)
