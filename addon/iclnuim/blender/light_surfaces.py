"""What the open scene shows in a render, as arrays and as real mesh objects that may be given light maps."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import mathutils
import numpy as np

from ..lightmap.surfaces import Surfaces, join
from .light_points import kept

_SURFACE_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


@dataclass(frozen=True, eq=False)
class Part:
    """One thing in the render: a mesh of its own as evaluated, where it stands, and what it was made from.

    `origin` is the object to hide when the part takes its place; `single` says that the part is all that this object shows.
    """

    name: str
    mesh: bpy.types.Mesh
    matrix: mathutils.Matrix
    source: bpy.types.Object
    origin: bpy.types.Object
    single: bool


@contextmanager
def as_rendered(scene: bpy.types.Scene) -> Iterator[bpy.types.Depsgraph]:
    """The evaluated scene as the renderer would see it: what is hidden only in the viewport is shown, and the reverse."""
    with ExitStack() as stack:
        for collection in scene.collection.children_recursive:
            stack.enter_context(kept(collection, hide_viewport=collection.hide_render))
        for layer in _layers(bpy.context.view_layer.layer_collection):
            stack.enter_context(kept(layer, hide_viewport=False))
        for thing in scene.objects:
            stack.enter_context(kept(thing, hide_viewport=thing.hide_render))
            hidden = thing.hide_get()
            thing.hide_set(False)
            stack.callback(thing.hide_set, hidden)
            for modifier in thing.modifiers:
                stack.enter_context(kept(modifier, show_viewport=modifier.show_render))
                if hasattr(modifier, "render_levels") and hasattr(modifier, "levels"):
                    stack.enter_context(kept(modifier, levels=modifier.render_levels))
        depsgraph = bpy.context.evaluated_depsgraph_get()
        depsgraph.update()
        yield depsgraph


def _layers(layer: bpy.types.LayerCollection) -> list[bpy.types.LayerCollection]:
    """All below `layer`; the top one is never hidden."""
    return [inner for child in layer.children for inner in (child, *_layers(child))]


def parts(depsgraph: bpy.types.Depsgraph) -> list[Part]:
    """Every surface that renders, instances made real, in Blender's own order. The caller removes the meshes."""
    found = []
    for instance in depsgraph.object_instances:
        thing = instance.object
        if not instance.show_self or thing.type not in _SURFACE_TYPES or thing.original.hide_render:
            continue
        mesh = bpy.data.meshes.new_from_object(thing, preserve_all_data_layers=True, depsgraph=depsgraph)
        if mesh is None or not len(mesh.polygons):
            continue
        _own_materials(mesh, thing)
        _same_texture_space(mesh, thing.data)
        origin = instance.parent.original if instance.is_instance else thing.original
        found.append(
            Part(thing.name, mesh, instance.matrix_world.copy(), thing.original, origin, not instance.is_instance)
        )
    return found


def _same_texture_space(mesh: bpy.types.Mesh, evaluated: bpy.types.ID) -> None:
    """Generated coordinates span the box of the mesh before its modifiers."""
    if isinstance(evaluated, bpy.types.Mesh):
        mesh.use_auto_texspace = False
        mesh.texspace_location, mesh.texspace_size = evaluated.texspace_location, evaluated.texspace_size


def _own_materials(mesh: bpy.types.Mesh, thing: bpy.types.Object) -> None:
    """Materials may hang on the object instead of its data: put what is shown into the mesh. Clearing would reset the faces' indices."""
    for number, slot in enumerate(thing.material_slots):
        material = slot.material and slot.material.original
        if number < len(mesh.materials):
            mesh.materials[number] = material
        else:
            mesh.materials.append(material)


def surfaces(found: list[Part]) -> Surfaces:
    """All parts as arrays in world coordinates, numbered in their order."""
    return join([_surfaces(part) for part in found])


def _surfaces(part: Part) -> Surfaces:
    mesh, matrix = part.mesh, np.array(part.matrix)
    mesh.calc_loop_triangles()
    vertices = _get(mesh.vertices, "co", 3) @ matrix[:3, :3].T + matrix[:3, 3]
    vertex_of_corner = _get(mesh.loops, "vertex_index", 1, np.int32)
    normals = _get(mesh.corner_normals, "vector", 3) @ np.linalg.inv(matrix[:3, :3])
    triangles = _get(mesh.loop_triangles, "loops", 3, np.int32)
    welded = np.unique(np.round(vertices / 1e-5).astype(np.int64), axis=0, return_inverse=True)[1].reshape(-1)
    return Surfaces(
        corners_m=vertices[vertex_of_corner],
        normals=normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12),
        vertex=welded[vertex_of_corner],
        face_start=np.append(_get(mesh.polygons, "loop_start", 1, np.int32), len(mesh.loops)),
        triangles=triangles[:, ::-1]
        if np.linalg.det(matrix[:3, :3]) < 0
        else triangles,  # mirrored: wound the other way
        triangle_face=_get(mesh.loop_triangles, "polygon_index", 1, np.int32),
        face_object=np.zeros(len(mesh.polygons), int),
    )


def material_of_face(part: Part) -> np.ndarray:
    """(F,) index into part.mesh.materials, clipped as Blender does; -1 where the mesh has none."""
    slots = len(part.mesh.materials)
    index = _get(part.mesh.polygons, "material_index", 1, np.int32)
    return np.minimum(index, slots - 1)


def _get(collection: bpy.types.bpy_prop_collection, name: str, width: int, kind: type = np.float32) -> np.ndarray:
    values = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, values)
    values = values.astype(np.float64 if kind is np.float32 else np.int64)
    return values.reshape(-1, width) if width > 1 else values
