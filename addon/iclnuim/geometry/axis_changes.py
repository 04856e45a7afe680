"""The changes of axes: matrices that swap and reverse them."""

from itertools import permutations, product

import numpy as np


def changes_of_axes(determinant: int) -> list[np.ndarray]:
    """The 24 matrices (3, 3) of this determinant, 1 or -1, that swap and reverse axes; of
    determinant 1 the identity is the first.
    """
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            B = np.zeros((3, 3))
            B[range(3), order] = signs
            if np.linalg.det(B) * determinant > 0:
                found.append(B)
    return found
