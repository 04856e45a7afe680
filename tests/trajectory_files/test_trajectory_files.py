"""Each trajectory format as others write it: axes, units, stamps, and how a file is told to be of a
format.
"""

import gc
import sys

import numpy as np
import pytest
from iclnuim.geometry import axes
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files.trajectories import FORMATS, read_trajectory, write_trajectory
from scipy.spatial.transform import Rotation


@pytest.fixture
def file(tmp_path):
    """file(name, content) -> the path of a new file."""

    def write(name: str, content: str):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
        return path

    return write


# -- lost poses

_LOST = {
    "nan": "nan " * 15 + "nan",
    "minus infinity": "-inf " * 15 + "-inf",
    "infinity that ends in 0 0 0 1": "inf " * 12 + "0 0 0 1",
    "an empty line": "",
    "a line of blanks": " \t",
}


def _square_row(x: float) -> str:
    return f"1 0 0 {x} 0 1 0 0 0 0 1 0 0 0 0 1"


@pytest.mark.parametrize("lost", _LOST)
def test_a_lost_row_keeps_its_place(file, lost):
    rows = [_square_row(x) for x in range(9)]
    rows[2] = rows[3] = rows[8] = _LOST[lost]
    loaded = read_trajectory(file("traj.txt", "\n".join(["# poses", *rows]) + "\n"))
    np.testing.assert_array_equal(loaded.rows, [0, 1, 4, 5, 6, 7])
    np.testing.assert_array_equal(loaded.trajectory.positions_m[:, 0], loaded.rows)
    np.testing.assert_allclose(loaded.trajectory.stamps_s, 1 + loaded.rows / 30, atol=5.1e-7)
    trailing = not lost.startswith(("nan", "minus", "inf"))
    assert loaded.row_count == (8 if trailing else 9)
    assert loaded.read_as.lost == loaded.row_count - 6
    assert f"{loaded.read_as.lost} of {loaded.row_count} rows" in loaded.read_as.sentence


def test_empty_lines_between_all_rows_are_no_lost_poses(file):
    loaded = read_trajectory(file("traj.txt", "\n\n".join(map(_square_row, range(5)))))
    assert loaded.row_count == 5 and loaded.read_as.lost == 0


def test_a_lost_first_row_of_seven_columns_keeps_its_place(file):
    rows = ["nan " * 7, "nan " * 7, "1 0 0 0 0 0 1", "2 0 0 0 0 0 1"]
    loaded = read_trajectory(file("pose_left.txt", "\n".join(rows)))
    np.testing.assert_array_equal(loaded.rows, [2, 3])


def test_a_lost_row_with_a_stamp_is_left_out_with_a_note(file):
    loaded = read_trajectory(file("a.txt", "1 0 0 0 0 0 0 1\n2 nan 0 0 0 0 0 1\n3 0 0 0 0 0 0 1\n"))
    np.testing.assert_array_equal(loaded.trajectory.stamps_s, [1, 3])
    np.testing.assert_array_equal(loaded.rows, [0, 2])
    assert not loaded.is_counted and "1 of 3 rows" in loaded.read_as.sentence


# -- TUM


def test_tum_is_read_as_it_stands(file):
    loaded = read_trajectory(
        file("a.txt", "# comment\n\n0.5 1 2 3 0 0 0.6 0.8 # why\r\n 1.5\t4 5 6 0 0 0 1\n")
    )
    np.testing.assert_array_equal(loaded.trajectory.stamps_s, [0.5, 1.5])
    np.testing.assert_array_equal(loaded.trajectory.positions_m, [[1, 2, 3], [4, 5, 6]])
    expected = Rotation.from_quat([0, 0, 0.6, 0.8]).as_matrix()
    np.testing.assert_allclose(loaded.trajectory.T_world_camera.rotation[0], expected, atol=1e-15)
    assert (loaded.read_as.format, loaded.read_as.handedness) == ("tum", "right")


def test_quaternions_of_three_digits_are_normalised(file):
    loaded = read_trajectory(file("a.txt", "0 0 0 0 0.707 0 0 0.707\n"))
    np.testing.assert_allclose(
        np.linalg.det(loaded.trajectory.T_world_camera.rotation), 1, atol=1e-14
    )


