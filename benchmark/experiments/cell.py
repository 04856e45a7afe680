"""A cell of an experiment: a method on an input, and everything that decides its figures."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol


class Key(Protocol):
    """The words that name a cell: a frozen dataclass of texts and numbers."""

    @property
    def place(self) -> str:
        """Path of the cell in a store, without ending."""
        ...


@dataclass(frozen=True, eq=False)
class Cell:
    """One measurement. identity: the settings, the hash of the input and the hash of the method's
    code. It is JSON.
    """

    key: Any
    identity: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured cell: its key, identity and figures, and the folder of its files, if there are
    any.
    """

    key: Any
    identity: Mapping[str, Any]
    figures: Mapping[str, Any]
    folder: Path = Path()
