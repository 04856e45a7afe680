"""The axes and units of an imported scene: its objects are rotated, scaled and mirrored to metres,
z up.
"""

from collections.abc import Sequence
from pathlib import Path

import bpy
import mathutils
import numpy as np
from bpy.types import Mesh, Object

from ...errors import InputError
from ...geometry import axes, scene_axes
from ...geometry.scene_axes import SceneReading
from .. import surfaces
from ..surfaces import array_of

ROOT = "placed in metres, z up"
#: Formats with y up, which Blender's importer has already rotated.
_Y_UP = (".glb", ".gltf")
#: Formats without information about axes and units, and the axis that usually points up in them.
_SILENT = {".obj": "y", ".ply": "z"}


def orient(path: Path, reading: SceneReading, objects: Sequence[Object]) -> tuple[str, bool]:
    """Transform the `objects` imported from `path` to metres, z up. If needed, they become children
    of an empty.

    Returns a sentence that describes how the file is read, including guesses, and whether it should
    be reported because this is not the format's default. Raises InputError for a file without
    surfaces if axes or unit must be guessed.
    """
    kind = path.suffix.lower()
    usual = "z"
    from_file = np.eye(3)
    if kind in _Y_UP:
        usual = "y"
        from_file = axes.Z_UP_FROM_Y_UP.T
    reasons = []
    up = reading.up or usual
    unit_m = reading.unit_m
    if kind in _SILENT and (reading.up is None or unit_m is None):
        shape = _shape(path)
        up = reading.up or scene_axes.guess_up(shape, _SILENT[kind], unit_m)
        unit_m = unit_m or scene_axes.guess_unit_m(shape, up)
        reasons.append(_guess(reading, shape.extent * unit_m, up))
    elif unit_m is None:
        unit_m = 1.0
        settings = bpy.context.scene.unit_settings
        if kind == ".blend" and settings.system != "NONE":
            unit_m = round(float(settings.scale_length), 9)
    matrix = scene_axes.linear(up, unit_m, reading.mirror) @ from_file
    if not np.allclose(matrix, np.eye(3), atol=1e-9):
        _move(objects, matrix)
    if reading.unit_m is None and (warning := _size_warning(path, objects, unit_m)):
        reasons.append(warning)
    sentence = f"the scene is read as {up} up, {scene_axes.unit_name(unit_m)}"
    if reading.mirror != "none":
        sentence += f", {reading.mirror} mirrored"
    unusual = bool(reasons) or (up, unit_m, reading.mirror) != (usual, 1.0, "none")
    return "; ".join([sentence, *reasons]), unusual


def _shape(path: Path) -> scene_axes.Shape:
    found = surfaces.triangles()
    if not len(found.triangles):
        raise InputError("a scene with at least one surface", path=path, found="none")
    return scene_axes.shape_of(found.vertices, found.triangles)


def _guess(reading: SceneReading, extent_m: np.ndarray, up: str) -> str:
    unknown = []
    options = []
    if reading.up is None:
        unknown.append("up axis")
        options.append("up")
    if reading.unit_m is None:
        unknown.append("unit")
        options.append("scene unit")
    reason = f"because the format does not contain its {' and '.join(unknown)}"
    guess = f"a guess from its shape ({_size(extent_m, up)})"
    return f"{guess}, {reason} (options: {' and '.join(options)})"


def _size(extent_m: np.ndarray, up: str) -> str:
    across = sorted(np.delete(extent_m, "xyz".index(up[-1])))
    return f"{across[1]:.3g} x {across[0]:.3g} m, {extent_m['xyz'.index(up[-1])]:.3g} m high"


