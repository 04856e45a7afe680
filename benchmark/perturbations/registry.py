"""The perturbations by name. A perturbation is a function marked with @perturbation, in any module
of this folder, and its block of numbers in perturbations.toml.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from .segment import Segment


@dataclass(frozen=True)
class perturbation:  # noqa: N801 (a decorator)
    """Marks function(segment, level, fixed settings by keyword), which is known by its name."""

    function: Callable[..., Segment]

    def __call__(self, segment: Segment, level: float, *args: Any, **fixed: Any) -> Segment:
        return self.function(segment, level, *args, **fixed)


def functions() -> dict[str, perturbation]:
    """All perturbations of the modules of this folder."""
    found = {}
    for module in iter_modules([str(Path(__file__).parent)]):
        values = vars(import_module(f"{__package__}.{module.name}")).values()
        found.update({p.function.__name__: p for p in values if isinstance(p, perturbation)})
    return found
