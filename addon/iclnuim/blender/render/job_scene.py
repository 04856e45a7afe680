"""The scene of a render job in Blender's session: opened, previewed, baked, built for frames."""

import math
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ... import shipped
from ... import worker_events as events
from ...channels import INSTANCE, exr_types
from ...errors import InputError
from ...geometry.continuous import keys_between
from ...geometry.se3 import SE3
from ...geometry.trajectory import Trajectory, frame_rate_hz
from ...job import RenderJob
from ...native_output import native_output_in
from .. import compat, surfaces
from ..light import light_map, mipmaps
from ..light.mipmaps import FilteredTextures
from ..open import light_choice, preflight, scene
from ..open.run_frames import RunFrames
from ..open.simulated import is_simulated
from . import camera, first_look, ground_truth, passes, settings


@dataclass(frozen=True, eq=False)
class BuiltScene:
    """A scene that is built for frames. has_volumes: also volumes that Geometry Nodes make."""

    has_volumes: bool
    textures: FilteredTextures


class JobScene:
    """The scene of a job, for the frames of a run. A step that changes what is open in Blender
    says so, and the next one opens the scene again.

    job: with light "auto" until it is chosen. can_bake: whether a chosen light may be baked.
    threads: of Cycles; default: all cores of this process.
    """

    def __init__(
        self,
        job: RenderJob,
        emit: Callable[[events.Event], None],
        threads: int | None = None,
        frames: RunFrames | None = None,
    ) -> None:
        self.job = job
        self.can_bake = True
        self.frames = frames
        self._emit = emit
        self._threads = threads
        self._is_open = False
        self._opening_core_s = 0.0

    def open_early(self) -> None:
        """Open the scene before its run, with path tracing if it cannot have baked light: its
        textures are part of the recipe, and moving objects affect the choice of light.
        """
        begun = time.process_time()
        with _silence():
            notes = scene.open_scene(self.job.scene, self.job.reading, self.frames)
            possible, more = light_choice.with_possible_light(self.job)
        self.can_bake = not more
        if self.job.light != "auto":
            self.job = possible
        self._opening_core_s = time.process_time() - begun
        self._is_open = True
        self._note_all([*notes, *more])

    def look(self, trajectory: Trajectory, requested: Sequence[int]) -> first_look.Look:
        """The ways to light the requested frames if the light is not chosen, else only a preview of
        the first one. The scene is changed.
        """
        self._is_open = False
        with _silence(errors=True):
            if self.job.light != "auto":
                return first_look.preview(self.job, trajectory, requested[0], self._threads)
            opened = self.can_bake, self._opening_core_s
            return first_look.look(self.job, trajectory, requested, self._threads, *opened)

    def measured_db(self, look: first_look.Look, trajectory: Trajectory) -> float:
        """The PSNR of the scene lit by its map against the views of a look. The scene is changed."""
        with _silence(errors=True):
            self._set_up()
            self._light_up(light_map.prepare(self.job, self._note)[0])
            camera.keyframe(trajectory.T_world_camera, self.job.camera)
            return first_look.measured_db(look)

    def bake(self) -> tuple[Path, bool]:
        """Find or bake the light map. Returns its folder and whether it was baked: then the scene
        is changed, and preferably built in a new process, which needs less memory.

        Raises InputError for a scene whose light cannot be baked.
        """
        with (
            tempfile.TemporaryDirectory() as folder,
            native_output_in(Path(folder) / "blender.log"),
        ):
            self._set_up(must_bake=True)
            map_folder, made = light_map.prepare(self.job, self._note)
        self._is_open = not made
        return map_folder, made

    def extend(self, last: int) -> bool:
        """Whether the run reaches beyond its last frame, where simulations end; then the scene is
        opened again, for a run that ends at frame `last`.
        """
        if self.frames is None or last <= self.frames.last:
            return False
        self.frames = replace(self.frames, last=last)
        self._is_open = False
        return True

    def build(self, trajectory: Trajectory, run: Path) -> BuiltScene:
        """Light the scene, keyframe the camera, and set all settings. Tables of the objects are
        written into the folder `run` if the job has instances.
        """
        job = self.job
        self._set_up()
        if INSTANCE in exr_types(job.further):
            ground_truth.write_objects(run, self._stamps_of_objects_s(trajectory))
        map_folder = light_map.prepare(job, self._note)[0] if job.light == "baked" else None
        # after the light map is found: it is that of the original textures
        filtered = FilteredTextures([], [], [])
        if job.mipmaps:
            cache = shipped.cache_folder()
            filtered = mipmaps.filter_textures(job.camera, cache / "mipmaps")
            self._note_all(filtered.notes)
        if map_folder is not None:
            self._light_up(map_folder)
        passes.add(job.further)
        frames, poses = _camera_keys(job, trajectory)
        camera.keyframe(poses, job.camera, frames)
        bpy.context.scene.frame_end = len(trajectory) - 1
        # including volumes made by Geometry Nodes
        volumes = light_choice.volume_names(bpy.context.scene) or compat.volume_outputs()
        return BuiltScene(bool(volumes), filtered)

    def _set_up(self, must_bake: bool = False) -> None:
        """Open the scene unless it is open, note what is found in it, and set all settings. The
        scene is changed.
        """
        job = self.job
        if not self._is_open:
            self._note_all(scene.open_scene(job.scene, job.reading, self.frames))
        self._is_open = False
        baked = must_bake or job.light == "baked"
        if must_bake and (obstacle := light_choice.reason_against_baking(bpy.context.scene)):
            wanted = "a scene whose light can be baked"
            raise InputError(wanted, path=job.scene, found=obstacle, hint="{light} path")
        if not shipped.is_scene(job.scene):
            noisy = baked and job.samples == 1 and not job.denoise
            self._note_all(preflight.findings(baked, noisy))
            if baked:
                self._note_all(settings.not_in_a_map())
        if baked:
            surfaces.make_lamps_real()
        settings.apply(job, self._threads)

    def _light_up(self, map_folder: Path) -> None:
        """Show the scene lit by its light map."""
        here = bpy.context.scene
        # path tracing clamps indirect light in the same way; not for built-in rooms, so that their
        # frames do not change
        is_built_in = shipped.is_scene(self.job.scene)
        light_map.apply(map_folder, None if is_built_in else here.cycles.sample_clamp_indirect)
        settings.assign(here.cycles, light_map.BOUNCES)
        if here.world is not None:
            # only rays of reflections sample the sky, which is faster than importance sampling
            here.world.cycles.sampling_method = "NONE"

    def _stamps_of_objects_s(self, trajectory: Trajectory) -> np.ndarray:
        """The stamps of all frames; those up to the last rendered one if a simulation ends there."""
        if self.frames is None or not is_simulated(bpy.context.scene):
            return trajectory.stamps_s
        return trajectory.stamps_s[: self.frames.last + 1]

    def _note(self, text: str) -> None:
        self._emit(events.Note(text))

    def _note_all(self, texts: Iterable[str]) -> None:
        for text in texts:
            self._note(text)


def _camera_keys(job: RenderJob, trajectory: Trajectory) -> tuple[np.ndarray, SE3]:
    """Frames (n,) and poses (n,) of the camera's keys: those of the trajectory, and for a shutter on
    the path of an IMU, further ones between, and beyond both ends as long as a shutter is open.
    """
    if not job.imu or job.exposure.instant:
        return np.arange(len(trajectory)), trajectory.T_world_camera
    open_s = (job.exposure_s + job.readout_s) / 2
    beyond = math.ceil(open_s * frame_rate_hz(trajectory.stamps_s))
    return keys_between(job.imu.motion(trajectory), trajectory, beyond)


def _silence(errors: bool = False) -> AbstractContextManager[None]:
    """Before a run has its log, what Blender prints goes nowhere."""
    return native_output_in(Path(os.devnull), errors=errors)
