"""What one tries with `import iclnuim` in a notebook works, or its error says what does."""

import inspect
import pickle

import iclnuim
import numpy as np
import pytest
from iclnuim import SE3, InputError, RenderJob, Trajectory
from matplotlib import pyplot

pyplot.switch_backend("Agg")
CAMERA = "16x12,16,-16,7.5,5.5"
POSES = SE3.exp(np.random.default_rng(0).normal(size=(60, 6)) * 0.1)
SHIFTED = Trajectory.at_rate(POSES @ SE3.exp([0.01, 0, 0, 0, 0, 0]))


def look(number):
    depth_z_m = np.full((12, 16), 2.0 + 0.01 * number)
    depth_z_m[:2] = 0
    return np.full((12, 16, 3), 0.3), depth_z_m


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wishes") / "clean"
    iclnuim.make_sequence(iclnuim.frames_from(CAMERA, POSES, look), folder, workers=1)
    return iclnuim.open_sequence(folder)


@pytest.fixture(autouse=True)
def figures():
    yield
    pyplot.close("all")


WORKS = {
    "np.asarray(pose)": lambda s: np.asarray(s[3].T_world_camera).shape == (4, 4),
    "np.asarray(poses)": lambda s: np.asarray(s.truth.T_world_camera).shape == (60, 4, 4),
    "alignment": lambda s: iclnuim.absolute_trajectory_error(s, SHIFTED, alignment="sim3").rmse_mm < 99,
    "positions": lambda s: iclnuim.absolute_trajectory_error(POSES.translation, SHIFTED.positions_m),
    "a built-in name": lambda s: iclnuim.read_trajectory("living_room/kt2"),
    "their names": lambda s: "living_room/kt2" in iclnuim.sequence_names(),
    "odometers by name": lambda s: iclnuim.run_odometers(["icp"], s[:3]),
    "fusion by its truth": lambda s: iclnuim.fuse_sequence(s[:3]),
    "Trajectory.from_matrices": lambda s: len(Trajectory.from_matrices(POSES.matrix)) == 60,
    "PinholeCamera.from_fov": lambda s: iclnuim.PinholeCamera.from_fov(640, 480, 90).fx > 319,
    "points of a frame": lambda s: s[0].points().shape == (160, 3),
    "points of a sequence": lambda s: s.points(step=2).shape == (60 * 5 * 8, 3),
    "plot of a frame": lambda s: len(s[0].plot()) == 2,
    "plot of a sequence": lambda s: s.plot(3).shape == (2, 3),
    "a list of numbers": lambda s: s[[0, 5]].stamps_s.tolist() == s.stamps_s[[0, 5]].tolist(),
    "a mask": lambda s: len(s[s.stamps_s > 2]) == 29,
    "from the end": lambda s: s[-1].stamp_s == s.stamps_s[-1],
    "comparison": lambda s: iclnuim.compare_sequences(s, s),
    "a pickled sequence": lambda s: pickle.loads(pickle.dumps(s))[59].points().shape == (160, 3),
    "a pickled frame": lambda s: pickle.loads(pickle.dumps(s[0])).points().shape == (160, 3),
}  # fmt: skip


@pytest.mark.parametrize("wish", WORKS)
def test_what_is_tried_works(sequence, wish):
    if wish in ("odometers by name", "fusion by its truth"):
        pytest.importorskip("numba", reason="numba is not installed")
    assert WORKS[wish](sequence)


SAYS = {
    "a frame beyond": (lambda s: s[1000], IndexError, "60 frames"),
    "a number beyond": (lambda s: s[[0, 60]], IndexError, "60 frames"),
    "a pose beyond": (lambda s: s.truth[60], IndexError, "60 poses"),
    "a name of a frame": (lambda s: s["last"], InputError, "a number of a frame"),
    "iclnuim.export": (lambda s: iclnuim.export, AttributeError, "convert_sequence"),
    "iclnuim.convert": (lambda s: iclnuim.convert, AttributeError, "convert_sequence"),
    "poses of nerf": (lambda s: iclnuim.write_trajectory("a", SHIFTED, "nerf"), InputError, "convert_sequence"),
    "an image of positions": (lambda s: iclnuim.absolute_trajectory_error(s, np.ones((4, 5))), InputError, r"\(4, 5\)"),
    "other coordinates": (lambda s: s[0].points("cam"), InputError, "world or camera"),
    "another setting": (lambda s: iclnuim.render_pose("living_room", np.eye(4), sample=3), TypeError, "sample"),
}  # fmt: skip


@pytest.mark.parametrize("wish", SAYS)
def test_an_error_says_what_works(sequence, wish):
    tried, kind, said = SAYS[wish]
    with pytest.raises(kind, match=said):
        tried(sequence)


def test_points_are_those_of_the_camera_moved_by_the_pose(sequence):
    frame = sequence[7]
    of_camera = frame.points("camera")
    np.testing.assert_allclose(of_camera[:, 2], 2.07, atol=1e-4)
    u_v = sequence.camera.project(of_camera)
    np.testing.assert_allclose(u_v[17], [1, 3], atol=1e-9)
    np.testing.assert_allclose(frame.points(), frame.T_world_camera.apply(of_camera))
    joined = sequence[[7, 9]].points(step=1)
    np.testing.assert_allclose(joined[:160], frame.points())


def test_points_without_truth_are_of_the_camera(sequence, tmp_path):
    iclnuim.make_sequence(sequence[:2], tmp_path / "a", workers=1)
    (tmp_path / "a/groundtruth.txt").unlink()
    bare = iclnuim.open_sequence(tmp_path / "a")
    assert bare.points("camera").shape == (2 * 2, 3)
    for one in (bare, bare[0]):
        with pytest.raises(InputError, match='points."camera".'):
            one.points()


def test_a_data_loader_gets_arrays_that_it_can_stack(sequence):
    """torch.utils.data.DataLoader(sequence, batch_size=4) calls __getitems__."""
    batch = [np.stack(column) for column in zip(*sequence.__getitems__([3, 1]), strict=True)]
    assert [column.shape for column in batch] == [(2,), (2, 12, 16, 3), (2, 12, 16), (2, 4, 4)]
    np.testing.assert_allclose(batch[3], POSES[[3, 1]].matrix, atol=1e-6)


def test_a_table_of_pandas_has_the_poses_of_a_trajectory():
    pytest.importorskip("pandas", reason="pandas is not installed")
    table = SHIFTED.to_pandas()
    T = SE3.from_quat_xyzw(table[["qx", "qy", "qz", "qw"]], table[["x", "y", "z"]])
    np.testing.assert_allclose(T.matrix, SHIFTED.T_world_camera.matrix, atol=1e-12)
    assert table.index.tolist() == SHIFTED.stamps_s.tolist()


def test_a_pose_is_rendered_with_the_settings_of_a_job():
    """The keywords are the settings that change colour or depth of one frame."""
    given = set(inspect.signature(iclnuim.render_pose).parameters) - {"T_world_camera"}
    assert given == set(inspect.signature(RenderJob).parameters) - {
        "sequence", "trajectory", "ground_truth", "channels", "imu"
    }  # fmt: skip
