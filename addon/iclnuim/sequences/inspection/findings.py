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
    """Figures by name, and what was found: errors and warnings as sentences.

    explanations: of poses that do not fit the depth, {kind, parameters}; explained_error: the
    figures with all of them applied, None without any.
    """

    folder: Path
    figures: dict[str, object] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    explanations: list[dict[str, Any]] = field(default_factory=list)
    explained_error: dict[str, float] | None = None

    def summary(self) -> str:
        return f"{self.folder}, {len(self.errors)} errors, {len(self.warnings)} warnings"

    def to_dict(self) -> dict[str, Any]:
        """The content of `iclnuim inspect` for JSON."""
        return {
            "folder": str(self.folder),
            "figures": self.figures,
            "errors": self.errors,
            "warnings": self.warnings,
            "explanations": self.explanations,
            "explained_error": self.explained_error,
        }

    def attempt(self, work: Callable[[], T]) -> T | None:
        """The result of work(); after an InputError None, and the message is added to `errors`."""
        try:
            return work()
        except InputError as error:
            self.errors.append(str(error).removeprefix(f"{self.folder}/"))
            return None

    def images(self, where: list[str], paths: list[Path], sentence: str) -> None:
        """Add a sentence with the number and the names of images to `errors` or `warnings`, if there are
        any.
        """
        if paths:
            where.append(sentence.format(len(paths), first_names([path.name for path in paths])))


def first_names(names: list[str]) -> str:
    """The first three names."""
    return ", ".join(names[:3]) + " ..." * (len(names) > 3)
