"""Meshes as binary PLY files, with colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..formats.files import atomic_write
from .mesh import Mesh


def write_ply(path: Path, mesh: Mesh) -> None:
    """Little-endian, float x y z, uchar red green blue where the mesh has colours. WorkError where it cannot be written."""
    coloured = mesh.colours.shape[1] == 3
    fields = [(name, "<f4") for name in "xyz"] + [(n, "u1") for n in ("red", "green", "blue") if coloured]
    vertices = np.empty(len(mesh.points), fields)
    for a, name in enumerate("xyz"):
        vertices[name] = mesh.points[:, a]
    for c, name in enumerate(("red", "green", "blue") if coloured else ()):
        vertices[name] = mesh.colours[:, c]
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property {'float' if kind == '<f4' else 'uchar'} {name}" for name, kind in fields]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    atomic_write(path, lambda t: t.write_bytes("\n".join(header).encode() + vertices.tobytes() + faces.tobytes()))
