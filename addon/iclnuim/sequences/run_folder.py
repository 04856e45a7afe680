"""The folder of a render run: its files, which frames are finished, and a check that frames of
different recipes are not mixed.

OUT/exr/000000.exr ...   R, G, B (scene-linear, half) and Z (float, planar metres, background 0);
                         with ground truth also
                         instance and normal.X, .Y, .Z (float, cv camera's frame; see channels.py),
                         and OUT/objects.json, and OUT/object_poses.csv if something moves
OUT/groundtruth.txt      TUM poses of every frame of the trajectory, our world
OUT/camera.json          the pinhole camera
OUT/sequence.json        the recipe: effective settings, seed, versions, source commit
OUT/frames.jsonl         the hash of each frame's file
OUT/preview.png          user-provided scenes: a small path-traced image of the first frame
OUT/first_look.json      the ways to light the run that were compared for the setting quality
"""

import functools
import json
import shutil
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from .. import shipped
from ..channels import BASE, INSTANCE, Channel, exr_bytes, exr_types, further_of
from ..errors import InputError, WorkError, within
from ..formats import exr
from ..formats.files import (
    atomic_write_text,
    csv_text,
    make_folder,
    read_bytes,
    read_json,
    sha256,
    write_json,
)
from ..formats.image_names import files_in
from ..geometry.camera import PinholeCamera
from ..geometry.trajectory import Trajectory
from ..job import RenderJob
from ..trajectory_files.trajectories import read_trajectory, write_trajectory
from . import frame_hashes
from .record import Record

OBJECTS = "objects.json"
#: The poses of moving objects in every frame, if something moves.
OBJECT_POSES = "object_poses.csv"


@dataclass(frozen=True)
class RunFolder:
    """A run on disk. `recipe` is the content of sequence.json."""

    path: Path
    recipe: dict

    @property
    def key(self) -> str:
        """Key of 16 hex digits of everything that determines the pixels; it is in each frame's
        header.
        """
        return run_key(self.recipe)

    @property
    def camera(self) -> PinholeCamera:
        """The camera of the job. Raises InputError."""
        with within(self.path / "sequence.json"):
            return PinholeCamera.from_dict(self.recipe["job"].get("camera"))

    @property
    def job(self) -> RenderJob:
        """The job. Raises InputError."""
        try:
            return RenderJob.from_dict(self.recipe["job"])
        except InputError as error:
            raise error.at(self.path / "sequence.json") from None

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels of a frame."""
        return (*BASE, *further_of(self.recipe["job"]))

    def truth(self) -> Trajectory:
        """Poses and stamps of all frames of the trajectory. Raises InputError."""
        return read_trajectory(self.path / "groundtruth.txt", "tum").trajectory

    def frame_file(self, number: int) -> Path:
        """The file of a frame: six digits, the number of its pose in the trajectory."""
        return self.path / "exr" / f"{number:06}.exr"

    def frame_numbers(self) -> list[int]:
        """The numbers of the existing frame files, in order."""
        names = (file.stem for file in (self.path / "exr").glob("[0-9]*.exr"))
        return sorted(int(name) for name in names if name.isdecimal())

    def is_finished(self, number: int, read_pixels: bool = True) -> bool:
        """Whether a frame's file can be read to the end, has the right size and channels, was made
        by this recipe, and is as it was written. Without read_pixels, only its header and its length
        are read.
        """
        return self._is_finished(number, frame_hashes.read_hashes(self.path), read_pixels)

    def _is_finished(
        self, number: int, hashes: Mapping[int, set[str]], read_pixels: bool = True
    ) -> bool:
        file = self.frame_file(number)
        if not file.is_file():
            return False
        try:
            header = exr.exr_header(file, whole=True)
            if header.parts[0].attributes.get("recipe") != self.key:
                return False
            if read_pixels and frame_hashes.is_changed(file, hashes.get(number)):
                return False
            is_known = number in hashes or not read_pixels
            there = header.channels.keys() if is_known else exr.read_exr(file).keys()
        except InputError:
            return False
        has_size = (header.width, header.height) == (self.camera.width, self.camera.height)
        return has_size and there >= exr_types(self.channels).keys()

    def missing(self, numbers: Iterable[int], read_pixels: bool = True) -> list[int]:
        """The frames of `numbers` that are not finished, in order; see is_finished."""
        numbers = list(numbers)
        hashes = frame_hashes.read_hashes(self.path) if read_pixels else {}
        is_finished = functools.partial(self._is_finished, hashes=hashes, read_pixels=read_pixels)
        with ThreadPoolExecutor(4) as pool:
            finished = list(pool.map(is_finished, numbers))
        return [number for number, done in zip(numbers, finished, strict=True) if not done]

    def check_space(self, frames: int) -> None:
        """Raises WorkError if the disk has no space for this number of frames."""
        need = frames * self.camera.width * self.camera.height * exr_bytes(self.channels)
        free = shutil.disk_usage(self.path).free
        if need > free:
            space = f"need up to {need / 1e9:.2f} GB, {free / 1e9:.2f} GB are free"
            hint = "fewer {frames} or another {out}"
            raise WorkError(f"{self.path}: {frames} frames {space}", hint=hint)

    def write_frame(
        self,
        number: int,
        rgb: np.ndarray,
        depth_z_m: np.ndarray,
        further: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Write (h, w, 3) scene-linear RGB and (h, w) planar metres, 0 where no surface is hit, and
        further channels unchanged, atomically.
        """
        half = np.clip(rgb, 0, 65504).astype(np.float16)
        channels = {name: half[..., i] for i, name in enumerate("RGB")}
        channels["Z"] = np.asarray(depth_z_m, np.float32)
        channels |= further or {}
        attributes = {"recipe": self.key}
        file = self.frame_file(number)
        exr.write_exr(file, channels, attributes=attributes, compressed=False)
        frame_hashes.note_frame(self.path, number, file)


