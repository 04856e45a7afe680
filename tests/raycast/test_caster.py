"""Arrays that no rays can be cast at, and depth that cannot be compared with rays, are refused in
one line.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("embreex", reason="casts rays")
from iclnuim.raycast.caster import RayCaster  # noqa: E402
from iclnuim.raycast.depth_check import compare_depth  # noqa: E402

CORNERS = np.array([[-1.0, -1, 2], [1, -1, 2], [0, 1, 2]])


@pytest.mark.parametrize(
    ("triangles", "match"),
    [
        ([[0, 1, 3]], "indices of the 3 vertices"),
        ([[-1, 1, 2]], "indices of the 3"),
        ([[0.0, 1, 2]], "as integers"),
    ],
)
def test_triangles_without_vertices_are_refused(triangles, match):
    with pytest.raises(InputError, match=match):
        RayCaster(CORNERS, np.array(triangles))


def test_depth_of_another_size_is_refused():
    caster, camera = RayCaster(CORNERS, np.array([[0, 1, 2]])), PinholeCamera.parse("64x48")
    with pytest.raises(InputError, match="64 x 48 as in the camera, found 8 x 6"):
        compare_depth(np.ones((6, 8)), caster, camera, SE3.identity())
