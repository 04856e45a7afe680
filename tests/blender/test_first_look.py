"""A user-provided scene's first look: the preview, the choice between baked light and path tracing,
and that neither changes a frame.
"""

import json
import re
import shutil

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim import render_ways, shipped  # noqa: E402
from iclnuim.blender.render import worker  # noqa: E402
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.formats.png import read_rgb8  # noqa: E402
from iclnuim.geometry.camera import PinholeCamera  # noqa: E402
from iclnuim.job import RenderJob  # noqa: E402
from iclnuim.sensor.transfer import srgb8  # noqa: E402
from iclnuim.sequences.frame_source import read_frame  # noqa: E402
from iclnuim.worker_events import Note  # noqa: E402

CAMERA = PinholeCamera.parse("64x48")


@pytest.fixture
def begun(cornered_room, forward_path, tmp_path, monkeypatch):
    """`begun(folder, asked, frames, bake, **settings)`: the run folder, its recipe's job, the notes."""
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))

    def begin(folder, asked, frames=(), bake=False, **settings):
        notes = []
        out = tmp_path / folder
        given = {"scene": str(cornered_room), "trajectory": str(forward_path), **settings}
        job = RenderJob("test", camera=CAMERA, **given)

        def take(event):
            if isinstance(event, Note):
                notes.append(event.text)

        with worker.Session(job, out, take, requested=asked) as session:
            if bake:
                session.bake()
            session.render(frames, lambda: False)
        return out, json.loads((out / "sequence.json").read_text())["job"], notes

    return begin


def test_the_cheapest_way_that_holds_is_chosen_and_the_run_keeps_it(begun):
    out, job, notes = begun("run", [0, 1], [0], light="auto")
    record = json.loads((out / "first_look.json").read_text())
    way = record["ways"][record["chosen"]]
    assert (job["light"], job["samples"]) == (way["light"], way["samples"])
    assert way["psnr_db"] >= 40 and record["views"] == [0], "more would take too long"
    assert way["core_s"] == min(w["core_s"] for w in record["ways"] if w["psnr_db"] >= 40)
    words = r"light: path traced with \d+ samples?, about .* for 2 frames, .* dB: the cheapest way"
    assert any(re.match(words, note) for note in notes)
    assert f"preview of frame 0, path traced with 16 samples: {out}/preview.png" in "".join(notes)
    picture = read_rgb8(out / "preview.png")
    assert picture.shape == (48, 64, 3) and picture.std() > 5
    _, again, notes = begun("run", [0] * 10**6, light="auto")
    assert again == job and not any("preview" in note for note in notes)
    assert "light: path, as when this run was started" in notes
    plain, *_ = begun("plain", [0], [0], light="path", samples=job["samples"])
    assert not (plain / "preview.png").exists()
    assert (plain / "exr/000000.exr").read_bytes() == (out / "exr/000000.exr").read_bytes()


def test_nothing_is_looked_at_where_the_samples_are_given(begun):
    out, job, notes = begun("run", [0], light="auto", samples=3)
    assert (job["light"], job["samples"]) == ("path", 3)
    assert not (out / "preview.png").exists() and not (out / "first_look.json").exists()
    assert "light: path, 3 samples" in notes


def test_the_best_way_in_a_time_is_chosen(begun):
    _, job, notes = begun("run", [0, 1], light="auto", quality="2h")
    assert (job["quality"], job["samples"]) == ("2h", 1024)
    assert any("the best way in 2h" in note for note in notes)
    _, job, notes = begun("fast", [0, 1], light="auto", quality="0.001s")
    assert job["samples"] == 1
    assert any("the fastest way, none holds 0.001s" in note for note in notes)


def test_a_psnr_that_no_way_holds_is_said(begun):
    _, job, notes = begun("run", [0, 1], light="auto", quality="90dB")
    assert job["samples"] == 1024
    assert any("the best way, none holds 90dB" in note for note in notes)


