"""The recipe of `iclnuim bench curve`: one setting in steps, everything else constant.

All steps of a sequence are measured together, as their times can be compared only then: if one is
missing, all are measured again.

OUT/cells/CURVE/SEQUENCE/METHOD_VALUE   a cell
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from iclnuim.benchmark.fusion.surface_error import TrueSurface
from iclnuim.console import Console
from iclnuim.formats.files import sha256

from ....perturbations.segment import Segment
from ...cell import Cell
from ...code_version import code_of, method_code
from ...inputs import Input
from ...page import Page, Section
from ...pool import Advance, Job, run_jobs
from ...store import Store
from ...table import ResultTable, mm, shown
from . import curves
from .curves import FusedPoint, Point, Step

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KIND = "curve"
FUSION = "voxel"


@dataclass(frozen=True)
class CurveKey:
    """A method on a sequence with one value of the setting; None if it does not have it."""

    curve: str
    sequence: str
    method: str
    value: float | None

    @property
    def place(self) -> str:
        name = f"{self.method.replace(':', '_')}_{shown(self.value, 'g')}"
        return f"{self.curve}/{self.sequence.replace('/', '_')}/{name}"


@dataclass(frozen=True, eq=False)
class CurveRecipe:
    """The experiment with odometers. segments: which frames of each input. settings: further
    settings that decide the figures. measurement: the function that measures. point: its figures.
    """

    name: str
    inputs: Mapping[str, Input]
    segments: Mapping[str, Segment]
    steps: Sequence[Step]
    settings: Mapping[str, Any]

    measurement: ClassVar[str] = f"{curves.__name__}:measure"
    point: ClassVar[Callable[..., Any]] = Point

    def cells(self, sequence: str) -> list[Cell]:
        """The cells of a sequence."""
        segment = self.segments[sequence]
        identity = {
            "input": self.inputs[sequence].sha256,
            "numbers": [segment.numbers[0], segment.numbers[-1]],
            "camera": segment.camera.to_dict(),
            "code": code_of(self.measurement),
            **self.settings,
        }
        found = []
        for method, value in self.steps:
            key = CurveKey(self.name, sequence, method, value)
            found.append(Cell(key, identity | {"method_code": method_code(method)}))
        return found

    def jobs(self, store: Store) -> list[Job]:
        """Those of the sequences of which a step is missing."""
        jobs = []
        for sequence, segment in self.segments.items():
            if store.missing(self.cells(sequence)):
                measure = partial(self._measure, sequence, store)
                jobs.append(Job(sequence, measure, len(segment.numbers)))
        return jobs

    def run(self, store: Store, console: Console) -> None:
        """Measure the sequences of which a step is missing."""
        folders = {name: str(one.sequence.folder) for name, one in self.inputs.items()}
        store.open({}, {"sequences": folders, **self.settings})
        jobs = self.jobs(store)
        frames = sum(job.steps for job in jobs)
        progress = console.progress(frames, f"bench curve {self.name}")
        run_jobs(jobs, 1, progress.advance)

    def _values(self) -> list[float]:
        values = [value for _, value in self.steps if value is not None]
        return list(dict.fromkeys(values))

    def _measure(self, sequence: str, store: Store, advance: Advance) -> None:
        points = self._points(self.segments[sequence], lambda: advance(1))
        for cell, point in zip(self.cells(sequence), points, strict=True):
            store.write(cell, asdict(point))

    def _points(self, segment: Segment, progress: Callable[[], object]) -> Sequence[Any]:
        return curves.measure(self.name, self.steps, segment, progress)

    def points(self, store: Store) -> dict[str, list[Any]]:
        """The measured points of each sequence."""
        found = {}
        for sequence in self.segments:
            measured = store.read(self.cells(sequence))
            found[sequence] = [self.point(**one.figures) for one in measured]
        return found

    def table(self, sequence: str, points: Sequence[Any]) -> ResultTable:
        """A row for each step."""
        rows = []
        for p in points:
            tracked = f"{p.tracked}/{p.frames}"
            errors = (mm(p.ate_m, ".3f"), f"{p.ms:.1f}")
            rows.append((p.method, shown(p.value, "g"), tracked, *errors))
        columns = ("method", "value", "tracked", "ATE mm", "ms")
        return ResultTable("curve", sequence, columns, tuple(rows))

    def page(self, points: Mapping[str, Sequence[Any]]) -> Page:
        """A section for each sequence."""
        lead = "Times can be compared within a sequence, whose steps were measured together."
        sections = []
        for name, found in points.items():
            sections.append(Section(name.replace("/", "-"), name, "", [self.table(name, found)]))
        return Page(f"ICL-NUIM: curve {self.name}", lead, sections)

    def figure(self, points: Mapping[str, Sequence[Any]]) -> "Figure":
        """Error over cost."""
        from .chart import curve_figure

        return curve_figure(self.name, points)


@dataclass(frozen=True, eq=False)
class FusionCurve(CurveRecipe):
    """The experiment with voxels, whose surfaces are compared with the true surface."""

    surface: TrueSurface

    measurement: ClassVar[str] = f"{curves.__name__}:measure_fusion"
    point: ClassVar[Callable[..., Any]] = FusedPoint

    def _points(self, segment: Segment, progress: Callable[[], object]) -> Sequence[Any]:
        return curves.measure_fusion(self._values(), segment, self.surface, progress)

    def table(self, sequence: str, points: Sequence[Any]) -> ResultTable:
        rows = []
        for p in points:
            errors = (mm(p.mean_m, ".3f"), mm(p.median_m, ".3f"), mm(p.p95_m, ".3f"))
            costs = (f"{p.ms:.1f}", f"{p.meshing_s:.1f}", f"{p.memory_mb:.0f}", f"{p.vertices}")
            rows.append((mm(p.voxel_m, ".1f"), *errors, *costs))
        columns = ("voxel mm", "mean mm", "median", "95 %", "ms", "meshing s", "MB", "vertices")
        return ResultTable("curve", sequence, columns, tuple(rows))

    def figure(self, points: Mapping[str, Sequence[Any]]) -> "Figure":
        from .chart import fusion_figure

        return fusion_figure(points)


def surface_sha256(surface: TrueSurface) -> str:
    """What identifies a model."""
    return sha256(surface.vertices.tobytes() + surface.triangles.tobytes())
