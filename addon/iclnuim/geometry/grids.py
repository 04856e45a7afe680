"""Connected cells of a grid, and distances to where they end, in NumPy alone."""

import numpy as np


def connected_parts(free: np.ndarray) -> np.ndarray:
    """The number (i, j, k) of the connected part that each free cell belongs to, from 1 in the order
    of their first cells, 0 for other cells. Cells that touch at a corner are connected.
    """
    none = free.size
    first = np.where(free, np.arange(free.size).reshape(free.shape), none)
    while True:  # the index of the first known cell of the part, and of that cell's part
        least = np.where(free, -_greatest_around(-first, -none), none)
        jumped = np.append(least.ravel(), none)[least]
        if (jumped == first).all():
            break
        first = jumped
    parts = np.zeros(free.shape, int)
    parts[free] = np.unique(first[free], return_inverse=True)[1].reshape(-1) + 1
    return parts


def with_neighbours(cells: np.ndarray) -> np.ndarray:
    """The cells (i, j, k), and all that touch one of them."""
    return _greatest_around(cells, False)


def _greatest_around(values: np.ndarray, beyond: float) -> np.ndarray:
    """The maximum of each cell and the 26 around it."""
    for axis in range(values.ndim):
        widths = [(int(k == axis),) * 2 for k in range(values.ndim)]
        padded = np.moveaxis(np.pad(values, widths, constant_values=beyond), axis, 0)
        greatest = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
        values = np.moveaxis(greatest, 0, axis)
    return values


def cells_to_the_edge(inside: np.ndarray) -> np.ndarray:
    """Distance (i, j, k), in cells, to the nearest cell of the same layer k that is not inside; none
    beyond the grid is. By Felzenszwalb and Huttenlocher, Theory of Computing 2012: first along i,
    then the smallest sum of squares along j.
    """
    along_i = np.pad(inside, ((1, 1), (1, 1), (0, 0)))
    index = np.arange(len(along_i))[:, None, None]
    before = np.maximum.accumulate(np.where(along_i, 0, index), axis=0)
    after = np.minimum.accumulate(np.where(along_i, len(along_i), index)[::-1], axis=0)[::-1]
    squared = np.minimum(index - before, after - index) ** 2
    least = squared.copy()
    for step in range(1, squared.shape[1]):
        if step**2 >= least.max():
            break
        np.minimum(least[:, step:], squared[:, :-step] + step**2, out=least[:, step:])
        np.minimum(least[:, :-step], squared[:, step:] + step**2, out=least[:, :-step])
    return np.sqrt(least[1:-1, 1:-1])
