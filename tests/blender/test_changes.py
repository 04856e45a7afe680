"""What an evaluation of frames shows to move, which no animation of the thing itself tells."""

import sys
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
from iclnuim.blender.open import motion  # noqa: E402


@pytest.fixture
def box():
    scene = made.fresh(bpy)
    scene.frame_start = 0
    scene.frame_end = 10
    return made.box(bpy, "box", (0, 0, 0), (1, 1, 1), made.material(bpy, "grey"))


@pytest.fixture
def mover():
    thing = bpy.data.objects.new("mover", None)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def animate(block, path, first, last, end=10):
    for frame, value in ((0, first), (end, last)):
        setattr(block, path, value)
        block.keyframe_insert(path, frame=frame)


def add_node(kind):
    tree = bpy.data.materials["grey"].node_tree
    node = tree.nodes.new(kind)
    tree.links.new(node.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return node


def found():
    return motion.moving_names(bpy.context.scene)


def test_a_still_scene_does_not_move_and_its_frame_stays(box):
    bpy.context.scene.frame_set(3, subframe=0.25)
    animate(box, "location", (0, 0, 1), (0, 0, 1))
    assert found() == []
    assert bpy.context.scene.frame_current_final == 3.25


def test_the_last_digits_of_a_place_are_no_motion(box):
    """A hundredth of a millimetre and more is."""

    def state(z_m):
        box.location.z = z_m
        bpy.context.view_layer.update()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        return motion._State(bpy.context.scene, depsgraph, {})

    still = state(0.0)
    assert [still.differences(state(z_m)) for z_m in (0.8e-5, 1.5e-5)] == [set(), {"box"}]


def test_a_mesh_that_follows_a_hidden_helper(box, mover):
    box.modifiers.new("mirror", "MIRROR").mirror_object = mover
    animate(mover, "location", (0, 0, 0), (-1, 0, 0))
    animate(box, "location", (0, 0, 1), (0, 0, 1))
    assert found() == ["box"]


def test_coordinates_of_a_texture_that_follow_a_helper(box, mover):
    add_node("ShaderNodeTexCoord").object = mover
    animate(mover, "location", (0, 0, 0), (1, 0, 0))
    assert found() == ["grey"]


@pytest.mark.parametrize("name", ["glow", "frame_current"])
def test_a_material_that_reads_the_scene(box, name):
    node = add_node("ShaderNodeAttribute")
    node.attribute_type = "VIEW_LAYER"
    node.attribute_name = name
    scene = bpy.context.scene
    for frame in (0, 10):
        scene["glow"] = frame / 10
        scene.keyframe_insert('["glow"]', frame=frame)
    assert found() == ["grey"]


def test_copies_that_follow_an_animated_number_of_them(box):
    made.box(bpy, "other", (3, 3, 3), (4, 4, 4))
    array = box.modifiers.new("array", "ARRAY")
    bpy.context.scene["copies"] = 1
    for frame, value in ((0, 2), (10, 4)):
        array.count = value
        box.keyframe_insert('modifiers["array"].count', frame=frame)
    assert motion.changed_names(bpy.context.scene) == {"box"}


def test_motion_between_two_of_the_compared_frames_of_a_short_run_is_found(box):
    scene = bpy.context.scene
    scene.frame_end = 31
    for frame, z in ((6, 0.0), (7, 1.0), (8, 0.0)):
        box.location.z = z
        box.keyframe_insert("location", frame=frame)
    assert motion.changed_names(scene) == {"box"}


def test_the_first_difference_is_enough_unless_all_are_wanted(box, mover):
    animate(mover, "location", (0, 0, 0), (-1, 0, 0))
    back = bpy.data.objects.new("back", None)
    bpy.context.scene.collection.objects.link(back)
    animate(back, "location", (0, 0, 0), (-1, 0, 0), end=5)
    animate(back, "location", (-1, 0, 0), (0, 0, 0))
    back.keyframe_insert("location", frame=0)
    other = made.box(bpy, "other", (3, 3, 3), (4, 4, 4))
    box.modifiers.new("mirror", "MIRROR").mirror_object = mover
    other.modifiers.new("mirror", "MIRROR").mirror_object = back
    assert motion.changed_names(bpy.context.scene, first_only=True) == {"box"}
    assert motion.changed_names(bpy.context.scene) == {"box", "other"}


def test_what_moves_after_the_run_does_not_count(box, mover):
    box.modifiers.new("mirror", "MIRROR").mirror_object = mover
    for frame, x in ((11, 0.0), (20, -1.0)):
        mover.location.x = x
        mover.keyframe_insert("location", frame=frame)
    assert motion.changed_names(bpy.context.scene) == set()
    bpy.context.scene.frame_end = 20
    assert motion.changed_names(bpy.context.scene) == {"box"}
