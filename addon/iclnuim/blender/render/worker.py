"""The frame loop: renders any trajectory through any scene, one EXR per frame, and can be resumed
at any frame.

A `Session` is used by the command line, the farm and the panel. It reports events through `emit`,
see worker_events.py.
"""

import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ... import shipped
from ... import worker_events as events
from ...channels import INSTANCE, exr_types
from ...errors import InputError
from ...formats.files import (
    atomic_write_text,
    make_folder,
    process_is_running,
    read_bytes,
    sha256,
    write_json,
    writer_has_ended,
)
from ...geometry.trajectory import frame_slice
from ...job import RenderJob
from ...native_output import native_output_in
from ...sequences.ground_truth import OBJECT_POSES, OBJECTS
from ...sequences.run_folder import RunFolder, load_trajectory, open_run, read_run, trajectory_file
from ...version import __version__
from ...worker_events import Event
from .. import compat, surfaces
from ..light import light_map, mipmaps
from ..open import light_choice, preflight, scene
from ..open.run_frames import RunFrames
from ..open.simulated import is_simulated
from . import camera, first_look, frames, ground_truth, passes, settings
from .object_poses import covers, object_poses

Emit = Callable[[Event], None]


class Session:
    """Opens a run in `out` and renders any of its frames. The scene is built at the first frame and
    kept.

    `threads` for Cycles; default: all cores of this process. `requested`: the requested frames: for
    a user-provided scene, the first one is rendered as a preview, and light "auto" is chosen for
    their number. `last`: the last frame, up to which simulations are baked; default: that of the
    trajectory. Use it as a context manager: Blender's output goes to a log meanwhile.
    """

    def __init__(
        self,
        job: RenderJob,
        out: Path,
        emit: Emit,
        threads: int | None = None,
        requested: Sequence[int] = (),
        last: int | None = None,
    ) -> None:
        compat.require_supported_version()
        self.emit = emit
        self.threads = threads
        self.trajectory = load_trajectory(job)
        self._last = len(self.trajectory) - 1 if last is None else last
        self._opened = not shipped.is_scene(job.scene)
        look = None
        self.job = _opened(job, self._frames, emit) if self._opened else job
        was_seen = not requested or (out / first_look.PREVIEW).exists()
        if self._opened and job.light != "path" and not was_seen:
            with native_output_in(Path(os.devnull)):
                look = first_look.look(self.job, self.trajectory, requested[0], threads)
            self._opened = False
        if self.job.light == "auto":
            self.job, sentence = first_look.choose(self.job, out, look, len(requested))
            emit(events.Note(sentence))
        self.run = open_run(out, recipe(self.job), self.trajectory)
        self._judged = None
        if not was_seen and not self.run.is_finished(requested[0]):
            self._judged = requested[0]
        if look:
            emit(events.Note(look.write(out)))
            self._stop_if_black(look.number, look.black)
        begun = read_run(out).recipe.get("machine", {}).get("features")
        features = _features()
        if begun is not None and begun != features:
            processors = f"a processor with {' '.join(begun)}, this one has {' '.join(features)}"
            expected = "frames of both are equal within a tolerance, not byte by byte"
            emit(events.Note(f"this run was started on {processors}: {expected}"))
        self.work = _work_folder(self.run)
        self._output = native_output_in(self.work / "blender.log", errors=False)
        self._ready = self._volumes = False
        self._mipmaps: list[bpy.types.Image] = []

    def __enter__(self) -> "Session":
        self._output.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._output.__exit__(None, None, None)
        shutil.rmtree(self.work, ignore_errors=True)

    @property
    def _frames(self) -> RunFrames:
        def begin(seconds: float) -> None:
            self.emit(events.Baking(seconds))

        return RunFrames(len(self.trajectory), self._last, self._note, begin)

    def _note(self, text: str) -> None:
        self.emit(events.Note(text))

    def prepare(self) -> None:
        """Build the scene, once."""
        if not self._ready:
            self._build()
            # including volumes made by Geometry Nodes
            self._volumes = bool(
                light_choice.volume_names(bpy.context.scene) or compat.volume_outputs()
            )
            self._ready = True
            self._opened = False
            self.emit(events.Ready())

    def _write_objects(self) -> None:
        """Number the objects, and write their tables unless they are there."""
        ground_truth.number_objects()
        table, poses_file = self.run.path / OBJECTS, self.run.path / OBJECT_POSES
        stamps_s = self.trajectory.stamps_s
        if is_simulated(bpy.context.scene):
            stamps_s = stamps_s[: self._last + 1]
        if table.is_file() and covers(poses_file, stamps_s[-1]):
            return
        poses = object_poses(stamps_s)
        if poses.rows:
            atomic_write_text(poses_file, poses.text)
        write_json(table, ground_truth.objects_table(poses.first_frames))

    def bake(self) -> tuple[Path, bool]:
        """Find or bake the light map. Returns its folder and whether it was baked; in that case the
        scene must be built again, preferably in a new
        process, which needs less memory.
        """
        opened = self._opened
        self._ready = self._opened = False
        folder, made = bake_light(self.job, self.emit, self.threads, opened, self._frames)
        self._opened = not made
        return folder, made

    def save_blend(self, file: Path) -> None:
        """Save a copy of the prepared scene with the keyframed camera, to be played in Blender."""
        self.prepare()
        for image in self._mipmaps:  # they have no files
            image.pack()
        bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True, compress=True)

    def render(
        self, requested: str | Sequence[int], should_stop: Callable[[], bool]
    ) -> tuple[int, bool]:
        """Render the missing frames of those requested, given as a slice or numbers. Returns how
        many were rendered, and whether none is missing.

        The file of each frame is written while Cycles renders the next: at most one is open in
        addition to the current one. Raises InputError for a frame that the trajectory does not
        have, WorkError.
        """
        count = len(self.trajectory)
        numbers = frame_slice(requested, count) if isinstance(requested, str) else requested
        if any(not 0 <= n < count for n in numbers):
            raise InputError(f"frames of 0..{count - 1}", found=f"{min(numbers)}..{max(numbers)}")
        missing = self.run.missing(numbers)
        self.emit(events.Missing("frames", len(missing)))
        if missing:
            self.run.check_space(len(missing))
            if max(missing) > self._last:  # simulations end there
                self._last = max(missing)
                self._ready = self._opened = False
            self.prepare()
        rendered = 0
        closing = None
        with ThreadPoolExecutor(1) as closer:
            for number in missing:
                if should_stop():
                    break
                begun = time.perf_counter()
                raw = _render(self.job, number, self.work / str(rendered % 2), self._volumes)
                blurred = self._blurred(number, raw)
                seconds = time.perf_counter() - begun
                if closing is not None:
                    closing.result()
                closing = closer.submit(self._close, number, raw, blurred, seconds)
                rendered += 1
            if closing is not None:
                closing.result()
        return rendered, rendered == len(missing)

    def _blurred(self, number: int, raw: "_RawFrame") -> np.ndarray | None:
        """RGB with motion blur or rolling shutter, if the job has any; Z is still that of the
        stamp.
        """
        if self.job.exposure.instant:
            return None
        depth_z_m = frames.read(raw.depth, raw.depth)[1]
        instant = self.work / "instant.exr"
        return frames.shoot(self.job, number, self.trajectory, depth_z_m, instant)

    def _build(self) -> None:
        """Open the scene unless it is open, light it, keyframe the camera, and set all settings."""
        job = self.job
        _set_up(job, self.emit, self.threads, self._opened, self._frames)
        if INSTANCE in exr_types(job.further):
            self._write_objects()
        lit_by = None
        if job.light == "baked":
            lit_by, _ = light_map.prepare(job, self._note)
        if job.mipmaps:  # after the light map is found: it is that of the original textures
            self._mipmaps = mipmaps.filter_textures(job.camera)
        if lit_by is not None:
            cycles = bpy.context.scene.cycles
            # path tracing clamps indirect light in the same way; not for built-in rooms, so that
            # their frames do not change
            light_map.apply(
                lit_by, None if shipped.is_scene(job.scene) else cycles.sample_clamp_indirect
            )
            settings.assign(bpy.context.scene.cycles, light_map.BOUNCES)
            if (
                bpy.context.scene.world is not None
            ):  # only rays of reflections sample the sky, which is faster than importance sampling
                bpy.context.scene.world.cycles.sampling_method = "NONE"
        passes.add(job.further)
        camera.keyframe(self.trajectory.T_world_camera, job.camera)

    def _close(
        self,
        number: int,
        raw: "_RawFrame",
        blurred: np.ndarray | None,
        cycles_seconds: float,
    ) -> None:
        """Convert Blender's raw frame to the finished file, with the job's further channels, and
        emit the event immediately.
        """
        begun = time.perf_counter()
        # a worker whose parent was killed has finished its last frame meanwhile
        if self.run.is_finished(number):
            self.emit(events.FrameDone(number, cycles_seconds, 0.0, found=True))
            return
        rgb, depth_z_m = frames.read(raw.rgb, raw.depth)
        further = {}
        if self.job.further:
            each = frames.channels_of(raw.depth)
            shot = passes.Shot(each, depth_z_m, number, self.trajectory, self.job.camera)
            further = passes.read(shot, self.job.further)
        if raw.behind is not None:
            behind_z_m = frames.read(raw.behind, raw.behind)[1]
            if self.job.glass == "behind":
                depth_z_m = behind_z_m
            else:
                depth_z_m = np.where(behind_z_m == depth_z_m, depth_z_m, 0.0)
        self.run.write_frame(number, rgb if blurred is None else blurred, depth_z_m, further)
        seconds = time.perf_counter() - begun
        black = frames.why_black(rgb, depth_z_m)
        self.emit(events.FrameDone(number, cycles_seconds, seconds, black=black))
        self._stop_if_black(number, black)

    def _stop_if_black(self, number: int, black: str | None) -> None:
        """Raises InputError if the first frame of a new run is black; a run that was begun goes on,
        because depth may be all that is wanted.
        """
        if black and number == self._judged:
            expected = "a first frame that is not black"
            again = "the same command again, which renders in the dark"
            raise InputError(expected, path=self.job.scene, found=black, hint=again)


