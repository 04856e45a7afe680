"""Names that a scene gives: lines of tables and messages stay lines."""

import csv

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
from iclnuim.blender import notes, surfaces  # noqa: E402
from iclnuim.blender.light import scene_key  # noqa: E402
from iclnuim.blender.open import motion, plain_names, scene  # noqa: E402
from iclnuim.channels import CHANNELS  # noqa: E402
from iclnuim.formats.files import write_json  # noqa: E402
from iclnuim.sequences.run_folder import FurtherImages  # noqa: E402


def test_names_of_a_scene_are_one_line_each():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for name in ("lamp\nv 1 2 3", "=HYPERLINK()", "Stuhl, groß"):
        bpy.data.objects.new(name, None)
    assert plain_names.rename() == ["2 names with unusual characters: changed"]
    assert {o.name for o in bpy.data.objects} == {"lamp_v 1 2 3", "_HYPERLINK()", "Stuhl, groß"}
    assert plain_names.rename() == []


def test_of_more_than_five_names_the_first_five_are_listed():
    assert notes.names_of("cabed") == "a, b, c, d, e"
    assert notes.names_of("gcfabed") == "a, b, c, d, e and 2 more"


def named_in_bytes(folder, word):
    """A file in which an attribute, a UV map, a node, view layers ... have names; the name `word`
    is not UTF-8.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add()
    mesh = bpy.context.object.data
    mesh.name = "ZZmesh"
    mesh.uv_layers[0].name = "ZZuv"
    mesh.attributes.new("ZZattribute", "FLOAT", "POINT")
    material = bpy.data.materials.new("ZZmaterial")
    material.use_nodes = True
    mesh.materials.append(material)
    node = material.node_tree.nodes.new("ShaderNodeUVMap")
    node.name = "ZZnode"
    node.uv_map = "ZZuv"
    group = bpy.data.node_groups.new("ZZgroup", "ShaderNodeTree")
    group.nodes.new("ShaderNodeRGB").name = "ZZinner"
    material.node_tree.nodes.new("ShaderNodeGroup").node_tree = group
    bpy.context.scene.view_layers[0].name = "ZZlayer"
    bpy.context.scene.view_layers.new("ZZsecond")
    path = folder / "named.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False)
    content = path.read_bytes()
    assert word.encode() + b"\0" in content
    path.write_bytes(
        content.replace(word.encode() + b"\0", b"\x93\xff" + word[2:].encode() + b"\0")
    )
    return path


@pytest.mark.parametrize(
    "word",
    ["ZZmesh", "ZZuv", "ZZattribute", "ZZmaterial", "ZZnode", "ZZinner", "ZZlayer", "ZZsecond"],
)
def test_a_name_that_is_not_utf_8_stops_nothing(word, tmp_path):
    """As files have them whose names a program wrote in an encoding of its country."""
    notes = scene.open_scene(str(named_in_bytes(tmp_path, word)))
    assert any("names with unusual characters: changed" in note for note in notes)
    assert motion.changed_names(bpy.context.scene) == set()
    with surfaces.rendered_parts() as (found, _):
        assert scene_key.key_parts(found, bpy.context.scene)
    (mesh,) = bpy.data.meshes
    nodes = mesh.materials[0].node_tree.nodes
    (uv,) = [node for node in nodes if node.type == "UVMAP"]
    assert uv.uv_map == mesh.uv_layers[0].name


@pytest.mark.parametrize("word", ["ZZuv", "ZZattribute", "ZZnode"])
def test_a_name_that_is_not_utf_8_in_a_linked_file_stops_nothing(word, tmp_path):
    library = named_in_bytes(tmp_path, word)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.objects = ["Plane"]
    bpy.context.scene.collection.objects.link(bpy.data.objects["Plane"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "links.blend"))
    notes = scene.open_scene(str(tmp_path / "links.blend"))
    assert any("names with unusual characters: changed" in note for note in notes)
    assert motion.changed_names(bpy.context.scene) == set()
    with surfaces.rendered_parts() as (found, _):
        assert scene_key.key_parts(found, bpy.context.scene)


def test_classes_are_four_fields_whatever_their_names(tmp_path):
    kinds = [{"id": 1, "name": 'wall, "red"', "nyu40_id": 1, "nyu40": "wall"}]
    write_json(tmp_path / "objects.json", {"objects": [], "classes": kinds})
    FurtherImages(tmp_path, tuple(CHANNELS.values())).write_tables(tmp_path)
    with open(tmp_path / "classes.csv", newline="") as file:
        assert list(csv.reader(file))[1] == ["1", 'wall, "red"', "1", "wall"]
