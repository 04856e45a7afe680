"""The things of the open scene as a table: number, name, class, NYU40 label, pose and boxes, ready for JSON."""

from __future__ import annotations

import bpy
import numpy as np

from .. import scene_classes as classes
from ..geometry.points import upright_box
from . import light_surfaces

SCHEMA_VERSION = 1
_DIGITS = 6  # micrometres


def table() -> dict:
    """Of what renders, by number; call it after ground_truth.number_objects(). A thing that is instanced has a row for each place.

    `T_world_object`: Blender's matrix, rows; may hold a scale. `box_world_m`: least and greatest x, y, z. `box_m`: the smallest upright
    box: centre and quaternion (x y z w) in the world, its x along the longer level side; its full sides.
    """
    with light_surfaces.as_rendered(bpy.context.scene) as depsgraph:
        found = light_surfaces.parts(depsgraph)
        try:
            kinds = classes.kinds_of([_class_name(part.source) for part in found])
            rows = [_row(part, kinds[_class_name(part.source)]) for part in found]
        finally:
            for part in found:
                bpy.data.meshes.remove(part.mesh)
    rows.sort(key=lambda row: (row["id"], row["box_m"]["centre"]))
    listed = sorted({kind.id: kind for kind in kinds.values()}.values(), key=lambda kind: kind.id)
    return {
        "schema_version": SCHEMA_VERSION,
        "world": "metres, right-handed, z up",
        "objects": rows,
        "classes": [{"id": k.id, "name": k.name, "nyu40_id": k.nyu40_id, "nyu40": k.nyu40} for k in listed],
    }


def _class_name(thing: bpy.types.Object) -> str | None:
    own = thing.get("class_name")
    return own if isinstance(own, str) and own else None


def _row(part: light_surfaces.Part, kind: classes.Kind) -> dict:
    matrix = np.array(part.matrix, float)
    points_m = _points_m(part.mesh, matrix)
    box = upright_box(points_m)
    return {
        "id": part.source.pass_index,
        "name": part.source.name,
        "class": kind.name,
        "class_id": kind.id,
        "nyu40_id": kind.nyu40_id,
        "T_world_object": _listed(matrix),
        "box_world_m": {"min": _listed(points_m.min(0)), "max": _listed(points_m.max(0))},
        "box_m": {
            "centre": _listed(box.T_world_box.translation),
            "quat_xyzw": _listed(box.T_world_box.quat_xyzw),
            "size": _listed(box.size_m),
        },
    }


def _points_m(mesh: bpy.types.Mesh, matrix: np.ndarray) -> np.ndarray:
    """(n, 3) in the world."""
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]


def _listed(values: np.ndarray) -> list:
    return (np.round(values, _DIGITS) + 0.0).tolist()
