"""inspect finds what was put wrong, names it, and finds nothing in what is right."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from iclnuim.formats.files import read_json, write_json
from iclnuim.formats.png import read_depth16, write_png
from iclnuim.geometry import axes
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.frame_source import run_frames
from iclnuim.sequences.inspection import Inspection, inspect_distances, inspect_sequence
from iclnuim.sequences.official_archives import ARCHIVES, archive_of, described
from iclnuim.sequences.run_folder import open_run
from iclnuim.sequences.writer import write_sequence
from iclnuim.trajectory_files.source import LoadedTrajectory, ReadAs
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Twelve frames of a moving camera in a box-shaped room, ray-traced: poses and depth belong
    together.
    """
    folder = tmp_path_factory.mktemp("sound")
    camera = PinholeCamera.parse("96x72")
    t = np.linspace(0, 1, 12)[:, None]
    twists = np.hstack([t * [0.3, -0.2, 0.4], t * [0.15, 0.3, -0.1]])
    truth = Trajectory.at_rate(SE3.exp(twists))
    recipe = {
        "job": {"camera": camera.to_dict()},
        "trajectory_sha256": "a",
        "scene_sha256": "b",
        "blender": "none",
    }
    run = open_run(folder / "raw", recipe, truth)
    low, high = np.array([-1.5, -1.1, -1.0]), np.array([2.0, 1.3, 3.0])
    for i in range(12):
        T = truth.T_world_camera[i]
        rays = camera.rays() @ T.rotation.T
        with np.errstate(divide="ignore"):
            reach = np.maximum((low - T.translation) / rays, (high - T.translation) / rays)
        depth = reach.min(-1)
        run.write_frame(i, np.repeat((depth / 5)[..., None], 3, -1), depth)
    write_sequence(run_frames(run.path), folder / "sequence")
    return folder / "sequence"


@pytest.fixture
def folder(sound, tmp_path):
    shutil.copytree(sound, tmp_path / "sequence")
    return tmp_path / "sequence"


def test_nothing_is_wrong_with_a_sound_sequence(sound):
    found = inspect_sequence(sound)
    assert (found.errors, found.warnings) == ([], [])
    assert found.figures["pairs"] == 12 and found.figures["rate_hz"] == 30
    assert found.figures["depth_fits_poses_mm"] < 10
    assert found.figures["depth_fits_poses_percent"] < 0.1
    assert "explanation" not in found.figures


def test_left_handed_poses_are_seen_by_the_depth(folder):
    from iclnuim.trajectory_files.trajectories import read_trajectory

    truth = read_trajectory(folder / "groundtruth.txt").trajectory
    mirrored = Trajectory(truth.stamps_s, axes.mirrored_y(truth.T_world_camera))
    write_trajectory(folder / "groundtruth.txt", mirrored, "tum")
    found = inspect_sequence(folder)
    assert any("a left-handed camera" in sentence for sentence in found.errors)
    assert [one["kind"] for one in found.explanations] == ["mirrored"]


def test_poses_of_another_sequence_are_seen(folder):
    twists = np.random.default_rng(1).normal(0, 0.4, (12, 6))
    write_trajectory(folder / "groundtruth.txt", Trajectory.at_rate(SE3.exp(twists)), "tum")
    assert any("do not match" in sentence for sentence in inspect_sequence(folder).errors)


