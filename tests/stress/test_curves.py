"""Curves: a step changes what it says, and all steps see the same frames."""

import json
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
from iclnuim import write_ply
from iclnuim.benchmark.experiments.recipes.curve import curves
from iclnuim.benchmark.odometry.protocol import Frame, OdometryResult
from iclnuim.benchmark.odometry.track import Tracker
from iclnuim.errors import InputError

pytest.importorskip("numba")
from iclnuim.benchmark.odometry.icp import Icp  # noqa: E402
from iclnuim.benchmark.odometry.icp_rgbd import IcpRgbd  # noqa: E402
from iclnuim.benchmark.odometry.photometric import Rgbd  # noqa: E402


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Cells are stored below the working folder by default."""
    monkeypatch.chdir(tmp_path)


def test_steps_change_the_settings_that_they_name():
    icp, rgbd = Icp.PRESETS["best"], Rgbd.PRESETS["best"]
    assert curves.iterations(icp, 2).iterations == (0, 8, 6) and curves.iterations(
        icp, 0.1
    ).iterations == (0, 1, 1)
    assert curves.levels(rgbd, 1).iterations == (0, 0, 2, 2)
    assert curves.strides(icp, 2).strides == (2, 4, 2) and curves.min_gradients(
        rgbd, 2
    ).min_gradients == (
        24,
        4,
        6,
        4,
    )
    with pytest.raises(InputError, match="fewer than 2 levels"):
        curves.levels(icp, 2)
    both = IcpRgbd(IcpRgbd.PRESETS["best"])
    changed = curves.changed("icp_rgbd", curves.CURVES["iterations"], 2)
    assert (
        changed.iterations == tuple(2 * n for n in both.iterations)
        and changed.weight_b == both.weight_b
    )


def test_halved_frames_keep_planes_and_drop_edges():
    depth = np.full((8, 8), 2.0, np.float32)
    depth[:, 5:] = 3.0
    depth[0, 0] = 0.0
    small = curves.halved(Frame.of(np.full((8, 8), 9.0, np.float32), depth, 0.0), 1)
    assert (
        np.array_equal(small.depth_z_m[1], [2, 2, 0, 3])
        and small.depth_z_m[0, 0] == 0
        and (small.grey == 9).all()
    )


class Slow:
    """Finds the camera where it was, and says that this took 50 ms."""

    name, reference = "slow", "frame"

    def prepare(self, frame, camera):
        return frame

    def align(self, reference, current, guess):
        return OdometryResult(guess)


def test_compiling_at_the_first_alignment_is_not_timed(segment, monkeypatch):
    clock_s = [0.0]
    monkeypatch.setattr("iclnuim.benchmark.odometry.track.time.perf_counter", lambda: clock_s[0])

    class Compiled(Slow):
        first = True

        def align(self, reference, current, guess):
            clock_s[0] += 10.0 if self.first else 0.001
            self.first = False
            return OdometryResult(guess)

    variant = curves.Variant("compiled", None, Tracker(Compiled(), segment.camera))
    (point,) = curves.interleaved("levels", [variant], segment.frames, segment.truth, lambda: None)
    assert (
        max(variant.seconds) < 0.002
        and point.ms == pytest.approx(1)
        and point.processed == point.frames == 40
    )


def test_a_curve_is_one_command(command_here, folder):
    words = (
        "bench",
        "curve",
        "resolution",
        folder,
        "--first",
        "6",
        "--values",
        "160,80",
        "--method",
        "opencv-icp",
    )
    code, out, err = command_here(*words, "--json")
    assert code == 0, err
    points = json.loads(out)["points"]
    assert [p["value"] for p in points] == [160, 80]
    assert all(p["ate_m"] < 0.02 and p["tracked"] == p["frames"] for p in points)


def test_what_cannot_be_varied_is_said_in_one_line(command_here, folder):
    for words, message in (
        (
            ("slope", folder),
            "expected a curve (levels, iterations, pixels, resolution, voxel)",
        ),
        (
            ("levels", folder, "--method", "opencv-icp"),
            "expected an odometer with such settings (dvo, rgbd, icp, icp_rgbd)",
        ),
        (
            ("resolution", folder, "--values", "100", "--first", "6"),
            "expected 160 divided by a power of two, found 100",
        ),
        (
            ("iterations", folder, "--values", "1,nan"),
            "--values: expected numbers above 0, at most 1e+06, found nan",
        ),
        (
            ("pixels", folder, "--values", "0,0.1"),
            "--values: expected numbers above 0, at most 1e+06, found 0",
        ),
        (("realtime", folder), "found realtime; try another curve, whose ms"),
        (("keyframe", folder), "found keyframe; try iclnuim odometry --reference keyframe"),
        (
            ("levels", folder, "--values", "0.5"),
            "--values: expected whole numbers of levels, found 0.5",
        ),
    ):
        code, _, err = command_here("bench", "curve", *words, "--first", "6")
        assert code == 2 and message in err


def test_methods_without_the_setting_have_one_step(command_here, folder, tmp_path):
    methods = ("--method", "icp", "--method", "opencv-icp")
    words = ("bench", "curve", "iterations", folder, "--first", "6", "--values", "0.5,1", *methods)
    code, out, err = command_here(*words, "--json", "--plot", tmp_path / "curve.svg")
    assert code == 0, err
    points = json.loads(out)["points"]
    assert [(p["method"], p["value"]) for p in points] == [
        ("icp", 0.5),
        ("icp", 1.0),
        ("opencv-icp", None),
    ]
    assert {p["processed"] for p in points} == {6} and len({p["sequence"] for p in points}) == 1
    drawn = (tmp_path / "curve.svg").read_text()
    assert drawn.startswith("<?xml") and len(drawn) > 10_000
    code, _, err = command_here(*words[:3], folder, folder, *words[4:])
    assert code == 2 and "expected sequences with different names" in err


def without_times(text):
    points = json.loads(text)["points"]
    return [{name: v for name, v in point.items() if name != "ms"} for point in points]


def test_a_sequence_whose_steps_are_measured_is_not_measured_again(command_here, folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "again/clean")
    (copy / "recipe.json").unlink()
    words = ("bench", "curve", "resolution", folder, copy, "--first", "6", "--values", "160,80")
    words = (*words, "--method", "opencv-icp", "-o", tmp_path / "out", "--json")
    code, first, err = command_here(*words)
    assert code == 0, err
    assert "curve.html written" in err
    files = sorted((tmp_path / "out/resolution/cells").rglob("*.cell.json"))
    assert len(files) == 4
    stamps = [file.stat().st_mtime_ns for file in files]
    files[0].unlink()
    code, second, _ = command_here(*words)
    assert code == 0 and without_times(second) == without_times(first)
    changed = [file.stat().st_mtime_ns != stamp for file, stamp in zip(files, stamps, strict=True)]
    assert changed == [True, True, False, False]  # all steps of that sequence, for their times


@pytest.mark.slow
def test_a_killed_curve_ends_in_the_same_table_but_for_times(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "again/clean")
    (copy / "recipe.json").unlink()
    words = [sys.executable, "-m", "iclnuim", "bench", "curve", "iterations", folder, copy]
    words += ["--method", "icp", "--method", "opencv-icp", "--json", "--quiet", "-o"]
    begun = time.monotonic()
    whole = subprocess.run([*words, tmp_path / "whole"], capture_output=True, check=True)
    took_s = time.monotonic() - begun
    kills = 0
    for share in np.linspace(0.3, 0.98, 8):
        process = subprocess.Popen([*words, tmp_path / "out"], stdout=subprocess.DEVNULL)
        time.sleep(share * took_s)
        kills += process.poll() is None
        process.kill()
        process.wait()
    last = subprocess.run([*words, tmp_path / "out"], capture_output=True, check=True)
    assert kills > 2 and without_times(last.stdout) == without_times(whole.stdout)


def test_a_short_sequence_is_used_whole_and_too_many_frames_are_refused(command_here, folder):
    words = (
        "bench",
        "curve",
        "resolution",
        folder,
        "--values",
        "160",
        "--method",
        "opencv-icp",
    )
    code, out, err = command_here(*words, "--start", "2", "--json")
    assert code == 0, err
    (point,) = json.loads(out)["points"]
    assert 3 < point["frames"] < 120 and list(json.loads(out)["recipe"]["frames"].values()) == [
        point["frames"]
    ]
    for options in (("--first", "500"), ("--start", "499"), ("--start", str(point["frames"]))):
        code, _, err = command_here(*words, *options)
        assert code == 2 and "frames, found" in err and "try another --frames" in err
    code, _, err = command_here(*words, "--start", "-1")
    assert code == 2 and "expected a first frame of 0 or more" in err


def test_a_method_with_fewer_levels_has_fewer_steps(command_here, folder):
    words = (
        "bench",
        "curve",
        "levels",
        folder,
        "--first",
        "4",
        "--method",
        "icp",
        "--method",
        "rgbd",
        "--json",
    )
    code, out, err = command_here(*words)
    assert code == 0, err
    steps = [(p["method"], p["value"]) for p in json.loads(out)["points"]]
    assert steps == [("icp", 0), ("icp", 1), ("rgbd", 0), ("rgbd", 1), ("rgbd", 2)]
    code, _, err = command_here(*words, "--values", "7")
    assert code == 2 and "expected fewer levels left out than a method has, found 7" in err


def test_a_step_that_lost_most_frames_fails_and_is_not_in_the_front():
    from iclnuim.benchmark.experiments.recipes.curve import chart as curve_chart
    from iclnuim.report.charts import pareto_front

    fast = curves.Point("icp", "levels", 2, 20, 20, 4, 1e-4, 1.0)
    sound = curves.Point(
        "icp", "levels", 0, 20, 10, 9, 1e-3, 5.0
    )  # half of the frames were dropped, not lost
    assert fast.failed and not sound.failed
    axes = curve_chart.curve_figure("levels", {"kt2": [fast, sound]}).axes[0]
    dashed = next(line for line in axes.lines if line.get_linestyle() == "--")
    assert dashed.get_xydata().tolist() == [[5.0, 1.0]] and any(
        line.get_marker() == "x" for line in axes.lines
    )
    assert pareto_front([(3, 1), (1, 3), (2, 3), (1, 3), (4, 0)]) == [1, 3, 0, 4]


@pytest.mark.slow
def test_smaller_voxels_are_nearer_to_the_true_box_and_take_more_memory(
    command_here, folder, tmp_path
):
    corners = np.array(np.meshgrid([-2.0, 2.0], [-2.5, 2.5], [0.0, 2.5])).reshape(3, -1).T
    faces = [(0, 2, 6, 4), (1, 3, 7, 5), (0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6)]
    write_ply(
        tmp_path / "box.ply",
        corners,
        np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]),
    )
    words = (
        "bench",
        "curve",
        "voxel",
        folder,
        "--first",
        "12",
        "--values",
        "0.06,0.02",
        "--model",
        tmp_path / "box.ply",
    )
    code, out, err = command_here(*words, "--json", "--plot", tmp_path / "voxel.png")
    assert code == 0, err
    coarse, fine = json.loads(out)["points"]
    assert fine["mean_m"] < coarse["mean_m"] < 0.03 and fine["memory_mb"] > coarse["memory_mb"]
    assert (tmp_path / "voxel.png").stat().st_size > 5_000
