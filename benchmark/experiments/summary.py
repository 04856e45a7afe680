"""Results of all cells over all segments: when each method fails, whether it notices, and how it
compares with related third-party methods.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..perturbations.plan import SEVERITIES, Plan
from .cells_file import Cells
from .matrix import CLEAN

#: Odometers of ours -> third-party ones of the same kind.
RELATIVES = {
    "fovis": ("run:fovis",),
    "rgbd": ("baseline:opencv-rgbd", "baseline:open3d-intensity"),
    "dvo": ("run:dvo",),
    "icp": ("baseline:opencv-icp", "baseline:open3d-plane"),
    "icp_rgbd": ("baseline:opencv-rgbd-icp", "baseline:open3d-hybrid"),
}


@dataclass(frozen=True)
class Group:
    """The cells of a method, a perturbation and a severity, over all segments. stretches: number of
    segments. ate_m: median, None if half or more have none.

    succeeded: share of segments. false_successes, false_alarms, alarms: shares of frames. noticed:
    share of the segments with a wrong pose; None if there is none. noticed_after: median number of
    frames. nees: mean. cause: the most frequent one.
    """

    stretches: int
    ate_m: float | None
    succeeded: float
    coverage: float
    worst_step_m: float | None
    false_successes: float
    false_alarms: float
    alarms: float
    noticed: float | None
    noticed_after: float | None
    nees: float | None
    cause: str

    @classmethod
    def of(cls, cells: list[dict[str, Any]]) -> "Group":
        after = [max(1, c["frames"] - 1) for c in cells]
        wrong = [c for c in cells if c["wrong"]]
        noticed = [c["noticed_after"] for c in wrong if c["noticed_after"] is not None]
        causes = Counter(c["cause"] for c in cells if c["cause"])
        nees = [c["nees"] for c in cells if c["nees"] is not None]
        shares = {
            k: sum(c[k] for c in cells) / sum(after)
            for k in ("false_successes", "false_alarms", "alarms")
        }
        return cls(
            stretches=len(cells),
            ate_m=_median(c["ate_m"] for c in cells),
            succeeded=float(np.mean([c["success"] for c in cells])),
            coverage=float(np.mean([c["coverage"] for c in cells])),
            worst_step_m=_median(c["worst_step_m"] for c in cells),
            **shares,
            noticed=len(noticed) / len(wrong) if wrong else None,
            noticed_after=float(np.median(noticed)) if noticed else None,
            nees=float(np.mean(nees)) if nees else None,
            cause=causes.most_common(1)[0][0] if causes else "",
        )

    @property
    def failed(self) -> bool:
        """Whether at least half of the segments did not succeed."""
        return self.succeeded <= 0.5

    def in_words(self) -> str:
        """All figures, for a tooltip."""
        parts = [
            f"ATE {_mm(self.ate_m)} mm",
            f"{self.succeeded:.0%} of {self.stretches} segments succeeded",
            f"coverage {self.coverage:.0%}",
            f"worst step {_mm(self.worst_step_m)} mm",
            f"false successes {self.false_successes:.1%}",
            f"false alarms {self.false_alarms:.1%}",
            f"alarms {self.alarms:.1%}",
        ]
        parts += [] if self.nees is None else [f"NEES {self.nees:.2g}"]
        parts += [] if self.noticed is None else [noticed(self)]
        return "; ".join([*parts, *([self.cause] if self.cause else [])])


def _median(values: Iterable[float | None]) -> float | None:
    middle = float(np.median([math.inf if v is None else v for v in values]))
    return middle if math.isfinite(middle) else None


def _mm(value_m: float | None) -> str:
    return "-" if value_m is None else f"{1e3 * value_m:.3g}"


def noticed(group: Group) -> str:
    if not group.noticed:
        return "does not notice"
    return f"notices in {group.noticed:.0%}, after {group.noticed_after:.0f} frames"


@dataclass(frozen=True, eq=False)
class Summary:
    """Groups by method, perturbation and severity; the unperturbed group has perturbation CLEAN and
    severity 0.
    """

    plan: Plan
    methods: list[str]
    perturbations: tuple[str, ...]
    cells: dict[tuple[str, str, int], Group]

    @classmethod
    def of(
        cls, plan: Plan, names: Iterable[str], perturbations: tuple[str, ...], cells: Cells
    ) -> "Summary":
        """Summary of the cells of the methods `names` that were measured, in this order."""
        found: dict[tuple[str, str, int], list[dict]] = defaultdict(list)
        for (task, name), figures in cells.items():
            found[name, task.perturbation, task.severity].append(figures)
        methods = [name for name in names if any(key[0] == name for key in found)]
        return cls(
            plan, methods, perturbations, {key: Group.of(some) for key, some in found.items()}
        )

    def row(self, method: str, perturbation: str) -> list[Group | None]:
        """The groups of severities 0 to 5."""
        clean = self.cells.get((method, CLEAN, 0))
        return [
            clean,
            *(self.cells.get((method, perturbation, k)) for k in range(1, SEVERITIES + 1)),
        ]

    def breaks_at(self, method: str, perturbation: str) -> int | None:
        """The lowest severity at which the method fails, 0 if it fails unperturbed, None if it
        never fails.
        """
        return next(
            (k for k, g in enumerate(self.row(method, perturbation)) if g and g.failed), None
        )

    def mark(self, method: str, perturbation: str) -> str:
        """The lowest severity with a failure, a dash if there is none, an empty text if it was not
        measured.
        """
        severity = self.breaks_at(method, perturbation)
        return (
            str(severity)
            if severity is not None
            else "-"
            if any(self.row(method, perturbation)[1:])
            else ""
        )

    def to_dict(self) -> dict[str, Any]:
        """The content of --json and OUT/stress.json."""
        keys = ("method", "perturbation", "severity")
        return {
            "cells": [
                {**dict(zip(keys, key, strict=True)), **asdict(g)} for key, g in self.cells.items()
            ]
        }

    def text(self) -> str:
        """The lowest severity at which each method fails, one line per perturbation, and totals."""
        short = [name.removeprefix("baseline:") for name in self.methods]
        width = max(map(len, (*self.perturbations, "clean: false alarms")))
        lines = [f"{'fails from severity':<{width}}  {'  '.join(short)}"]
        for p in self.perturbations:
            marks = [self.mark(m, p) for m in self.methods]
            cells = [f"{mark:>{len(name)}}" for mark, name in zip(marks, short, strict=True)]
            lines.append(f"{p:<{width}}  {'  '.join(cells)}")
        for title, values in self.totals().items():
            cells = [f"{v:>{len(name)}}" for v, name in zip(values, short, strict=True)]
            lines.append(f"{title:<{width}}  {'  '.join(cells)}")
        for ours, other, total, good, theirs, alone in self.relatives():
            where = f"; only the latter in {', '.join(alone)}" if alone else ""
            lines.append(f"{ours} succeeds in {good} of {total} cells, {other} in {theirs}{where}")
        return "\n".join(lines)

    def relatives(self) -> list[tuple[str, str, int, int, int, list[str]]]:
        """For each of our methods and each related third-party method: their names, the number of
        perturbed cells of both, the numbers of successes of each, and the cells in which only the
        latter succeeded.
        """
        found = []
        for ours, other in (
            (m, r) for m in self.methods for r in RELATIVES.get(m, ()) if r in self.methods
        ):
            pairs = {
                key[1:]: (g, self.cells.get((other, *key[1:])))
                for key, g in self.cells.items()
                if key[0] == ours
            }
            both = {key: (g, h) for key, (g, h) in pairs.items() if h and key[0] != CLEAN}
            good = sum(not g.failed for g, _ in both.values())
            theirs = sum(not h.failed for _, h in both.values())
            alone = [
                f"{name} {severity}"
                for (name, severity), (g, h) in both.items()
                if g.failed and not h.failed
            ]
            found.append((ours, other, len(both), good, theirs, alone))
        return found

    def totals(self) -> dict[str, list[str]]:
        """Title -> a text for each method, in the order of the methods."""
        by_method = {
            m: [g for (name, p, _), g in self.cells.items() if name == m and p != CLEAN]
            for m in self.methods
        }
        cleans = [self.cells.get((m, CLEAN, 0)) for m in self.methods]
        some = [by_method[m] for m in self.methods]
        nees = ["-" if c is None or c.nees is None else f"{c.nees:.2g}" for c in cleans]
        return {
            "clean: ATE [mm]": [_mm(c.ate_m if c else None) for c in cleans],
            "clean: false alarms": ["-" if c is None else f"{c.false_alarms:.1%}" for c in cleans],
            "clean: NEES": nees,
            "succeeded": [_share([g.succeeded for g in groups]) for groups in some],
            "false successes": [_share([g.false_successes for g in groups]) for groups in some],
            "false alarms": [_share([g.false_alarms for g in groups]) for groups in some],
        }


def _share(values: list[float]) -> str:
    return f"{np.mean(values):.1%}" if values else "-"
