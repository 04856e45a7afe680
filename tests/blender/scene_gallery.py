"""A gallery of awkward scenes, each a few polygons: what foreign files do that light maps and depth
must survive or refuse. Needs bpy.

Every function of GALLERY fills the emptied Blender scene, around a room of 4 x 4 x 2.5 m seen from
one of its corners.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

#: Position and quaternion (x y z w) of a camera in a corner of the room that looks across it,
#: slightly down.
POSE = "0.000000 -1.6 -1.6 1.5 -0.727534 0.301354 -0.235865 0.569428"


@dataclass(frozen=True)
class Scene:
    """fill: fills the empty scene, or writes a file at the path it is given and returns that.
    light: what the frames must be made by.

    light is `baked`, `path`, or `either`; note: words that a note or error must have; refused: the
    file must be refused; map_samples: of the light map.
    """

    fill: Callable[[Path], Path | None]
    light: str = "baked"
    note: str = ""
    refused: bool = False
    map_samples: int = 8


GALLERY: dict[str, Scene] = {}


def scene(
    light: str = "baked", note: str = "", refused: bool = False, map_samples: int = 8
) -> Callable:
    """Put a function into the gallery under its name."""

    def add(fill: Callable) -> Callable:
        GALLERY[fill.__name__] = Scene(fill, light, note, refused, map_samples)
        return fill

    return add


def make(name: str, folder: Path) -> Path:
    """Write a scene of the gallery into `folder` and return its file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    written = GALLERY[name].fill(folder)
    if written is not None:
        return written
    path = folder / f"{name}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def material(
    name: str, colour: tuple[float, float, float] = (0.7, 0.7, 0.7), **inputs: object
) -> bpy.types.Material:
    """A Principled surface without gloss; `inputs` by their names with `_` for spaces."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    node = made.node_tree.nodes["Principled BSDF"]
    values = {"Base_Color": (*colour, 1.0), "Specular_IOR_Level": 0.0, "Roughness": 0.8, **inputs}
    for key, value in values.items():
        node.inputs[key.replace("_", " ")].default_value = value
    return made


def mesh(
    name: str, vertices: list, faces: list, surface: bpy.types.Material | None = None
) -> bpy.types.Object:
    """One object of a mesh in world coordinates."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    if surface is not None:
        data.materials.append(surface)
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    return made


def box(
    name: str,
    low: tuple,
    high: tuple,
    surface: bpy.types.Material | None = None,
    inward: bool = False,
) -> bpy.types.Object:
    """A closed box; `inward`: its normals point to its inside."""
    corners = []
    for x in (low[0], high[0]):
        for y in (low[1], high[1]):
            for z in (low[2], high[2]):
                corners.append((x, y, z))
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh(name, corners, [face[::-1] for face in faces] if inward else faces, surface)


def lamp(
    place: tuple = (0.5, 0.3, 2.1), watts: float = 60.0, radius: float = 0.15, kind: str = "POINT"
) -> bpy.types.Object:
    """A lamp of the scene."""
    data = bpy.data.lights.new("lamp", kind)
    data.energy = watts
    if kind == "AREA":
        data.size = 2 * radius
    else:
        data.shadow_soft_size = radius
    made = bpy.data.objects.new("lamp", data)
    made.location = place
    bpy.context.scene.collection.objects.link(made)
    return made


def room(inward: bool = True, furnished: bool = True, lit: bool = True) -> None:
    """Walls, a box of another colour on the floor, a lamp under the ceiling."""
    box("room", (-2, -2, 0), (2, 2, 2.5), material("walls", (0.7, 0.65, 0.6)), inward=inward)
    if furnished:
        box("box", (0.3, 0.2, 0.0), (1.0, 1.1, 0.7), material("red", (0.7, 0.2, 0.15)))
    if lit:
        lamp()


def collection(name: str) -> bpy.types.Collection:
    """A collection of the scene."""
    made = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(made)
    return made


def moved(thing: bpy.types.Object, to: bpy.types.Collection) -> None:
    """Out of the scene's own collection into another."""
    to.objects.link(thing)
    bpy.context.scene.collection.objects.unlink(thing)


@scene()
def plain_room(folder: Path) -> None:
    """Nothing awkward at all."""
    room()


@scene()
def zero_normal(folder: Path) -> Path:
    """An OBJ with a corner normal of length 0, and a triangle without area."""
    room()
    bpy.ops.wm.obj_export(filepath=str(folder / "plain.obj"), export_normals=True)
    lines = (folder / "plain.obj").read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("vn "))
    lines[first] = "vn 0 0 0"
    lines.append("f 1 1 2")
    path = folder / "zero_normal.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


@scene()
def point_lamp_without_size(folder: Path) -> None:
    """A lamp of radius 0: its shadows have no penumbra."""
    room(lit=False)
    lamp((0.9, -0.5, 1.6), watts=60.0, radius=0.0)


@scene()
def walls_outward(folder: Path) -> None:
    """A beginner's cube: the room's normals point away from it."""
    room(inward=False)


@scene()
def mixed_normals(folder: Path) -> None:
    """Half of the walls' normals point in, half out."""
    room(furnished=True)
    data = bpy.data.objects["room"].data
    for k in (0, 3, 4):
        data.polygons[k].flip()


