"""What saving, opening and undo do to the panel and its images; what a shown scene leaves behind."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim import ui  # noqa: E402
from iclnuim.ui import image_editor, operators, shown_scene, state  # noqa: E402


@pytest.fixture
def saved(tmp_path: Path) -> Iterator[Path]:
    """A saved and opened file with an evaluation and its plot."""
    ui.register()
    image_editor.show(bpy.context, operators.PLOT, np.full((4, 6, 3), 51, np.uint8))
    bpy.data.images[operators.PLOT].use_fake_user = True
    state.current().evaluation_lines = ["ATE rmse 1 mm"]
    file = tmp_path / "film.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.wm.open_mainfile(filepath=str(file))
    yield file
    bpy.ops.wm.read_factory_settings()
    ui.unregister()


def test_the_plot_is_saved_and_the_evaluation_is_not(saved: Path):
    assert bpy.data.images[operators.PLOT].pixels[0] == pytest.approx(51 / 255)
    assert state.current().evaluation_lines == []


def test_the_open_file_cannot_be_loaded_into_itself(saved: Path):
    settings = bpy.context.scene.iclnuim
    settings.scene_source = "FILE"
    settings.scene_file = str(saved)
    assert not bpy.ops.iclnuim.load_scene.poll()
    settings.scene_file = str(saved.with_name("another.blend"))
    assert bpy.ops.iclnuim.load_scene.poll()


def test_a_removed_scene_leaves_nothing_behind(saved: Path):
    bpy.context.scene.iclnuim.scene_source = "office"
    before = set(bpy.data.user_map())
    bpy.ops.iclnuim.load_scene()
    used = next(m for m in set(bpy.data.materials) - before if m.users)
    bpy.data.meshes["Cube"].materials.append(used)
    bpy.ops.iclnuim.remove_scene()
    left = set(bpy.data.user_map()) - before
    assert {block for block in left if block.id_type not in ("IMAGE", "LIBRARY")} == {used}


def test_a_shown_scene_keeps_no_driver_that_needs_python(saved: Path):
    """Not even in a session that lets scripts run."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    world = bpy.context.scene.world = bpy.data.worlds.new("sky")
    mesh, lamp = bpy.data.meshes.new("box"), bpy.data.lights.new("lamp", "POINT")
    for data in (mesh, lamp):
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(data.name, data))
    world.driver_add("color", 0).driver.expression = "len(str(print))"
    lamp.driver_add("energy").driver.expression = "len(str(print))"
    lamp.driver_add("cutoff_distance").driver.expression = "2 * frame"
    if world.node_tree is None:
        world.use_nodes = True
    sky = world.node_tree.nodes["Background"].inputs["Strength"]
    sky.driver_add("default_value").driver.expression = "len(str(print))"
    file = saved.with_name("driven.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    settings = bpy.context.scene.iclnuim
    settings.scene_source, settings.scene_file = "FILE", str(file)
    assert bpy.ops.iclnuim.load_scene() == {"FINISHED"}
    shown = [bpy.context.scene.world, bpy.data.lights["lamp"]]
    owners = [*shown, shown[0].node_tree]
    drivers = [owner.animation_data.drivers for owner in owners]
    assert [[curve.data_path for curve in found] for found in drivers] == [
        [],
        ["cutoff_distance"],
        [],
    ]


def test_undo_shows_what_the_views_hid_for_a_scene(saved: Path):
    (area,) = state.areas("VIEW_3D")
    overlay = area.spaces.active.overlay
    bpy.context.scene.iclnuim.scene_source = "office"
    bpy.ops.iclnuim.load_scene()
    assert not overlay.show_extras
    collection = bpy.data.collections[shown_scene.trajectory_view.COLLECTION]
    bpy.data.collections.remove(collection)
    shown_scene._undone()
    assert overlay.show_extras
    bpy.data.collections.new(shown_scene.trajectory_view.COLLECTION)
    shown_scene._undone()
    assert not overlay.show_extras


def test_a_file_that_cannot_be_read_leaves_no_collection(saved: Path):
    file = saved.with_name("bad.glb")
    file.write_bytes(b"glTF")
    settings = bpy.context.scene.iclnuim
    settings.scene_source = "FILE"
    settings.scene_file = str(file)
    before = set(bpy.data.user_map())
    assert bpy.ops.iclnuim.load_scene() == {"CANCELLED"}
    assert set(bpy.data.user_map()) == before