class FurtherImages:
    """The images of a run's frames in addition to colour and depth.

    The table of objects is read at first use, so it may be written after this object is made.
    """

    def __init__(self, run: Path, channels: tuple[Channel, ...]) -> None:
        self.run = Path(run)
        self.channels = channels

    @property
    def has_objects(self) -> bool:
        """False until a worker of the run has prepared the scene."""
        return (self.run / OBJECTS).is_file()

    @cached_property
    def objects(self) -> dict:
        """The content of objects.json. Raises InputError if it is missing or has another format."""
        table = read_json(self.run / OBJECTS)
        if not all(isinstance(table.get(key), list) for key in ("objects", "classes")):
            raise InputError("the objects and classes of a scene", path=self.run / OBJECTS)
        return table

    @cached_property
    def _class_numbers(self) -> np.ndarray:
        """(65536,) class number by instance number."""
        found = np.zeros(1 << 16, np.uint16)
        for thing in self.objects["objects"]:
            found[thing["id"]] = thing["class_id"]
        return found

    def images(self, number: int) -> dict[str, np.ndarray]:
        """The images of a frame by name, as channels.py describes them.

        Raises InputError if a channel of its file is missing.
        """
        path = self.run / "exr" / f"{number:06}.exr"
        exr_channels = exr.read_exr(path)
        missing = [name for name in exr_types(self.channels) if name not in exr_channels]
        if missing:
            raise InputError(
                "a frame with ground truth", path=path, found=f"no {', '.join(missing)}"
            )
        return {c.name: c.read(exr_channels, lambda: self._class_numbers) for c in self.channels}

    def write_tables(self, folder: Path) -> None:
        """Write objects.json, object_poses.csv if something moves, and classes.csv: the names of
        the numbers in class/, and their NYU40 labels; nothing if the images have no instances.
        """
        if INSTANCE not in exr_types(self.channels):
            return
        write_json(folder / OBJECTS, self.objects)
        if (self.run / OBJECT_POSES).is_file():
            poses = read_bytes(self.run / OBJECT_POSES).decode()
            atomic_write_text(folder / OBJECT_POSES, poses)
        keys = ("id", "name", "nyu40_id", "nyu40")
        rows = [[kind[key] for key in keys] for kind in self.objects["classes"]]
        text = csv_text([("class_id", "class", "nyu40_id", "nyu40"), *rows])
        atomic_write_text(folder / "classes.csv", text)