@scene()
def lamp_in_hidden_collection(folder: Path) -> None:
    """A lamp in a collection that is disabled in renders gives no light."""
    room()
    hidden = collection("not rendered")
    moved(lamp((-1.0, -1.0, 2.0), watts=500.0), hidden)
    hidden.hide_render = True


@scene(note="no light")
def only_an_excluded_lamp(folder: Path) -> None:
    """All light of the scene stands in an excluded collection."""
    room(lit=False)
    hidden = collection("excluded")
    moved(lamp(), hidden)
    bpy.context.view_layer.layer_collection.children["excluded"].exclude = True


@scene()
def geometry_nodes_instances(folder: Path) -> None:
    """Boxes on a grid by Geometry Nodes: instances that are no objects."""
    instances_by_nodes(mesh("carrier", [(0, 0, 0)], []))


@scene()
def instances_on_a_point_cloud(folder: Path) -> None:
    """The same on a point cloud, as USD's point instancers are read: no point of it is rendered."""
    carrier = bpy.data.objects.new("carrier", bpy.data.pointclouds.new("carrier"))
    bpy.context.scene.collection.objects.link(carrier)
    instances_by_nodes(carrier)


def instances_by_nodes(carrier: bpy.types.Object) -> None:
    room(furnished=False)
    block = box("block", (-0.15, -0.15, 0), (0.15, 0.15, 0.5), material("green", (0.2, 0.6, 0.2)))
    block.location = (0, 0, -5)
    block.hide_render = True
    tree = bpy.data.node_groups.new("instances", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    grid = tree.nodes.new("GeometryNodeMeshGrid")
    grid.inputs["Size X"].default_value = grid.inputs["Size Y"].default_value = 2.0
    grid.inputs["Vertices X"].default_value = grid.inputs["Vertices Y"].default_value = 3
    instance = tree.nodes.new("GeometryNodeInstanceOnPoints")
    source = tree.nodes.new("GeometryNodeObjectInfo")
    source.inputs["Object"].default_value = block
    output = tree.nodes.new("NodeGroupOutput")
    tree.links.new(grid.outputs["Mesh"], instance.inputs["Points"])
    tree.links.new(source.outputs["Geometry"], instance.inputs["Instance"])
    tree.links.new(instance.outputs["Instances"], output.inputs[0])
    carrier.modifiers.new("instances", "NODES").node_group = tree


@scene()
def collection_instances(folder: Path) -> None:
    """A collection that stands twice, by empties."""
    room(furnished=False)
    piece = box("piece", (-0.3, -0.3, 0), (0.3, 0.3, 0.6), material("blue", (0.2, 0.3, 0.7)))
    instanced(piece, (0.8, 0.5, 0), (-0.6, 1.2, 0))


@scene(light="path", note="hair")
def particle_hair(folder: Path) -> None:
    """Hair of a particle system."""
    room()
    rug = mesh(
        "rug",
        [(-1, -1, 0.01), (1, -1, 0.01), (1, 1, 0.01), (-1, 1, 0.01)],
        [(0, 1, 2, 3)],
        material("rug"),
    )
    rug.modifiers.new("hair", "PARTICLE_SYSTEM")
    settings = rug.particle_systems[0].settings
    settings.type = "HAIR"
    settings.count = 200
    settings.hair_length = 0.3


@scene(light="path", note="hair")
def hair_curves(folder: Path) -> None:
    """The newer hair: a curves object."""
    room()
    hair_in(bpy.context.scene)


def hair_in(into: bpy.types.Scene) -> None:
    """Two strands."""
    data = bpy.data.hair_curves.new("strands")
    data.add_curves([3, 3])
    data.position_data.foreach_set(
        "vector", [0, 0, 0.2, 0.1, 0, 0.6, 0.2, 0, 1.0, 0.3, 0, 0.2, 0.4, 0, 0.6, 0.5, 0, 1.0]
    )
    into.collection.objects.link(bpy.data.objects.new("strands", data))


@scene(light="path", note="volume")
def fog_in_a_box(folder: Path) -> None:
    """A box filled with a volume."""
    room()
    fog = bpy.data.materials.new("fog")
    fog.use_nodes = True
    fog.node_tree.nodes.clear()
    fog.node_tree.nodes.new("ShaderNodeOutputMaterial")
    fill_with_fog(fog.node_tree)
    box("fog", (-1.0, -0.5, 0.2), (0.0, 0.5, 1.2), fog)


def fill_with_fog(tree: bpy.types.NodeTree, density: float = 1.0) -> None:
    """A volume for the output of a material or world."""
    output = next(n for n in tree.nodes if n.type in ("OUTPUT_MATERIAL", "OUTPUT_WORLD"))
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    volume.inputs["Density"].default_value = density
    tree.links.new(volume.outputs[0], output.inputs["Volume"])


@scene(light="path", note="volume")
def fog_everywhere(folder: Path) -> None:
    """A sky that is a volume, and a box with a surface and a volume."""
    room()
    fill_with_fog(bpy.data.materials["red"].node_tree)
    sky = bpy.data.worlds.new("sky")
    sky.use_nodes = True
    fill_with_fog(sky.node_tree, 0.2)
    bpy.context.scene.world = sky


@scene(light="path", note="hair")
def hair_in_an_instance(folder: Path) -> None:
    """Hair in a collection that stands elsewhere: no object of the scene has any."""
    hair_curves(folder)
    instanced(bpy.data.objects["strands"], (0.2, 0.1, 0.0))


@scene(light="path", note="points")
def points_by_nodes(folder: Path) -> None:
    """Geometry Nodes that make points of a mesh."""
    room()
    made_by_nodes(bpy.data.objects["box"], "GeometryNodeMeshToPoints")


@scene(light="path", note="volume")
def fog_by_nodes(folder: Path) -> None:
    """Geometry Nodes that make a volume of a mesh, and give it its material."""
    room()
    fog = bpy.data.materials.new("fog")
    fog.use_nodes = True
    fog.node_tree.nodes.clear()
    fog.node_tree.nodes.new("ShaderNodeOutputMaterial")
    fill_with_fog(fog.node_tree, 5.0)
    made_by_nodes(bpy.data.objects["box"], "GeometryNodeMeshToVolume", fog)


def made_by_nodes(
    thing: bpy.types.Object, kind: str, surface: bpy.types.Material | None = None
) -> None:
    """A node in place of a thing's own mesh, and a material on what it makes."""
    tree, _, start, end = nodes_that_shift(thing)
    node = tree.nodes.new(kind)
    paint = tree.nodes.new("GeometryNodeSetMaterial")
    paint.inputs["Material"].default_value = surface
    for source, target in ((start, node), (node, paint), (paint, end)):
        tree.links.new(source.outputs[0], target.inputs[0])


@scene(light="path", note="link")
def link_in_an_instance(folder: Path) -> None:
    """A linked lamp in a collection that stands elsewhere."""
    light_linking(folder)
    instanced(bpy.data.objects["lamp"], (0, 0, 0))


@scene(light="path", note="no light reaches")
def lamp_outside(folder: Path) -> None:
    """A closed room whose only lamp stands outside, seen with hair so that no light is baked:
    black.
    """
    room(lit=False)
    lamp((0, 0, 5))
    hair_in(bpy.context.scene)


@scene(light="path", note="link")
def light_linking(folder: Path) -> None:
    """A lamp that lights only some things."""
    room()
    lit = bpy.data.collections.new("receivers")
    lit.objects.link(bpy.data.objects["box"])
    bpy.data.objects["lamp"].light_linking.receiver_collection = lit
    lamp((-1.0, 1.0, 2.0), watts=30.0)


@scene(note="no light")
def metal_without_light(folder: Path) -> Path:
    """glTF's default material is metal: without lamps it must not be black."""
    box("room", (-2, -2, 0), (2, 2, 2.5), None, inward=True)
    return gltf(folder / "metal_without_light.gltf")


@scene()
def tiny_light(folder: Path) -> None:
    """An LED of a centimetre is no light for a room."""
    room(lit=False)
    box(
        "led",
        (0.0, 1.98, 0.5),
        (0.01, 1.99, 0.51),
        material("led", Emission_Color=(0, 1, 0, 1), Emission_Strength=1.0),
    )


@scene(map_samples=16)
def lit_by_a_surface_alone(folder: Path) -> None:
    """A small Principled surface whose emission is all light."""
    room(lit=False)
    shine = {"Emission_Color": (1, 0.9, 0.8, 1), "Emission_Strength": 20}
    box("tube", (-0.5, 0.2, 2.2), (0.5, 0.3, 2.3), material("shine", (1, 1, 1), **shine))


@scene(note="passes straight through", map_samples=64)
def sun_through_thin_glass(folder: Path) -> None:
    """A room lit by the sun through a pane of a Glass BSDF, as architects' files have it."""
    pane = bpy.data.materials.new("pane")
    pane.use_nodes = True
    pane.node_tree.nodes.clear()
    output = pane.node_tree.nodes.new("ShaderNodeOutputMaterial")
    glass = pane.node_tree.nodes.new("ShaderNodeBsdfGlass")
    glass.inputs["Roughness"].default_value = 0.0
    pane.node_tree.links.new(glass.outputs[0], output.inputs["Surface"])
    window_room(pane)


@scene(map_samples=64)
def open_window(folder: Path) -> None:
    """The same without a pane."""
    window_room(material("pane"))
    bpy.data.objects.remove(bpy.data.objects["pane"])


@scene(note="passes straight through", map_samples=64)
def sun_through_a_thick_pane(folder: Path) -> None:
    """A pane of two faces, tinted, of a Principled surface."""
    tinted = {"Transmission_Weight": 1.0, "Roughness": 0.0, "Specular_IOR_Level": 0.5}
    pane = material("pane", (0.6, 0.9, 0.6), **tinted)
    window_room(pane)
    bpy.data.objects.remove(bpy.data.objects["pane"])
    box("pane", (1.99, -1, 0.8), (2.01, 1, 2.0), pane)


@scene(note="passes straight through")
def vitrine(folder: Path) -> None:
    """A thing under glass."""
    room()
    pane = material(
        "pane", (1, 1, 1), Transmission_Weight=1.0, Roughness=0.0, Specular_IOR_Level=0.5
    )
    box("vitrine", (-1.2, -0.4, 0.01), (-0.2, 0.6, 1.0), pane)
    box("exhibit", (-0.9, -0.1, 0.02), (-0.5, 0.3, 0.6), material("blue", (0.2, 0.3, 0.7)))


def window_room(pane: bpy.types.Material) -> None:
    """A room with a hole in the wall x = 2, a pane in it, sun and sky outside."""
    walls = material("walls", (0.7, 0.65, 0.6))
    a = 2.0
    b = 2.5
    mesh("floor", [(-a, -a, 0), (a, -a, 0), (a, a, 0), (-a, a, 0)], [(0, 1, 2, 3)], walls)
    mesh("ceiling", [(-a, -a, b), (-a, a, b), (a, a, b), (a, -a, b)], [(0, 1, 2, 3)], walls)
    mesh("back", [(-a, a, 0), (-a, a, b), (a, a, b), (a, a, 0)][::-1], [(0, 1, 2, 3)], walls)
    mesh("front", [(-a, -a, 0), (-a, -a, b), (a, -a, b), (a, -a, 0)], [(0, 1, 2, 3)], walls)
    mesh("left", [(-a, -a, 0), (-a, a, 0), (-a, a, b), (-a, -a, b)], [(0, 1, 2, 3)], walls)
    outer = [(a, -a, 0), (a, a, 0), (a, a, b), (a, -a, b)]
    inner = [(a, -1, 0.8), (a, 1, 0.8), (a, 1, 2.0), (a, -1, 2.0)]
    ring = [(k, 4 + k, 4 + (k + 1) % 4, (k + 1) % 4) for k in range(4)]
    mesh("right", outer + inner, ring, walls)
    mesh("pane", inner, [(0, 1, 2, 3)], pane)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy = 4.0
    sun.data.angle = 0.05
    sun.rotation_euler = (0.0, 0.9, 0.2)
    bpy.context.scene.collection.objects.link(sun)
    sky = bpy.data.worlds.new("sky")
    sky.use_nodes = True
    sky.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.7, 1.0, 1.0)
    bpy.context.scene.world = sky


