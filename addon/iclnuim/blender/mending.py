"""Makes a scene that came from outside safe to render: broken numbers, missing pictures, colours that only vertices carry.

All in memory. Each function returns sentences that say what was found and done.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import bmesh
import bpy
import numpy as np

#: Coordinates beyond this are as good as no number: float32 has no millimetres there.
_FARTHEST = 1e7
#: A face of less area than this (file units squared) is a line or a point.
_NO_AREA = 1e-14


def mend(scene: bpy.types.Scene) -> list[str]:
    """All of it, on the open session."""
    return [*_lost_objects(scene), *_broken_meshes(), *missing_images(), *_vertex_colours(scene), *_sleeping_scripts()]


def _lost_objects(scene: bpy.types.Scene) -> list[str]:
    """An object whose matrix holds no numbers cannot stand anywhere."""
    lost = [o for o in scene.objects if not np.isfinite(np.array(o.matrix_world)).all()]
    for thing in lost:
        thing.hide_render = thing.hide_viewport = True
    return [f"objects without a place ({_names(lost)}): left out"] if lost else []


def _broken_meshes() -> list[str]:
    gone = flat = texture = mended = 0
    for mesh in bpy.data.meshes:
        gone += _without_lost_vertices(mesh)
        mended += bool(mesh.validate(clean_customdata=False))
        flat += _flat_faces(mesh)
        texture += sum(_finite_uv(layer) for layer in mesh.uv_layers)
    found = []
    if gone:
        found.append(f"{gone} vertices are no numbers or farther than {_FARTHEST:.0e}: left out with their faces")
    if mended:
        found.append(f"{mended} meshes named vertices that are not there, or faces twice: such faces are left out")
    if flat:
        found.append(f"{flat} faces have no area: no ray meets them")
    if texture:
        found.append(f"{texture} texture coordinates are no numbers: taken as 0")
    return found


def _without_lost_vertices(mesh: bpy.types.Mesh) -> int:
    places = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", places)
    lost = np.flatnonzero(~(np.abs(places.reshape(-1, 3)) < _FARTHEST).all(1))
    if len(lost):
        # far away first: deleting walks over edges whose length must be a number
        places.reshape(-1, 3)[lost] = 0.0
        mesh.vertices.foreach_set("co", places)
        edited = bmesh.new()
        try:
            edited.from_mesh(mesh)
            edited.verts.ensure_lookup_table()
            bmesh.ops.delete(edited, geom=[edited.verts[int(k)] for k in lost], context="VERTS")
            edited.to_mesh(mesh)
        finally:
            edited.free()
    return len(lost)


def _flat_faces(mesh: bpy.types.Mesh) -> int:
    areas = np.empty(len(mesh.polygons), np.float32)
    mesh.polygons.foreach_get("area", areas)
    return int((~(areas > _NO_AREA)).sum())


def _finite_uv(layer: bpy.types.MeshUVLoopLayer) -> int:
    uv = np.empty(len(layer.data) * 2, np.float32)
    layer.data.foreach_get("uv", uv)
    lost = ~np.isfinite(uv)
    if lost.any():
        layer.data.foreach_set("uv", np.where(lost, 0.0, uv).astype(np.float32))
    return int(lost.sum())


def missing_images() -> list[str]:
    """Pictures that are not there, or cannot be read, are taken out of the materials: their plain values show, not magenta."""
    missing = [image for image in bpy.data.images if _is_missing(image)]
    if not missing:
        return []
    shown = [n for tree in _trees() for n in tree.nodes if getattr(n, "image", None) in missing]
    for node in shown:
        for output in node.outputs:
            for link in list(output.links):
                node.id_data.links.remove(link)
    names = _names(missing)
    for image in missing:
        bpy.data.images.remove(image)
    return [f"textures that are missing or broken ({names}): plain colour in their place"] if shown else []


def _is_missing(image: bpy.types.Image) -> bool:
    if image.source in ("GENERATED", "VIEWER"):
        return False
    with suppress(RuntimeError, OSError, ValueError):
        if image.source in ("SEQUENCE", "TILED"):
            return not any(Path(bpy.path.abspath(image.filepath, library=image.library)).parent.glob("*"))
        return not (image.size[0] and image.size[1])
    return True


def _trees() -> Iterator[bpy.types.NodeTree]:
    yield from bpy.data.node_groups
    for block in (*bpy.data.materials, *bpy.data.worlds, *bpy.data.lights):
        if block.node_tree is not None:
            yield block.node_tree


def _vertex_colours(scene: bpy.types.Scene) -> list[str]:
    """A mesh without any material that carries colours (a scan as PLY) shows them."""
    coloured = [
        o
        for o in scene.objects
        if o.type == "MESH" and not any(o.material_slots[k].material for k in range(len(o.material_slots)))
        if o.data.color_attributes
    ]
    for thing in coloured:
        thing.data.materials.clear()
        thing.data.materials.append(_coloured_by(thing.data.color_attributes[0].name))
    return ["surfaces without a material show the colours of their vertices"] if coloured else []


def _coloured_by(attribute: str) -> bpy.types.Material:
    name = f"colours of {attribute}"
    if name in bpy.data.materials:
        return bpy.data.materials[name]
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    source, matt, output = (tree.nodes.new(f"ShaderNode{n}") for n in ("Attribute", "BsdfDiffuse", "OutputMaterial"))
    source.attribute_name = attribute
    tree.links.new(source.outputs["Color"], matt.inputs["Color"])
    tree.links.new(matt.outputs[0], output.inputs["Surface"])
    return material


def _sleeping_scripts() -> list[str]:
    scripts = [t.name for t in bpy.data.texts if t.use_module]
    return [f"scripts in the file ({_names(scripts)}): not run"] if scripts else []


def _names(things: Iterable) -> str:
    names = sorted(t if isinstance(t, str) else t.name for t in things)
    shown = ", ".join(names[:5])
    return shown[:160] + (f" and {len(names) - 5} more" if len(names) > 5 else "")