def test_whole_number_stamps_are_seconds_unless_told_otherwise(file):
    path = file("a.txt", "".join(f"{i} {i} 0 0 0 0 0 1\n" for i in range(5)))
    loaded = read_trajectory(path)
    assert loaded.read_as.format == "tum" and "tum-ids" in loaded.read_as.sentence
    np.testing.assert_array_equal(loaded.trajectory.stamps_s, range(5))
    frames = read_trajectory(path, "tum-ids")
    np.testing.assert_allclose(
        frames.trajectory.stamps_s, 1 + np.arange(5) / 30, atol=5.1e-7, rtol=0
    )
    np.testing.assert_array_equal(frames.trajectory.positions_m, loaded.trajectory.positions_m)


def test_reading_takes_no_call_per_line(tmp_path):
    calls = {}
    for count in (1000, 100_000):
        poses = SE3.exp(np.random.default_rng(0).normal(size=(count, 6)) * 0.5)
        write_trajectory(tmp_path / "big.txt", Trajectory.at_rate(poses), "tum")
        calls[count] = 0

        def counted(frame, event, argument, count=count):
            calls[count] += 1

        gc.collect()  # now: what other tests have left would call back while it is counted
        sys.setprofile(counted)
        loaded = read_trajectory(tmp_path / "big.txt")
        sys.setprofile(None)
        assert len(loaded.trajectory) == count
    assert calls[100_000] < calls[1000] + 500


# -- as SLAM systems write them


def test_a_stamp_written_twice_counts_once_and_is_noted(file):
    """As ORB-SLAM3 does for a frame that it lost: stamp and pose of the one before."""
    lines = [f"{1 + i / 30:.6f} {i} 0 0 0 0 0 1\n" for i in range(5)]
    loaded = read_trajectory(file("a.txt", "".join([*lines[:3], lines[2], *lines[3:]])))
    np.testing.assert_array_equal(loaded.trajectory.positions_m[:, 0], range(5))
    assert loaded.read_as.sentence.endswith("; 1 repeated stamp left out")


@pytest.mark.parametrize("first_s", ["0", "1", "1403636579"])
def test_orb_slam3s_nanoseconds_are_told_from_seconds_by_their_steps(file, first_s):
    ns = [int(first_s) * 10**9 + i * 33333333 for i in range(4)]
    loaded = read_trajectory(file("f_ours.txt", "".join(f"{t}.000000 1 2 3 0 0 0 1\n" for t in ns)))
    np.testing.assert_allclose(loaded.trajectory.stamps_s, np.array(ns) / 1e9, rtol=0, atol=3e-7)
    assert loaded.read_as.format == "tum" and "stamps in nanoseconds" in loaded.read_as.sentence


def test_keyframes_an_hour_apart_are_still_in_seconds(file):
    loaded = read_trajectory(
        file("KeyFrameTrajectory.txt", "0 0 0 0 0 0 0 1\n3600 1 0 0 0 0 0 1\n")
    )
    np.testing.assert_array_equal(loaded.trajectory.stamps_s, [0, 3600])


def test_replicas_rows_are_camera_to_world(file):
    text = "".join(" ".join(f"{v:.18e}" for v in row) + "\n" for row in ROWS.matrix.reshape(-1, 16))
    loaded = read_trajectory(file("traj.txt", text))
    assert (loaded.read_as.format, loaded.read_as.handedness) == ("replica", "right")
    np.testing.assert_allclose(loaded.trajectory.T_world_camera.matrix, ROWS.matrix, atol=1e-14)
    np.testing.assert_allclose((loaded.trajectory.stamps_s - 1) * 30, range(4), atol=2e-5)


