"""Rendering from Python. Blender runs in a child process, so that this process needs no bpy and
Blender cannot change its state.

One worker uses all cores. `iclnuim render` uses several workers, locks the folder and restarts
workers that crash.
"""

import queue
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .console import Meter, advance_of
from .errors import InputError, StrPath, WorkError
from .geometry.camera import CameraOrText
from .geometry.scene_axes import SceneReading
from .geometry.se3 import SE3, Poses
from .geometry.trajectory import Trajectory, frame_slice
from .job import RenderJob
from .sequences.frame_source import read_frame
from .sequences.rgbd_sequence import pictures
from .sequences.run_folder import RunFolder, load_trajectory, read_run
from .trajectory_files.trajectories import write_trajectory
from .worker_client import WorkerClient, worker_command
from .worker_events import ChunkDone, Event, Exited, Failed, FrameDone


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """rgb (h, w, 3): scene-linear, 1 = white. depth_z_m (h, w): planar depth in metres, 0 where no
    surface is hit.
    """

    rgb: np.ndarray
    depth_z_m: np.ndarray

    def __repr__(self) -> str:
        return f"RenderedFrame({'x'.join(map(str, self.depth_z_m.shape[::-1]))})"

    def _repr_html_(self) -> str:
        return f"{self!r}<br>{pictures(self.rgb, self.depth_z_m)}"


def render_frames(
    job: RenderJob,
    out: StrPath,
    frames: str = "::",
    on_event: Callable[[Event], None] = lambda event: None,
    progress: Meter = None,
) -> RunFolder:
    """Render the frames of a job that are missing in the run folder `out`, and return the folder
    (its files: docs/reference/conventions.md).

    frames: a slice A:B:S over the poses of the job's trajectory. on_event is called with each event
    of the worker (worker_events.py), with FrameDone after each frame. progress: True or False, by
    default on in a notebook, or progress(total, label), which returns an object with advance(). If
    the light map is not in the cache, it is baked first, which takes minutes. Raises InputError
    for frames that the trajectory does not have, and WorkError if Blender is missing, the scene or
    the folder cannot be used, or the work failed. Finished frames stay, and the same call resumes.
    """
    numbers = list(frame_slice(frames, len(load_trajectory(job))))
    advance = advance_of(progress, len(numbers), "render")
    with tempfile.TemporaryDirectory(prefix="iclnuim-") as folder:
        inbox: queue.SimpleQueue[tuple[WorkerClient, Event]] = queue.SimpleQueue()
        log = Path(folder) / "worker.log"
        asked = numbers if job.light == "auto" else ()
        options = {"job": job.to_dict(), "asked": asked, "last": max(numbers, default=None)}
        worker = WorkerClient(worker_command(), options, Path(out).resolve(), log, inbox)
        try:
            worker.send({"frames": numbers})
            while not isinstance(event := inbox.get()[1], ChunkDone):
                if isinstance(event, Failed):
                    raise WorkError(event.text)
                if isinstance(event, Exited):
                    log_end = f": {event.log}" if event.log else ""
                    raise WorkError(f"the render worker ended with code {event.code}{log_end}")
                on_event(event)
                if isinstance(event, FrameDone):
                    advance()
            worker.stop()
        except BaseException:
            worker.kill()
            raise
        finally:
            worker.close()
    return read_run(Path(out))


def render_pose(
    scene: str,
    T_world_camera: Poses,
    camera: CameraOrText | None = None,
    light: str | None = None,
    samples: int | None = None,
    *,
    quality: str | None = None,
    denoise: bool | None = None,
    antialias: bool | None = None,
    mipmaps: bool | None = None,
    lambertian: bool | None = None,
    map_size: int | None = None,
    map_samples: int | None = None,
    seed: int | None = None,
    exposure_s: float | None = None,
    readout_s: float | None = None,
    reading: SceneReading | None = None,
    glass: str | None = None,
) -> RenderedFrame:
    """Render one frame of a scene (a built-in name or a file) from a pose of the cv camera (x
    right, y down, z forward; metres, z up), or from its matrix (4, 4).

    camera: by default the benchmark's. light: baked, path or auto, samples: of a pixel, and all
    others: the fields of RenderJob, by default its values. Starting Blender and opening the scene
    takes seconds: for many poses, write a trajectory file and call render_frames. Raises
    InputError and WorkError like render_frames.
    """
    settings = {name: value for name, value in locals().items() if value is not None}
    del settings["scene"], settings["T_world_camera"]
    T_world_camera = SE3.of(T_world_camera)
    if T_world_camera.shape:
        found = f"poses of shape {T_world_camera.shape}"
        raise InputError("a single pose", found=found, hint="one of them, T[i]")
    with tempfile.TemporaryDirectory(prefix="iclnuim-") as folder:
        file = Path(folder) / "pose.txt"
        pose = SE3(T_world_camera.rotation[None], T_world_camera.translation[None])
        write_trajectory(file, Trajectory(np.zeros(1), pose), "tum")
        job = RenderJob(sequence="pose", scene=scene, trajectory=str(file), **settings)
        run = render_frames(job, Path(folder) / "run", progress=False)
        rgb, depth_z_m = read_frame(run.frame_file(0), run.camera)
    return RenderedFrame(rgb.astype(np.float32), depth_z_m)
