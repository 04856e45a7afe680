"""Inputs of the cells: the sequences of `iclnuim make all`, sequences with other noise seeds, the
rooms' triangles, and the trajectories
written by the systems of `iclnuim run`.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from iclnuim import shipped
from iclnuim.dataset.frames import find_pairs, find_truth, image_frames, read_truth, rendered_job
from iclnuim.dataset.sequence import write_sequence
from iclnuim.dataset.sequence_options import SequenceSettings
from iclnuim.errors import IclnuimError, InputError, WorkError
from iclnuim.formats.files import make_folder, read_bytes, read_json, sha256
from iclnuim.sensor.models import depth_model, rgb_model

from ..systems.staging import StagedSequence
from .cells import EXTERNAL, LAMBERTIAN, Cell
from .recipes.system import RunKey, system_store

_ROOM = """
import sys, numpy as np
from iclnuim.formats.files import atomic_write
from iclnuim.benchmark.fusion.surface_error import read_model
points, triangles = read_model(sys.argv[1])
atomic_write(sys.argv[2], lambda path: np.savez(path, points=points, triangles=triangles))
"""


@dataclass(frozen=True)
class Sources:
    """data: folder as written by `iclnuim make all`, with ROOM/TRAJECTORY/clean and noisy. out:
    folder of the benchmark. lambertian:
    folder as written by `iclnuim make all --lambertian`, if there is one.
    """

    data: Path
    out: Path
    lambertian: Path | None = None
    _identities: dict[Path, dict] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def folder(self, cell: Cell) -> Path:
        """Folder of the cell's sequence: the existing one, or one with another noise seed, which
        exists only while its cells are measured.
        """
        return self.out / "noise" / cell.sequence if cell.seed else self._existing(cell, cell.noise)

    def _existing(self, cell: Cell, noise: str) -> Path:
        """Folder of the user's sequence in the cell's room and trajectory with this noise."""
        if noise == LAMBERTIAN and self.lambertian:
            return self.lambertian / cell.room / cell.trajectory / "clean"
        return self.data / cell.room / cell.trajectory / noise

    @property
    def work(self) -> Path:
        """Folder of data shared by cells while they are measured."""
        return self.out / "work"

    def fault(self, cell: Cell, first: int | None) -> str:
        """Why the cell cannot be measured; empty if it can.

        Sequences with other noise seeds are made from the clean sequence.
        """
        for noise in {cell.noise, "clean"} if cell.seed else {cell.noise}:
            folder, lambertian = self._existing(cell, noise), noise == LAMBERTIAN
            if not folder.is_dir():
                option = (
                    f" --lambertian -o {folder.parent}" if lambertian else ", or iclnuim make all"
                )
                return f"{folder} does not exist; try: iclnuim make {cell.room}/{cell.trajectory}{option}"
            recipe = folder / "recipe.json"
            if recipe.is_file() and read_json(recipe).get("finished") is False:
                return f"{folder} is not finished; try: iclnuim resume {folder.parent}"
            try:
                count = len(find_pairs(folder))
            except InputError as error:
                return error.worded()
            if lambertian and not rendered_job(folder).get("lambertian"):
                return (
                    f"{folder} was not rendered without reflections; try: iclnuim make --lambertian"
                )
            if read_truth(folder) is None:
                return f"{folder} has no ground truth"
            if first and count < first:
                return f"{folder} has {count} frames, expected at least {first}"
        return ""

    def frames(self, cell: Cell, first: int | None) -> int:
        """Number of frames on which the cell is measured."""
        count = len(find_pairs(self._existing(cell, "clean" if cell.seed else cell.noise)))
        return min(count, first or count)

    def identity(self, cell: Cell) -> dict:
        """Hashes that identify the cell's images, camera and ground truth: for our sequences that
        of the journal, for others those of the images.
        """
        folder = self._existing(cell, "clean" if cell.seed else cell.noise)
        files = [folder / name for name in ("frames.jsonl", "groundtruth.txt", "camera.json")]
        if not all(path.is_file() for path in files):
            return self._foreign_identity(folder)
        hashes = {path.stem: sha256(path.read_bytes()) for path in files}
        return {**hashes, "noise": self._noise(cell).to_dict()} if cell.seed else hashes

    def _foreign_identity(self, folder: Path) -> dict:
        if folder not in self._identities:
            staged, truth = StagedSequence.of(folder), find_truth(folder)
            camera = {
                **staged.camera.pinhole.to_dict(),
                "depth_units_per_metre": staged.camera.depth_units_per_metre,
            }
            truth_sha256 = sha256(read_bytes(truth)) if truth else None
            self._identities[folder] = {
                "images": staged.images_sha256,
                "camera": camera,
                "groundtruth": truth_sha256,
            }
        return self._identities[folder]

    def _noise(self, cell: Cell) -> SequenceSettings:
        """The noise settings of the existing noisy sequence, with the cell's seed.

        Raises InputError if its recipe does not contain them.
        """
        path = self.data / cell.room / cell.trajectory / "noisy/recipe.json"
        recipe, models = read_json(path), []
        for kind, make in (("depth_noise", depth_model), ("rgb_noise", rgb_model)):
            settings = dict(recipe.get(kind) or {})
            name = settings.pop("model", None)
            if name is None:
                raise InputError(f"the recipe of a noisy sequence with {kind}", path=path)
            models.append(make(name, settings))
        return SequenceSettings(models[0], models[1], cell.seed, recipe["depth_units_per_metre"])

    def make_noise(self, cell: Cell, first: int | None, on_frame: Callable[[int], None]) -> None:
        """Write the cell's sequence with another noise seed; an incomplete one is resumed."""
        source = image_frames(self.data / cell.room / cell.trajectory / "clean", f":{first or ''}")
        write_sequence(source, self.folder(cell), self._noise(cell), on_frame=on_frame)

    def remove_noise(self, cell: Cell) -> None:
        """Remove a sequence with another noise seed, once all its cells are measured."""
        shutil.rmtree(self.folder(cell), ignore_errors=True)

    def remove_work(self) -> None:
        """Remove the shared data, once all cells are measured; the lock file stays."""
        shutil.rmtree(self.work / "seen", ignore_errors=True)

    def model(self, room: str) -> Path:
        """File with the room's triangles, written by a separate process to save Blender's memory in
        this one. Raises WorkError if it fails.
        """
        blend = shipped.folder("blend") / f"{room}.blend"
        path = self.out / "models" / f"{room}_{sha256(blend.read_bytes())[:16]}.npz"
        if not path.is_file():
            make_folder(path.parent)
            done = subprocess.run(
                [sys.executable, "-c", _ROOM, room, str(path)], capture_output=True, text=True
            )
            if done.returncode:
                last = (done.stderr or done.stdout).strip().splitlines()[-1:]
                raise WorkError(f"the triangles of {room} cannot be read: {' '.join(last)}")
        return path

    def model_name(self, cell: Cell) -> str | None:
        """Name of the room in which the sequence was rendered; None for other sequences and those
        without reflections, whose
        surfaces are not measured.
        """
        if cell.noise == LAMBERTIAN:
            return None
        folder = self._existing(cell, cell.noise)
        try:
            return cell.room if rendered_job(folder).get("scene") == cell.room else None
        except IclnuimError:
            return None


