"""The open scene as a surface with textures: all evaluated surfaces that are visible to cameras, in
world coordinates.
"""

import numpy as np
from bpy.types import Image, Material, NodeSocket, NodeTree

from ...errors import InputError
from ...formats.scene_model import Appearance, SceneModel
from ...sensor.transfer import srgb8
from .. import surfaces
from ..surfaces import Part, array_of
from . import ground_truth

#: Maximum difference of unit normals: a flat face whose triangles differ more (0.006 degrees) is
#: not planar.
_PLANE = 1e-4
_GREY = (0.8, 0.8, 0.8)
#: Shader nodes and inputs in which a material's colour is searched, in this order.
_SHADERS = {
    "BSDF_PRINCIPLED": "Base Color", "BSDF_DIFFUSE": "Color", "EMISSION": "Color", "BSDF_GLOSSY":
    "Color",
    "BSDF_TRANSLUCENT": "Color", "BSDF_TRANSPARENT": "Color",
}  # fmt: skip


def scene_model(stretched: bool = False) -> SceneModel:
    """The open scene as a SceneModel. Objects have the instance numbers of the frames; held-out
    objects have 0. Raises InputError for a scene without surfaces.

    stretched: normals of meshes that several objects share are scaled by their matrices and are not
    unit vectors: Cycles interpolates these in the mesh's space, and those of other meshes in the
    world.
    """
    ground_truth.number_objects()
    with surfaces.rendered_parts() as (found, _):
        parts = [part for part in found if part.source.visible_camera]
        if not parts:
            raise InputError("a scene with surfaces", found="none")
        joined = surfaces.joined(parts)
        counts = [len(part.mesh.loop_triangles) for part in parts]
        corners_m = joined.corners_m[joined.triangles]
        normals = joined.normals[joined.triangles]
        looks: dict[Material | None, int] = {}
        material = []
        start = 0
        for part, count in zip(parts, counts, strict=True):
            here = slice(start, start + count)
            start += count
            _shade_as_cycles(part, corners_m[here], normals[here])
            if stretched and part.shared:
                in_mesh = normals[here] @ np.array(part.matrix)[:3, :3]
                lengths = np.linalg.norm(in_mesh, axis=-1, keepdims=True)
                normals[here] /= lengths.clip(1e-12)
            material.append(_materials(part, looks))
        numbers = [_number(part) for part in parts]
        model = SceneModel(
            corners_m=corners_m,
            normals=normals,
            uv=np.concatenate([_uv(part) for part in parts]),
            material=np.concatenate(material),
            instance=np.repeat(numbers, counts),
            looks=tuple(map(_look, looks)),
            names={n: part.source.name for n, part in zip(numbers, parts, strict=True) if n},
        )
        return model.chosen(np.concatenate([surfaces.solid(part) for part in parts]))


def _number(part: Part) -> int:
    return 0 if part.source.is_holdout else part.source.pass_index


def _shade_as_cycles(part: Part, corners_m: np.ndarray, normals: np.ndarray) -> None:
    """Change normals (m, 3, 3) where Cycles does not use the normals of Blender's corners: flat
    faces that are not planar are shaded per triangle, smooth faces in a mesh with flat faces by
    their vertices. Meshes with custom normals or sharp edges are not changed.
    """
    mesh = part.mesh
    sharp = mesh.attributes.get("sharp_edge")
    if sharp is not None and array_of(sharp.data, "value", 1, bool).any():
        return
    if mesh.has_custom_normals:
        return
    of_triangle = array_of(mesh.loop_triangles, "polygon_index", 1, np.int32)
    smooth = array_of(mesh.polygons, "use_smooth", 1, bool)[of_triangle]
    if smooth.any() and not smooth.all():
        vertices = array_of(mesh.loop_triangles, "vertices", 3, np.int32)[smooth]
        wound = -1 if part.matrix.determinant() < 0 else 1  # the same order as in `joined`
        normals[smooth] = surfaces.world_normals(part, mesh.vertex_normals)[vertices[:, ::wound]]
    a, b, c = np.moveaxis(corners_m, 1, 0)
    own = np.cross(b - a, c - a)
    own /= np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-30)
    bent = ~smooth & own.any(1) & (np.linalg.norm(normals[:, 0] - own, axis=1) > _PLANE)
    normals[bent] = own[bent, None]


def _materials(part: Part, looks: dict[Material | None, int]) -> np.ndarray:
    """(m,) number of each triangle's material in `looks`; new materials are added to it."""
    slots = list(part.mesh.materials) or [None]
    numbers = np.array([looks.setdefault(material, len(looks)) for material in slots])
    of_triangle = array_of(part.mesh.loop_triangles, "polygon_index", 1, np.int32)
    return numbers[np.maximum(surfaces.material_of_face(part), 0)][of_triangle]


def _uv(part: Part) -> np.ndarray:
    """(m, 3, 2) texture coordinates of the UV map used for rendering; 0 if there is none."""
    mesh = part.mesh
    layer = next((u for u in mesh.uv_layers if u.active_render), None)
    if layer is None:
        return np.zeros((len(mesh.loop_triangles), 3, 2))
    uv = array_of(layer.data, "uv", 2).astype(float)
    return uv[array_of(mesh.loop_triangles, "loops", 3, np.int32)]


def _look(material: Material | None) -> Appearance:
    if material is None:
        return Appearance("no material", _srgb(_GREY))
    socket = _colour_of(material.node_tree) if material.use_nodes and material.node_tree else None
    if socket is None:
        return Appearance(material.name, _srgb(material.diffuse_color[:3]))
    image = _image_behind(socket)
    if image is None:
        return Appearance(material.name, _srgb(socket.default_value[:3]))
    return Appearance(material.name, _srgb((1.0, 1.0, 1.0)), _pixels(image))


def _colour_of(tree: NodeTree) -> NodeSocket | None:
    for kind, name in _SHADERS.items():
        for node in tree.nodes:
            if node.type == kind:
                return node.inputs[name]
    return None


def _image_behind(socket: NodeSocket) -> Image | None:
    """The nearest image node that is connected to the socket, directly or through other nodes."""
    waiting = [socket]
    seen = set()
    while waiting:
        for link in waiting.pop(0).links:
            node = link.from_node
            if node.type == "TEX_IMAGE" and node.image is not None and node.image.size[0]:
                return node.image
            if node not in seen:
                seen.add(node)
                waiting.extend(node.inputs)
    return None


def _pixels(image: Image) -> np.ndarray:
    """(h, w, 3) uint8 sRGB, row 0 at the top."""
    width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    values = values.reshape(height, width, image.channels)[::-1]
    values = np.repeat(values[..., :1], 3, -1) if image.channels < 3 else values[..., :3]
    if image.is_float:
        return srgb8(values)
    return np.clip(np.rint(values * 255), 0, 255).astype(np.uint8)


def _srgb(linear: tuple[float, ...]) -> tuple[float, float, float]:
    r, g, b = (int(v) / 255 for v in srgb8(np.array(linear[:3])))
    return r, g, b
