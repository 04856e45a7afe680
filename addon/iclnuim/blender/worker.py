"""The frame loop: any trajectory through any scene, one EXR a frame, resumable anywhere.

A `Session` is the same for the command line, the farm and the panel. It reports through `emit`, see worker_events.py.
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

import bpy
import numpy as np

from .. import __version__, shipped
from .. import worker_events as events
from ..dataset.ground_truth import OBJECTS
from ..dataset.run_folder import RunFolder, load_trajectory, open_run, read_run, trajectory_file
from ..errors import InputError
from ..formats.files import make_folder, process_lives, read_bytes, sha256, write_json, writer_died
from ..geometry.trajectory import frame_slice
from ..job import RenderJob
from ..worker_events import Event
from . import camera, compat, first_look, frames, ground_truth, light_map, output, preflight, scene, settings, surfaces

Emit = Callable[[Event], None]


class Session:
    """A run opened in `out`, its scene built at the first frame and kept; then any frames of it, as often as asked.

    `threads` for Cycles; default: all cores of this process. `asked`: frames that are wanted: a user-provided scene gets a preview of the
    first, and light "auto" is chosen for so many. Use as a context manager: Blender's chatter goes to a log meanwhile.
    """

    def __init__(
        self, job: RenderJob, out: Path, emit: Emit, threads: int | None = None, asked: Sequence[int] = ()
    ) -> None:
        compat.require_supported_version()
        self.emit, self.threads = emit, threads
        self.trajectory = load_trajectory(job)
        self._opened, look = not scene.is_shipped(job.scene), None
        self.job = _opened(job, emit) if self._opened else job
        if self._opened and asked and job.light != "path" and not (out / first_look.PREVIEW).exists():
            with output.blender_output_in(Path(os.devnull)):
                look = first_look.look(self.job, self.trajectory, asked[0], threads)
            self._opened = False
        if self.job.light == "auto":
            self.job, sentence = first_look.choose(self.job, out, look, len(asked))
            emit(events.Note(sentence))
        self.run = open_run(out, recipe(self.job), self.trajectory)
        if look:
            emit(events.Note(look.write(out)))
        begun, features = read_run(out).recipe.get("machine", {}).get("features"), _features()
        if begun is not None and begun != features:
            processors = f"a processor with {' '.join(begun)}, this one has {' '.join(features)}"
            expected = "its frames will equal those of one kind by tolerance, not to the byte"
            emit(events.Note(f"this run was begun on {processors}: {expected}"))
        self.work = _work_folder(self.run)
        self._output = output.blender_output_in(self.work / "blender.log", errors=False)
        self._ready = False

    def __enter__(self) -> "Session":
        self._output.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._output.__exit__(None, None, None)
        shutil.rmtree(self.work, ignore_errors=True)

    def prepare(self) -> None:
        """Build the scene, once."""
        if not self._ready:
            table = self._build()
            if table is not None:
                write_json(self.run.path / OBJECTS, table)
            self._ready, self._opened = True, False
            self.emit(events.Ready())

    def bake(self) -> tuple[Path, bool]:
        """Find the light map or make it, and whether it was made: then the scene is to be built anew, in a process that needs less memory."""
        opened, self._ready, self._opened = self._opened, False, False
        folder, made = bake_light(self.job, self.emit, self.threads, opened)
        self._opened = not made
        return folder, made

    def save_blend(self, file: Path) -> None:
        """A copy of the prepared scene, camera keyed, to be played in Blender."""
        self.prepare()
        bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True, compress=True)

    def render(self, asked: str | Sequence[int], should_stop: Callable[[], bool]) -> tuple[int, bool]:
        """Frames of `asked`, a slice as text or numbers, that were missing and are rendered now, and whether all of them are there.

        Each frame is closed while Cycles is at the next: at most one is open besides the one in work. Raises InputError for a frame
        that the trajectory does not have, WorkError.
        """
        count = len(self.trajectory)
        numbers = frame_slice(asked, count) if isinstance(asked, str) else asked
        if any(not 0 <= n < count for n in numbers):
            raise InputError(f"frames of 0..{count - 1}", found=f"{min(numbers)}..{max(numbers)}")
        missing = self.run.missing(numbers)
        self.emit(events.Missing("frames", len(missing)))
        if missing:
            self.run.check_space(len(missing))
            self.prepare()
        job, rendered, closing = self.job, 0, None
        with ThreadPoolExecutor(1) as closer:
            for number in missing:
                if should_stop():
                    break
                begun = time.perf_counter()
                raw, raw_depth, raw_behind = _render(job, number, self.work / str(rendered % 2))
                blurred = None
                if not job.exposure.instant:  # RGB through a shutter that takes its time; Z stays that of the stamp
                    depth_z_m, instant = frames.read(raw_depth, raw_depth)[1], self.work / "instant.exr"
                    blurred = frames.shoot(job, number, self.trajectory, depth_z_m, instant)
                seconds = time.perf_counter() - begun
                if closing is not None:
                    closing.result()
                closing = closer.submit(self._close, number, raw, raw_depth, raw_behind, blurred, seconds)
                rendered += 1
            if closing is not None:
                closing.result()
        return rendered, rendered == len(missing)

    def _build(self) -> dict | None:
        """Open the scene unless that was done, light it, key the camera, fix every setting. With ground truth, the table of objects."""
        job, table = self.job, None
        _set_up(job, self.emit, self.threads, self._opened)
        if job.ground_truth:
            ground_truth.number_objects()
            table = ground_truth.objects_table()
        if job.light == "baked":
            folder, _ = light_map.prepare(job, lambda text: self.emit(events.Note(text)))
            cycles = bpy.context.scene.cycles
            # as path tracing clamps light that bounced; the built-in rooms keep their frames
            light_map.apply(folder, None if scene.is_shipped(job.scene) else cycles.sample_clamp_indirect)
            settings.assign(bpy.context.scene.cycles, light_map.BOUNCES)
            if (
                bpy.context.scene.world is not None
            ):  # reflections find the sky by themselves, at less cost than by aiming at it
                bpy.context.scene.world.cycles.sampling_method = "NONE"
        if job.ground_truth:
            ground_truth.add_passes()
        camera.keyframe(self.trajectory.T_world_camera, job.camera)
        return table

    def _close(
        self,
        number: int,
        raw: Path,
        raw_depth: Path,
        raw_behind: Path | None,
        blurred: np.ndarray | None,
        cycles_seconds: float,
    ) -> None:
        """Blender's raw frame -> the finished file, with ground truth if the job has it; told at once, not a frame later."""
        begun = time.perf_counter()
        if self.run.is_finished(number):  # a worker whose parent was killed ended its last frame meanwhile
            return self.emit(events.FrameDone(number, cycles_seconds, 0.0, found=True))
        rgb, depth_z_m = frames.read(raw, raw_depth)
        further = {}
        if self.job.ground_truth:
            further = ground_truth.read(raw_depth, self.trajectory.T_world_camera[number])
        if raw_behind is not None:
            behind_z_m = frames.read(raw_behind, raw_behind)[1]
            depth_z_m = behind_z_m if self.job.glass == "behind" else np.where(behind_z_m == depth_z_m, depth_z_m, 0.0)
        self.run.write_frame(number, rgb if blurred is None else blurred, depth_z_m, further)
        seconds = time.perf_counter() - begun
        return self.emit(events.FrameDone(number, cycles_seconds, seconds, black=frames.why_black(rgb, depth_z_m)))


