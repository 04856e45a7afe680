"""Trajectories as other programs and people write them: columns named by a header, separators,
units, matrices in blocks, positions alone. Each is one trajectory in another form.
"""

import json
import re

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry import axes
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files.trajectories import read_trajectory, trajectory_text

COUNT = 12
WALK = Trajectory.at_rate(
    SE3.exp(np.cumsum(np.random.default_rng(3).normal(size=(COUNT, 6)) * 0.1, axis=0))
)
X, Y, Z = WALK.positions_m.T
QX, QY, QZ, QW = WALK.T_world_camera.quat_xyzw.T
S = WALK.stamps_s
EPOCH_S = 1403636579
NS = np.rint(S * 1e9).astype(int) + EPOCH_S * 10**9


def column(values) -> list[str]:
    """The texts of a column: whole numbers as they are, others with all digits."""
    return [str(value) for value in np.asarray(values).tolist()]


def table(header: str, *columns, separator: str = " ", end: str = "") -> str:
    rows = zip(*map(column, columns), strict=True)
    lines = [separator.join(row) + end for row in rows]
    return "\n".join([header, *lines] if header else lines) + "\n"


def as_walk(loaded, stamps_s=S, tolerance: float = 1e-12) -> None:
    found = loaded.trajectory
    np.testing.assert_allclose(found.stamps_s, stamps_s, rtol=0, atol=6e-7)
    expected = WALK.T_world_camera.matrix
    np.testing.assert_allclose(found.T_world_camera.matrix, expected, rtol=0, atol=tolerance)


