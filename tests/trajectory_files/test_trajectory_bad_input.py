"""What is wrong with a trajectory file is said in one line: file, line, what was expected and
found, what to try.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.trajectory_files.trajectories import FORMATS, read_trajectory

TUM = "1.0 0 0 0 0 0 0 1\n2.0 0 0 0 0 0 0 1\n"
KITTI = "1 0 0 0 0 1 0 0 0 0 1 0\n"
SIM = "1 0 0 0\n0 1 0 0\n0 0 1 0\n"
CSV = "1,0,0,0,1,0,0,0\n"
IMAGE = "1 1 0 0 0 0.5 0 0 1 rgb/7.png\n"
COMMAND = (
    "povray +Oa_0001.png "
    + " ".join(f"Declare=val{r}{c}={int(r == c)}" for r in range(4) for c in range(3))
    + "\n"
)
CAMERA = "cam_pos = [0, 0, 0]';\ncam_dir = [0, 0, 1]';\ncam_up = [0, 1, 0]';\n"

#: name, content, line where the message points (None: the file), pieces of the message
CASES = {
    "empty": ("a.txt", "", None, ["found an empty file"]),
    "blank": ("a.txt", " \n\n", None, ["found an empty file"]),
    "comments alone": ("a.txt", "# nothing\n", None, ["found comments alone"]),
    "a pointer": (
        "p.txt",
        "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n",
        1,
        ["a pointer of Git LFS", "git lfs pull"],
    ),
    "a web page": (
        "a.txt",
        "<!DOCTYPE html><html><body>404</body></html>",
        1,
        ["found a web page", "downloading"],
    ),
    "a web page as ground truth": (
        "a.gt.freiburg",
        "\n<html><body>moved</body></html>",
        1,
        ["found a web page"],
    ),
    "binary": ("a.txt", "\x7fELF\0\0\0", None, ["found a binary file"]),
    "words": ("a.txt", "hello world\n", 1, ["found 'hello world'", "try from"]),
    "7 columns": ("a.txt", "1 2 3 4 5 6 7\n", 1, ["8 columns (TUM)", "found 7 columns"]),
    "7 columns later": (
        "a.txt",
        TUM + "# x\n3.0 0 0 0 0 0 1\n",
        4,
        ["8 columns: timestamp tx", "found 7 columns"],
    ),
    "a word among numbers": (
        "a.txt",
        TUM + "3.0 0 zero 0 0 0 0 1\n",
        3,
        ["8 columns: timestamp tx", "found 'zero'"],
    ),
    "NaN as a stamp": ("a.txt", TUM + "nan 0 0 0 0 0 0 1\n", 3, ["a stamp in seconds", "nan"]),
    "no finite pose": (
        "a.txt",
        "1 0 nan 0 0 0 0 1\n2 0 0 0 0 0 0 inf\n",
        1,
        ["finite poses", "none in 2 rows"],
    ),
    "a zero quaternion": (
        "a.txt",
        TUM + "3.0 0 0 0 0 0 0 0\n4 0 0 0 0 0 0 1\n",
        3,
        ["quaternions of length 1", "length 0"],
    ),
    "a long quaternion": (
        "a.txt",
        TUM + "3.0 0 0 0 0 0 0 1.5\n",
        3,
        ["quaternions of length 1", "length 1.5"],
    ),
    "stamps backwards": (
        "a.txt",
        TUM + "1.5 0 0 0 0 0 0 1\n",
        3,
        ["above the 2 of line 2", "found 1.5", "of a single run"],
    ),
    "most stamps repeated": (
        "a.txt",
        "# x\n" + TUM + "2.0 0 0 0 0 0 0 1\n" * 4,
        2,
        ["all their digits", "4 of 6 that repeat", "six digits"],
    ),
    "a stamp of no time": (
        "a.txt",
        TUM + "1403636579763555584 0 0 0 0 0 0 1\n" + TUM,
        3,
        ["a stamp in seconds"],
    ),
    "a 4x4 row of something else": (
        "a.txt",
        KITTI.strip() + " 0 0 1 1\n",
        1,
        ["4x4 matrix", "0 0 1 1"],
    ),
    "no x y z": ("a.csv", "t,lat,lon\n1,48.1,11.5\n", 1, ["columns, found 't,lat,lon'"]),
    "dates": (
        "a.csv",
        "t,x,y,z\n2023-05-01T12:00:00,1,2,3\n",
        2,
        ["a number in each column that the header names", "found '2023-05-01T12:00:00'"],
    ),
    "15 columns": ("a.txt", "1 " * 15, 1, ["12, 13, 16 or 17", "found 15 columns"]),
    "an image without number": (
        "images.txt",
        IMAGE + IMAGE.replace("7.png", "x.png"),
        2,
        ["frame's number", "x.png"],
    ),
    "an image twice": (
        "images.txt",
        IMAGE + "\n" + IMAGE,
        3,
        ["frame number above the 7 of line 1", "7 again"],
    ),
    "a word in COLMAP's": (
        "images.txt",
        IMAGE + "\n" + IMAGE.replace("0.5", "half"),
        3,
        ["COLMAP", "half"],
    ),
    "absurd position": (
        "a.txt",
        TUM + "3.0 1e30 0 0 0 0 0 1\n",
        3,
        ["at most 2.5e+07 m", "1e+30 m", "unit"],
    ),
    "ids that are none": (
        "a.gt.freiburg",
        "1 0 0 0 0 0 0 1\n1.5 0 0 0 0 0 0 1\n",
        2,
        ["frame number", "1.5", "try from tum"],
    ),
    "negative ids": ("a.gt.freiburg", "-1 0 0 0 0 0 0 1\n", 1, ["frame number", "-1"]),
    "repeated ids": (
        "a.gt.freiburg",
        "1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n",
        2,
        ["above the 1 of line 1"],
    ),
    "associations": (
        "a.txt",
        "1 depth/1.png 1 rgb/1.png\n",
        1,
        ["8 columns (TUM)", "found '1 depth/1.png 1 rgb/1.png'"],
    ),
    "11 columns": ("a.txt", "1 0 0 0 0 1 0 0 0 0 1\n", 1, ["found 11 columns"]),
    "no rotation": ("a.txt", KITTI + "2 0 0 0 0 1 0 0 0 0 1 0\n", 2, ["rotation matrices"]),
    "a reflection": (
        "a.txt",
        KITTI + "-1 0 0 0 0 1 0 0 0 0 1 0\n",
        2,
        ["determinant +1", "a reflection"],
    ),
    "matrix of words": ("a.txt", KITTI + "a 0 0 0 0 1 0 0 0 0 1 0\n", 2, ["3x4 matrix", "'a'"]),
    "pov frames backwards": (
        "pov.txt",
        "2 " + KITTI + "1 " + KITTI,
        2,
        ["above the 2 of line 1", "found 1"],
    ),
    "a short block": (
        "a.gt.sim",
        SIM + "\n1 0 0 0\n0 1 0 0\n\n" + SIM,
        5,
        ["blocks of 3 lines", "another length"],
    ),
    "a last block cut": ("a.gt.sim", SIM + "\n1 0 0 0\n0 1 0 0\n", 5, ["blocks of 3 lines"]),
    "two lines apart": ("a.gt.sim", SIM + "\n1 0 0 0\n\n0 1 0 0\n", 5, ["blocks of 3 lines"]),
    "a block without rotation": (
        "a.gt.sim",
        SIM + "\n" + SIM.replace("1", "3"),
        5,
        ["rotation matrices"],
    ),
    "a missing value": (
        "c.txt",
        COMMAND + COMMAND.replace("Declare=val21=0", ""),
        2,
        ["val00= to Declare=val32=", "no val21"],
    ),
    "a value of words": ("c.txt", COMMAND.replace("val21=0", "val21=x0"), 1, ["found val21=x0"]),
    "a value twice": ("c.txt", COMMAND.strip() + " Declare=val00=1\n", 1, ["each once"]),
    "the same image twice": ("c.txt", COMMAND * 2, 2, ["frame number above the 1"]),
    "9 columns of CSV": (
        "a.csv",
        "1,0,0,0,1,0,0,0,0\n",
        1,
        ["8, 11 or 17 columns", "found 9 columns"],
    ),
    "an empty field": ("a.csv", CSV + "2,0,,0,1,0,0,0\n", 2, ["separated by commas", "''"]),
    "a zero quaternion in CSV": (
        "a.csv",
        CSV + "33333334,0,0,0,0,0,0,0\n",
        2,
        ["quaternions of length 1"],
    ),
    "a camera without position": (
        "s_1.txt",
        CAMERA.replace("cam_pos", "cam_x"),
        None,
        ["cam_pos = [x, y, z]", "no cam_pos"],
    ),
    "a camera of words": ("s_1.txt", CAMERA.replace("1, 0]", "one, 0]"), 3, ["cam_up = [x, y, z]"]),
    "Euler angles": (
        "e.txt",
        "1.0 0 0 0.3 0.1 0.2 0.3\n" * 3,
        1,
        ["7 columns", "roll, pitch, yaw"],
    ),
    "Euler angles alone": ("e.txt", "0 0 0.3 3 2 90\n" * 3, 1, ["6 columns", "roll, pitch, yaw"]),
    "named Euler angles": (
        "e.csv",
        "time,x,y,z,roll,pitch,yaw\n1,0,0,0,1,2,3\n2,0,0,1,1,2,3\n",
        None,
        ["positions alone", "quaternions instead of angles"],
    ),
    "a flat camera": ("s_1.txt", CAMERA.replace("[0, 1, 0]", "[0, 0, 2]"), None, ["span a plane"]),
}


@pytest.mark.parametrize("case", CASES)
def test_the_message_names_file_line_and_what_stands_there(tmp_path, case):
    name, content, line, pieces = CASES[case]
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(InputError) as error:
        read_trajectory(path)
    message = str(error.value)
    assert message.startswith(f"{path}:{line}: expected " if line else f"{path}: expected ")
    assert "\n" not in message
    for piece in pieces:
        assert piece in message


@pytest.mark.parametrize(
    ("content", "place", "found"),
    [(CSV, ":1", "1,0,0,0,1,0,0,0"), ("# nothing\n", "", "comments alone")],
)
def test_vslam_lab_needs_the_names_of_its_columns(tmp_path, content, place, found):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(InputError, match=rf"a\.csv{place}: expected .*found {found}"):
        read_trajectory(tmp_path / "a.csv", "vslam-lab")


def test_bytes_that_are_no_text_are_named_with_their_line(tmp_path):
    (tmp_path / "a.txt").write_bytes(TUM.encode() + b"\xff\xfe\n")
    with pytest.raises(InputError, match="a.txt:3: .*not UTF-8"):
        read_trajectory(tmp_path / "a.txt")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="no.txt: expected a trajectory file, found no such file"):
        read_trajectory(tmp_path / "no.txt")


def test_a_folder_without_camera_files_is_named(tmp_path):
    (tmp_path / "groundtruth.txt").write_text(TUM)
    with pytest.raises(InputError, match="a folder of POV-Ray camera files .*, found no such file"):
        read_trajectory(tmp_path)


def test_the_broken_file_of_a_folder_is_named(tmp_path):
    (tmp_path / "scene_00_0000.txt").write_text(CAMERA)
    (tmp_path / "scene_00_0001.txt").write_text("")
    with pytest.raises(
        InputError, match="scene_00_0001.txt: expected a POV-Ray camera file, found an empty file"
    ):
        read_trajectory(tmp_path)


def test_a_frame_twice_in_a_folder_is_named(tmp_path):
    (tmp_path / "scene_00_0001.txt").write_text(CAMERA)
    (tmp_path / "scene_01_0001.txt").write_text(CAMERA)
    with pytest.raises(
        InputError, match="scene_01_0001.txt: .*frame 1 again, as in scene_00_0001.txt"
    ):
        read_trajectory(tmp_path)


@pytest.mark.parametrize(
    "format",
    [name for name in FORMATS if name not in ("pov-cameras", "scannet", "rosbag", "polycam")],
)
def test_a_folder_is_no_file(tmp_path, format):
    with pytest.raises(InputError, match="found a folder"):
        read_trajectory(tmp_path, format)


def test_an_unknown_format_is_refused_with_the_known_ones(tmp_path):
    (tmp_path / "a.txt").write_text(TUM)
    with pytest.raises(InputError, match="gt.freiburg, gt.sim, .*, found freiburg"):
        read_trajectory(tmp_path / "a.txt", "freiburg")


@pytest.mark.parametrize(
    "options", [{"rate_hz": 0}, {"rate_hz": np.nan}, {"unit_m": -1}, {"unit_m": np.inf}]
)
def test_options_that_cannot_be_are_refused(tmp_path, options):
    (tmp_path / "a.txt").write_text(TUM)
    with pytest.raises(InputError, match="1e-6 to 1e6"):
        read_trajectory(tmp_path / "a.txt", **options)


def test_the_line_is_found_deep_in_a_long_file(tmp_path):
    lines = [f"{i} 0 0 0 0 0 0 1\n" for i in range(20_000)]
    lines[17_321] = "17321 0 0 0 0 0 0 0.5\n"
    (tmp_path / "a.txt").write_text("# header\n" + "".join(lines))
    with pytest.raises(
        InputError, match="a.txt:17323: expected quaternions of length 1 .* found length 0.5"
    ):
        read_trajectory(tmp_path / "a.txt")
