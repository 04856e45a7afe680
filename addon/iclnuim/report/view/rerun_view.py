"""The same ViewContents as a recording for the viewer Rerun."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...console import Meter, advance_of
from ...errors import StrPath
from ..recording import TRUTH, Recorder, record
from .contents import ViewContents, ViewedSequence, ViewedSurface


def record_view(path: StrPath, view: ViewContents, progress: Meter = None) -> None:
    """Write a recording (.rrd). Raises the errors of `record`."""
    advance = advance_of(progress, sum(len(one.frames) for one in view.sequences), "view")

    def fill(recorder: Recorder) -> None:
        for surface in view.surfaces:
            _surface(recorder, surface)
        for number, one in enumerate(view.trajectories):
            colour = TRUTH if one.is_truth else (30, 110 + 40 * (number % 3), 200)
            entity = f"world/trajectories/{number} {one.label}"
            recorder.trajectory(entity, one.trajectory.positions_m, colour)
        for sequence in view.sequences:
            _frames(recorder, sequence, advance)

    record(path, view.title, fill)


def _frames(recorder: Recorder, sequence: ViewedSequence, advance: Callable[[], object]) -> None:
    entity = f"world/{sequence.name}"
    recorder.camera(f"{entity}/image", sequence.camera)
    for frame in sequence.frames:
        rgb, depth_z_m = frame.load()
        recorder.at(frame.stamp_s, frame.number)
        if frame.T_world_camera is not None:
            recorder.pose(entity, frame.T_world_camera)
        recorder.log(f"{entity}/image/rgb", recorder.rerun.Image(rgb))
        depth = recorder.rerun.DepthImage(np.asarray(depth_z_m, np.float32), meter=1.0)
        recorder.log(f"{entity}/image/depth", depth)
        advance()


def _surface(recorder: Recorder, surface: ViewedSurface) -> None:
    mesh = {"vertex_positions": surface.points, "triangle_indices": surface.triangles}
    if surface.colours is not None:
        mesh["vertex_colors"] = surface.colours
    recorder.static(f"world/{surface.name}", recorder.rerun.Mesh3D(**mesh))


def start_viewer(path: Path) -> None:
    """Start the viewer with a recording; it goes on when this process ends."""
    subprocess.Popen([sys.executable, "-m", "rerun", path], start_new_session=True)
