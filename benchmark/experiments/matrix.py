"""Computes all cells, every method on every perturbed segment, on all cores. Each cell is a file
with the settings that decided it; existing cells are kept.

OUT/recipe.json                                    versions, machine, the whole file of
                                                   perturbations
OUT/cells/SEQUENCE/START/PERTURBATION_SEVERITY/METHOD.json      one cell: its identity and its
figures
"""

import functools
import os
import platform
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.benchmark.odometry.registry import BASELINES, ODOMETERS, PACKAGES, odometer
from iclnuim.benchmark.odometry.run import Sequence
from iclnuim.dataset.frame_pool import FramePool
from iclnuim.dataset.frames import FrameSource, read_truth, rendered_job, require_images
from iclnuim.dataset.sequence import write_sequence
from iclnuim.errors import InputError
from iclnuim.formats.files import is_file, make_folder, read_json, sha256, write_json
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, sample
from iclnuim.sensor.transfer import light_from_srgb8
from iclnuim.shipped import source_commit, versions
from iclnuim.version import __version__

from ..perturbations.plan import SEVERITIES, Plan
from ..perturbations.segment import Segment
from ..systems.experiment import Experiment
from ..systems.staging import StagedSequence
from ..systems.system import System
from . import code_version
from .cell import Cell, Poses, cell, diagnostics, track_all

_SCHEMA_VERSION = 1
CLEAN = "clean"
#: Libraries whose versions the recipe records.
_LIBRARIES = ("numpy", "numba", "opencv-contrib-python-headless", "open3d-cpu")


@dataclass(frozen=True)
class Task:
    """One perturbed segment; severity 0 is unperturbed."""

    sequence: str
    start: int
    perturbation: str
    severity: int

    @property
    def place(self) -> str:
        """Folder of the task, relative to cells/."""
        name = f"{self.perturbation}_{self.severity}" if self.severity else CLEAN
        return f"{self.sequence.replace('/', '_')}/{self.start}/{name}"


@dataclass(frozen=True, eq=False)
class Base:
    """A sequence from which segments are taken, and its ground truth."""

    name: str
    sequence: Sequence
    truth: Trajectory
    files_sha256: str

    @classmethod
    def of(cls, folder: Path) -> "Base":
        """Open a sequence. Its name is that in its recipe, or the last two folders of its path.
        Raises InputError without ground truth
        or without one of the images.
        """
        sequence, truth = Sequence(folder), read_truth(folder)
        if truth is None:
            raise InputError("a ground truth in the folder", path=folder)
        require_images(folder, sequence.pairs)
        name = rendered_job(folder).get("sequence") or "/".join(folder.resolve().parts[-2:])
        files = [
            f"{p.stamp_s:.6f} {p.rgb.name} {p.rgb.stat().st_size} {p.depth.stat().st_size}"
            for p in sequence.pairs
        ]
        return cls(name, sequence, truth, sha256("\n".join(files).encode()))


