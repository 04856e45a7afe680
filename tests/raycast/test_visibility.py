"""What a camera sees of a surface with another one just in front of it: single precision decides."""

import numpy as np
import pytest
from iclnuim.formats.scene_model import SceneModel
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("embreex", reason="casts rays")
from iclnuim.raycast.caster import RayCaster  # noqa: E402
from iclnuim.raycast.visibility import FRONT, Visibility, seen_points  # noqa: E402

CAMERA = PinholeCamera(80, 60, 60.0, 60.0, 39.5, 29.5)
POSES = SE3.from_matrix(np.eye(4)[None])


def triangle(z_m, size_m):
    """Its centroid is on the axis of the camera at the origin, its front towards the camera."""
    return np.array([[-1, -1, 0], [0, 2, 0], [1, -1, 0]]) * size_m + (0, 0, z_m)


@pytest.mark.parametrize(("behind_m", "is_seen"), [(0.00007, True), (0.00013, False)])
def test_a_point_up_to_a_tenth_of_a_millimetre_behind_a_surface_3_m_away_is_seen(behind_m, is_seen):
    caster = RayCaster(triangle(3.0, 1), np.array([[0, 1, 2]]))
    point = np.array([[0.0, 0.0, 3.0 + behind_m]])
    assert seen_points(caster, point, CAMERA, POSES, 8.0)[0] == is_seen


@pytest.mark.parametrize(("behind_m", "is_seen"), [(0.0002, True), (0.0004, False)])
def test_a_triangle_up_to_a_ten_thousandth_behind_another_is_seen(behind_m, is_seen):
    corners = np.stack([triangle(3.0, 1), triangle(3.0 + behind_m, 0.01)])
    none = np.zeros(2, int)
    model = SceneModel(corners, np.zeros((2, 3, 3)), np.zeros((2, 3, 2)), none, none)
    visibility = Visibility(model)
    visibility.along(CAMERA, POSES, lambda: None)
    assert visibility.seen[:, FRONT].tolist() == [True, is_seen]
