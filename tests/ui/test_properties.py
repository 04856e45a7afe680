"""The panel's properties: made of the declarations and registries, so that a new entry appears
without a line in the panel.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.evaluation.align import METHODS
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.job import RenderJob
from iclnuim.settings import declared

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim import shipped, ui  # noqa: E402
from iclnuim.sensor import models  # noqa: E402
from iclnuim.sequences import sequence_formats  # noqa: E402
from iclnuim.sequences.sequence_options import SequenceOptions  # noqa: E402
from iclnuim.trajectory_files.trajectories import read_trajectory  # noqa: E402
from iclnuim.ui import inputs, presets, properties, state  # noqa: E402


@pytest.fixture
def register():
    """Registers the panel and returns its settings, all at their defaults."""

    def registered():
        ui.register()
        settings = bpy.context.scene.iclnuim
        for name in [p.identifier for p in settings.bl_rna.properties]:
            settings.property_unset(name)
        return settings

    yield registered
    ui.unregister()


def items(settings, name):
    return {
        item.identifier: item.description for item in settings.bl_rna.properties[name].enum_items
    }


def test_new_entries_of_the_registries_appear_in_the_panel(register, monkeypatch):
    class FakeNoise(models.DEPTH_MODELS["none"]):
        name, summary = "fake", "no noise at all"

    monkeypatch.setitem(models.DEPTH_MODELS, "fake", FakeNoise)
    monkeypatch.setitem(models.RGB_MODELS, "fake", FakeNoise)
    tum = sequence_formats.FORMATS["tum"]
    fake = dataclasses.replace(tum, name="fake", description="like TUM")
    monkeypatch.setitem(sequence_formats.FORMATS, "fake", fake)
    monkeypatch.setitem(shipped.SCENES, "cellar", shipped.SceneEntry("cellar", "Cellar", "dark"))
    monkeypatch.setitem(shipped.TRAJECTORIES, "kt4", "a fifth")
    monkeypatch.setitem(METHODS, "fake", "no alignment")
    settings = register()
    assert (
        items(settings, "depth_noise")["fake"]
        == items(settings, "rgb_noise")["fake"]
        == "No noise at all"
    )
    assert items(settings, "formats")["fake"] == "Like TUM"
    assert items(settings, "scene_source")["cellar"] == "dark"
    assert items(settings, "trajectory_source")["kt4"] == "a fifth"
    assert items(settings, "align_method")["fake"] == "No alignment"
    settings.depth_noise, settings.formats, settings.scene_source = (
        "fake",
        {"fake", "tum"},
        "cellar",
    )
    assert SequenceOptions(**settings.values_of(SequenceOptions)).formats == ("tum", "fake")
    numbers = {
        item.identifier: item.value
        for item in settings.bl_rna.properties["scene_source"].enum_items
    }
    assert numbers == {
        "living_room": 0,
        "office": 1,
        "OPEN": 2,
        "FILE": 3,
        "cellar": 4,
    }  # saved files keep theirs


def test_a_new_setting_of_a_job_appears_in_the_panel(register, monkeypatch):
    known = declared(RenderJob)
    fake = dataclasses.replace(
        known["map_size"],
        name="fake",
        label="Fake",
        default=64,
        help="new",
        unit="px",
        shown=("px", 1.0),
    )
    with_fake = {**known, "fake": fake}
    monkeypatch.setattr(
        properties, "declared", lambda group: with_fake if group is RenderJob else declared(group)
    )
    settings = register()
    assert settings.fake == 64 and settings.bl_rna.properties["fake"].description == "New"
    assert settings.values_of(RenderJob)["fake"] == 64


@pytest.mark.parametrize("group", [RenderJob, PinholeCamera, SequenceOptions, SceneReading])
def test_defaults_and_ranges_are_those_of_the_declarations(register, group):
    settings = register()
    values = settings.values_of(group)
    for name, setting in declared(group).items():
        if name in ("depth_noise", "rgb_noise"):
            assert values[name] == "released"  # the panel's own default
        elif name in ("unit_m", "textures"):
            assert getattr(settings.reading(), name) is None
        elif setting.kind is float:
            assert values[name] == pytest.approx(setting.default, abs=1e-4)
        else:
            assert values[name] == setting.default
    if group is RenderJob:
        size = settings.bl_rna.properties["map_size"]
        assert (size.hard_min, size.hard_max) == (16, 16384)
        assert settings.bl_rna.properties["exposure_ms"].hard_max == 1000


def test_numbers_show_their_units(register):
    shown = register().bl_rna.properties
    assert (shown["exposure_ms"].name, shown["depth_units"].name) == (
        "Exposure (ms)",
        "Depth (1/m)",
    )
    pixels = ("width", "fx", "cy", "map_size")
    assert {shown[name].subtype for name in pixels} == {"PIXEL"}
    assert shown["start_location"].subtype == "TRANSLATION"


def test_settings_that_an_older_version_saved_in_a_blend_still_exist(register):
    saved = """scene_source scene_file scene_up scene_unit scene_mirror scene_textures estimate truth
    scene_allow_outside trajectory_source trajectory_file out scale use_start start_location delta
    start_rotation show_path write_clean write_noisy frames width height fx fy cx cy depth_noise
    rgb_noise seed depth_units formats light samples denoise antialias mipmaps lambertian map_size
    map_samples exposure_ms readout_ms ground_truth glass align_method align_first align_up"""
    assert set(saved.split()) <= set(register().bl_rna.properties.keys())


def test_labels_and_choices_begin_with_capitals(register):
    settings = register()
    for shown in settings.bl_rna.properties:
        assert shown.name[:1].isupper(), shown.identifier
    assert {"Paper", "None"} <= {
        item.name for item in settings.bl_rna.properties["depth_noise"].enum_items
    }


def test_the_job_of_untouched_settings_is_the_benchmarks(register):
    job = register().to_job("living_room", "living_room/kt2")
    assert job == RenderJob("living_room/kt2", "living_room", "living_room/kt2")


def test_what_is_set_reaches_the_job_in_the_librarys_units(register):
    settings = register()
    settings.exposure_ms, settings.samples, settings.denoise, settings.lambertian = (
        10.0,
        7,
        "OFF",
        True,
    )
    settings.scene_source, settings.scene_up, settings.scene_unit, settings.scene_mirror = (
        "FILE",
        "-y",
        "cm",
        "x",
    )
    job = settings.to_job("/a.obj", "/a.txt")
    assert (job.exposure_s, job.samples, job.denoise, job.lambertian) == (0.01, 7, False, True)
    assert job.reading == SceneReading("-y", 0.01, "x")


def test_errors_name_the_panels_labels(register):
    register()
    with pytest.raises(InputError) as error:
        RenderJob("a", "b", "c", map_size=1)
    assert error.value.worded(properties.label_of).startswith("Map Size: expected")
    assert [properties.label_of(name) for name in ("out", "exposure_s", "up", "scene", "unknown")] == [
        "Output Folder", "Exposure", "Up", "Scene", "unknown",
    ]  # fmt: skip


def test_presets_hold_only_differences_and_leave_this_files_settings_alone(register):
    settings = register()
    settings.seed, settings.scene_source, settings.out = 3, "office", "/x"
    assert presets.values(settings) == {"seed": 3}
    presets.apply(settings, presets.BUILT_IN["Quick look"])
    assert (settings.seed, settings.scene_source, settings.out) == (0, "office", "/x")
    assert settings.camera() == PinholeCamera.parse("320x240")
    presets.apply(settings, {"formats": ["euroc", "tum"], "align_method": "sim3"})
    assert settings.formats == {"euroc", "tum"} and settings.align_method == "sim3"
    assert settings.light == "baked"
    with pytest.raises(InputError, match="colour"):
        presets.apply(settings, {"colour": 1})
    with pytest.raises(InputError, match="light"):
        presets.apply(settings, {"light": "moon"})


def test_a_path_saved_under_a_name_without_ending_is_a_txt_and_the_message_names_it(
    register, tmp_path
):
    register()
    bpy.ops.iclnuim.save_path(filepath=str(tmp_path / "kept"))
    assert [p.name for p in tmp_path.iterdir()] == ["kept.txt"]
    assert state.current().work.message.endswith(" kept.txt")


def test_open_folder_names_the_folder_for_who_has_no_file_manager(register, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    register().out = str(tmp_path)
    bpy.ops.iclnuim.open_folder()
    assert state.current().work.message == f"the output folder is {tmp_path}"


@pytest.mark.parametrize("name", ["My preset", "Benchmark"])
def test_the_panel_is_drawn_again_with_what_a_button_says(name, register, monkeypatch):
    register()
    redrawn: list[str] = []
    monkeypatch.setattr(state, "redraw", redrawn.append)
    monkeypatch.setattr(presets, "write_json", lambda *_: None)
    bpy.ops.iclnuim.preset_save(preset=name)
    assert redrawn == ["UI"]


def test_nothing_is_left_after_unregistering(register):
    register()
    ui.unregister()
    assert not hasattr(bpy.types.Scene, "iclnuim") and not hasattr(
        bpy.types.WindowManager, "iclnuim_state"
    )
    ui.register()


def test_files_of_the_user_in_the_output_folder_are_left_alone(register, tmp_path):
    settings, mine = register(), b"\xff my notes"
    poses = "".join(f"{1 + i / 30:.6f} {i / 10} 0 0 0 0 0 1\n" for i in range(3))
    chosen = tmp_path / "trajectory.txt"
    chosen.write_text(poses)
    (tmp_path / "scene.blend").write_bytes(mine)
    settings.trajectory_source, settings.trajectory_file, settings.scale = "FILE", str(chosen), 0.5
    written = {inputs.job(bpy.context, tmp_path).trajectory for _ in range(2)}
    assert len(written) == 1 and chosen.read_text() == poses
    assert read_trajectory(*written).trajectory.positions_m[-1, 0] == pytest.approx(0.1)
    settings.scale = 0.25
    assert (
        inputs.job(bpy.context, tmp_path).trajectory not in written
    )  # that of the earlier run stays
    settings.scene_source = "OPEN"
    saved = {inputs.job(bpy.context, tmp_path).scene for _ in range(2)}
    assert len(saved) == 1 and Path(*saved).read_bytes()[:7] == b"BLENDER"  # not compressed
    assert (tmp_path / "scene.blend").read_bytes() == mine
    (tmp_path / "raw/exr").mkdir(parents=True)
    (tmp_path / "raw/exr/000000.exr").touch()
    with pytest.raises(InputError, match="without frames of an earlier state of the open scene"):
        inputs.job(bpy.context, tmp_path)


@pytest.fixture
def own_camera(register):
    """The settings, and an active camera of 50 mm in a render of 800 x 600 at half size."""
    settings = register()
    scene = bpy.context.scene
    before = scene.camera
    thing = bpy.data.objects.new("own", bpy.data.cameras.new("own"))
    scene.collection.objects.link(thing)
    scene.camera = thing
    render = scene.render
    size = render.resolution_x, render.resolution_y, render.resolution_percentage
    render.resolution_x, render.resolution_y, render.resolution_percentage = 800, 600, 50
    thing.data.lens, thing.data.sensor_width = 50, 36
    settings.trajectory_source = "CAMERA"
    yield settings, thing
    render.resolution_x, render.resolution_y, render.resolution_percentage = size
    scene.camera = before
    bpy.data.objects.remove(thing)


def test_the_active_cameras_lens_and_the_renders_size_are_used(own_camera):
    settings, thing = own_camera
    lens = settings.camera()
    assert (lens.width, lens.height) == (400, 300)
    assert (lens.fx, abs(lens.fy)) == pytest.approx((400 * 50 / 36,) * 2, abs=1e-3)
    settings.trajectory_source = "kt2"
    assert settings.camera() == PinholeCamera()
    settings.trajectory_source = "CAMERA"
    thing.data.type = "ORTHO"
    with pytest.raises(InputError, match="a perspective camera, found ORTHO"):
        settings.camera()


def test_a_camera_that_stands_still_and_a_path_of_another_room_are_said(own_camera):
    settings, thing = own_camera
    assert "stands still" in inputs.trajectory(bpy.context).read_as.sentence
    thing.keyframe_insert("location", frame=1)
    thing.location.x += 1
    thing.keyframe_insert("location", frame=20)
    assert "stands still" not in inputs.trajectory(bpy.context).read_as.sentence
    settings.trajectory_source, settings.scene_source = "kt2", "OPEN"
    assert "another room" in inputs.trajectory(bpy.context).read_as.sentence
    settings.scene_source = "office"
    assert inputs.trajectory(bpy.context).read_as.sentence == "office/kt2"


def test_a_path_is_scaled_about_its_start_also_where_it_is_not_moved(register):
    settings = register()
    settings.trajectory_source = "kt2"
    as_it_is, settings.scale = inputs.trajectory(bpy.context).trajectory.positions_m, 0.5
    scaled = inputs.trajectory(bpy.context).trajectory.positions_m
    np.testing.assert_allclose(scaled - as_it_is[0], (as_it_is - as_it_is[0]) / 2, atol=1e-9)
