"""The readings of an IMU beside the frames of a sequence: written, stored, read, resumed, converted and
packed; their truth; files that are broken.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import iclnuim
import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.continuous import RecipeMotion
from iclnuim.geometry.handheld import Recipe
from iclnuim.geometry.se3 import SE3
from iclnuim.postprocess import frames_from
from iclnuim.sensor.imu import ImuOnCamera, imu_on
from iclnuim.sensor.imu_noise import imu_noise
from iclnuim.sequences.bag_reader import unpacked
from iclnuim.sequences.bag_writer import BagSettings, write_rosbag
from iclnuim.sequences.frame_source import image_frames, original_frames, run_frames
from iclnuim.sequences.imu import SequenceImu, read_imu_files
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.packing import packed_names
from iclnuim.sequences.run_folder import open_run
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.sequence_options import SequenceOptions, SequenceSettings
from iclnuim.sequences.shards import pack_shards
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import SequenceWriter, write_sequence

from .bag_files import Recording

RATE_HZ = 200.0
COUNT = 6
T_IMU_CAMERA = SE3.exp(np.array([0.03, -0.01, 0.02, 0.2, -0.1, 1.5]))
NOISY = SequenceSettings(imu=imu_noise("adis16448"), seed=3)
WITH_IMU = [name for name, format in FORMATS.items() if format.limits.imu]


@pytest.fixture(scope="session")
def motion(repository):
    content = json.loads((repository / "trajectories/living_room/kt2.json").read_text())
    return RecipeMotion(Recipe.from_dict(content)), content


@pytest.fixture(scope="session")
def imu_run(motion, tmp_path_factory) -> Path:
    """A run of six frames on the path of kt2, with an IMU beside the camera."""
    path, content = motion
    camera = {"width": 32, "height": 24, "fx": 24.0, "fy": 24.0, "cx": 15.5, "cy": 11.5}
    mount = tuple(T_IMU_CAMERA.matrix.ravel().tolist())
    imu = ImuOnCamera(RATE_HZ, mount, content).to_dict()
    recipe = {"job": {"camera": camera, "samples": 1, "imu": imu}}
    folder = tmp_path_factory.mktemp("imu") / "raw"
    run = open_run(folder, recipe, path.trajectory[:COUNT])
    v, u = np.mgrid[0:24, 0:32]
    for number in range(COUNT):
        colour = np.stack([u / 32, v / 24, (u + v) / 56], -1)
        run.write_frame(number, colour, 1.0 + number / 10 + v / 30)
    return folder


@pytest.fixture(scope="session")
def written(imu_run, tmp_path_factory) -> Path:
    """That run with noise, in every format, a folder each, to be read only."""
    out = tmp_path_factory.mktemp("imu") / "out"
    write_sequence(run_frames(imu_run), out, NOISY, tuple(FORMATS), workers=1)
    return out


def expected(motion, first=0, last=COUNT - 1):
    """The readings around frames."""
    stream = imu_on(motion[0], RATE_HZ, T_IMU_CAMERA)
    stamps_s = motion[0].trajectory.stamps_s
    return NOISY.imu.apply(stream, 3).around(stamps_s[first], stamps_s[last])


@pytest.mark.parametrize("format", WITH_IMU)
def test_a_format_gives_back_readings_stamps_and_mounting(written, motion, format):
    found = StoredSequence(written / format).imu.stream
    wanted = expected(motion)
    assert (found.stamps_ns == wanted.stamps_ns).all()
    assert found.readings == pytest.approx(wanted.readings, abs=5.1e-10)
    assert np.abs(found.T_imu_camera.matrix - T_IMU_CAMERA.matrix).max() < 1e-8
    if format != "vslam-lab":  # it has what estimators are to assume
        assert found.noise == pytest.approx(NOISY.imu.figures(), rel=1e-8)
    assert found.rate_hz == RATE_HZ


def test_a_format_that_cannot_store_them_says_so(imu_run, tmp_path):
    writer = SequenceWriter(run_frames(imu_run), {tmp_path / "out": NOISY}, tuple(FORMATS))
    said = {text.partition(":")[0] for text in writer.losses() if "readings of the IMU" in text}
    assert said == set(FORMATS) - set(WITH_IMU)
    assert set(WITH_IMU) == {"tum", "rtabmap", "euroc", "tum-vi", "vslam-lab"}


def test_the_readings_begin_before_the_first_frame_and_end_after_the_last(written):
    sequence = iclnuim.open_sequence(written / "tum")
    assert sequence.imu.shape == (len(sequence.imu_stamps_s), 6)
    assert sequence.imu_stamps_s[0] < sequence.stamps_s[0] - 0.05
    assert sequence.imu_stamps_s[-1] > sequence.stamps_s[-1] + 0.05
    part = sequence[2:4]
    assert part.imu_stamps_s[0] == pytest.approx(part.stamps_s[0] - 0.1, abs=0.005)
    assert part.imu_stamps_s[-1] == pytest.approx(part.stamps_s[-1] + 0.1, abs=0.005)


def test_euroc_has_the_true_states_of_the_imu(written, motion):
    rows = np.loadtxt(
        written / "euroc/mav0/state_groundtruth_estimate0/data.csv", delimiter=",", comments="#"
    )
    assert rows.shape == (COUNT, 17)
    stamps_s = rows[:, 0] / 1e9
    states = motion[0].states(stamps_s).of_mounted(T_IMU_CAMERA.inverse())
    assert rows[:, 1:4] == pytest.approx(states.T_world_body.translation, abs=1e-6)
    assert rows[:, 8:11] == pytest.approx(states.velocity_m_s, abs=1e-8)
    stream = expected(motion)
    biases = [np.interp(stamps_s, stream.stamps_s, column) for column in stream.biases.T]
    assert rows[:, 11:] == pytest.approx(np.stack(biases, -1), abs=1e-8)
    assert np.abs(rows[:, 11:]).min() > 0


ORB_SLAM3 = {
    "IMU.NoiseGyro": "gyroscope_noise_density",
    "IMU.NoiseAcc": "accelerometer_noise_density",
    "IMU.GyroWalk": "gyroscope_random_walk",
    "IMU.AccWalk": "accelerometer_random_walk",
}


@pytest.mark.parametrize("noise", ["none", "bmi055", "adis16448"])
def test_orb_slam3_finds_the_imu_in_its_settings_and_no_noise_of_0(imu_run, tmp_path, noise):
    """Settings.cc: a float is refused that is not a real number in OpenCV's reader."""
    cv2 = pytest.importorskip("cv2")
    settings = SequenceSettings(imu=imu_noise(noise), seed=3)
    write_sequence(run_frames(imu_run), tmp_path / "out", settings, workers=1)
    file = str(tmp_path / "out/orb_slam3.yaml")
    storage = cv2.FileStorage(file, cv2.FILE_STORAGE_READ)
    assert np.abs(storage.getNode("IMU.T_b_c1").mat() - T_IMU_CAMERA.matrix).max() < 1e-6
    assert storage.getNode("IMU.Frequency").isReal()
    assert storage.getNode("IMU.Frequency").real() == RATE_HZ
    figures, filled = imu_noise(noise).figures(), imu_noise("bmi055").figures()
    for key, name in ORB_SLAM3.items():
        assert storage.getNode(key).isReal()
        wanted = figures.get(name) or filled[name]
        assert storage.getNode(key).real() == pytest.approx(wanted, rel=1e-9)


