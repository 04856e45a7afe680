"""The surfaces of the open scene as rendered: as triangles in the world, and as mesh objects that
can have light maps.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any

import bpy
import mathutils
import numpy as np
from bpy.types import (
    Depsgraph,
    DepsgraphObjectInstance,
    FCurve,
    LayerCollection,
    Mesh,
    Object,
    Scene,
)

from ..lightmap.surfaces import Surfaces, join
from .compat import animated_curves, temporarily

#: Points closer than this are at the same position.
_SAME_PLACE_M = 1e-5
SURFACE_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
#: Properties for the level of detail in the viewport and in renders: subdivision and
#: multiresolution, screws, curves, metaballs, oceans.
_LEVELS = (
    ("levels", "render_levels"), ("steps", "render_steps"), ("resolution_u", "render_resolution_u"),
    ("resolution_v", "render_resolution_v"), ("resolution", "render_resolution"),
    ("viewport_resolution", "resolution"),
)  # fmt: skip


@dataclass(frozen=True)
class Surface:
    """vertices (n, 3) in metres, our world; triangles (m, 3) indices; owners (m,) index into names,
    one per object; held_out (m,): whether the object is a holdout: frames have no depth there;
    classes: the class of each object, "" for none.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    owners: np.ndarray
    names: tuple[str, ...]
    held_out: np.ndarray
    classes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Part:
    """One rendered object or instance: a copy of its evaluated mesh, its matrix, and the object it
    was made from.

    `origin`: the object to hide when the part replaces it. `single`: the part is everything that
    this object shows. `shared`: other parts have the same mesh.
    """

    name: str
    mesh: Mesh
    matrix: mathutils.Matrix
    source: Object
    origin: Object
    single: bool
    shared: bool = False

    def vertices_m(self) -> np.ndarray:
        """(n, 3) in metres, our world."""
        matrix = np.array(self.matrix)
        vertices = array_of(self.mesh.vertices, "co", 3).astype(float)
        return vertices @ matrix[:3, :3].T + matrix[:3, 3]


def triangles(panes: bool = True) -> Surface:
    """All surfaces that camera rays can hit, evaluated as for a render (modifiers, instances),
    without hidden objects.

    panes: include surfaces that only have a Transparent BSDF.
    """
    vertices = [np.zeros((0, 3))]
    faces = [np.zeros((0, 3), np.int32)]
    counts: list[int] = []
    shown: list[Part] = []
    start = 0
    with rendered_parts() as (found, _):
        for part in found:
            if part.source.visible_camera and len(part.mesh.loop_triangles):
                kept = solid(part) if panes else solid(part) & ~_is_pane(part)
                vertices.append(part.vertices_m())
                faces.append(array_of(part.mesh.loop_triangles, "vertices", 3, np.int32)[kept])
                faces[-1] += start
                start += len(vertices[-1])
                counts.append(len(faces[-1]))
                shown.append(part)
    owners = np.repeat(np.arange(len(shown), dtype=np.int32), counts)
    held_out = np.array([part.source.is_holdout for part in shown], bool)
    return Surface(
        vertices=np.concatenate(vertices),
        triangles=np.concatenate(faces),
        owners=owners,
        names=tuple(part.name for part in shown),
        held_out=held_out[owners],
        classes=tuple(class_name(part.source) or "" for part in shown),
    )


def class_name(thing: Object) -> str | None:
    """The class of an object, its custom property `class_name`; None if it has none."""
    own = thing.get("class_name")
    return own if isinstance(own, str) and own else None


def box_corners_m(things: Iterable[Object]) -> np.ndarray:
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
    count = 0
    with as_rendered(bpy.context.scene) as depsgraph:
        for instance in depsgraph.object_instances:
            thing = instance.object
            if not instance.show_self or thing.type != "MESH" or not thing.visible_camera:
                continue
            if instance.is_instance or not thing.hide_render:
                count += len(thing.data.loops) - 2 * len(thing.data.polygons)
    return count


@contextmanager
def as_rendered(scene: Scene) -> Iterator[Depsgraph]:
    """The scene evaluated as for rendering: visibility, modifiers, curves and metaballs have their
    settings for rendering instead of those for the viewport, also for objects that are only
    instanced.
    """
    with ExitStack() as stack:

        def hold(thing: Any, **values: object) -> None:
            changed = {name: v for name, v in values.items() if getattr(thing, name) != v}
            stack.enter_context(temporarily(thing, **changed))

        for collection in bpy.data.collections:
            hold(collection, hide_viewport=collection.hide_render)
        for layer in layers_below(bpy.context.view_layer.layer_collection):
            hold(layer, hide_viewport=False)
        for thing in bpy.data.objects:
            hold(thing, hide_viewport=thing.hide_render)
            hold(thing, show_instancer_for_viewport=thing.show_instancer_for_render)
            if thing.hide_get():
                thing.hide_set(False)
                stack.callback(thing.hide_set, True)
            for modifier in thing.modifiers:
                hold(modifier, show_viewport=modifier.show_render, **_levels(modifier))
            hold(thing.data, **_levels(thing.data))
        for tree in bpy.data.node_groups:
            for node in tree.nodes:
                if node.bl_idname == "GeometryNodeIsViewport":
                    hold(node, mute=True)  # then its output is False
        depsgraph = bpy.context.evaluated_depsgraph_get()
        depsgraph.update()
        yield depsgraph


