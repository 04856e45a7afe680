"""The key of a light map: another one for every small change of what determines light."""

import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
from iclnuim.blender import surfaces  # noqa: E402
from iclnuim.blender.light import scene_key  # noqa: E402
from iclnuim.blender.open import importers  # noqa: E402

TEXELS = 1024


def box():
    return bpy.data.objects["box"]


def shader():
    return box().data.materials[0].node_tree.nodes["Principled BSDF"]


def uv_by_a_texel():
    box().data.uv_layers[0].data[0].uv[0] += 1 / TEXELS


def vertex_by_a_millimetre():
    box().data.vertices[0].co[2] += 0.001


def object_by_a_millimetre():
    box().location[0] += 0.001


def colour():
    shader().inputs["Base Color"].default_value[1] += 0.001


def roughness():
    shader().inputs["Roughness"].default_value += 0.001


def power_of_a_lamp():
    bpy.data.lights[0].energy *= 1.001


def place_of_a_lamp():
    next(thing for thing in bpy.data.objects if thing.type == "LIGHT").location[1] += 0.001


def colour_of_the_sky():
    bpy.context.scene.world.node_tree.nodes["Background"].inputs["Color"].default_value[2] += 0.001


def bounces():
    bpy.context.scene.cycles.diffuse_bounces += 1


def texel_of_a_picture():
    image = bpy.data.images["picture"]
    image.pixels[0] = 1.0 - image.pixels[0]
    image.update()


def mirrored_by_a_modifier():
    box().modifiers.new("mirror", "MIRROR").use_axis = (False, False, True)


EDITS = [
    uv_by_a_texel, vertex_by_a_millimetre, object_by_a_millimetre, colour, roughness,
    power_of_a_lamp, place_of_a_lamp, colour_of_the_sky, bounces, texel_of_a_picture,
    mirrored_by_a_modifier,
]  # fmt: skip


@pytest.fixture
def room():
    here = made.fresh(bpy)
    image = bpy.data.images.new("picture", 16, 16)
    made.box(bpy, "box", (-1, -1, -1), (1, 1, 1), made.material(bpy, "m", image=image))
    box().modifiers.new("bevel", "BEVEL").segments = 3
    made.lamp(bpy)
    here.world = bpy.data.worlds.new("sky")
    here.world.use_nodes = True


def key():
    bpy.context.view_layer.update()
    with surfaces.rendered_parts() as (found, _):
        return scene_key.key_parts(found, bpy.context.scene), scene_key.uv_of(found)


def is_found(before, after):
    return before[0] == after[0] and scene_key.same_uv(before[1], after[1])


@pytest.mark.parametrize("edit", EDITS)
def test_a_small_edit_has_another_key_and_the_same_scene_the_same(room, edit):
    before = key()
    assert is_found(before, key())
    edit()
    assert not is_found(before, key())


def test_texture_coordinates_that_differ_by_rounding_are_the_same():
    uv = np.random.default_rng(0).uniform(-3, 3, (1000, 2)).astype(np.float32)
    assert scene_key.same_uv(uv, uv + np.float32(4e-7))
    assert not scene_key.same_uv(uv, uv + np.float32(1 / 16384))


@pytest.mark.skipif(not hasattr(bpy.ops.export_scene, "fbx"), reason="writes FBX")
def test_the_objects_of_an_fbx_are_in_the_order_of_their_names(tmp_path):
    made.fresh(bpy)
    for name in ("c", "a", "d", "b", "f", "e"):
        made.box(bpy, name, (0, 0, 0), (1, 1, 1))
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "a.fbx"))
    made.fresh(bpy)
    importers.load(tmp_path / "a.fbx")
    found = [thing.name for thing in bpy.context.scene.collection.all_objects]
    assert found == sorted(found) and len(found) == 6
