"""The surfaces of the open scene as rendered: as triangles in the world, and as mesh objects that
can have light maps.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any

import bpy
import mathutils
import numpy as np

from ..lightmap.surfaces import Surfaces, join
from .compat import temporarily

SURFACE_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
#: Properties for the level of detail in the viewport and in renders: subdivision and
#: multiresolution, screws, curves, metaballs, oceans.
_LEVELS = (
    ("levels", "render_levels"), ("steps", "render_steps"), ("resolution_u", "render_resolution_u"),
    ("resolution_v", "render_resolution_v"), ("resolution", "render_resolution"), ("viewport_resolution", "resolution"),
)  # fmt: skip


@dataclass(frozen=True)
class Surface:
    """vertices (n, 3) in metres, our world; triangles (m, 3) indices; owners (m,) index into names,
    one per object; held_out (m,): whether the
    object is a holdout: frames have no depth there.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    owners: np.ndarray
    names: tuple[str, ...]
    held_out: np.ndarray


@dataclass(frozen=True, eq=False)
class Part:
    """One rendered object or instance: a copy of its evaluated mesh, its matrix, and the object it
    was made from.

    `origin`: the object to hide when the part replaces it. `single`: the part is everything that
    this object shows. `shared`: other parts have the same mesh.
    """

    name: str
    mesh: bpy.types.Mesh
    matrix: mathutils.Matrix
    source: bpy.types.Object
    origin: bpy.types.Object
    single: bool
    shared: bool = False

    def vertices_m(self) -> np.ndarray:
        """(n, 3) in metres, our world."""
        matrix = np.array(self.matrix)
        return (
            array_of(self.mesh.vertices, "co", 3).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
        )


def triangles(panes: bool = True) -> Surface:
    """All surfaces that camera rays can hit, evaluated as for a render (modifiers, instances),
    without hidden objects.

    panes: include surfaces that only have a Transparent BSDF.
    """
    vertices, faces, owners, count = (
        [np.zeros((0, 3))],
        [np.zeros((0, 3), np.int32)],
        [np.zeros(0, np.int32)],
        0,
    )
    names: list[str] = []
    held_out: list[bool] = []
    with rendered_parts() as (found, _):
        for part in found:
            if part.source.visible_camera and len(part.mesh.loop_triangles):
                vertices.append(part.vertices_m())
                kept = solid(part) if panes else solid(part) & ~_is_pane(part)
                faces.append(
                    array_of(part.mesh.loop_triangles, "vertices", 3, np.int32)[kept] + count
                )
                owners.append(np.full(len(faces[-1]), len(names), np.int32))
                names.append(part.name)
                held_out.append(part.source.is_holdout)
                count += len(vertices[-1])
    owner = np.concatenate(owners)
    return Surface(
        np.concatenate(vertices),
        np.concatenate(faces),
        owner,
        tuple(names),
        np.array(held_out, bool)[owner],
    )


def box_corners_m(things: Iterable[bpy.types.Object]) -> np.ndarray:
    """(n, 3) the corners of the objects' bounding boxes in the world; the origin if there are no
    objects.
    """
    corners = []
    for thing in things:
        matrix = np.array(thing.matrix_world)
        corners += [matrix @ (*corner, 1.0) for corner in thing.bound_box]
    return np.array(corners or [np.zeros(4)])[:, :3]


def triangle_count() -> int:
    """The number of triangles that the open scene renders, including every instance, without curves
    and texts.
    """
    with as_rendered(bpy.context.scene) as depsgraph:
        shown = ((i.object, i.is_instance) for i in depsgraph.object_instances if i.show_self)
        seen = (
            thing
            for thing, instanced in shown
            if thing.visible_camera and (instanced or not thing.hide_render)
        )
        meshes = (thing.data for thing in seen if thing.type == "MESH")
        return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)


@contextmanager
def as_rendered(scene: bpy.types.Scene) -> Iterator[bpy.types.Depsgraph]:
    """The scene evaluated as for rendering: visibility, modifiers, curves and metaballs have their
    settings for rendering instead of those for the
    viewport, also for objects that are only instanced.
    """
    with ExitStack() as stack:

        def hold(thing: Any, **values: object) -> None:
            stack.enter_context(
                temporarily(thing, **{k: v for k, v in values.items() if getattr(thing, k) != v})
            )

        for collection in bpy.data.collections:
            hold(collection, hide_viewport=collection.hide_render)
        for layer in layers_below(bpy.context.view_layer.layer_collection):
            hold(layer, hide_viewport=False)
        for thing in bpy.data.objects:
            hold(
                thing,
                hide_viewport=thing.hide_render,
                show_instancer_for_viewport=thing.show_instancer_for_render,
            )
            if thing.hide_get():
                thing.hide_set(False)
                stack.callback(thing.hide_set, True)
            for modifier in thing.modifiers:
                hold(modifier, show_viewport=modifier.show_render, **_levels(modifier))
            hold(thing.data, **_levels(thing.data))
        for tree in (tree for tree in bpy.data.node_groups if tree.bl_idname == "GeometryNodeTree"):
            for node in (node for node in tree.nodes if node.bl_idname == "GeometryNodeIsViewport"):
                hold(node, mute=True)  # then its output is False
        depsgraph = bpy.context.evaluated_depsgraph_get()
        depsgraph.update()
        yield depsgraph


