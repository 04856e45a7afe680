"""Puts numpy meshes into the Blender scene: one named object per thing, with instance id, class and
sharp edges.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence

import bpy
import numpy as np

from .coarsening import coarser, feature_m
from .mesh import Mesh, face_normals

SHARP_DEG = 38.0  # edges with a larger angle between their faces are sharp


class Stage:
    """Adds objects to the current scene; instance ids count up from 1 in this order.

    Below full detail, small features are removed.
    """

    def __init__(
        self, seed: int, materials: dict[str, bpy.types.Material], detail: float = 1.0
    ) -> None:
        self.seed = seed
        self.materials = materials
        self.feature_m = feature_m(detail)
        self.count = 0

    def add(
        self, name: str, class_name: str, mesh: Mesh, materials: str | Sequence[str]
    ) -> bpy.types.Object:
        """One object from a mesh in world coordinates; slot k shows material materials[k], or the
        only one.
        """
        if isinstance(materials, str):
            materials = [materials]
        self.count += 1
        data = to_blender(name, coarser(mesh, self.feature_m) if self.feature_m > 0 else mesh)
        for key in materials:
            data.materials.append(self.materials[key])
        obj = bpy.data.objects.new(name, data)
        obj["instance_id"] = self.count
        obj["class_name"] = class_name
        obj.pass_index = self.count
        bpy.context.scene.collection.objects.link(obj)
        return obj


def to_blender(name: str, mesh: Mesh) -> bpy.types.Mesh:
    """Make a Blender mesh.

    Vertices are rounded to a micrometre, so that every numpy and Blender version gives the same
    bytes.
    """
    is_tri = mesh.faces[:, 3] < 0
    sizes = np.where(is_tri, 3, 4)
    corners = mesh.faces.reshape(-1)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int32)
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(mesh.verts))
    data.vertices.foreach_set("co", np.round(mesh.verts, 6).astype(np.float32).reshape(-1))
    data.loops.add(int(sizes.sum()))
    data.loops.foreach_set("vertex_index", corners[corners >= 0].astype(np.int32))
    data.polygons.add(len(mesh.faces))
    data.polygons.foreach_set("loop_start", starts)
    data.polygons.foreach_set("material_index", mesh.material.astype(np.int32))
    data.update(calc_edges=True)
    layer = data.uv_layers.new(name="UVMap")
    layer.data.foreach_set(
        "uv", mesh.uv.reshape(-1, 2)[corners >= 0].astype(np.float32).reshape(-1)
    )
    data.polygons.foreach_set("use_smooth", np.ones(len(mesh.faces), bool))
    _mark_sharp(data, mesh, sizes)
    return data


def _mark_sharp(data: bpy.types.Mesh, mesh: Mesh, sizes: np.ndarray) -> None:
    edge_of_corner = np.empty(int(sizes.sum()), np.int32)
    data.loops.foreach_get("edge_index", edge_of_corner)
    face_of_corner = np.repeat(np.arange(len(sizes)), sizes)
    order = np.argsort(edge_of_corner, kind="stable")
    edge = edge_of_corner[order]
    face = face_of_corner[order]
    pair = np.flatnonzero(edge[1:] == edge[:-1])
    normal = face_normals(mesh)
    cosine = np.einsum("ij,ij->i", normal[face[pair]], normal[face[pair + 1]])
    sharp = np.zeros(len(data.edges), bool)
    sharp[edge[pair]] = cosine < np.cos(np.radians(SHARP_DEG))
    attribute = data.attributes.new("sharp_edge", "BOOLEAN", "EDGE")
    attribute.data.foreach_set("value", sharp)


def _evaluated_meshes() -> Iterator[tuple[bpy.types.Object, bpy.types.Mesh]]:
    graph = bpy.context.evaluated_depsgraph_get()
    for obj in sorted(bpy.context.scene.objects, key=lambda o: o.name):
        if obj.type == "MESH":
            yield obj, obj.evaluated_get(graph).data


def geometry_hash() -> str:
    """SHA-256 over names, ids, classes, placements and the evaluated vertex and face arrays of the
    current scene.
    """
    digest = hashlib.sha256()
    for obj, data in _evaluated_meshes():
        digest.update(f"{obj.name}|{obj['instance_id']}|{obj['class_name']}|".encode())
        digest.update(np.array(obj.matrix_world, np.float32).tobytes())
        for items, key, kind, width in (
            (data.vertices, "co", np.float32, 3),
            (data.loops, "vertex_index", np.int32, 1),
            (data.polygons, "loop_start", np.int32, 1),
        ):
            values = np.empty(len(items) * width, kind)
            items.foreach_get(key, values)
            digest.update(values.tobytes())
    return digest.hexdigest()


def triangle_count() -> int:
    """Triangles of all meshes in the current scene."""
    meshes = [data for _, data in _evaluated_meshes()]
    return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)
