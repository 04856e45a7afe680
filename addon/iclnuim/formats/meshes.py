"""Reads meshes and point clouds as arrays."""

from pathlib import Path

import numpy as np

from ..errors import InputError, StrPath
from .gltf import read_gltf
from .obj import read_obj
from .off import read_off
from .ply import read_ply
from .stl import read_stl

_READERS = {".obj": read_obj, ".stl": read_stl, ".off": read_off}
GLTF_ENDINGS = (".gltf", ".glb")
MESH_ENDINGS = (".ply", *_READERS, *GLTF_ENDINGS)


def read_mesh(path: StrPath) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points (n, 3), triangles (m, 3), colours (n, 3) uint8 or (n, 0); polygons become triangles.

    Raises InputError for a file that is not a mesh, is empty, has no triangle, or has coordinates
    that are not finite, WorkError if a reader is missing.
    """
    points, triangles, colours = read_mesh_or_cloud(Path(path))
    invalid = int((~np.isfinite(points).all(axis=1)).sum())
    if invalid:
        found = f"NaN or infinity in {invalid} of {len(points)}"
        raise InputError(
            "points of finite coordinates", path=path, found=found, hint="removing them"
        )
    if not len(triangles):
        found = f"{len(points)} points and no triangle"
        raise InputError("a mesh with triangles", path=path, found=found)
    return points, triangles, colours


def read_mesh_or_cloud(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same, with (m, 3) of m = 0 for a point cloud; coordinates may be NaN or infinite."""
    ending = path.suffix.lower()
    if ending not in MESH_ENDINGS:
        expected = f"a mesh ({', '.join(MESH_ENDINGS)})"
        raise InputError(expected, path=path, found=path.suffix or "no ending")
    if not path.is_file():
        raise InputError("a mesh", path=path, found="no such file")
    if ending == ".ply":
        model = read_ply(path)
        points, triangles, colours = model.points, model.triangles, model.colours
    else:
        points, triangles = _READERS.get(ending, read_gltf)(path)
        colours = np.zeros((len(points), 0), np.uint8)
    if not len(points):
        raise InputError("a mesh or a point cloud with points", path=path, found="none")
    return points, triangles, colours
