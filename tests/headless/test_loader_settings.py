"""`iclnuim settings`: the file that each system wants has the camera, the depth scale and the bounds
of the sequence.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from iclnuim.formats.ply import write_ply
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, stamps_of_frames
from iclnuim.headless.loader_settings import bounds_m, filled, system_files, systems
from iclnuim.postprocess import frames_from
from iclnuim.sensor.imu import ImuOnCamera
from iclnuim.sensor.imu_noise import imu_noise
from iclnuim.sequences.imu import SequenceImu
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence

CAMERA = PinholeCamera(64, 48, 48.5, 47.25, 31.5, 23.75)
T_IMU_CAMERA = SE3.exp(np.array([0.03, -0.04, 0.0, 0.2, -0.1, 1.5]))
UNITS = {"replica": 6553.5, "eth3d": 5000.0, "euroc": 1000.0, "vslam-lab": 5000.0}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A camera that moves 1 m to the right in front of a wall at 2 m."""
    out = tmp_path_factory.mktemp("settings") / "out"
    positions = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]])
    trajectory = Trajectory(
        stamps_of_frames(np.arange(3)), SE3(np.tile(np.eye(3), (3, 1, 1)), positions)
    )

    def load(number):
        return np.full((48, 64, 3), 0.5, np.float32), np.full((48, 64), 2, np.float32)

    write_sequence(frames_from(CAMERA, trajectory, load), out, SequenceSettings(), UNITS, workers=1)
    return out


def parsed(name, text):
    if name.endswith(".json"):
        return json.loads(text)
    if name.endswith((".py", ".txt")):
        return text
    return yaml.safe_load(text.replace("%YAML:1.0", "").replace("!!opencv-matrix", ""))


def numbers_of(content):
    if isinstance(content, dict):
        content = list(content.values())
    if isinstance(content, list):
        return [number for item in content for number in numbers_of(item)]
    return [content] if isinstance(content, int | float) else []


@pytest.mark.parametrize("name", systems())
def test_every_file_is_read_and_has_the_camera(written, name):
    system = system_files(name)
    texts = filled(system, written / system.format)
    found = []
    for file, text in texts.items():
        assert "$" not in text
        content = parsed(file, text)
        if file.endswith(".txt"):
            content = list(map(float, text.split()))
        if file.endswith(".py"):
            compile(content, file, "exec")
            continue
        found += numbers_of(content)
    if name == "vslam-lab":  # the camera is in calibration.yaml
        assert found[:2] == [pytest.approx(30, abs=0.01), 5000]
        return
    for value in (48.5, 47.25, 31.5, 23.75):
        assert value in found
    if name != "droid-slam":
        assert 64 in found and 48 in found
    if system.format == "replica":
        assert 6553.5 in found


def test_files_have_what_the_systems_require_and_inherit_from_nowhere(written):
    """Point-SLAM reads two keys that its file for Replica does not have, OKVIS2 stops at the first
    number that is missing, by OpenCV's reader.
    """
    cv2 = pytest.importorskip("cv2")
    text = filled(system_files("point-slam"), written / "replica")["point-slam.yaml"]
    content = yaml.safe_load(text)
    assert content["config_path"] == str(written / "replica/point-slam.yaml")
    assert content["scene"] == "replica" and content["meshing"] == {"eval_rec": False}
    text = filled(system_files("okvis2"), written / "euroc")["okvis2.yaml"]
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    camera = storage.getNode("cameras").at(0)
    assert [camera.getNode("focal_length").at(k).real() for k in range(2)] == [48.5, 47.25]
    assert camera.getNode("T_SC").size() == storage.getNode("imu_parameters").getNode("T_BS").size()
    groups = {
        "camera_parameters": "timestamp_tolerance image_delay sync_cameras online_calibration",
        "imu_parameters": "use a_max g_max sigma_g_c sigma_bg sigma_a_c sigma_ba sigma_gw_c "
        "sigma_aw_c a0 g0 g",
        "frontend_parameters": "detection_threshold absolute_threshold matching_threshold octaves "
        "max_num_keypoints keyframe_overlap use_cnn parallelise_detection num_matching_threads",
        "estimator_parameters": "num_keyframes num_loop_closure_frames num_imu_frames "
        "do_loop_closures do_final_ba enforce_realtime realtime_min_iterations "
        "realtime_max_iterations realtime_time_limit realtime_num_threads full_graph_iterations "
        "full_graph_num_threads",
        "output_parameters": "display_matches display_overhead",
    }
    for group, names in groups.items():
        assert set(names.split()) <= set(storage.getNode(group).keys())


def test_there_is_a_file_for_each_system():
    wanted = (
        "nice-slam co-slam eslam point-slam splatam monogs mast3r-slam droid-slam okvis2 "
        "open_vins basalt kalibr vslam-lab vins-fusion"
    )
    assert systems() == tuple(sorted(wanted.split()))


