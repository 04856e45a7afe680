"""Findings about a sequence: errors and warnings as sentences."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from ...errors import InputError
from ...shown import Shown

T = TypeVar("T")


@dataclass(repr=False)
class Inspection(Shown):
    """Figures by name, and findings: `wrong` are errors, `odd` are warnings."""

    folder: Path
    figures: dict[str, object] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    odd: list[str] = field(default_factory=list)

    def summary(self) -> str:
        return f"{self.folder}, {len(self.wrong)} wrong, {len(self.odd)} odd"

    def to_dict(self) -> dict[str, Any]:
        """The figures by name, and the findings as sentences."""
        return {**self.figures, "wrong": self.wrong, "odd": self.odd}

    def attempt(self, work: Callable[..., T], *arguments: object) -> T | None:
        """The result of work(*arguments).

        After an InputError None; the message is added to `wrong`.
        """
        try:
            return work(*arguments)
        except InputError as error:
            self.wrong.append(str(error).removeprefix(f"{self.folder}/"))
            return None

    def images(self, where: list[str], paths: list[Path], sentence: str) -> None:
        """Add a sentence with the number and the names of images to `wrong` or `odd`, if there are
        any.
        """
        if paths:
            where.append(sentence.format(len(paths), first_names([path.name for path in paths])))


def first_names(names: list[str]) -> str:
    """The first three names."""
    return ", ".join(names[:3]) + " ..." * (len(names) > 3)
