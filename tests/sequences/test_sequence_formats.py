"""Every sequence format against an independent reading of it."""

import argparse
import csv
import dataclasses
import json
import shutil

import numpy as np
import pytest
from iclnuim.channels import RGB
from iclnuim.errors import InputError
from iclnuim.formats.ply import read_ply
from iclnuim.formats.png import read_depth16, write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless.farm.run_plan import RunPlan
from iclnuim.headless.farm.tasks import SequenceStage
from iclnuim.headless.options import add_settings
from iclnuim.job import RenderJob
from iclnuim.sensor.models import depth_model
from iclnuim.sequences.camera_files import SequenceCamera
from iclnuim.sequences.frame_source import image_frames, original_frames, run_frames
from iclnuim.sequences.frames import Row, SequenceFrame, posed
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.sequence_options import SequenceOptions, SequenceSettings
from iclnuim.sequences.stored_sequence import StoredSequence, read_images
from iclnuim.sequences.writer import SequenceWriter, write_sequence
from iclnuim.trajectory_files import trajectories
from iclnuim.trajectory_files.trajectories import read_trajectory
from sequences.conftest import sloping_m


@pytest.fixture
def truth(shared_run):
    return read_trajectory(shared_run.path / "groundtruth.txt", "tum").trajectory


def test_the_same_images_lie_in_every_format(all_formats):
    places = {
        "tum": ("rgb/000002.png", "depth/000002.png"),
        "icl-nuim": ("rgb/000002.png", "depth/000002.png"),
        "eth3d": ("rgb/0000000001.066667.png", "depth/0000000001.066667.png"),
        "vslam-lab": ("rgb_0/000002.png", "depth_0/000002.png"),
    }
    for index in (0, 1):
        assert (
            len(
                {(all_formats / name / paths[index]).read_bytes() for name, paths in places.items()}
            )
            == 1
        )
    assert all((all_formats / name / "recipe.json").is_file() for name in places)


def test_icl_nuim_has_integer_ids_depth_first_left_handed_poses_and_no_pose_for_image_0(
    all_formats, truth
):
    folder = all_formats / "icl-nuim"
    line = (folder / "associations.txt").read_text().splitlines()[1]
    assert line == "1 depth/000001.png 1 rgb/000001.png"
    k = np.loadtxt(folder / "calibration.txt")
    assert np.allclose(k, [[48, 0, 31.5], [0, -48, 23.5], [0, 0, 1]])
    rows = np.loadtxt(folder / "groundtruth.gt.freiburg")
    assert rows[:, 0].tolist() == [1, 2, 3]
    assert np.allclose(rows[0, 1:], [0, 0, -2.25, 0, 0, 0, 1])
    # T(i) = [I, (0, 0, -2.25)] T(1)^-1 T(i), y mirrored
    from scipy.spatial.transform import Rotation

    S = np.diag([1.0, -1, 1])
    T = truth.T_world_camera.matrix
    for row, i in zip(rows, (1, 2, 3), strict=True):
        relative = np.linalg.inv(T[1]) @ T[i]
        assert np.allclose(row[1:4], S @ relative[:3, 3] + [0, 0, -2.25], atol=1e-8)
        assert np.allclose(
            Rotation.from_quat(row[4:]).as_matrix(), S @ relative[:3, :3] @ S, atol=1e-8
        )


def test_gt_sim_has_the_motions_of_gt_freiburg(all_formats):
    folder = all_formats / "icl-nuim"
    blocks = np.loadtxt(folder / "groundtruth.gt.sim").reshape(-1, 3, 4)
    poses = read_trajectory(folder / "groundtruth.gt.freiburg").trajectory.T_world_camera
    sim = read_trajectory(folder / "groundtruth.gt.sim").trajectory.T_world_camera
    assert len(blocks) == len(sim) == len(poses) == 3
    motions = [(T[0].inverse() @ T).matrix for T in (sim, poses)]
    assert np.allclose(motions[0], motions[1], atol=1e-7)


def test_a_folder_with_an_official_name_has_the_ground_truth_that_gradslam_reads(run, tmp_path):
    for name, truth in (
        ("living_room_traj2_frei_png", "livingRoom2n"),
        ("traj0_frei_png", "traj0n"),
    ):
        frames = run_frames(run.path, "1:")
        write_sequence(frames, tmp_path / name, formats=("icl-nuim",))
        lines = (tmp_path / name / "associations.txt").read_text().splitlines()
        blocks = np.loadtxt(tmp_path / name / f"{truth}.gt.sim").reshape(-1, 3, 4)
        assert len(lines) == len(blocks) == 3 and lines[0].startswith("1 ")
        assert (tmp_path / name / f"{truth}.gt.freiburg").is_file()


def test_nerf_has_names_for_training_and_test_and_points_of_the_surface(all_formats, truth):
    content = json.loads((all_formats / "nerf/transforms.json").read_text())
    held_out = content["test_filenames"]
    assert held_out == content["val_filenames"] == ["images/000000.png"]
    names = [frame["file_path"] for frame in content["frames"]]
    assert sorted(held_out + content["train_filenames"]) == sorted(names)
    points = read_ply(all_formats / "nerf" / content["ply_file_path"]).points
    theirs = np.loadtxt(all_formats / "colmap/sparse/0/points3D.txt", usecols=(1, 2, 3))
    assert np.allclose(points, theirs, atol=1e-5)


