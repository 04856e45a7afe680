"""What `iclnuim run` has written becomes cells of `iclnuim benchmark`, and what a cell is measured
on is told apart.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from iclnuim.benchmark.experiments import code_version
from iclnuim.benchmark.experiments.recipes.paper import surface as paper_surface
from iclnuim.benchmark.experiments.recipes.paper.keys import LAMBERTIAN, PaperKey
from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND, Paper
from iclnuim.benchmark.experiments.recipes.paper.sources import Sources, external_keys
from iclnuim.benchmark.experiments.store import Store
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.png import write_png

KT2 = PaperKey("living_room", "kt2", "clean", "icp", "best", "default")


@pytest.fixture
def sources(make_sequence, tmp_path):
    make_sequence(tmp_path / "data/living_room/kt2/clean")
    return Sources(tmp_path / "data", tmp_path / "bench")


@pytest.fixture
def store(sources):
    return Store(sources.out, KIND)


def measure(paper, store):
    """Measure what is missing; returns the notes and the frames that progress showed."""
    console = Console()
    console.note = (notes := []).append
    console.progress = lambda total, label: (
        shown.append(total) or Console(quiet=True).progress(total, label)
    )
    shown = []
    assert paper.run(store, 1, console) == []
    return notes, sum(shown)


def test_runs_of_a_system_are_cells_whose_error_is_that_of_its_row(
    sources, store, run, fake, tmp_path
):
    rows, _ = run(fake("good"), "--runs", 2, folder=sources.folder(KT2))
    keys = external_keys(tmp_path / "out", [KT2], sources, None)
    names = {(key.odometer, key.preset, key.run) for key in keys}
    assert names == {("good", name, number) for name in ("final", "live") for number in (1, 2)}
    assert external_keys(tmp_path / "out", [KT2], sources, 30) == {}  # other frames
    key = next(key for key in keys if key.preset == "final" and key.run == 2)
    notes, _ = measure(Paper(sources, [], {key: keys[key]}), store)
    assert notes[0].endswith("; 1 of iclnuim run")
    (found,) = store.read_all(PaperKey)
    assert found.key == key and found.figures["coverage"] == 1 and "surface" not in found.figures
    assert found.figures["ate_m"]["rmse"] == pytest.approx(rows["good"]["ate_rmse_m"], abs=1e-9)
    path = found.figures["path"]
    assert len(path["truth_m"]) == len(path["estimate_m"]) == len(path["error_m"]) == 60
    assert (found.folder / "trajectory.txt").is_file()


@pytest.mark.slow
def test_what_cannot_be_tracked_is_a_result_too(sources, store):
    """Frames without depth in 8 x 6 pixels of one grey."""
    measure(Paper(sources, [KT2], {}, first=3), store)
    (found,) = store.read_all(PaperKey)
    assert "failed" in found.figures and "ate_m" not in found.figures


def test_a_sequence_that_cannot_be_measured_is_named_with_what_makes_it(sources):
    assert sources.fault(KT2, None) == "" and sources.fault(KT2, 60) == ""
    assert "has 60 frames, expected at least 61" in sources.fault(KT2, 61)
    assert "iclnuim make living_room/kt3" in sources.fault(replace(KT2, trajectory="kt3"), None)


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
    (one,) = Paper(there, [cell], {}).cells()
    assert one.identity["model"] is None
    elsewhere = replace(sources, lambertian=tmp_path / "matt")
    assert (
        f"try: iclnuim make {cell.room}/kt2 --lambertian -o {tmp_path / 'matt'}/{cell.room}/kt2"
        in elsewhere.fault(cell, None)
    )


def test_a_cell_is_measured_again_for_other_images_frames_settings_or_code(
    sources, store, monkeypatch
):
    def missing(first=None):
        fresh = Sources(sources.data, sources.out)
        return len(store.missing(Paper(fresh, [KT2], {}, first).cells()))

    assert missing() == 1
    (cell,) = Paper(sources, [KT2], {}).cells()
    store.write(cell, {})
    assert missing() == 0 and missing(30) == 1
    with monkeypatch.context() as other:
        other.setattr(code_version, "code_of", lambda *names, **without: "other")
        assert missing() == 1
    content = json.loads(store.file(KT2).read_text())
    content["identity"]["fusion"] = {}
    store.file(KT2).write_text(json.dumps(content))
    assert missing() == 1
    store.write(cell, {})
    assert missing() == 0
    write_png(sources.folder(KT2) / "depth.png", np.full((6, 8), 999, np.uint16))
    assert missing() == 1


def test_code_of_surfaces_decides_surfaces_alone(sources, monkeypatch):
    """Neither fusion nor its comparison with the model counts where no surface is measured; fusion
    counts where frames are aligned with a model.
    """

    def identities():
        keys = [KT2, replace(KT2, reference="model")]
        cells = Paper(sources, keys, {}, surfaces=False).cells() + Paper(sources, keys, {}).cells()
        return [dict(cell.identity) for cell in cells]

    before = identities()
    for name, changed in (
        ("measure_surface", [False, False, True, True]),
        ("make_reference", [False, True, False, True]),
        ("measure", [True, True, True, True]),
    ):
        with monkeypatch.context() as other:
            whole = code_version.code_of

            def code_of(entry, without=(), name=name, whole=whole):
                if getattr(entry, "__name__", entry).split(":")[-1] == name:
                    return "other"
                return whole(entry, without=without)

            other.setattr("iclnuim.benchmark.experiments.recipes.paper.recipe.code_of", code_of)
            assert [a != b for a, b in zip(before, identities(), strict=True)] == changed


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


def test_trajectories_alone_are_enough_where_surfaces_are_not_asked_for(
    sources, store, monkeypatch
):
    """And a surface that is measured is not lost by asking for less."""
    monkeypatch.setattr(Sources, "model_name", lambda *_: KT2.room)
    monkeypatch.setattr(Sources, "model", lambda *_: Path("model.npz"))

    def cells(surfaces):
        return Paper(sources, [KT2], {}, surfaces=surfaces).cells()

    def missing(surfaces):
        return len(store.missing(cells(surfaces)))

    assert missing(True) == missing(False) == 1
    store.write(cells(False)[0], {})
    assert missing(False) == 0 and missing(True) == 1
    store.write(cells(True)[0], {})
    assert missing(False) == missing(True) == 0


def test_a_room_whose_triangles_cannot_be_read_has_no_surface_until_they_can(
    sources, store, run, fake, tmp_path, monkeypatch
):
    from iclnuim.errors import WorkError

    def broken(*_):
        raise WorkError("no Blender")

    run(fake("good"), folder=sources.folder(KT2))
    keys = external_keys(tmp_path / "out", [KT2], sources, None)
    monkeypatch.setattr(Sources, "model_name", lambda *_: KT2.room)
    monkeypatch.setattr(Sources, "model", broken)
    paper = Paper(sources, [], keys)
    notes, steps = measure(paper, store)
    assert "surfaces of living_room are not measured: no Blender" in notes[1] and steps == 0
    assert len(store.missing(paper.cells())) == len(keys) == len(store.read_all(PaperKey)) == 2
    assert "; of 2 only the surface is missing" in measure(paper, store)[0][0]


@pytest.fixture
def tracked(sources, store, monkeypatch):
    """A cell without a surface; its trajectory is moved, so that it is told from the truth."""
    monkeypatch.setattr(Sources, "model_name", lambda *_: KT2.room)
    monkeypatch.setattr(Sources, "model", lambda *_: Path("model.npz"))
    (cell,) = Paper(sources, [KT2], {}, surfaces=False).cells()
    with store.files(cell) as folder:
        (folder / "trajectory.txt").write_text("1 7 0 0 0 0 0 1\n2 8 0 0 0 0 0 1\n")
    store.write(cell, {"ate_m": {"rmse": 0.1}, "times": {"track_s": 2.0, "cpu_s": 3.0}})
    return store.read([cell])[0]


def test_a_surface_is_added_along_the_stored_trajectory(sources, store, tracked, monkeypatch):
    def measure_surface(task, truth, trajectory, folder, meter):
        (folder / "heat.jpg").write_text("drawn")
        meter.advance(60)
        return {"vertices": float(trajectory.positions_m[:, 0].sum()), "times": {"fuse_s": 4.0}}

    monkeypatch.setattr(paper_surface, "measure_surface", measure_surface)
    before = (tracked.folder / "trajectory.txt").stat().st_mtime_ns
    notes, steps = measure(Paper(sources, [KT2], {}), store)
    assert notes[0].endswith("; of 1 only the surface is missing") and steps == 60
    (found,) = store.read(Paper(sources, [KT2], {}).cells())
    assert found.figures["surface"] == {"vertices": 15.0}
    assert found.figures["ate_m"] == {"rmse": 0.1}
    times = found.figures["times"]
    assert times["track_s"] == 2.0 and times["fuse_s"] == 4.0 and times["cpu_s"] >= 3.0
    assert (tracked.folder / "trajectory.txt").stat().st_mtime_ns == before
    assert (tracked.folder / "heat.jpg").is_file()


def test_a_surface_that_fails_or_is_killed_leaves_the_trajectory(
    sources, store, tracked, monkeypatch
):
    paper, bare = Paper(sources, [KT2], {}), Paper(sources, [KT2], {}, surfaces=False)

    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(paper_surface, "measure_surface", killed)
    with pytest.raises(KeyboardInterrupt):
        measure(paper, store)
    assert store.read(bare.cells())[0].figures == tracked.figures

    def fails(*_):
        raise InputError("a surface", found="nothing")

    monkeypatch.setattr(paper_surface, "measure_surface", fails)
    measure(paper, store)
    (found,) = store.read(paper.cells())
    assert "expected a surface" in found.figures["failed"] and "ate_m" in found.figures


@pytest.mark.parametrize("changed", ["no file", "failed"])
def test_what_has_no_trajectory_is_tracked(sources, store, tracked, changed):
    paper = Paper(sources, [KT2], {})
    (cell,) = paper.cells()
    assert paper.tracked(cell, store) is not None
    only_surface_s = paper.core_seconds(cell, store)
    if changed == "no file":
        (tracked.folder / "trajectory.txt").unlink()
    else:
        store.write(replace(cell, identity=tracked.identity), {"failed": "lost", "times": {}})
    assert paper.tracked(cell, store) is None
    assert paper.core_seconds(cell, store) > only_surface_s > 0
