"""What `iclnuim run` has written becomes cells of `iclnuim benchmark`, and what a cell is measured
on is told apart.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from iclnuim.benchmark.experiments.cells import LAMBERTIAN, Cell
from iclnuim.benchmark.experiments.measure import Meter, Task, measure
from iclnuim.benchmark.experiments.runner import Benchmark, measured
from iclnuim.benchmark.experiments.sources import Sources, external_cells
from iclnuim.console import Console
from iclnuim.formats.png import write_png

KT2 = Cell("living_room", "kt2", "clean", "icp", "best", "default")


class Quiet(Meter):
    def flush(self):
        self.done = 0


@pytest.fixture
def sources(make_sequence, tmp_path):
    make_sequence(tmp_path / "data/living_room/kt2/clean")
    return Sources(tmp_path / "data", tmp_path / "bench")


def test_runs_of_a_system_are_cells_whose_error_is_that_of_its_row(sources, run, fake, tmp_path):
    rows, _ = run(fake("good"), "--runs", 2, folder=sources.folder(KT2))
    cells = external_cells(tmp_path / "out", [KT2], sources, None)
    names = {(cell.odometer, cell.preset, cell.run) for cell in cells}
    assert names == {("good", name, number) for name in ("final", "live") for number in (1, 2)}
    assert external_cells(tmp_path / "out", [KT2], sources, 30) == {}  # other frames
    cell = next(cell for cell in cells if cell.preset == "final" and cell.run == 2)
    out = sources.out / "cells" / cell.name
    recipe, work = {"kind": "a cell"}, str(sources.work)
    measure(
        Task(cell, str(sources.folder(cell)), str(out), None, None, str(cells[cell]), recipe, work),
        Quiet(),
    )
    (found,) = measured(sources.out)
    assert found["cell"] == cell and found["coverage"] == 1 and "surface" not in found
    assert found["ate_m"]["rmse"] == pytest.approx(rows["good"]["ate_rmse_m"], abs=1e-9)
    path = json.loads((out / "path.json").read_text())
    assert len(path["truth_m"]) == len(path["estimate_m"]) == len(path["error_m"]) == 60


@pytest.mark.slow
def test_what_cannot_be_tracked_is_a_result_too(sources, tmp_path):
    """Frames without depth in 8 x 6 pixels of one grey."""
    out = tmp_path / "cell"
    measure(
        Task(KT2, str(sources.folder(KT2)), str(out), 3, None, None, {}, str(sources.work)), Quiet()
    )
    content = json.loads((out / "result.json").read_text())
    assert "failed" in content and "ate_m" not in content


def test_a_sequence_that_cannot_be_measured_is_named_with_what_makes_it(sources):
    assert sources.fault(KT2, None) == "" and sources.fault(KT2, 60) == ""
    assert "has 60 frames, expected at least 61" in sources.fault(KT2, 61)
    assert "iclnuim make living_room/kt3" in sources.fault(replace(KT2, trajectory="kt3"), None)
    (sources.folder(KT2) / "recipe.json").write_text('{"finished": false}')
    assert "iclnuim resume" in sources.fault(KT2, None)


def test_frames_without_reflections_are_those_of_another_folder_and_have_no_surface(
    sources, tmp_path
):
    cell = replace(KT2, noise=LAMBERTIAN)
    there = replace(sources, lambertian=sources.data)
    assert "does not exist" in sources.fault(cell, None)
    assert there.folder(cell) == sources.folder(replace(KT2, noise="clean"))
    assert "was not rendered without reflections" in there.fault(cell, None)
    job = {"scene": cell.room, "lambertian": True}
    (there.folder(cell) / "recipe.json").write_text(json.dumps({"source": {"run": {"job": job}}}))
    assert there.fault(cell, None) == "" and there.frames(cell, None) == 60
    (there.folder(cell) / "frames.jsonl").write_text('{"frame": 0}\n')
    assert Benchmark(there, [cell], {}, None, 1, Console(quiet=True))._task(cell).model is None
    elsewhere = replace(sources, lambertian=tmp_path / "matt")
    assert (
        f"try: iclnuim make {cell.room}/kt2 --lambertian -o {tmp_path / 'matt'}/{cell.room}/kt2"
        in elsewhere.fault(cell, None)
    )


def test_a_cell_is_measured_again_only_for_other_images_frames_or_settings(sources):
    (sources.folder(KT2) / "frames.jsonl").write_text('{"frame": 0}\n')
    task = Benchmark(sources, [KT2], {}, None, 1, Console(quiet=True))._task(KT2)
    out = sources.out / "cells" / KT2.name
    out.mkdir(parents=True)

    def missing(first=None):
        return len(Benchmark(sources, [KT2], {}, first, 1, Console(quiet=True))._missing())

    assert missing() == 1
    (out / "recipe.json").write_text(
        json.dumps({**task.recipe, "source_commit": "another", "versions": {}})
    )
    assert missing() == 0 and missing(30) == 1
    (out / "recipe.json").write_text(json.dumps({**task.recipe, "fusion": {}}))
    assert missing() == 1
    (out / "recipe.json").write_text(json.dumps(task.recipe))
    (sources.folder(KT2) / "frames.jsonl").write_text('{"frame": 1}\n')
    assert missing() == 1


@pytest.mark.parametrize("changed", ["depth.png", "groundtruth.txt", "camera.json"])
def test_a_cell_of_a_foreign_sequence_is_measured_again_if_a_file_changed(sources, changed):
    folder = sources.folder(KT2)
    before = Sources(sources.data, sources.out).identity(KT2)
    assert Sources(sources.data, sources.out).identity(KT2) == before
    if changed == "depth.png":
        write_png(folder / changed, np.full((6, 8), 999, np.uint16))
    else:
        text = (folder / changed).read_text()
        (folder / changed).write_text(
            text.replace("1000.0", "1001.0") if changed == "camera.json" else text + "# end\n"
        )
    assert Sources(sources.data, sources.out).identity(KT2) != before


def test_cells_that_another_version_measured_are_kept_and_said(sources, capsys):
    (sources.folder(KT2) / "frames.jsonl").write_text('{"frame": 0}\n')
    bench = Benchmark(sources, [KT2], {}, None, 1, Console())
    task, out = bench._task(KT2), sources.out / "cells" / KT2.name
    out.mkdir(parents=True)
    (out / "recipe.json").write_text(json.dumps(task.recipe))
    assert bench.run() == [] and "another version" not in capsys.readouterr().err
    (out / "recipe.json").write_text(json.dumps({**task.recipe, "source_commit": "another"}))
    assert bench.run() == []
    note = capsys.readouterr().err
    assert "1 of these were measured by another version or commit" in note and str(out) in note


def test_trajectories_alone_are_enough_where_surfaces_are_not_asked_for(sources, monkeypatch):
    """And a surface that is measured is not lost by asking for less."""
    monkeypatch.setattr(type(sources), "model_name", lambda *_: KT2.room)
    monkeypatch.setattr(type(sources), "model", lambda *_: Path("model.npz"))

    def asked(surfaces):
        return Benchmark(sources, [KT2], {}, None, 1, Console(quiet=True), surfaces)

    def missing(surfaces):
        return [task.model for task in asked(surfaces)._missing()]

    assert missing(True) == ["model.npz"] and missing(False) == [None]
    out = sources.out / "cells" / KT2.name
    out.mkdir(parents=True)
    (out / "recipe.json").write_text(json.dumps(asked(False)._task(KT2).recipe))
    assert missing(False) == [] and missing(True) == ["model.npz"]
    (out / "recipe.json").write_text(json.dumps(asked(True)._task(KT2).recipe))
    assert missing(False) == missing(True) == []
