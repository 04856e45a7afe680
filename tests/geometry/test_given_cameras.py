"""Cameras given as a matrix, a text or a camera.json, and poses given as matrices."""

import json

import numpy as np
import pytest
from iclnuim import SE3, InputError, PinholeCamera, Trajectory

PAPER = PinholeCamera(640, 480, 481.2, 480, 319.5, 239.5)
TEXT = "640x480,481.2,-480,319.5,239.5"


def test_a_camera_is_read_from_text_matrix_and_file(tmp_path):
    assert PinholeCamera.parse(TEXT) == PinholeCamera.of(TEXT) == PAPER
    K = PAPER.K
    assert PinholeCamera.from_K(K, 640, 480) == PAPER
    assert PinholeCamera.from_K((K * [1, -1, 1]).tolist(), 640, 480) == PAPER
    file = tmp_path / "camera.json"
    file.write_text(json.dumps(PAPER.to_dict() | {"depth_units_per_metre": 5000}))
    assert PinholeCamera.read(file) == PinholeCamera.read(str(file)) == PAPER


@pytest.mark.parametrize("K", [np.eye(4), [[1, 2, 3], [0, 1, 3], [0, 0, 1]], np.eye(3) * 2])
def test_a_matrix_that_is_no_pinhole_camera_is_refused(K):
    with pytest.raises(InputError, match="fx 0 cx; 0 fy cy; 0 0 1"):
        PinholeCamera.from_K(K, 640, 480)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("no json", "no JSON"),
        ("[" * 100_000, "no JSON"),
        ("[1, 2]", "a JSON object"),
        ('{"width": 640, "height": 480}', "no fx, fy, cx, cy"),
        (json.dumps(PAPER.to_dict() | {"k1": 0.1}), "k1"),
        (json.dumps(PAPER.to_dict() | {"fx": "a"}), "fx of a camera"),
        (json.dumps(PAPER.to_dict() | {"fy": float("nan")}), "fy of a camera"),
        ("\xff", "no JSON"),
    ],
)
def test_a_file_that_is_no_camera_is_refused_by_name(tmp_path, content, said):
    (tmp_path / "camera.json").write_text(content, encoding="latin-1")
    with pytest.raises(InputError, match=said) as error:
        PinholeCamera.read(tmp_path / "camera.json")
    assert "camera.json" in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(InputError, match="No such file"):
        PinholeCamera.read(tmp_path / "nowhere.json")


def test_poses_are_taken_as_matrices_and_lists():
    poses = SE3.exp(np.linspace(0, 0.5, 24).reshape(4, 6))
    for given in (poses, poses.matrix, list(poses.matrix), list(poses), poses.matrix.tolist()):
        assert np.allclose(SE3.of(given).matrix, poses.matrix)
        assert np.allclose(Trajectory.at_rate(given).T_world_camera.matrix, poses.matrix)
        assert np.allclose(Trajectory(np.arange(4), given).T_world_camera.matrix, poses.matrix)
    assert np.allclose((poses[0] @ poses.matrix).matrix, (poses[0] @ poses).matrix)


@pytest.mark.parametrize("given", [None, "a", [], [[1, 2]], np.eye(3), 1.0, [SE3.identity(), 1]])
def test_what_are_no_poses_is_refused(given):
    with pytest.raises(InputError, match="poses"):
        SE3.of(given)


def test_poses_and_trajectories_are_counted_indexed_and_iterated():
    poses = SE3.exp(np.linspace(0, 0.5, 24).reshape(4, 6))
    trajectory = Trajectory.at_rate(poses)
    assert [T.shape for T in poses] == [()] * 4
    for i, (stamp_s, T_world_camera) in enumerate(trajectory):
        assert stamp_s == trajectory[i].stamp_s == trajectory.stamps_s[i]
        assert np.array_equal(T_world_camera.matrix, poses.matrix[i])
    assert np.array_equal(trajectory[-1].T_world_camera.matrix, poses.matrix[3])
    assert len(trajectory[np.array([0, 2])]) == 2 and len(trajectory[1:]) == 3
    assert repr(trajectory).startswith("Trajectory(4 poses, 1.000..1.100 s, 0.")
    with pytest.raises(IndexError):
        trajectory[4]
    for of_one in (len, list):
        with pytest.raises(TypeError, match="a single pose"):
            of_one(poses[0])
    assert poses[0] and not poses[:0]
