"""Public functions refuse arguments of another shape or meaning in words, before they compute or write anything."""

import numpy as np
import pytest
from iclnuim import SE3, noisy_depth
from iclnuim.errors import InputError
from iclnuim.formats.ply import write_ply

CORNERS = np.eye(3)
FACE = np.array([[0, 1, 2]])


@pytest.mark.parametrize("given", [{"seed": -1}, {"frame": -1}])
def test_noise_has_a_seed_and_a_frame_of_at_least_0(given):
    with pytest.raises(InputError, match="a seed and a frame of at least 0"):
        noisy_depth(np.full((12, 16), 2.0), **given)


@pytest.mark.parametrize("quaternion", [[0, 0, 1], 1.0])
def test_a_quaternion_has_four_numbers(quaternion):
    with pytest.raises(InputError, match=r"quaternions \(..., 4\)"):
        SE3.from_quat_xyzw(quaternion, [0, 0, 0])


@pytest.mark.parametrize(
    ("points", "triangles", "words"),
    [
        (CORNERS[:, :2], None, r"vertices \(n, 3\)"),
        (CORNERS, FACE[:, :2], r"triangles \(m, 3\)"),
        (CORNERS, FACE + 1, "indices of the 3 vertices in triangles, found 1 to 3"),
        (CORNERS, FACE - 1, "indices of the 3 vertices in triangles, found -1 to 1"),
    ],
)
def test_a_mesh_has_three_coordinates_three_corners_and_indices_of_its_vertices(tmp_path, points, triangles, words):
    with pytest.raises(InputError, match=words):
        write_ply(tmp_path / "a.ply", points, triangles)
    assert not list(tmp_path.iterdir())


def test_a_surface_is_compared_with_vertices_that_are_finite():
    pytest.importorskip("igl", reason="libigl is not installed")
    from iclnuim import TrueSurface

    with pytest.raises(InputError, match="indices of the 3 vertices"):
        TrueSurface(CORNERS, FACE + 1)
    for points in (np.zeros((0, 3)), np.array([[0, 0, np.nan]])):
        with pytest.raises(InputError, match="vertices .n, 3. that are finite"):
            TrueSurface(CORNERS, FACE).error(points)


def test_what_is_not_an_odometer_is_refused_by_name():
    pytest.importorskip("cv2", reason="OpenCV is not installed")
    from iclnuim import run_odometers

    with pytest.raises(InputError, match="odometers, as iclnuim.odometer"):
        run_odometers([object()], "nowhere")
