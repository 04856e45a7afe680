"""The 256 cases of marching cubes, worked out instead of listed.

W. Lorensen, H. Cline, "Marching cubes", SIGGRAPH 1987. On each face, every run of inside corners is cut off by one line,
so two cubes that share a face always agree, and the surface has no holes where a face is ambiguous.

Corner n of a cube stands at (n >> 2, n >> 1 & 1, n & 1); edge 3 n + axis leaves corner n towards +axis.
"""

from __future__ import annotations

import numpy as np

#: Corners around each face, counter-clockwise as seen from outside.
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def edge(one: int, two: int) -> int:
    """The edge between two neighbouring corners."""
    return 3 * min(one, two) + {4: 0, 2: 1, 1: 2}[one ^ two]


def loops(case: int) -> list[list[int]]:
    """Closed loops of crossed edges that cut off the inside corners (bits of `case`)."""
    following = {}
    for face in FACES:
        inside = [bool(case >> corner & 1) for corner in face]
        for i in range(4):
            if inside[i] or not inside[(i + 1) % 4]:
                continue
            run = next(n for n in range(1, 4) if not inside[(i + 1 + n) % 4])
            entered, left = edge(face[i], face[(i + 1) % 4]), edge(face[(i + run) % 4], face[(i + run + 1) % 4])
            following[entered] = left
    found = []
    while following:
        loop = [next(iter(following))]
        while following[loop[-1]] != loop[0]:
            loop.append(following.pop(loop[-1]))
        del following[loop[-1]]
        found.append(loop)
    return found


def triangles(case: int) -> list[tuple[int, int, int]]:
    """Fans over the loops; normals point away from the inside."""
    return [(loop[0], loop[i], loop[i + 1]) for loop in loops(case) for i in range(1, len(loop) - 1)]


def table() -> tuple[np.ndarray, np.ndarray]:
    """(count (256,), edges (256, most, 3)) int8."""
    cases = [triangles(case) for case in range(256)]
    count = np.array([len(c) for c in cases], np.int8)
    edges = np.zeros((256, count.max(), 3), np.int8)
    for case, found in enumerate(cases):
        edges[case, : len(found)] = np.array(found, np.int8).reshape(-1, 3)
    return count, edges