@pytest.mark.parametrize(
    ("names", "stamps_s"),
    [
        (["rgb/000002.png", "rgb/000010.png", "000030.jpg"], [1.066667, 1.333333, 2]),
        (["frame2.png", "frame10.png", "frame_30.png"], [1.066667, 1.333333, 2]),
        (["1305031102.175304.png", "1305031102.211214.png", "1305031103.png"], [1305031102.175304, 1305031102.211214, 1305031103]),
        (["1403636579763555584.png", "1403636579813555456.png"], [1403636579.763555584, 1403636579.813555456]),
        (["1305031102175304.png", "1305031102211214.png"], [1305031102.175304, 1305031102.211214]),
    ],
)  # fmt: skip
@pytest.mark.parametrize("points", ["\n", "1.5 2.5 -1 3 4 17 5 6 -1 7 8 9\n", ""])
def test_colmaps_images_are_inverted_and_put_in_order(file, names, stamps_s, points):
    """COLMAP has x_camera = R(q) x_world + t, in any order of the images."""
    rows, R = [], Rotation.from_matrix(np.array(ROWS.rotation))
    for i, name in enumerate(names):
        q, t = R[i].inv().as_quat(), -R[i].inv().apply(np.array(ROWS.translation[i]))
        rows.append(
            " ".join([str(9 - i), *(f"{v:.17g}" for v in (q[3], *q[:3], *t)), "1", name]) + "\n"
        )
    header = "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
    loaded = read_trajectory(file("images.txt", header + points.join(rows[::-1]) + points))
    assert (loaded.read_as.format, loaded.read_as.handedness) == ("colmap", "right")
    np.testing.assert_allclose(loaded.trajectory.stamps_s, stamps_s, rtol=0, atol=5e-7)
    np.testing.assert_allclose(
        loaded.trajectory.T_world_camera.matrix, ROWS.matrix[: len(names)], atol=1e-14
    )


# -- handedness: by name, by start, by --from; by nothing else

LEFT = "{id0} 0 0 {z} 0 0 0 1\n{id1} 0.1 0.2 0.3 0.1 0.2 0.3 0.9273618495495704\n"


def is_left_handed(path, format=None) -> bool:
    loaded = read_trajectory(path, format)
    assert (loaded.read_as.handedness == "left") == (loaded.read_as.format == "gt.freiburg")
    # left-handed files come out with y mirrored, right-handed ones as they stand
    assert loaded.trajectory.positions_m[1, 1] == (
        -0.2 if loaded.read_as.handedness == "left" else 0.2
    )
    return loaded.read_as.handedness == "left"


def test_the_name_makes_a_file_left_handed(file):
    assert is_left_handed(file("traj0.gt.freiburg", LEFT.format(id0=1, id1=2, z=7)))
    assert is_left_handed(file("TRAJ0.GT.FREIBURG", LEFT.format(id0=1, id1=2, z=7)))


@pytest.mark.parametrize("z", [-2.25, -2.5, -2.2505, -2.499])
def test_the_official_start_makes_a_file_left_handed(file, z):
    assert is_left_handed(file("groundtruth.txt", LEFT.format(id0=1, id1=2, z=z)))


@pytest.mark.parametrize("z", [0, 2.25, -2.0, -2.3, -2.4])
def test_whole_numbers_alone_do_not(file, z):
    assert not is_left_handed(file("groundtruth.txt", LEFT.format(id0=1, id1=2, z=z)))


def test_seconds_are_no_frame_ids_wherever_the_path_starts(file):
    assert not is_left_handed(file("estimate.txt", LEFT.format(id0=0, id1="0.033333", z=-2.25)))


def test_being_told_beats_name_and_start(file):
    left = file("a.gt.freiburg", LEFT.format(id0=1, id1=2, z=-2.25))
    assert not is_left_handed(left, "tum")
    assert is_left_handed(file("a.txt", LEFT.format(id0=1, id1=2, z=9)), "gt.freiburg")


def test_a_converted_file_is_not_mirrored_twice(file, tmp_path):
    loaded = read_trajectory(file("a.gt.freiburg", LEFT.format(id0=30, id1=60, z=-2.25)))
    write_trajectory(tmp_path / "a.txt", loaded.trajectory, "tum")
    # whole seconds at the official start
    np.testing.assert_array_equal(loaded.trajectory.stamps_s, [2, 3])
    again = read_trajectory(tmp_path / "a.txt")
    assert again.read_as.format == "tum"
    np.testing.assert_allclose(
        again.trajectory.T_world_camera.matrix, loaded.trajectory.T_world_camera.matrix, atol=1e-9
    )


