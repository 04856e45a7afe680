"""The experiment `inertial`: ORB-SLAM3 with and without the IMU of a sequence whose images fail for
seconds.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from iclnuim.errors import InputError
from iclnuim.formats.files import sha256
from iclnuim.formats.imu_files import imu_text
from iclnuim.sensor.transfer import linear_from_srgb8
from iclnuim.sequences.frame_source import FrameSource, image_frames
from iclnuim.sequences.imu import SequenceImu
from iclnuim.sequences.writer import write_sequence
from iclnuim.settings import parameter

from ....perturbations.filters import black_frames, gaussian_blur, low_light
from ....perturbations.plan import Bounds
from ....perturbations.segment import Images, Segment
from ....systems.staging import StagedSequence
from ....systems.system import System, read_system
from ...cell import Cell, Measured
from ...experiment import Experiment
from ...inputs import Input
from ...intervals import share_interval
from ...table import ResultTable, mm
from ..system.recipe import SystemRuns, system_store

#: Name of a variant -> mode of ORB-SLAM3.
_MODES = {"rgbd": None, "rgbd-inertial": "rgbd-inertial"}
#: What becomes of an image that fails.
_KINDS = {
    "black": "no light and no depth",
    "frozen": "the last image that did not fail, and its depth",
    "blurred": "colour blurred",
    "dark": "less light, with its noise",
}


@dataclass(frozen=True)
class Inertial(Experiment):
    """Whether an IMU pays: ORB-SLAM3 with and without it, on images that fail for seconds.

    Give it noisy sequences with an IMU, and --workers 1: ORB-SLAM3 has threads of its own. A cell
    is a kind of failure and a mode, with all its runs.
    """

    vocabulary: str = parameter("", "ORBvoc.txt, as for `iclnuim run orbslam3`")
    program: str = parameter("python", "the Python that has pyorbslam3")
    runs: int = parameter(5, "runs of each cell, as ORB-SLAM3 is not deterministic", low=1)
    kinds: tuple[str, ...] = parameter(
        tuple(_KINDS),
        "what becomes of images that fail",
        choices=_KINDS,
        parse=lambda text: tuple(text.split(",")),
        source="own choice",
    )
    whole_s: float = parameter(
        15.0, "time at the start without failures", unit="s", low=0.0, source="own choice"
    )
    failing_s: float = parameter(
        2.0, "duration of a failure", unit="s", low=0.0, source="own choice"
    )
    every_s: float = parameter(
        10.0, "time between the starts of two failures", unit="s", low=0.1, source="own choice"
    )
    blur_px: float = parameter(
        6.0,
        "standard deviation of the blur",
        unit="px",
        low=0.1,
        source="severity 5 of `iclnuim stress`",
    )
    dark_stops: float = parameter(
        12.0, "how often the light is halved", low=0.0, source="severity 5 of `iclnuim stress`"
    )
    seed: int = parameter(1, "seed of the noise in the dark", low=0, source="own choice")

    def variants(self) -> Sequence[str]:
        return [f"{kind}/{mode}" for kind, mode in product(self.kinds, _MODES)]

    def cells(self, inputs: Sequence[Input]) -> list[Cell]:
        """The cells of the engine, which also depend on the readings and on the system's file.

        Raises InputError for a sequence without an IMU, and without a vocabulary.
        """
        readings = {one.name: _readings(one) for one in inputs}
        found = []
        for cell in super().cells(inputs):
            stream = readings[cell.key.sequence].stream
            _, mode = cell.key.variant.split("/")
            identity = {
                **cell.identity,
                "imu_sha256": sha256(imu_text(stream.stamps_ns, stream.readings).encode()),
                "system": dict(self._system(mode).content),
            }
            found.append(replace(cell, identity=identity))
        return found

    def measure(self, variant: str, one: Input) -> Mapping[str, Any]:
        """Of each run the ATE in metres, the share of frames with a pose and the time of all cores;
        None for a run without an ATE.
        """
        kind, mode = variant.split("/")
        with TemporaryDirectory() as text:
            folder = Path(text)
            write_sequence(self.frames(kind, one), folder / "frames")
            staged = StagedSequence.of(folder / "frames")
            system = SystemRuns(self._system(mode), staged, system_store(folder))
            final = system.run(self.runs, 60.0 + len(staged.pairs))[0]
        return {
            "ate_m": [run["ate_rmse_m"] for run in final["each"]],
            "coverage": [run["matched"] / final["frames"] for run in final["each"]],
            "initialised_s": [run["initialised_s"] for run in final["each"]],
            "cpu_s": [run["cpu_s"] for run in final["each"]],
        }

    def frames(self, kind: str, one: Input) -> FrameSource:
        """The frames and readings of the sequence, with images that fail."""
        segment = self.segment(kind, one)
        places = {pair.number: place for place, pair in enumerate(one.sequence.pairs)}

        def load(number: int) -> Images:
            colour, depth_z_m = segment.load(places[number])
            return linear_from_srgb8(colour), depth_z_m

        stored = image_frames(one.sequence.stored)
        return replace(stored, numbers=tuple(places), load=load)

    def segment(self, kind: str, one: Input) -> Segment:
        """The whole sequence with images that fail."""
        whole = Segment.of(one.sequence, one.truth, 0, len(one.sequence.pairs), self.seed)
        failed = self._failed(kind, whole)
        return replace(whole, load=lambda n: (failed if self.fails(whole, n) else whole.load)(n))

    def fails(self, segment: Segment, number: int) -> bool:
        """Whether the image of a frame fails, by its stamp."""
        since_s = segment.stamps_s[number] - segment.stamps_s[segment.numbers[0]] - self.whole_s
        return since_s > -1e-6 and (since_s + 1e-6) % self.every_s < self.failing_s

    def _failed(self, kind: str, whole: Segment) -> Callable[[int], Images]:
        """The images of frames that fail."""
        if kind == "frozen":
            return lambda number: whole.load(self._last_whole(whole, number))
        if kind == "black":
            return black_frames(whole, 100.0).load
        if kind == "blurred":
            return gaussian_blur(whole, self.blur_px).load
        return low_light(whole, self.dark_stops).load

    def _last_whole(self, segment: Segment, number: int) -> int:
        """The last frame before this one that does not fail; the first, if all do."""
        while number > segment.numbers[0] and self.fails(segment, number):
            number -= 1
        return number

    def _system(self, mode: str) -> System:
        given = {"vocabulary": self.vocabulary, "program": self.program}
        return read_system("orbslam3", given, _MODES[mode])

    def tables(self, results: Sequence[Measured]) -> list[ResultTable]:
        """Runs within the bound of `iclnuim stress`, by sequence and kind, without and with the IMU,
        and over all with intervals.
        """
        ratio = {name: [0, 0] for name in _MODES}
        by_row: dict[tuple[str, str], dict[str, str]] = {}
        for one in results:
            kind, mode = one.key.variant.split("/")
            good = sum(succeeded(one.figures))
            ratio[mode][0] += good
            ratio[mode][1] += len(one.figures["ate_m"])
            known = [1e9 if value is None else value for value in one.figures["ate_m"]]
            ate = "-" if median(known) >= 1e9 else mm(median(known))
            text = f"{good}/{len(known)}, {ate}"
            by_row.setdefault((one.key.sequence, kind), {})[mode] = text
        rows = [(*key, *(texts.get(mode, "") for mode in _MODES)) for key, texts in by_row.items()]
        rows.append(("all", "", *(_share(*ratio[mode]) for mode in _MODES)))
        bound = f"{mm(Bounds().success_m, '.0f')} mm"
        title = f"Runs with an ATE up to {bound} over half of the frames, and median ATE in mm."
        columns = ("sequence", "images", *_MODES)
        return [ResultTable("inertial", title, columns, tuple(rows))]


def _readings(one: Input) -> SequenceImu:
    """The readings of a sequence. Raises InputError without an IMU."""
    imu = one.sequence.stored.imu
    if imu is None:
        raise InputError("an IMU in the sequence", path=one.sequence.folder, found="none")
    return imu


def succeeded(figures: Mapping[str, Any]) -> Iterator[bool]:
    """Whether each run of a cell is within the bounds of `iclnuim stress`."""
    bounds = Bounds()
    for ate_m, coverage in zip(figures["ate_m"], figures["coverage"], strict=True):
        yield ate_m is not None and ate_m <= bounds.success_m and coverage >= bounds.min_coverage


def _share(good: int, runs: int) -> str:
    if not runs:
        return ""
    share, low, high = share_interval(good, runs)
    return f"{good}/{runs}: {share:.0%} [{low:.0%}, {high:.0%}]"
