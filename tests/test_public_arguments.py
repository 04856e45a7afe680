"""Public functions refuse arguments of another shape or meaning in words, before they compute or
write anything.
"""

import numpy as np
import pytest
from iclnuim import (
    SE3,
    Trajectory,
    absolute_trajectory_error,
    fuse_sequence,
    noisy_depth,
    noisy_rgb,
    relative_pose_error,
)
from iclnuim.errors import InputError
from iclnuim.formats.ply import write_ply

CORNERS = np.eye(3)
FACE = np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    "given", [{"seed": -1}, {"frame": -1}, {"seed": 1.5}, {"seed": "a"}, {"frame": None}]
)
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
        (CORNERS, FACE.astype(float), "triangles as integers, found float64"),
        (CORNERS, FACE - 1, "indices of the 3 vertices in triangles, found -1 to 1"),
    ],
)
def test_a_mesh_has_three_coordinates_three_corners_and_indices_of_its_vertices(
    tmp_path, points, triangles, words
):
    with pytest.raises(InputError, match=words):
        write_ply(tmp_path / "a.ply", points, triangles)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "colours",
    [
        np.zeros((2, 3), np.uint8),
        np.ones((3, 3)),
        [[1, 2, 3]] * 3,
        np.zeros(3, np.uint8),
        np.zeros((3, 2), np.uint8),
        np.zeros((3, 4), np.uint8),
    ],
)
def test_colours_of_a_mesh_are_bytes_for_each_vertex(tmp_path, colours):
    with pytest.raises(InputError, match=r"colours \(3, 3\) as uint8"):
        write_ply(tmp_path / "a.ply", CORNERS, FACE, colours=colours)
    assert not list(tmp_path.iterdir())


def test_a_mesh_has_a_normal_for_each_vertex(tmp_path):
    for normals in (np.zeros((2, 3)), np.zeros(3)):
        with pytest.raises(InputError, match=r"normals \(3, 3\)"):
            write_ply(tmp_path / "a.ply", CORNERS, FACE, normals=normals)
    write_ply(tmp_path / "a.ply", CORNERS, FACE, normals=CORNERS.tolist())


def test_depth_has_rows_and_columns():
    for shape in ((3,), ()):
        with pytest.raises(InputError, match=r"depth \(h, w\), or a batch .*, in metres, found \("):
            noisy_depth(np.ones(shape))


def test_twists_have_six_numbers_and_a_trajectory_has_an_axis():
    with pytest.raises(InputError, match=r"twists \(..., 6\), found \(5,\)"):
        SE3.exp([0] * 5)
    with pytest.raises(InputError, match=r"poses \(n,\), found poses \(\)"):
        Trajectory.at_rate(SE3.identity())


def test_images_have_pixels_and_trajectories_are_trajectories():
    for noise in (noisy_rgb, noisy_depth):
        with pytest.raises(InputError, match=r"found an array \(0, 0, 3\)"):
            noise(np.zeros((0, 0, 3)))
    for error in (absolute_trajectory_error, relative_pose_error):
        with pytest.raises(
            InputError, match="a Trajectory, a file, a sequence, poses .*, found SE3"
        ):
            error(SE3.identity(), SE3.identity())


def test_a_surface_is_compared_with_vertices_that_are_finite():
    pytest.importorskip("igl", reason="libigl is not installed")
    from iclnuim import TrueSurface

    with pytest.raises(InputError, match="indices of the 3 vertices"):
        TrueSurface(CORNERS, FACE + 1)
    for triangles in (FACE.astype(float), FACE.astype(float).tolist()):
        with pytest.raises(InputError, match="triangles as integers, found float64"):
            TrueSurface(CORNERS, triangles)
    for points in (np.zeros(3), np.zeros((2, 2)), np.zeros((1, 1, 3)), np.float64(1)):
        with pytest.raises(InputError, match=r"vertices \(n, 3\), found \("):
            TrueSurface(CORNERS, FACE).error(points)
    for points in (np.zeros((0, 3)), np.array([[0, 0, np.nan]])):
        with pytest.raises(InputError, match="vertices .n, 3. that are finite"):
            TrueSurface(CORNERS, FACE).error(points)


def test_what_is_not_an_odometer_is_refused_by_name():
    pytest.importorskip("cv2", reason="OpenCV is not installed")
    from iclnuim import run_odometers

    with pytest.raises(InputError, match="odometers, as iclnuim.odometer"):
        run_odometers([object()], "nowhere")


def test_a_surface_is_fused_along_a_trajectory(tmp_path):
    with pytest.raises(InputError, match=r"a Trajectory, found .*; try iclnuim.read_trajectory"):
        fuse_sequence(tmp_path, "groundtruth.txt")
