"""Reads the surface of a scene or of a mesh file. bpy is imported for a scene only."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import InputError, blender_missing
from ...formats.meshes import MESH_ENDINGS, read_mesh
from ...native_output import native_output_in


@dataclass(frozen=True, eq=False)
class ClassedModel:
    """points (n, 3) in metres and triangles (m, 3); names of classes ("" for none), and the index
    (m,) of each triangle's; no names for a mesh file, which does not have them.
    """

    points: np.ndarray
    triangles: np.ndarray
    names: tuple[str, ...] = ()
    of_triangles: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))


def read_model(name: str, unit_m: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """points (n, 3) in metres and triangles (m, 3) of a mesh file in units of unit_m, a built-in
    scene by name, or a .blend; in the world of the file, z up for scenes.

    Raises InputError if it is none of these or has no triangle, or for a unit of a scene, which has
    its own, WorkError if a reader or bpy is missing.
    """
    model = read_classed_model(name, unit_m)
    return model.points, model.triangles


def read_classed_model(name: str, unit_m: float) -> ClassedModel:
    """The same with the class of each triangle of a scene."""
    if not 1e-6 <= unit_m <= 1e6:
        raise InputError("1e-06 to 1e+06 m", setting="model_unit", found=unit_m)
    if Path(name).suffix.lower() in MESH_ENDINGS:
        points, triangles, _ = read_mesh(name)
        return ClassedModel(points * unit_m, triangles)
    if unit_m != 1:
        expected = f"a mesh file ({', '.join(MESH_ENDINGS)}) with {{model_unit}}"
        raise InputError(expected, found=name)
    with native_output_in(Path(os.devnull)):  # importing bpy may print
        try:
            from .. import surfaces
            from . import scene
        except ImportError as error:
            raise blender_missing("a scene as the model", error) from None
        scene.open_scene(name)
        found = surfaces.triangles()
    if not len(found.triangles):
        raise InputError("a scene with surfaces", found=name)
    return ClassedModel(found.vertices, found.triangles, found.classes, found.owners)