@dataclass(frozen=True, eq=False)
class Matrix:
    """The work of a run in `out`: segments of the bases, each perturbed as in the plan, and every
    method on each.

    methods: names in the registry; preset applies to our odometers. systems: systems of `iclnuim
    run`, `runs` times each. starts: use only this number of the plan's segments per sequence.
    """

    out: Path
    plan: Plan
    bases: Mapping[str, Base]
    methods: tuple[str, ...]
    systems: tuple[System, ...] = ()
    perturbations: tuple[str, ...] = ()
    severities: tuple[int, ...] = tuple(range(1, SEVERITIES + 1))
    starts: int | None = None
    preset: str = "best"
    runs: int = 5

    @property
    def names(self) -> list[str]:
        """Names of all methods in the results."""
        return [*self.methods, *map(label, self.systems)]

    def tasks(self) -> list[Task]:
        """All tasks. Unperturbed segments come first, as the others are compared with them."""
        segments = [
            (name, start)
            for name, base in self.bases.items()
            for start in self.plan.starts_of(name, len(base.sequence))[: self.starts]
        ]
        clean = [Task(name, start, CLEAN, 0) for name, start in segments]
        return clean + [
            Task(*s, p, k) for p in self.perturbations for k in self.severities for s in segments
        ]

    def missing(self) -> int:
        """Number of cells to compute; cells with other settings are computed again."""
        return sum(len(self._missing(task, self.names)) for task in self.tasks())

    def run(self, workers: int, progress: Callable[[int], object]) -> None:
        """Compute the missing cells; calls progress(n) after n cells."""
        make_folder(self.out, hint="another {out}")
        write_json(self.out / "recipe.json", self._recipe())
        todo = [task for task in self.tasks() if self._missing(task, self.methods)]
        perturbed = [task for task in todo if task.severity]
        for some in (
            [task for task in todo if not task.severity],
            perturbed,
        ):  # unperturbed first, for comparison
            if some:
                self._track_all(some, workers, progress)
        for task in self.tasks():
            missing = set(self._missing(task, map(label, self.systems)))
            if systems := [system for system in self.systems if label(system) in missing]:
                self._run_systems(task, systems, progress)

    def _track_all(
        self, tasks: list[Task], workers: int, progress: Callable[[int], object]
    ) -> None:
        _one_thread()
        with FramePool(lambda k: self._track(tasks[k]), min(workers, len(tasks)), progress) as pool:
            for k in range(len(tasks)):
                pool.add(k)

    def cells(self) -> dict[tuple[Task, str], dict[str, Any]]:
        """The figures of all existing cells with the tasks, methods and settings of this matrix."""
        pairs = [
            (task, name)
            for task in self.tasks()
            for name in self.names
            if self._is_done(task, name)
        ]
        return {(task, name): read_json(self._file(task, name))["cell"] for task, name in pairs}

    def segment(self, task: Task) -> Segment:
        """The frames of a task. Raises InputError if the sequence is too short."""
        base, plan = self.bases[task.sequence], self.plan
        segment = Segment.of(base.sequence, base.truth, task.start, plan.frames, plan.seed)
        return plan.apply(task.perturbation, task.severity, segment)

    def _track(self, task: Task) -> int:
        """Compute the missing methods of a task on one thread, in a process of the pool; returns
        their number.
        """
        missing = self._missing(task, self.methods)
        segment = self.segment(task)
        all_tracked = track_all(
            [odometer(name, self.preset if name in ODOMETERS else "best") for name in missing],
            segment,
        )
        for name, (tracked, references_s) in zip(missing, all_tracked, strict=True):
            clean = self._clean(task, name)
            extra = diagnostics(tracked, references_s, segment.truth, clean)
            bounds = self.plan.bounds
            poses = Poses.of(tracked, 0.0 if name in ODOMETERS else bounds.min_fitness)
            self._write(task, name, cell(poses, segment.truth, bounds, not task.severity, extra))
        return len(missing)

    def _run_systems(
        self, task: Task, systems: list[System], progress: Callable[[int], object]
    ) -> None:
        """Run external systems on the perturbed frames, which are written once, as a sequence."""
        # another command may run other systems at the same time
        work = self.out / "work" / "+".join(system.name for system in systems) / task.place
        segment = self.segment(task)
        write_sequence(_source(segment), work / "frames")
        staged = StagedSequence.of(work / "frames")
        truth = Trajectory(staged.stamps_s, sample(segment.truth, _stamps_s(segment)))
        for system in systems:
            self._write(task, label(system), self._run_system(task, system, staged, truth, work))
            progress(1)
        shutil.rmtree(work)

    def _run_system(
        self, task: Task, system: System, staged: StagedSequence, truth: Trajectory, work: Path
    ) -> Cell:
        """The cell of the run with the median ATE."""
        experiment = Experiment(system, staged, work)
        runs = self._runs(system)
        experiment.run(runs, 60.0 + len(staged.pairs))
        name = next(iter(system.trajectories)) if "live" not in system.trajectories else "live"
        found = []
        for number in range(1, runs + 1):
            file = experiment.folder / f"run_{number}" / "matched" / f"{name}.txt"
            found.append(
                cell(
                    Poses.of_file(_read(file), staged.stamps_s),
                    truth,
                    self.plan.bounds,
                    not task.severity,
                )
            )
        return _median_cell(found)

    def _runs(self, system: System) -> int:
        return 1 if system.settings.deterministic else self.runs

    def _missing(self, task: Task, names: Iterable[str]) -> list[str]:
        return [name for name in names if not self._is_done(task, name)]

    def _is_done(self, task: Task, name: str) -> bool:
        file = self._file(task, name)
        return is_file(file) and read_json(file).get("identity") == self._identity(task, name)

    def _clean(self, task: Task, name: str) -> Cell | None:
        file = self._file(Task(task.sequence, task.start, CLEAN, 0), name)
        return Cell(**read_json(file)["cell"]) if task.severity and is_file(file) else None

    def _write(self, task: Task, name: str, figures: Cell) -> None:
        file = self._file(task, name)
        make_folder(file.parent)
        write_json(file, {"identity": self._identity(task, name), "cell": figures.to_dict()})

    def _file(self, task: Task, name: str) -> Path:
        preset = f"_{self.preset}" if name in ODOMETERS and self.preset != "best" else ""
        return self.out / "cells" / task.place / f"{name.replace(':', '_')}{preset}.json"

    def _identity(self, task: Task, name: str) -> dict[str, Any]:
        """All settings that decide a cell."""
        plan, p = self.plan, self.plan.perturbations.get(task.perturbation)
        system = next((s for s in self.systems if label(s) == name), None)
        return {
            "schema_version": _SCHEMA_VERSION,
            **asdict(task),
            "level": p.levels[task.severity - 1] if p and task.severity else None,
            "fixed": dict(plan.fixed.get(task.perturbation, {})),
            "frames": plan.frames,
            "seed": plan.seed,
            "bounds": plan.bounds.to_dict(),
            "files_sha256": self.bases[task.sequence].files_sha256,
            "method": name,
            "preset": self.preset if name in ODOMETERS else None,
            "version": _version(name),
            "code": {
                "frames": code_version.perturbing(),
                "method": code_version.tracking() if name in ODOMETERS else None,
            },
            "options": {k: v for k, v in system.options.items() if k != "program"}
            if system
            else None,
            "runs": self._runs(system) if system else 1,
        }

    def _recipe(self) -> dict[str, Any]:
        return {
            "schema_version": _SCHEMA_VERSION,
            "perturbations": self.plan.text,
            "methods": self.names,
            "sequences": {name: str(base.sequence.folder) for name, base in self.bases.items()},
            "versions": {
                "iclnuim": __version__,
                **{name: one for name, one in versions(*_LIBRARIES).items() if one},
            },
            "source_commit": source_commit(),
            "machine": {"system": platform.platform(), "cores": os.cpu_count()},
        }


