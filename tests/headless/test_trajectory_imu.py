"""`iclnuim trajectory imu` and `imu_of`: exact on the path of a recipe, a spline otherwise, refused
for poses that were interpolated.
"""

import json
import shutil

import iclnuim
import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.imu_files import imu_text, read_imu
from iclnuim.geometry.se3 import SE3
from iclnuim.headless.cli import main


@pytest.fixture
def kt2(repository, tmp_path):
    for ending in ("txt", "json"):
        shutil.copy(repository / f"trajectories/living_room/kt2.{ending}", tmp_path)
    return tmp_path / "kt2.txt"


def run(capsys, *arguments) -> tuple[int, str, str]:
    code = main(["trajectory", "imu", *map(str, arguments)])
    return code, *capsys.readouterr()


def test_it_writes_what_python_gives(capsys, tmp_path):
    out = tmp_path / "imu.csv"
    code, said, _ = run(
        capsys, "kt2", "--rate", 100, "--noise", "bmi055", "--seed", 5, "-o", out, "--json"
    )
    stamps_ns, readings = read_imu(out)
    expected = iclnuim.imu_of("kt2", 100, "bmi055", seed=5)
    assert code == 0 and json.loads(said)["exact"]
    assert (stamps_ns == expected.stamps_ns).all()
    assert readings == pytest.approx(expected.readings, abs=5.1e-10)
    assert imu_text(stamps_ns, readings) == out.read_text()


def test_lines_cut_from_a_file_beside_its_recipe_are_exact(capsys, kt2, tmp_path):
    lines = kt2.read_text().splitlines(keepends=True)
    kt2.write_text("".join(lines[200:300]))
    code, said, _ = run(capsys, kt2, "-o", tmp_path / "imu.csv", "--json")
    assert code == 0 and json.loads(said)["exact"]


@pytest.mark.parametrize("change", ["a pose", "the recipe", "no recipe"])
def test_other_poses_than_the_recipe_makes_get_a_spline(capsys, kt2, tmp_path, change):
    recipe = kt2.with_suffix(".json")
    if change == "a pose":
        lines = kt2.read_text().splitlines(keepends=True)
        fields = lines[400].split()
        fields[1] = f"{float(fields[1]) + 3e-6:.6f}"
        lines[400] = " ".join(fields) + "\n"
        kt2.write_text("".join(lines))
    elif change == "the recipe":
        recipe.write_text(recipe.read_text().replace('"seed": ', '"seed": 1'))
    else:
        recipe.unlink()
    code, said, _ = run(capsys, kt2, "-o", tmp_path / "imu.csv", "--json")
    figures = json.loads(said)
    assert code == 0 and not figures["exact"]
    assert "a C2 spline through them" in figures["path"]


def test_a_spline_costs_what_the_command_says(kt2):
    exact = iclnuim.imu_of(kt2)
    kt2.with_suffix(".json").unlink()
    spline = iclnuim.imu_of(kt2)
    off = (exact.readings - spline.readings)[100:-100, 3:]
    assert np.sqrt((off**2).sum(axis=1).mean()) == pytest.approx(0.4, abs=0.05)


@pytest.mark.parametrize("rate_hz", [60, 90, 120, 240])
@pytest.mark.parametrize("name", ["kt2", "office/kt1"])
def test_a_resampled_trajectory_is_refused(name, rate_hz):
    resampled = iclnuim.resample(iclnuim.read_trajectory(name).trajectory, rate_hz)
    with pytest.raises(InputError, match="straight pieces between others; try the trajectory that"):
        iclnuim.imu_of(resampled)