def test_a_wrong_depth_scale_is_guessed(folder):
    for path in (folder / "depth").glob("*.png"):
        write_png(path, (read_depth16(path) // 20).astype(np.uint16))
    wrong = " ".join(inspect_sequence(folder).errors)
    assert "with 5000 units per metre: 1000 units per metre would give" in wrong


def test_colour_images_of_16_bits_which_no_odometer_reads_are_an_error(folder):
    for path in (folder / "rgb").glob("*.png"):
        write_png(path, np.full((72, 96, 3), 30_000, np.uint16))
    assert "rgb images are 96 x 72, 16-bit RGB, not 8-bit RGB" in inspect_sequence(folder).errors


@pytest.mark.parametrize("black", [1, 12])
def test_black_colour_images_are_a_warning_and_an_error_if_all_are(folder, black):
    for path in sorted((folder / "rgb").glob("*.png"))[:black]:
        write_png(path, np.zeros((72, 96, 3), np.uint8))
    found, sentence = (
        inspect_sequence(folder),
        f"{black} of 12 inspected colour images are black, the first 000000.png",
    )
    assert (found.errors, found.warnings) == (([sentence], []) if black == 12 else ([], [sentence]))


def test_clipped_depth_is_seen(folder):
    path = folder / "depth/000000.png"
    units = read_depth16(path)
    units[:10] = 65535
    write_png(path, units)
    assert any("depth was clipped" in sentence for sentence in inspect_sequence(folder).errors)


def test_missing_unlisted_broken_and_odd_images_are_named(folder):
    (folder / "rgb/000003.png").unlink()
    shutil.copy(folder / "rgb/000004.png", folder / "rgb/000099.png")
    data = (folder / "depth/000005.png").read_bytes()
    (folder / "depth/000005.png").write_bytes(data[:-40])
    write_png(folder / "rgb/000006.png", np.zeros((10, 10, 3), np.uint8))
    write_png(folder / "depth/000007.png", np.zeros((72, 96, 3), np.uint8))
    found = inspect_sequence(folder)
    wrong = "\n".join(found.errors)
    assert "1 images in the lists do not exist: 000003.png" in "\n".join(found.warnings)
    assert "000005.png: expected a whole PNG image, found a truncated file" in wrong
    assert "rgb images differ: 10 of 96 x 72, 8-bit RGB, 1 of 10 x 10, 8-bit RGB" in wrong
    assert "not 16-bit grey" in wrong
    assert "the camera is 96 x 72, images are 10 x 10" in wrong
    assert any("000099.png" in sentence for sentence in found.warnings)


def test_gaps_stamps_poses_and_camera_are_checked(folder):
    lines = (folder / "associations.txt").read_text().splitlines()
    (folder / "associations.txt").write_text("\n".join(lines[:5] + lines[8:]) + "\n")
    poses = (folder / "groundtruth.txt").read_text().splitlines()
    (folder / "groundtruth.txt").write_text("\n".join(poses[:3] + poses[4:]) + "\n")
    camera = read_json(folder / "camera.json")
    write_json(folder / "camera.json", {**camera, "cx": 48.0, "cy": 36.0})
    odd = "\n".join(inspect_sequence(folder).warnings)
    assert "1 gaps in time, the longest 0.133 s, the first after 000004.png" in odd
    assert "1 frames without a pose: 000002.png" in odd
    assert "3 poses without a frame" in odd
    assert "half a pixel off" in odd


@pytest.mark.parametrize(("left", "is_wrong"), [(4, True), (6, False)])
def test_poses_of_less_than_half_of_the_frames_are_an_error_with_both_times(folder, left, is_wrong):
    lines = (folder / "groundtruth.txt").read_text().splitlines()
    poses = [line for line in lines if not line.startswith("#")]
    (folder / "groundtruth.txt").write_text("\n".join(poses[:left]) + "\n")
    found = inspect_sequence(folder)
    said = "\n".join(found.errors if is_wrong else found.warnings)
    assert f"{len(poses) - left} frames without a pose" in said
    assert ("those of poses are 1.000 to 1.100 s" in said) == is_wrong


def test_a_folder_of_nothing_and_a_list_that_is_broken_are_findings_not_errors(folder, tmp_path):
    assert "pairs of colour and depth images" in inspect_sequence(tmp_path).errors[0]
    (folder / "associations.txt").write_text("1 2\n")
    assert "4 columns" in inspect_sequence(folder).errors[0]
    (folder / "associations.txt").unlink()
    (folder / "groundtruth.txt").unlink()
    assert "no ground truth" in inspect_sequence(folder).warnings[0]


def test_the_official_sequence_is_right_and_so_is_its_handedness(samples):
    found = inspect_sequence(samples / "or_kt0")
    assert found.errors == []
    assert found.figures["pairs"] == 120 and found.figures["poses"] == 1507
    assert found.figures["depth_fits_poses_mm"] < 3
    assert found.figures["depth_fits_poses_percent"] < 0.01
    said = found.figures["published_as"]
    assert said.startswith("office kt0 of 2014 (traj0_frei_png): left-handed poses")
    assert "fy = -480" in said and "its first pose number 2" in said


def test_the_living_room_is_told_from_the_office_and_other_paths_are_no_archive(samples):
    truth = samples / "trajectories/livingRoom0.gt.freiburg.recomputed"
    loaded = read_trajectory(truth, "gt.freiburg")
    archive = archive_of(loaded)
    assert (archive.room, archive.name) == ("living room", "kt0")
    assert archive.file == "living_room_traj0_frei_png"
    assert "1.84 m/s" in described(archive, loaded)
    fewer = loaded.trajectory[2:]
    assert archive_of(replace(loaded, trajectory=fewer)) is None
    other = Trajectory(
        loaded.trajectory.stamps_s,
        SE3(loaded.trajectory.T_world_camera.rotation, 1.02 * loaded.trajectory.positions_m),
    )
    assert archive_of(replace(loaded, trajectory=other)) is None


@pytest.mark.parametrize("archive", ARCHIVES, ids=lambda each: each.file)
@pytest.mark.parametrize("times_as_long", [0.98, 0.992, 1.0, 1.008, 1.02])
def test_an_archive_is_told_by_its_poses_and_its_length_within_a_hundredth(archive, times_as_long):
    along_m = np.linspace(0, times_as_long * archive.length_m, archive.poses)
    positions_m = np.stack([along_m, 0 * along_m, 0 * along_m], -1)
    poses = SE3(np.broadcast_to(np.eye(3), (archive.poses, 3, 3)), positions_m)
    loaded = LoadedTrajectory(
        Trajectory(np.arange(archive.poses) / 30, poses), ReadAs("tum", "right", "", "")
    )
    found = archive_of(loaded)
    assert found is (archive if abs(times_as_long - 1) < 0.01 else None)


def test_depth_images_of_another_size_are_listed_and_do_not_end_the_inspection(sound, tmp_path):
    shutil.copytree(sound, tmp_path / "s")
    for image in (tmp_path / "s/depth").glob("*.png"):
        write_png(image, np.ascontiguousarray(read_depth16(image)[:40]))
    found = inspect_sequence(tmp_path / "s")
    expected = "inspected depth images are not of the camera's size 96 x 72: 000000.png is 96 x 40"
    assert any(expected in line for line in found.errors)
    assert not any("no depth" in line for line in found.errors)


def test_ground_truth_images_need_no_partner(sound, tmp_path):
    shutil.copytree(sound, tmp_path / "s")
    for kind in ("instance", "class", "normal"):
        shutil.copy(tmp_path / "s/depth/000001.png", tmp_path / f"s/depth/{kind}000001.png")
    assert not any("partner" in line for line in inspect_sequence(tmp_path / "s").warnings)
    shutil.copy(tmp_path / "s/depth/000001.png", tmp_path / "s/depth/normal_light.png")
    assert any("normal_light.png" in line for line in inspect_sequence(tmp_path / "s").warnings)


@pytest.mark.parametrize("prefix", ["classroom", "normal"])
def test_images_in_the_lists_are_found_whatever_their_names(sound, tmp_path, prefix):
    shutil.copytree(sound, tmp_path / "s")
    for kind in ("rgb", "depth"):
        for image in (tmp_path / "s" / kind).glob("*.png"):
            image.rename(image.with_name(prefix + image.name))
    for lists in (
        tmp_path / "s/rgb.txt",
        tmp_path / "s/depth.txt",
        tmp_path / "s/associations.txt",
    ):
        lists.write_text(re.sub("(rgb|depth)/", rf"\1/{prefix}", lists.read_text()))
    assert inspect_sequence(tmp_path / "s").errors == inspect_sequence(sound).errors == []


def test_depth_at_the_first_and_the_last_pose_is_compared():
    """Before a wall that is 2 m away at first, and half a centimetre nearer at the end."""
    camera = PinholeCamera.parse("96x72")
    truth = Trajectory.at_rate(SE3.exp(np.linspace(0, 1, 5)[:, None] * [0, 0, 0.02, 0, 0, 0]))
    depths = [(truth.stamps_s[i], np.full((72, 96), z_m)) for i, z_m in ((0, 2.0), (-1, 1.985))]
    result = Inspection(Path("a"))
    inspect_distances(result, depths, truth, camera)
    assert result.figures["depth_fits_poses_mm"] == pytest.approx(5, abs=0.1)
