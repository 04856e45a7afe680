"""`iclnuim odometry` on the official frames, judged by `iclnuim evaluate DIR EST`."""

import json

import numpy as np
import pytest
from iclnuim.formats.depth_units import depth16_from_metres
from iclnuim.formats.png import write_png

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.registry import ODOMETERS, names, odometer  # noqa: E402
from iclnuim.benchmark.odometry.run import Sequence  # noqa: E402
from iclnuim.errors import InputError, WorkError  # noqa: E402
from iclnuim.headless import method_options  # noqa: E402
from iclnuim.headless.cli import main  # noqa: E402


@pytest.fixture
def stretch(samples, tmp_path):
    """Frames 600..607 of office kt0 beside the left-handed ground truth."""
    folder = tmp_path / "kt0"
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
        for i in range(600, 608):
            (folder / kind / f"{i}.png").symlink_to(samples / "or_kt0" / kind / f"{i}.png")
    for truth in (samples / "or_kt0").glob("*.gt.freiburg"):
        (folder / truth.name).symlink_to(truth)
    return folder


def test_an_estimate_of_official_frames_is_evaluated_without_options(stretch, tmp_path, capsys):
    estimate = tmp_path / "est.txt"
    assert main(["odometry", "icp", str(stretch), "-o", str(estimate), "--quiet"]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(stretch), str(estimate), "--json", "--quiet"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["pairs"] == 8
    assert report["translation_error_m"]["rmse"] < 0.001
    assert main(["evaluate", "rpe", str(stretch), str(estimate), "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)["translation_error_m"]["rmse"] < 0.001


def test_a_missing_image_is_named_and_left_out_of_the_path(stretch, tmp_path, capsys):
    (stretch / "depth/603.png").unlink()
    lines = [f"{i} depth/{i}.png {i} rgb/{i}.png\n" for i in range(600, 608)]
    (stretch / "associations.txt").write_text("".join(lines))
    estimate = tmp_path / "est.txt"
    assert main(["odometry", "dvo", str(stretch), "-o", str(estimate), "--json"]) == 0
    out, notes = capsys.readouterr()
    assert json.loads(out)["runs"][0]["lost"] == 0
    assert (
        " frames are there, and only these are used; 1 images are missing" in notes
        and "depth/603.png" in notes
    )
    assert (
        len([line for line in estimate.read_text().splitlines() if not line.startswith("#")]) == 7
    )


def test_what_a_sensor_adds_to_inverse_depth_is_taken_off_again(tmp_path):
    rng = np.random.default_rng(1)
    z_m = rng.uniform(0.5, 8.0, (480, 640)).astype(np.float32)
    z_m[:10] = 0
    biased = np.where(z_m > 0, z_m / (1 + 0.0016 * z_m), 0)
    for kind, image in (
        ("rgb", np.zeros((480, 640, 3), np.uint8)),
        ("depth", depth16_from_metres(biased)),
    ):
        (tmp_path / kind).mkdir()
        write_png(tmp_path / kind / "0.png", image)
    ((_, raw),) = Sequence(tmp_path).frames()
    ((_, corrected),) = Sequence(tmp_path, 0.0016).frames()
    assert np.abs(raw.depth_z_m - z_m).max() > 0.05
    assert np.abs(corrected.depth_z_m - z_m).max() < 2e-4
    assert (corrected.depth_z_m[:10] == 0).all()


def test_a_depth_offset_beyond_sense_is_bad_input(stretch, capsys):
    assert main(["odometry", "icp", str(stretch), "--depth-offset", "0.5"]) == 2
    assert "0.015" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--plot", "path.bmp"), "path.bmp: expected a picture's name"),
        (("--plot", "nowhere/path.png"), "nowhere: expected a folder"),
        (("-o", "nowhere/est.txt"), "nowhere: expected a folder"),
    ],
)
def test_what_cannot_be_written_is_said_before_the_work(stretch, options, said, capsys):
    assert main(["odometry", "icp", str(stretch), *options]) == 2
    out, err = capsys.readouterr()
    assert said in err and "frames/s" not in err and not out


@pytest.mark.parametrize("number", ["0", "-3", "x"])
def test_a_number_of_frames_below_one_is_bad_input(stretch, number, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["odometry", "icp", str(stretch), "--first", number])
    assert "at least 1" in capsys.readouterr().err


def test_an_unknown_method_is_bad_input(stretch, capsys):
    assert main(["odometry", "orb", str(stretch)]) == 2
    assert "icp_rgbd" in capsys.readouterr().err


def test_evaluate_says_when_a_folder_has_no_ground_truth(tmp_path, capsys):
    assert main(["evaluate", str(tmp_path), "est.txt"]) == 2
    assert "ground truth" in capsys.readouterr().err


def test_a_camera_that_nothing_tells_is_named_and_one_may_be_given(stretch, tmp_path, capsys):
    assert main(["odometry", "icp", str(stretch)]) == 0
    assert "the benchmark's camera is assumed" in capsys.readouterr().err
    estimate = tmp_path / "est.txt"
    assert (
        main(
            [
                "odometry",
                "icp",
                str(stretch),
                "--camera",
                "640x480,600,600,320,240",
                "-o",
                str(estimate),
            ]
        )
        == 0
    )
    assert "camera is assumed" not in capsys.readouterr().err
    assert main(["odometry", "icp", str(stretch), "--camera", "320x240"]) == 2
    assert "expected 320 x 240 as in the camera, found 640 x 480" in capsys.readouterr().err


def test_all_methods_are_written_to_a_folder_and_drawn_in_one_figure(stretch, tmp_path, capsys):
    out, picture = tmp_path / "est", tmp_path / "all.png"
    options = ("--first", "3", "-o", str(out), "--plot", str(picture))
    assert main(["odometry", "--all", str(stretch), *options]) == 0
    assert sorted(path.name for path in out.iterdir()) == sorted(
        f"{name}.txt" for name in ODOMETERS
    )
    assert picture.stat().st_size > 10_000
    table = capsys.readouterr().out
    assert all(f"\n{name} " in table for name in ODOMETERS)


@pytest.mark.parametrize(
    "command", [("odometry", "icp"), ("bench", "odometry"), ("fuse", "-o", "x.ply")]
)
@pytest.mark.parametrize("module", ["numba", "cv2"])
def test_a_missing_package_is_one_line_that_names_the_command(
    stretch, command, module, monkeypatch, capsys
):
    monkeypatch.setattr(
        method_options, "find_spec", lambda name: None if name == module else object()
    )
    assert main([*command, str(stretch)]) == 3
    line = capsys.readouterr().err
    assert f"needs {module}; try: pip install " in line and len(line.splitlines()) == 1


def test_a_comparison_leaves_out_what_is_not_installed_and_says_so(stretch, capsys, monkeypatch):
    def without_open3d(name, preset="best"):
        if "open3d" in name:
            raise WorkError(f"{name} needs open3d; try: pip install open3d-cpu")
        return odometer(name, preset)

    monkeypatch.setattr(method_options, "odometer", without_open3d)
    assert main(["bench", "odometry", str(stretch), "--first", "3", "--only", "p"]) == 0
    out, err = capsys.readouterr()
    assert "left out: open3d-plane needs open3d; try: pip install open3d-cpu" in err
    assert "icp_rgbd" in out and "open3d" not in out
    assert err.index("the benchmark's camera is assumed") < err.index("frames")


def test_a_comparison_of_the_built_in_ones_alone(stretch, capsys):
    assert (
        main(["bench", "odometry", str(stretch), "--first", "2", "--only", "ours", "--json"]) == 0
    )
    (race,) = json.loads(capsys.readouterr().out)["results"]
    assert [run["odometer"] for run in race["runs"]] == list(ODOMETERS)


def test_the_page_lists_every_odometer(repository):
    page = (repository / "docs/guide/odometry.md").read_text()
    assert all(f"`{name}`" in page for name in names())


def test_an_offset_leaves_the_largest_depth_of_an_image_before_the_camera(tmp_path):
    """65.5 m in millimetres; an offset of 1 / 65.5 m would move it to infinity."""
    for kind, image in (
        ("rgb", np.zeros((480, 640, 3), np.uint8)),
        ("depth", np.full((480, 640), 65535, np.uint16)),
    ):
        (tmp_path / kind).mkdir()
        write_png(tmp_path / kind / "0.png", image)
    assert Sequence(tmp_path, 0.0105).depth_offset == 0.0105
    with pytest.raises(InputError, match="depth offset"):
        Sequence(tmp_path, 0.0155)
