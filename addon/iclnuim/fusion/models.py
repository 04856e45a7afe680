"""What a surface is judged by: the triangles of a mesh file, of one of our rooms, or of a .blend."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..errors import InputError, WorkError, blender_missing

MESH_ENDINGS = (".ply", ".obj", ".stl", ".off", ".gltf", ".glb")


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points (n, 3), triangles (m, 3), colours (n, 3) uint8 or (n, 0) of a mesh file; other polygons are cut into triangles.

    Raises InputError for what is no mesh, WorkError where Open3D is missing.
    """
    if path.suffix.lower() not in MESH_ENDINGS:
        raise InputError(f"a mesh ({', '.join(MESH_ENDINGS)})", path=path, found=path.suffix or "no ending")
    if not path.is_file():
        raise InputError("a mesh", path=path, found="nothing of that name")
    try:
        import open3d
    except ImportError:
        raise WorkError("meshes are read by Open3D; try: pip install open3d-cpu") from None
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(str(path))
    points, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if not len(triangles):
        raise InputError("a mesh with triangles", path=path, found=f"{len(points)} points and no triangle")
    if not np.isfinite(points).all():
        raise InputError("finite coordinates", path=path, found="NaN or infinity")
    colours = (np.asarray(mesh.vertex_colors) * 255 + 0.5).astype(np.uint8)
    return points, triangles.astype(np.int64), colours if len(colours) else np.zeros((len(points), 0), np.uint8)


def read_model(name: str) -> tuple[np.ndarray, np.ndarray]:
    """points and triangles of a mesh file, a scene of ours by name, or a .blend; in its own world, z up for ours."""
    if Path(name).suffix.lower() in MESH_ENDINGS:
        points, triangles, _ = read_mesh(Path(name))
        return points, triangles
    from ..blender import output

    with output.blender_output_in(Path(os.devnull)):  # the very import of bpy may print
        try:
            from ..blender import scene, surface
        except ImportError as error:
            raise blender_missing("a scene as the model", error) from None
        scene.open_scene(name)
        found = surface.triangles()
    if not len(found.triangles):
        raise InputError("a scene with surfaces", found=name)
    return found.vertices, found.triangles
