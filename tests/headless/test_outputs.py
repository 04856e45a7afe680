"""What a command writes replaces nothing that it reads, and reaches pipes, links and closed
terminals as it should.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np
import pytest
from iclnuim import noisy_depth, noisy_rgb
from iclnuim.errors import InputError
from iclnuim.formats.depth_units import depth16_from_metres
from iclnuim.formats.files import atomic_write_text, check_file
from iclnuim.formats.png import write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless.cli import main
from iclnuim.sequences.stored_sequence import read_depth_m
from iclnuim.trajectory_files.trajectories import write_trajectory
from patience import patience

WALK = Trajectory.at_rate(SE3.exp(np.random.default_rng(0).normal(size=(20, 6)) * 0.1))
SIZE = (64, 48)


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("gt.txt", "est.txt"):
        write_trajectory(tmp_path / name, WALK, "tum")
    return tmp_path


@pytest.fixture
def sequence(tmp_path, monkeypatch):
    """Three equal frames of a tilted, textured plane."""
    monkeypatch.chdir(tmp_path)
    u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    grey = (120 + 60 * np.sin(0.7 * u) * np.cos(0.9 * v)).astype(np.uint8)
    for i in range(3):
        for kind, image in (
            ("rgb", np.dstack([grey] * 3)),
            ("depth", depth16_from_metres(2 + 0.01 * u + 0.005 * v)),
        ):
            (tmp_path / "seq" / kind).mkdir(parents=True, exist_ok=True)
            write_png(tmp_path / "seq" / kind / f"{i}.png", image)
    camera = PinholeCamera.parse(f"{SIZE[0]}x{SIZE[1]}").to_dict()
    (tmp_path / "seq/camera.json").write_text(str(camera).replace("'", '"'))
    still = Trajectory.at_rate(SE3.exp(np.zeros((3, 6))))
    write_trajectory(tmp_path / "seq/groundtruth.txt", still, "tum")
    return tmp_path / "seq"


@pytest.mark.parametrize("option", ["--csv", "--plot"])
@pytest.mark.parametrize("output", ["est.txt", "./gt.txt", "link.txt"])
def test_an_input_is_not_overwritten(files, option, output, capsys):
    (files / "link.txt").symlink_to("gt.txt")
    before = [(files / name).read_bytes() for name in ("gt.txt", "est.txt")]
    assert main(["evaluate", "ate", "gt.txt", "est.txt", option, output]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "none of the inputs" in error and f"another name for {option}" in error
    assert [(files / name).read_bytes() for name in ("gt.txt", "est.txt")] == before


@pytest.mark.parametrize("name", ["groundtruth.txt", "camera.json", "rgb/0.png"])
def test_a_file_of_the_sequence_is_not_overwritten_and_an_estimate_in_its_folder_is(
    sequence, name, capsys
):
    before = (sequence / name).read_bytes()
    assert main(["odometry", "icp", "seq", "-o", f"seq/{name}"]) == 2
    assert "a file of the sequence seq" in capsys.readouterr().err
    assert (sequence / name).read_bytes() == before
    for _ in range(2):
        assert main(["odometry", "icp", "seq", "-o", "seq/est.txt", "--first", "1"]) == 0


@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "ate", "seq/groundtruth.txt", "est.txt", "--csv", "seq/camera.json"],
        ["evaluate", "ate", "seq", "est.txt", "--plot", "seq/rgb/0.png"],
        ["evaluate", "rpe", "est.txt", "est.txt", "--csv", "seq/groundtruth.txt"],
        ["evaluate", "surface", "mesh.ply", "--model", "mesh.ply", "--plot", "seq/depth/0.png"],
        ["evaluate", "views", "views", "--truth", "views", "--csv", "seq/camera.json"],
        ["trajectory", "plot", "seq/groundtruth.txt", "-o", "seq/depth/0.png"],
        ["stress", "--plot", "seq/rgb/1.png"],
        ["bench", "odometry", "results.json", "--plot", "seq/rgb/1.png"],
        ["figure", "1", "-o", "seq/rgb/1.png"],
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_no_command_replaces_a_file_of_a_sequence(sequence, words, capsys):
    (sequence.parent / "est.txt").write_bytes((sequence / "groundtruth.txt").read_bytes())
    before = {path: path.read_bytes() for path in sequence.rglob("*") if path.is_file()}
    assert main(words) == 2
    assert "a file of the sequence" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in sequence.rglob("*") if path.is_file()} == before


def test_pictures_and_tables_in_a_sequence_that_are_not_its_own_are_replaced(sequence):
    (sequence / "plots").mkdir()
    words = ["evaluate", "ate", "seq/groundtruth.txt", "seq/groundtruth.txt", "--align", "none"]
    for _ in range(2):
        assert main([*words, "--plot", "seq/plots/error.png", "--csv", "seq/error.csv"]) == 0


@pytest.mark.parametrize("name", ["seq/camera", "notes"])
def test_a_surface_replaces_no_json_that_is_not_its_recipe(sequence, name, capsys, monkeypatch):
    path = sequence.parent / f"{name}.json"
    if name == "notes":
        path.write_text("[1]")
    before = path.read_bytes()
    monkeypatch.setattr("iclnuim.benchmark.fusion.sequence.fuse_sequence", None)
    assert main(["fuse", "seq", "-o", f"{name}.ply"]) == 2
    error = capsys.readouterr().err
    assert f"{name}.json: expected" in error and "another name for --out" in error
    assert path.read_bytes() == before and not path.with_suffix(".ply").exists()


def test_a_surface_and_its_recipe_are_announced_and_replaced_by_the_next(sequence, capsys):
    for _ in range(2):
        assert main(["fuse", "seq", "-o", "surface.ply", "--max-blocks", "4000"]) == 0
    assert json.loads((sequence.parent / "surface.json").read_text())["kind"] == "surface"
    assert "surface.json written" in capsys.readouterr().err


def test_a_folder_that_does_not_exist_is_not_taken_for_one_without_ground_truth(tmp_path, capsys):
    assert main(["fuse", str(tmp_path / "none"), "-o", str(tmp_path / "m.ply")]) == 2
    assert (
        "expected a folder with a sequence, or a ROS bag, found nothing" in capsys.readouterr().err
    )


def test_a_figure_without_a_name_replaces_no_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "figure_6.png").write_bytes(b"of my paper")
    assert main(["figure", "6"]) == 2
    assert (
        "figure_6.png: expected a new file name, found an existing file; try -o FILE"
        in capsys.readouterr().err
    )
    assert (tmp_path / "figure_6.png").read_bytes() == b"of my paper"


@pytest.mark.parametrize(
    ("out", "words"), [(".", "found a folder"), ("none/a.csv", "no such folder")]
)
def test_a_table_that_cannot_be_written_is_refused_before_the_work(
    sequence, out, words, capsys, monkeypatch
):
    monkeypatch.setattr("iclnuim.sequences.rendered_views.view_errors", None)
    assert main(["evaluate", "views", "seq", "--truth", "seq", "--csv", out]) == 2
    assert words in capsys.readouterr().err


def test_a_link_stays_and_its_target_is_written(tmp_path):
    (tmp_path / "link.txt").symlink_to("target.txt")
    atomic_write_text(tmp_path / "link.txt", "one")
    atomic_write_text(tmp_path / "link.txt", "two")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "target.txt").read_text() == "two"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.txt", "target.txt"]


@pytest.mark.skipif(os.name == "nt", reason="needs named pipes")
def test_a_pipe_receives_the_content_and_stays_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    read: list[str] = []
    reader = threading.Thread(
        target=lambda: read.append((tmp_path / "pipe").read_text()), daemon=True
    )
    reader.start()
    atomic_write_text(tmp_path / "pipe", "content")
    reader.join(10)
    assert read == ["content"] and (tmp_path / "pipe").is_fifo()


@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="needs a file system in memory")
def test_a_file_in_memory_is_replaced_as_any_other():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        for text in ("one", "two"):
            atomic_write_text(f"{folder}/out.txt", text)
        assert Path(folder, "out.txt").read_text() == "two"


@pytest.mark.skipif(not Path("/dev/stdout").exists(), reason="needs /dev/stdout")
def test_standard_output_by_its_name(files):
    words = ["evaluate", "ate", "gt.txt", "est.txt", "--csv", "/dev/stdout", "--quiet"]
    done = subprocess.run(
        [sys.executable, "-m", "iclnuim", *words],
        capture_output=True,
        text=True,
        timeout=patience(100),
    )
    assert done.returncode == 0 and "reference_index" in done.stdout and "rmse" in done.stdout
    assert not Path("/dev/stdout").is_file() or Path("/dev/stdout").is_symlink()


@pytest.mark.parametrize(
    "words",
    [["--help"], ["--version"], ["evaluate", "--help"], ["evaluate", "ate", "gt.txt", "est.txt"]],
)
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_closed_standard_output_is_no_error(files, words, unbuffered):
    read, write = os.pipe()
    os.close(read)
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    done = subprocess.run(
        [sys.executable, "-m", "iclnuim", *words],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        timeout=patience(100),
    )
    os.close(write)
    assert done.returncode == 0 and "Error" not in done.stderr, done.stderr


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs /dev/full")
def test_a_full_standard_output_is_one_line(files):
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "iclnuim", "evaluate", "ate", "gt.txt", "est.txt", "--quiet"]
        done = subprocess.run(
            words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=patience(100)
        )
    assert (
        done.returncode == 3
        and "No space left on device" in done.stderr
        and "Traceback" not in done.stderr
    )


def test_an_estimate_is_written_though_nobody_reads_the_table(sequence, tmp_path, monkeypatch):
    def closed(*_):
        raise BrokenPipeError

    monkeypatch.setattr("iclnuim.headless.options.Console.result", closed)
    assert main(["odometry", "icp", "seq", "-o", "est.txt"]) == 0
    assert (tmp_path / "est.txt").is_file()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            lambda seq: (seq / "groundtruth.txt").write_text("1 2\n"),
            "groundtruth.txt:1: expected a trajectory",
        ),
        (
            lambda seq: (seq.parent / "est.txt").mkdir(),
            "est.txt: expected a file to write, found a folder",
        ),
    ],
    ids=["truth", "folder"],
)
def test_what_would_fail_at_the_end_fails_before_the_work(
    sequence, spoil, words, capsys, monkeypatch
):
    spoil(sequence)
    monkeypatch.setattr("iclnuim.benchmark.odometry.track.Tracker.add", None)
    assert main(["odometry", "icp", "seq", "-o", "est.txt"]) == 2
    assert words in capsys.readouterr().err


def test_a_sequence_without_a_surface_says_why_its_frames_are_left_out(sequence, capsys):
    first, *others = sorted((sequence / "depth").glob("*.png"))
    write_png(first, np.zeros((48, 64), np.uint16))
    for path in others:
        write_png(path, np.full((24, 32), 10_000, np.uint16))
    assert main(["fuse", "seq", "-o", "surface.ply", "--quiet"]) == 2
    error = capsys.readouterr().err
    assert (
        "no triangle in 1 fused frames; 2 left out, the first: depth/1.png: expected 64 x 48"
        in error
    )
    assert "found 32 x 24; try --camera with the size of the images" in error


@pytest.mark.parametrize("lacking", [("cx", "cy"), ("fx", "fy", "cx", "cy"), ("width",)])
def test_a_camera_is_not_completed_with_another_ones_figures(sequence, lacking, capsys):
    camera = PinholeCamera().to_dict()
    content = {name: value for name, value in camera.items() if name not in lacking}
    (sequence / "camera.json").write_text(str(content).replace("'", '"'))
    assert main(["odometry", "icp", "seq"]) == 2
    error = capsys.readouterr().err
    assert (
        f"camera.json: expected a camera with width, height, fx, fy, cx, cy, found no {', '.join(lacking)}"
        in error
    )


def test_depth_units_of_zero_are_refused(sequence, capsys):
    for words in (["--units", "0"], ["--units", "0", "--camera", "64x48"]):
        assert main(["odometry", "icp", "seq", *words]) == 2
    assert "1 to 1000000 depth units per metre, found 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["odometry", "icp", "seq", "-o", "out.txt"],
        ["fuse", "seq", "-o", "out.ply", "--max-blocks", "4000", "--voxel", "0.03"],
        ["noise", "seq", "out", "--depth-noise", "paper"],
        ["convert", "seq", "out"],
    ],
    ids=lambda words: words[0],
)
def test_depth_units_alone_replace_those_of_the_folder_s_camera(sequence, words, monkeypatch):
    used = []

    def remembered(path, units_per_metre):
        used.append(units_per_metre)
        return read_depth_m(path, units_per_metre)

    monkeypatch.setattr("iclnuim.sequences.stored_sequence.read_depth_m", remembered)
    assert main([*words, "--units", "2500"]) == 0
    if words[0] in ("noise", "convert"):
        made, recipe = (
            json.loads((sequence.parent / f"out/{name}.json").read_text())
            for name in ("camera", "recipe")
        )
        assert json.loads((sequence / "camera.json").read_text()).items() <= made.items()
        assert recipe["source"]["depth_units_per_metre"] == 2500
    else:
        assert set(used) == {2500}


@pytest.mark.parametrize(
    "options",
    [["--voxel", "0.03"], ["--voxel", "0.03", "--truncation", "0.07"], ["--truncation", "0.018"]],
)
@pytest.mark.parametrize("preset", ["best", "paper"])
def test_voxels_of_any_size_can_be_chosen(sequence, options, preset, capsys):
    assert (
        main(
            [
                "fuse",
                "seq",
                "-o",
                "surface.ply",
                "--preset",
                preset,
                "--max-blocks",
                "4000",
                *options,
            ]
        )
        == 0
    )


def test_a_truncation_that_grows_with_the_voxels_is_said_in_a_note_and_in_the_help(
    sequence, capsys
):
    notes = []
    for options in (
        ["--voxel", "0.03"],
        ["--voxel", "0.01"],
        ["--voxel", "0.03", "--truncation", "0.09"],
    ):
        assert main(["fuse", "seq", "-o", "surface.ply", "--max-blocks", "4000", *options]) == 0
        notes.append(
            "truncation distance 0.09 m: three voxels of 0.03 m" in capsys.readouterr().err
        )
    assert notes == [True, False, False]
    with pytest.raises(SystemExit):
        main(["fuse", "--help"])
    assert "the command fuse uses three voxels" in " ".join(capsys.readouterr().out.split())


def test_the_folder_one_stands_in_is_packed_beside_it(sequence, monkeypatch):
    monkeypatch.chdir(sequence)
    assert main(["convert", ".", "../tum"]) == 0
    monkeypatch.chdir(sequence.parent / "tum")
    assert main(["pack", ".", "--no-preview", "--licence", "MIT", "--quiet"]) == 0
    assert (sequence.parent / "tum.tar.gz").is_file()


def test_a_read_only_folder_is_named_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(Exception, match="cannot write: the folder is read-only"):
        check_file(tmp_path / "est.txt")


def test_values_of_image_files_are_not_taken_for_metres_or_light():
    with pytest.raises(
        InputError, match="depth in metres, as floating-point numbers, found uint16"
    ):
        noisy_depth(np.full((48, 64), 10_000, np.uint16))
    with pytest.raises(InputError, match="found uint8; try iclnuim.linear_from_srgb8"):
        noisy_rgb(np.full((48, 64, 3), 128, np.uint8))
    with pytest.raises(InputError, match="camera's size 64x48, found"):
        noisy_depth(np.full((10, 64), 2.0), camera=PinholeCamera.parse("64x48"))


@pytest.mark.parametrize(
    ("stamp", "expected"),
    [
        ("1.033333", "stamps in whole nanoseconds, as in EuRoC, found 1.033333"),
        ("1000000001", "stamps in nanoseconds, as in EuRoC, found stamps 1 apart"),
    ],
    ids=["seconds", "frame numbers"],
)
def test_a_tum_file_with_commas_is_not_read_as_euroc(tmp_path, stamp, expected, capsys):
    (tmp_path / "est.csv").write_text(f"1000000000,0,0,0,0,0,0,1\n{stamp},0,0,1,0,0,0,1\n")
    assert main(["trajectory", "info", str(tmp_path / "est.csv")]) == 2
    error = capsys.readouterr().err
    assert expected in error and "--from tum" in error


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["table", "9"], "invalid choice: 9"),
        (["evaluate", "surface", "mesh.ply"], "required: --model"),
        (["convert", "a", "b", "--workers", "0"], "expected a whole number of at least 1"),
        (["doctor", "--colour"], "unrecognized arguments: --colour"),
    ],
    ids=lambda words: words[0] if isinstance(words, list) else "",
)
def test_an_invalid_command_line_is_one_line_that_names_the_help(words, found, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(words)
    error = capsys.readouterr().err
    assert stopped.value.code == 2 and error.count("\n") == 1
    assert error.startswith(f"iclnuim {words[0]}") and found in error and error.endswith("--help\n")


def test_an_empty_argument_is_refused_not_taken_for_none(capsys):
    for argv in (
        ["make", "kt2", "--frames", ""],
        ["make", "kt2", "--camera="],
        ["evaluate", "", "b.txt"],
    ):
        assert main(argv) == 2
        assert "found an empty one" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["../../evil", "/tmp/abs", "a/../../b", "..\\b"])
def test_the_name_in_a_recipe_stays_below_the_output_folder(tmp_path, capsys, name):
    recipe = {
        "schema_version": 1,
        "sequence": name,
        "scene": "living_room",
        "trajectory": "living_room/kt2",
    }
    (tmp_path / "r.json").write_text(json.dumps({"job": recipe}))
    assert main(["make", str(tmp_path / "r.json"), "--frames", ":1", "--camera", "16x12"]) == 2
    assert "r.json: expected a sequence named such as living_room/kt2" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["noise", "seq", "out", "--rgb-noise", "paper"], ["convert", "seq", "out"]]
)
def test_a_camera_that_no_file_gives_is_noted(sequence, words, capsys):
    assert main(words) == 0 and "assumed" not in capsys.readouterr().err
    (sequence / "camera.json").unlink()
    for kind, image in (
        ("rgb", np.full((480, 640, 3), 90, np.uint8)),
        ("depth", np.full((480, 640), 9_000, np.uint16)),
    ):
        for i in range(3):
            write_png(sequence / kind / f"{i}.png", image)
    assert main([*words[:2], "assumed", *words[3:]]) == 0
    note = capsys.readouterr().err
    assert "seq: no camera.json, so the benchmark's camera is assumed" in note
    assert "5000 depth units per metre; set others with --camera and --units" in note


@pytest.mark.parametrize("number", ["0", "-3", "two"])
def test_a_number_of_processes_that_is_none_is_refused(sequence, number, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["convert", "seq", "out", f"--workers={number}"])
    assert (
        ended.value.code == 2
        and "--workers: expected a whole number of at least 1" in capsys.readouterr().err
    )


def test_options_may_stand_between_the_method_and_the_folder(sequence, capsys):
    assert main(["odometry", "icp", "--preset", "paper", "nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_an_odometer_without_a_folder_is_refused_with_what_is_missing(sequence, capsys):
    assert main(["odometry", "icp"]) == 2
    assert (
        "expected a METHOD and a folder with a sequence, or --all and a folder, found icp"
        in capsys.readouterr().err
    )
    assert main(["odometry", "seq"]) == 2
    assert "expected a METHOD, or --all without one, found neither" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["pack", "seq"],
            "seq: expected a sequence, found no recipe.json; try the output folder of",
        ),
        (
            ["check-depth", "seq"],
            "seq: expected the folder of a run, found no sequence.json; try the folder that",
        ),
    ],
)
def test_a_folder_that_another_command_wrote_is_refused_with_where_to_look(
    sequence, words, message, capsys
):
    assert main(words) == 2
    assert message in capsys.readouterr().err


def test_a_ground_truth_of_another_time_is_noted(sequence, capsys):
    assert main(["odometry", "icp", "seq", "--first", "2"]) == 0
    assert "no error is computed" not in capsys.readouterr().err
    lines = [
        f"50{line}\n"
        for line in (sequence / "groundtruth.txt").read_text().splitlines()
        if line[0] != "#"
    ]
    (sequence / "groundtruth.txt").write_text("".join(lines))
    assert main(["odometry", "icp", "seq", "--first", "2"]) == 0
    spans = "poses at 501.000..501.067 s, images at 1.000..1.033 s"
    assert (
        f"no error is computed, as no image has a ground-truth pose: {spans}"
        in capsys.readouterr().err
    )


def test_a_blend_file_that_exists_is_not_replaced_by_the_scene(tmp_path, capsys):
    (tmp_path / "mine.blend").write_bytes(b"mine")
    assert (
        main(
            [
                "render",
                "kt2",
                "--frames",
                "0:1",
                "--blend",
                str(tmp_path / "mine.blend"),
                "-o",
                str(tmp_path / "a"),
            ]
        )
        == 2
    )
    assert "mine.blend: expected a new file name, found an existing file" in capsys.readouterr().err
    assert (tmp_path / "mine.blend").read_bytes() == b"mine" and not (tmp_path / "a").exists()


def test_a_sequence_with_a_loop_of_links_is_recognized(sequence, capsys):
    for name in ("gt.txt", "est.txt"):
        write_trajectory(sequence.parent / name, WALK, "tum")
    (sequence / "rgb/1.png").unlink()
    (sequence / "rgb/1.png").symlink_to("1.png")
    assert main(["evaluate", "ate", "gt.txt", "est.txt", "--csv", "seq/groundtruth.txt"]) == 2
    assert "found a file of the sequence" in capsys.readouterr().err