@scene(note="lie exactly on others")
def coincident_faces(folder: Path) -> None:
    """Two faces in one place."""
    room()
    for name in ("one", "other"):
        mesh(
            name,
            [(-1, 1.99, 0.5), (1, 1.99, 0.5), (1, 1.99, 1.5), (-1, 1.99, 1.5)],
            [(0, 1, 2, 3)],
            material(name, (0.3, 0.5, 0.3)),
        )


@scene(note="in the plane of others")
def flush_rug(folder: Path) -> None:
    """A rug and a poster in the very planes of floor and wall; the box stands on the floor and
    stays.
    """
    room()
    rug = material("rug", (0.2, 0.3, 0.7))
    mesh("rug", [(-1.2, -1, 0), (0.2, -1, 0), (0.2, 1, 0), (-1.2, 1, 0)], [(0, 1, 2, 3)], rug)
    mesh("poster", [(-1, 2, 0.8), (0, 2, 0.8), (0, 2, 1.6), (-1, 2, 1.6)], [(0, 1, 2, 3)], rug)


@scene(note="overlap larger ones")
def overlapping_faces(folder: Path) -> None:
    """Faces of one object that overlap in one plane, as a cross; a box let into another, flush with
    its sides.
    """
    room()
    blue = material("blue", (0.2, 0.3, 0.7))
    bars = [
        (-1.5, 0.2),
        (0, 0.2),
        (0, 0.5),
        (-1.5, 0.5),
        (-0.9, -0.3),
        (-0.6, -0.3),
        (-0.6, 0.9),
        (-0.9, 0.9),
    ]
    mesh("cross", [(x, y, 0.4) for x, y in bars], [(0, 1, 2, 3), (4, 5, 6, 7)], blue)
    box("flush", (0.3, 0.5, 0.2), (1.3, 0.9, 0.7), blue)


