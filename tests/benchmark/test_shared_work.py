"""What cells share while they are measured, and a disk that is full."""

import errno
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from iclnuim.errors import WorkError
from iclnuim.formats.files import locked
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.headless import cli

pytest.importorskip("embreex")
pytest.importorskip("igl")
from iclnuim.benchmark.experiments import pool
from iclnuim.benchmark.experiments.recipes.paper import surface as paper_surface
from iclnuim.benchmark.experiments.recipes.paper.recipe import Paper  # noqa: E402
from iclnuim.benchmark.experiments.recipes.paper.sources import Sources  # noqa: E402
from iclnuim.benchmark.fusion.quality import SeenBy, surface_quality  # noqa: E402
from iclnuim.benchmark.fusion.settings import QualitySettings  # noqa: E402
from iclnuim.benchmark.fusion.surface_error import TrueSurface  # noqa: E402
from iclnuim.headless.commands import benchmark  # noqa: E402

#: Two walls, one before the other.
WALLS = np.array([[x, y, z] for z in (2.0, 3.0) for x, y in ((-z, -1), (z, -1), (z, 1), (-z, 1))])
SIDES = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
FEW = QualitySettings(samples=2000)


@pytest.fixture
def views():
    steps = np.column_stack([0.01 * np.arange(30), np.zeros((30, 5))])
    return SeenBy(PinholeCamera.parse("160x120"), SE3.exp(steps))


def test_what_was_seen_is_computed_once_for_all_cells_and_again_if_its_file_is_damaged(
    tmp_path, monkeypatch, views
):
    surface, asked = TrueSurface(WALLS, SIDES), []

    def counted(*args, compute=paper_surface.what_was_seen):
        asked.append(args)
        return compute(*args)

    monkeypatch.setattr(paper_surface, "what_was_seen", counted)

    def figures(seen_by=views, model="room_1.npz"):
        seen = paper_surface.cached_seen(tmp_path / "seen", model, surface, seen_by, FEW)
        return surface_quality(
            surface, WALLS + (0, 0, 0.004), SIDES, seen_by=seen, settings=FEW
        ).to_dict()

    plain = surface_quality(
        surface, WALLS + (0, 0, 0.004), SIDES, seen_by=views, settings=FEW
    ).to_dict()
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(lambda _: figures(), range(3))) == [plain] * 3
    assert len(asked) == 1
    file = next((tmp_path / "seen").glob("*.npz"))
    file.write_bytes(file.read_bytes()[:-1000])
    assert figures() == plain and len(asked) == 2
    figures(model="room_2.npz")
    figures(replace(views, T_world_camera=SE3.exp(np.full(6, 0.01)) @ views.T_world_camera))
    figures(replace(views, camera=PinholeCamera.parse("80x60")))
    assert len(asked) == 5 and figures() == plain and len(asked) == 5


@pytest.fixture
def started(tmp_path, monkeypatch):
    """Starts `iclnuim benchmark` on sequences that only seem to exist; returns its exit code."""
    monkeypatch.chdir(tmp_path)  # without out/systems, whose results would be part of the benchmark
    known = {"fault": "", "frames": 1, "model_name": None, "identity": {"sha256": ""}}
    for name, value in known.items():
        monkeypatch.setattr(Sources, name, lambda *args, value=value: value)
    monkeypatch.setattr(benchmark, "note_sequence", lambda *args: None)
    folders = ["--data", str(tmp_path / "data"), "--out", str(tmp_path / "out")]
    return lambda: cli.main(["benchmark", *folders, "--quiet"])


def test_a_full_disk_is_one_line_with_the_file_and_what_to_try(
    started, tmp_path, monkeypatch, capsys
):
    """Writes into one file fail as those of a full disk do: without its name."""

    def full(write):
        def writes(path, *args, **options):
            if path.name.startswith(".recipe."):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return write(path, *args, **options)

        return writes

    for name in ("write_bytes", "write_text"):
        monkeypatch.setattr(Path, name, full(getattr(Path, name)))
    assert started() == 3
    error = capsys.readouterr().err
    assert str(tmp_path / "out/recipe.json") in error and error.count("\n") == 1
    assert "No space left on device; try freeing space there" in error


def test_one_command_at_a_time_works_in_a_folder_and_can_fork(started, tmp_path, monkeypatch):
    """A fork is unsafe beside a thread, so the lock has none."""

    def run(*args):
        with pytest.raises(WorkError, match="another process is writing here"), locked(out):
            pass
        begun.append(threading.active_count())
        return []

    out = tmp_path / "out"
    begun = []
    monkeypatch.setattr(Paper, "run", run)
    before = threading.active_count()
    assert started() == 2  # no cell is measured
    assert begun == [before]


def test_threads_of_numba_that_run_already_keep_their_number(monkeypatch):
    """Else numba refuses to compile anything further."""

    def refuses():
        raise RuntimeError("threads have been launched")

    monkeypatch.setattr("numba.core.config.reload_config", refuses)
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    pool.one_thread()
    assert "NUMBA_NUM_THREADS" not in os.environ
