"""The experiment `sensors`: odometers on one path, as each model of a depth camera sees it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from iclnuim.benchmark.odometry.registry import ODOMETERS, names, odometer
from iclnuim.benchmark.odometry.run import Sequence as FrameSequence
from iclnuim.benchmark.odometry.run import run_odometers
from iclnuim.formats.depth_units import UNITS_PER_METRE, depth16_from_metres, metres_from_depth16
from iclnuim.sensor.models import DEPTH_MODELS, depth_model, rgb_model, with_depth_noise
from iclnuim.sensor.noise_model import DEPTH, RGB, frame_generator
from iclnuim.sensor.transfer import linear_from_srgb8
from iclnuim.sequences.frames import ImagePair
from iclnuim.settings import parameter

from ...cell import Measured
from ...experiment import Experiment
from ...inputs import Input
from ...table import ResultTable, mm

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class SeenBySensor(FrameSequence):
    """A clean sequence with the noise of a depth model, and that of an RGB model where depth has
    noise; stored as TUM stores it.
    """

    def __init__(self, clean: FrameSequence, sensor: str, rgb_noise: str, seed: int) -> None:
        self._depth_model = depth_model(sensor)
        self._rgb_model = rgb_model("none" if sensor == "none" else rgb_noise)
        self._seed = seed
        super().__init__(clean.stored)
        self.pairs = clean.pairs

    def images(self, pair: ImagePair) -> tuple[np.ndarray, np.ndarray]:
        rgb, depth_z_m = super().images(pair)
        light = linear_from_srgb8(rgb)
        depth_rng, rgb_rng = (
            frame_generator(self._seed, pair.number, stream) for stream in (DEPTH, RGB)
        )
        camera = self.camera.pinhole
        noisy_m = with_depth_noise(self._depth_model, depth_z_m, camera, depth_rng, light)
        stored_m = metres_from_depth16(depth16_from_metres(noisy_m), UNITS_PER_METRE)
        return self._rgb_model.apply(light, rgb_rng), stored_m


@dataclass(frozen=True)
class Sensors(Experiment):
    """Which depth camera suits which method: one path as each model of a sensor sees it.

    Give it clean sequences. A cell is a sensor; all methods see the same frames of it.
    """

    methods: tuple[str, ...] = parameter(
        tuple(ODOMETERS),
        "odometers",
        choices={name: "" for name in names()},
        parse=lambda text: tuple(text.split(",")),
        source="own choice",
    )
    rgb_noise: str = parameter("released", "noise of the colour images", source="own choice")
    seed: int = parameter(0, "seed of the noise", low=0, source="own choice")

    def variants(self) -> Sequence[str]:
        return tuple(DEPTH_MODELS)

    def measure(self, variant: str, one: Input) -> dict[str, Any]:
        """Of each method the ATE in metres and the share of frames that it tracked, and the share
        of pixels without depth.
        """
        seen = SeenBySensor(one.sequence, variant, self.rgb_noise, self.seed)
        runs = run_odometers([odometer(name) for name in self.methods], seen)
        shown = seen.pairs[:: max(1, len(seen.pairs) // 20)]
        missing = [np.mean(seen.images(pair)[1] == 0) for pair in shown]
        found = [run.to_dict() for run in runs]
        return {
            "missing_share": float(np.mean(missing)),
            "ate_m": {run["odometer"]: run["ate_rmse_m"] for run in found},
            "coverage": {run["odometer"]: run["coverage"] for run in found},
        }

    def tables(self, results: Sequence[Measured]) -> list[ResultTable]:
        return [self._table(sequence, rows) for sequence, rows in _by_sequence(results).items()]

    def _table(self, sequence: str, rows: Sequence[Measured]) -> ResultTable:
        """A row a sensor, the smallest ATE of each in bold."""
        texts, best = [], set()
        for i, one in enumerate(rows):
            ate_m = [one.figures["ate_m"].get(name) for name in self.methods]
            known = [value for value in ate_m if value is not None]
            if known:
                best.add((i, 2 + ate_m.index(min(known))))
            missing = f"{100 * one.figures['missing_share']:.1f}"
            texts.append((one.key.variant, missing, *map(mm, ate_m)))
        title = f"ATE in mm on {sequence}, by sensor."
        columns = ("sensor", "missing pixels [%]", *self.methods)
        name = f"sensors_{sequence.replace('/', '_')}"
        return ResultTable(name, title, columns, tuple(texts), frozenset(best))

    def chart(self, results: Sequence[Measured]) -> "Figure":
        """ATE by sensor, a mark for each method, a panel for each sequence."""
        from matplotlib.figure import Figure

        panels = _by_sequence(results)
        drawing = Figure(figsize=(9, 3.4 * len(panels)), layout="constrained")
        for axes, (sequence, rows) in zip(
            drawing.subplots(len(panels), squeeze=False).flat, panels.items(), strict=True
        ):
            sensors = [one.key.variant for one in rows]
            for k, name in enumerate(self.methods):
                ate_mm = [1e3 * (one.figures["ate_m"].get(name) or np.nan) for one in rows]
                place = np.arange(len(rows)) + 0.12 * (k - (len(self.methods) - 1) / 2)
                axes.plot(place, ate_mm, "os^Dv<>P*"[k % 9], label=name)
            axes.set_yscale("log")
            axes.set_xticks(range(len(sensors)), labels=sensors)
            axes.set_ylabel("ATE [mm], less is better")
            axes.set_title(sequence)
            axes.grid(axis="y", alpha=0.3)
            axes.legend(ncols=3, fontsize=8)
        return drawing


def _by_sequence(results: Sequence[Measured]) -> dict[str, list[Measured]]:
    found: dict[str, list[Measured]] = {}
    for one in results:
        found.setdefault(one.key.sequence, []).append(one)
    return found