def test_vslam_lab_finds_its_columns_and_keys(written):
    """Their names are those of DatasetVSLAMLab_calibration.py and dataset_euroc.py; OKVIS2 takes them."""
    yaml = pytest.importorskip("yaml")
    text = (written / "vslam-lab/calibration.yaml").read_text()
    (imu,) = yaml.safe_load(text.replace("%YAML 1.2", ""))["imus"]
    keys = (
        "imu_name a_max g_max sigma_g_c sigma_bg sigma_a_c sigma_ba sigma_gw_c sigma_aw_c a0 g0 g"
    )
    assert set(imu) == {*keys.split(), "s_a", "fps", "T_BS"}
    assert min(float(imu[key]) for key in keys.split() if "sigma" in key) > 0
    header, first = (written / "vslam-lab/imu_0.csv").read_text().splitlines()[:2]
    assert header.split(",")[:4] == ["ts (ns)", "wx (rad s^-1)", "wy (rad s^-1)", "wz (rad s^-1)"]
    assert first in (written / "tum/imu.csv").read_text()


def test_tum_vi_has_kalibr_s_camera_and_the_poses_of_the_imu(written, motion):
    yaml = pytest.importorskip("yaml")
    folder = written / "tum-vi"
    camera = yaml.safe_load((folder / "dso/camchain.yaml").read_text())["cam0"]
    assert np.abs(camera["T_cam_imu"] @ T_IMU_CAMERA.matrix - np.eye(4)).max() < 1e-8
    noise = yaml.safe_load((folder / "dso/imu_config.yaml").read_text())
    assert noise["update_rate"] == RATE_HZ and float(noise["gyroscope_random_walk"]) > 0
    poses = np.loadtxt(folder / "mav0/mocap0/data.csv", delimiter=",", comments="#")
    states = motion[0].states(poses[:, 0] / 1e9).of_mounted(T_IMU_CAMERA.inverse())
    assert poses[:, 1:4] == pytest.approx(states.T_world_body.translation, abs=1e-6)
    assert poses.shape == (COUNT, 8)


