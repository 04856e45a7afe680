"""The mode of ORB-SLAM3 with an IMU: what it is given, what is noted of it, and what is refused."""

import json
import sys
from pathlib import Path

import iclnuim
import numpy as np
import pytest
from iclnuim.benchmark.systems.system import read_system
from iclnuim.geometry.se3 import SE3
from iclnuim.sequences.imu import SequenceImu, write_imu

T_IMU_CAMERA = SE3.exp(np.array([0.03, -0.01, 0.02, 0.2, -0.1, 1.5]))


@pytest.fixture(scope="module")
def with_imu(make_sequence, tmp_path_factory):
    """A sequence from 0.25 s on, so that its view is a second later."""
    folder = make_sequence(tmp_path_factory.mktemp("imu") / "kt2/noisy", 0.25)
    truth = folder / "groundtruth.txt"
    stream = iclnuim.imu_of(truth, noise="adis16448", seed=1, T_imu_camera=T_IMU_CAMERA)
    write_imu(folder, SequenceImu(stream))
    return folder


@pytest.fixture
def inertial(run, tmp_path, monkeypatch):
    """inertial(sequence, options ...) -> rows, notes and the folder of the runs, of ORB-SLAM3's
    driver with a stand-in for pyorbslam3.
    """
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent / "stand_in"))
    vocabulary = tmp_path / "words.txt"
    vocabulary.write_text("a vocabulary")

    def call(folder, *options, mode=("--mode", "rgbd-inertial"), code=0):
        given = (*mode, "--program", sys.executable, "--vocabulary", vocabulary, *options)
        rows, notes = run("orbslam3", *given, folder=folder, code=code)
        return rows, notes, next((tmp_path / "out/cells").glob("*/*"), None)

    return call


def test_each_frame_is_given_the_readings_since_the_one_before_it(with_imu, inertial):
    _, _, folder = inertial(with_imu)
    calls = json.loads((folder / "run_1/out/calls.json").read_text())
    sequence = iclnuim.open_sequence(with_imu)
    before_s = -np.inf
    for stamp_s, rows in calls:
        stamps_s = np.array(rows)[:, 0]
        assert (stamps_s > before_s).all() and (stamps_s <= stamp_s).all() and len(rows) >= 6
        before_s = stamp_s
    given = np.concatenate([rows for _, rows in calls])
    stored = sequence.imu[sequence.imu_stamps_s + 1 <= before_s]
    assert np.abs(given[:, 0] - 1 - sequence.imu_stamps_s[: len(given)]).max() < 1e-8
    np.testing.assert_allclose(given[:, 1:], stored, rtol=0, atol=1e-9)


def test_its_settings_have_the_noise_of_the_sequence_and_the_mounting(with_imu, inertial):
    cv2 = pytest.importorskip("cv2")
    _, _, folder = inertial(with_imu, "--first", "20")
    read = cv2.FileStorage(str(folder / "stage/settings.yaml"), cv2.FILE_STORAGE_READ)
    T_b_c1 = read.getNode("IMU.T_b_c1").mat()
    np.testing.assert_allclose(T_b_c1, T_IMU_CAMERA.matrix, rtol=0, atol=1e-6)
    density = json.loads((with_imu / "imu.json").read_text())["gyroscope_noise_density"]
    assert read.getNode("IMU.NoiseGyro").real() == pytest.approx(density, rel=1e-8)
    names = ("NoiseGyro", "NoiseAcc", "GyroWalk", "AccWalk", "Frequency")
    assert min(read.getNode(f"IMU.{name}").real() for name in names) > 0


def test_a_row_has_the_time_until_the_imu_was_initialised(with_imu, inertial):
    rows, notes, folder = inertial(with_imu)
    row = rows["ORB-SLAM3 RGB-D-inertial"]
    assert row["initialised_s"] == pytest.approx(11 / 30, abs=1e-6)
    assert "its IMU was initialised 2 times" in row["notes"]
    (folder / "run_1/out/initialised.txt").write_text("")
    rows, _, _ = inertial(with_imu)
    row = rows["ORB-SLAM3 RGB-D-inertial"]
    assert row["initialised_s"] is None and "its IMU was never initialised" in row["notes"]


def test_without_the_mode_the_readings_stay_out(with_imu, inertial):
    rows, _, folder = inertial(with_imu, mode=())
    calls = json.loads((folder / "run_1/out/calls.json").read_text())
    assert len(calls) == 60 and all(imu is None for _, imu in calls)
    assert list(rows) == ["ORB-SLAM3", "ORB-SLAM3 live"]
    assert rows["ORB-SLAM3"]["initialised_s"] is None and not (folder / "stage/imu.csv").exists()


def with_gap(folder, make_sequence, tmp_path):
    """The sequence without the readings from 0.5 to 0.6 s."""
    copy = make_sequence(tmp_path / "kt2/gap", 0.25)
    lines = (folder / "imu.csv").read_text().splitlines(keepends=True)
    kept = [one for one in lines if one[0] == "#" or not 5 <= int(one.split(",")[0]) / 1e8 < 6]
    (copy / "imu.csv").write_text("".join(kept))
    return copy


def test_what_it_cannot_run_with_is_one_line(
    with_imu, sequence, inertial, make_sequence, tmp_path, monkeypatch
):
    _, none, _ = inertial(sequence, code=2)
    assert "expected an IMU in the sequence, found none; try `iclnuim make --imu" in none
    _, gap, _ = inertial(with_gap(with_imu, make_sequence, tmp_path), "--dry-run", code=2)
    assert "between all frames, found none between 0.51" in gap
    _, mode, _ = inertial(with_imu, mode=("--mode", "stereo"), code=2)
    assert "--mode: expected a mode (rgbd-inertial), found stereo" in mode
    monkeypatch.setenv("WITHOUT_IMU", "1")
    _, old, _ = inertial(with_imu, code=3)
    assert "orbslam3:rgbd-inertial cannot run with" in old and "Sensor.IMU_RGBD" in old
    assert all(len(text.splitlines()) == 1 for text in (none, gap, mode, old))


def test_a_mode_changes_values_and_the_keys_of_tables_alone(fake):
    path = fake("good", '[options]\na = "1"\nb = "2"\n[modes.other]\ntitle = "Other"')
    path.write_text(path.read_text() + '\n[modes.other.options]\nb = "3"')
    plain, other = (read_system(str(path), {}, mode) for mode in (None, "other"))
    assert (plain.title, other.title, other.name) == ("good", "Other", "good:other")
    assert plain.options["b"] == "2" and "modes" not in plain.content
    assert {**other.options, "b": "2"} == plain.options and other.options["b"] == "3"
