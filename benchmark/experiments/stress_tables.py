"""Results of `iclnuim stress` over all segments: when each method fails, and whether it notices; as
tables and as a page.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..perturbations.plan import SEVERITIES, Plan
from .page import Page, Section
from .recipes.stress import CLEAN, StressKey
from .shades import shade, shown_mm
from .table import Mark, ResultTable, mm

#: Figures of a cell by its key.
Figures = Mapping[StressKey, Mapping[str, Any]]


@dataclass(frozen=True)
class Group:
    """The cells of a method, a perturbation and a severity, over all segments. segments: their
    number. ate_m: median, None if half or more have none.

    succeeded: share of segments. false_successes, false_alarms, alarms: shares of frames. noticed:
    share of the segments with a wrong pose; None if there is none. noticed_after: median number of
    frames. nees: mean. cause: the most frequent one.
    """

    segments: int
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
    def of(cls, cells: Sequence[Mapping[str, Any]]) -> "Group":
        after_first = sum(max(1, c["frames"] - 1) for c in cells)
        wrong = [c for c in cells if c["wrong"]]
        noticed = [c["noticed_after"] for c in wrong if c["noticed_after"] is not None]
        causes = Counter(c["cause"] for c in cells if c["cause"])
        nees = [c["nees"] for c in cells if c["nees"] is not None]
        return cls(
            segments=len(cells),
            ate_m=_median(c["ate_m"] for c in cells),
            succeeded=float(np.mean([c["success"] for c in cells])),
            coverage=float(np.mean([c["coverage"] for c in cells])),
            worst_step_m=_median(c["worst_step_m"] for c in cells),
            false_successes=sum(c["false_successes"] for c in cells) / after_first,
            false_alarms=sum(c["false_alarms"] for c in cells) / after_first,
            alarms=sum(c["alarms"] for c in cells) / after_first,
            noticed=len(noticed) / len(wrong) if wrong else None,
            noticed_after=float(np.median(noticed)) if noticed else None,
            nees=float(np.mean(nees)) if nees else None,
            cause=causes.most_common(1)[0][0] if causes else "",
        )

    @property
    def failed(self) -> bool:
        """Whether at least half of the segments did not succeed."""
        return self.succeeded <= 0.5

    @property
    def mark(self) -> str:
        """The ATE in mm, or a cross for a failure; ! if it also reports wrong poses as good."""
        if not self.failed and self.ate_m is not None:
            return mm(self.ate_m, ".2g")
        return "\u00d7!" if self.failed and self.false_successes > 0 else "\u00d7"

    def notice(self) -> str:
        """Whether it notices wrong poses; empty if there are none."""
        if self.noticed is None:
            return ""
        if not self.noticed:
            return "does not notice"
        return f"notices in {self.noticed:.0%}, after {self.noticed_after:.0f} frames"

    def in_words(self) -> str:
        """All figures, for a tooltip."""
        parts = [
            f"ATE {mm(self.ate_m)} mm",
            f"{self.succeeded:.0%} of {self.segments} segments succeeded",
            f"coverage {self.coverage:.0%}",
            f"worst step {mm(self.worst_step_m)} mm",
            f"false successes {self.false_successes:.1%}",
            f"false alarms {self.false_alarms:.1%}",
            f"alarms {self.alarms:.1%}",
            "" if self.nees is None else f"NEES {self.nees:.2g}",
            self.notice(),
            self.cause,
        ]
        return "; ".join(filter(None, parts))


def _median(values: Iterable[float | None]) -> float | None:
    middle = float(np.median([math.inf if v is None else v for v in values]))
    return middle if math.isfinite(middle) else None


@dataclass(frozen=True, eq=False)
class Summary:
    """Groups by method, perturbation and severity; the unperturbed group has perturbation CLEAN and
    severity 0.
    """

    plan: Plan
    methods: list[str]
    perturbations: tuple[str, ...]
    groups: Mapping[tuple[str, str, int], Group]

    @classmethod
    def of(
        cls, plan: Plan, names: Iterable[str], perturbations: tuple[str, ...], cells: Figures
    ) -> "Summary":
        """Summary of the cells of the methods `names` that were measured, in this order."""
        found = defaultdict(list)
        for key, figures in cells.items():
            found[key.method, key.perturbation, key.severity].append(figures)
        methods = [name for name in names if any(key[0] == name for key in found)]
        groups = {key: Group.of(some) for key, some in found.items()}
        return cls(plan, methods, perturbations, groups)

    def row(self, method: str, perturbation: str) -> list[Group | None]:
        """The groups of severities 0 to 5."""
        severities = range(1, SEVERITIES + 1)
        perturbed = [self.groups.get((method, perturbation, k)) for k in severities]
        return [self.groups.get((method, CLEAN, 0)), *perturbed]

    def fails_at(self, method: str, perturbation: str) -> int | None:
        """The lowest severity at which the method fails, 0 if it fails unperturbed, None if it
        never fails.
        """
        groups = enumerate(self.row(method, perturbation))
        return next((severity for severity, g in groups if g and g.failed), None)

    def to_dict(self) -> dict[str, Any]:
        """The content of --json and OUT/stress.json."""
        cells = []
        for (method, perturbation, severity), group in self.groups.items():
            key = {"method": method, "perturbation": perturbation, "severity": severity}
            cells.append({**key, **asdict(group)})
        return {"cells": cells}

    def overview(self) -> ResultTable:
        """The lowest severity at which each method fails, one row per perturbation, and totals."""
        rows = []
        marks = {}
        for i, name in enumerate(self.perturbations):
            texts = [self._first_failure(method, name) for method in self.methods]
            rows.append((name, *texts))
            for j, text in enumerate(texts, 1):
                if text.isdecimal():
                    marks[i, j] = Mark(shade(100.0 / 4 ** int(text)))
        rows += [(title, *values) for title, values in self._totals().items()]
        bounds = self.plan.bounds
        note = (
            "A severity fails if at least half of its segments do: their ATE is above "
            f"{mm(bounds.success_m, 'g')} mm, or less than {bounds.min_coverage:.0%} of their "
            "frames have a pose. A dash: no severity fails."
        )
        columns = ("fails from severity", *map(_short, self.methods))
        title = "The lowest severity at which methods fail."
        return ResultTable("stress", title, columns, tuple(rows), notes=(note,), marks=marks)

    def _first_failure(self, method: str, perturbation: str) -> str:
        """As a text; empty if it was not measured."""
        severity = self.fails_at(method, perturbation)
        if severity is not None:
            return str(severity)
        return "-" if any(self.row(method, perturbation)[1:]) else ""

    def _totals(self) -> dict[str, list[str]]:
        """Title -> a text for each method, in the order of the methods."""
        cleans = [self.groups.get((m, CLEAN, 0)) for m in self.methods]
        perturbed = []
        for method in self.methods:
            keys = [key for key in self.groups if key[0] == method and key[1] != CLEAN]
            perturbed.append([self.groups[key] for key in keys])
        nees = [None if c is None else c.nees for c in cleans]
        return {
            "clean: ATE mm": [mm(c.ate_m if c else None) for c in cleans],
            "clean: false alarms": ["-" if c is None else f"{c.false_alarms:.1%}" for c in cleans],
            "clean: NEES": ["-" if value is None else f"{value:.2g}" for value in nees],
            "succeeded": [_share(g.succeeded for g in some) for some in perturbed],
            "false successes": [_share(g.false_successes for g in some) for some in perturbed],
            "false alarms": [_share(g.false_alarms for g in some) for some in perturbed],
        }

    def of_method(self, method: str) -> ResultTable:
        """The ATE of a method in mm by perturbation and severity."""
        rows = []
        marks = {}
        for i, name in enumerate(self.perturbations):
            groups = self.row(method, name)
            perturbation = self.plan.perturbations[name]
            for severity, group in enumerate(groups):
                if group is not None:
                    level = perturbation.level(severity) if severity else "unperturbed"
                    style = shade(shown_mm(group.ate_m, group.failed))
                    marks[i, 1 + severity] = Mark(style, f"{level}: {group.in_words()}")
            texts = [group.mark if group else "" for group in groups]
            rows.append((name, *texts, *self._verdict(method, name)))
        severities = map(str, range(SEVERITIES + 1))
        columns = ("", *severities, "fails at", "failure noticed", "diagnosed cause")
        return ResultTable(method, f"ATE of {method} in mm.", columns, tuple(rows), marks=marks)

    def _verdict(self, method: str, name: str) -> tuple[str, str, str]:
        """The level at which the method fails, whether it notices, and the diagnosed cause."""
        severity = self.fails_at(method, name)
        group = None if severity is None else self.row(method, name)[severity]
        if group is None:
            return "-", "", ""
        level = self.plan.perturbations[name].level(severity) if severity else "unperturbed"
        return level, group.notice(), group.cause

    def page(self) -> Page:
        """An overview, then a section for each method."""
        lead = (
            "Numbers are the median ATE in mm; \u00d7 is a failure; ! means that the method also "
            "reports wrong poses as good. Point at a number for all figures."
        )
        sections = [Section("overview", "Overview", tables=[self.overview()])]
        for method in self.methods:
            name = method.replace(":", "-")
            sections.append(Section(name, method, tables=[self.of_method(method)]))
        return Page("ICL-NUIM: where methods fail", lead, sections)

    def write(self, out: Path) -> Path:
        """Write OUT/stress.html and return its path."""
        return self.page().write(out / "stress.html")


def _short(method: str) -> str:
    return method.removeprefix("baseline:")


def _share(values: Iterable[float]) -> str:
    found = list(values)
    return f"{np.mean(found):.1%}" if found else "-"