def test_without_sensor_files_tum_vi_is_read_by_kalibr_s(written, motion, tmp_path):
    folder = tmp_path / "sequence"
    shutil.copytree(written / "tum-vi", folder)
    for file in folder.rglob("sensor.yaml"):
        file.unlink()
    found, wanted = StoredSequence(folder), StoredSequence(written / "tum-vi")
    assert found.camera.pinhole == wanted.camera.pinhole
    assert np.abs(found.truth.positions_m - wanted.truth.positions_m).max() < 1e-6
    assert np.abs(found.imu.stream.T_imu_camera.matrix - T_IMU_CAMERA.matrix).max() < 1e-8
    chain = folder / "dso/camchain.yaml"
    chain.write_text(chain.read_text().replace("radtan", "equidistant"))
    with pytest.raises(InputError, match="a pinhole camera, found distortion_model equidistant"):
        assert StoredSequence(folder).camera


@pytest.mark.parametrize("format", WITH_IMU)
def test_the_ground_truth_that_is_read_is_the_camera_s(written, motion, format):
    truth = StoredSequence(written / format).truth
    own = motion[0].trajectory[:COUNT]
    assert np.abs(truth.T_world_camera.matrix - own.T_world_camera.matrix).max() < 2e-6


def test_a_sequence_without_noise_has_readings_without(imu_run, motion, tmp_path):
    write_sequence(run_frames(imu_run), tmp_path / "clean", workers=1)
    exact = imu_on(motion[0], RATE_HZ, T_IMU_CAMERA)
    found = read_imu_files(tmp_path / "clean").stream
    kept = np.isin(exact.stamps_ns, found.stamps_ns)
    assert found.readings == pytest.approx(exact.readings[kept], abs=5.1e-10)
    assert found.noise == {} and "imu_noise" not in (tmp_path / "clean/recipe.json").read_text()


def test_a_stopped_sequence_is_finished_with_the_same_bytes(imu_run, written, tmp_path):
    formats = ("tum", "euroc")
    first = run_frames(imu_run, ":2")
    write_sequence(first, tmp_path / "out", NOISY, formats, workers=1)
    part = StoredSequence(tmp_path / "out/tum").imu.stream
    write_sequence(run_frames(imu_run), tmp_path / "out", NOISY, formats, workers=1)
    for file in ("tum/imu.csv", "tum/imu.json", "euroc/mav0/imu0/data.csv"):
        assert (tmp_path / "out" / file).read_bytes() == (written / file).read_bytes()
    whole = StoredSequence(written / "tum").imu.stream
    same = np.isin(whole.stamps_ns, part.stamps_ns)
    assert (whole.readings[same] == part.readings).all()


def test_a_sequence_with_other_noise_is_not_resumed(imu_run, tmp_path):
    write_sequence(run_frames(imu_run, ":1"), tmp_path / "out", NOISY, workers=1)
    other = SequenceSettings(imu=imu_noise("bmi055"), seed=3)
    with pytest.raises(InputError, match="imu_noise model adis16448 there, bmi055 requested"):
        write_sequence(run_frames(imu_run), tmp_path / "out", other, workers=1)
    with pytest.raises(InputError, match="the sequence that was started there"):
        write_sequence(run_frames(imu_run), tmp_path / "out", SequenceSettings(seed=3), workers=1)