@scene()
def bent_quads_beside_smooth_ones(folder: Path) -> None:
    """A flat and a smooth quad in one mesh, neither of them plane."""
    room()
    bent = mesh(
        "bent",
        [(-1, 0, 0.3), (0, 0, 0.5), (0, 1, 0.3), (-1, 1, 0.6), (0.25, 0, 0.3), (0.25, 1, 0.6)],
        [(0, 1, 2, 3), (1, 4, 5, 2)],
        material("bent", (0.4, 0.4, 0.7)),
    )
    bent.data.polygons[1].use_smooth = True


@scene(light="path", note="diffuse")
def unlit_room(folder: Path) -> None:
    """Light baked into emission, as rooms on the web are: nothing is diffuse."""
    glow = bpy.data.materials.new("baked")
    glow.use_nodes = True
    glow.node_tree.nodes.clear()
    output = glow.node_tree.nodes.new("ShaderNodeOutputMaterial")
    emission = glow.node_tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (0.4, 0.5, 0.6, 1.0)
    glow.node_tree.links.new(emission.outputs[0], output.inputs["Surface"])
    box("room", (-2, -2, 0), (2, 2, 2.5), glow, inward=True)


@scene(light="path", note="no light reaches")
def all_glass(folder: Path) -> None:
    """Nothing but glass."""
    box(
        "vitrine",
        (-0.5, 0.2, 0.3),
        (0.5, 1.0, 1.2),
        material("glass", Transmission_Weight=1.0, Roughness=0.0),
    )
    lamp()