def frame_changer(scene: Scene) -> Callable[[float], None]:
    """A function that changes the frame within as_rendered(), with the objects that are rendered
    then.

    Blender does not evaluate the animation of an object that the viewport does not show. Showing it
    takes as long as building the scene, so that a plain curve is read instead.
    """
    curves = {thing: _hiding_curves(thing) for thing in bpy.data.objects}
    appearing = {thing: found for thing, found in curves.items() if found}

    def go_to(frame: float) -> None:
        for thing, found in appearing.items():
            hidden = False
            if _is_plain(thing, found):
                hidden = found[0].evaluate(frame) >= 1
                _assign(thing, "hide_render", hidden)
            _assign(thing, "hide_viewport", hidden)
        scene.frame_set(math.floor(frame), subframe=frame % 1)
        if any([_assign(thing, "hide_viewport", thing.hide_render) for thing in appearing]):
            bpy.context.view_layer.update()

    return go_to


def _hiding_curves(thing: Object) -> list[FCurve]:
    """The curves and drivers that decide whether an object is rendered."""
    curves = [*animated_curves(thing), *getattr(thing.animation_data, "drivers", ())]
    return [curve for curve in curves if curve.data_path == "hide_render"]


def _is_plain(thing: Object, curves: list[FCurve]) -> bool:
    """Whether the value of one curve decides alone."""
    data = thing.animation_data
    return len(curves) == 1 and not (curves[0].mute or curves[0].driver or len(data.nla_tracks))


def _assign(thing: Object, name: str, value: bool) -> bool:
    """Set a property unless it has the value, as Blender builds the scene again. Whether it was
    set.
    """
    is_other = getattr(thing, name) != value
    if is_other:
        setattr(thing, name, value)
    return is_other


def _levels(thing: Any) -> dict[str, object]:
    """Viewport properties for the level of detail of a modifier, curve or metaball, and their
    values in renders. 0 usually means no change.
    """
    levels = {}
    for shown, rendered in _LEVELS:
        if hasattr(thing, shown) and hasattr(thing, rendered):
            level = getattr(thing, rendered)
            if level or shown == "levels":
                levels[shown] = level
    return levels


def layers_below(layer: LayerCollection, rendered: bool = False) -> list[LayerCollection]:
    """All layer collections below `layer`, or only those that render.

    The top one is never hidden.
    """
    below = []
    for child in layer.children:
        if not rendered or not (child.exclude or child.collection.hide_render):
            below += [child, *layers_below(child, rendered)]
    return below


def parts(depsgraph: Depsgraph) -> list[Part]:
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
        mesh = _mesh_of(instance, depsgraph)
        if mesh is None or not len(mesh.polygons):
            continue
        origin = instance.parent.original if instance.is_instance else thing.original
        matrix = instance.matrix_world.copy()
        is_single = not instance.is_instance
        found.append(Part(thing.name, mesh, matrix, thing.original, origin, is_single))
        data.append(thing.data.as_pointer())
    users = Counter(data)
    return [replace(part, shared=users[k] > 1) for part, k in zip(found, data, strict=True)]


def _mesh_of(instance: DepsgraphObjectInstance, depsgraph: Depsgraph) -> Mesh | None:
    """A copy of the evaluated mesh of an instance, with the materials that it shows."""
    thing = instance.object
    # an instance made by Geometry Nodes is not an object: it has a mesh and materials, but the name
    # of the object
    by_nodes = instance.is_instance and instance.parent.original == thing.original
    if by_nodes and isinstance(thing.data, Mesh):
        mesh = thing.data.copy()
    else:
        options = {"preserve_all_data_layers": True, "depsgraph": depsgraph}
        mesh = bpy.data.meshes.new_from_object(thing, **options)
    if mesh is None or not len(mesh.polygons):
        return mesh
    mesh.calc_loop_triangles()
    shown = mesh.materials if by_nodes else [slot.material for slot in thing.material_slots]
    for number, material in enumerate(shown):
        # materials may be linked to the object instead of its data; clearing the mesh's materials
        # would reset the faces' indices
        material = material and material.original
        if number < len(mesh.materials):
            mesh.materials[number] = material
        else:
            mesh.materials.append(material)
    if isinstance(thing.data, Mesh):
        # generated coordinates refer to its bounding box before the modifiers
        mesh.use_auto_texspace = False
        mesh.texspace_location = thing.data.texspace_location
        mesh.texspace_size = thing.data.texspace_size
    return mesh


