"""Whatever interrupts a writer, the file is as before or whole, and nothing else is left."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import atomic_write, process_is_running
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.associations import (
    Associations,
    ImageList,
    write_associations,
    write_image_list,
)
from iclnuim.trajectory_files.trajectories import write_trajectory

WALK = Trajectory.at_rate(SE3.exp(np.random.default_rng(0).normal(size=(2000, 6)) * 0.1))
IMAGES = ImageList(tuple(i / 30 for i in range(2000)), tuple(f"depth/{i}.png" for i in range(2000)))
COLOURS = ImageList(IMAGES.stamps_s, tuple(f"rgb/{i}.png" for i in range(2000)))
WRITERS = {
    **{
        format: lambda path, format=format: write_trajectory(path, WALK, format)
        for format in (
            "tum",
            "kitti",
            "pov-matrix",
            "gt.freiburg",
            "gt.sim",
            "pov-commands",
            "euroc",
        )
    },
    "associations": lambda path: write_associations(path, Associations(COLOURS, IMAGES)),
    "images": lambda path: write_image_list(path, IMAGES),
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("before", [None, "what was there"])
def test_a_full_disk_leaves_the_file_as_it_was(tmp_path, file_size_limit, name, before):
    path = tmp_path / "out.txt"
    if before:
        path.write_text(before)
    with file_size_limit(10_000), pytest.raises(WorkError, match="out.txt: cannot write: "):
        WRITERS[name](path)
    assert [p.name for p in tmp_path.iterdir()] == (["out.txt"] if before else [])
    assert not before or path.read_text() == before


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError(errno.EIO, "input/output error")])
def test_an_interruption_before_the_renaming_leaves_nothing(tmp_path, monkeypatch, name, stop):
    def interrupted(*_):
        raise stop

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises((KeyboardInterrupt, WorkError)):
        WRITERS[name](tmp_path / "out.txt")
    assert not list(tmp_path.iterdir())


def test_a_killed_process_leaves_the_file_as_it_was(tmp_path, repository):
    path = tmp_path / "out.txt"
    path.write_text("what was there")
    program = """if True:
        import os, signal, sys
        from iclnuim.formats.files import atomic_write
        def write(temporary):
            temporary.write_text("half of")
            os.kill(os.getpid(), signal.SIGKILL)
        atomic_write(sys.argv[1], write)
    """
    environment = {**os.environ, "PYTHONPATH": str(repository / "addon")}
    assert (
        subprocess.run(
            [sys.executable, "-c", program, str(path)], env=environment, check=False
        ).returncode
        == -9
    )
    assert path.read_text() == "what was there"
    # what is left has a name that no reader takes for a result
    assert all(p.name.startswith(".") and ".tmp" in p.name for p in tmp_path.iterdir() if p != path)


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(WorkError, match="no/out.txt: cannot write: No such file"):
        write_trajectory(tmp_path / "no/out.txt", WALK, "tum")


def test_what_cannot_be_written_does_not_touch_the_file(tmp_path):
    path = tmp_path / "out.gt.sim"
    path.write_text("what was there")
    with pytest.raises(InputError):
        write_trajectory(path, WALK[::7], "gt.sim")
    assert path.read_text() == "what was there"


def test_the_temporary_file_stands_beside_the_target(tmp_path):
    seen: list[Path] = []
    atomic_write(
        tmp_path / "a.png", lambda temporary: (seen.append(temporary), temporary.write_text("x"))
    )
    assert seen[0].parent == tmp_path and seen[0].suffix == ".png" and not seen[0].exists()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
def test_a_killed_writer_has_ended_before_its_parent_notices():
    writer = subprocess.Popen(["sleep", "60"])
    assert process_is_running(writer.pid)
    os.kill(writer.pid, signal.SIGKILL)
    os.waitid(os.P_PID, writer.pid, os.WEXITED | os.WNOWAIT)  # it stays in the table of processes
    assert not process_is_running(writer.pid)
    writer.wait()
    assert not process_is_running(writer.pid)
