"""What Blender's importers leave out of a file is read here, or named in a note."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
from iclnuim.blender import surfaces  # noqa: E402
from iclnuim.blender.open import scene  # noqa: E402

#: A wall of 4 x 2.5 m: corners, and its faces of four and of three corners.
CORNERS = ((0, 0, 0), (4, 0, 0), (4, 0, 2.5), (0, 0, 2.5), (2, 0, 3))
FACES = ((0, 1, 2, 3), (3, 2, 4))
COLOURS = ((200, 40, 30), (20, 60, 220))


def has(notes, *words):
    return any(all(word in note for word in words) for note in notes)


def opened(path, text):
    path.write_text(text)
    return scene.open_scene(str(path))


def ply(comment="", of_faces=""):
    lines = [f"ply\nformat ascii 1.0\n{comment}element vertex {len(CORNERS)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(FACES)}", "property list uchar int vertex_indices"]
    lines += [f"property uchar {name}" for name in of_faces.split()] + ["end_header"]
    lines += [" ".join(map(str, corner)) for corner in CORNERS]
    for face, colour in zip(FACES, COLOURS, strict=True):
        values = (len(face), *face, *(colour if of_faces else ()))
        lines.append(" ".join(map(str, values)))
    return "\n".join(lines) + "\n"


def test_faces_of_a_ply_have_their_colours(tmp_path):
    notes = opened(tmp_path / "wall.ply", ply(of_faces="red green blue"))
    assert has(notes, "colours of", "faces")
    colours = bpy.data.meshes[0].color_attributes[0].data
    shown = surfaces.array_of(colours, "color_srgb", 4)[:, :3] * 255
    expected = np.repeat(COLOURS, [len(face) for face in FACES], axis=0)
    assert np.abs(shown - expected).max() < 1


def test_the_texture_of_a_ply_is_named(tmp_path):
    notes = opened(tmp_path / "wall.ply", ply("comment TextureFile scan/wall.png\n"))
    assert has(notes, "textures of a PLY", "(wall.png)")
    assert not has(opened(tmp_path / "plain.ply", ply()), "textures")


def test_materials_of_an_obj_that_no_mtl_file_describes_are_named(tmp_path):
    (tmp_path / "wall.mtl").write_text("newmtl brick\nKd 0.6 0.2 0.1\n")
    corners = "".join(f"v {x} {z} {y}\n" for x, y, z in CORNERS)
    faces = "usemtl brick\nf 1 2 3 4\nusemtl glaze \nf 4 3 5\n"
    notes = opened(tmp_path / "wall.obj", f"mtllib wall.mtl\n{corners}{faces}")
    assert has(notes, "no .mtl file describes (glaze)")


def gltf(folder, **more):
    """The wall as glTF, with one material."""
    corners = [(x, z, -y) for x, y, z in CORNERS]
    numbers = [0, 1, 2, 0, 2, 3, 3, 2, 4]
    data = np.array(corners, "<f4").tobytes() + np.array(numbers, "<u4").tobytes()
    (folder / "wall.bin").write_bytes(data)
    view = {"buffer": 0, "byteOffset": 0, "byteLength": 60}
    points = {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"}
    points |= {"min": [0, 0, 0], "max": [4, 3, 0]}
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "material": 0}
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"uri": "wall.bin", "byteLength": len(data)}],
        "bufferViews": [view, {"buffer": 0, "byteOffset": 60, "byteLength": 36}],
        "accessors": [
            points,
            {"bufferView": 1, "componentType": 5125, "count": 9, "type": "SCALAR"},
        ],
        "materials": [{}],
    }
    return opened(folder / "wall.gltf", json.dumps(content | more))


def test_extensions_of_gltf_that_blender_lacks_are_named(tmp_path):
    used = ["KHR_node_visibility", "KHR_materials_unlit"]
    assert has(gltf(tmp_path, extensionsUsed=used), "extensions", "(KHR_node_visibility)")


@pytest.mark.parametrize(
    ("material", "is_lit"),
    [
        ({"extensions": {"KHR_materials_unlit": {}}}, False),
        ({"emissiveFactor": [1, 1, 1]}, True),
    ],
)
def test_unlit_surfaces_give_no_light(tmp_path, material, is_lit):
    used = list(material.get("extensions", ()))
    notes = gltf(tmp_path, materials=[material], extensionsUsed=used)
    assert has(notes, "no light") != is_lit


USD = """#usda 1.0
(
    defaultPrim = "root"
    upAxis = "Z"
)
def Xform "root" {
    def Material "paint" {
        token outputs:surface.connect = </root/paint/shader.outputs:surface>
        def Shader "shader" {
            uniform token info:id = "%s"
            color3f inputs:diffuseColor = (0.1, 0.2, 0.7)
            token outputs:surface
        }
    }
    def Mesh "wall" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4]
        point3f[] points = %s
        rel material:binding = </root/paint>
    }
    %s
}
"""
DOME = "def DomeLight %s { float inputs:intensity = 2\n color3f inputs:color = (1, 0.5, 0)\n }"


def usd(shader="UsdPreviewSurface", light=""):
    return USD % (shader, list(CORNERS), light)


def test_the_dome_light_of_usd_is_the_sky(tmp_path):
    notes = opened(tmp_path / "wall.usda", usd(light=DOME % '"dome"'))
    assert not has(notes, "no light")
    sky = bpy.context.scene.world.node_tree.nodes["Background"].inputs
    assert tuple(sky["Color"].default_value)[:3] == (1, 0.5, 0)
    assert sky["Strength"].default_value == 2
    assert has(opened(tmp_path / "dark.usda", usd()), "no light")


def test_materials_of_usd_for_other_renderers_are_named_and_grey(tmp_path):
    notes = opened(tmp_path / "wall.usda", usd("ND_standard_surface_surfaceshader"))
    assert has(notes, "USD Preview Surface (paint)")
    material = bpy.data.objects["wall"].material_slots[0].material
    colour = material.node_tree.nodes["Diffuse BSDF"].inputs["Color"].default_value
    assert np.allclose(tuple(colour), (0.8, 0.8, 0.8, 1))
    assert not has(opened(tmp_path / "blue.usda", usd()), "USD Preview Surface")


FBX = """; FBX 7.4.0 project file
FBXHeaderExtension: {
    FBXVersion: 7400
}
GlobalSettings: {
    Properties70: {
        P: "UpAxis", "int", "Integer", "",2
        P: "UpAxisSign", "int", "Integer", "",1
        P: "FrontAxis", "int", "Integer", "",1
        P: "FrontAxisSign", "int", "Integer", "",-1
        P: "CoordAxis", "int", "Integer", "",0
        P: "CoordAxisSign", "int", "Integer", "",1
        P: "UnitScaleFactor", "double", "Number", "",100
    }
}
Objects: {
    Geometry: 1, "Geometry::wall", "Mesh" {
        Vertices: *15 {
            a: %s
        }
        PolygonVertexIndex: *7 {
            a: 0,1,2,-4,3,2,-5
        }
    }
    Model: 2, "Model::wall", "Mesh" {
    }
    Model: 3, "Model::collider", "Mesh" {
        Properties70: {
            P: "Visibility", "Visibility", "", "A",0
        }
    }
}
Connections: {
    C: "OO",2,0
    C: "OO",1,2
    C: "OO",3,0
    C: "OO",1,3
}
"""


@pytest.mark.skipif("fbx_import" not in dir(bpy.ops.wm), reason="reads no FBX in text")
def test_objects_that_an_fbx_hides_are_named_and_hidden(tmp_path):
    numbers = [str(value) for corner in CORNERS for value in corner]
    notes = opened(tmp_path / "wall.fbx", FBX % ",".join(numbers))
    assert has(notes, "the file hides (collider)")
    assert len(surfaces.triangles().triangles) == 3


def two_layers(tmp_path, first_is_used):
    """A floor, and a box in each of two view layers."""
    into = made.fresh(bpy)
    into.view_layers.new("second")
    made.lamp(bpy)
    for place, layer in enumerate(into.view_layers):
        box = made.box(bpy, layer.name, (place, 0, 0), (place + 0.5, 1, 1))
        own = bpy.data.collections.new(layer.name)
        into.collection.children.link(own)
        own.objects.link(box)
        into.collection.objects.unlink(box)
        for other in into.view_layers:
            other.layer_collection.children[layer.name].exclude = other != layer
    into.view_layers[0].use = first_is_used
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "layers.blend"))
    return scene.open_scene(str(tmp_path / "layers.blend"))


@pytest.mark.parametrize("first_is_used", [True, False])
def test_the_first_view_layer_that_is_used_is_rendered(tmp_path, first_is_used):
    notes = two_layers(tmp_path, first_is_used)
    assert has(notes, "view layers (second): left out") == first_is_used
    low = surfaces.triangles().vertices[:, 0].min()
    assert np.isclose(low, 0 if first_is_used else 1)


def test_what_a_view_layer_excludes_gives_no_light(tmp_path):
    into = made.fresh(bpy)
    tube = made.material(bpy, "tube", Emission_Strength=5.0)
    made.box(bpy, "room", (0, 0, 0), (4, 4, 2.5))
    lit = made.box(bpy, "tube", (1, 1, 2), (2, 1.1, 2.1), tube)
    excluded = bpy.data.collections.new("excluded")
    into.collection.children.link(excluded)
    excluded.objects.link(lit)
    into.collection.objects.unlink(lit)
    bpy.context.view_layer.layer_collection.children["excluded"].exclude = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tube.blend"))
    assert has(scene.open_scene(str(tmp_path / "tube.blend")), "no light")
