"""The recipe of `iclnuim stress`: every method on segments of sequences whose frames are perturbed
with increasing severity.

OUT/cells/SEQUENCE/START/PERTURBATION_SEVERITY/METHOD   a cell; severity 0 is `clean`; with the
                                                        base noisy below SEQUENCE/START/noisy
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.benchmark.odometry.registry import BASELINES, ODOMETERS, odometer
from iclnuim.benchmark.odometry.run import run_odometers
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, sample
from iclnuim.sensor.transfer import linear_from_srgb8
from iclnuim.sequences.frame_source import FrameSource
from iclnuim.sequences.imu import SequenceImu
from iclnuim.sequences.writer import write_sequence
from iclnuim.trajectory_files.trajectories import read_trajectory

from ....perturbations.plan import CLEAN, FUNCTIONS, Plan, with_base_noise
from ....perturbations.segment import Segment
from ....systems.staging import StagedSequence
from ....systems.system import System
from ...cell import Cell
from ...code_version import Entry, code_of, method_code
from ...inputs import Input
from ...outcome import Outcome, Poses, diagnostics, outcome, track_all
from ...pool import Advance, Job, compile_first, one_thread, run_jobs
from ...store import Store
from ..system.recipe import SystemRuns, system_store

KIND = "stress"
#: What stands before the name of a system of `iclnuim run` in cells.
SYSTEM = "run:"
#: What selects frames, and computes the figures of a cell.
_FRAMES_CODE: tuple[Entry, ...] = (Plan, Poses, track_all, diagnostics, outcome)
#: Core-seconds to perturb a frame, and to track it with one method, in the mean of our odometers. A
#: segment of 120 frames with all five took 15 to 24 on free cores, and at severity 5, where many
#: frames are lost and tried again, 44 on busy ones.
_PERTURB_CORE_S = 0.08
_TRACK_CORE_S = 0.04


@dataclass(frozen=True, order=True)
class StressKey:
    """A method on a perturbed segment; severity 0 is unperturbed. preset: of our odometers, empty
    for `best` and for other methods. base: the frames that are perturbed, one of BASES.
    """

    sequence: str
    start: int
    perturbation: str
    severity: int
    method: str
    preset: str = ""
    base: str = CLEAN

    @property
    def words(self) -> tuple[str | int, ...]:
        """Its fields, without the base CLEAN."""
        found = (self.sequence, self.start, self.perturbation, self.severity, self.method)
        return (*found, self.preset, *([] if self.base == CLEAN else [self.base]))

    @property
    def segment(self) -> tuple[str, int, str, int]:
        return self.sequence, self.start, self.perturbation, self.severity

    @property
    def segment_place(self) -> str:
        name = f"{self.perturbation}_{self.severity}" if self.severity else CLEAN
        base = "" if self.base == CLEAN else f"/{self.base}"
        return f"{self.sequence.replace('/', '_')}/{self.start}{base}/{name}"

    @property
    def place(self) -> str:
        preset = f"_{self.preset}" if self.preset else ""
        return f"{self.segment_place}/{self.method.replace(':', '_')}{preset}"

    @property
    def unperturbed(self) -> "StressKey":
        """The same method on the same segment without perturbation."""
        return replace(self, perturbation=CLEAN, severity=0)


@dataclass(frozen=True, eq=False)
class Stress:
    """The experiment: every method on segments of the inputs, each perturbed as in the plan.

    methods: names in the registry; preset applies to our odometers. systems: systems of `iclnuim
    run`, `runs` times each. starts: use only this number of the plan's segments per sequence. base:
    the frames that are perturbed, one of BASES.
    """

    plan: Plan
    inputs: Mapping[str, Input]
    methods: tuple[str, ...]
    systems: tuple[System, ...]
    perturbations: tuple[str, ...]
    severities: tuple[int, ...]
    starts: int | None
    preset: str
    runs: int
    base: str = CLEAN

    @property
    def names(self) -> list[str]:
        """Names of all methods in the results."""
        return [*self.methods, *map(label, self.systems)]

    def cells(self) -> list[Cell]:
        """All cells, segment by segment. Unperturbed segments come first, as the others are
        compared with them.
        """
        return [self._cell(place, name) for place, name in product(self._places(), self.names)]

    def run(self, store: Store, workers: int, console: Console) -> None:
        """Measure the missing cells."""
        methods = {label(system): system for system in self.systems}
        about = {"perturbations": self.plan.text, "methods": self.names}
        folders = {name: str(one.sequence.folder) for name, one in self.inputs.items()}
        store.open({}, {**about, "sequences": folders})
        one_thread()
        missing = store.missing(self.cells())
        compile_first([Job("compile", self._try_methods, 1)], min(workers, len(missing)))
        advance = console.progress(len(missing), "stress", "cells").advance
        tracked = [cell for cell in missing if cell.key.method not in methods]
        for perturbed in (False, True):
            some = [cell for cell in tracked if bool(cell.key.severity) == perturbed]
            clean = self._clean_outcomes(store) if perturbed else {}
            run_jobs(list(self._jobs(some, store, clean)), workers, advance)
        for cells in by_segment([cell for cell in missing if cell.key.method in methods]):
            self._run_systems(cells, methods, store, advance)

    def _try_methods(self, advance: Advance) -> None:
        """Track three frames with every method."""
        for one in self.inputs.values():
            odometers = [odometer(name, self.preset) for name in self.methods if name in ODOMETERS]
            run_odometers(odometers, one.sequence, progress=False, frames=3)

    def segment(self, key: StressKey) -> Segment:
        """The perturbed frames of a cell. Raises InputError if the sequence is too short."""
        clean = self.clean_segment(key)
        return self.plan.apply(key.perturbation, key.severity, clean, key.base)

    def clean_segment(self, key: StressKey) -> Segment:
        """The frames of a cell as rendered."""
        one = self.inputs[key.sequence]
        return Segment.of(one.sequence, one.truth, key.start, self.plan.frames, self.plan.seed)

    def segment_keys(self) -> Iterator[StressKey]:
        """A key without a method of each segment, the unperturbed ones first."""
        for place in self._places():
            yield StressKey(*place, method="", base=self.base)

    def _places(self) -> Iterator[tuple[str, int, str, int]]:
        perturbed = [(CLEAN, 0), *product(self.perturbations, self.severities)]
        for perturbation, segment in product(perturbed, self._segments()):
            yield (*segment, *perturbation)

    def _segments(self) -> Iterator[tuple[str, int]]:
        for name, one in self.inputs.items():
            for start in self.plan.starts_of(name, len(one.sequence))[: self.starts]:
                yield name, start

    def _cell(self, place: tuple[str, int, str, int], method: str) -> Cell:
        preset = ""
        if method in ODOMETERS and self.preset != "best":
            preset = self.preset
        key = StressKey(*place, method=method, preset=preset, base=self.base)
        identity = self.frames_identity(key)
        identity["bounds"] = self.plan.bounds.to_dict()
        identity["method_code"] = method_code(method)
        for system in self.systems:
            if label(system) == method:
                identity["options"] = system.chosen_options
                identity["runs"] = self._runs(system)
        return Cell(key, identity)

    def frames_identity(self, key: StressKey) -> dict[str, Any]:
        """What decides the frames of a cell."""
        plan = self.plan
        identity = {
            "frames": plan.frames,
            "seed": plan.seed,
            "input": self.inputs[key.sequence].sha256,
            "frames_code": code_of(*_frames_code(key)),
        }
        if key.severity:
            identity["level"] = plan.perturbations[key.perturbation].levels[key.severity - 1]
            identity["fixed"] = dict(plan.fixed.get(key.perturbation, {}))
        return identity

    def _clean_outcomes(self, store: Store) -> dict[StressKey, Outcome]:
        cells = [cell for cell in self.cells() if not cell.key.severity]
        return {one.key: Outcome(**one.figures) for one in store.read(cells)}

    def _jobs(
        self, cells: Sequence[Cell], store: Store, clean: Mapping[StressKey, Outcome]
    ) -> Iterator[Job]:
        for some in by_segment(cells):

            def measure(advance: Advance, some: list[Cell] = some) -> None:
                self._track(some, store, clean)
                advance(len(some))

            yield Job(some[0].key.segment_place, measure, len(some))

    def _track(
        self, cells: Sequence[Cell], store: Store, clean: Mapping[StressKey, Outcome]
    ) -> None:
        """Measure the methods of a segment, each frame of which is loaded once."""
        segment = self.segment(cells[0].key)
        bounds = self.plan.bounds
        odometers = [odometer(cell.key.method, cell.key.preset or "best") for cell in cells]
        for cell, (tracked, references_s) in zip(cells, track_all(odometers, segment), strict=True):
            unperturbed = clean.get(cell.key.unperturbed)
            extra = diagnostics(tracked, references_s, segment.truth, unperturbed)
            min_fitness = bounds.min_fitness if cell.key.method in BASELINES else 0.0
            poses = Poses.of(tracked, min_fitness)
            found = outcome(poses, segment.truth, bounds, not cell.key.severity, extra)
            store.write(cell, asdict(found))

    def _run_systems(
        self,
        cells: Sequence[Cell],
        systems: Mapping[str, System],
        store: Store,
        advance: Advance,
    ) -> None:
        """Run external systems on the perturbed frames, which are written once, as a sequence."""
        # another command may run other systems at the same time
        names = "+".join(systems[cell.key.method].name for cell in cells)
        work = store.out / "work" / names / cells[0].key.segment_place
        segment = self.segment(cells[0].key)
        write_segment(segment, work / "frames")
        staged = StagedSequence.of(work / "frames")
        truth = staged_truth(staged, segment)
        for cell in cells:
            experiment = SystemRuns(systems[cell.key.method], staged, system_store(work))
            found = self._system_outcome(experiment, truth, not cell.key.severity)
            store.write(cell, asdict(found))
            advance(1)
        shutil.rmtree(work)

    def _system_outcome(self, experiment: SystemRuns, truth: Trajectory, clean: bool) -> Outcome:
        """The outcome of the run with the median ATE; a run without an ATE counts as the worst."""
        system = experiment.system
        runs = self._runs(system)
        stamps_s = experiment.sequence.stamps_s
        experiment.run(runs, 60.0 + len(stamps_s))
        name = "live" if "live" in system.trajectories else next(iter(system.trajectories))
        found = []
        for cell in experiment.cells(runs):
            file = experiment.store.folder(cell.key) / "matched" / f"{name}.txt"
            poses = Poses.of_file(_read(file), stamps_s)
            found.append(outcome(poses, truth, self.plan.bounds, clean))
        found.sort(key=lambda one: (one.ate_m is None, one.ate_m or 0.0))
        return found[len(found) // 2]

    def _runs(self, system: System) -> int:
        return 1 if system.settings.deterministic else self.runs


def work_s(frames: int, segments: int, cells: int) -> float:
    """Expected core-seconds of cells on segments of so many frames; the methods of a segment share
    its perturbed frames.
    """
    return frames * (segments * _PERTURB_CORE_S + cells * _TRACK_CORE_S)


def _frames_code(key: StressKey) -> list[Entry]:
    """What decides the frames and figures of a cell."""
    code = [*_FRAMES_CODE]
    if key.base != CLEAN:
        code += [with_base_noise, FUNCTIONS["noise"].function]
    if key.perturbation in FUNCTIONS:
        code.append(FUNCTIONS[key.perturbation].function)
    return code


def label(system: System) -> str:
    """Name in cells of a system of `iclnuim run`."""
    return system_name(system.name)


def system_name(name: str) -> str:
    return f"{SYSTEM}{name}"


def write_segment(segment: Segment, folder: Path, imu: SequenceImu | None = None) -> None:
    """Write the frames of a segment as the sequence that a system reads, or resume it. imu: the
    readings of an IMU that moved with its frames.
    """
    write_sequence(replace(_source(segment), imu=lambda: imu), folder)


def staged_truth(staged: StagedSequence, segment: Segment) -> Trajectory:
    """The true poses of a segment's frames, with the stamps of its sequence."""
    stamps_s = np.array([segment.stamps_s[number] for number in segment.numbers])
    return Trajectory(staged.stamps_s, sample(segment.truth, stamps_s))


def by_segment(cells: Sequence[Cell]) -> list[list[Cell]]:
    """The cells of each segment, which are measured together."""
    found: dict[tuple[str, int, str, int], list[Cell]] = {}
    for cell in cells:
        found.setdefault(cell.key.segment, []).append(cell)
    return list(found.values())


def _source(segment: Segment) -> FrameSource:
    """The frames of a segment as a source for writing a sequence, with their numbers and stamps."""

    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        colour, depth_z_m = segment.load(number)
        return linear_from_srgb8(colour), depth_z_m

    def truth_of(numbers: tuple[int, ...]) -> Trajectory:
        stamps_s = np.array([segment.stamps_s[number] for number in numbers])
        return Trajectory(stamps_s, sample(segment.truth, stamps_s))

    stamps_s = {number: segment.stamps_s[number] for number in segment.numbers}
    about = {"frames": "perturbed"}
    return FrameSource(segment.camera, segment.numbers, stamps_s, load, truth_of, about)


def _read(file: Path) -> Trajectory:
    """Read a trajectory; it is empty if the system wrote no readable file."""
    try:
        return read_trajectory(file, "tum").trajectory
    except InputError:
        return Trajectory(np.zeros(0), SE3.identity((0,)))