def test_euroc_has_nanoseconds_and_the_quaternions_scalar_first(all_formats, truth):
    mav = all_formats / "euroc/mav0"
    for sensor in ("cam0", "depth0"):
        rows = list(csv.reader((mav / sensor / "data.csv").open()))[1:]
        assert [int(row[0]) for row in rows] == [1000000000, 1033333000, 1066667000, 1100000000]
        assert all((mav / sensor / "data" / row[1]).is_file() for row in rows)
        assert "intrinsics: [48, 48, 31.5, 23.5]" in (mav / sensor / "sensor.yaml").read_text()
    rows = np.loadtxt(mav / "state_groundtruth_estimate0/data.csv", delimiter=",")
    assert np.allclose(rows[:, 1:4], truth.positions_m, atol=1e-8)
    quat_wxyz = np.roll(truth.T_world_camera.quat_xyzw, 1, axis=1)
    assert rows.shape == (4, 17) and np.allclose(rows[:, 4:8], quat_wxyz, atol=1e-8)
    steps = (rows[2:, 1:4] - rows[:-2, 1:4]) / (truth.stamps_s[2:] - truth.stamps_s[:-2])[:, None]
    assert np.allclose(rows[1:-1, 8:11], steps, rtol=1e-3, atol=1e-6)
    assert not rows[:, 11:].any()


def test_nerf_poses_project_as_the_cv_camera_does(all_formats, truth):
    content = json.loads((all_formats / "nerf/transforms.json").read_text())
    point = np.array([0.3, -0.2, 5.0])  # world
    for i, frame in enumerate(content["frames"]):
        x, y, z, _ = np.linalg.inv(np.array(frame["transform_matrix"])) @ [*point, 1]
        u = (
            content["fl_x"] * x / -z + content["cx"]
        )  # an OpenGL camera looks along -z, pixel centres at +0.5
        v = content["fl_y"] * -y / -z + content["cy"]
        ours = PinholeCamera(64, 48, 48, 48, 31.5, 23.5).project(
            truth.T_world_camera[i].inverse().apply(point)
        )
        assert np.allclose([u - 0.5, v - 0.5], ours, atol=1e-6)
        assert (all_formats / "nerf" / frame["file_path"]).is_file()
        assert (all_formats / "nerf" / frame["depth_file_path"]).is_file()


def test_replica_as_nice_slam_reads_it(all_formats, truth):
    """Images in the order of their names, a line of 16 numbers each, camera to world; scale and K
    from cam_params.json.
    """
    folder = all_formats / "replica"
    camera = json.loads((folder / "cam_params.json").read_text())["camera"]
    assert [camera[key] for key in ("w", "h", "fx", "fy", "cx", "cy", "scale")] == [
        64,
        48,
        48,
        48,
        31.5,
        23.5,
        6553.5,
    ]
    lines = np.loadtxt(folder / "traj.txt").reshape(-1, 4, 4)
    assert np.abs(lines - truth.T_world_camera.matrix).max() < 1e-9
    for i, (image, depth) in enumerate(
        zip(
            sorted(folder.glob("results/frame*.jpg")),
            sorted(folder.glob("results/depth*.png")),
            strict=True,
        )
    ):
        assert image.name == f"frame{i:06}.jpg" and image.read_bytes()[:3] == b"\xff\xd8\xff"
        assert np.abs(read_depth16(depth) / 6553.5 - sloping_m(i)).max() <= 0.51 / 6553.5


