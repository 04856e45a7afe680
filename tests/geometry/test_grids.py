"""Parts of grids and distances in them, judged by SciPy's."""

import numpy as np
import pytest
from iclnuim.geometry.grids import cells_to_the_edge, connected_parts, with_neighbours

ndimage = pytest.importorskip("scipy.ndimage")
AROUND = np.ones((3, 3, 3))


def grids():
    """Grids from almost empty to full, a spiral corridor, and one of a single cell."""
    rng = np.random.default_rng(0)
    for share in (0.02, 0.15, 0.5, 0.97, 1.0):
        yield rng.random((23, 17, 5)) < share
    spiral = np.zeros((41, 41, 1), bool)
    for k in range(0, 20, 4):
        spiral[k, k : 41 - k] = spiral[k : 41 - k, 40 - k] = True
        spiral[40 - k, k : 41 - k] = spiral[k + 4 : 41 - k, k] = True
        spiral[k + 4, k : k + 4] = True
    yield spiral
    yield np.ones((1, 1, 1), bool)


def test_parts_are_those_of_scipy_in_its_order():
    for free in grids():
        assert (connected_parts(free) == ndimage.label(free, AROUND)[0]).all()


def test_neighbours_are_those_of_a_dilation():
    for cells in grids():
        assert (with_neighbours(cells) == ndimage.binary_dilation(cells, AROUND)).all()


def test_distances_are_those_to_the_nearest_cell_outside_in_the_layer():
    for inside in grids():
        for k, layer in enumerate(np.moveaxis(inside, -1, 0)):
            true = ndimage.distance_transform_edt(np.pad(layer, 1))[1:-1, 1:-1]
            assert cells_to_the_edge(inside)[..., k] == pytest.approx(true, abs=1e-12)
