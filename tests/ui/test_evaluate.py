"""The evaluation of the panel: what it says of poses that are far apart, and of a file without poses."""

from collections.abc import Iterator
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim import ui  # noqa: E402
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory  # noqa: E402
from iclnuim.ui import state  # noqa: E402


@pytest.fixture
def settings() -> Iterator[bpy.types.PropertyGroup]:
    ui.register()
    yield bpy.context.scene.iclnuim
    bpy.ops.wm.read_factory_settings()
    ui.unregister()


def test_poses_farther_apart_than_the_delta_have_an_ate(settings, tmp_path: Path):
    from iclnuim import shipped

    poses = read_trajectory(shipped.trajectory_file("living_room/kt2")).trajectory
    write_trajectory(tmp_path / "est.txt", poses[::60], "tum")
    settings.estimate = str(tmp_path / "est.txt")
    assert bpy.ops.iclnuim.evaluate() == {"FINISHED"}
    lines = state.current().evaluation_lines
    assert lines[0] == "ATE rmse 0.000 mm"
    assert any("RPE over 1s: none" in line for line in lines)
    settings.delta = "2s"
    bpy.ops.iclnuim.evaluate()
    assert any("RPE over 2s: 0.000 mm" in line for line in state.current().evaluation_lines)


def test_an_error_stands_below_the_button(settings, tmp_path: Path):
    empty = tmp_path / "empty.txt"
    empty.write_text("")
    settings.estimate = str(empty)
    assert bpy.ops.iclnuim.evaluate() == {"CANCELLED"}
    assert state.current().evaluation_lines == []
    assert state.current().evaluation_warnings == [state.current().work.message]
