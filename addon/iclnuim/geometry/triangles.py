"""Arrays of vertices and triangles."""

import numpy as np

from ..errors import InputError


def check_mesh(vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Raises InputError unless vertices are (n, 3), triangles (m, 3) of integers, and all indices
    are those of a vertex.
    """
    if (
        vertices.ndim != 2
        or vertices.shape[1] != 3
        or triangles.ndim != 2
        or triangles.shape[1] != 3
    ):
        raise InputError(
            "vertices (n, 3) and triangles (m, 3)", found=f"{vertices.shape} and {triangles.shape}"
        )
    if triangles.dtype.kind not in "iu":
        raise InputError("triangles as integers", found=triangles.dtype)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        found = f"{triangles.min()} to {triangles.max()}"
        raise InputError(f"indices of the {len(vertices)} vertices in triangles", found=found)