@pytest.fixture(scope="module")
def with_imu(tmp_path_factory):
    """That camera with an IMU, which is turned and 5 cm away, and the noise of a sensor."""
    out = tmp_path_factory.mktemp("imu") / "out"
    positions = np.array([[0.0, 0, 0], [0.01, 0, 0], [0.03, 0, 0]])
    poses = SE3(np.tile(np.eye(3), (3, 1, 1)), positions)
    trajectory = Trajectory(stamps_of_frames(np.arange(3)), poses)

    def load(number):
        return np.full((48, 64, 3), 0.5, np.float32), np.full((48, 64), 2, np.float32)

    frames = frames_from(CAMERA, trajectory, load)
    job = ImuOnCamera(400.0, tuple(T_IMU_CAMERA.matrix.ravel().tolist()))
    frames = replace(frames, imu=lambda: SequenceImu.of_job(job, trajectory))
    write_sequence(frames, out, SequenceSettings(imu=imu_noise("bmi055")), ("euroc",), workers=1)
    return out


def test_systems_with_an_imu_get_its_place_rate_and_noise(with_imu):
    cv2 = pytest.importorskip("cv2")
    noise = imu_noise("bmi055").figures()

    def yaml_of(system, file):
        return parsed(file, filled(system_files(system), with_imu)[file])

    kalibr = yaml_of("kalibr", "imu.yaml")
    assert {name: float(kalibr[name]) for name in noise} == pytest.approx(noise, rel=1e-9)
    assert kalibr["update_rate"] == 400 and kalibr["rostopic"] == "/camera/imu"
    chain = yaml_of("open_vins", "kalibr_imu_chain.yaml")["imu0"]
    assert {name: float(chain[name]) for name in noise} == pytest.approx(noise, rel=1e-9)
    camera = yaml_of("open_vins", "kalibr_imucam_chain.yaml")["cam0"]
    assert np.abs(np.array(camera["T_imu_cam"]) - T_IMU_CAMERA.matrix).max() < 1e-8
    basalt = yaml_of("basalt", "basalt.json")["value0"]
    pose = basalt["T_imu_cam"][0]
    found = SE3.from_quat_xyzw([pose[f"q{a}"] for a in "xyzw"], [pose[f"p{a}"] for a in "xyz"])
    assert np.abs(found.matrix - T_IMU_CAMERA.matrix).max() < 1e-8
    assert basalt["imu_update_rate"] == 400
    assert basalt["gyro_noise_std"] == pytest.approx([noise["gyroscope_noise_density"]] * 3)
    text = filled(system_files("vins-fusion"), with_imu)["vins_fusion.yaml"]
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    assert np.abs(storage.getNode("body_T_cam0").mat() - T_IMU_CAMERA.matrix).max() < 1e-8
    per_reading = 20 * noise["accelerometer_noise_density"]  # integration_base.h weights each one
    assert storage.getNode("acc_n").real() == pytest.approx(per_reading)


def test_bounds_are_those_of_what_is_seen_and_five_percent(written):
    low = np.array([-31.5 / 48.5 * 2, -23.75 / 47.25 * 2, 2])
    high = np.array([1 + (56 - 31.5) / 48.5 * 2, (40 - 23.75) / 47.25 * 2, 2])
    margin = 0.05 * (high - low)
    expected = np.stack([low - margin, high + margin], 1)
    assert np.abs(bounds_m(StoredSequence(written / "replica")) - expected).max() < 1e-3
    content = yaml.safe_load(
        filled(system_files("nice-slam"), written / "replica")["nice-slam.yaml"]
    )
    assert np.abs(np.array(content["mapping"]["bound"]) - expected).max() < 2e-3


def test_bounds_of_a_model_are_its_own_and_five_percent(written, tmp_path):
    vertices = np.array([[0.0, 0, 0], [4, 0, 0], [0, 2, 1]])
    write_ply(tmp_path / "room.ply", vertices, np.array([[0, 1, 2]]))
    bounds = bounds_m(StoredSequence(written / "replica"), tmp_path / "room.ply")
    assert np.allclose(bounds, [[-0.2, 4.2], [-0.1, 2.1], [-0.05, 1.05]])


def test_the_command_writes_beside_the_sequence_and_names_the_format_it_needs(
    written, tmp_path, command_here
):
    code, said, _ = command_here("settings", "monogs", written / "replica", "-o", tmp_path)
    assert code == 0 and str(tmp_path / "monogs.yaml") in said
    code, _, said = command_here("settings", "okvis2", written / "replica")
    assert code == 2 and "a sequence in the format euroc for okvis2, found no mav0" in said
    assert "--format euroc" in said
    code, _, said = command_here("settings", "imap", written / "replica")
    assert code == 2 and "a system (basalt, co-slam" in said
