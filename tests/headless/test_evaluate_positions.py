"""`iclnuim evaluate` of files without rotations and in map coordinates, and built-in trajectories."""

import json

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless import cli
from iclnuim.trajectory_files.trajectories import trajectory_text

COUNT = 60
RNG = np.random.default_rng(7)
TRUTH = Trajectory.at_rate(SE3.exp(np.cumsum(RNG.normal(size=(COUNT, 6)) * 0.1, axis=0)))
FAR_M = np.array([367000.0, 5429380.0, 110.0])


def noisy(trajectory: Trajectory) -> Trajectory:
    return Trajectory(
        trajectory.stamps_s, trajectory.T_world_camera @ SE3.exp(RNG.normal(size=(COUNT, 6)) * 0.01)
    )


def moved(trajectory: Trajectory, by_m: np.ndarray) -> str:
    """TUM's text with positions moved: more than write_trajectory writes."""
    fields = [line.split() for line in trajectory_text(trajectory, "tum").splitlines()[1:]]
    rows = [
        [line[0], *(f"{float(a) + b:.9f}" for a, b in zip(line[1:4], by_m, strict=True)), *line[4:]]
        for line in fields
    ]
    return "".join(" ".join(row) + "\n" for row in rows)


def positions_of(text: str) -> str:
    return "".join(
        " ".join(line.split()[:4]) + "\n" for line in text.splitlines() if line[0] != "#"
    )


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("positions")
    estimate = noisy(TRUTH)
    (folder / "gt.txt").write_text(trajectory_text(TRUTH, "tum"))
    (folder / "est.txt").write_text(trajectory_text(estimate, "tum"))
    for name, trajectory in (("gt", TRUTH), ("est", estimate)):
        (folder / f"{name}_utm.txt").write_text(moved(trajectory, FAR_M))
        (folder / f"{name}_xyz.txt").write_text(positions_of(trajectory_text(trajectory, "tum")))
    return folder


def result(capsys, *words) -> dict:
    assert cli.main(["evaluate", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("names", [("gt", "est_xyz"), ("gt_xyz", "est"), ("gt_xyz", "est_xyz")])
@pytest.mark.parametrize("align", ["se3", "sim3", "yaw", "none"])
def test_positions_alone_have_the_same_ate_and_no_rotation_error(files, capsys, names, align):
    whole = result(capsys, "ate", files / "gt.txt", files / "est.txt", "--align", align)
    found = result(capsys, "ate", *(files / f"{name}.txt" for name in names), "--align", align)
    assert found["translation_error_m"] == whole["translation_error_m"]
    assert found["rotation_error_deg"] is None
    assert found["warnings"] == whole["warnings"]


def test_positions_alone_are_refused_where_rotations_count(files, tmp_path, capsys):
    gt, est = files / "gt.txt", files / "est_xyz.txt"
    for words in (
        ["evaluate", "rpe", gt, est],
        ["evaluate", "ate", gt, est, "--align", "origin"],
        ["trajectory", "convert", est, tmp_path / "out.txt"],
    ):
        assert cli.main([str(word) for word in words]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.endswith("est_xyz.txt: expected poses with rotations, found positions alone")
    assert not (tmp_path / "out.txt").exists()


def test_the_text_the_table_and_the_chart_of_positions_have_no_rotations(files, tmp_path, capsys):
    table, chart = tmp_path / "errors.csv", tmp_path / "error.png"
    words = ["evaluate", "ate", files / "gt.txt", files / "est_xyz.txt"]
    assert cli.main([str(w) for w in [*words, "--csv", table, "--plot", chart]]) == 0
    assert "rotation (deg)   none: positions alone" in capsys.readouterr().out
    assert table.read_text().splitlines()[1].split(",")[5] == "nan"
    assert chart.stat().st_size > 1000
    assert cli.main(["trajectory", "info", str(files / "est_xyz.txt")]) == 0
    assert "none: positions alone" in capsys.readouterr().out


@pytest.mark.parametrize("align", ["se3", "sim3", "yaw", "origin", "none"])
def test_map_coordinates_have_the_errors_of_the_same_files_near_the_origin(files, capsys, align):
    near = result(capsys, "ate", files / "gt.txt", files / "est.txt", "--align", align)
    far = result(capsys, "ate", files / "gt_utm.txt", files / "est_utm.txt", "--align", align)
    for name, value in near["translation_error_m"].items():
        assert far["translation_error_m"][name] == pytest.approx(value, abs=2e-9)
    if align == "none":
        one = result(capsys, "ate", files / "gt_utm.txt", files / "est.txt", "--align", align)
        assert one["translation_error_m"]["min"] > np.linalg.norm(FAR_M) - 100


def test_a_built_in_trajectory_is_given_by_its_name(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for words in (["living_room/kt1", "kt1"], ["ate", "office/kt1", "office/kt1"]):
        assert result(capsys, *words)["translation_error_m"]["max"] < 1e-12
    for words in (["info", "kt1"], ["convert", "office/kt1", "out.kitti"]):
        assert cli.main(["trajectory", *words]) == 0
    (tmp_path / "kt1").write_text("1 0 0 0 0 0 0 1\n")  # a file of that name is meant
    capsys.readouterr()
    assert cli.main(["trajectory", "info", "kt1"]) == 0
    assert "frames    1 " in capsys.readouterr().out