def test_scannet_as_its_exports_are_read(all_formats, truth):
    folder = all_formats / "scannet/frames"
    for i in range(4):
        assert (
            np.abs(np.loadtxt(folder / f"pose/{i:06}.txt") - truth.T_world_camera[i].matrix).max()
            < 1e-9
        )
        assert (
            np.abs(read_depth16(folder / f"depth/{i:06}.png") / 1000 - sloping_m(i)).max()
            <= 0.51 / 1000
        )
        assert (folder / f"color/{i:06}.jpg").is_file()
    K = np.loadtxt(folder / "intrinsic/intrinsic_depth.txt")
    assert np.array_equal(K, [[48, 0, 31.5, 0], [0, 48, 23.5, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_scannets_own_colour_of_twice_the_size_is_seen_by_the_depth_camera(all_formats, tmp_path):
    shutil.copytree(all_formats / "scannet", tmp_path / "s")
    top = tmp_path / "s/frames"
    (top / "intrinsic/intrinsic_color.txt").write_text("100 0 66 0\n0 100 50 0\n0 0 1 0\n0 0 0 1\n")
    v, u = np.mgrid[
        0:100, 0:132
    ]  # the ramp as a camera of twice the resolution and another K sees it
    for i in range(4):
        (top / f"color/{i:06}.jpg").unlink()
        write_png(top / f"color/{i:06}.png", np.stack([u, v, u * 0], -1).astype(np.uint8))
    pairs, camera = (
        StoredSequence(tmp_path / "s").pairs,
        StoredSequence(tmp_path / "s").camera_of(top / "color/000000.png"),
    )
    colour, depth_z_m = read_images(pairs[2], camera)
    assert colour.shape == (48, 64, 3) and np.abs(depth_z_m - sloping_m(2)).max() < 6e-4
    x, y = (
        np.mgrid[0:48, 0:64][::-1].reshape(2, -1).T - (31.5, 23.5)
    ).T / 48  # rays of the depth camera
    expected = np.stack([100 * x + 66, 100 * y + 50], -1).reshape(48, 64, 2)
    assert np.abs(colour[1:-1, 1:-1, :2] - expected[1:-1, 1:-1]).max() <= 1
    assert inspect_sequence(tmp_path / "s").errors == []


def test_eth3d_as_bad_slam_reads_it(all_formats):
    """One line fx fy cx cy, pixel centres at whole numbers; associated.txt: colour first; images
    named by stamps.
    """
    folder = all_formats / "eth3d"
    assert [float(value) for value in (folder / "calibration.txt").read_text().split()] == [
        48,
        48,
        31.5,
        23.5,
    ]
    line = (folder / "associated.txt").read_text().splitlines()[1]
    stamp = "0000000001.033333"
    assert line == f"{stamp} rgb/{stamp}.png {stamp} depth/{stamp}.png"


def test_tartanair_has_metres_and_poses_in_ned_axes(all_formats, truth):
    from scipy.spatial.transform import Rotation

    folder = all_formats / "tartanair"
    depth = np.load(folder / "depth_left/000002_left_depth.npy")
    assert depth.dtype == np.float32 and np.abs(depth - sloping_m(2)).max() < 1e-6
    rows = np.loadtxt(folder / "pose_left.txt")
    forward, right, down = Rotation.from_quat(rows[:, 3:]).as_matrix().transpose(2, 0, 1)
    to_ned = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # our z up to their z down
    R = truth.T_world_camera.rotation
    for axis, column in ((right, 0), (down, 1), (forward, 2)):  # x right, y down, z forward of ours
        assert np.abs(axis - R[:, :, column] @ to_ned.T).max() < 1e-9
    assert np.abs(rows[:, :3] - truth.positions_m @ to_ned.T).max() < 1e-9


def test_vslam_lab_has_nanoseconds_paths_and_a_calibration(all_formats, truth):
    folder = all_formats / "vslam-lab"
    rows = list(csv.DictReader((folder / "rgb.csv").open()))
    assert [int(row["ts_rgb_0 (ns)"]) for row in rows] == [
        1000000000,
        1033333000,
        1066667000,
        1100000000,
    ]
    assert all(
        (folder / row[f"path_{kind}_0"]).is_file() for row in rows for kind in ("rgb", "depth")
    )
    text = (folder / "calibration.yaml").read_text()
    for item in (
        "focal_length: [48.0, 48.0]",
        "depth_factor: 5000.0",
        "image_dimension: [64, 48]",
        "depth_name: depth_0",
    ):
        assert item in text
    poses = list(csv.reader((folder / "groundtruth.csv").open()))
    assert poses[0] == ["ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qx", "qy", "qz", "qw"]
    assert np.allclose(np.array(poses[1:], float)[:, 4:], truth.T_world_camera.quat_xyzw, atol=1e-9)


def test_rtabmap_finds_a_stamp_in_every_name(all_formats):
    for kind in ("rgb_sync", "depth_sync"):
        names = sorted(path.stem for path in (all_formats / "rtabmap" / kind).iterdir())
        stamps = ("1.000000", "1.033333", "1.066667", "1.100000")
        assert names == [f"000000000{stamp}" for stamp in stamps]


def colmap_points(model):
    """(n, 3) points of points3D.txt, and by COLMAP's own formulas the distance in pixels of each
    observation from its point.
    """
    from scipy.spatial.transform import Rotation

    lines = [
        line for line in (model / "images.txt").read_text().split("\n") if not line.startswith("#")
    ]
    fx, fy, cx, cy = map(float, (model / "cameras.txt").read_text().split()[-4:])
    points = {int(row[0]): row[1:4] for row in np.loadtxt(model / "points3D.txt", usecols=range(4))}
    found = []
    for head, seen in zip(lines[0::2], lines[1::2], strict=False):
        if not head:
            break
        w, x, y, z, *t = map(float, head.split()[1:8])
        R = Rotation.from_quat([x, y, z, w]).as_matrix()
        for u, v, number in np.array(seen.split(), float).reshape(-1, 3):
            p = R @ points[int(number)] + t
            found.append(np.hypot(fx * p[0] / p[2] + cx - u, fy * p[1] / p[2] + cy - v))
    return np.array(list(points.values())), np.array(found)


def test_colmap_points_lie_on_the_true_surface_also_of_a_noisy_sequence_and_are_seen_where_it_says(
    run, tmp_path
):
    poses = read_trajectory(run.path / "groundtruth.txt", "tum").trajectory
    noisy = SequenceSettings(depth_model("kinect2012"), seed=1)
    write_sequence(run_frames(run.path), tmp_path / "out", noisy, ["colmap"], workers=1)
    model = tmp_path / "out/sparse/0"
    points, distances_px = colmap_points(model)
    assert len(points) > 1000 and distances_px.max() < 0.1
    rows = [line.split() for line in (model / "points3D.txt").read_text().splitlines()[1:]]
    first = [k for k, row in enumerate(rows) if row[8] == "3"]  # taken from the third image
    camera = PinholeCamera(64, 48, 48, 48, 31.5, 23.5)
    p = poses.T_world_camera[2].inverse().apply(points[first])
    u, v = np.rint(camera.project(p)).astype(int).T
    assert np.abs(p[:, 2] - sloping_m(2)[v, u]).max() < 1e-5
    held_out = (model / "test.txt").read_text().split()
    assert held_out == ["000000.png"] and len(list((tmp_path / "out/images").glob("*.png"))) == 4


def test_orb_slam3_settings_are_read_by_opencv(all_formats):
    cv2 = pytest.importorskip("cv2")
    storage = cv2.FileStorage(str(all_formats / "tum/orb_slam3.yaml"), cv2.FILE_STORAGE_READ)
    values = [storage.getNode(f"Camera1.{name}").real() for name in ("fx", "fy", "cx", "cy")]
    assert values == [48, 48, 31.5, 23.5]
    assert storage.getNode("RGBD.DepthMapFactor").real() == 5000
    assert storage.getNode("Camera.type").string() == "PinHole"


@pytest.mark.parametrize("name", FORMATS)
def test_our_own_reader_takes_back_what_was_written(all_formats, shared_run, truth, name):
    source, frames = image_frames(all_formats / name), run_frames(shared_run.path)
    units = FORMATS[name].limits.fixed_units or 5000
    jpeg = FORMATS[name].image(SequenceFrame(0, 1.0), RGB).endswith(".jpg")
    assert source.numbers == frames.numbers
    assert source.camera.to_dict() == pytest.approx(frames.camera.to_dict())
    assert [source.stamps_s[n] for n in source.numbers] == pytest.approx(
        [frames.stamps_s[n] for n in frames.numbers]
    )
    for number in frames.numbers:
        (light, depth), (light_there, depth_there) = frames.load(number), source.load(number)
        assert np.abs(depth - depth_there).max() <= 0.5 / units + 1e-6
        assert np.abs(light.astype(float) - light_there).max() < (0.03 if jpeg else 0.006)
    there = source.truth_of(source.numbers)
    kept = {
        round(stamp_s * 30) - 30: T
        for stamp_s, T in zip(there.stamps_s, there.T_world_camera, strict=True)
    }
    assert set(kept) == ({1, 2, 3} if name == "icl-nuim" else {0, 1, 2, 3})
    for i in (2, 3):  # whatever the world: the same motion
        motion = truth.T_world_camera[1].inverse() @ truth.T_world_camera[i]
        assert np.allclose((kept[1].inverse() @ kept[i]).matrix, motion.matrix, atol=1e-7)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("nerf/transforms.json", '"frames"', '"views"', "a list of frames"),
        ("nerf/transforms.json", '"file_path"', '"path"', "file_path, found frame 0"),
        ("nerf/transforms.json", '"depth_', '"d_', "depth_file_path or depth_path, found none"),
        ("nerf/transforms.json", '"fl_x": ', '"fl_x": "wide", "f": ', "a number for fl_x"),
        ("euroc/mav0/cam0/data.csv", "1033333000,", "a,", "lines `nanoseconds,image`"),
        (
            "euroc/mav0/depth0/sensor.yaml",
            "intrinsics: [48",
            "intrinsics: [x",
            "intrinsics: .fx, fy, cx, cy.",
        ),
    ],
)
def test_damaged_lists_of_other_forms_are_one_line(all_formats, tmp_path, file, old, new, message):
    shutil.copytree(all_formats / file.split("/")[0], tmp_path / file.split("/")[0])
    path = tmp_path / file
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=message) as error:
        image_frames(tmp_path / file.split("/")[0])
    assert "\n" not in str(error.value)