@contextmanager
def rendered_parts() -> Iterator[tuple[list[Part], Depsgraph]]:
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
    mesh = part.mesh
    vertices = part.vertices_m()
    vertex_of_corner = array_of(mesh.loops, "vertex_index", 1, np.int32)
    triangles = array_of(mesh.loop_triangles, "loops", 3, np.int32).astype(int)
    if np.linalg.det(np.array(part.matrix)[:3, :3]) < 0:  # wound the other way
        triangles = triangles[:, ::-1]
    starts = array_of(mesh.polygons, "loop_start", 1, np.int32).astype(int)
    places = np.round(vertices / _SAME_PLACE_M).astype(np.int64)
    _, welded = np.unique(places, axis=0, return_inverse=True)
    return Surfaces(
        corners_m=vertices[vertex_of_corner],
        normals=world_normals(part, mesh.corner_normals),
        vertex=welded.reshape(-1)[vertex_of_corner],
        face_start=np.append(starts, len(mesh.loops)),
        triangles=triangles,
        triangle_face=array_of(mesh.loop_triangles, "polygon_index", 1, np.int32).astype(int),
        face_object=np.zeros(len(mesh.polygons), int),
    )


def world_normals(part: Part, found: Any) -> np.ndarray:
    """(n, 3) unit normals in the world, of the corners or vertices of a part."""
    to_world = _normal_matrix(np.array(part.matrix)[:3, :3])
    normals = array_of(found, "vector", 3).astype(float) @ to_world
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _normal_matrix(linear: np.ndarray) -> np.ndarray:
    """(3, 3): rows of normals times this matrix are normals in the world, up to scale; for a
    singular matrix it is made from the cofactors.
    """
    if np.linalg.matrix_rank(linear) == 3:
        return np.linalg.inv(linear)
    x, y, z = linear.T
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])


def rendered_objects(scene: Scene, types: set[str]) -> list[Object]:
    """The objects of these types that are rendered: not hidden, and in at least one collection that
    is not hidden.
    """
    top = bpy.context.view_layer.layer_collection
    shown = set(top.collection.objects)
    for layer in layers_below(top, rendered=True):
        shown.update(layer.collection.objects)
    return [o for o in scene.objects if o in shown and o.type in types and not o.hide_render]


def put(thing: Object, matrix: mathutils.Matrix) -> list[Object]:
    """Set the world matrix of an object without a parent. An object's own matrix cannot shear: in
    that case it gets an empty as a parent, which is returned.
    """
    matrix = matrix.copy()
    thing.matrix_world = matrix
    without_shear = mathutils.Matrix.LocRotScale(*matrix.decompose())
    if np.allclose(np.array(without_shear), np.array(matrix), atol=_SAME_PLACE_M):
        return []
    parent = bpy.data.objects.new("sheared", None)
    bpy.context.scene.collection.objects.link(parent)
    thing.matrix_basis.identity()
    thing.parent = parent
    thing.matrix_parent_inverse = matrix
    return [parent]


def make_lamps_real() -> None:
    """Make instanced lamps objects of the scene, because a light map is sampled lamp by lamp."""
    with as_rendered(bpy.context.scene) as depsgraph:
        shown = []
        instanced = set()
        for instance in depsgraph.object_instances:
            lamp = instance.object.original
            if lamp.type == "LIGHT":
                shown.append((lamp, instance.matrix_world.copy()))
                if instance.is_instance:
                    instanced.add(lamp)
    for lamp, matrix in shown:
        if lamp not in instanced:
            continue
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
    ends = []
    for output in _outputs(part):
        sockets = output and output.inputs
        ends.append(
            not (sockets and sockets["Volume"].is_linked and not sockets["Surface"].is_linked)
        )
    return _of_triangles(part, ends)


def _is_pane(part: Part) -> np.ndarray:
    """(m,) whether light passes straight through the triangle."""
    panes = []
    for output in _outputs(part):
        links = output.inputs["Surface"].links if output else ()
        panes.append(any(link.from_node.type == "BSDF_TRANSPARENT" for link in links))
    return _of_triangles(part, panes)


def _outputs(part: Part) -> list[Any]:
    """The Cycles output node of each material of the part; None for a material without nodes."""
    outputs = []
    for material in part.mesh.materials:
        has_nodes = material and material.use_nodes
        outputs.append(material.node_tree.get_output_node("CYCLES") if has_nodes else None)
    return outputs or [None]


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