def external_cells(
    systems: Path, given: list[Cell], sources: Sources, first: int | None
) -> dict[Cell, Path]:
    """Cells of the results of `iclnuim run` below `systems` that used exactly the images of our
    sequences -> the trajectory matched to the frames.
    """
    sequences = {
        replace(cell, seed=0, odometer="", preset="", reference=EXTERNAL)
        for cell in given
        if not cell.seed
    }
    staged = {
        cell: StagedSequence.of(sources.folder(cell), first=first)
        for cell in sorted(sequences, key=lambda c: c.name)
    }
    found = {}
    for run in system_store(systems).read_all(RunKey):
        images = run.identity["sequence_sha256"]
        for cell, sequence in staged.items():
            if sequence.name == run.key.sequence and sequence.images_sha256 == images:
                for path in sorted((run.folder / "matched").glob("*.txt")):
                    if path.name.startswith("whole_"):
                        continue
                    title = run.figures["title"]
                    one = replace(cell, odometer=title, preset=path.stem, run=run.key.run)
                    found[one] = path
    return found


def environment() -> dict[str, str]:
    """Environment of a process that measures a cell: one thread, as there is one process per core."""
    names = (
        "NUMBA_NUM_THREADS",
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "IGL_NUM_THREADS",
    )
    return {**os.environ, **dict.fromkeys(names, "1")}


def task_text(content: dict) -> str:
    """The task as JSON, as read by measure.py."""
    return json.dumps(content, indent=1, sort_keys=True)