def test_left_handed_ids_become_right_handed_seconds(file):
    loaded = read_trajectory(file("a.gt.freiburg", LEFT.format(id0=1, id1=2, z=-2.25)))
    np.testing.assert_allclose(loaded.trajectory.stamps_s, [1.033333, 1.066667])
    np.testing.assert_allclose(
        loaded.trajectory.T_world_camera.quat_xyzw[1, :3], [-0.1, 0.2, -0.3], atol=1e-15
    )


# -- matrices

ROWS = SE3.exp(np.random.default_rng(1).normal(size=(4, 6)))


def matrix_text(numbered: bool, header: str = "") -> str:
    rows = ROWS.matrix[:, :3].reshape(-1, 12)
    return header + "".join(
        (f"{10 + i} " if numbered else "") + " ".join(f"{v:.15g}" for v in row) + "\n"
        for i, row in enumerate(rows)
    )


@pytest.mark.parametrize("numbered", [False, True])
def test_matrix_rows_are_kitti_poses(file, numbered):
    loaded = read_trajectory(file("00.txt", matrix_text(numbered)))
    assert (loaded.read_as.format, loaded.read_as.handedness) == ("kitti", "right")
    np.testing.assert_allclose(loaded.trajectory.T_world_camera.matrix, ROWS.matrix, atol=1e-14)
    np.testing.assert_allclose(
        (loaded.trajectory.stamps_s - 1) * 30, np.arange(4) + (10 if numbered else 0), atol=2e-5
    )


@pytest.mark.parametrize("numbered", [False, True])
@pytest.mark.parametrize(
    ("name", "header"),
    [("lr_Tpov_cam.txt", ""), ("rows.txt", "# T_pov_cam, LEFT-handed POV-Ray world\n")],
)
def test_matrix_rows_are_in_the_pov_world_where_name_or_header_says_so(
    file, name, header, numbered
):
    loaded = read_trajectory(file(name, matrix_text(numbered, header)))
    assert (loaded.read_as.format, loaded.read_as.handedness) == ("pov-matrix", "left")
    expected = axes.world_cv_from_pov(ROWS)
    np.testing.assert_allclose(loaded.trajectory.T_world_camera.matrix, expected.matrix, atol=1e-14)


def test_matrix_rows_in_a_folder_named_pov_are_not_in_the_pov_world(file):
    assert read_trajectory(file("povray/00.txt", matrix_text(False))).read_as.format == "kitti"


def test_centimetres_are_suspected_in_the_pov_world(file):
    text = "1 0 0 91 0 1 0 465 0 0 1 -292\n"
    assert "unit cm" in read_trajectory(file("office_pov.txt", text)).read_as.sentence
    loaded = read_trajectory(file("office_pov.txt", text), unit_m=0.01)
    assert "unit cm" not in loaded.read_as.sentence
    np.testing.assert_allclose(loaded.trajectory.positions_m, [[-0.91, 2.92, 4.65]])


def test_sim_blocks_start_at_image_one(file):
    text = "1 0 0 0.1\n0 1 0 0.2\n0 0 1 -2.25\n\n0 -1 0 1\n1 0 0 2\n0 0 1 3\n"
    for name in ("a.gt.sim", "a.txt"):
        loaded = read_trajectory(file(name, text))
        assert (loaded.read_as.format, loaded.read_as.handedness) == ("gt.sim", "left")
        np.testing.assert_allclose(loaded.trajectory.stamps_s, [1.033333, 1.066667])
        np.testing.assert_array_equal(
            loaded.trajectory.positions_m, [[0.1, -0.2, -2.25], [1, -2, 3]]
        )
        # a quarter turn about z changes its sense in the mirror
        np.testing.assert_array_equal(
            loaded.trajectory.T_world_camera.rotation[1], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
        )


# -- POV-Ray


def command(number, T: SE3, declare: str = " + Declare") -> str:
    rows = np.vstack([T.rotation.T, T.translation])
    values = "".join(f"{declare}=val{r}{c}={rows[r, c]:.15g}" for r in range(4) for c in range(3))
    return f"/usr/bin/povray +Iliving_room.pov +Oscene_00_{number:04d}.png +W640 +H480{values}\n"