def test_a_new_format_is_one_entry_of_the_registry(run, tmp_path, monkeypatch):
    """Here with names and a marker of its own; all else is TUM's."""
    own = dataclasses.replace(
        FORMATS["tum"],
        name="own",
        image=lambda frame, kind: f"{kind}_{frame.number}.png",
        write_texts=lambda folder, contents, format: (folder / "own.txt").write_text(
            str(len(contents.frames))
        ),
        reader=dataclasses.replace(
            FORMATS["tum"].reader,
            found=lambda folder: (folder / "own.txt").is_file(),
            rows=lambda folder: [
                Row(1 + i / 30, folder / f"rgb_{i}.png", folder / f"depth_{i}.png", number=i)
                for i in range(int((folder / "own.txt").read_text()))
            ],
        ),
    )
    monkeypatch.setitem(FORMATS, "own", own)
    write_sequence(run_frames(run.path), tmp_path / "out", formats=("own",), workers=1)
    assert [pair.rgb.name for pair in StoredSequence(tmp_path / "out").pairs] == [
        f"rgb_{i}.png" for i in range(4)
    ]
    parser = argparse.ArgumentParser()
    add_settings(parser, SequenceOptions, ("formats",))
    assert "own" in parser.format_help()


def test_one_format_lies_in_the_folder_itself_and_others_are_added_in_folders_of_their_own(
    run, tmp_path
):
    write_sequence(run_frames(run.path), tmp_path / "out", formats=("colmap",))
    assert (tmp_path / "out/sparse/0/images.txt").is_file() and (
        tmp_path / "out/images/000000.png"
    ).is_file()
    before = (tmp_path / "out/sparse/0/images.txt").read_bytes()
    with pytest.raises(InputError, match="format colmap there, tum requested"):
        write_sequence(run_frames(run.path), tmp_path / "out")
    write_sequence(run_frames(run.path), tmp_path / "out", formats=("tum", "euroc"))
    assert (tmp_path / "out/tum/rgb.txt").is_file() and (
        tmp_path / "out/sparse/0/images.txt"
    ).read_bytes() == before
    with pytest.raises(InputError, match="format colmap there, tum requested"):
        write_sequence(run_frames(run.path), tmp_path / "out")
    assert write_sequence(run_frames(run.path), tmp_path / "out", formats=("colmap",)).made == 0