def _levels(thing: Any) -> dict[str, object]:
    """Viewport properties for the level of detail of a modifier, curve or metaball, and their
    values in renders. 0 usually means no change.
    """
    both = [
        (shown, rendered)
        for shown, rendered in _LEVELS
        if hasattr(thing, shown) and hasattr(thing, rendered)
    ]
    levels = {shown: getattr(thing, rendered) for shown, rendered in both}
    return {shown: level for shown, level in levels.items() if level or shown == "levels"}


def layers_below(
    layer: bpy.types.LayerCollection, rendered: bool = False
) -> list[bpy.types.LayerCollection]:
    """All layer collections below `layer`, or only those that render.

    The top one is never hidden.
    """
    shown = [
        c for c in layer.children if not (rendered and (c.exclude or c.collection.hide_render))
    ]
    return [inner for child in shown for inner in (child, *layers_below(child, rendered))]


def parts(depsgraph: bpy.types.Depsgraph) -> list[Part]:
    """Every rendered surface, with instances made real, in Blender's order.

    The caller must remove the meshes.
    """
    found: list[Part] = []
    data: list[int] = []
    for instance in depsgraph.object_instances:
        thing = instance.object
        hidden = thing.original.hide_render and not instance.is_instance
        if not instance.show_self or thing.type not in SURFACE_TYPES or hidden:
            continue
        # an instance made by Geometry Nodes is not an object: it has a mesh and materials, but the
        # name of the object
        by_nodes = instance.is_instance and instance.parent.original == thing.original
        if by_nodes and isinstance(thing.data, bpy.types.Mesh):
            mesh = thing.data.copy()
        else:
            mesh = bpy.data.meshes.new_from_object(
                thing, preserve_all_data_layers=True, depsgraph=depsgraph
            )
        if mesh is None or not len(mesh.polygons):
            continue
        mesh.calc_loop_triangles()
        shown = mesh.materials if by_nodes else [slot.material for slot in thing.material_slots]
        for number, material in enumerate(shown):
            # materials may be linked to the object instead of its data; clearing the mesh's
            # materials would reset the faces' indices
            material = material and material.original
            if number < len(mesh.materials):
                mesh.materials[number] = material
            else:
                mesh.materials.append(material)
        if isinstance(
            thing.data, bpy.types.Mesh
        ):  # generated coordinates refer to its bounding box before the modifiers
            mesh.use_auto_texspace = False
            mesh.texspace_location, mesh.texspace_size = (
                thing.data.texspace_location,
                thing.data.texspace_size,
            )
        origin = instance.parent.original if instance.is_instance else thing.original
        matrix, single = instance.matrix_world.copy(), not instance.is_instance
        found.append(Part(thing.name, mesh, matrix, thing.original, origin, single))
        data.append(thing.data.as_pointer())
    users = Counter(data)
    return [
        replace(part, shared=users[pointer] > 1) for part, pointer in zip(found, data, strict=True)
    ]


@contextmanager
def rendered_parts() -> Iterator[tuple[list[Part], bpy.types.Depsgraph]]:
    """The parts of the open scene as rendered.

    Their meshes are removed at the end of the `with` block.
    """
    with as_rendered(bpy.context.scene) as depsgraph:
        found = parts(depsgraph)
        try:
            yield found, depsgraph
        finally:
            for part in found:
                bpy.data.meshes.remove(part.mesh)


def joined(found: list[Part]) -> Surfaces:
    """All parts as arrays in world coordinates, numbered in their order."""
    return join([_surfaces(part) for part in found])


def _surfaces(part: Part) -> Surfaces:
    mesh, matrix = part.mesh, np.array(part.matrix)
    vertices = part.vertices_m()
    vertex_of_corner = array_of(mesh.loops, "vertex_index", 1, np.int32)
    triangles = array_of(mesh.loop_triangles, "loops", 3, np.int32).astype(int)
    mirrored = np.linalg.det(matrix[:3, :3]) < 0  # wound the other way
    welded = np.unique(np.round(vertices / 1e-5).astype(np.int64), axis=0, return_inverse=True)[
        1
    ].reshape(-1)
    return Surfaces(
        corners_m=vertices[vertex_of_corner],
        normals=world_normals(part, mesh.corner_normals),
        vertex=welded[vertex_of_corner],
        face_start=np.append(
            array_of(mesh.polygons, "loop_start", 1, np.int32).astype(int), len(mesh.loops)
        ),
        triangles=triangles[:, ::-1] if mirrored else triangles,
        triangle_face=array_of(mesh.loop_triangles, "polygon_index", 1, np.int32).astype(int),
        face_object=np.zeros(len(mesh.polygons), int),
    )


