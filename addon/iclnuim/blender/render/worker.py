"""The frame loop: renders any trajectory through any scene, one EXR per frame, and can be resumed
at any frame.

A `Session` is used by the command line, the farm and the panel. It reports events through `emit`,
see worker_events.py.
"""

import os
import platform
import shutil
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import bpy
import numpy as np

from ... import shipped
from ... import worker_events as events
from ...errors import InputError, WorkError
from ...formats.files import make_folder, process_is_running, writer_has_ended
from ...geometry.trajectory import frame_slice
from ...job import RenderJob
from ...native_output import native_output_in
from ...sequences.run_folder import RunFolder, load_trajectory, open_run, read_run
from ...worker_events import Event
from .. import compat
from ..open.run_frames import RunFrames
from . import first_look, frames, passes, run_recipe
from .job_scene import BuiltScene, JobScene

Emit = Callable[[Event], None]


class Session:
    """Opens a run in `out` and renders any of its frames. It looks at a scene and chooses its light,
    makes or resumes the run, builds the scene at the first frame, and renders.

    `threads` for Cycles; default: all cores of this process. `requested`: the requested frames, for
    which light "auto" of a scene without a shipped light map is chosen, with a preview. `last`: the last frame, up to which simulations are baked; default:
    that of the trajectory. Use it as a context manager: Blender's output goes to a log meanwhile.
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
        self.trajectory = load_trajectory(job)
        last = len(self.trajectory) - 1 if last is None else last
        run_frames = RunFrames(len(self.trajectory), last, self._note, self._note_bake)
        self._scene = JobScene(job, emit, threads, run_frames)
        self._built: BuiltScene | None = None
        self._checked: BuiltScene | None = None
        was_seen = (out / first_look.PREVIEW).exists()
        first = requested[0] if requested and not was_seen else None
        look = self._look(requested if first is not None else ())
        self._choose_light(out, look)
        self._chosen_by = look if look and look.ways else None
        self.run = open_run(out, run_recipe.recipe(self.job), self.trajectory)
        is_new = first is not None and not self.run.is_finished(first)
        self._first = first_look.FirstFrame(self.job.scene, first if is_new else None)
        self._note_start(look)
        self.work = _work_folder(self.run)
        self._output = native_output_in(self.work / "blender.log", errors=False)

    def __enter__(self) -> "Session":
        self._output.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._output.__exit__(None, None, None)
        shutil.rmtree(self.work, ignore_errors=True)

    @property
    def job(self) -> RenderJob:
        """The job, with the light that was chosen."""
        return self._scene.job

    def _look(self, requested: Sequence[int]) -> first_look.Look | None:
        """Open a scene whose light may have to be chosen. Returns a look at the requested frames,
        unless there are none, or nothing to choose.
        """
        if shipped.is_scene(self.job.scene) and self.job.light != "auto":
            return None
        self._scene.open_early()
        is_given = self.job.light == "auto" and self.job.samples is not None
        if not requested or self.job.light == "path" or is_given:
            return None
        return self._scene.look(self.trajectory, requested)

    def _choose_light(self, out: Path, look: first_look.Look | None) -> None:
        """Replace light "auto" by the way that was chosen."""
        if self.job.light != "auto":
            return
        can_bake = self._scene.can_bake
        self._scene.job, sentence = first_look.choose(self.job, out, look, can_bake)
        self._note(sentence)

    def _note_start(self, look: first_look.Look | None) -> None:
        """Keep and judge the preview; say if frames may differ from those of an earlier start."""
        if look:
            self._note(look.write(self.run.path))
            self._first.refuse_black(look.number, look.black)
        if note := run_recipe.processor_note(read_run(self.run.path)):
            self._note(note)

    def _note(self, text: str) -> None:
        self.emit(events.Note(text))

    def _note_bake(self, seconds: float) -> None:
        self.emit(events.Baking(seconds))

    def prepare(self) -> BuiltScene:
        """The scene, built once."""
        if self._built is None:
            self._built = self._scene.build(self.trajectory, self.run.path)
            self.emit(events.Ready())
        return self._built

    def bake(self) -> tuple[Path, bool]:
        """Find or bake the light map; see JobScene.bake."""
        self._built = None
        baked = self._scene.bake()
        if (look := self._chosen_by) is not None and self.job.light == "baked":
            measured_db = self._scene.measured_db(look, self.trajectory)
            look.write(self.run.path, measured_db)
            self._note(look.corrected(measured_db))
        return baked

    def save_blend(self, file: Path) -> None:
        """Save a copy of the prepared scene with the keyframed camera, to be played in Blender."""
        for image in self.prepare().textures.images:  # in memory, or in the cache
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
        if not missing:
            return 0, True
        self.run.check_space(len(missing))
        if self._scene.extend(max(missing)):
            self._built = None
        built = self.prepare()
        rendered = 0
        closing = None
        with ThreadPoolExecutor(1) as closer:
            for number in missing:
                if should_stop():
                    break
                begun = time.perf_counter()
                name = self.work / str(rendered % 2)
                raw = frames.render_parts(self.job, number, name, built.has_volumes)
                self._check_textures(built)
                blurred = self._blurred(number, raw)
                seconds = time.perf_counter() - begun
                if closing is not None:
                    closing.result()
                closing = closer.submit(self._close, number, raw, blurred, seconds)
                rendered += 1
            if closing is not None:
                closing.result()
        return rendered, rendered == len(missing)

    def _check_textures(self, built: BuiltScene) -> None:
        """Raises WorkError if Cycles may have missed a picture in the first frame; later ones have
        what it has read for that.
        """
        if self._checked is not built and (removed := built.textures.removed):
            hint = "the same command again"
            raise WorkError(f"{removed}: removed while the scene was prepared", hint=hint)
        self._checked = built

    def _blurred(self, number: int, raw: frames.RawFrame) -> np.ndarray | None:
        """RGB with motion blur or rolling shutter, if the job has any; Z is still that of the
        stamp.
        """
        if self.job.exposure.instant:
            return None
        depth_z_m = frames.read(raw.depth, raw.depth)[1]
        instant = self.work / "instant.exr"
        return frames.shoot(self.job, number, self.trajectory, depth_z_m, instant)

    def _close(
        self,
        number: int,
        raw: frames.RawFrame,
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
        self._first.refuse_black(number, black)


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