def test_conversion_keeps_every_digit(written, tmp_path):
    source = original_frames(written / "tum")
    write_sequence(source, tmp_path / "out", formats=("euroc", "tum"), workers=1)
    text = (written / "tum/imu.csv").read_text()
    assert (tmp_path / "out/tum/imu.csv").read_text() == text
    assert (tmp_path / "out/euroc/mav0/imu0/data.csv").read_text() == text
    back = original_frames(written / "euroc")
    write_sequence(back, tmp_path / "back", formats=("euroc",), workers=1)
    states = "mav0/state_groundtruth_estimate0/data.csv"
    # body and camera are one there: the poses of the camera are written anew
    assert np.loadtxt(tmp_path / "back" / states, delimiter=",").shape == (COUNT, 17)
    assert (tmp_path / "back/mav0/imu0/data.csv").read_text() == text


def test_what_a_source_does_not_know_is_said(written, tmp_path):
    writer = SequenceWriter(
        original_frames(written / "tum"), {tmp_path / "out": SequenceSettings()}, ("euroc",)
    )
    assert any("no velocities and biases" in sentence for sentence in writer.losses())


def test_noise_is_added_to_readings_that_are_stored(imu_run, tmp_path):
    write_sequence(run_frames(imu_run), tmp_path / "clean", workers=1)
    iclnuim.make_sequence(tmp_path / "clean", tmp_path / "noisy", imu="bmi055", seed=1, workers=1)
    clean, noisy = (read_imu_files(tmp_path / name).stream for name in ("clean", "noisy"))
    wanted = imu_noise("bmi055").apply(clean, 1)
    assert noisy.readings == pytest.approx(wanted.readings, abs=5.1e-10)


def test_noise_without_an_imu_is_refused(run, tmp_path):
    with pytest.raises(InputError, match="frames with an IMU for its noise, found none"):
        write_sequence(run_frames(run.path), tmp_path / "out", NOISY, workers=1)
    assert not (tmp_path / "out").exists()


def test_shards_and_archive_have_the_readings(written, tmp_path):
    sequence = tmp_path / "sequence"
    shutil.copytree(written / "tum", sequence)
    assert {"imu.csv", "imu.json"} <= set(packed_names(sequence))
    pack_shards(sequence, tmp_path / "shards", "CC-BY-4.0")
    shards = read_imu_files(tmp_path / "shards").stream
    assert (shards.readings == read_imu_files(sequence).stream.readings).all()
    assert np.abs(shards.T_imu_camera.matrix - T_IMU_CAMERA.matrix).max() < 1e-12


def test_inspection_tells_the_rate_gaps_and_frames_without_readings(written, tmp_path):
    folder = tmp_path / "sequence"
    shutil.copytree(written / "tum", folder)
    (folder / "groundtruth.txt").unlink()
    found = inspect_sequence(folder)
    assert found.figures["imu"]["rate_hz"] == RATE_HZ
    assert not [text for text in found.warnings if "IMU" in text]
    lines = (folder / "imu.csv").read_text().splitlines(keepends=True)
    (folder / "imu.csv").write_text("".join(lines[:30] + lines[40:50]))
    said = " ".join(inspect_sequence(folder).warnings)
    assert "frames are not between the first and the last reading of the IMU" in said
    assert "1 gaps in the readings of the IMU, the longest 0.055 s" in said


def test_inspection_holds_the_readings_against_the_poses(motion, tmp_path):
    poses = motion[0].trajectory[:40]
    stream = imu_on(motion[0], RATE_HZ, T_IMU_CAMERA).around(*poses.stamps_s[[0, -1]])
    images = np.full((24, 32, 3), 0.5, np.float32), np.zeros((24, 32), np.float32)
    frames = frames_from(PinholeCamera.parse("32x24"), poses, lambda number: images)
    degrees = stream.readings * np.repeat([180 / np.pi, 1.0], 3)
    for name, readings in (("right", stream.readings), ("degrees", degrees)):
        imu = SequenceImu(replace(stream, readings=readings))
        write_sequence(replace(frames, imu=lambda imu=imu: imu), tmp_path / name, workers=1)
    right, degrees = (inspect_sequence(tmp_path / name) for name in ("right", "degrees"))
    assert right.figures["imu"]["rates_differ_rad_s"] < 0.001
    assert not [text for text in right.errors + right.warnings if "IMU" in text]
    assert [one["kind"] for one in degrees.figures["imu"]["explanations"]] == ["degrees"]
    assert any("with rates in degrees per second" in text for text in degrees.errors)


