"""Inputs of the paper's cells: the sequences of `iclnuim make all`, sequences with other noise
seeds, the rooms' triangles, and the trajectories written by the systems of `iclnuim run`.
"""

import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from iclnuim import shipped
from iclnuim.errors import IclnuimError, InputError, WorkError
from iclnuim.formats.files import make_folder, read_json, sha256
from iclnuim.sensor.models import depth_model, rgb_model
from iclnuim.sequences.frame_source import image_frames
from iclnuim.sequences.recipe import rendered_job
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence

from ....systems.staging import StagedSequence
from ...inputs import input_sha256
from ..system.recipe import RunKey, system_store
from .keys import EXTERNAL, LAMBERTIAN, PaperKey

_ROOM = """
import sys, numpy as np
from iclnuim.formats.files import atomic_write
from iclnuim.blender.open.model_file import read_model
points, triangles = read_model(sys.argv[1])
atomic_write(sys.argv[2], lambda path: np.savez(path, points=points, triangles=triangles))
"""


@dataclass(frozen=True)
class Sources:
    """data: folder as written by `iclnuim make all`, with ROOM/TRAJECTORY/clean and noisy. out:
    folder of the benchmark. lambertian: folder as written by `iclnuim make all --lambertian`, if
    there is one.
    """

    data: Path
    out: Path
    lambertian: Path | None = None
    _hashes: dict[Path, str] = field(default_factory=dict, init=False, repr=False, compare=False)

    def folder(self, key: PaperKey) -> Path:
        """Folder of a cell's sequence: the existing one, or one with another noise seed, which
        exists only while its cells are measured.
        """
        return self.out / "noise" / key.sequence if key.seed else self._existing(key, key.noise)

    def _existing(self, key: PaperKey, noise: str) -> Path:
        """Folder of the user's sequence in the cell's room and trajectory with this noise."""
        if noise == LAMBERTIAN and self.lambertian:
            return self.lambertian / key.room / key.trajectory / "clean"
        return self.data / key.room / key.trajectory / noise

    def _source(self, key: PaperKey) -> Path:
        """The existing sequence from which the cell's sequence comes."""
        return self._existing(key, "clean" if key.seed else key.noise)

    @property
    def work(self) -> Path:
        """Folder of data shared by cells while they are measured."""
        return self.out / "work"

    def measurable(
        self, keys: Sequence[PaperKey], first: int | None, note: Callable[[str], object]
    ) -> list[PaperKey]:
        """Those whose sequences are there; a note names each other one.

        Raises InputError if there are none.
        """
        faults = {}
        for key in keys:
            if key.sequence not in faults:
                faults[key.sequence] = self.fault(key, first)
        for fault in sorted(set(filter(None, faults.values()))):
            note(f"left out: {fault}")
        found = [key for key in keys if not faults[key.sequence]]
        if not found:
            hint = "iclnuim make all, or another {data}"
            raise InputError("sequences to measure on", path=self.data, found="none", hint=hint)
        return found

    def fault(self, key: PaperKey, first: int | None) -> str:
        """Why the cell cannot be measured; empty if it can.

        Sequences with other noise seeds are made from the clean sequence.
        """
        noises = {key.noise, "clean"} if key.seed else {key.noise}
        return next(filter(None, (self._fault(key, noise, first) for noise in noises)), "")

    def _fault(self, key: PaperKey, noise: str, first: int | None) -> str:
        folder = self._existing(key, noise)
        lambertian = noise == LAMBERTIAN
        if not folder.is_dir():
            more = f" --lambertian -o {folder.parent}" if lambertian else ", or iclnuim make all"
            command = f"iclnuim make {key.room}/{key.trajectory}{more}"
            return f"{folder} does not exist; try: {command}"
        sequence = StoredSequence(folder)
        try:
            count = len(sequence.pairs)
        except InputError as error:
            return error.worded()
        if lambertian and not rendered_job(folder).get("lambertian"):
            how = "try: iclnuim make --lambertian"
            return f"{folder} was not rendered without reflections; {how}"
        if sequence.truth is None:
            return f"{folder} has no ground truth"
        if first and count < first:
            return f"{folder} has {count} frames, expected at least {first}"
        return ""

    def frames(self, key: PaperKey, first: int | None) -> int:
        """Number of frames on which the cell is measured."""
        count = len(StoredSequence(self._source(key)).pairs)
        return min(count, first or count)

    def identity(self, key: PaperKey) -> dict[str, Any]:
        """What identifies the cell's images, camera and ground truth."""
        noise = self._noise(key).to_dict() if key.seed else None
        folder = self._source(key)
        if folder not in self._hashes:
            self._hashes[folder] = input_sha256(folder)
        return {"sha256": self._hashes[folder], "noise": noise}

    def _noise(self, key: PaperKey) -> SequenceSettings:
        """The noise settings of the existing noisy sequence, with the cell's seed.

        Raises InputError if its recipe does not contain them.
        """
        path = self._existing(key, "noisy") / "recipe.json"
        recipe = read_json(path)
        models: list[Any] = []
        for kind, make in (("depth_noise", depth_model), ("rgb_noise", rgb_model)):
            settings = dict(recipe.get(kind) or {})
            name = settings.pop("model", None)
            if name is None:
                raise InputError(f"the recipe of a noisy sequence with {kind}", path=path)
            models.append(make(name, settings))
        return SequenceSettings(models[0], models[1], key.seed, recipe["depth_units_per_metre"])

    def make_noise(self, key: PaperKey, first: int | None, on_frame: Callable[[int], None]) -> None:
        """Write the cell's sequence with another noise seed; an incomplete one is resumed."""
        source = image_frames(self._existing(key, "clean"), f":{first or ''}")
        write_sequence(source, self.folder(key), self._noise(key), on_frame=on_frame)

    def remove_noise(self, key: PaperKey) -> None:
        """Remove a sequence with another noise seed, once all its cells are measured."""
        shutil.rmtree(self.folder(key), ignore_errors=True)

    def remove_work(self) -> None:
        """Remove what cells share, once all are measured; the lock file stays."""
        shutil.rmtree(self.work / "seen", ignore_errors=True)
        shutil.rmtree(self.out / "noise", ignore_errors=True)

    def model(self, room: str) -> Path:
        """File with the room's triangles, written by a separate process to save Blender's memory in
        this one. Raises WorkError if it fails.
        """
        blend = shipped.folder("blend") / f"{room}.blend"
        path = self.out / "models" / f"{room}_{sha256(blend.read_bytes())[:16]}.npz"
        if not path.is_file():
            make_folder(path.parent)
            command = [sys.executable, "-c", _ROOM, room, str(path)]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                last = (done.stderr or done.stdout).strip().splitlines()[-1:]
                raise WorkError(f"the triangles of {room} cannot be read: {' '.join(last)}")
        return path

    def model_name(self, key: PaperKey) -> str | None:
        """Name of the room in which the sequence was rendered; None for other sequences and those
        without reflections, whose surfaces are not measured.
        """
        if key.noise == LAMBERTIAN:
            return None
        try:
            scene = rendered_job(self._existing(key, key.noise)).get("scene")
        except IclnuimError:
            return None
        return key.room if scene == key.room else None


def external_keys(
    systems: Path, given: Sequence[PaperKey], sources: Sources, first: int | None
) -> dict[PaperKey, Path]:
    """Keys of the results of `iclnuim run` in `systems` that used exactly the images of our
    sequences -> the trajectory matched to the frames.
    """
    sequences = {key.sequence: key for key in given if not key.seed}
    staged = {}
    for name, key in sorted(sequences.items()):
        staged[name] = StagedSequence.of(sources.folder(key), frames=f":{first or ''}")
    found = {}
    for run in system_store(systems).read_all(RunKey):
        images = run.identity["sequence_sha256"]
        for name, sequence in staged.items():
            if sequence.name != run.key.sequence or sequence.images_sha256 != images:
                continue
            for path in sorted((run.folder / "matched").glob("*.txt")):
                if not path.name.startswith("whole_"):
                    words = {"odometer": run.figures["title"], "preset": path.stem}
                    where = replace(sequences[name], reference=EXTERNAL, run=run.key.run)
                    found[replace(where, **words)] = path
    return found