def test_what_a_format_cannot_say_is_refused_before_anything_is_written(run, tmp_path):
    with pytest.raises(InputError, match="a sequence format .tum, icl-nuim, euroc, nerf."):
        write_sequence(run_frames(run.path), tmp_path / "out", formats=("kitti",))
    with pytest.raises(InputError, match="at least two poses for the format nerf"):
        write_sequence(run_frames(run.path, "0"), tmp_path / "out", formats=("nerf",))
    assert not (tmp_path / "out").exists()


def test_pairs_are_found_by_lists_by_stamps_or_by_name(run, tmp_path):
    out = tmp_path / "out"
    write_sequence(run_frames(run.path), out)
    by_association = StoredSequence(out).pairs
    (out / "associations.txt").unlink()
    by_lists = StoredSequence(out).pairs
    (out / "rgb.txt").unlink()
    by_name = StoredSequence(out).pairs
    for pairs in (by_lists, by_name):
        assert [(p.number, p.rgb, p.depth) for p in pairs] == [
            (p.number, p.rgb, p.depth) for p in by_association
        ]
        assert np.allclose([p.stamp_s for p in pairs], [p.stamp_s for p in by_association])
    with pytest.raises(InputError, match="pairs of colour and depth images.*found none"):
        assert StoredSequence(tmp_path).pairs


@pytest.mark.parametrize("character", ["\x85", "\u2028", "\x0c"])
def test_only_line_feeds_end_the_lines_of_lists(all_formats, tmp_path, character):
    for name in ("tum", "vslam-lab"):
        shutil.copytree(all_formats / name, tmp_path / name)
    path = tmp_path / "tum/associations.txt"
    path.write_text(f"# recorded{character}in the lab\n{path.read_text()}")
    assert [pair.written for pair in StoredSequence(tmp_path / "tum").pairs] == [
        p.written for p in StoredSequence(all_formats / "tum").pairs
    ]
    path, pair = tmp_path / "vslam-lab/rgb.csv", StoredSequence(tmp_path / "vslam-lab").pairs[0]
    image = pair.rgb
    path.write_text(path.read_text().replace(image.name, f"a{character}b.png"))
    for each in (image, pair.depth):
        each.rename(each.with_name(f"a{character}b.png"))
    assert StoredSequence(tmp_path / "vslam-lab").pairs[0].rgb.name == f"a{character}b.png"


def test_lists_whose_stamps_do_not_meet_are_refused_and_not_replaced_by_names(run, tmp_path):
    out = tmp_path / "out"
    write_sequence(run_frames(run.path), out)
    (out / "associations.txt").unlink()
    later = [
        f"9{line[1:]}" if line[0] == "1" else line
        for line in (out / "rgb.txt").read_text().splitlines()
    ]
    (out / "rgb.txt").write_text("\n".join(later))
    with pytest.raises(
        InputError,
        match=r"near those in rgb.txt, found rgb 9\.\d+\.\.9\.\d+ s; depth 1\.\d+\.\.1\.\d+ s",
    ):
        assert StoredSequence(out).pairs


@pytest.mark.parametrize("ending", [".jpg", ".jpeg"])
@pytest.mark.parametrize("names", [("0", "1"), ("1.250000", "1.283333")])
def test_colour_as_jpeg_is_paired_by_name_and_by_stamp_and_png_comes_first(tmp_path, names, ending):
    for kind, end in (("rgb", ending), ("depth", ".png")):
        (tmp_path / kind).mkdir()
        for name in names:
            (tmp_path / kind / f"{name}{end}").touch()
    assert [p.rgb.name for p in StoredSequence(tmp_path).pairs] == [
        f"{name}{ending}" for name in names
    ]
    (tmp_path / f"rgb/{names[0]}.png").touch()
    assert [p.rgb.name for p in StoredSequence(tmp_path).pairs] == [
        f"{names[0]}.png",
        f"{names[1]}{ending}",
    ]