def test_the_predicted_error_is_that_of_frames(begun):
    """Of views that the look has not seen, against many samples of another seed; and it takes less
    than a tenth of what it announces, in core-seconds.
    """
    numbers = [0, 3, 6, 9, 11]
    unseen = [3, 9]
    out, _, _ = begun("look", sorted(numbers * 200), light="auto")
    record = json.loads((out / "first_look.json").read_text())
    assert record["core_s"] < 0.1 * record["ways"][record["chosen"]]["core_s"]
    assert record["views"] == [0, 6, 11] and record["window"] == [64, 48]
    truth, *_ = begun("truth", [], unseen, light="path", samples=1024, seed=1)
    for way in record["ways"]:
        if way["light"] == "path" and way["samples"] in (4, 16):
            name = str(way["samples"])
            run, *_ = begun(name, [], unseen, light="path", samples=way["samples"])
            images = [
                srgb8(np.array([read_frame(folder / f"exr/{n:06}.exr", CAMERA)[0] for n in unseen]))
                for folder in (truth, run)
            ]
            found_db = render_ways.psnr_db(render_ways.square(*images))
            assert -5 < way["psnr_db"] - found_db < 2


def test_a_built_in_scene_without_a_light_map_is_lit_as_an_own_one(
    begun, cornered_room, tmp_path, monkeypatch
):
    """And a resumed run does not choose again."""
    (tmp_path / "blend").mkdir()
    shutil.copy(cornered_room, tmp_path / "blend/box.blend")
    entry = shipped.SceneEntry("box", "Box", "a box")
    monkeypatch.setattr(shipped, "SCENES", {**shipped.SCENES, "box": entry})
    monkeypatch.setattr(shipped, "SCENE_NAMES", tuple(shipped.SCENES))
    monkeypatch.setattr(shipped, "folder", lambda name: tmp_path / name)
    out, job, notes = begun("run", [0], [0], scene="box", light="auto")
    assert (job["scene"], job["light"]) == ("box", "path")
    assert any("light: path traced with" in note for note in notes)
    assert (out / "exr/000000.exr").is_file()
    _, again, notes = begun("run", [0] * 10**6, scene="box", light="auto")
    assert again == job and "light: path, as when this run was started" in notes


def test_a_light_map_is_measured_after_its_bake_and_the_sentence_is_corrected(begun):
    """Many frames pay for a map, if a low quality is asked for."""
    given = {"light": "auto", "map_size": 256, "map_samples": 2, "quality": "37dB"}
    out, job, notes = begun("run", [0] * 10**6, bake=True, **given)
    assert (job["light"], job["samples"], job["denoise"]) == ("baked", 1, False)
    assert any("light: baked with a map of 256 texels a side, about" in note for note in notes)
    record = json.loads((out / "first_look.json").read_text())
    expected_db = record["ways"][record["chosen"]]["psnr_db"]
    found = f"has {record['measured_db']:.0f} dB, {expected_db:.0f} dB were expected"
    held = ": it does not hold 37dB" * (record["measured_db"] < 37)
    assert notes[-1] == f"light: baked with a map of 256 texels a side, {found}{held}"
    assert record["measured_db"] > 20


@pytest.fixture
def dark(cornered_room, tmp_path):
    """The room with a lamp that is too weak to be seen."""
    bpy.ops.wm.open_mainfile(filepath=str(cornered_room))
    bpy.data.lights[0].energy = 1e-6
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "dark.blend"))
    return str(tmp_path / "dark.blend")


@pytest.mark.parametrize(("light", "left"), [("baked", "preview.png"), ("path", "exr/000000.exr")])
def test_a_run_that_begins_black_stops_and_goes_on_if_asked_again(begun, dark, light, left):
    """Before a light map is baked; of a path-traced run after its first frame."""
    given = {"light": light, "samples": 1, "scene": dark, "map_size": 32, "map_samples": 2}
    with pytest.raises(
        InputError, match="not black, found no light reaches .*try the same command"
    ):
        begun("run", [0, 1, 2], [0, 1, 2], **given)
    out, *_ = begun("run", [0, 1, 2], [0, 1, 2], **given)
    assert (out / left).exists() and (out / "exr/000002.exr").exists()


def test_a_preview_does_not_change_baked_frames(begun):
    small = {"light": "baked", "map_size": 32, "map_samples": 2}
    first, *_ = begun("with", [0], [0], **small)
    second, *_ = begun("without", [], [0], **small)
    assert (first / "preview.png").exists() and not (second / "preview.png").exists()
    assert (first / "exr/000000.exr").read_bytes() == (second / "exr/000000.exr").read_bytes()
