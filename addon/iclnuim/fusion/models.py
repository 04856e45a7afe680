"""Surfaces from files: a reconstruction, and the model that it is compared with."""

import os
from pathlib import Path

import numpy as np

from ..errors import InputError, WorkError, blender_missing
from ..formats.files import read_text
from ..formats.ply import read_ply
from ..geometry.se3 import SE3

MESH_ENDINGS = (".ply", ".obj", ".stl", ".off", ".gltf", ".glb")


def read_points(path: Path | str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points (n, 3), triangles (m, 3), colours (n, 3) uint8 or (n, 0) of a mesh or a point cloud, which has m = 0; polygons become triangles.

    Raises InputError for a file that is neither, is empty or has coordinates that are not finite, WorkError where open3d is missing.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_ENDINGS:
        raise InputError(f"a mesh ({', '.join(MESH_ENDINGS)})", path=path, found=path.suffix or "no ending")
    if not path.is_file():
        raise InputError("a mesh", path=path, found="nothing of that name")
    if path.suffix.lower() == ".ply":
        model = read_ply(path)
        points, triangles, colours = model.points, model.triangles, model.colours
    else:
        points, triangles, colours = _by_open3d(path)
    if not len(points):
        raise InputError("a mesh or a point cloud with points", path=path, found="none")
    bad = int((~np.isfinite(points).all(axis=1)).sum())
    if bad:
        found = f"NaN or infinity in {bad} of {len(points)}"
        raise InputError("points of finite coordinates", path=path, found=found, hint="removing them")
    return points, triangles, colours


def read_mesh(path: Path | str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of a mesh. Raises InputError also where there is no triangle."""
    points, triangles, colours = read_points(path)
    if not len(triangles):
        raise InputError("a mesh with triangles", path=path, found=f"{len(points)} points and no triangle")
    return points, triangles, colours


def _by_open3d(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    try:
        import open3d
    except ImportError:
        raise WorkError(f"{path}: {path.suffix} is read by open3d; try: pip install open3d-cpu, or a .ply") from None
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(path)
    points, colours = np.asarray(mesh.vertices), (np.asarray(mesh.vertex_colors) * 255 + 0.5).astype(np.uint8)
    triangles = np.asarray(mesh.triangles).reshape(-1, 3).astype(np.int64)
    return points, triangles, colours if len(colours) else np.zeros((len(points), 0), np.uint8)


def read_model(name: str) -> tuple[np.ndarray, np.ndarray]:
    """points (n, 3) and triangles (m, 3) of a mesh file, a built-in scene by name, or a .blend; in its own world, z up for scenes.

    Raises InputError for what is none of them or has no triangle, WorkError where open3d or bpy is missing.
    """
    if Path(name).suffix.lower() in MESH_ENDINGS:
        points, triangles, _ = read_mesh(Path(name))
        return points, triangles
    from ..blender import output

    with output.blender_output_in(Path(os.devnull)):  # the very import of bpy may print
        try:
            from ..blender import scene, surfaces
        except ImportError as error:
            raise blender_missing("a scene as the model", error) from None
        scene.open_scene(name)
        found = surfaces.triangles()
    if not len(found.triangles):
        raise InputError("a scene with surfaces", found=name)
    return found.vertices, found.triangles


def read_transform(path: Path) -> SE3:
    """The rigid motion of a text file with the 16 numbers of a 4 x 4 matrix, row by row. Raises InputError."""
    try:
        T = np.array([float(word) for word in read_text(path).replace(",", " ").split()])
    except ValueError as error:
        raise InputError("the 16 numbers of a 4x4 matrix", path=path, found=error) from None
    if T.size != 16:
        raise InputError("the 16 numbers of a 4x4 matrix", path=path, found=f"{T.size} numbers")
    T = T.reshape(4, 4)
    rigid = np.isfinite(T).all() and np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3)
    if not rigid or np.abs(T[3] - (0, 0, 0, 1)).max() > 1e-9:
        raise InputError("a rigid motion, last row 0 0 0 1", path=path)
    return SE3(T[:3, :3], T[:3, 3])
