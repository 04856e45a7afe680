"""The panel's work with a real worker process: killed, or abandoned by its window, finished frames
stay and the next run continues.
"""

import time
from pathlib import Path

import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.job import shipped_job
from iclnuim.ui.work import Work
from iclnuim.worker_client import WorkerClient, worker_command
from patience import patience

bpy = pytest.importorskip("bpy", reason="needs the bpy package")


@pytest.fixture(scope="module")
def crate(tmp_path_factory) -> Path:
    """A scene that loads and renders in no time."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, 1))
    file = tmp_path_factory.mktemp("crate") / "crate.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    return file


@pytest.fixture
def begin(crate):
    """`begin(out, frames, ...)`: a worker process that has been told to render them, and the
    panel's work with it.
    """

    def run(
        out: Path, frames: list[int], sequences: dict | None = None, **changes
    ) -> tuple[Work, WorkerClient]:
        small = {
            "light": "path",
            "samples": 1,
            "denoise": False,
            "camera": PinholeCamera.parse("32x24"),
        }
        job = shipped_job("kt2").changed(scene=str(crate), **small, **changes)
        worker = WorkerClient(worker_command(), {"job": job.to_dict()}, out, out.parent / "log.txt")
        work = Work()
        work.start("render", {"frames": frames, "sequences": sequences}, worker, "all there")
        return work, worker

    return run


def wait(work: Work, until) -> None:
    end = time.monotonic() + patience(120)
    while not until() and time.monotonic() < end:
        work.poll()
        time.sleep(0.02)
    assert until(), (work.phase, work.message)


def finished(out: Path) -> set[str]:
    return {p.name for p in (out / "exr").glob("[0-9]*.exr")}


def test_a_killed_worker_is_reported_and_its_frames_are_kept(tmp_path, begin):
    out = tmp_path / "run"
    work, worker = begin(out, list(range(0, 800, 2)))
    wait(work, lambda: work.done >= 2)
    worker.kill()
    wait(work, lambda: not work.busy)
    assert work.phase == "failed" and "Resume" in work.message
    kept = finished(out)
    work, _ = begin(out, [0, 2, 4])
    wait(work, lambda: not work.busy)
    assert (work.phase, work.message) == ("done", "all there")
    assert finished(out) >= kept | {"000004.exr"}


def test_when_the_window_is_gone_the_worker_stops_by_itself(tmp_path, begin):
    out = tmp_path / "run"
    work, worker = begin(out, list(range(800)))
    wait(work, lambda: work.done >= 1)
    worker.stdin.close()
    wait(work, lambda: not work.busy)
    assert work.phase == "stopped"
    assert len(finished(out)) < 800


def test_cancel_keeps_the_finished_frames(tmp_path, begin):
    out = tmp_path / "run"
    work, _ = begin(out, list(range(800)))
    wait(work, lambda: work.done >= 1)
    work.cancel()
    wait(work, lambda: not work.busy)
    assert work.phase == "stopped"
    assert "000000.exr" in finished(out)
    assert list(out.glob(".work-*")) == []


def test_bad_input_comes_back_as_one_line(tmp_path, begin):
    work, _ = begin(tmp_path / "run", [0], trajectory=str(tmp_path / "nowhere.txt"))
    wait(work, lambda: not work.busy)
    assert work.phase == "failed"
    assert "nowhere.txt" in work.message and "\n" not in work.message


def test_sequences_of_other_noise_are_refused_before_the_first_frame(tmp_path, begin):
    def sequences(seed: int) -> dict:
        return {
            "formats": ["tum"],
            "variants": {str(tmp_path / "noisy"): {"depth_noise": "released", "seed": seed}},
        }

    out = tmp_path / "run"
    work, _ = begin(out, [0], sequences(seed=0))
    wait(work, lambda: not work.busy)
    assert work.phase == "done" and (tmp_path / "noisy/depth/000000.png").is_file()
    work, _ = begin(out, [0, 1], sequences(seed=1))
    wait(work, lambda: not work.busy)
    assert work.phase == "failed" and "noisy" in work.message
    assert finished(out) == {"000000.exr"}