@pytest.mark.parametrize("declare", [" + Declare", "+ Declare", " Declare", "  Declare "])
def test_render_commands_are_poses_in_the_pov_world(file, declare):
    text = "#!/bin/sh\ncd out\n" + "".join(
        command(i, ROWS[k], declare) for k, i in enumerate((0, 1, 5, 7))
    )
    loaded = read_trajectory(file("commands.txt", text), "pov-commands")
    np.testing.assert_allclose(
        loaded.trajectory.T_world_camera.matrix, axes.world_cv_from_pov(ROWS).matrix, atol=1e-13
    )
    np.testing.assert_allclose((loaded.trajectory.stamps_s - 1) * 30, [0, 1, 5, 7], atol=2e-5)


def test_render_commands_without_numbered_images_are_counted(file):
    text = "".join(command(i, ROWS[i]).replace(f"+Oscene_00_{i:04d}.png", "") for i in range(4))
    np.testing.assert_allclose(
        (read_trajectory(file("x", text)).trajectory.stamps_s - 1) * 30, range(4), atol=2e-5
    )


CAMERA = """cam_pos      = [91, 465, -292]';
cam_dir      = [0.0496855, -0.285692, 0.957033]';
cam_up       = [0.00725319, 0.958294, 0.285692]';
cam_lookat   = [0, 0, 1]';
cam_sky      = [0, 1, 0]';
cam_right    = [1.32832, 0.00964677, -0.0660817]';
cam_fpoint   = [0, 0, 10]';
cam_angle    = 90;
"""


def test_a_folder_of_camera_files_is_a_trajectory(file, tmp_path):
    for i in (0, 2, 10):
        file(f"cams/scene_00_{i:04d}.txt", CAMERA.replace("[91,", f"[{91 + i},"))
    file("cams/notes.txt", "not a camera")
    loaded = read_trajectory(tmp_path / "cams", unit_m=0.01)
    assert (loaded.read_as.format, loaded.read_as.handedness) == ("pov-cameras", "left")
    np.testing.assert_allclose((loaded.trajectory.stamps_s - 1) * 30, [0, 2, 10], atol=2e-5)
    np.testing.assert_allclose(
        loaded.trajectory.positions_m,
        [[-0.91, 2.92, 4.65], [-0.93, 2.92, 4.65], [-1.01, 2.92, 4.65]],
    )
    # what the camera looks along, and what it has on its right
    forward, right = (
        loaded.trajectory.T_world_camera.rotation[0][:, 2],
        loaded.trajectory.T_world_camera.rotation[0][:, 0],
    )
    np.testing.assert_allclose(
        forward, axes.WORLD_FROM_POV @ (0.0496855, -0.285692, 0.957033), atol=1e-5
    )
    np.testing.assert_allclose(
        right, axes.WORLD_FROM_POV @ (1.32832, 0.00964677, -0.0660817) / 1.33, atol=1e-4
    )


def test_one_camera_file_is_one_pose(file):
    loaded = read_trajectory(file("scene_00_0030.txt", CAMERA), unit_m=0.01)
    np.testing.assert_allclose(loaded.trajectory.stamps_s, [2])


def test_a_camera_file_and_a_render_command_agree(file):
    camera = read_trajectory(file("scene_0.txt", CAMERA)).trajectory
    pov = axes.pov_from_world_cv(camera.T_world_camera)
    commanded = read_trajectory(file("commands.txt", command(0, pov[0]))).trajectory
    np.testing.assert_allclose(
        commanded.T_world_camera.matrix, camera.T_world_camera.matrix, atol=1e-12
    )


# -- EuRoC


@pytest.mark.parametrize("more", ["", ",1,2,3,4,5,6,7,8,9"])
def test_euroc_has_nanoseconds_and_the_scalar_first(file, more):
    text = f"1403636579763555584,1,2,3,0.8,0,0,0.6{more}\n1403636579863555584,4,5,6,1,0,0,0{more}\n"
    text = "#timestamp, p_RS_R_x [m], and so on\n" + text
    loaded = read_trajectory(file("data.csv", text))
    assert (loaded.read_as.format, loaded.read_as.handedness) == ("euroc", "right")
    np.testing.assert_allclose(
        loaded.trajectory.stamps_s, [1403636579.763555584, 1403636579.863555584], rtol=0, atol=5e-7
    )
    expected = Rotation.from_quat([0, 0, 0.6, 0.8]).as_matrix()
    np.testing.assert_allclose(loaded.trajectory.T_world_camera.rotation[0], expected, atol=1e-15)