@pytest.mark.parametrize(
    ("names", "stamps_s"),
    [
        (["frame_9", "frame_10", "frame_12"], [1 + 9 / 30, 1 + 10 / 30, 1 + 12 / 30]),
        (["9", "10", "12"], [1 + 9 / 30, 1 + 10 / 30, 1 + 12 / 30]),
        (
            ["1403636579763555584", "1403636579796888917"],
            [1403636579.763555584, 1403636579.796888917],
        ),
        (["a9 left", "a10 left"], [1 + 9 / 30, 1 + 10 / 30]),
        (["1403636579763", "1403636579796"], [1403636579.763, 1403636579.796]),
        (["1403636579763555", "1403636580096888"], [1403636579.763555, 1403636580.096888]),
        (["a right", "b left"], [1, 1 + 1 / 30]),
    ],
    ids=["prefix", "plain", "nanoseconds", "inside", "milliseconds", "3 a second", "none"],
)
def test_numbers_in_names_order_the_images_and_are_their_frames_or_nanoseconds(
    tmp_path, names, stamps_s
):
    for kind in ("rgb", "depth"):
        (tmp_path / kind).mkdir()
        for name in names:
            (tmp_path / kind / f"{name}.PNG").touch()
    pairs = StoredSequence(tmp_path).pairs
    assert [p.rgb.stem for p in pairs] == [p.depth.stem for p in pairs] == names
    assert [p.stamp_s for p in pairs] == pytest.approx(stamps_s, abs=1e-6)
    for pair, name in zip(pairs, names, strict=True):
        digits = pair.written[0].replace(".", "")
        assert digits.startswith(name) if len(name) > 9 else not digits


@pytest.mark.parametrize(
    "names", [("20230105123000123", "20230105123000156"), ("98765432109876", "98765432109877")]
)
def test_names_in_another_unit_of_time_are_refused(tmp_path, names):
    for kind in ("rgb", "depth"):
        (tmp_path / kind).mkdir()
        for name in names:
            (tmp_path / kind / f"{name}.png").touch()
    with pytest.raises(InputError, match=r"found another unit of time; try rgb.txt and depth.txt"):
        assert StoredSequence(tmp_path).pairs


@pytest.mark.parametrize("first", [1, 2])
def test_colour_images_counted_from_another_number_than_depth_images_are_refused(tmp_path, first):
    for kind, start in (("rgb", first), ("depth", 0)):
        (tmp_path / kind).mkdir()
        for number in range(start, start + 5):
            (tmp_path / kind / f"{number:04}.png").touch()
    counted = f"found rgb {first} to {first + 4}, depth 0 to 4; try equal names"
    with pytest.raises(InputError, match=counted):
        assert StoredSequence(tmp_path).pairs
    (tmp_path / "depth/0003.png").unlink()
    assert [pair.number for pair in StoredSequence(tmp_path).pairs] == [
        n for n in (1, 2, 4) if n >= first
    ]


def test_images_beside_the_target_of_a_link_are_none_of_the_sequence(all_formats, tmp_path):
    for kind in ("rgb", "depth"):
        (tmp_path / kind).mkdir()
        for number in range(2):
            name = f"{kind}/{number:06}.png"
            (tmp_path / name).symlink_to(all_formats / "tum" / name)
    assert StoredSequence(tmp_path).unused_images() == {"rgb": [], "depth": []}


def test_a_missing_image_shifts_no_pair_of_images_named_by_stamps(all_formats, tmp_path):
    shutil.copytree(all_formats / "rtabmap", tmp_path / "s")
    for name in ("rgb.txt", "depth.txt", "associations.txt"):
        (tmp_path / "s" / name).unlink()
    sorted((tmp_path / "s/depth_sync").iterdir())[1].unlink()
    pairs = StoredSequence(tmp_path / "s").pairs
    assert len(pairs) == 3 and all(p.rgb.stem == p.depth.stem for p in pairs)


def test_images_of_transforms_json_that_are_named_by_nanoseconds_have_these_stamps(
    all_formats, tmp_path
):
    shutil.copytree(all_formats / "nerf", tmp_path / "s")
    file = tmp_path / "s/transforms.json"
    content = json.loads(file.read_text())
    for number, frame in enumerate(content["frames"]):
        name = f"images/{1403636579763555584 + 33333333 * number}.png"
        (tmp_path / "s" / frame["file_path"]).rename(tmp_path / "s" / name)
        frame["file_path"] = name
    file.write_text(json.dumps(content))
    pairs = StoredSequence(tmp_path / "s").pairs
    assert [p.written[0] for p in pairs[:2]] == ["1403636579.763555584", "1403636579.796888917"]
    poses = read_trajectory(file)
    np.testing.assert_allclose(poses.trajectory.stamps_s, [p.stamp_s for p in pairs], atol=1e-6)
    assert "stamps in nanoseconds by the images' names" in poses.read_as.sentence
    assert inspect_sequence(tmp_path / "s").figures["poses"] == 4


