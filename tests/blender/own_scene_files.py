"""Small scenes made and exported for the tests of own scenes."""

import math
from pathlib import Path

import numpy as np


def fresh(bpy):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


def picture(bpy, path: Path, value=0.5, size=16):
    """A PNG of two greys on disk, as an image of the session."""
    image = bpy.data.images.new(path.stem, size, size)
    pixels = np.ones((size, size, 4), np.float32)
    pixels[: size // 2, :, :3] = value
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw = str(path)
    image.file_format = "PNG"
    image.save()
    return image


def material(bpy, name, colour=(0.6, 0.5, 0.4), image=None, **inputs):
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    tree = made.node_tree
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    for socket, value in inputs.items():
        shader.inputs[socket.replace("_", " ")].default_value = value
    if image is not None:
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    return made


def add(bpy, name, vertices, faces, *materials, uv=True):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    if uv:
        layer = mesh.uv_layers.new(name="UVMap")
        corners = np.array([v for f in faces for v in f])
        layer.data.foreach_set("uv", np.array(vertices, np.float32)[corners][:, :2].ravel())
    for one in materials:
        mesh.materials.append(one)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def box(bpy, name, low, high, *materials):
    """Faces outwards."""
    (a, b, c) = low
    (d, e, f) = high
    v = [(a, b, c), (d, b, c), (d, e, c), (a, e, c), (a, b, f), (d, b, f), (d, e, f), (a, e, f)]
    q = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    return add(bpy, name, v, q, *materials)


def lamp(bpy, kind="POINT", energy=50.0, location=(0, -1, 2.2)):
    data = bpy.data.lights.new("lamp", kind)
    data.energy = energy
    thing = bpy.data.objects.new("lamp", data)
    thing.location = location
    bpy.context.scene.collection.objects.link(thing)
    return thing


def small_room(bpy, folder: Path):
    """A floor, two walls, two boxes and a lamp, 5 x 4 x 2.5 m, with a textured floor; a camera that
    moves.
    """
    scene = fresh(bpy)
    (folder / "tex").mkdir(parents=True, exist_ok=True)
    image = picture(bpy, folder / "tex/floor.png")
    floor = material(bpy, "floor", image=image, Roughness=0.4)
    wall = material(bpy, "wall", (0.8, 0.75, 0.7), Roughness=0.9)
    add(
        bpy,
        "floor",
        [(-2.5, -2, 0), (2.5, -2, 0), (2.5, 2, 0), (-2.5, 2, 0)],
        [(0, 1, 2, 3)],
        floor,
    )
    add(
        bpy,
        "wall",
        [(-2.5, 2, 0), (2.5, 2, 0), (2.5, 2, 2.5), (-2.5, 2, 2.5)],
        [(0, 1, 2, 3)],
        wall,
    )
    add(
        bpy,
        "side",
        [(-2.5, -2, 0), (-2.5, 2, 0), (-2.5, 2, 2.5), (-2.5, -2, 2.5)],
        [(0, 1, 2, 3)],
        wall,
    )
    box(bpy, "crate", (0.2, 0.6, 0), (1.0, 1.3, 0.7), material(bpy, "red", (0.7, 0.2, 0.2)))
    turned = box(
        bpy,
        "chest",
        (-0.4, -0.3, 0),
        (0.4, 0.3, 0.5),
        material(bpy, "metal", (0.8, 0.7, 0.3), Metallic=1.0),
    )
    turned.location = (-1.2, 0.9, 0)
    turned.rotation_euler = (0, 0, 0.6)
    lamp(bpy)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.rotation_euler = (math.radians(80), 0, 0)
    for frame, x in ((1, -0.5), (5, 0.5)):
        camera.location = (x, -1.8, 1.4)
        camera.keyframe_insert("location", frame=frame)
    scene.frame_start = 1
    scene.frame_end = 5
    image.filepath = "//tex/floor.png"
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "room.blend"))
    return folder / "room.blend"


EXPORTS = {
    "glb": lambda bpy, path: bpy.ops.export_scene.gltf(
        filepath=path, export_lights=True, export_cameras=True
    ),
    "gltf": lambda bpy, path: bpy.ops.export_scene.gltf(
        filepath=path, export_format="GLTF_SEPARATE", export_lights=True
    ),
    "obj": lambda bpy, path: bpy.ops.wm.obj_export(
        filepath=path, path_mode="RELATIVE", export_animation=False
    ),
    "ply": lambda bpy, path: bpy.ops.wm.ply_export(filepath=path),
    "usdc": lambda bpy, path: bpy.ops.wm.usd_export(filepath=path),
    "fbx": lambda bpy, path: bpy.ops.export_scene.fbx(
        filepath=path, path_mode="RELATIVE", bake_anim=False
    ),
}


def points_of(surface):
    """The surface's triangle corners as a sorted list of rounded points: equal for equal surfaces,
    however they are split.
    """
    return np.unique(np.round(surface.vertices[np.unique(surface.triangles)], 4) + 0.0, axis=0)