@scene(note="lie exactly on others")
def flattened_object(folder: Path) -> None:
    """An object scaled to 0 along one axis: its matrix has no inverse."""
    room()
    flat = box("flat", (-1.0, 1.0, 0.6), (-0.2, 1.4, 1.2), material("flat", (0.2, 0.2, 0.6)))
    flat.scale = (1.0, 0.0, 1.0)
    flat.location = (0.0, 1.2, 0.0)


@scene()
def mirrored_object(folder: Path) -> None:
    """A negative scale."""
    room()
    bpy.data.objects["box"].scale = (-1.0, 1.0, 1.0)


@scene()
def no_material(folder: Path) -> None:
    """A room without any material, a box with a slot that holds nothing."""
    box("room", (-2, -2, 0), (2, 2, 2.5), None, inward=True)
    box("box", (0.3, 0.2, 0.0), (1.0, 1.1, 0.7)).data.materials.append(None)
    lamp()


@scene(refused=True, note="surface")
def nothing_at_all(folder: Path) -> None:
    """A file without a surface."""
    lamp()


@scene()
def transparent_leaves(folder: Path) -> None:
    """Cut-out leaves: alpha of 0 and 1."""
    room()
    leaf = material("leaf", (0.2, 0.5, 0.1))
    image = bpy.data.images.new("cut-out", 8, 8, alpha=True)
    pixels = np.ones((8, 8, 4), np.float32)
    pixels[::2, :, 3] = 0.0
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    texture = leaf.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    texture.interpolation = "Closest"
    leaf.node_tree.links.new(
        texture.outputs["Alpha"], leaf.node_tree.nodes["Principled BSDF"].inputs["Alpha"]
    )
    plane = mesh(
        "leaves",
        [(-1.4, 0.5, 0.2), (-0.4, 0.5, 0.2), (-0.4, 0.5, 1.2), (-1.4, 0.5, 1.2)],
        [(0, 1, 2, 3)],
        leaf,
    )
    plane.data.uv_layers.new(name="uv")


@scene(map_samples=16)
def levels_for_rendering(folder: Path) -> None:
    """A curve, a metaball, a screw and an instanced subdivision that are coarser in the viewport
    than in renders.
    """
    room(furnished=False)
    blue = material("blue", (0.2, 0.3, 0.7))
    curve = bpy.data.curves.new("curve", "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth = 0.15
    curve.resolution_u = 1
    curve.render_resolution_u = 12
    spline = curve.splines.new("BEZIER")
    spline.bezier_points.add(1)
    for point, place in zip(
        spline.bezier_points, ((-1.2, 0.2, 0.3), (-0.2, 0.8, 1.2)), strict=True
    ):
        point.co = place
        point.handle_left_type = "FREE"
        point.handle_right_type = "FREE"
        point.handle_left = (place[0] - 0.6, *place[1:])
        point.handle_right = (place[0] + 0.6, *place[1:])
    ball = bpy.data.metaballs.new("ball")
    ball.resolution = 0.5
    ball.render_resolution = 0.1
    ball.elements.new().co = (0.6, 0.6, 1.4)
    screw = mesh("screw", [(0.35, 0, 0), (0.35, 0, 0.6)], [], blue)
    screw.data.edges.add(1)
    screw.data.edges[0].vertices = (0, 1)
    screw.location = (-1.2, 1.2, 0.1)
    screw.modifiers.new("screw", "SCREW").steps = 3
    screw.modifiers[0].render_steps = 24
    for data in (curve, ball):
        data.materials.append(blue)
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(data.name, data))
    piece = box("piece", (-0.3, -0.3, 0), (0.3, 0.3, 0.6), blue)
    subdivision = piece.modifiers.new("subdivision", "SUBSURF")
    subdivision.levels = 0
    subdivision.render_levels = 2
    instanced(piece, (0.9, 0.2, 0))


def instanced(piece: bpy.types.Object, *places: tuple) -> None:
    """A thing that only instances of its collection show."""
    library = bpy.data.collections.new("library")
    moved(piece, library)
    for place in places:
        standing(library, place)


