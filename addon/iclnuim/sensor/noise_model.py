"""The base of the noise models: a group of settings with a name. The command takes them as JSON, so they have no options."""

from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from ..settings import Settings, setting

#: `setting`, without an option.
parameter = partial(setting, option="")


@dataclass(frozen=True)
class NoiseModel(Settings):
    """`name` is what users call the model, `summary` one line on it for lists; a subclass has `apply`, and is listed in models.py."""

    name: ClassVar[str] = ""
    summary: ClassVar[str] = ""

    def __init_subclass__(cls, **rest: Any) -> None:
        super().__init_subclass__(**rest)
        cls.group = f"settings of the noise model {cls.name!r}"