def test_a_rate_that_a_file_says_and_the_stamps_do_not_is_told(written, tmp_path):
    folder = tmp_path / "sequence"
    shutil.copytree(written / "tum", folder)
    (folder / "groundtruth.txt").unlink()
    about = folder / "imu.json"
    about.write_text(about.read_text().replace('"rate_hz": 200', '"rate_hz": 100'))
    said = " ".join(inspect_sequence(folder).warnings)
    assert "the readings of the IMU come at 200 Hz, its file says 100 Hz" in said


@pytest.mark.parametrize(("name", "names"), [("a.bag", "tum"), ("b_ros2", "realsense")])
def test_bags_have_the_readings_for_rosbags_and_for_us(written, tmp_path, name, names):
    highlevel = pytest.importorskip("rosbags.highlevel")
    path = tmp_path / name
    write_rosbag(written / "tum", path, 1 if name == "a.bag" else 2, BagSettings(bag_names=names))
    wanted = StoredSequence(written / "tum").imu.stream
    stamps, rows, frames = [], [], {}
    with highlevel.AnyReader([path]) as reader:
        for connection, time_ns, raw in reader.messages():
            if connection.topic in ("/camera/imu", "/tf_static"):
                message = reader.deserialize(raw, connection.msgtype)
                if connection.topic == "/tf_static":
                    frames[message.transforms[0].child_frame_id] = message.transforms[0]
                    continue
                assert connection.msgtype == "sensor_msgs/msg/Imu"
                stamp = message.header.stamp
                stamps.append(stamp.sec * 10**9 + stamp.nanosec)
                assert stamps[-1] == time_ns and message.orientation_covariance[0] == -1
                vectors = message.angular_velocity, message.linear_acceleration
                rows.append([getattr(vector, axis) for vector in vectors for axis in "xyz"])
    assert (np.array(stamps) == wanted.stamps_ns).all()
    assert (np.array(rows) == wanted.readings).all()
    place = frames["camera_imu_optical_frame"].transform.translation
    assert [place.x, place.y, place.z] == pytest.approx(T_IMU_CAMERA.inverse().translation)
    found = StoredSequence(path).imu.stream
    assert (found.stamps_ns == wanted.stamps_ns).all()
    assert (found.readings == wanted.readings).all()
    assert np.abs(found.T_imu_camera.matrix - T_IMU_CAMERA.matrix).max() < 1e-9


def images_and_imu(recording, topics, stamps_ns, readings):
    """Two pairs of images, and readings in topics of Imu."""
    for stamp_ns in (10**9, 2 * 10**9):
        recording.image("/rgb", stamp_ns, np.ones((24, 32, 3), np.uint8), "rgb8")
        recording.image("/depth", stamp_ns, np.full((24, 32), 1000, np.uint16), "16UC1")
    for topic, each, rows in zip(topics, stamps_ns, readings, strict=True):
        for stamp_ns, row in zip(each, rows, strict=True):
            recording.imu(topic, stamp_ns, row)


@pytest.fixture
def line_of_readings():
    """Readings (n, 6) that are linear in time."""
    return lambda stamps_ns: np.outer(np.array(stamps_ns) / 1e9, [1.0, 2, 3, 4, 5, 6])


def test_a_gyroscope_and_an_accelerometer_apart_are_one_imu(tmp_path, line_of_readings):
    """librealsense records both in topics of their own, each with zeros for the other sensor."""
    pytest.importorskip("rosbags")
    gyro_ns = list(range(10**9, 2 * 10**9, 5_000_000))
    accel_ns = list(range(10**9 + 1_000_000, 2 * 10**9, 16_000_000))
    topics = ["/device_0/Accel_0/imu/data", "/device_0/Gyro_0/imu/data"]
    stamps = [accel_ns, gyro_ns]
    rows = [line_of_readings(each) for each in stamps]
    rows[0][:, :3] = 0
    rows[1][:, 3:] = 0
    with Recording(tmp_path / "a.bag") as recording:
        images_and_imu(recording, topics, stamps, rows)
    found = StoredSequence(tmp_path / "a.bag").imu.stream
    assert found.rate_hz == 200 and set(found.stamps_ns.tolist()) < set(gyro_ns)
    assert found.readings == pytest.approx(line_of_readings(found.stamps_ns), abs=1e-8)