def label(system: System) -> str:
    """Name in cells of a system of `iclnuim run`; the prefix separates it from an odometer of ours,
    such as dvo.
    """
    return f"run:{system.name}"


def _version(name: str) -> str | None:
    """The version of the package that contains a method; None for a system of `iclnuim run`."""
    if name in ODOMETERS:
        return __version__
    if name not in BASELINES:
        return None
    return _installed(PACKAGES[BASELINES[name][2].partition(".")[0]])


@functools.cache
def _installed(package: str) -> str | None:
    """The installed version of a package, read once: every cell asks for it."""
    return versions(package)[package]


def _one_thread() -> None:
    """Limit OpenCV to one thread, as processes share the cores.

    Before they are forked: a fork would wait for threads that it does not have.
    """
    import cv2

    cv2.setNumThreads(1)


def _stamps_s(segment: Segment) -> np.ndarray:
    return np.array([segment.stamps_s[number] for number in segment.numbers])


def _source(segment: Segment) -> FrameSource:
    """The frames of a segment as a source for writing a sequence, with their numbers and stamps."""

    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        colour, depth_z_m = segment.load(number)
        return light_from_srgb8(colour), depth_z_m

    def truth_of(numbers: tuple[int, ...]) -> Trajectory:
        stamps_s = np.array([segment.stamps_s[number] for number in numbers])
        return Trajectory(stamps_s, sample(segment.truth, stamps_s))

    stamps_s = {number: segment.stamps_s[number] for number in segment.numbers}
    return FrameSource(
        segment.camera, segment.numbers, stamps_s, load, truth_of, {"frames": "perturbed"}
    )


def _read(file: Path) -> Trajectory:
    """Read a trajectory; it is empty if the system wrote no readable file."""
    try:
        return read_trajectory(file, "tum").trajectory
    except InputError:
        return Trajectory(np.zeros(0), SE3.identity((0,)))


def _median_cell(cells: list[Cell]) -> Cell:
    """The cell with the median ATE; a run without an ATE counts as the worst."""
    order = sorted(cells, key=lambda c: np.inf if c.ate_m is None else c.ate_m)
    return order[len(order) // 2]