ZERO = np.zeros(COUNT, int)
WORD = ["map"] * COUNT
LAST = (QX, QY, QZ, QW)
FIRST = (QW, QX, QY, QZ)
AT = (X, Y, Z)
#: program or person -> text of a file with seconds
SECONDS = {
    "DROID-SLAM": table("# timestamp tx ty tz qw qx qy qz", S, *AT, *FIRST),
    "no #": table("timestamp tx ty tz qx qy qz qw", S, *AT, *LAST),
    "no #, qw first": table("timestamp tx ty tz qw qx qy qz", S, *AT, *FIRST),
    "tabs": table("time\tx\ty\tz\tqw\tqx\tqy\tqz", S, *AT, *FIRST, separator="\t"),
    "semicolons": table("t;x;y;z;qx;qy;qz;qw", S, *AT, *LAST, separator=";"),
    "decimal commas": table("t;x;y;z;qw;qx;qy;qz", S, *AT, *FIRST, separator=";").replace(".", ","),
    "commas and blanks": table("time, x, y, z, qx, qy, qz, qw", S, *AT, *LAST, separator=", "),
    "quotes": table('"stamp","x","y","z","qx","qy","qz","qw"', S, *AT, *LAST, separator=","),
    "RTAB-Map": table("#timestamp x y z qx qy qz qw id", S, *AT, *LAST, range(COUNT)),
    "OpenVINS": table("# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12", S, *AT, *LAST, ZERO, ZERO),
    "OpenVINS simulation": table("# format: timestamp tx ty tz qx qy qz qw Ptx", S, *AT, *LAST, ZERO),
    "UZH-FPV": table("# id timestamp tx ty tz qx qy qz qw", range(COUNT), S, *AT, *LAST),
    "pandas": table(",timestamp,tx,ty,tz,qx,qy,qz,qw", range(COUNT), S, *AT, *LAST, separator=","),
    "pandas with blanks": table("timestamp tx ty tz qw qx qy qz", range(COUNT), S, *AT, *FIRST),
    "StrayScanner": table("timestamp, frame, x, y, z, qx, qy, qz, qw", S, range(COUNT), *AT, *LAST, separator=", "),
    "seconds and nanoseconds": table("#sec,nsec,x,y,z,qx,qy,qz,qw", S.astype(int), np.rint(S % 1 * 1e9).astype(int), *AT, *LAST, separator=","),
    "bagpy": table("Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,pose.position.x,pose.position.y,pose.position.z,pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.orientation.w", S + 3, ZERO, S.astype(int), np.rint(S % 1 * 1e9).astype(int), WORD, *AT, *LAST, separator=","),
    "rotation first": table("qw,qx,qy,qz,tx,ty,tz,time", *FIRST, *AT, S, separator=","),
    "velocities between": table("timestamp x y z vx vy vz qx qy qz qw", S, *AT, ZERO, ZERO, ZERO, *LAST),
    "millimetres": table("timestamp,x [mm],y [mm],z [mm],qx,qy,qz,qw", S, 1e3 * X, 1e3 * Y, 1e3 * Z, *LAST, separator=","),
    "metres in names": table("time_s;p_x_m;p_y_m;p_z_m;q_w;q_x;q_y;q_z", S, *AT, *FIRST, separator=";"),
    "stamp last": table("tx ty tz qx qy qz qw timestamp", *AT, *LAST, S),
    "matrix by names": table("t r00 r10 r20 r01 r11 r21 r02 r12 r22 t_x t_y t_z", S, *WALK.T_world_camera.rotation.transpose(2, 1, 0).reshape(9, COUNT), *AT),
    "comma at the end": table("timestamp,x,y,z,qx,qy,qz,qw,", S, *AT, *LAST, separator=",", end=","),
    "covariances": table("timestamp,x,y,z," + ",".join(f"field.pose.covariance.{i}" for i in range(72)) + ",qx,qy,qz,qw", S, *AT, *[ZERO] * 72, *LAST, separator=","),
    "PlotJuggler": table("__time,/vio/pose/pose/position/x,/vio/pose/pose/position/y,/vio/pose/pose/position/z,/vio/pose/pose/orientation/x,/vio/pose/pose/orientation/y,/vio/pose/pose/orientation/z,/vio/pose/pose/orientation/w", S, *AT, *LAST, separator=","),
    "MATLAB": table("% made by me\n% t x y z qw qx qy qz", S, *AT, *FIRST),
    "rotation as r": table("timestamp,tx,ty,tz,rx,ry,rz,rw", S, *AT, *LAST, separator=","),
    "ROS 2": table("header.stamp.sec,header.stamp.nanosec,pose.pose.position.x,pose.pose.position.y,pose.pose.position.z,pose.pose.orientation.x,pose.pose.orientation.y,pose.pose.orientation.z,pose.pose.orientation.w", S.astype(int), np.rint(S % 1 * 1e9).astype(int), *AT, *LAST, separator=","),
    "prose after other names": table("# timestamp tx ty tz qw qx qy qz; seconds, metres", S, *AT, *FIRST),
    "prose after the names": table("# timestamp tx ty tz qx qy qz qw; seconds, x y z in metres", S, *AT, *LAST),
    "prose before the names": table("# ground truth\n# made at x = 1, y = 2, z = 3\n# timestamp tx ty tz qx qy qz qw", S, *AT, *LAST),
}  # fmt: skip
#: program -> text of a file with nanoseconds since 1970
NANOSECONDS = {
    "EuRoC": table("#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []", NS, *AT, *FIRST, separator=","),
    "maplab with frames": table("timestamp [ns], vertex index, p_G_Ix [m], p_G_Iy [m], p_G_Iz [m], q_G_Iw [], q_G_Ix [], q_G_Iy [], q_G_Iz []", NS, ZERO, *AT, *FIRST, separator=", "),
    "EuRoC with the scalar last": table("#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_x [], q_RS_y [], q_RS_z [], q_RS_w []", NS, *AT, *LAST, separator=","),
    "EuRoC with blanks": table("#timestamp [ns] p_RS_R_x [m] p_RS_R_y [m] p_RS_R_z [m] q_RS_w [] q_RS_x [] q_RS_y [] q_RS_z []", NS, *AT, *FIRST),
    "OKVIS": table("timestamp, p_WS_W_x, p_WS_W_y, p_WS_W_z, q_WS_x, q_WS_y, q_WS_z, q_WS_w, v_WS_W_x, b_g_x", NS, *AT, *LAST, ZERO, ZERO, separator=", "),
    "VINS-Mono": table("", NS, *AT, *FIRST, ZERO, ZERO, ZERO, separator=",", end=","),
    "VINS-Fusion": table("", NS, *AT, *FIRST, separator=",", end=","),
    "Kimera": table("#timestamp,x,y,z,qw,qx,qy,qz,vx,vy,vz,bgx,bgy,bgz,bax,bay,baz", NS, *AT, *FIRST, *[ZERO] * 9, separator=","),
    "rostopic echo -p": table("%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x,field.pose.position.y,field.pose.position.z,field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w", NS + 10**9, ZERO, NS, WORD, *AT, *LAST, separator=","),
    "Aria": table("graph_uid,tracking_timestamp_us,utc_timestamp_ns,tx_world_device,ty_world_device,tz_world_device,qx_world_device,qy_world_device,qz_world_device,qw_world_device,gravity_x_world", WORD, NS // 1000, NS, *AT, *LAST, ZERO, separator=","),
    "maplab": table("vertex index,timestamp [ns],position x [m],position y [m],position z [m],quaternion x,quaternion y,quaternion z,quaternion w", range(COUNT), NS, *AT, *LAST, separator=","),
    "timestamp_ns": table("timestamp_ns,pos_x,pos_y,pos_z,quat_w,quat_x,quat_y,quat_z", NS, *AT, *FIRST, separator=","),
    "microseconds": table("timestamp_us tx ty tz qx qy qz qw", NS // 1000, *AT, *LAST),
    "milliseconds": table("timestamp [ms],x,y,z,qw,qx,qy,qz", NS / 1e6, *AT, *FIRST, separator=","),
    "ORB-SLAM3": table("", [f"{value}.000000" for value in NS.tolist()], *AT, *LAST),
    "microseconds without a name": table("", NS // 1000, *AT, *LAST),
    "milliseconds without a name": table("", NS / 1e6, *AT, *LAST),
}  # fmt: skip


@pytest.mark.parametrize("program", SECONDS)
def test_columns_are_found_by_their_names(tmp_path, program):
    (tmp_path / "a.txt").write_text(SECONDS[program])
    as_walk(read_trajectory(tmp_path / "a.txt"))


@pytest.mark.parametrize("program", NANOSECONDS)
def test_stamps_since_1970_are_read_in_any_unit(tmp_path, program):
    (tmp_path / "a.csv").write_text(NANOSECONDS[program])
    as_walk(read_trajectory(tmp_path / "a.csv"), S + EPOCH_S)


# -- matrices

MATRICES = WALK.T_world_camera.matrix
NUMBERS = 10 * np.arange(COUNT)
NUMBER_STAMPS = 1 + NUMBERS / 30


def rows_of(columns: int, *first) -> str:
    return table("", *first, *MATRICES.reshape(COUNT, 16)[:, :columns].T)


def blocks_of(head: str, matrices=MATRICES, between: str = "") -> str:
    """4 x 4 lines for each matrix; head: of the line before, with {0} for its number."""
    text = ""
    for number, matrix in zip(NUMBERS.tolist(), matrices, strict=True):
        lines = [" ".join(column(row)) for row in matrix]
        text += head.format(number) + "\n".join(lines) + "\n" + between
    return text


@pytest.mark.parametrize("columns", [12, 16])
def test_a_matrix_may_have_a_frame_number_or_a_stamp_in_front(tmp_path, columns):
    path = tmp_path / "a.txt"
    path.write_text(rows_of(columns))
    as_walk(read_trajectory(path))
    since_1970 = S + EPOCH_S
    for first, stamps_s in (
        (NUMBERS, NUMBER_STAMPS),
        (S, S),
        (NS, since_1970),
        (NS // 1000, since_1970),
    ):
        path.write_text(rows_of(columns, first))
        as_walk(read_trajectory(path), stamps_s)


def test_a_matrix_with_commas_is_no_state_of_euroc(tmp_path):
    for columns in (12, 16):
        (tmp_path / "a.csv").write_text(rows_of(columns, NUMBERS).replace(" ", ","))
        as_walk(read_trajectory(tmp_path / "a.csv"), NUMBER_STAMPS)


@pytest.mark.parametrize("head", ["{0} {0} 9\n", "{0}\n", "{0}\t{0}\t0\n"])
def test_redwoods_log_numbers_its_frames(tmp_path, head):
    for name in ("traj.log", "livingroom1-traj.txt"):
        (tmp_path / name).write_text(blocks_of(head))
        as_walk(read_trajectory(tmp_path / name), NUMBER_STAMPS)


@pytest.mark.parametrize("between", ["", "\n"])
def test_stacked_matrices_are_counted(tmp_path, between):
    (tmp_path / "a.txt").write_text(blocks_of("", between=between))
    as_walk(read_trajectory(tmp_path / "a.txt"))


def test_matrices_as_numpy_prints_them_are_read(tmp_path):
    (tmp_path / "a.txt").write_text(
        np.array2string(MATRICES, separator=", ", threshold=10**6, floatmode="maxprec")
    )
    as_walk(read_trajectory(tmp_path / "a.txt"), tolerance=2e-8)


@pytest.mark.parametrize(
    ("text", "line", "found"),
    [
        (blocks_of("{0} 1 2\n"), 1, "0 1 2"),  # pairs of fragments are no trajectory
        (blocks_of("{0} {0} 1\n").replace("0.0 0.0 0.0 1.0", "0.0 0.0 1.0 1.0", 1), 1, "0 0 1 1"),
        (blocks_of("{0} {0} 1\n") + "9 9 9\n1 0 0 0\n", 61, "another length"),
        (blocks_of("{0} {0} 1\n").replace("\n", " 0\n", 7).replace(" 0\n", "\n", 6), 6, "another length"),
        (blocks_of("{0} {0} 1\n").replace("0.0 0.0 0.0 1.0", "0.0 0.0 0.0 one", 1), 1, "'one'"),
    ],
)  # fmt: skip
def test_the_first_bad_block_is_named_by_its_line(tmp_path, text, line, found):
    (tmp_path / "a.log").write_text(text)
    with pytest.raises(InputError, match=f"a.log:{line}: expected blocks of .*found .*{found}"):
        read_trajectory(tmp_path / "a.log", "matrix-blocks")


def open3d(matrices) -> list[dict]:
    return [
        {"class_name": "PinholeCameraParameters", "extrinsic": m.T.ravel().tolist()}
        for m in matrices
    ]


def test_open3ds_extrinsics_are_world_to_camera_and_column_by_column(tmp_path):
    inverse = WALK.T_world_camera.inverse().matrix
    of_first_versions = [camera["extrinsic"] for camera in open3d(inverse)]
    for content in ({"parameters": open3d(inverse)}, {"extrinsic": of_first_versions}):
        text = json.dumps({"class_name": "PinholeCameraTrajectory", **content})
        (tmp_path / "a.json").write_text(text)
        loaded = read_trajectory(tmp_path / "a.json")
        assert loaded.read_as.format == "open3d" and "inverted" in loaded.read_as.sentence
        as_walk(loaded)


@pytest.mark.parametrize(
    "content",
    [{}, {"parameters": []}, {"parameters": 3}, {"parameters": [1]}, {"parameters": [{}]}, {"extrinsic": [[1]]}],
)  # fmt: skip
def test_open3d_without_extrinsics_is_refused(tmp_path, content):
    text = json.dumps({"class_name": "PinholeCameraTrajectory", **content})
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match="a.json: expected a"):
        read_trajectory(tmp_path / "a.json")


def test_rotations_of_three_digits_are_made_orthonormal_which_is_noted(tmp_path):
    every = SE3.exp(np.random.default_rng(5).normal(size=(2000, 6)))
    rows = np.round(every.matrix[:, :3].reshape(-1, 12), 3)
    np.savetxt(tmp_path / "kitti.txt", rows, fmt="%.3f")
    loaded = read_trajectory(tmp_path / "kitti.txt")
    off = loaded.trajectory.T_world_camera.rotation - every.rotation
    assert np.abs(off).max() < 1.5e-3 and "few digits" in loaded.read_as.sentence
    for slightly_larger in (1, 1.0004):
        np.savetxt(tmp_path / "kitti.txt", slightly_larger * every.matrix[:, :3].reshape(-1, 12))
        assert "digits" not in read_trajectory(tmp_path / "kitti.txt").read_as.sentence
    np.savetxt(tmp_path / "kitti.txt", 1.0011 * rows, fmt="%.9f")
    with pytest.raises(InputError, match="rotation matrices"):
        read_trajectory(tmp_path / "kitti.txt")


# -- seven columns, positions alone, map coordinates, encodings


def test_seven_columns_are_ned_only_by_a_name_or_beside_tartanairs_images(tmp_path):
    text = table("", *AT, *LAST)
    for name in ("poses.txt", "gt.txt", "est.txt", "left.txt"):
        (tmp_path / name).write_text(text)
        loaded = read_trajectory(tmp_path / name)
        assert loaded.read_as.format == "tum-unstamped" and "NED" in loaded.read_as.sentence
        as_walk(loaded)
    (tmp_path / "P000" / "image_left").mkdir(parents=True)
    names = ["pose_left.txt", "pose_right.txt", "pose_gt.txt", "pose_est.txt"]
    for name in [*names, "pose_lcam_front.txt", "P000/anything.txt"]:
        (tmp_path / name).write_text(text)
        loaded = read_trajectory(tmp_path / name)
        assert loaded.read_as.format == "tartanair"
        expected = axes.world_cv_from_ned(WALK.T_world_camera).matrix
        np.testing.assert_allclose(loaded.trajectory.T_world_camera.matrix, expected, atol=1e-12)
    assert read_trajectory(tmp_path / "poses.txt", "tartanair").read_as.format == "tartanair"


@pytest.mark.parametrize(
    ("text", "stamps_s"),
    [
        (table("", S, *AT), S),
        (table("", *AT), S),
        (table("# x y z", *AT), S),
        (table("stamp,x,y,z", NS, *AT, separator=","), S + EPOCH_S),
        (table("timestamp x y z roll pitch yaw", S, *AT, ZERO, ZERO, ZERO), S),
        (table("time easting northing altitude", S, *AT), S),
    ],
)
def test_positions_alone_are_read_where_they_suffice(tmp_path, text, stamps_s):
    (tmp_path / "leica.txt").write_text(text)
    with pytest.raises(
        InputError, match="leica.txt: expected poses with rotations, found positions alone"
    ):
        read_trajectory(tmp_path / "leica.txt")
    loaded = read_trajectory(tmp_path / "leica.txt", positions_suffice=True)
    assert not loaded.read_as.has_rotations
    np.testing.assert_allclose(loaded.trajectory.positions_m, WALK.positions_m)
    np.testing.assert_allclose(loaded.trajectory.stamps_s, stamps_s, rtol=0, atol=6e-7)


def test_map_coordinates_are_relative_to_the_first_position_which_is_noted(tmp_path):
    edge_of_mercator_m = 20037508.34
    for far in ([500000, 5429380.5, 110], [-edge_of_mercator_m, edge_of_mercator_m, 0]):
        far_m = np.array(far)
        (tmp_path / "a.txt").write_text(table("", S, *(WALK.positions_m + far_m).T, *LAST))
        loaded = read_trajectory(tmp_path / "a.txt")
        moved_m = WALK.positions_m - WALK.positions_m[0]
        np.testing.assert_allclose(loaded.trajectory.positions_m, moved_m, atol=1e-8)
        np.testing.assert_allclose(loaded.read_as.shift_m, far_m + WALK.positions_m[0])
        assert "relative to the first one" in loaded.read_as.sentence
    circumference_m = 40_030_000
    (tmp_path / "a.txt").write_text(table("", S, X + circumference_m, Y, Z, *LAST))
    with pytest.raises(InputError, match="at most 2.5e.07 m"):
        read_trajectory(tmp_path / "a.txt")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
def test_the_encodings_of_windows_are_read(tmp_path, encoding):
    text = table("timestamp tx ty tz qw qx qy qz", S, *AT, *FIRST)
    (tmp_path / "a.txt").write_bytes(text.replace("\n", "\r\n").encode(encoding))
    as_walk(read_trajectory(tmp_path / "a.txt"))


@pytest.mark.parametrize("header", ["", "timestamp tx ty tz qx qy qz qw\n"])
@pytest.mark.parametrize("separator", [" ", "\t", "; "])
def test_decimal_commas_are_read(tmp_path, header, separator):
    text = "1,0 0,5 -1,25 2,0e0 0,0 0,0 0,0 1,0\n2,0 0,25 1,5 2,0 0,0 0,0 0,0 1,0\n"
    text = text.replace(" ", separator)
    (tmp_path / "a.txt").write_text(header.replace(" ", separator) + text)
    loaded = read_trajectory(tmp_path / "a.txt").trajectory
    assert loaded.stamps_s.tolist() == [1, 2]
    assert loaded.positions_m.tolist() == [[0.5, -1.25, 2], [0.25, 1.5, 2]]


def test_nan_of_old_windows_programs_is_a_lost_pose(tmp_path):
    lines = table("", S, *AT, *LAST).splitlines()
    lines[4] = f"{S[4]} " + " ".join(["-1.#INF", "1.#QNAN", "-1.#IND"] + ["-1.#IND"] * 4)
    (tmp_path / "a.txt").write_text("\n".join(lines))
    loaded = read_trajectory(tmp_path / "a.txt")
    assert loaded.read_as.lost == 1 and len(loaded.trajectory) == COUNT - 1


# -- what a header says and the numbers do not


def test_columns_that_are_not_read_are_named(tmp_path):
    (tmp_path / "a.txt").write_text(SECONDS["RTAB-Map"])
    assert read_trajectory(tmp_path / "a.txt").read_as.sentence.endswith("; not read: id")


def test_a_unit_that_the_stamps_cannot_have_is_noted_and_not_believed(tmp_path):
    text = table("timestamp [ns],x,y,z,qx,qy,qz,qw", S + EPOCH_S, *AT, *LAST, separator=",")
    (tmp_path / "a.csv").write_text(text)
    loaded = read_trajectory(tmp_path / "a.csv")
    as_walk(loaded, S + EPOCH_S)
    assert "not in the unit that the header names" in loaded.read_as.sentence


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (table("timestamp x y z qx qy qz qw x", S, *AT, *LAST, X), "timestamp x y z"),
        (table("timestamp x y z qx qy qz qw", S, *AT, *LAST, ZERO, ZERO), "8 names over 10 columns"),
        (table("timestamp x y z qx qy qz qw more", S, *AT, *LAST), "9 names over 8 columns"),
        (table("timestamp x y z qx vx qy qz qw", S, *AT, *LAST, ZERO), "length"),
        (table("timestamp x y z qx qy qz qw id", S, *AT, *LAST, WORD).replace("map", "map 1", 1), ""),
    ],
)  # fmt: skip
def test_a_header_that_contradicts_the_numbers_is_refused(tmp_path, text, found):
    (tmp_path / "a.txt").write_text(text)
    if found:
        with pytest.raises(InputError, match=f"a.txt.*{found}"):
            read_trajectory(tmp_path / "a.txt")
    else:
        as_walk(read_trajectory(tmp_path / "a.txt"))  # a column that is not read may be anything


@pytest.mark.parametrize(
    "header",
    ["# x y z: x right, y down, z forward", "# z is up, x and y are level", "# 3 x 4 matrices", "# made by x.y.z"],
)  # fmt: skip
def test_prose_is_no_header(tmp_path, header):
    for text in (table(header, S, *AT, *LAST), f"{header}\n{rows_of(12)}"):
        (tmp_path / "a.txt").write_text(text)
        loaded = read_trajectory(tmp_path / "a.txt")
        assert loaded.read_as.format in ("tum", "kitti")
        as_walk(loaded)


@pytest.mark.parametrize(
    ("step", "unit"),
    [(1_000_000, 1e9), (999_999, 1e6), (1000, 1e6), (999, 1.0), (0.5, 1.0)],
)
def test_the_unit_of_stamps_from_zero_is_told_by_their_steps(tmp_path, step, unit):
    (tmp_path / "a.txt").write_text(table("", step * np.arange(COUNT), *AT, *LAST))
    stamps_s = read_trajectory(tmp_path / "a.txt").trajectory.stamps_s
    np.testing.assert_allclose(stamps_s, step * np.arange(COUNT) / unit)


@pytest.mark.parametrize("first_s", [6.4e8, 4.0e9])
@pytest.mark.parametrize("step_s", [0.1, 999.0])
@pytest.mark.parametrize("ticks", [1, 1e3, 1e6, 1e9])
def test_stamps_of_a_clock_are_told_by_their_size(tmp_path, first_s, step_s, ticks):
    stamps_s = first_s + step_s * np.arange(COUNT)
    (tmp_path / "a.txt").write_text(table("", np.rint(stamps_s * ticks * 10) / 10, *AT, *LAST))
    found = read_trajectory(tmp_path / "a.txt").trajectory.stamps_s
    np.testing.assert_allclose(found, stamps_s, rtol=0, atol=1e-5)


@pytest.mark.parametrize("first_s", [1000, 3000])
@pytest.mark.parametrize("rate_hz", [30, 1000])
def test_nanoseconds_since_a_computers_start_are_no_clocks_milliseconds(tmp_path, first_s, rate_hz):
    stamps_s = first_s + np.arange(COUNT) / rate_hz
    (tmp_path / "a.txt").write_text(table("", np.rint(stamps_s * 1e9).astype(int), *AT, *LAST))
    found = read_trajectory(tmp_path / "a.txt").trajectory.stamps_s
    np.testing.assert_allclose(found, stamps_s, rtol=0, atol=1e-6)


def test_frame_numbers_may_be_named(tmp_path):
    text = table("frame_id,tx,ty,tz,qw,qx,qy,qz,file", NUMBERS, *AT, *FIRST, WORD, separator=",")
    (tmp_path / "a.csv").write_text(text)
    as_walk(read_trajectory(tmp_path / "a.csv"), NUMBER_STAMPS)
    (tmp_path / "a.csv").write_text(text.replace("frame_id", "image_file"))
    as_walk(read_trajectory(tmp_path / "a.csv"))


def test_a_long_comment_takes_no_time_and_no_stack(tmp_path):
    for comment in (":" * 20_000, "x y " * 5_000, "p_a" * 7_000, "[" * 20_000, "t_" * 10_000):
        (tmp_path / "a.txt").write_text(table(f"# {comment}", S, *AT, *LAST))
        as_walk(read_trajectory(tmp_path / "a.txt"))


KITTI = trajectory_text(Trajectory.at_rate(SE3.exp(np.linspace(0, 0.3, 24).reshape(4, 6))), "kitti")


@pytest.mark.parametrize(
    ("rows", "times"),
    [("00/poses.txt", "00/times.txt"), ("poses/07.txt", "sequences/07/times.txt")],
)
def test_stamps_beside_the_rows_of_kitti_are_those_of_its_poses(tmp_path, rows, times):
    for name in (rows, times):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / rows).write_text(KITTI)
    counted = read_trajectory(tmp_path / rows)
    (tmp_path / times).write_text("0.000000e+00\n1.036224e-01\n2.072000e-01\n3.2e-01\n")
    loaded = read_trajectory(tmp_path / rows)
    assert loaded.trajectory.stamps_s.tolist() == [0, 0.1036224, 0.2072, 0.32]
    assert not loaded.is_counted and counted.is_counted
    assert "stamps of times.txt" in loaded.read_as.sentence
    matrices = [one.trajectory.T_world_camera.matrix for one in (counted, loaded)]
    assert np.array_equal(*matrices)


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ("0\n0.1\n0.2\n", "times.txt has 3 stamps for 4 poses and is not used"),
        ("0\n0.2\n0.1\n0.3\n", "times.txt has stamps that do not increase and is not used"),
        ("0 a\n0.1 b\n0.2 c\n0.3 d\n", "not used: .*times.txt:1: expected a stamp in seconds"),
    ],
)
def test_other_files_of_times_are_left_with_a_note(tmp_path, times, words):
    (tmp_path / "poses.txt").write_text(KITTI)
    (tmp_path / "times.txt").write_text(times)
    loaded = read_trajectory(tmp_path / "poses.txt")
    assert loaded.is_counted and re.search(words, loaded.read_as.sentence)
