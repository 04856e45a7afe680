"""Results of `iclnuim stress` over all segments: when each method fails, and whether it notices; as
tables.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_hex

from ....odometry.registry import names
from ....perturbations.plan import CLEAN, SEVERITIES, Plan
from ....systems.system import title_of
from ...intervals import share_interval
from ...outcome import mean, median
from ...table import Mark, ResultTable, mm, shown
from .recipe import SYSTEM, StressKey

#: Figures of a cell by its key.
Figures = Mapping[StressKey, Mapping[str, Any]]


@dataclass(frozen=True)
class Group:
    """The cells of a method, a perturbation and a severity, over all segments. segments: their
    number. ate_m: median, None if half or more have none. ate_low_m, ate_high_m: the smallest and
    the largest, None if a segment has none.

    succeeded: share of segments. false_successes, false_alarms, alarms: shares of frames. noticed:
    share of the segments with a wrong pose; None if there is none. noticed_after: median number of
    frames. nees: mean. cause: the most frequent one. ms: of a frame, in the mean.
    """

    segments: int
    ate_m: float | None
    ate_low_m: float | None
    ate_high_m: float | None
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
    ms: float | None = None

    @classmethod
    def of(cls, cells: Sequence[Mapping[str, Any]]) -> "Group":
        after_first = sum(max(1, c["frames"] - 1) for c in cells)
        wrong = [c for c in cells if c["wrong"]]
        noticed = [c["noticed_after"] for c in wrong if c["noticed_after"] is not None]
        causes = Counter(c["cause"] for c in cells if c["cause"])
        errors_m = [c["ate_m"] for c in cells]
        ends = (None, None) if None in errors_m else (min(errors_m), max(errors_m))
        return cls(
            segments=len(cells),
            ate_m=_median_with_failures(errors_m),
            ate_low_m=ends[0],
            ate_high_m=ends[1],
            succeeded=float(np.mean([c["success"] for c in cells])),
            coverage=float(np.mean([c["coverage"] for c in cells])),
            worst_step_m=_median_with_failures(c["worst_step_m"] for c in cells),
            false_successes=sum(c["false_successes"] for c in cells) / after_first,
            false_alarms=sum(c["false_alarms"] for c in cells) / after_first,
            alarms=sum(c["alarms"] for c in cells) / after_first,
            noticed=mean(c["noticed_after"] is not None for c in wrong),
            noticed_after=median(noticed),
            nees=mean(c["nees"] for c in cells),
            cause=max(causes, key=causes.__getitem__, default=""),
            ms=1e3 * sum(c.get("seconds") or 0.0 for c in cells) / after_first or None,
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
            f"NEES {shown(self.nees, '.2g')}",
            self.notice(),
            self.cause,
        ]
        return "; ".join(filter(None, parts))


def _median_with_failures(values: Iterable[float | None]) -> float | None:
    """The median, where None is larger than any figure."""
    found = sorted((value is None, value or 0.0) for value in values)
    low = found[(len(found) - 1) // 2]
    high = found[len(found) // 2]
    return None if high[0] else (low[1] + high[1]) / 2


def method_name(method: str) -> str:
    """The name of a method wherever it is shown: of a system of `iclnuim run` its title, with
    `(run)` if an odometer has the same name.
    """
    name = method.removeprefix(SYSTEM)
    if name == method:
        return method
    return f"{name} (run)" if name in names() else title_of(name)


#: Rows of the unperturbed frames: title, figure, format, factor.
_CLEAN_TOTALS = (
    ("unperturbed: ATE in mm", "ate_m", ".3g", 1e3),
    ("unperturbed: right poses reported as bad", "false_alarms", ".1%", 1),
    ("unperturbed: squared error / stated one", "nees", ".2g", 1),
)
#: Rows of all perturbed frames: title, share.
_PERTURBED_TOTALS = (
    ("perturbed: segments that succeed", "succeeded"),
    ("perturbed: wrong poses reported as good", "false_successes"),
    ("perturbed: right poses reported as bad", "false_alarms"),
)


@dataclass(frozen=True, eq=False)
class Summary:
    """Groups by method, perturbation and severity, all of one base; the unperturbed group has
    perturbation CLEAN and severity 0.
    """

    plan: Plan
    methods: list[str]
    perturbations: tuple[str, ...]
    groups: Mapping[tuple[str, str, int], Group]
    base: str = CLEAN

    @classmethod
    def of(
        cls,
        plan: Plan,
        names: Iterable[str],
        perturbations: tuple[str, ...],
        cells: Figures,
        base: str = CLEAN,
    ) -> "Summary":
        """Summary of the cells of a base, of the methods `names` that were measured, in this
        order.
        """
        found = defaultdict(list)
        for key, figures in cells.items():
            if key.base != base:
                continue
            found[key.method, key.perturbation, key.severity].append(figures)
        methods = [name for name in names if any(key[0] == name for key in found)]
        groups = {key: Group.of(some) for key, some in found.items()}
        return cls(plan, methods, perturbations, groups, base)

    def row(self, method: str, perturbation: str) -> list[Group | None]:
        """The groups of severities 0 to 5."""
        severities = range(1, SEVERITIES + 1)
        perturbed = [self.groups.get((method, perturbation, k)) for k in severities]
        return [self.groups.get((method, CLEAN, 0)), *perturbed]

    def to_dict(self) -> dict[str, Any]:
        """The content of --json and OUT/stress.json."""
        cells = []
        for (method, perturbation, severity), group in self.groups.items():
            key = {
                "method": method_name(method),
                "perturbation": perturbation,
                "severity": severity,
            }
            cells.append({**key, **asdict(group)})
        return {"base": self.base, "cells": cells}

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
        rows += self._totals()
        bounds = self.plan.bounds
        note = (
            "A severity fails if at least half of its segments do: their ATE is above "
            f"{mm(bounds.success_m, 'g')} mm, or less than {bounds.min_coverage:.0%} of their "
            "frames have a pose. A dash: no severity fails. Squared error / stated one (NEES): 1 if "
            "errors are as large as the method states."
        )
        columns = (
            "fails from severity",
            *map(method_name, self.methods),
        )
        title = f"The lowest severity at which methods fail, {self.base} frames perturbed."
        return ResultTable("stress", title, columns, tuple(rows), notes=(note,), marks=marks)

    def _first_failure(self, method: str, perturbation: str) -> str:
        """The lowest severity at which the method fails, 0 if it fails unperturbed; a dash if it
        never fails, empty if it was not measured.
        """
        groups = self.row(method, perturbation)
        failed = [str(severity) for severity, group in enumerate(groups) if group and group.failed]
        return [*failed, *["-"] * any(groups[1:]), ""][0]

    def _totals(self) -> list[tuple[str, ...]]:
        """Rows of the unperturbed frames, and of means over all perturbed ones."""
        rows = []
        cleans = [self.groups.get((m, CLEAN, 0)) for m in self.methods]
        for title, name, spec, factor in _CLEAN_TOTALS:
            values = [getattr(clean, name, None) for clean in cleans]
            rows.append((title, *(shown(v, spec, factor) for v in values)))
        for title, name in _PERTURBED_TOTALS:
            values = [self._mean(method, name) for method in self.methods]
            rows.append((title, *(shown(v, ".1%") for v in values)))
        return rows

    def _mean(self, method: str, name: str) -> float | None:
        keys = [key for key in self.groups if key[0] == method and key[1] != CLEAN]
        return mean(getattr(self.groups[key], name) for key in keys)

    def by_severity(self) -> ResultTable:
        """The ATE of each method in mm, one row per perturbation and method."""
        rows = []
        for name in self.perturbations:
            for method in self.methods:
                groups = self.row(method, name)
                rows.append(
                    (name, method_name(method), *(getattr(group, "mark", "") for group in groups))
                )
        columns = ("", "severity", *map(str, range(SEVERITIES + 1)))
        title = f"ATE in mm, {self.base} frames perturbed; 0: unperturbed; \u00d7: failed; !: reports wrong poses as good."
        return ResultTable("severities", title, columns, tuple(rows))

    def of_method(self, method: str) -> ResultTable:
        """The ATE of a method in mm by perturbation and severity."""
        rows = []
        marks = {}
        for i, name in enumerate(self.perturbations):
            groups = self.row(method, name)
            texts = [getattr(group, "mark", "") for group in groups]
            rows.append((name, *texts, *self._verdict(method, name)))
            for severity, group in enumerate(groups):
                if group is not None:
                    style = shade(shown_mm(group.ate_m, group.failed))
                    about = f"{self._level(name, severity)}: {group.in_words()}"
                    marks[i, 1 + severity] = Mark(style, about)
        severities = map(str, range(SEVERITIES + 1))
        columns = ("", *severities, "fails at", "failure noticed", "diagnosed cause")
        return ResultTable(
            method, f"ATE of {method_name(method)} in mm.", columns, tuple(rows), marks=marks
        )

    def _level(self, name: str, severity: int) -> str:
        return self.plan.perturbations[name].level(severity) if severity else "unperturbed"

    def _verdict(self, method: str, name: str) -> tuple[str, str, str]:
        """The level at which the method fails, whether it notices, and the diagnosed cause."""
        for severity, group in enumerate(self.row(method, name)):
            if group and group.failed:
                return self._level(name, severity), group.notice(), group.cause
        return "-", "", ""

    def speed(self) -> ResultTable:
        """What each method costs beside how often it succeeds, the most often first; with the 95 %
        interval of the share.
        """
        rows = []
        for name, ms, share, low, high in sorted(self.speeds(), key=lambda of: -of[2]):
            clean = self.groups.get((name, CLEAN, 0))
            ate_mm = mm(clean.ate_m if clean else None)
            texts = (f"{share:.1%}", f"{low:.1%}", f"{high:.1%}", ate_mm)
            rows.append((method_name(name), shown(ms, ".1f"), *texts))
        columns = ("method", "ms a frame", "succeed", "95 % from", "to", "unperturbed ATE mm")
        return ResultTable("speed", "Success beside speed.", columns, tuple(rows))

    def speeds(self) -> list[tuple[str, float | None, float, float, float]]:
        """Of each method: ms a frame, the share of perturbed segments that succeed, and the ends of
        its interval.
        """
        found = []
        for method in self.methods:
            groups = [g for key, g in self.groups.items() if key[0] == method and key[1] != CLEAN]
            if groups:
                segments = sum(group.segments for group in groups)
                succeeded = sum(round(group.succeeded * group.segments) for group in groups)
                ms = mean(group.ms for group in groups)
                found.append((method, ms, *share_interval(succeeded, segments)))
        return found


# -- the colour scale of errors: logarithmic, distinguishable without colour vision and in grey

#: Ends of the scale in mm.
LOW_MM = 0.1
HIGH_MM = 100.0
#: Colours from small to large errors.
COLOURS = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")
#: Place on the scale from which black text is easier to read than white.
_BRIGHT = 0.55


def shown_mm(ate_m: float | None, failed: bool) -> float:
    """The error in mm that the colour shows: the highest for a failure."""
    if failed or ate_m is None:
        return HIGH_MM
    return float(np.clip(1e3 * ate_m, LOW_MM, HIGH_MM))


def ink(error_mm: float) -> str:
    """The colour of a text on the colour of an error."""
    return "black" if _place(error_mm) > _BRIGHT else "white"


def shade(error_mm: float) -> str:
    """CSS of the colour of an error, and of a text on it."""
    colour = to_hex(colour_map()(_place(error_mm)))
    return f"background:{colour};color:{ink(error_mm)}"


def colour_map() -> LinearSegmentedColormap:
    """The colours from 0 to 1 on the scale."""
    return LinearSegmentedColormap.from_list("ate", COLOURS)


def _place(error_mm: float) -> float:
    """Place 0..1 on the scale."""
    return math.log(error_mm / LOW_MM) / math.log(HIGH_MM / LOW_MM)
