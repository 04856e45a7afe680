"""Reads meshes and point clouds as arrays: PLY here, OBJ, STL and OFF by libigl, glTF by Open3D."""

import os
from pathlib import Path

import numpy as np

from ..errors import InputError, WorkError
from ..native_output import native_output_in
from .ply import read_ply

GLTF_ENDINGS = (".gltf", ".glb")
MESH_ENDINGS = (".ply", ".obj", ".stl", ".off", *GLTF_ENDINGS)


def read_mesh(path: Path | str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
        points, triangles = _read_gltf(path) if ending in GLTF_ENDINGS else _read_plain(path)
        colours = np.zeros((len(points), 0), np.uint8)
    if not len(points):
        raise InputError("a mesh or a point cloud with points", path=path, found="none")
    return points, triangles, colours


def _read_plain(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        import igl
    except ImportError:
        raise WorkError(
            f"{path}: {path.suffix} is read by libigl; try: pip install libigl, or a .ply"
        ) from None
    try:
        with native_output_in(Path(os.devnull)):
            points, triangles = igl.read_triangle_mesh(str(path))
    except RuntimeError as error:
        found = str(error).splitlines()[0]
        raise InputError("a complete mesh", path=path, found=found, hint="a .ply") from None
    triangles = triangles.reshape(-1, 3).astype(np.int64)
    if path.suffix.lower() == ".stl":
        # Each triangle has corners of its own: means over vertices would depend on the format.
        points, merged = np.unique(points, axis=0, return_inverse=True)
        triangles = merged.reshape(-1)[triangles]
    return points, triangles


def _read_gltf(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        import open3d
    except ImportError:
        raise WorkError(
            f"{path}: {path.suffix} is read by open3d; try: pip install open3d-cpu, or a .ply"
        ) from None
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(path)
    if not len(mesh.vertices):
        raise InputError(
            "a glTF file from which Open3D reads a mesh", path=path, found="none", hint="a .ply"
        )
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles).reshape(-1, 3).astype(np.int64)
