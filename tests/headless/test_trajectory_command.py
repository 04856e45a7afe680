"""`iclnuim trajectory` as a user types it: figures, files, statements of frames, refusals."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, adopt, resample
from iclnuim.headless.cli import main
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

WALK = Trajectory.at_rate(
    SE3.exp(np.cumsum(np.random.default_rng(0).normal(size=(61, 6)) * 0.01, axis=0))
)


@pytest.fixture
def run(capsys):
    """run("info", ...) -> exit code, standard output, standard error."""

    def call(*argv) -> tuple[int, str, str]:
        try:
            code = main(["trajectory", *map(str, argv)])
        except SystemExit as stopped:  # argparse
            code = stopped.code
        return code, *capsys.readouterr()

    return call


@pytest.fixture
def walk(tmp_path):
    write_trajectory(tmp_path / "walk.txt", WALK, "tum")
    return tmp_path / "walk.txt"


def assert_refused(outcome, *pieces: str) -> None:
    """Exit code 2, nothing on standard output, one line that holds the pieces."""
    code, out, err = outcome
    assert code == 2 and out == ""
    assert (
        err.count("\n") == 1 and err.startswith("iclnuim trajectory: ") and "Traceback" not in err
    )
    for piece in pieces:
        assert piece in err


# -- info


def test_info_prints_the_figures_and_how_the_file_was_taken(run, walk):
    code, out, _ = run("info", walk)
    assert code == 0
    for piece in (
        "TUM: stamps in seconds, right-handed",
        "61 at 30 Hz",
        f"{WALK.length_m():.3f} m",
        "2.000 s",
        "none",
    ):
        assert piece in out


def test_info_warns_of_rotations_that_are_none(run, tmp_path, walk):
    rows = np.loadtxt(walk)
    rows[:, 4:] = 0, 0, 0, 1
    np.savetxt(tmp_path / "tracker.txt", rows)
    code, _, err = run("info", tmp_path / "tracker.txt")
    assert code == 0 and "warning" in err and "all rotations are the same" in err
    assert "warning" not in run("info", walk)[2]


def test_info_gives_json_of_all_files(run, walk):
    code, out, _ = run("info", walk, walk, "--json")
    first, second = json.loads(out)["trajectories"]
    assert code == 0 and first == second
    assert first["frames"] == 61 and first["length_m"] == pytest.approx(WALK.length_m(), abs=1e-6)
    assert first["read_as"]["format"] == "tum" and first["read_as"]["handedness"] == "right"
    assert {
        "mean_speed",
        "max_speed",
        "mean_rotation_rate",
        "max_rotation_rate",
        "gaps",
        "longest_gap_s",
    } <= set(first)


def test_info_tells_of_gaps(run, tmp_path):
    write_trajectory(tmp_path / "a.txt", WALK[np.delete(np.arange(61), [7, 8])], "tum")
    assert "1, the longest step is 0.100 s" in run("info", tmp_path / "a.txt")[1]


def test_info_knows_the_official_lengths(run, samples):
    files = [samples / "trajectories" / f"lr_kt{i}_Tpov_cam_3x4.txt" for i in (0, 2)] + [
        samples / "or_kt0/traj0.gt.freiburg"
    ]
    found = json.loads(run("info", *files, "--json")[1])["trajectories"]
    assert [round(one["length_m"], 3) for one in found] == [6.545, 8.430, 6.525]
    assert [one["read_as"]["handedness"] for one in found] == ["left"] * 3


def test_the_form_can_be_told(run, tmp_path):
    (tmp_path / "a.txt").write_text("1 0 1 0 0 0 0 1\n2 0 1 0 0 0 0 1\n")
    assert (
        "gt.freiburg (as requested): LEFT-handed"
        in run("info", tmp_path / "a.txt", "--from", "gt.freiburg")[1]
    )
    assert "30 Hz" in run("info", tmp_path / "a.txt", "--from", "tum-ids")[1]
    assert "60 Hz" in run("info", tmp_path / "a.txt", "--from", "tum-ids", "--file-rate", "60")[1]


# -- convert


@pytest.mark.parametrize("name", ["a.csv", "a.kitti", "a_pov.txt", "render_commands.txt", "a.tum"])
def test_converting_there_and_back_keeps_the_trajectory(run, walk, tmp_path, name):
    assert run("convert", walk, tmp_path / name)[0] == 0
    assert run("convert", tmp_path / name, tmp_path / "back.txt")[0] == 0
    back = read_trajectory(tmp_path / "back.txt").trajectory
    np.testing.assert_allclose(back.T_world_camera.matrix, WALK.T_world_camera.matrix, atol=3e-9)
    np.testing.assert_allclose(back.stamps_s, WALK.stamps_s, atol=2e-9)


def test_converting_says_which_frame_it_comes_from_and_goes_to(run, walk, tmp_path):
    _, out, err = run("convert", walk, tmp_path / "a.gt.freiburg", "--start-z", "-2.5")
    assert out == ""
    assert f"{walk}: TUM: stamps in seconds, right-handed" in err
    assert f"{tmp_path / 'a.gt.freiburg'}: gt.freiburg: frame ids, LEFT-handed" in err
    assert np.loadtxt(tmp_path / "a.gt.freiburg")[0, 3] == -2.5
    assert run("convert", walk, tmp_path / "b.txt", "--quiet")[1:] == ("", "")


def test_centimetres_come_in_and_go_out(run, tmp_path):
    (tmp_path / "office_pov.txt").write_text("1 0 0 91 0 1 0 465 0 0 1 -292\n")
    assert run("convert", tmp_path / "office_pov.txt", tmp_path / "a.txt", "--unit", "cm")[0] == 0
    np.testing.assert_allclose(
        read_trajectory(tmp_path / "a.txt").trajectory.positions_m, [[-0.91, 2.92, 4.65]]
    )
    assert run("convert", tmp_path / "a.txt", tmp_path / "b_pov.txt", "--out-unit", "cm")[0] == 0
    np.testing.assert_allclose(np.loadtxt(tmp_path / "b_pov.txt")[[4, 8, 12]], [91, 465, -292])


def test_an_existing_file_is_kept_unless_forced(run, walk, tmp_path):
    out = tmp_path / "out.txt"
    out.write_text("precious")
    for arguments in (["convert", walk, out], ["resample", walk, "--rate", 60, "-o", out]):
        assert_refused(run(*arguments), f"{out}: expected a new file name", "--force")
        assert out.read_text() == "precious"
    assert run("convert", walk, out, "--force")[0] == 0
    assert len(read_trajectory(out).trajectory) == 61


def test_stamps_of_a_recording_can_be_made_anew(run, tmp_path):
    write_trajectory(
        tmp_path / "a.txt",
        Trajectory(WALK.stamps_s * 1.01 + 1305031102.17, WALK.T_world_camera),
        "tum",
    )
    assert_refused(
        run("convert", tmp_path / "a.txt", tmp_path / "a.gt.freiburg", "--quiet"),
        "stamps of whole frame numbers",
        "--restamp",
    )
    assert run("convert", tmp_path / "a.txt", tmp_path / "a.gt.freiburg", "--restamp")[0] == 0
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "a.gt.freiburg")[:, 0], range(1, 61))


def test_the_output_format_can_be_told(run, walk, tmp_path):
    assert_refused(
        run("convert", walk, tmp_path / "a.dat"), "a.dat: expected a name ending in", "--to FORMAT"
    )
    assert run("convert", walk, tmp_path / "a.dat", "--to", "euroc")[0] == 0
    assert (tmp_path / "a.dat").read_text().startswith("#timestamp [ns]")


@pytest.mark.parametrize(
    ("name", "header"),
    [
        ("o.tum", "seconds, millimetres, right-handed"),
        ("o.csv", "p_RS_R_x [mm],p_RS_R_y [mm],p_RS_R_z [mm]"),
        ("vslam.txt", "ts (ns),tx (mm),ty (mm),tz (mm)"),
    ],
)
def test_the_header_names_the_unit_of_the_positions(run, walk, tmp_path, name, header):
    assert run("convert", walk, tmp_path / name, "--out-unit", "mm")[0] == 0
    assert header in (tmp_path / name).read_text().splitlines()[0]


def test_a_device_is_written_and_a_folder_that_cannot_be_is_bad_input(walk, tmp_path):
    command = [sys.executable, "-m", "iclnuim", "trajectory", "convert", walk]
    done = subprocess.run(
        [*command, "/dev/stdout", "--to", "kitti"], capture_output=True, text=True, check=True
    )
    assert len(done.stdout.splitlines()) == len(WALK)
    for out, words in ((tmp_path / "no" / "o.txt", "no such folder"), (tmp_path, "found a folder")):
        done = subprocess.run(
            [*command, out, "--to", "tum", "--force"], capture_output=True, text=True
        )
        assert done.returncode == 2 and words in done.stderr


def test_help_lists_the_words_in_a_name_that_select_a_format(run):
    _, out, _ = run("convert", "--help")
    assert "the words command, vslam, pov, kitti, replica, pose_left" in " ".join(out.split())


# -- adopt, resample


def test_adopting_applies_equation_two(run, walk, tmp_path):
    start = "-1.4,-1.4,1.5,0.5,0.5,0.5,0.5"  # the leading minus is no option
    assert run("adopt", walk, "--start", start, "--scale", "0.8", "-o", tmp_path / "a.txt")[0] == 0
    T_world_start = SE3.from_quat_xyzw(np.full(4, 0.5), np.array([-1.4, -1.4, 1.5]))
    expected = adopt(WALK, T_world_start, 0.8).T_world_camera.matrix
    np.testing.assert_allclose(
        read_trajectory(tmp_path / "a.txt").trajectory.T_world_camera.matrix, expected, atol=3e-9
    )


def test_adopting_takes_the_first_pose_of_a_file_as_start(run, walk, tmp_path):
    moved = adopt(WALK, SE3.exp(np.array([1.0, 2, 3, 0.1, 0.2, 0.3])))
    write_trajectory(tmp_path / "start.txt", moved, "tum")
    code, _, said = run("adopt", walk, "--start", tmp_path / "start.txt", "-o", tmp_path / "a.txt")
    assert code == 0 and "adopted: the first pose is the start pose" in said
    adopted = read_trajectory(tmp_path / "a.txt").trajectory
    np.testing.assert_allclose(
        adopted.T_world_camera.matrix, moved.T_world_camera.matrix, atol=5e-9
    )


def test_without_an_output_tum_comes_out_on_standard_output(run, walk, tmp_path):
    code, out, said = run("resample", walk, "--rate", 60)
    (tmp_path / "a.txt").write_text(out)
    assert code == 0 and "resampled: 61 poses to 121 at 60 Hz" in said
    resampled, expected = read_trajectory(tmp_path / "a.txt").trajectory, resample(WALK, 60)
    np.testing.assert_allclose(
        resampled.T_world_camera.matrix, expected.T_world_camera.matrix, atol=1e-8
    )
    np.testing.assert_allclose(resampled.stamps_s, expected.stamps_s, atol=1e-8)


def test_a_resampled_trajectory_gets_frame_numbers_of_its_own_rate(run, walk, tmp_path):
    assert run("resample", walk, "--rate", 60, "-o", tmp_path / "a.gt.freiburg")[0] == 0
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "a.gt.freiburg")[:, 0], range(1, 121))


@pytest.mark.parametrize(
    ("name", "rate", "noted"),
    [
        ("a.gt.freiburg", 60, True),
        ("a.kitti", 60, True),
        ("a.tum", 60, False),
        ("a_vslam.csv", 60, False),
        ("b.kitti", 30, False),
    ],
)
def test_a_file_without_stamps_at_another_rate_is_noted_with_the_option_that_reads_it(
    run, walk, tmp_path, name, rate, noted
):
    _, _, err = run("resample", walk, "--rate", rate, "-o", tmp_path / name)
    assert ("give --file-rate 60 where it is read" in err) == noted
    if noted:
        _, out, _ = run("info", tmp_path / name, "--file-rate", "60")
        assert " at 60 Hz" in out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("convert {} {} --to kitti", "a line's number is no longer that of its frame"),
        ("resample {} --rate 60 -o {}", "poses in it are interpolated"),
    ],
)
def test_gaps_are_named_where_a_file_without_stamps_or_interpolation_hides_them(
    run, walk, tmp_path, words, told
):
    write_trajectory(tmp_path / "holey.txt", WALK[np.r_[0:20, 50:61]], "tum")
    _, _, err = run(*words.format(tmp_path / "holey.txt", tmp_path / "a.txt").split())
    assert "note: the trajectory has 1 gap, the longest of 1.033 s" in err and told in err
    assert "note: " not in run(*words.format(walk, tmp_path / "b.txt").split())[2]


# -- plot


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_a_plot_is_a_picture(run, walk, tmp_path, ending):
    from matplotlib import rcParams

    before = dict(rcParams)
    assert run("plot", walk, walk, "-o", tmp_path / f"a.{ending}")[0] == 0
    start = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[ending]
    assert (tmp_path / f"a.{ending}").read_bytes().startswith(start)
    assert dict(rcParams) == before


def test_the_top_view_is_x_and_y_with_z_up(tmp_path):
    from iclnuim.report.charts import positions_z_up_m, trajectories_figure

    # an anchored file whose camera moves right, then up, then forward
    (tmp_path / "a.gt.freiburg").write_text(
        "1 0 0 -2.25 0 0 0 1\n2 1 0 -2.25 0 0 0 1\n3 1 1 -2.25 0 0 0 1\n4 1 1 0 0 0 0 1\n"
    )
    loaded = read_trajectory(tmp_path / "a.gt.freiburg")
    np.testing.assert_array_equal(
        positions_z_up_m(loaded), [[0, -2.25, 0], [1, -2.25, 0], [1, -2.25, 1], [1, 0, 1]]
    )
    above = trajectories_figure([("a", loaded)]).axes[0]
    np.testing.assert_array_equal(
        above.lines[0].get_xydata(), [[0, -2.25], [1, -2.25], [1, -2.25], [1, 0]]
    )


def test_one_pose_can_be_plotted(run, tmp_path):
    write_trajectory(tmp_path / "a.txt", WALK[:1], "tum")
    assert run("plot", tmp_path / "a.txt", "-o", tmp_path / "a.png")[0] == 0


# -- refusals


@pytest.mark.parametrize(
    ("content", "pieces"),
    [
        ("", ["bad.txt: ", "an empty file"]),
        ("<!DOCTYPE html>\n<html></html>\n", ["bad.txt:1: ", "a web page", "try downloading"]),
        ("1 2 3 4 5 6 7\n", ["bad.txt:1: ", "7 columns", "try --from"]),
        ("1 0 0 0 0 0 0 0\n", ["bad.txt:1: ", "length 0"]),
        (
            "2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n",
            ["bad.txt:2: ", "above the 2 of line 1", "try a file of a single run"],
        ),
        ("\0\1\2", ["bad.txt: ", "a binary file"]),
    ],
)
def test_bad_input_gets_one_line_and_exit_code_two(run, walk, tmp_path, content, pieces):
    bad = tmp_path / "bad.txt"
    bad.write_text(content)
    out = tmp_path / "out.png"
    actions = [
        ["info", bad],
        ["convert", bad, out, "--to", "tum"],
        ["plot", walk, bad, "-o", out],
        ["resample", bad, "--rate", 60, "-o", out, "--to", "tum"],
        ["adopt", walk, "--start", bad, "-o", out, "--to", "tum"],
    ]
    for arguments in actions:
        assert_refused(run(*arguments, *(["--quiet"] if arguments[0] != "info" else [])), *pieces)
        assert not out.exists()


def test_options_that_cannot_be_get_one_line(run, walk, tmp_path):
    assert_refused(
        run("adopt", walk, "--start", "1,2,3", "--quiet"),
        "--start x,y,z,qx,qy,qz,qw",
        "found 1,2,3",
    )
    assert_refused(
        run("adopt", walk, "--start", "0,0,0,0,0,0,0", "--quiet"),
        "quaternions of length 1 (to 0.01) in --start",
    )
    assert_refused(
        run("adopt", walk, "--start", "0,0,0,0,0,0,1", "--scale", "-1", "--quiet"), "a scale > 0"
    )
    assert_refused(run("resample", walk, "--rate", "1000", "--quiet"), "15 to 240 Hz", "found 1000")
    assert_refused(run("info", walk, "--from", "freiburg"), "gt.freiburg", "found freiburg")
    assert_refused(
        run("convert", walk, tmp_path / "a.txt", "--to", "pov-cameras", "--quiet"),
        "that can be written",
    )
    assert_refused(
        run("plot", walk, "-o", tmp_path / "a.gif", "--quiet"), ".png, .pdf, .svg", "found .gif"
    )
    assert_refused(run("info", tmp_path), "a folder of POV-Ray camera files", "no such file")
    code, _, err = run("info", walk, "--unit", "parsec")
    assert (
        code == 2
        and "expected a unit: m, dm, cm, mm, in, ft, or metres as a number, found parsec" in err
    )


def test_a_full_disk_is_exit_code_three_and_leaves_nothing(walk, tmp_path):
    program = (
        "import resource, signal, sys; from iclnuim.headless.cli import main;"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500)); sys.exit(main(sys.argv[1:]))"
    )
    for arguments in (
        ["convert", walk, tmp_path / "out.csv"],
        ["plot", walk, "-o", tmp_path / "out.png"],
    ):
        command = [sys.executable, "-c", program, "trajectory", *arguments, "--quiet"]
        # modules compiled under the limit would stay in the environment, cut off
        limited = environment() | {"PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(command, capture_output=True, text=True, env=limited, check=False)
        assert (
            done.returncode == 3
            and "cannot write: File too large" in done.stderr
            and done.stderr.count("\n") == 1
        )
    assert [p.name for p in tmp_path.iterdir()] == ["walk.txt"]


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}


@pytest.mark.parametrize(
    "arguments", [["info", "{}"], ["convert", "{}", "{}.csv"], ["resample", "{}", "--rate", "60"]]
)
def test_commands_start_without_heavy_packages(walk, arguments):
    program = (
        "import sys; from iclnuim.headless.cli import main; main(sys.argv[1:]);"
        "heavy = ('scipy', 'matplotlib', 'bpy', 'cv2', 'OpenEXR', 'open3d');"
        "print('heavy:', *[name for name in heavy if name in sys.modules], file=sys.stderr)"
    )
    command = [
        sys.executable,
        "-c",
        program,
        "trajectory",
        *(a.format(walk) for a in arguments),
        "--quiet",
    ]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=True)
    assert done.stderr.strip() == "heavy:"


@pytest.mark.parametrize("action", ["info", "convert", "plot", "make", "adopt", "resample"])
def test_every_action_helps_with_an_example(run, action):
    code, out, _ = run(action, "--help")
    assert code == 0 and "example:\n  iclnuim trajectory " in out


def test_make_through_a_scene_overwrites_no_file_of_other_content(repository, tmp_path, capsys):
    pytest.importorskip("bpy", reason="needs the bpy package")
    words = [
        "trajectory",
        "make",
        "--scene",
        str(repository / "tests/room.obj"),
        "--out",
        str(tmp_path),
    ]
    words += ["--viewpoints", "auto:2"]
    assert main(words) == 0
    made = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    assert sorted(made) == ["room.json", "room.txt"] and main(words) == 0  # the same again
    (tmp_path / "room.txt").unlink()
    (tmp_path / "room.json").write_text("mine\n")
    assert main(words) == 2
    assert "room.json: expected a new file name" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["room.json"]


def test_a_viewpoint_far_outside_the_scene_is_refused(repository, tmp_path, run):
    pytest.importorskip("bpy", reason="needs the bpy package")
    (tmp_path / "places.txt").write_text("1e9 0 0  # far\x85away\n1 1 1\n")
    words = [
        "make",
        "--scene",
        repository / "tests/room.obj",
        "--out",
        tmp_path / "path",
        "--viewpoints",
    ]
    code, _, error = run(*words, tmp_path / "places.txt")
    assert code == 2 and "at most 20 m outside it, found 1e+09,0,0, 1e+09 m outside it" in error


def test_all_trajectories_are_made_by_the_word_all_and_nothing_else_is_replaced(
    run, repository, tmp_path, monkeypatch
):
    monkeypatch.setattr("iclnuim.headless.commands.trajectory_make.NAMES", ["living_room/kt2"])
    for _ in range(2):
        assert run("make", "all", "--out", tmp_path)[0] == 0
    made = (tmp_path / "living_room/kt2.txt").read_bytes()
    (tmp_path / "mine.json").write_bytes(
        (repository / "trajectories/living_room/kt2.json").read_bytes()
    )
    (tmp_path / "mine.txt").write_text("notes")
    code, _, err = run("make", tmp_path / "mine.json")
    assert (
        code == 2
        and "mine.txt: expected no file, or a trajectory that was made before, found another file"
        in err
    )
    assert (tmp_path / "mine.txt").read_text() == "notes"
    (tmp_path / "mine.txt").unlink()
    assert (
        run("make", tmp_path / "mine.json")[0] == 0 and (tmp_path / "mine.txt").read_bytes() == made
    )