def test_pairs_are_in_the_order_of_time_whatever_their_names_and_the_order_in_a_file(
    all_formats, run, tmp_path
):
    shutil.copytree(all_formats / "nerf", tmp_path / "nerf")
    content = json.loads((tmp_path / "nerf/transforms.json").read_text())
    content["frames"].reverse()
    for frame in content["frames"]:
        name = frame["file_path"].replace("images/", "images/frame_")
        (tmp_path / "nerf" / frame["file_path"]).rename(tmp_path / "nerf" / name)
        frame["file_path"] = name
    (tmp_path / "nerf/transforms.json").write_text(json.dumps(content))
    pairs, again = (
        StoredSequence(tmp_path / "nerf").pairs,
        read_trajectory(tmp_path / "nerf/transforms.json").trajectory,
    )
    assert [(p.number, p.rgb.stem) for p in pairs] == [(n, f"frame_00000{n}") for n in range(4)]
    written = read_trajectory(all_formats / "nerf/transforms.json").trajectory
    assert np.array_equal(again.positions_m, written.positions_m)
    write_sequence(run_frames(run.path), tmp_path / "tum")
    for kind in ("rgb", "depth"):
        lines = [f"{1 + k / 30:.6f} {kind}/00000{n}.png" for k, n in enumerate((3, 1, 2, 0))]
        (tmp_path / f"tum/{kind}.txt").write_text("\n".join(lines) + "\n")
    (tmp_path / "tum/associations.txt").unlink()
    pairs = StoredSequence(tmp_path / "tum").pairs
    assert [p.number for p in pairs] == [0, 1, 2, 3] and [p.rgb.stem[-1] for p in pairs] == [
        "3",
        "1",
        "2",
        "0",
    ]
    write_sequence(original_frames(tmp_path / "tum"), tmp_path / "again")
    assert [p.rgb.stem[-1] for p in StoredSequence(tmp_path / "again").pairs] == [
        "3",
        "1",
        "2",
        "0",
    ]


@pytest.mark.parametrize(
    ("key", "units"),
    [
        (None, 1000),
        ('"integer_depth_scale": 0.0002', 5000),
        ('"depth_unit_scale_factor": 0.0005', 2000),
    ],
)
def test_depth_of_transforms_json_is_in_millimetres_unless_it_has_a_scale_as_nerfstudio_reads_it(
    all_formats, tmp_path, key, units
):
    shutil.copytree(all_formats / "nerf", tmp_path / "nerf")
    file = tmp_path / "nerf/transforms.json"
    file.write_text(file.read_text().replace('"integer_depth_scale": 0.001', key or '"other": 0'))
    assert StoredSequence(tmp_path / "nerf").camera.depth_units_per_metre == units
    writer = SequenceWriter(
        original_frames(all_formats / "tum"), {tmp_path / "o": SequenceSettings()}, ("nerf",)
    )
    assert writer.losses() == ["nerf: depth is stored in 1000 units per metre; the source has 5000"]


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("nerf/transforms.json", '"k1": 0.0', '"k1": -0.2'),
        ("euroc/mav0/depth0/sensor.yaml", "[0.0, 0.0, 0.0, 0.0]", "[-2.8e-1, 0, 0, 0]"),
        (
            "vslam-lab/calibration.yaml",
            "fps:",
            "distortion_coefficients: [0.26, -0.95, 0, 0, 1.16],\n     fps:",
        ),
    ],
)
def test_a_lens_distortion_that_is_ignored_is_noted(
    all_formats, tmp_path, file, old, new, command_here
):
    name = file.split("/")[0]
    assert StoredSequence(all_formats / name).camera.notes == ()
    shutil.copytree(all_formats / name, tmp_path / name)
    text = (tmp_path / file).read_text()
    (tmp_path / file).write_text(text.replace(old, new))
    assert (tmp_path / file).read_text() != text
    code, _, noted = command_here("convert", tmp_path / name, tmp_path / "out")
    assert code == 0 and "lens distortion in the camera's file is ignored" in noted
    assert any(
        "lens distortion" in warning for warning in inspect_sequence(tmp_path / name).warnings
    )


def test_make_notes_what_its_formats_lose(run):
    job = RenderJob("test", "living_room", "living_room/kt2", camera=PinholeCamera.parse("64x48"))
    plan = RunPlan(job, run.path, (0, 1, 2, 3), SequenceOptions(formats=("tartanair", "scannet")))
    notes = []
    with SequenceStage(plan, 1) as stage:
        stage.begin(run)
        stage.add_finished(plan.numbers)
        stage.complete(notes.append)
    assert any("tartanair: its programs support only the camera" in note for note in notes)
    assert any("scannet: colour is stored as JPEG" in note for note in notes)


@pytest.mark.parametrize("command", [("convert",), ("noise", "--depth-noise", "paper")])
def test_depth_units_that_no_requested_format_can_have_are_refused(
    all_formats, tmp_path, command, command_here
):
    words = (
        *command,
        all_formats / "tum",
        tmp_path / "out",
        "--format",
        "replica",
        "--depth-units",
    )
    code, _, said = command_here(*words, "1000")
    assert code == 2 and "--depth-units: expected 6553.5 for the format replica, found 1000" in said
    assert (
        not (tmp_path / "out").exists() and command_here(*words, "1000", "--format", "tum")[0] == 0
    )


@pytest.mark.parametrize(
    "option", [("--compress-bags",), ("--bag-storage", "mcap"), ("--bag-names", "realsense")]
)
def test_settings_of_bags_without_bags_are_refused(all_formats, tmp_path, option, command_here):
    code, _, said = command_here("convert", all_formats / "tum", tmp_path / "out", *option)
    assert code == 2 and f"expected --rosbag with {option[0]}, found it alone" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("frames", "noted"), [("1:", True), (":2", False)])
def test_a_part_of_replica_v2_without_frame_0_is_noted(
    all_formats, tmp_path, command_here, frames, noted
):
    words = ("--format", "replica-v2", "--frames", frames)
    code, _, said = command_here("convert", all_formats / "tum", tmp_path / "out", *words)
    assert code == 0 and ("SplaTAM looks for rgb_0.png" in said) == noted