def nodes_that_shift(thing: bpy.types.Object) -> tuple:
    """Geometry Nodes with a Transform; the tree, it, and the group's input and output."""
    tree = bpy.data.node_groups.new("shift", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    nodes = []
    for kind in ("GeometryNodeTransform", "NodeGroupInput", "NodeGroupOutput"):
        nodes.append(tree.nodes.new(kind))
    tree.links.new(nodes[1].outputs[0], nodes[0].inputs[0])
    tree.links.new(nodes[0].outputs[0], nodes[2].inputs[0])
    thing.modifiers.new("shift", "NODES").node_group = tree
    return tree, *nodes


@scene()
def is_viewport(folder: Path) -> None:
    """Geometry Nodes that show something else in the viewport."""
    room()
    tree, shift, start, end = nodes_that_shift(bpy.data.objects["box"])
    shift.inputs["Translation"].default_value = (-1, 0, 0)
    asks = tree.nodes.new("GeometryNodeIsViewport")
    switch = tree.nodes.new("GeometryNodeSwitch")
    for source, target in ((asks, "Switch"), (start, "False"), (shift, "True")):
        tree.links.new(source.outputs[0], switch.inputs[target])
    tree.links.new(switch.outputs[0], end.inputs[0])


@scene(light="path", note="move")
def scene_time(folder: Path) -> None:
    """Geometry Nodes that follow the frame, without any animation."""
    room()
    tree, shift, _, _ = nodes_that_shift(bpy.data.objects["box"])
    time = tree.nodes.new("GeometryNodeInputSceneTime")
    tree.links.new(time.outputs["Seconds"], shift.inputs["Translation"])
    bpy.context.scene.frame_set(40)


@scene(light="path", note="move")
def appears_later(folder: Path) -> None:
    """A box that is hidden at the frame the file was saved at."""
    room()
    thing = bpy.data.objects["box"]
    for hidden, frame in ((False, 0), (True, 20)):
        thing.hide_render = hidden
        thing.keyframe_insert("hide_render", frame=frame)
    bpy.context.scene.frame_set(20)


@scene(light="path", note="move")
def colour_changes_in_a_group(folder: Path) -> None:
    """An animated colour inside a node group of a material."""
    room()
    group = bpy.data.node_groups.new("group", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    colour = group.nodes.new("ShaderNodeRGB")
    end = group.nodes.new("NodeGroupOutput")
    group.links.new(colour.outputs[0], end.inputs[0])
    for value, frame in (((1, 0, 0, 1), 0), ((0, 0, 1, 1), 20)):
        colour.outputs[0].default_value = value
        colour.outputs[0].keyframe_insert("default_value", frame=frame)
    tree = bpy.data.materials["red"].node_tree
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(node.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])


@scene(note="displaced")
def displaced_instances(folder: Path) -> None:
    """A displaced thing that only an instance shows, one in a collection that is excluded, and a
    file that simplifies.
    """
    room(furnished=False)
    pieces = [displaced_piece(name) for name in ("piece", "excluded")]
    instanced(pieces[0], (0.6, 0.4, 0.2))
    moved(pieces[1], collection("out"))
    bpy.context.view_layer.layer_collection.children["out"].exclude = True
    bpy.context.scene.render.use_simplify = True
    bpy.context.scene.render.simplify_subdivision = 0


@scene(light="path", note="toon")
def toon(folder: Path) -> None:
    """A diffuse shader that is neither of those that light maps replace."""
    room()
    tree = bpy.data.materials["red"].node_tree
    shader = tree.nodes.new("ShaderNodeBsdfToon")
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


def rough(roughness: float) -> None:
    """A room of rough diffuse walls, by the Diffuse BSDF, and a Principled box."""
    room()
    for surface in bpy.data.materials:
        tree = surface.node_tree
        if node := tree.nodes["Principled BSDF"].inputs.get("Diffuse Roughness"):
            node.default_value = roughness
        if surface.name != "red":
            shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
            shader.inputs["Color"].default_value = (0.7, 0.7, 0.7, 1.0)
            shader.inputs["Roughness"].default_value = roughness
            tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


@scene(light="path", note="rough diffuse")
def rough_walls(folder: Path) -> None:
    """Their light depends on the view: 24 dB with baked light."""
    rough(0.4)


@scene()
def slightly_rough_walls(folder: Path) -> None:
    rough(0.25)


@scene(note="partly transparent")
def panel_that_the_camera_does_not_see(folder: Path) -> None:
    """By its shader: it is in Z."""
    room()
    panel = material("panel")
    mesh("panel", [(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], [(0, 1, 2, 3)], panel)
    tree = panel.node_tree
    kinds = ("LightPath", "BsdfTransparent", "MixShader")
    rays, clear, mix = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    tree.links.new(rays.outputs["Is Camera Ray"], mix.inputs[0])
    tree.links.new(tree.nodes["Principled BSDF"].outputs[0], mix.inputs[1])
    tree.links.new(clear.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


@scene(light="path", note="UV maps")
def eight_uv_maps(folder: Path) -> None:
    """As many as Blender allows."""
    room()
    for number in range(8):
        bpy.data.objects["box"].data.uv_layers.new(name=f"map {number}")


@scene(light="path", note="differ by instance")
def random_colour_of_instances(folder: Path) -> None:
    """A material that gives each instance a colour of its own."""
    collection_instances(folder)
    tree = bpy.data.materials["blue"].node_tree
    info = tree.nodes.new("ShaderNodeObjectInfo")
    tree.links.new(info.outputs["Random"], tree.nodes["Principled BSDF"].inputs["Base Color"])


@scene()
def view_layers(folder: Path) -> None:
    """Collections that are held out, or seen in reflections and by light alone; a second view
    layer, without the box, is looked at.
    """
    room()
    for name, x in (("holdout", -1.2), ("indirect_only", -0.2)):
        moved(
            box(name, (x, 0.6, 0.3), (x + 0.5, 1.2, 0.9), material(name, (0.2, 0.3, 0.7))),
            collection(name),
        )
        setattr(bpy.context.view_layer.layer_collection.children[name], name, True)
    moved(bpy.data.objects["box"], collection("boxes"))
    second = bpy.context.scene.view_layers.new("second")
    second.layer_collection.children["boxes"].exclude = True
    bpy.context.window.view_layer = second


@scene(note="displaced surfaces (piece)")
def displaced_twice_in_a_library(folder: Path) -> Path:
    """A linked collection, seen as two instances, one of them mirrored; a texture by Generated
    coordinates moves its vertices.
    """
    library = collection("library")
    moved(displaced_piece(), library)
    moved(
        box("wedge", (0.35, -0.1, 0), (0.5, 0.3, 0.7), material("blue", (0.2, 0.3, 0.7))), library
    )
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    room(furnished=False)
    path = folder / "displaced_twice_in_a_library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    with bpy.data.libraries.load(str(folder / "library.blend"), link=True, relative=True) as (
        _,
        linked,
    ):
        linked.collections = ["library"]
    standing(bpy.data.collections["library"], (0.8, 0.6, 0))
    standing(bpy.data.collections["library"], (-0.7, 0.9, 0.2), (-1, 1, 1.3), 0.6)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def displaced_piece(name: str = "piece") -> bpy.types.Object:
    """A subdivided box under noise."""
    bumpy = material("bumpy", (0.2, 0.5, 0.2))
    bumpy.displacement_method = "DISPLACEMENT"
    tree = bumpy.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    moves = tree.nodes.new("ShaderNodeDisplacement")
    noise.inputs["Scale"].default_value = 3.0
    moves.inputs["Scale"].default_value = 0.3
    tree.links.new(noise.outputs[0], moves.inputs["Height"])
    tree.links.new(moves.outputs[0], tree.nodes["Material Output"].inputs["Displacement"])
    piece = box(name, (-0.3, -0.3, 0), (0.3, 0.3, 0.5), bumpy)
    piece.modifiers.new("subdivision", "SUBSURF").render_levels = 4
    return piece


def standing(
    what: bpy.types.Collection, place: tuple, scale: tuple = (1, 1, 1), turn: float = 0.0
) -> bpy.types.Object:
    """An instance of a collection."""
    carrier = bpy.data.objects.new("stand", None)
    carrier.instance_type = "COLLECTION"
    carrier.instance_collection = what
    carrier.location = place
    carrier.scale = scale
    carrier.rotation_euler = (0, 0, turn)
    bpy.context.scene.collection.objects.link(carrier)
    return carrier


@scene(map_samples=16)
def instances_in_instances(folder: Path) -> None:
    """A collection of instances below a mirrored parent; things on the faces and on the vertices of
    others, themselves mirrored.
    """
    room(furnished=False)
    inner = bpy.data.collections.new("inner")
    outer = bpy.data.collections.new("outer")
    moved(box("post", (-0.1, -0.1, 0), (0.25, 0.1, 0.4), material("green", (0.2, 0.6, 0.2))), inner)
    moved(
        mesh(
            "sail",
            [(0, 0, 0.4), (0.3, 0, 0.4), (0, 0.2, 0.8)],
            [(0, 1, 2)],
            material("sand", (0.7, 0.6, 0.1)),
        ),
        inner,
    )
    for k in range(3):
        moved(standing(inner, (0.45 * k, 0, 0), (1, -1 if k == 1 else 1, 1), 0.5 * k), outer)
    mirror = bpy.data.objects.new("mirror", None)
    mirror.scale = (-1, 1, 1)
    bpy.context.scene.collection.objects.link(mirror)
    standing(outer, (-0.3, 0.2, 0)).parent = mirror
    standing(outer, (-0.9, 1.2, 1.2), (1, 1, -1))
    for kind, place in (("FACES", (-1.2, 1.2, 0.6)), ("VERTS", (1.0, 1.5, 1.3))):
        carrier = mesh(
            kind,
            [(0, 0, 0), (0.6, 0, 0), (0.6, 0.3, 0.4), (0, 0.3, 0.4)],
            [(0, 1, 2, 3)],
            material("red"),
        )
        carrier.location = place
        carrier.instance_type = kind
        carrier.use_instance_faces_scale = True
        carrier.show_instancer_for_render = kind == "VERTS"
        child = box(
            f"on {kind}", (-0.05, -0.05, 0), (0.05, 0.05, 0.2), material("blue", (0.2, 0.2, 0.7))
        )
        child.parent = carrier
        child.scale = (-1, 1, 1)


@scene()
def smooth_twins_of_other_proportions(folder: Path) -> None:
    """Objects that share a smooth mesh, stretched along different axes."""
    room(furnished=False)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=8, ring_count=6, radius=0.3)
    one = bpy.context.object
    one.data.materials.append(material("green", (0.2, 0.6, 0.2)))
    for face in one.data.polygons:
        face.use_smooth = True
    other = bpy.data.objects.new("other", one.data)
    bpy.context.scene.collection.objects.link(other)
    one.location = (-0.3, 1.0, 0.7)
    one.scale = (1, 0.6, 2)
    other.location = (0.6, 0.9, 0.4)
    other.scale = (1.6, 0.6, 1)


@scene(map_samples=16)
def instanced_lamps_and_shear(folder: Path) -> None:
    """A collection with a turned box and a lamp stands twice, once below a parent that is longer
    than wide: no other lamp is there.
    """
    room(furnished=False, lit=False)
    library = bpy.data.collections.new("library")
    piece = box("piece", (-0.2, -0.2, 0), (0.2, 0.2, 0.6), material("green", (0.2, 0.6, 0.2)))
    piece.rotation_euler = (0, 0, 0.7)
    moved(piece, library)
    moved(lamp((0, 0, 1.4), 15.0, 0.1), library)
    shear = bpy.data.objects.new("shear", None)
    shear.scale = (1, 2, 0.7)
    bpy.context.scene.collection.objects.link(shear)
    standing(library, (0.5, 0.2, 0), turn=0.4).parent = shear
    standing(library, (-0.9, 0.9, 0.1), (-1, 1, 1))


@scene()
def background_set(folder: Path) -> None:
    """A thing and a lamp of another scene, which is the background set of this one."""
    room()
    behind = bpy.data.scenes.new("behind")
    for thing in (
        box("far", (-0.9, 0.9, 0), (-0.5, 1.3, 1.2), material("sand", (0.7, 0.6, 0.1))),
        lamp((-1, 0, 2)),
    ):
        behind.collection.objects.link(thing)
        bpy.context.scene.collection.objects.unlink(thing)
    bpy.context.scene.background_set = behind


@scene(note="Grease Pencil")
def grease_pencil(folder: Path) -> None:
    """A drawing in the room: with it, Blender rounds the depth of every pixel."""
    room()
    data = (
        bpy.data.grease_pencils_v3
        if hasattr(bpy.data, "grease_pencils_v3")
        else bpy.data.grease_pencils
    ).new("drawing")
    drawing = data.layers.new("layer").frames.new(0).drawing
    drawing.add_strokes([3])
    for point, place in zip(
        drawing.strokes[0].points, ((-1, 0.5, 0.4), (0, 0.5, 0.4), (0, 0.5, 1.4)), strict=True
    ):
        point.position = place
        point.radius = 0.05
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("drawing", data))


