"""What the camera of a scene has besides poses and one lens is named."""

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
from iclnuim.blender.render import camera  # noqa: E402
from iclnuim.blender.render.camera_notes import camera_notes  # noqa: E402


@pytest.fixture
def scene():
    """Two cameras, the first of which is active and moves, over ten frames."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    here = bpy.context.scene
    here.frame_start = 1
    here.frame_end = 10
    for name in ("first", "second"):
        thing = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        here.collection.objects.link(thing)
    here.camera = bpy.data.objects["first"]
    for frame, x in ((1, 0.0), (10, 2.0)):
        here.camera.location.x = x
        here.camera.keyframe_insert("location", frame=frame)
    return here


def marked(scene, *places) -> None:
    for frame, name in places:
        scene.timeline_markers.new(name, frame=frame).camera = bpy.data.objects[name]


def animated(block, path: str, values) -> None:
    for frame, value in zip((1, 10), values, strict=True):
        setattr(block, path, value)
        block.keyframe_insert(path, frame=frame)


def test_a_moving_camera_with_one_lens_has_nothing_to_say(scene):
    assert camera_notes(scene) == []
    animated(scene.camera.data, "display_size", (1, 2))
    marked(scene, (1, "first"), (20, "second"), (-5, "second"))
    assert camera_notes(scene) == []


@pytest.mark.parametrize(
    ("path", "values"),
    [("lens", (35, 50)), ("sensor_width", (36, 24)), ("shift_x", (0, 0.1)), ("shift_y", (0, 0.1))],
)
def test_an_animated_lens_is_named(scene, path, values):
    animated(scene.camera.data, path, values)
    before = scene.frame_current
    (note,) = camera_notes(scene)
    assert "the camera's lens changes along the timeline (focal length from" in note
    assert scene.frame_current == before


def test_a_driven_lens_is_named(scene):
    driver = scene.camera.data.driver_add("lens").driver
    driver.expression = "30 + frame"
    (note,) = camera_notes(scene)
    assert "the camera's lens changes" in note


def test_markers_that_switch_cameras_are_named(scene):
    marked(scene, (1, "first"), (6, "second"))
    (note,) = camera_notes(scene)
    assert "markers of the timeline switch between cameras (first, second)" in note
    assert camera_notes(scene, bpy.data.objects["first"]) == []
    bpy.data.objects["second"].data.lens = 20
    notes = camera_notes(scene)
    assert len(notes) == 2 and "lens changes" in notes[1]


def test_before_the_first_marker_its_camera_is_shown(scene):
    marked(scene, (6, "second"))
    assert camera_notes(scene) == []
    scene.frame_set(1)
    assert scene.camera.name == "second"


@pytest.mark.parametrize("kind", ["ORTHO", "PANO"])
def test_a_camera_that_is_no_perspective_one_is_named(scene, kind):
    scene.camera.data.type = kind
    (note,) = camera_notes(scene)
    assert f"not a perspective one (first: {kind})" in note
    assert camera.pinhole(scene, scene.camera) is None


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda scene: setattr(scene.camera.data.dof, "use_dof", True), "depth of field"),
        (lambda scene: setattr(scene.render, "use_motion_blur", True), "motion blur"),
        (lambda scene: setattr(scene.render, "use_border", True), "render region"),
        (lambda scene: setattr(scene.render, "use_multiview", True), "stereoscopy"),
        (lambda scene: setattr(scene, "frame_step", 2), "frame step"),
        (lambda scene: setattr(scene.cycles, "rolling_shutter_type", "TOP"), "rolling shutter"),
    ],
)
def test_settings_that_are_not_applied_are_named(scene, change, what):
    change(scene)
    assert camera_notes(scene) == [f"settings of the scene that are not applied: {what}"]


def test_a_pixel_aspect_is_applied(scene):
    scene.render.pixel_aspect_x = 2
    lens = camera.pinhole(scene, scene.camera)
    assert lens.fy == pytest.approx(2 * lens.fx)
    assert camera_notes(scene) == []


def test_the_command_names_them(scene, tmp_path, command_here):
    marked(scene, (1, "first"), (6, "second"))
    scene.camera.data.dof.use_dof = True
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film.blend"))
    code, _, noted = command_here(
        "trajectory", "camera", tmp_path / "film.blend", "-o", tmp_path / "film.txt"
    )
    assert code == 0
    assert "switch between cameras" in noted and "depth of field" in noted


@pytest.mark.parametrize(
    ("scale", "is_sheared"), [((1, 1, 1), False), ((2, 2, 2), False), ((1, 2, 1), True)]
)
def test_a_camera_that_its_parent_shears_is_named(scene, scale, is_sheared):
    parent = bpy.data.objects.new("parent", None)
    scene.collection.objects.link(parent)
    parent.scale = scale
    scene.camera.parent = parent
    scene.camera.rotation_euler = (0.6, 0.3, 0.4)
    bpy.context.view_layer.update()
    assert any("sheared" in note for note in camera_notes(scene)) == is_sheared
