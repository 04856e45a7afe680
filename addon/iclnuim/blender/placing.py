"""Turns, scales and mirrors what was brought into the session so that it stands in metres with z up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import mathutils
import numpy as np

from ..errors import InputError
from ..geometry import scene_axes
from ..geometry.scene_axes import SceneReading
from . import surface
from .import_files import SILENT, importers_turn

ROOT = "placed in metres, z up"


@dataclass(frozen=True)
class Placed:
    """How the file was taken: up, unit_m, mirror, and a sentence that says so, guesses included.

    worth_telling: not just as its format has it.
    """

    up: str
    unit_m: float
    mirror: str
    sentence: str
    worth_telling: bool


def place(path: Path, reading: SceneReading, objects: Sequence[bpy.types.Object]) -> Placed:
    """Put the `objects` that came from `path` in their place, below an empty where they have to move.

    Raises InputError for a file without surfaces whose shape should be guessed by.
    """
    kind, turn = path.suffix.lower(), importers_turn(path)
    placed = _decided(path, kind, reading)
    matrix = scene_axes.linear(placed.up, placed.unit_m, placed.mirror) @ turn.T
    if not np.allclose(matrix, np.eye(3), atol=1e-9):
        _move(objects, matrix)
    return placed


def _decided(path: Path, kind: str, reading: SceneReading) -> Placed:
    usual = "y" if kind in (".glb", ".gltf") else "z"
    up, unit_m, reasons = reading.up or usual, reading.unit_m, []
    if kind in SILENT and (reading.up is None or unit_m is None):
        found = surface.triangles()
        if not len(found.triangles):
            raise InputError("a scene with at least one surface", path=path, found="none")
        shape = scene_axes.shape_of(found.vertices, found.triangles)
        up = reading.up or scene_axes.guess_up(shape, SILENT[kind])
        unit_m = unit_m or scene_axes.guess_unit_m(shape, up)
        reasons.append(_guess(reading, shape.extent * unit_m, up))
    elif unit_m is None:
        unit_m = _unit_of_blend() if kind == ".blend" else 1.0
    sentence = f"{up} up, {scene_axes.unit_name(unit_m)}"
    sentence += f", {reading.mirror} mirrored" if reading.mirror != "none" else ""
    told = bool(reasons) or (up, unit_m, reading.mirror) != (usual, 1.0, "none")
    return Placed(up, unit_m, reading.mirror, "; ".join([f"the scene is read as {sentence}", *reasons]), told)


def _guess(reading: SceneReading, extent_m: np.ndarray, up: str) -> str:
    unknown = [name for name, given in (("up axis", reading.up), ("unit", reading.unit_m)) if given is None]
    across = sorted(np.delete(extent_m, "xyz".index(up[-1])))
    size = f"{across[1]:.3g} x {across[0]:.3g} m, {extent_m['xyz'.index(up[-1])]:.3g} m high"
    return f"a guess from its shape ({size}), as the format does not say its {' and '.join(unknown)}"


def _unit_of_blend() -> float:
    settings = bpy.context.scene.unit_settings
    return 1.0 if settings.system == "NONE" else round(float(settings.scale_length), 9)


def _move(objects: Sequence[bpy.types.Object], matrix: np.ndarray) -> None:
    """Meshes without parents, animation or second users take the matrix into their vertices: no mirrored objects are left
    of an OBJ or PLY. All else is put below one empty.
    """
    here = set(objects)
    tops = [o for o in objects if o.parent is None or o.parent not in here]
    if all(_is_plain(o) for o in tops):
        for thing in tops:
            _into_vertices(thing, matrix)
        return
    root = bpy.data.objects.new(ROOT, None)
    bpy.context.scene.collection.objects.link(root)
    root.matrix_world = mathutils.Matrix(matrix).to_4x4()
    for thing in tops:
        thing.parent, thing.parent_type = root, "OBJECT"
        thing.matrix_parent_inverse.identity()
    scale = abs(float(np.linalg.det(matrix))) ** (1 / 3)
    if abs(scale - 1) > 1e-6:
        _scale_lamps(objects, scale)


def _is_plain(thing: bpy.types.Object) -> bool:
    mesh = thing.data
    return (
        thing.type == "MESH"
        and mesh.users == 1
        and not (thing.children or thing.modifiers or thing.constraints or mesh.shape_keys)
        and thing.animation_data is None
    )


def _into_vertices(thing: bpy.types.Object, matrix: np.ndarray) -> None:
    mesh, whole = thing.data, mathutils.Matrix(matrix).to_4x4() @ thing.matrix_basis
    shading = np.empty(len(mesh.loops) * 3, np.float32)
    mesh.corner_normals.foreach_get("vector", shading)
    agree = _wound_as_shaded(mesh, shading)
    custom = mesh.has_custom_normals
    mesh.transform(whole)
    thing.matrix_basis.identity()
    if whole.determinant() < 0 and agree:
        order = _flip(mesh)
        shading = shading.reshape(-1, 3)[order].ravel()
    if custom and whole.determinant() < 0:
        turned = shading.reshape(-1, 3) @ np.linalg.inv(np.array(whole)[:3, :3])
        mesh.normals_split_custom_set(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12))
    mesh.update()


def _wound_as_shaded(mesh: bpy.types.Mesh, shading: np.ndarray) -> bool:
    """Whether faces are wound counter-clockwise about the normals that the file gives them, on the whole.

    A file that was mirrored by a change of sign alone has kept its normals outside and turned its faces inside.
    """
    normals = np.empty(len(mesh.polygons) * 3, np.float32)
    mesh.polygons.foreach_get("normal", normals)
    sizes = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", sizes)
    return float((np.repeat(normals.reshape(-1, 3), sizes, axis=0) * shading.reshape(-1, 3)).sum()) >= 0


def _flip(mesh: bpy.types.Mesh) -> np.ndarray:
    """Wind all faces the other way; (corners,) where each corner was before."""
    numbers = mesh.attributes.new("corner before", "INT", "CORNER")
    numbers.data.foreach_set("value", np.arange(len(mesh.loops), dtype=np.int32))
    mesh.flip_normals()
    order = np.empty(len(mesh.loops), np.int32)
    mesh.attributes["corner before"].data.foreach_get("value", order)
    mesh.attributes.remove(mesh.attributes["corner before"])
    return order


def _scale_lamps(objects: Sequence[bpy.types.Object], scale: float) -> None:
    """The same picture at another size: power grows with the area, radii with the length. A sun has neither."""
    for lamp in {o.data for o in objects if o.type == "LIGHT"}:
        if lamp.type != "SUN":
            lamp.energy *= scale**2
        if lamp.type in ("POINT", "SPOT"):
            lamp.shadow_soft_size *= scale
