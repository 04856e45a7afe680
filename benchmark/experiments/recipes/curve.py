"""The recipe of `iclnuim bench curve`: one setting in steps, everything else constant.

All steps of a sequence are measured together, as their times can be compared only then: if one is
missing, all are measured again.

OUT/cells/CURVE/SEQUENCE/METHOD_VALUE   a cell
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from iclnuim.benchmark.fusion.surface_error import TrueSurface
from iclnuim.console import Console
from iclnuim.formats.files import sha256

from ...perturbations.segment import Segment
from .. import curves, fusion_curve
from ..cell import Cell
from ..code_version import code_of, method_code
from ..curves import CURVES, Point, Step
from ..fusion_curve import FusedPoint
from ..inputs import Input
from ..page import Page, Section
from ..pool import Advance, Job, run_jobs
from ..store import Store
from ..table import ResultTable, mm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KIND = "curve"
FUSION = "voxel"
_EXPERIMENTS = "iclnuim.benchmark.experiments"


@dataclass(frozen=True)
class CurveKey:
    """A method on a sequence with one value of the setting; None if it does not have it."""

    curve: str
    sequence: str
    method: str
    value: float | None

    @property
    def place(self) -> str:
        value = "default" if self.value is None else f"{self.value:g}"
        name = f"{self.method.replace(':', '_')}_{value}"
        return f"{self.curve}/{self.sequence.replace('/', '_')}/{name}"


@dataclass(frozen=True, eq=False)
class Curve:
    """The experiment. start, frames: which frames of each input. settings: further settings that
    decide the figures. surface: the true surface, for the curve of fusion.
    """

    name: str
    inputs: Mapping[str, Input]
    segments: Mapping[str, Segment]
    steps: Sequence[Step]
    settings: Mapping[str, Any]
    surface: TrueSurface | None = None

    def cells(self, sequence: str) -> list[Cell]:
        """The cells of a sequence."""
        segment = self.segments[sequence]
        module = "fusion_curve" if self.surface else "curves"
        identity = {
            "input": self.inputs[sequence].sha256,
            "numbers": [segment.numbers[0], segment.numbers[-1]],
            "camera": segment.camera.to_dict(),
            "code": code_of(f"{_EXPERIMENTS}.{module}"),
            **self.settings,
        }
        found = []
        for method, value in self.steps:
            key = CurveKey(self.name, sequence, method, value)
            found.append(Cell(key, identity | {"method_code": method_code(method)}))
        return found

    def run(self, store: Store, console: Console) -> None:
        """Measure the sequences of which a step is missing."""
        folders = {name: str(one.sequence.folder) for name, one in self.inputs.items()}
        store.open({}, {"sequences": folders, **self.settings})
        jobs = []
        for sequence, segment in self.segments.items():
            if not store.missing(self.cells(sequence)):
                continue

            def measure(advance: Advance, sequence: str = sequence) -> None:
                self._measure(sequence, store, advance)

            jobs.append(Job(sequence, measure, self._length(segment)))
        frames = sum(job.steps for job in jobs)
        progress = console.progress(frames, f"bench curve {self.name}")
        run_jobs(jobs, 1, progress.advance)

    def _length(self, segment: Segment) -> int:
        values = [value for _, value in self.steps if value is not None]
        return curves.length(self.name, list(dict.fromkeys(values)), segment)

    def _measure(self, sequence: str, store: Store, advance: Advance) -> None:
        segment = self.segments[sequence]

        def progress() -> None:
            advance(1)

        if self.surface is None:
            steps = curves.measure(self.name, self.steps, segment, progress)
            figures = [asdict(point) for point in steps]
        else:
            voxels_m = [value for _, value in self.steps if value is not None]
            fused = fusion_curve.measure(voxels_m, segment, self.surface, progress)
            figures = [asdict(point) for point in fused]
        for cell, one in zip(self.cells(sequence), figures, strict=True):
            store.write(cell, one)

    def points(self, store: Store) -> dict[str, list[Any]]:
        """The measured points of each sequence."""
        point = FusedPoint if self.surface else Point
        found = {}
        for sequence in self.segments:
            measured = store.read(self.cells(sequence))
            found[sequence] = [point(**one.figures) for one in measured]
        return found

    def tables(self, points: Mapping[str, Sequence[Any]]) -> list[ResultTable]:
        """A table for each sequence."""
        table = _fusion_table if self.surface else _table
        return [table(sequence, found) for sequence, found in points.items()]

    def page(self, points: Mapping[str, Sequence[Any]]) -> Page:
        """A section for each sequence."""
        lead = "Times can be compared within a sequence, whose steps were measured together."
        sections = []
        for table in self.tables(points):
            sections.append(Section(table.title.replace("/", "-"), table.title, tables=[table]))
        return Page(f"ICL-NUIM: curve {self.name}", lead, sections)

    def figure(self, points: Mapping[str, Sequence[Any]]) -> "Figure":
        """Error over cost."""
        from ..curve_chart import figure, fusion_figure

        return fusion_figure(points) if self.surface else figure(self.name, points)


def surface_sha256(surface: TrueSurface) -> str:
    """What identifies a model."""
    return sha256(surface.vertices.tobytes() + surface.triangles.tobytes())


def _table(sequence: str, points: Sequence[Point]) -> ResultTable:
    rows = []
    for p in points:
        value = "-" if p.value is None else f"{p.value:g}"
        tracked = f"{p.tracked}/{p.frames}"
        rows.append((p.method, value, tracked, mm(p.ate_m, ".3f"), f"{p.ms:.1f}"))
    columns = ("method", "value", "tracked", "ATE mm", "ms")
    return ResultTable("curve", sequence, columns, tuple(rows))


def _fusion_table(sequence: str, points: Sequence[FusedPoint]) -> ResultTable:
    rows = []
    for p in points:
        errors = (mm(p.mean_m, ".3f"), mm(p.median_m, ".3f"), mm(p.p95_m, ".3f"))
        costs = (f"{p.ms:.1f}", f"{p.meshing_s:.1f}", f"{p.memory_mb:.0f}", f"{p.vertices}")
        rows.append((mm(p.voxel_m, ".1f"), *errors, *costs))
    columns = ("voxel mm", "mean mm", "median", "95 %", "ms", "meshing s", "MB", "vertices")
    return ResultTable("curve", sequence, columns, tuple(rows))


def default_values(curve: str) -> tuple[float, ...]:
    """The values of a curve without --values."""
    return fusion_curve.VALUES if curve == FUSION else CURVES[curve].values
