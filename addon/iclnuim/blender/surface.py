"""The open scene as triangles in world coordinates: what independent rays are cast against, and clearance is measured to."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from . import light_surfaces


@dataclass(frozen=True)
class Surface:
    """vertices (n, 3) in metres, our world; triangles (m, 3) indices; owners (m,) index into names, one per object."""

    vertices: np.ndarray
    triangles: np.ndarray
    owners: np.ndarray
    names: tuple[str, ...]


def triangles() -> Surface:
    """All surfaces a camera ray can meet: evaluated as for a render (modifiers, instances), without what is hidden from it."""
    with light_surfaces.as_rendered(bpy.context.scene) as depsgraph:
        return _triangles(depsgraph)


def _triangles(depsgraph: bpy.types.Depsgraph) -> Surface:
    vertices, faces, owners, names, count = [], [], [], [], 0
    for instance in depsgraph.object_instances:
        thing = instance.object
        if not _is_seen(thing):
            continue
        mesh = thing.to_mesh()
        points, corners = _arrays(mesh)
        thing.to_mesh_clear()
        if len(corners):
            to_world = np.array(instance.matrix_world)
            vertices.append(points @ to_world[:3, :3].T + to_world[:3, 3])
            faces.append(corners + count)
            owners.append(np.full(len(corners), len(names), np.int32))
            names.append(thing.name)
            count += len(points)
    if not vertices:
        return Surface(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int32), ())
    return Surface(np.concatenate(vertices), np.concatenate(faces), np.concatenate(owners), tuple(names))


def triangle_count() -> int:
    """How many triangles the open scene renders, those of every instance counted; curves and texts left out."""
    with light_surfaces.as_rendered(bpy.context.scene) as depsgraph:
        shown = (i.object for i in depsgraph.object_instances)
        meshes = (thing.data for thing in shown if thing.type == "MESH" and _is_seen(thing))
        return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)


def _is_seen(thing: bpy.types.Object) -> bool:
    return thing.type in {"MESH", "CURVE", "SURFACE", "META", "FONT"} and thing.visible_camera and not thing.hide_render


def _arrays(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    mesh.calc_loop_triangles()
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    corners = np.empty(len(mesh.loop_triangles) * 3, np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    return points.reshape(-1, 3).astype(float), corners.reshape(-1, 3)