# -- the official samples


@pytest.mark.parametrize(
    ("name", "format", "poses", "length_m"),
    [
        ("trajectories/lr_kt0_Tpov_cam_3x4.txt", "pov-matrix", 1510, 6.545),
        ("trajectories/lr_kt2_Tpov_cam_3x4.txt", "pov-matrix", 882, 8.430),
        ("trajectories/livingRoom0.gt.freiburg.recomputed", "gt.freiburg", 1508, 6.534),
        ("or_kt0/traj0.gt.freiburg", "gt.freiburg", 1507, 6.525),
    ],
)
def test_official_files_have_their_known_lengths(samples, name, format, poses, length_m):
    loaded = read_trajectory(samples / name)
    assert (loaded.read_as.format, loaded.read_as.handedness) == (format, "left")
    assert len(loaded.trajectory) == poses
    assert loaded.trajectory.length_m() == pytest.approx(length_m, abs=5e-4)


def test_the_published_ground_truth_comes_out_of_the_pov_poses(samples, tmp_path):
    poses = read_trajectory(samples / "trajectories/lr_kt0_Tpov_cam_3x4.txt").trajectory
    write_trajectory(tmp_path / "kt0.gt.freiburg", poses, "gt.freiburg")
    ours = np.loadtxt(tmp_path / "kt0.gt.freiburg")
    official = np.loadtxt(samples / "trajectories/livingRoom0.gt.freiburg.recomputed")
    ours = ours[: len(official)]  # the published files leave out the last frame
    np.testing.assert_array_equal(ours[:, 0], official[:, 0])
    np.testing.assert_allclose(ours[:, 1:], official[:, 1:], rtol=0, atol=1e-5)


def test_both_official_forms_of_kt0_are_one_path_in_a_right_handed_world(samples):
    pov = read_trajectory(samples / "trajectories/lr_kt0_Tpov_cam_3x4.txt").trajectory[1:1509]
    anchored = read_trajectory(
        samples / "trajectories/livingRoom0.gt.freiburg.recomputed"
    ).trajectory
    np.testing.assert_allclose(anchored.stamps_s, pov.stamps_s)
    motion = [t.T_world_camera[0].inverse() @ t.T_world_camera for t in (pov, anchored)]
    np.testing.assert_allclose(motion[1].matrix, motion[0].matrix, atol=1e-5)


def test_the_offices_ground_truth_goes_through_tum_and_back_unmoved(samples, tmp_path):
    source = samples / "or_kt0/traj0.gt.freiburg"
    write_trajectory(tmp_path / "a.txt", read_trajectory(source).trajectory, "tum")
    write_trajectory(
        tmp_path / "a.gt.freiburg", read_trajectory(tmp_path / "a.txt").trajectory, "gt.freiburg"
    )
    np.testing.assert_allclose(
        np.loadtxt(tmp_path / "a.gt.freiburg"), np.loadtxt(source), atol=2e-6
    )


def test_every_format_says_in_one_sentence_how_it_was_taken(samples):
    for name in ("trajectories/lr_kt0_Tpov_cam_3x4.txt", "or_kt0/traj0.gt.freiburg"):
        sentence = read_trajectory(samples / name).read_as.sentence
        assert "\n" not in sentence and "LEFT-handed" in sentence
    assert all(known.writer.goes_to for known in FORMATS.values() if known.writer)


def test_a_loaded_trajectory_shows_itself_in_one_short_line(file):
    lines = [f"{i}.5 {i} 0 0 0 0 0 1\n" for i in range(999)]
    loaded = read_trajectory(
        file("a.txt", "".join([*lines, lines[-1], lines[-1].replace(" 0", " nan")]))
    )
    assert repr(loaded) == (
        "LoadedTrajectory(tum, Trajectory(999 poses, 0.500..998.500 s, 998.000 m), "
        "1 lost, 1 repeated)"
    )
    assert repr(read_trajectory(file("b.txt", lines[0]))) == (
        "LoadedTrajectory(tum, Trajectory(1 poses, 0.500..0.500 s, 0.000 m))"
    )