@pytest.mark.parametrize("rate_hz", [15, 31, 45, 120])
def test_what_is_resampled_beside_its_recipe_stays_on_its_path(kt2, capsys, tmp_path, rate_hz):
    out = tmp_path / "resampled.txt"
    words = ["trajectory", "resample", str(kt2), "--rate", str(rate_hz), "-o", str(out)]
    assert main(words) == 0
    assert "on the path of the recipe that made the poses" in capsys.readouterr().err
    code, said, _ = run(capsys, out, "-o", tmp_path / "imu.csv", "--json")
    assert code == 0 and json.loads(said)["exact"]
    exact, found = (iclnuim.imu_of(file) for file in (kt2, out))
    shared = np.intersect1d(exact.stamps_ns, found.stamps_ns)
    rows = [one.readings[np.isin(one.stamps_ns, shared)] for one in (exact, found)]
    assert len(shared) > 1000 and rows[0] == pytest.approx(rows[1], abs=1e-9)
    apart = iclnuim.resample(iclnuim.read_trajectory(kt2).trajectory, rate_hz)
    moved = iclnuim.read_trajectory(out).trajectory.positions_m - apart.positions_m
    assert (
        np.linalg.norm(moved, axis=1).max() < 0.002
    )  # what straight lines between poses leave out


def test_a_recipe_is_not_written_over_another_file(kt2, capsys, tmp_path):
    (tmp_path / "other.json").write_text("{}")
    words = ["trajectory", "resample", str(kt2), "--rate", "40", "-o", str(tmp_path / "other.txt")]
    assert main(words) == 2
    assert "no other file where the recipe belongs" in capsys.readouterr().err
    assert (tmp_path / "other.json").read_text() == "{}"


def test_a_smooth_motion_at_constant_speed_is_not_refused():
    count = 600
    angle = np.linspace(0, 6, count)
    positions = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    turns = np.column_stack([np.zeros((count, 5)), angle])
    circle = iclnuim.Trajectory.at_rate(SE3(SE3.exp(turns).rotation, positions))
    readings = iclnuim.imu_of(circle).readings[50:-50]
    speed = 6 * 30 / (count - 1)
    assert readings.mean(axis=0) == pytest.approx([0, 0, speed, -(speed**2), 0, 9.81], abs=1e-3)


def test_a_rig_mounts_the_imu(capsys, tmp_path):
    T = SE3.exp(np.array([0.02, 0.01, -0.03, 0.0, 0.0, np.pi / 2]))
    rig = tmp_path / "rig.json"
    rig.write_text(json.dumps({"T_imu_cam0": T.matrix.tolist()}))
    assert run(capsys, "kt2", "--rig", rig, "-o", tmp_path / "imu.csv")[0] == 0
    expected = iclnuim.imu_of("kt2", T_imu_camera=T).readings
    assert read_imu(tmp_path / "imu.csv")[1] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"T_imu_cam0": 3}', "four rows of four numbers"),
        ('{"T_imu_cam1": []}', "a rig: T_imu_cam0, found T_imu_cam1"),
        ('{"T_imu_cam0": [[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]}', "multiplied by 2"),
        ("{}", "four rows of four numbers"),
        ('{"T_imu_cam0": [["a",0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}', "four rows"),
    ],
)
def test_a_rig_that_is_none_is_refused_in_a_line(capsys, tmp_path, content, said):
    rig = tmp_path / "rig.json"
    rig.write_text(content)
    code, out, err = run(capsys, "kt2", "--rig", rig, "-o", tmp_path / "imu.csv")
    assert code == 2 and not out and err.count("\n") == 1
    assert said in err and "rig.json" in err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "found an empty file"),
        ("#only names\n", "readings of an IMU"),
        ("1,2,3\n", "nanoseconds, and six finite numbers"),
        ("1,1,2,3,4,5,nan\n", "nanoseconds, and six finite numbers"),
        ("1.5,1,2,3,4,5,6\n", "nanoseconds, and six finite numbers"),
        ("2,1,2,3,4,5,6\n2,1,2,3,4,5,6\n", "increasing stamps"),
        ("-5,1,2,3,4,5,6\n", "nanoseconds, and six finite numbers"),
    ],
)
def test_a_file_without_readings_is_refused_with_its_line(tmp_path, text, said):
    (tmp_path / "imu.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_imu(tmp_path / "imu.csv")