def trajectory_file(job: RenderJob) -> Path:
    """The file of a job's poses, shipped or user-provided."""
    ours = job.trajectory in shipped.sequence_names()
    return shipped.trajectory_file(job.trajectory) if ours else Path(job.trajectory)


def load_trajectory(job: RenderJob) -> Trajectory:
    """The poses of a job, in our world."""
    return read_trajectory(trajectory_file(job)).trajectory


def open_run(path: Path, recipe: dict, trajectory: Trajectory) -> RunFolder:
    """Make the folder with ground truth, camera and recipe, or open the existing run.

    Raises InputError if the folder contains another recipe (the message lists the settings that
    differ) or other files, WorkError if it cannot be written.
    """
    path = Path(path)
    existing = path / "sequence.json"
    if existing.is_file():
        begun = read_json(existing)
        there = run_identity(begun)
        requested = run_identity(recipe)
        hint = "another {out}"
        if requested.get("mipmaps") and not there.get("mipmaps"):
            hint = "turning {mipmaps} off to go on as before, or another {out}"
        Record("run", existing, requested, _changed(begun, recipe), hint).refuse_other(there)
    elif path.is_dir() and any(path.iterdir()):
        # a run that was killed before its recipe was written leaves an empty exr/, camera.json,
        # groundtruth.txt and temporary files
        left = ("exr", "camera.json", "groundtruth.txt")
        others = [p for p in files_in(path) if p.name not in left]
        if others or files_in(path / "exr"):
            expected = "an empty folder or a run folder"
            raise InputError(expected, path=path, found="other files", hint="another {out}")
    elif path.exists() and not path.is_dir():
        raise InputError("a folder", path=path, found="a file", hint="another {out}")
    make_folder(path / "exr", hint="another {out}")
    run = RunFolder(path, recipe)
    if not existing.is_file():
        write_trajectory(path / "groundtruth.txt", trajectory, "tum")
        write_json(path / "camera.json", recipe["job"]["camera"])
        write_json(existing, recipe)
    return run


def read_run(path: Path) -> RunFolder:
    """The run in a folder. Raises InputError if there is none."""
    if not (Path(path) / "sequence.json").is_file():
        hint = "the folder that `iclnuim render` wrote, or raw/ of `make` with {keep_raw}"
        raise InputError("the folder of a run", path=path, found="no sequence.json", hint=hint)
    recipe = read_json(Path(path) / "sequence.json")
    if not isinstance(recipe.get("job"), dict):
        raise InputError("the recipe of a run, with its job", path=Path(path) / "sequence.json")
    return RunFolder(Path(path), recipe)


def _changed(begun: dict, requested: dict) -> dict[str, str]:
    """Descriptions for messages: of mipmaps, and of files whose name is the same in both recipes,
    for the case that their hash differs.
    """
    there = _job(begun)
    job = _job(requested)
    found = {"mipmaps": "frames without mipmaps"}
    if there.get("mipmaps"):
        found["mipmaps"] = "frames with mipmaps"
        if job.get("mipmaps"):
            found["mipmaps"] = "frames with mipmaps of an older version"
    if there.get("trajectory") == job.get("trajectory"):
        sentence = f"other poses or stamps of the trajectory {job.get('trajectory')}"
        found["trajectory_sha256"] = sentence
    if there.get("scene") == job.get("scene"):
        found["scene_sha256"] = f"another version of the scene {job.get('scene')}"
    return found


def _job(recipe: dict) -> dict:
    return recipe["job"] if isinstance(recipe.get("job"), dict) else {}


def run_identity(recipe: dict) -> dict:
    """The values that determine the pixels of a run. Scene and trajectory are represented by their
    hashes, not by name or path.

    `texture_filter` of the recipe is the version of mipmaps.
    """
    identity = dict(_job(recipe))
    for key in ("sequence", "scene", "trajectory"):
        identity.pop(key, None)
    if identity.pop("mipmaps", False):
        identity["mipmaps"] = recipe.get("texture_filter", True)
    for key in ("trajectory_sha256", "scene_sha256", "blender"):
        identity[key] = recipe.get(key)
    return identity


def run_key(recipe: dict) -> str:
    """Key of 16 hex digits of everything that determines the pixels of a run."""
    return sha256(json.dumps(run_identity(recipe), sort_keys=True).encode())[:16]