def recipe(job: RenderJob) -> dict:
    """The content of sequence.json."""
    processor = _cpuinfo("model name") or platform.processor()
    return {
        "schema_version": 1,
        "job": job.to_dict(),
        "trajectory_sha256": sha256(read_bytes(trajectory_file(job))),
        "scene_sha256": scene.scene_sha256(job.scene),
        "blender": compat.version_line(),
        "texture_filter": mipmaps.VERSION,
        "versions": {
            "iclnuim": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        "source_commit": shipped.source_commit(),
        "machine": {"system": platform.platform(), "processor": processor, "features": _features()},
    }


def _opened(job: RenderJob, frames: RunFrames, emit: Emit) -> RenderJob:
    """Open a user-provided scene before its run is opened: its textures are part of the recipe, and
    moving objects affect the choice of light.
    """
    with native_output_in(Path(os.devnull), errors=False):
        notes = scene.open_scene(job.scene, job.reading, frames)
        job, more = light_choice.with_possible_light(job)
    _note_all(emit, [*notes, *more])
    return job


def bake_light(
    job: RenderJob,
    emit: Emit,
    threads: int | None = None,
    opened: bool = False,
    frames: RunFrames | None = None,
) -> tuple[Path, bool]:
    """Open the job's scene, for the frames of a run, unless it is open, and find or bake its light
    map. Returns its folder, and whether it was baked.

    Raises InputError for a scene whose light cannot be baked.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        native_output_in(Path(folder) / "blender.log"),
    ):
        _set_up(job, emit, threads, opened, frames, must_bake=True)
        return light_map.prepare(job, lambda text: emit(events.Note(text)))


def _set_up(
    job: RenderJob,
    emit: Emit,
    threads: int | None,
    opened: bool,
    frames: RunFrames | None,
    must_bake: bool = False,
) -> None:
    """Open the job's scene unless it is open, emit notes about it, and set all settings."""
    baked = must_bake or job.light == "baked"
    _note_all(emit, [] if opened else scene.open_scene(job.scene, job.reading, frames))
    if must_bake and (obstacle := light_choice.reason_against_baking(bpy.context.scene)):
        wanted = "a scene whose light can be baked"
        raise InputError(wanted, path=job.scene, found=obstacle, hint="{light} path")
    if not shipped.is_scene(job.scene):
        _note_all(emit, preflight.findings(baked, baked and job.samples == 1 and not job.denoise))
    if baked:
        surfaces.make_lamps_real()
    settings.apply(job, threads)


def _note_all(emit: Emit, texts: list[str]) -> None:
    for text in texts:
        emit(events.Note(text))


class _RawFrame(NamedTuple):
    """Blender's frames with RGB and with Z, usually the same, and with Z behind glass if the job
    needs it.
    """

    rgb: frames.Raw
    depth: frames.Raw
    behind: frames.Raw | None


def _render(job: RenderJob, number: int, name: Path, volumes: bool) -> _RawFrame:
    """Render a frame. Its parts may be files: the caller alternates names while another frame is
    being written.

    A separate render with one sample gives Z if the filter is wide or the scene has `volumes`, else
    Z is that of the first sample. It also gives the further channels, which otherwise are a mean
    over the samples.
    """
    scene = bpy.context.scene
    rgb = depth = frames.render(number, name.with_suffix(".exr"), in_memory=True)
    behind = None
    # one narrow ray per pixel, so that Z has the same bits as without antialiasing
    narrow = {"filter_width": settings.CENTRE_FILTER_PX, "samples": 1, "use_denoising": False}
    if job.antialias or volumes or (job.further and job.samples != 1):
        with compat.temporarily(scene.cycles, **narrow), settings.without_volumes():
            file = name.with_name(f"{name.name}-depth.exr")
            depth = frames.render(number, file, in_memory=True)
    if job.glass != "surface":
        through = compat.temporarily(scene.view_layers[0], pass_alpha_threshold=0.5)
        with through, compat.temporarily(scene.cycles, **narrow), settings.without_volumes():
            file = name.with_name(f"{name.name}-behind.exr")
            behind = frames.render(number, file, in_memory=True)
    return _RawFrame(rgb, depth, behind)


def _work_folder(run: RunFolder) -> Path:
    """A folder for Blender's raw frames, named after this process. Folders of processes of this
    host that have ended are removed.

    It is in the run folder, or in ICLNUIM_SCRATCH, for example a node's local disk.
    """
    host = platform.node()
    place = Path(os.environ.get("ICLNUIM_SCRATCH") or run.path)
    for old in place.glob(f".work-{host}-*"):
        if not process_is_running(int(old.name.rsplit("-", 1)[1])):
            shutil.rmtree(old, ignore_errors=True)
    for leftover in (run.path / "exr").glob(".*.tmp.exr"):
        if writer_has_ended(leftover):
            leftover.unlink(missing_ok=True)
    work = place / f".work-{host}-{os.getpid()}"
    make_folder(work)
    return work


def _features() -> list[str]:
    """Processor features that select Cycles' kernels: frames are guaranteed to have equal bytes
    only on processors with equal features.
    """
    return sorted(
        set(_cpuinfo("flags").split()) & {"sse4_2", "avx", "avx2", "fma", "f16c", "avx512f"}
    )


def _cpuinfo(key: str) -> str:
    """An entry of /proc/cpuinfo for the first processor; empty if there is none (not Linux, another
    architecture).
    """
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith(key):
                return line.split(":", 1)[1].strip()
    return ""
