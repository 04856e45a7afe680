"""A user-provided scene's first look: the preview, the choice between baked light and path tracing,
and that neither changes a frame.
"""

import json
import shutil

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim import shipped  # noqa: E402
from iclnuim.blender.render import worker  # noqa: E402
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.formats.png import read_rgb8  # noqa: E402
from iclnuim.geometry.camera import PinholeCamera  # noqa: E402
from iclnuim.job import RenderJob  # noqa: E402
from iclnuim.worker_events import Note  # noqa: E402


@pytest.fixture
def begun(cornered_room, forward_path, tmp_path, monkeypatch):
    """`begun(folder, asked, frames, **settings)`: the run folder, its recipe's job, the notes."""
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))

    def begin(folder, asked, frames=(), **settings):
        notes = []
        out = tmp_path / folder
        given = {"scene": str(cornered_room), "trajectory": str(forward_path), **settings}
        job = RenderJob("test", camera=PinholeCamera.parse("64x48"), **given)

        def take(event):
            if isinstance(event, Note):
                notes.append(event.text)

        with worker.Session(job, out, take, requested=asked) as session:
            session.render(frames, lambda: False)
        return out, json.loads((out / "sequence.json").read_text())["job"], notes

    return begin


def test_a_bake_that_would_not_pay_is_not_begun_and_the_run_keeps_its_light(begun):
    out, job, notes = begun("run", [0], [0], light="auto", samples=4)
    assert (job["light"], job["samples"]) == ("path", 4)
    choice = next(note for note in notes if "light: path traced" in note)
    assert "1 frame:" in choice and "light baked" in choice
    assert f"preview of frame 0, path traced with 16 samples: {out}/preview.png" in "".join(notes)
    picture = read_rgb8(out / "preview.png")
    assert picture.shape == (48, 64, 3) and picture.std() > 5
    _, again, notes = begun("run", [0] * 10**6, light="auto", samples=4)
    assert again == job and not any("preview" in note for note in notes)
    plain, _, notes = begun("plain", [0], [0], light="path", samples=4)
    assert not (plain / "preview.png").exists()
    assert (plain / "exr/000000.exr").read_bytes() == (out / "exr/000000.exr").read_bytes()


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
    out, job, notes = begun("run", [0], [0], scene="box", light="auto", samples=4)
    assert (job["scene"], job["light"]) == ("box", "path")
    assert any("light: path traced, which takes less time (1 frame:" in note for note in notes)
    assert (out / "exr/000000.exr").is_file()
    _, again, notes = begun("run", [0] * 10**6, scene="box", light="auto", samples=4)
    assert again == job and "light: path, as when this run was started" in notes


def test_many_frames_are_baked(begun):
    _, job, notes = begun("run", [0] * 10**6, light="auto")
    assert (job["light"], job["samples"], job["denoise"]) == ("baked", 1, False)
    assert any("light: baked, which takes less time (1000000 frames:" in note for note in notes)


@pytest.fixture
def dark(cornered_room, tmp_path):
    """The room with a lamp that is too weak to be seen."""
    bpy.ops.wm.open_mainfile(filepath=str(cornered_room))
    bpy.data.lights[0].energy = 1e-6
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "dark.blend"))
    return str(tmp_path / "dark.blend")


@pytest.mark.parametrize(("light", "left"), [("auto", "preview.png"), ("path", "exr/000000.exr")])
def test_a_run_that_begins_black_stops_and_goes_on_if_asked_again(begun, dark, light, left):
    """Before a light map is baked; of a path-traced run after its first frame."""
    given = {"light": light, "samples": 1, "scene": dark}
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
