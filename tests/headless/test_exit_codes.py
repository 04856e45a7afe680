"""An unexpected exception inside a command, its worker or the script never ends with exit code 0."""

import os
import subprocess
import sys

import pytest
from patience import patience

RENDER = ["kt2", "--frames", "0:1", "--camera", "64x48", "--light", "path", "--samples", "1"]


@pytest.fixture
def sabotaged(tmp_path):
    """`sabotaged(module, name, *argv)` runs Python in which that function of that module raises;
    returns the finished process.
    """

    def run(module, name, *argv):
        folder = tmp_path / "sabotage"
        folder.mkdir()
        (folder / "sitecustomize.py").write_text(
            f"import {module} as module\n"
            "def sabotaged(*args, **options):\n"
            "    raise RuntimeError('sabotaged')\n"
            f"module.{name} = sabotaged\n"
        )
        environment = {**os.environ, "PYTHONPATH": str(folder)}
        return subprocess.run(
            [sys.executable, *map(str, argv)],
            capture_output=True,
            text=True,
            env=environment,
            cwd=tmp_path,
            timeout=patience(200),
        )

    return run


def test_in_a_command(sabotaged, repository):
    path = repository / "trajectories/living_room/kt2.txt"
    done = sabotaged(
        "iclnuim.trajectory_files.trajectories",
        "read_trajectory",
        "-m",
        "iclnuim",
        "trajectory",
        "info",
        path,
    )
    assert done.returncode not in (0, 2) and "RuntimeError: sabotaged" in done.stderr


def test_in_the_render_script(sabotaged, repository):
    script = repository / "headless/render.py"
    done = sabotaged("iclnuim.shipped", "full_name", script, *RENDER, "--out", "raw")
    assert done.returncode == 3 and "RuntimeError: sabotaged" in done.stderr


def test_in_a_worker(sabotaged, repository, tmp_path):
    pytest.importorskip("bpy", reason="needs the bpy package")
    words = (
        repository / "headless/render.py",
        *RENDER,
        "--scene",
        repository / "tests/room.obj",
        "--out",
        "raw",
    )
    done = sabotaged("iclnuim.sequences.run_folder", "RunFolder.write_frame", *words)
    assert done.returncode == 3, done.stderr
    assert "sabotaged" in done.stderr + "".join(p.read_text() for p in tmp_path.rglob("*.log"))


def test_the_render_script_loses_no_line_that_it_prints(repository):
    words = [sys.executable, repository / "headless/render.py", "--help"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=patience(200))
    assert done.returncode == 0 and done.stdout.startswith("usage:")
