"""From the frames of a render run to a TUM sequence, clean or noisy; resumable, the same bytes in any order.

    OUT/rgb/000000.png    8 bit                 OUT/rgb.txt, depth.txt      stamp path
    OUT/depth/000000.png  16 bit, 5000 a metre  OUT/associations.txt        stamp rgb/... stamp depth/...
    OUT/camera.json       pinhole camera        OUT/groundtruth.txt         a pose for every image
    OUT/recipe.json       noise, seed, versions, and the recipe of the run the frames come from
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..errors import InputError, WorkError
from ..formats import exr, png
from ..formats.associations import Associations, ImageList, write_associations, write_image_list
from ..formats.files import read_json, write_json
from ..formats.trajectories import read_trajectory, write_trajectory
from ..geometry.trajectory import Trajectory
from ..sensor.models import depth_model, rgb_model
from ..sensor.randomness import DEPTH, RGB, frame_generator
from .depth_units import depth16_from_metres
from .run_folder import RunFolder

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class SensorSettings:
    """Noise by name (sensor/models.py) with its parameters, and the seed; a frame's noise depends on (seed, frame, stream) alone."""

    depth_noise: str = "none"
    rgb_noise: str = "none"
    depth_settings: dict[str, Any] = field(default_factory=dict)
    rgb_settings: dict[str, Any] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise InputError("a seed as a whole number from 0 up", found=self.seed)

    def to_dict(self) -> dict[str, Any]:
        """Effective parameters, every field of both models."""
        depth, rgb = depth_model(self.depth_noise, self.depth_settings), rgb_model(self.rgb_noise, self.rgb_settings)
        return {
            "depth_noise": {"model": self.depth_noise, **depth.to_dict()},
            "rgb_noise": {"model": self.rgb_noise, **rgb.to_dict()},
            "seed": self.seed,
        }


@dataclass(frozen=True)
class Sequence:
    """A TUM sequence on disk."""

    path: Path

    def rgb_file(self, number: int) -> Path:
        return self.path / "rgb" / f"{number:06}.png"

    def depth_file(self, number: int) -> Path:
        return self.path / "depth" / f"{number:06}.png"

    def finished(self, numbers: Iterable[int], size: tuple[int, int]) -> list[int]:
        """Those whose two images can be read to the end and have (height, width) `size`."""
        numbers = list(numbers)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            good = list(pool.map(lambda number: self._is_whole(number, size), numbers))
        return [number for number, fine in zip(numbers, good, strict=True) if fine]

    def frame_numbers(self) -> list[int]:
        """Numbers of the frames with both images, in order."""
        both = [{p.stem for p in (self.path / kind).glob("[0-9]*.png")} for kind in ("rgb", "depth")]
        return sorted(int(stem) for stem in both[0] & both[1] if stem.isdigit())

    def _is_whole(self, number: int, size: tuple[int, int]) -> bool:
        if not (self.rgb_file(number).is_file() and self.depth_file(number).is_file()):
            return False
        try:
            return png.read_rgb8(self.rgb_file(number)).shape[:2] == size == png.read_depth16(self.depth_file(number)).shape
        except InputError:
            return False


def open_sequence(out: Path, run: RunFolder, settings: SensorSettings) -> Sequence:
    """Make the folder with its recipe, or take up what was begun there with the same one.

    Raises InputError where it holds another recipe or other files, WorkError where it cannot be written.
    """
    recipe = {"schema_version": SCHEMA_VERSION, "sensor": settings.to_dict(), "run": run.recipe, "iclnuim": __version__}
    file = out / "recipe.json"
    if file.is_file():
        _refuse_other_recipe(file, read_json(file), recipe)
    elif out.is_dir() and any(p.name not in ("rgb", "depth") and not p.name.startswith(".") for p in out.iterdir()):
        raise InputError("an empty folder, or one of a sequence", path=out, found="other files", hint="another folder")
    elif out.exists() and not out.is_dir():
        raise InputError("a folder", path=out, found="a file", hint="another folder")
    try:
        for kind in ("rgb", "depth"):
            (out / kind).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WorkError(f"{out}: cannot make the folder: {error.strerror or error}") from None
    if not file.is_file():
        write_json(file, recipe)
    return Sequence(out)


def write_frames(run: RunFolder, sequence: Sequence, settings: SensorSettings, numbers: Iterable[int], done: Callable[[int], None]) -> int:
    """Write both images of frames that the run holds; `done(number)` after each. Returns how many depths did not fit in 16 bits."""
    depth_noise = depth_model(settings.depth_noise, settings.depth_settings)
    rgb_noise = rgb_model(settings.rgb_noise, settings.rgb_settings)

    def write(number: int) -> int:
        channels = exr.read_exr(run.frame_file(number))
        depth_z_m = depth_noise.apply(channels["Z"], run.camera, frame_generator(settings.seed, number, DEPTH))
        light = np.stack([channels[c] for c in "RGB"], -1)
        depth16, lost = depth16_from_metres(depth_z_m)
        png.write_png(sequence.depth_file(number), depth16)
        png.write_png(sequence.rgb_file(number), rgb_noise.apply(light, frame_generator(settings.seed, number, RGB)))
        done(number)
        return lost

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return sum(pool.map(write, list(numbers)))


def write_lists(run: RunFolder, sequence: Sequence) -> None:
    """rgb.txt, depth.txt, associations.txt, groundtruth.txt and camera.json for the images that are there."""
    numbers = sequence.frame_numbers()
    trajectory = read_trajectory(run.path / "groundtruth.txt", "tum").trajectory
    if not numbers or numbers[-1] >= len(trajectory):
        raise InputError(f"images of the {len(trajectory)} frames of the run", path=sequence.path, found=f"{len(numbers)} images")
    kept: Trajectory = trajectory[np.array(numbers)]
    stamps = tuple(kept.stamps_s.tolist())
    images = {kind: ImageList(stamps, tuple(f"{kind}/{number:06}.png" for number in numbers)) for kind in ("rgb", "depth")}
    for kind, listed in images.items():
        write_image_list(sequence.path / f"{kind}.txt", listed)
    write_associations(sequence.path / "associations.txt", Associations(images["rgb"], images["depth"]))
    write_trajectory(sequence.path / "groundtruth.txt", kept, "tum")
    write_json(sequence.path / "camera.json", {**run.recipe["job"]["camera"], "depth_units_per_metre": 5000})


def _refuse_other_recipe(file: Path, old: dict, new: dict) -> None:
    """The run's own recipe counts by what decides its pixels; versions and machine may differ."""
    a, b = _identity(old), _identity(new)
    different = [f"{key} {a.get(key)} there, {b.get(key)} asked" for key in sorted({*a, *b}) if a.get(key) != b.get(key)]
    if different:
        raise InputError("the sequence that was begun there", path=file, found="; ".join(different), hint="another folder")


def _identity(recipe: dict) -> dict:
    run, sensor = recipe.get("run"), recipe.get("sensor")
    if not isinstance(run, dict) or not isinstance(sensor, dict) or not isinstance(run.get("job"), dict):
        return {}
    return {**sensor, "frames": RunFolder(Path(), run).key}
