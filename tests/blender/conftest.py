"""Tiny analytic scenes; the render command in a process of its own as users run it, and the same
frame loop in this process.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from patience import patience

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def cornered_room(tmp_path_factory) -> Path:
    """A .blend with a floor z = 0, a wall y = 2, a ramp and a point light: every depth follows from
    a formula or a ray.
    """
    path = tmp_path_factory.mktemp("scene") / "cornered_room.blend"
    bpy.ops.wm.read_factory_settings(use_empty=True)
    quads = {
        "floor": [(-9, -9, 0), (9, -9, 0), (9, 2, 0), (-9, 2, 0)],
        "wall": [(-9, 2, 0), (9, 2, 0), (9, 2, 3), (-9, 2, 3)],
        "ramp": [(0.2, 0.5, 0.3), (0.8, 0.5, 0.3), (0.8, 1.4, 0.9), (0.2, 1.4, 0.9)],
    }
    for name, corners in quads.items():
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
    lamp.location = (0, 0, 2.5)
    lamp.data.energy = 100.0
    bpy.context.scene.collection.objects.link(lamp)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture(scope="session")
def forward_path(tmp_path_factory) -> Path:
    """A TUM file of 12 poses that look along +y, slightly down and rolled, moving right by a
    centimetre a frame.
    """
    from iclnuim.geometry import so3
    from iclnuim.geometry.se3 import SE3

    looking_along_y = np.array(
        [[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]
    )  # cv camera: x right, y down, z forward
    tilts = so3.exp(
        np.stack([np.full(12, -0.1), np.linspace(0, 0.2, 12), np.linspace(-0.05, 0.05, 12)], -1)
    )
    T = SE3(
        looking_along_y @ tilts,
        np.stack([0.01 * np.arange(12), np.full(12, -1.5), np.full(12, 1.3)], -1),
    )
    path = tmp_path_factory.mktemp("path") / "forward.txt"
    rows = np.concatenate([np.arange(12)[:, None] / 30, T.translation, T.quat_xyzw], -1)
    np.savetxt(path, rows, fmt="%.9f")
    return path


@pytest.fixture(scope="session")
def render(cornered_room, forward_path):
    """`render(out, *options)` runs the script as a user would, small and path-traced; returns the
    finished process.
    """

    def run(
        out: Path,
        *options: str,
        scene=cornered_room,
        trajectory=forward_path,
        base=("--light", "path", "--samples", "2", "--no-denoise"),
    ):
        return subprocess.run(
            command(out, *options, scene=scene, trajectory=trajectory, base=base),
            capture_output=True,
            text=True,
            timeout=patience(300),
        )

    def command(
        out,
        *options,
        scene=cornered_room,
        trajectory=forward_path,
        base=("--light", "path", "--samples", "2", "--no-denoise"),
    ):
        size = () if "--camera" in options else ("--camera", "64x48")
        fixed = [
            "--scene",
            str(scene),
            "--trajectory",
            str(trajectory),
            "--out",
            str(out),
            *size,
            *base,
        ]
        return [sys.executable, str(REPOSITORY / "headless/render.py"), *fixed, *options]

    run.command = command
    return run


@pytest.fixture(scope="session")
def render_here(cornered_room, forward_path):
    """`render_here(out, frames, **settings)` renders in this process, where Blender is loaded
    already; returns what was noted.

    The bytes are those of the command: tests of the command itself, and of whole processes, use
    `render`.
    """
    from iclnuim.blender.render import worker
    from iclnuim.geometry.camera import PinholeCamera
    from iclnuim.job import RenderJob
    from iclnuim.worker_events import Note

    def run(
        out: Path,
        frames="::",
        *,
        job=None,
        scene=cornered_room,
        trajectory=forward_path,
        camera="64x48",
        **settings,
    ):
        if job is None:
            small = (
                {"light": "path", "samples": 2, "denoise": False}
                if settings.get("light") != "baked"
                else {}
            )
            lens = PinholeCamera.parse(camera)
            job = RenderJob(
                "test", str(scene), str(trajectory), camera=lens, **{**small, **settings}
            )
        notes = []
        out.parent.mkdir(parents=True, exist_ok=True)

        def listen(event):
            if isinstance(event, Note):
                notes.append(event.text)

        with worker.Session(job, out, listen) as session:
            _, whole = session.render(frames, lambda: False)
        assert whole
        return notes

    return run