def _size_warning(path: Path, objects: Sequence[Object], unit_m: float) -> str | None:
    """A warning if the scene does not have the size of a room.

    Bounding boxes are checked first, to avoid reading all triangles.
    """
    bpy.context.view_layer.update()
    shown = [o for o in objects if o.type in surfaces.SURFACE_TYPES and not o.hide_render]
    extent_m = np.ptp(surfaces.box_corners_m(shown), axis=0)
    if scene_axes.is_plausible(extent_m, "z") or not len(surfaces.triangles().triangles):
        return None
    shape = _shape(path)
    if scene_axes.is_plausible(shape.extent, "z"):
        return None
    better_m = unit_m * scene_axes.guess_unit_m(shape, "z")
    advice = "no other unit makes it one"
    if better_m != unit_m:
        advice = f"as {scene_axes.unit_name(better_m)} it would be one"
    return f"{_size(shape.extent, 'z')} is not the size of a room, {advice} (option: scene unit)"


def _move(objects: Sequence[Object], matrix: np.ndarray) -> None:
    """Apply the matrix to the vertices of meshes without parents, animation or second users, so
    that an OBJ or PLY has no mirrored objects. If there are other objects, all become children of
    one empty.
    """
    here = set(objects)
    tops = [o for o in objects if o.parent is None or o.parent not in here]
    if all(map(_is_plain_mesh, tops)):
        for thing in tops:
            _into_vertices(thing, matrix)
        return
    root = bpy.data.objects.new(ROOT, None)
    bpy.context.scene.collection.objects.link(root)
    root.matrix_world = mathutils.Matrix(matrix).to_4x4()
    for thing in tops:
        thing.parent = root
        thing.parent_type = "OBJECT"
        thing.matrix_parent_inverse.identity()
    _scale_lamps(objects, abs(float(np.linalg.det(matrix))) ** (1 / 3))


def _is_plain_mesh(thing: Object) -> bool:
    if thing.type != "MESH" or thing.data.users != 1 or thing.animation_data is not None:
        return False
    return not (thing.children or thing.modifiers or thing.constraints or thing.data.shape_keys)


def _scale_lamps(objects: Sequence[Object], scale: float) -> None:
    """Give the same image at another scale: power grows with the area, radii with the length; a sun
    has neither.
    """
    if abs(scale - 1) <= 1e-6:
        return
    for lamp in {o.data for o in objects if o.type == "LIGHT"}:
        if lamp.type != "SUN":
            lamp.energy *= scale**2
        if lamp.type in ("POINT", "SPOT"):
            lamp.shadow_soft_size *= scale


def _into_vertices(thing: Object, matrix: np.ndarray) -> None:
    mesh = thing.data
    whole = mathutils.Matrix(matrix).to_4x4() @ thing.matrix_basis
    is_mirrored = whole.determinant() < 0
    shading = array_of(mesh.corner_normals, "vector", 3)
    # in a file that was mirrored only by a change of sign, normals still point outside, but faces
    # are wound inside out
    normals = array_of(mesh.polygons, "normal", 3)
    sizes = array_of(mesh.polygons, "loop_total", 1, np.int32)
    is_wound_as_shaded = float((np.repeat(normals, sizes, axis=0) * shading).sum()) >= 0
    is_custom = mesh.has_custom_normals
    mesh.transform(whole)
    thing.matrix_basis.identity()
    if is_mirrored and is_wound_as_shaded:
        shading = shading[_flip(mesh)]
    if is_mirrored and is_custom:
        moved = shading @ np.linalg.inv(np.array(whole)[:3, :3])
        lengths = np.maximum(np.linalg.norm(moved, axis=1, keepdims=True), 1e-12)
        mesh.normals_split_custom_set(moved / lengths)
    mesh.update()


def _flip(mesh: Mesh) -> np.ndarray:
    """Reverse the winding of all faces. Returns (corners,) the previous index of each corner."""
    numbers = mesh.attributes.new("corner before", "INT", "CORNER")
    numbers.data.foreach_set("value", np.arange(len(mesh.loops), dtype=np.int32))
    mesh.flip_normals()
    order = array_of(mesh.attributes["corner before"].data, "value", 1, np.int32)
    mesh.attributes.remove(mesh.attributes["corner before"])
    return order