def test_what_of_an_imu_in_a_bag_is_not_read_is_said(tmp_path, line_of_readings):
    pytest.importorskip("rosbags")
    stamps_ns = list(range(10**9, 2 * 10**9, 10_000_000))
    rows = line_of_readings(stamps_ns)
    rows[7, 2] = np.nan
    with Recording(tmp_path / "two.bag") as recording:
        images_and_imu(recording, ["/imu/a", "/imu/b"], [stamps_ns] * 2, [rows] * 2)
    both = StoredSequence(tmp_path / "two.bag")
    assert both.imu is None
    warnings = json.loads((unpacked(tmp_path / "two.bag")[0] / "bag.json").read_text())["warnings"]
    assert "no IMU is read, as several are there: /imu/a, /imu/b" in " ".join(warnings)
    with Recording(tmp_path / "frames.bag") as recording:
        images_and_imu(recording, [], [], [])
        for stamp_ns, row in zip(stamps_ns, rows, strict=True):
            recording.imu("/imu", stamp_ns, row, "imu")
        still = np.array([0.0, 0, 0, 0, 0, 0, 1])
        pairs = [("a", "imu", still), ("b", "imu", still)]
        recording.transforms("/tf_static", stamps_ns[0], pairs)
    assert len(StoredSequence(tmp_path / "frames.bag").imu.stream) == len(stamps_ns) - 1
    warnings = json.loads((unpacked(tmp_path / "frames.bag")[0] / "bag.json").read_text())
    assert "1 readings of the IMU that are not finite" in warnings["warnings"][0]
    assert "no one path of transforms from imu to optical" in warnings["warnings"][1]
    rows[:, :3] = 0
    with Recording(tmp_path / "accel.bag") as recording:  # as in the bags of the TUM benchmark
        images_and_imu(recording, ["/imu"], [stamps_ns], [rows])
    assert StoredSequence(tmp_path / "accel.bag").imu is None
    notes = json.loads((unpacked(tmp_path / "accel.bag")[0] / "bag.json").read_text())["notes"]
    assert "no IMU is read, as /imu has no rotation rates" in notes
    one = StoredSequence(f"{tmp_path / 'two.bag'}:/imu/b")
    assert len(one.imu.stream) == len(stamps_ns) - 1


def test_sequences_without_an_imu_have_no_trace_of_one(all_formats):
    for name in FORMATS:
        folder = all_formats / name
        assert not [path for path in folder.rglob("*") if "imu" in path.name]
        assert StoredSequence(folder).imu is None
    assert "imu" not in SequenceOptions().to_dict().keys() | SequenceSettings().to_dict().keys()


def mutated(data: bytes, rng) -> bytes:
    data = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        place = int(rng.integers(0, len(data)))
        kind = rng.integers(0, 4)
        if kind == 0:
            data[place] = int(rng.integers(0, 256))
        elif kind == 1:
            del data[place : place + int(rng.integers(1, 60))]
        elif kind == 2:
            data[place:place] = bytes(
                rng.choice(list(b"0123456789eE+-.,\n #naif[]{}:"), 3).tolist()
            )
        else:
            data = data[: place + 1]
    return bytes(data)


@pytest.mark.parametrize(
    "file",
    [
        "tum/imu.csv",
        "tum/imu.json",
        "euroc/mav0/imu0/data.csv",
        "euroc/mav0/imu0/sensor.yaml",
        "vslam-lab/imu_0.csv",
        "vslam-lab/calibration.yaml",
    ],
)
def test_a_broken_file_gives_a_line_or_valid_readings(written, tmp_path, file):
    format = file.partition("/")[0]
    shutil.copytree(written / format, tmp_path / format)
    rng = np.random.default_rng(0)
    original = (written / file).read_bytes()
    for _ in range(340):
        (tmp_path / file).write_bytes(mutated(original, rng))
        try:
            imu = StoredSequence(tmp_path / format).imu
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert imu is None or np.isfinite(imu.stream.readings).all()


def test_images_of_a_sequence_carry_its_imu(written):
    imu = image_frames(written / "tum", "1:3").imu()
    assert len(imu.stream) == len(StoredSequence(written / "tum").imu.stream)