@scene()
def settings_that_spoil(folder: Path) -> None:
    """Render settings of a file that would hide surfaces, change light or samples, or move the
    camera.
    """
    room()
    scene = bpy.context.scene
    render = bpy.context.scene.render
    layer = bpy.context.scene.view_layers[0]
    render.engine = "CYCLES"
    over = material("over", (1, 0, 0))
    spoiled = {
        render: {
            "frame_map_old": 100, "frame_map_new": 300, "use_border": True, "border_max_x": 0.3,
            "film_transparent": True, "use_simplify": True, "use_multiview": True,
            "pixel_aspect_x": 2.0,
        },
        layer: {"samples": 1, "use_solid": False, "use_sky": False, "material_override": over},
        layer.cycles: {"use_denoising": False},
        scene.cycles: {
            "use_sample_subset": True, "sample_subset_length": 1, "use_fast_gi": True,
            "blur_glossy": 10.0, "light_sampling_threshold": 1.0, "scrambling_distance": 0.0,
            "texture_limit_render": "128", "direct_light_sampling_type": "FORWARD_PATH_TRACING",
            "sampling_pattern": "TABULATED_SOBOL", "film_exposure": 4.0, "use_auto_tile": True,
            "tile_size": 8,
        },
    }  # fmt: skip
    for owner, values in spoiled.items():
        for name, value in values.items():
            setattr(owner, name, value)


@scene(refused=True, note="surface")
def edges_alone(folder: Path) -> None:
    """A mesh without a face."""
    mesh("edges", [(-1, 0, 0.5), (0, 0, 0.9)], []).data.edges.add(1)
    lamp()


def gltf(path: Path) -> Path:
    """A minimal glTF of the scene's first mesh, without a material, which is metal by default."""
    data = bpy.context.scene.objects[0].data
    data.calc_loop_triangles()
    points = np.array([v.co for v in data.vertices], np.float32)[:, [0, 2, 1]] * (1, 1, -1)
    corners = np.array([t.vertices for t in data.loop_triangles], np.uint16).ravel()
    blob = points.astype("<f4").tobytes() + corners.astype("<u2").tobytes()
    path.with_suffix(".bin").write_bytes(blob)
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": points.size * 4},
        {"buffer": 0, "byteOffset": points.size * 4, "byteLength": corners.size * 2},
    ]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3",
         "min": points.min(0).tolist(), "max": points.max(0).tolist()},
        {"bufferView": 1, "componentType": 5123, "count": len(corners), "type": "SCALAR"},
    ]  # fmt: skip
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": path.with_suffix(".bin").name, "byteLength": len(blob)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    path.write_text(json.dumps(content))
    return path