def test_images_that_are_in_no_pair_are_noted(all_formats, tmp_path, command_here):
    shutil.copytree(all_formats / "tum", tmp_path / "s")
    for name in ("rgb.txt", "depth.txt", "associations.txt", "depth/000002.png"):
        (tmp_path / "s" / name).unlink()
    for command in (("convert",), ("noise", "--depth-noise", "paper")):
        code, _, noted = command_here(*command, tmp_path / "s", tmp_path / command[0])
        assert code == 0 and "not used: 1 in rgb/ (first: 000002.png)" in noted


@pytest.mark.parametrize("shift_s", [0.0, 0.004])
def test_images_that_are_named_by_stamps_have_these_stamps(tmp_path, shift_s):
    for kind, offset_s in (("rgb", 0.0), ("depth", shift_s)):
        (tmp_path / kind).mkdir()
        for i in range(3):
            (tmp_path / kind / f"{1305031102.175304 + i / 30 + offset_s:.6f}.png").touch()
    pairs = StoredSequence(tmp_path).pairs
    np.testing.assert_allclose(
        [p.stamp_s for p in pairs], 1305031102.175304 + np.arange(3) / 30, atol=1e-6
    )
    assert all(float(p.depth.stem) == pytest.approx(p.stamp_s + shift_s, abs=2e-6) for p in pairs)
    for depth in (tmp_path / "depth").iterdir():
        depth.rename(depth.with_name(f"x{depth.name}"))
    with pytest.raises(
        InputError,
        match=r"equal file names in rgb/ \(PNG or JPEG\) and depth/ \(PNG, EXR or NumPy\), or rgb.txt",
    ):
        assert StoredSequence(tmp_path).pairs


def test_stamps_of_depth_that_a_format_loses_are_noted(tmp_path):
    for kind, offset_s in (("rgb", 0.0), ("depth", 0.004)):
        (tmp_path / kind).mkdir()
        for i in range(3):
            (tmp_path / kind / f"{1 + i / 30 + offset_s:.6f}.png").touch()
    camera = SequenceCamera(PinholeCamera.parse("64x48"))
    source = image_frames(StoredSequence(tmp_path).with_camera(camera))
    losses = SequenceWriter(
        source, {tmp_path / "out": SequenceSettings()}, ("rtabmap", "vslam-lab", "tum")
    ).losses()
    assert losses == [
        "rtabmap: depth images get the stamps of their colour images, up to 4 ms from their own"
    ]


def test_noise_on_a_written_clean_sequence_is_noise_on_its_pixels(run, tmp_path):
    from iclnuim.formats.png import read_rgb8
    from iclnuim.sensor.models import depth_model, rgb_model

    clean = write_sequence(run_frames(run.path), tmp_path / "clean").folders[0]
    settings = SequenceSettings(depth_model("released"), rgb_model("released"), seed=7)
    from_exr = write_sequence(run_frames(run.path), tmp_path / "a", settings).folders[0]
    from_png = write_sequence(image_frames(clean), tmp_path / "b", settings).folders[0]
    # the released RGB noise is added to the finished 8-bit values: the very same pixels either way
    assert np.array_equal(
        read_rgb8(from_exr / "rgb/000001.png"), read_rgb8(from_png / "rgb/000001.png")
    )
    unchanged = write_sequence(image_frames(clean), tmp_path / "c").folders[0]
    for image in ("rgb/000003.png", "depth/000003.png"):
        assert (clean / image).read_bytes() == (unchanged / image).read_bytes()


@pytest.mark.parametrize(("stride", "fps"), [(1, 30), (2, 15)])
def test_orb_slam3s_settings_have_the_rate_of_the_stamps(run, tmp_path, stride, fps):
    write_sequence(run_frames(run.path, f"::{stride}"), tmp_path / "out")
    assert f"\nCamera.fps: {fps}\n" in (tmp_path / "out/orb_slam3.yaml").read_text()


@pytest.mark.parametrize(("steps_off", "has_pose"), [(0.0, True), (0.45, True), (0.55, False)])
def test_a_pose_belongs_to_the_frame_that_is_nearest_in_time(steps_off, has_pose):
    """At the usual rate of 30 frames per second; further away it belongs to a neighbour."""
    stamps_s = 1 + np.arange(5) / 30
    other = np.delete(stamps_s, 2)
    late = Trajectory(np.sort(np.append(other, stamps_s[2] + steps_off / 30)), SE3.identity((5,)))
    assert posed(stamps_s, late).tolist() == [True, True, has_pose, True, True]


@pytest.mark.parametrize(("folder", "name"), [("tum", "tum"), ("vslam-lab", "vslam-lab")])
def test_the_entry_of_a_trajectory_format_says_whether_lines_are_poses(
    all_formats, monkeypatch, folder, name
):
    source = image_frames(all_formats / folder)
    some = source.numbers[1:3]
    format, data = source.truth_file(some)
    assert format == name and len(data.splitlines()) == 3  # with the header
    entry = trajectories.FORMATS[name]
    reader = dataclasses.replace(entry.reader, first_pose=None)
    monkeypatch.setitem(trajectories.FORMATS, name, entry._replace(reader=reader))
    assert source.truth_file(some) is None