def recipe(job: RenderJob) -> dict:
    """The content of sequence.json."""
    processor = _cpuinfo("model name") or platform.processor()
    return {
        "schema_version": 1,
        "job": job.to_dict(),
        "trajectory_sha256": sha256(read_bytes(trajectory_file(job))),
        "scene_sha256": scene.scene_sha256(job.scene),
        "blender": compat.version_line(),
        "versions": {"iclnuim": __version__, "python": platform.python_version(), "numpy": np.__version__},
        "source_commit": shipped.source_commit(),
        "machine": {"system": platform.platform(), "processor": processor, "features": _features()},
    }


def _opened(job: RenderJob, emit: Emit) -> RenderJob:
    """Open a user-provided scene before its run begins: its textures count in the recipe, and what moves decides the light."""
    with output.blender_output_in(Path(os.devnull), errors=False):
        notes = scene.open_scene(job.scene, job.reading)
        job, more = scene.lit_as_it_can_be(job)
    _note_all(emit, [*notes, *more])
    return job


def bake_light(job: RenderJob, emit: Emit, threads: int | None = None, opened: bool = False) -> tuple[Path, bool]:
    """Open the job's scene, unless it is, and find or make its light map: its folder, and whether it had to be made.

    Raises InputError for a scene that cannot be lit so.
    """
    with tempfile.TemporaryDirectory() as folder, output.blender_output_in(Path(folder) / "blender.log"):
        _set_up(job, emit, threads, opened, must_bake=True)
        return light_map.prepare(job, lambda text: emit(events.Note(text)))


