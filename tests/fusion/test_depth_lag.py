"""Depth images that were taken beside their colour images have the poses of their own stamps."""

import numpy as np
import pytest
from iclnuim.formats.files import write_json
from iclnuim.formats.png import write_png
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.rgbd_sequence import open_sequence
from iclnuim.trajectory_files.trajectories import write_trajectory
from moving_box import CAMERA, depth_z_m, distance_m, hand_held_at

pytest.importorskip("numba")
from iclnuim.benchmark.fusion.sequence import FuseSettings, fuse_sequence  # noqa: E402
from iclnuim.benchmark.odometry.run import run_odometers  # noqa: E402
from iclnuim.headless.cli import main  # noqa: E402

FRAMES = 24
SEED = 8


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """A sequence whose depth images were taken this many ms after the colour images, with ground
    truth at 100 Hz: ms -> folder.
    """

    def make(lag_ms: float):
        folder = tmp_path_factory.mktemp("late")
        times_s = np.arange(FRAMES) / 30
        lists = {"rgb": [], "depth": []}
        for i, T in enumerate(hand_held_at(times_s + lag_ms / 1e3, SEED)):
            depth = np.rint(5000 * depth_z_m(T)).astype(np.uint16)
            grey = np.full((*depth.shape, 3), 100 + i, np.uint8)
            for kind, image, late_s in (("rgb", grey, 0.0), ("depth", depth, lag_ms / 1e3)):
                (folder / kind).mkdir(exist_ok=True)
                write_png(folder / kind / f"{i:06}.png", image)
                stamp_s = 1 + times_s[i] + late_s
                lists[kind].append(f"{stamp_s:.6f} {kind}/{i:06}.png\n")
        for kind, lines in lists.items():
            (folder / f"{kind}.txt").write_text("".join(lines))
        write_json(folder / "camera.json", CAMERA.to_dict() | {"depth_units_per_metre": 5000})
        tracked_s = np.arange(-5, 100) / 100
        truth = Trajectory(1 + tracked_s, hand_held_at(tracked_s, SEED))
        write_trajectory(folder / "groundtruth.txt", truth, "tum")
        return folder

    return {lag_ms: make(lag_ms) for lag_ms in (0, 5, 15, 30)}


def test_fused_depth_is_as_near_the_surface_as_without_lag(late):
    settings = FuseSettings()
    in_time_m, late_m = (
        float(distance_m(fuse_sequence(late[lag_ms], settings=settings).mesh.points).mean())
        for lag_ms in (0, 30)
    )
    assert late_m <= 1.2 * in_time_m


@pytest.mark.parametrize("lag_ms", [0, 5, 15, 30])
def test_inspect_finds_that_late_depth_fits_the_poses(late, lag_ms):
    found = inspect_sequence(late[lag_ms])
    assert not found.errors
    assert found.figures["depth_fits_poses_percent"] <= 0.02


def test_a_frame_has_the_pose_of_its_depth_beside_that_of_its_colour(late):
    frame = open_sequence(late[15])[10]
    both = hand_held_at(10 / 30 + np.array([0.0, 0.015]), SEED)
    for found, true in zip((frame.T_world_camera, frame.T_world_depth), both, strict=True):
        np.testing.assert_allclose(found.matrix, true.matrix, atol=2e-4)
    assert np.median(distance_m(frame.points())) < 5e-4
    same = open_sequence(late[0])[10]
    assert (same.T_world_depth.matrix == same.T_world_camera.matrix).all()


def test_icp_has_the_stamps_of_depth_and_others_those_of_colour(late):
    icp, dvo = run_odometers(["icp", "dvo"], late[15], frames=4)
    depth_s, colour_s = ([one.stamp_s for one in run.frames] for run in (icp, dvo))
    np.testing.assert_allclose(np.subtract(depth_s, colour_s), 0.015, atol=1e-6)


@pytest.mark.parametrize(("method", "is_noted"), [("icp", False), ("dvo", True)])
def test_methods_that_read_both_images_get_a_note_of_the_lag(late, capsys, method, is_noted):
    assert main(["odometry", method, str(late[15]), "--frames", ":3"]) == 0
    noted = f"15 ms beside their colour images (median): {method} use" in capsys.readouterr().err
    assert noted == is_noted


@pytest.mark.parametrize("format", ["tum", "euroc", "eth3d", "vslam-lab", "edex"])
def test_formats_with_two_lists_keep_the_stamps_of_depth(late, tmp_path, capsys, format):
    out = tmp_path / "out"
    assert main(["convert", str(late[15]), str(out), "--format", format]) == 0
    assert "get the stamps of their colour images" not in capsys.readouterr().err
    found = [open_sequence(folder).pairs for folder in (late[15], out)]
    assert len(found[0]) == len(found[1]) == FRAMES
    for one, other in zip(*found, strict=True):
        assert other.stamp_s == pytest.approx(one.stamp_s, abs=1e-6)
        assert other.depth_stamp_s - other.stamp_s == pytest.approx(0.015, abs=1e-6)


@pytest.mark.parametrize("format", ["scannet", "rtabmap"])
def test_formats_with_one_stamp_say_by_how_much_depth_is_beside_it(late, tmp_path, capsys, format):
    assert main(["convert", str(late[15]), str(tmp_path / "out"), "--format", format]) == 0
    assert "up to 15 ms from their own" in capsys.readouterr().err
