"""What saving and opening a file does to the panel and to the images that it made."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim import ui  # noqa: E402
from iclnuim.ui import image_editor, operators, state  # noqa: E402


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