def world_normals(part: Part, found: Any) -> np.ndarray:
    """(n, 3) unit normals in the world, of the corners or vertices of a part."""
    normals = array_of(found, "vector", 3).astype(float) @ _normal_matrix(
        np.array(part.matrix)[:3, :3]
    )
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _normal_matrix(linear: np.ndarray) -> np.ndarray:
    """(3, 3): rows of normals times this matrix are normals in the world, up to scale; for a
    singular matrix it is made from the cofactors.
    """
    if np.linalg.matrix_rank(linear) == 3:
        return np.linalg.inv(linear)
    x, y, z = linear.T
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])


def rendered_lamps(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The lamps that are rendered: not hidden, and in at least one collection that is not hidden."""
    top = bpy.context.view_layer.layer_collection
    shown = {
        thing
        for layer in (top, *layers_below(top, rendered=True))
        for thing in layer.collection.objects
    }
    return [
        thing
        for thing in scene.objects
        if thing.type == "LIGHT" and not thing.hide_render and thing in shown
    ]


def put(thing: bpy.types.Object, matrix: mathutils.Matrix) -> list[bpy.types.Object]:
    """Set the world matrix of an object without a parent. An object's own matrix cannot shear: in
    that case it gets an empty as a parent, which is
    returned.
    """
    matrix = matrix.copy()
    thing.matrix_world = matrix
    if np.allclose(
        np.array(mathutils.Matrix.LocRotScale(*matrix.decompose())), np.array(matrix), atol=1e-5
    ):
        return []
    parent = bpy.data.objects.new("sheared", None)
    bpy.context.scene.collection.objects.link(parent)
    thing.matrix_basis.identity()
    thing.parent, thing.matrix_parent_inverse = parent, matrix
    return [parent]


def make_lamps_real() -> None:
    """Make instanced lamps objects of the scene, because a light map is sampled lamp by lamp."""
    with as_rendered(bpy.context.scene) as depsgraph:
        shown = [
            (i.object.original, i.matrix_world.copy(), i.is_instance)
            for i in depsgraph.object_instances
            if i.object.type == "LIGHT"
        ]
    instanced = {lamp for lamp, _, is_instance in shown if is_instance}
    for lamp, matrix, _ in (row for row in shown if row[0] in instanced):
        made = lamp.copy()
        made.animation_data_clear()
        made.constraints.clear()
        made.parent = None
        bpy.context.scene.collection.objects.link(made)
        put(made, matrix)
    for lamp in instanced:
        lamp.hide_render = True


def material_of_face(part: Part) -> np.ndarray:
    """(F,) index into part.mesh.materials, clipped as in Blender; -1 if the mesh has none."""
    slots = len(part.mesh.materials)
    index = array_of(part.mesh.polygons, "material_index", 1, np.int32).astype(int)
    return np.minimum(index, slots - 1)


def solid(part: Part) -> np.ndarray:
    """(m,) whether a camera ray ends at the triangle; it does not at the bounds of a volume without
    a surface.
    """
    ends = [
        not (o and o.inputs["Volume"].is_linked and not o.inputs["Surface"].is_linked)
        for o in _outputs(part)
    ]
    return _of_triangles(part, ends)


def _is_pane(part: Part) -> np.ndarray:
    """(m,) whether light passes straight through the triangle."""
    links = [list(o.inputs["Surface"].links) if o else [] for o in _outputs(part)]
    return _of_triangles(
        part, [any(link.from_node.type == "BSDF_TRANSPARENT" for link in own) for own in links]
    )


def _outputs(part: Part) -> list[Any]:
    """The Cycles output node of each material of the part; None for a material without nodes."""
    return [
        m and m.use_nodes and m.node_tree.get_output_node("CYCLES") for m in part.mesh.materials
    ] or [None]


def _of_triangles(part: Part, of_materials: list[bool]) -> np.ndarray:
    """(m,) the value of the material of each triangle."""
    of_triangle = array_of(part.mesh.loop_triangles, "polygon_index", 1, np.int32)
    return np.array(of_materials)[np.maximum(material_of_face(part), 0)][of_triangle]


def array_of(collection: Any, name: str, width: int = 1, kind: type = np.float32) -> np.ndarray:
    """(n, width), or (n,) for width 1: an attribute of all vertices, corners or faces of a mesh, in
    Blender's type.
    """
    values: np.ndarray = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, values)
    return values.reshape(-1, width) if width > 1 else values
