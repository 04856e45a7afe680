"""What the panels draw, noted by a layout of ours: every panel in every state, without an error."""

from types import SimpleNamespace
from typing import Any

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim import ui  # noqa: E402
from iclnuim.ui import panels, state  # noqa: E402


class Layout:
    """Notes the texts and properties that are drawn; `drawn` is shared with its parts."""

    def __init__(self, drawn: list[str]) -> None:
        self.drawn = drawn

    def part(self, *_: Any, **words: Any) -> "Layout":
        self.drawn += [str(words[key]) for key in ("text", "heading") if key in words]
        return Layout(self.drawn)

    column = row = split = label = operator = popover = progress = menu = part

    def prop(self, settings: Any, name: str, **words: Any) -> None:
        assert hasattr(settings, name)
        self.drawn.append(name)


@pytest.fixture
def draw():
    """`draw()`: everything that all panels draw, with settings that were set before."""
    ui.register()
    settings = bpy.context.scene.iclnuim
    for name in [p.identifier for p in settings.bl_rna.properties]:
        settings.property_unset(name)

    def drawn() -> list[str]:
        layout = Layout([])
        for panel in panels._PANELS:
            panel.draw(SimpleNamespace(layout=layout), bpy.context)
        return layout.drawn

    yield drawn
    ui.unregister()


@pytest.mark.parametrize("scene", ["living_room", "OPEN", "FILE"])
@pytest.mark.parametrize("light", ["baked", "path", "auto"])
@pytest.mark.parametrize("trajectory", ["kt2", "FILE", "CAMERA"])
def test_every_panel_is_drawn_with_every_source(draw, scene: str, light: str, trajectory: str):
    settings = bpy.context.scene.iclnuim
    settings.scene_source = scene
    settings.light = light
    settings.trajectory_source = trajectory
    drawn = draw()
    assert {"scene_source", "denoise", "depth_noise", "out", "formats"} <= set(drawn)
    of_the_panel = trajectory != "CAMERA" or bpy.context.scene.camera is None
    assert ("fx" in drawn) == of_the_panel
    assert ("map_size" in drawn) == (light != "path")
    assert ("scene_file" in drawn) == (scene == "FILE")


def test_a_number_of_0_is_drawn_as_auto(draw):
    settings = bpy.context.scene.iclnuim
    assert "samples" not in draw() and draw().count("Auto") == 2
    settings.samples = 5
    assert "samples" in draw() and draw().count("Auto") == 1


def test_progress_is_drawn_in_finished_frames(draw):
    work = state.current().work
    work.phase = "rendering"
    work.done = 12
    work.total = 60
    work.message = "stopped; finished frames stay"
    assert {"Rendering: 12 of 60 frames", "Stopped; finished frames stay"} <= set(draw())
    work.total = 1
    assert "Rendering" in draw()
    work.phase = "idle"


def test_the_trajectory_is_read_once_after_the_panel_was_drawn_for_a_scene(draw):
    panel = state.current()
    draw()
    draw()
    assert len(panel.waiting) == 1
    first = bpy.context.window.scene
    bpy.context.window.scene = bpy.data.scenes.new("Another")
    draw()
    draw()
    assert len(panel.waiting) == 2
    bpy.data.scenes.remove(bpy.context.window.scene)
    assert bpy.context.window.scene == first
