"""A path that is made through the scene in the window: Blender's tree against Embree and libigl, the
lens of the active camera, and what cannot be.
"""

from collections.abc import Iterator

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
pytest.importorskip("embreex")

from iclnuim import ui  # noqa: E402
from iclnuim.blender.render import camera as keyed_camera  # noqa: E402
from iclnuim.raycast.caster import RayCaster  # noqa: E402
from iclnuim.raycast.distance import TriangleDistance  # noqa: E402
from iclnuim.ui import state  # noqa: E402
from iclnuim.ui.surface_tree import SurfaceTree  # noqa: E402


def box(size: tuple, at: tuple) -> None:
    bpy.ops.mesh.primitive_cube_add(size=1, location=at)
    bpy.context.object.scale = size


@pytest.fixture
def room() -> Iterator[bpy.types.Scene]:
    """A room of 6 x 4 x 2.6 m with a table, and a camera of 50 mm."""
    bpy.ops.wm.read_factory_settings()
    ui.register()
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    for axis, side in enumerate((6.0, 4.0, 2.6)):
        for end in (0.0, side):
            at = [3.0, 2.0, 1.3]
            at[axis] = end
            size = [6.2, 4.2, 2.8]
            size[axis] = 0.1
            box(tuple(size), tuple(at))
    box((1.4, 0.8, 0.7), (3.0, 2.0, 0.35))
    scene = bpy.context.scene
    scene.camera.data.lens = 50.0
    scene.iclnuim.scene_source = "OPEN"
    yield scene
    bpy.ops.wm.read_factory_settings()
    ui.unregister()


def surface() -> tuple[np.ndarray, np.ndarray]:
    from iclnuim.blender import surfaces

    found = surfaces.triangles()
    return found.vertices, found.triangles


def test_blender_s_tree_measures_as_embree_and_libigl(room):
    shape = surface()
    rng = np.random.default_rng(0)
    points = rng.uniform((-1, -1, -1), (7, 5, 4), (300, 3))
    rays = rng.normal(size=(300, 2, 3))
    tree = SurfaceTree(*shape)
    assert tree.distance(points) == pytest.approx(
        TriangleDistance(*shape).distance(points), abs=1e-5
    )
    found, true = (by.cast(points[:, None].repeat(2, 1), rays) for by in (tree, RayCaster(*shape)))
    assert found.distance == pytest.approx(true.distance, rel=1e-4)
    assert found.normal == pytest.approx(true.normal, abs=1e-4)
    coplanar = found.triangle != true.triangle
    assert coplanar.mean() < 0.02


def test_a_made_path_keeps_clear_and_has_the_lens_of_the_active_camera(room):
    lens = keyed_camera.pinhole(room, room.camera)
    assert bpy.ops.iclnuim.make_path(count=4, clearance=0.3, seed=3) == {"FINISHED"}
    assert room.iclnuim.trajectory_source == "CAMERA"
    assert room.camera.name == keyed_camera.NAME
    made = room.iclnuim.camera()
    assert (made.width, made.height) == (lens.width, lens.height)
    assert made.fx == pytest.approx(lens.fx, abs=1e-3)
    poses = keyed_camera.trajectory(room)
    assert len(poses) == room.frame_end + 1 > 200
    assert TriangleDistance(*surface()).distance(poses.positions_m).min() >= 0.3 - 1e-4
    assert not state.current().trajectory_warning


def test_the_same_settings_make_the_same_path_and_one_camera(room):
    positions = []
    for _ in range(2):
        bpy.ops.iclnuim.make_path(count=3, seed=5)
        positions.append(keyed_camera.trajectory(room).positions_m)
    assert (positions[0] == positions[1]).all()
    assert sum(thing.name.startswith(keyed_camera.NAME) for thing in bpy.data.objects) == 1


def test_the_path_leads_through_the_selected_empties(room):
    bpy.ops.object.select_all(action="DESELECT")
    places = np.array([(1.0, 1.0, 1.5), (5.0, 1.0, 1.4), (5.0, 3.0, 1.6)])
    for name, place in zip("cba", places[::-1], strict=True):
        empty = bpy.data.objects.new(name, None)
        empty.location = place
        room.collection.objects.link(empty)
        empty.select_set(True)
    bpy.context.view_layer.update()
    assert bpy.ops.iclnuim.make_path(shake=0.0) == {"FINISHED"}
    path = keyed_camera.trajectory(room).positions_m
    away_m = np.linalg.norm(path[:, None] - places, axis=-1)
    assert away_m.min(0) == pytest.approx(0, abs=0.02)
    assert (np.diff(away_m.argmin(0)) > 0).all()


def test_what_cannot_be_is_said_in_a_line(room):
    operator = bpy.ops.iclnuim.make_path
    assert operator(clearance=3.0) == {"CANCELLED"}
    assert "a smaller Clearance" in state.current().work.message
    room.iclnuim.scene_source = "living_room"
    assert not operator.poll()
    room.iclnuim.scene_source = "OPEN"
    bpy.ops.object.mode_set(mode="EDIT")
    assert not operator.poll()