def _set_up(job: RenderJob, emit: Emit, threads: int | None, opened: bool, must_bake: bool = False) -> None:
    """Open the job's scene unless it is, note what is worth telling, fix every setting."""
    _note_all(emit, [] if opened else scene.open_scene(job.scene, job.reading))
    if must_bake and (hindrance := scene.why_not_baked(bpy.context.scene)):
        wanted = "a scene whose light can be baked"
        raise InputError(wanted, path=job.scene, found=hindrance, hint="{light} path")
    _note_all(emit, preflight.findings(must_bake or job.light == "baked"))
    if must_bake or job.light == "baked":
        surfaces.make_lamps_real()
    settings.apply(job, threads)


def _note_all(emit: Emit, texts: list[str]) -> None:
    for text in texts:
        emit(events.Note(text))


def _render(job: RenderJob, number: int, name: Path) -> tuple[Path, Path, Path | None]:
    """Blender's raw files that hold RGB and Z of a frame, mostly one and the same, and Z behind glass where the job asks for it; the
    caller alternates names while one is being closed.

    Z is that of the first sample at any rate, but not with a wide filter nor in a volume; normals are a mean over the samples.
    """
    raw, raw_behind = name.with_suffix(".exr"), None
    raw_depth, scene = raw, bpy.context.scene
    frames.render(number, raw)
    # one narrow ray a pixel, so that Z is the same bits as without antialiasing
    narrow = {"filter_width": settings.CENTRE_FILTER_PX, "samples": 1, "use_denoising": False}
    volumes = preflight.volume_names(scene) or compat.volume_outputs()  # those that Geometry Nodes fill, too
    if job.antialias or volumes or (job.ground_truth and job.samples != 1):
        raw_depth = name.with_name(f"{name.name}-depth.exr")
        with compat.temporarily(scene.cycles, **narrow), settings.without_volumes():
            frames.render(number, raw_depth)
    if job.glass != "surface":
        raw_behind = name.with_name(f"{name.name}-behind.exr")
        through = compat.temporarily(scene.view_layers[0], pass_alpha_threshold=0.5)
        with through, compat.temporarily(scene.cycles, **narrow), settings.without_volumes():
            frames.render(number, raw_behind)
    return raw, raw_depth, raw_behind


def _work_folder(run: RunFolder) -> Path:
    """A folder for Blender's raw frames, named after this process; those of processes that died here are removed.

    It lies in the run folder, or in ICLNUIM_SCRATCH: a node's own disk.
    """
    host, place = platform.node(), Path(os.environ.get("ICLNUIM_SCRATCH") or run.path)
    for old in place.glob(f".work-{host}-*"):
        if not process_lives(int(old.name.rsplit("-", 1)[1])):
            shutil.rmtree(old, ignore_errors=True)
    for leftover in (run.path / "exr").glob(".*.tmp.exr"):
        if writer_died(leftover):
            leftover.unlink(missing_ok=True)
    work = place / f".work-{host}-{os.getpid()}"
    make_folder(work)
    return work


def _features() -> list[str]:
    """What decides which of Cycles' kernels runs: equal bytes are promised between processors of equal features only."""
    return sorted(set(_cpuinfo("flags").split()) & {"sse4_2", "avx", "avx2", "fma", "f16c", "avx512f"})


def _cpuinfo(key: str) -> str:
    """The first processor's entry; empty where there is none (not Linux, another architecture)."""
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith(key):
                return line.split(":", 1)[1].strip()
    return ""
