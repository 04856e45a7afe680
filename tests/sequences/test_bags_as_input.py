"""Bags as sequences and as trajectories: ours, with the topics of TUM and RealSense, and every
encoding that is read; what cannot be read is refused by name.
"""

import json

import cv2
import numpy as np
import pytest
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.bags import is_bag
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.headless.cli import main
from iclnuim.sequences import bag_reader
from iclnuim.sequences.bag_reader import unpacked
from iclnuim.sequences.bag_writer import BagSettings, write_rosbag
from iclnuim.sequences.camera_files import DISTORTED
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.rgbd_sequence import open_sequence
from iclnuim.sequences.stored_sequence import StoredSequence, read_images
from iclnuim.trajectory_files.trajectories import read_trajectory

from .bag_files import Recording, compressed_depth, png_of

pytest.importorskip("rosbags")
CAMERA = PinholeCamera(8, 6, 8.0, 8.5, 3.5, 2.5)
NS = 1305031102_175304123
STEP = 33_333_333
POSES = SE3.exp(np.random.default_rng(0).normal(size=(4, 6)) * 0.2)
SEVEN = np.hstack([POSES.translation, POSES.quat_xyzw])
RGB = np.random.default_rng(1).integers(0, 255, (6, 8, 3)).astype(np.uint8)
MM = (1000 + 10 * np.arange(48).reshape(6, 8)).astype(np.uint16)
TUM = ("/camera/rgb/image_color", "/camera/depth/image", "/camera/rgb/camera_info")
REALSENSE = (
    "/camera/color/image_raw",
    "/camera/aligned_depth_to_color/image_raw",
    "/camera/color/camera_info",
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))


def recorded(path, topics=TUM, rgb=(RGB, "rgb8"), depth=(MM, "16UC1"), **more):
    """Four pairs; depth 5 ms after colour. `poses(recording)` adds further messages."""
    with Recording(path, storage=more.get("storage", "sqlite3")) as bag:
        for i in range(4):
            stamp = NS + STEP * i
            bag.image(topics[0], stamp, *rgb, **more.get("colour", {}))
            bag.image(topics[1], stamp + 5_000_000, *depth, **more.get("depths", {}))
            bag.info(topics[2], stamp, CAMERA, **more.get("info", {}))
        more.get("also", lambda bag: None)(bag)
    return path


def read(path):
    """Images of the first pair, camera, and ground truth."""
    pairs = StoredSequence(path).pairs
    camera = StoredSequence(path).camera
    return pairs, camera, read_images(pairs[0], camera), StoredSequence(path).truth


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("s.bag", {}),
        ("s.bag", {"compress_bags": True}),
        ("s_ros2", {}),
        ("s_ros2", {"compress_bags": True, "bag_storage": "mcap"}),
    ],
)
def test_our_bags_are_read_back_as_they_were_written(all_formats, tmp_path, name, settings):
    folder = all_formats / "tum"
    write_rosbag(folder, tmp_path / name, 1 if name.endswith("bag") else 2, BagSettings(**settings))
    bag, own = read(tmp_path / name), read(folder)
    assert [p.written for p in bag[0]] == [p.written for p in own[0]]
    assert bag[1] == own[1] and not bag[1].assumed
    for ours, theirs in zip(own[0], bag[0], strict=True):
        for a, b in zip(read_images(ours, own[1]), read_images(theirs, bag[1]), strict=True):
            assert np.array_equal(a, b)
    direct = read_trajectory(tmp_path / name).trajectory
    for truth in (bag[3], direct):
        assert np.array_equal(truth.stamps_s, own[3].stamps_s)
        assert np.abs(truth.T_world_camera.matrix - own[3].T_world_camera.matrix).max() < 1e-9


@pytest.mark.parametrize("name", ["s.bag", "s_ros2"])
def test_bags_named_as_of_a_realsense_have_its_topics_and_millimetres(all_formats, tmp_path, name):
    highlevel = pytest.importorskip("rosbags.highlevel")
    ros = 1 if name.endswith("bag") else 2
    write_rosbag(all_formats / "tum", tmp_path / name, ros, BagSettings(bag_names="realsense"))
    depth = "/camera/aligned_depth_to_color/image_raw"
    with highlevel.AnyReader([tmp_path / name]) as reader:
        topics = {c.topic: c for c in reader.connections}
        assert {
            "/camera/color/image_raw",
            "/camera/color/camera_info",
            depth,
            "/camera/aligned_depth_to_color/camera_info",
        } <= set(topics)
        first = next(reader.messages([topics[depth]]))
        image = reader.deserialize(first[2], topics[depth].msgtype)
    assert image.encoding == "16UC1" and image.header.frame_id == "camera_color_optical_frame"
    bag, own = read(tmp_path / name), read(all_formats / "tum")
    assert bag[1].pinhole == own[1].pinhole and bag[1].depth_units_per_metre == 1000
    for ours, theirs in zip(own[0], bag[0], strict=True):
        colour, depth_z_m = read_images(theirs, bag[1])
        expected = read_images(ours, own[1])
        assert np.array_equal(colour, expected[0])
        assert np.abs(depth_z_m - expected[1]).max() <= 0.0005 + 1e-6
    assert np.array_equal(bag[3].stamps_s, own[3].stamps_s)


def test_the_commands_read_a_bag_and_say_how(tmp_path, capsys):
    def add(bag):
        for i, seven in enumerate(SEVEN):
            bag.pose("/odom", "Odometry", NS + STEP * i, seven, child="optical")

    path = recorded(tmp_path / "x.bag", also=add)
    assert main(["inspect", str(path), "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["figures"]["poses"] == 4
    assert (
        "colour /camera/rgb/image_color (rgb8), depth /camera/depth/image (16UC1, 1000" in said.err
    )
    assert "/odom (Odometry) of optical in world" in said.err
    assert main(["convert", str(path), str(tmp_path / "out"), "--quiet"]) == 0
    assert main(["inspect", str(tmp_path / "out"), "--quiet"]) == 0
    camera = json.loads((tmp_path / "out/camera.json").read_text())
    assert camera["depth_units_per_metre"] == 1000 and camera["fy"] == 8.5
    first = (tmp_path / "out/associations.txt").read_text().split()
    assert first[0] == "1305031102.175304123" and first[2] == "1305031102.180304123"
    capsys.readouterr()
    truth = str(tmp_path / "out/groundtruth.txt")
    assert main(["evaluate", "ate", str(path), truth, "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)["translation_error_m"]["rmse"] < 1e-9


ENCODINGS = {
    "rgb8": RGB,
    "bgr8": RGB[..., ::-1],
    "8UC3": RGB[..., ::-1],
    "rgba8": np.dstack([RGB, MM.astype(np.uint8)]),
    "bgra8": np.dstack([RGB[..., ::-1], MM.astype(np.uint8)]),
    "8UC4": np.dstack([RGB[..., ::-1], MM.astype(np.uint8)]),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("padding", [0, 5])
def test_colour_of_every_encoding_is_read(tmp_path, encoding, padding):
    rgb = (ENCODINGS[encoding], encoding)
    path = recorded(tmp_path / "x.bag", rgb=rgb, colour={"padding": padding})
    assert np.array_equal(read(path)[2][0], RGB)


@pytest.mark.parametrize("topics", [TUM, REALSENSE])
@pytest.mark.parametrize("big", [False, True])
def test_grey_and_depth_of_every_encoding_are_read(tmp_path, topics, big):
    metres = np.where(MM > 1100, MM / np.float32(1000), np.nan).astype(np.float32)
    metres[0, 0] = -1
    depths = {"16UC1": MM, "mono16": MM, "32FC1": metres}
    for encoding, values in depths.items():
        more = {"rgb": (RGB[..., 0], "mono8"), "depth": (values, encoding)}
        more["depths"] = {"padding": 4, "big": big}
        path = recorded(tmp_path / f"{encoding}.bag", topics, **more)
        colour, depth = read(path)[2]
        assert np.array_equal(colour, np.repeat(RGB[..., :1], 3, -1))
        expected = MM / np.float32(1000)
        if encoding == "32FC1":
            expected = np.where(MM > 1100, expected, 0)
        assert np.array_equal(depth, expected)


def test_compressed_images_are_read_and_stored_as_they_are(tmp_path):
    jpeg = cv2.imencode(".jpg", RGB[..., ::-1])[1].tobytes()
    a, b = 120.0, -10.0
    inverse = np.where(MM > 1100, a / (MM / 1000) + b, 0)
    depths = {
        "16UC1; compressedDepth": compressed_depth(MM),
        "16UC1; compressedDepth png": compressed_depth(MM),
        "16UC1; png compressed ": png_of(MM),
        "32FC1; compressedDepth png": compressed_depth(np.rint(inverse).astype(np.uint16), a, b),
    }
    colours = {
        "rgb8; jpeg compressed bgr8": jpeg,
        "jpeg": jpeg,
        "bgr8; png compressed bgr8": png_of(RGB[..., ::-1]),
        "png": png_of(RGB[..., ::-1]),
    }
    for number, (format, data) in enumerate(depths.items()):
        how, colour = list(colours.items())[number]
        with Recording(tmp_path / f"{number}.bag") as bag:
            bag.compressed("/cam/color/image_raw/compressed", NS, colour, how)
            bag.compressed("/cam/depth/image_raw/compressedDepth", NS, data, format)
            bag.info("/cam/color/camera_info", NS, CAMERA)
        pairs, _, images, _ = read(tmp_path / f"{number}.bag")
        assert pairs[0].rgb.read_bytes() == colour
        if "png" in how:
            assert np.array_equal(images[0], RGB)
        if format.startswith("32FC1"):
            assert (images[1] > 0).sum() == (MM > 1100).sum()
            seen = images[1] > 0
            assert np.abs(images[1] - MM / 1000)[seen].max() < 0.5 * 1.5**2 / a
        else:
            assert np.array_equal(images[1], MM / np.float32(1000))


@pytest.mark.parametrize(
    ("colour", "depth", "named"),
    [
        ("rgb8; jpeg compressed bgr8", "16UC1; compressedDepth rvl", "compressedDepth rvl"),
        ("bayer_rggb8; h264", "16UC1; compressedDepth png", "bayer_rggb8; h264"),
    ],
)
def test_what_is_compressed_otherwise_is_refused_by_name(tmp_path, colour, depth, named):
    with Recording(tmp_path / "x.bag") as bag:
        bag.compressed("/cam/color/image_raw/compressed", NS, png_of(RGB), colour)
        bag.compressed("/cam/depth/image_raw/compressedDepth", NS, compressed_depth(MM), depth)
    with pytest.raises(InputError, match=named):
        assert StoredSequence(tmp_path / "x.bag").pairs
    path = recorded(tmp_path / "bayer.bag", rgb=(RGB[..., 0], "bayer_rggb8"))
    with pytest.raises(InputError, match=r"topic of colour images .*\(bayer_rggb8\)"):
        assert StoredSequence(path).pairs


def test_topics_that_do_not_decide_are_named_and_can_be_given(tmp_path):
    def also(bag):
        bag.image("/second/color", NS, RGB[::-1], "rgb8", frame="optical")

    path = recorded(tmp_path / "x.bag", also=also)
    with pytest.raises(InputError, match=r"one topic of colour images, found .*/second/color"):
        assert StoredSequence(path).pairs
    chosen = f"{path}:/second/color"
    assert is_bag(chosen) and len(StoredSequence(chosen).pairs) == 1
    assert np.array_equal(read(chosen)[2][0], RGB[::-1])
    with pytest.raises(InputError, match="expected the topic /none, found /camera/rgb/image_color"):
        assert StoredSequence(f"{path}:/none").pairs


def test_a_bag_is_opened_as_a_sequence(tmp_path):
    sequence = open_sequence(recorded(tmp_path / "a.bag"))
    assert len(sequence) == 4 and sequence.camera == CAMERA and sequence.truth is None
    assert np.array_equal(sequence[3].rgb, RGB) and sequence[3].depth_z_m.max() == np.float32(1.47)


def test_of_several_topics_the_registered_raw_ones_are_read(tmp_path):
    def also(bag):
        bag.compressed(f"{REALSENSE[0]}/compressed", NS, png_of(RGB), "rgb8; png compressed")
        bag.image("/camera/depth/image_rect_raw", NS, MM[::-1].copy(), "16UC1", frame="depth")
        other = PinholeCamera(8, 6, 5.0, 5.0, 3, 2)
        bag.info("/camera/depth/camera_info", NS, other, frame="depth")
        for side in ("infra1", "infra2"):
            bag.image(f"/camera/{side}/image_rect_raw", NS, RGB[..., 0], "mono8", frame=side)

    pairs, camera, (_, depth), _ = read(recorded(tmp_path / "x.bag", REALSENSE, also=also))
    assert len(pairs) == 4 and camera.pinhole == CAMERA
    assert np.array_equal(depth, MM / np.float32(1000))


def test_infrared_images_are_no_depth(tmp_path):
    """They have its encodings."""
    for number, topic in enumerate(("/k/ir/image_raw", "/k/image_ir", "/cam/infra1/image")):
        for encoding in ("mono16", "16UC1"):
            path = tmp_path / f"{number}{encoding}.bag"
            recorded(path, ("/k/rgb/image_raw", topic, "/k/rgb/camera_info"), depth=(MM, encoding))
            with pytest.raises(InputError, match="a topic of depth images"):
                assert StoredSequence(path).pairs
    topics = ("/air/rgb/image", "/iris/depth/image", "/iris/camera_info")
    assert StoredSequence(recorded(tmp_path / "x.bag", topics)).pairs


def test_depth_that_is_not_registered_is_read_with_its_own_camera_and_a_note(tmp_path):
    other = PinholeCamera(8, 6, 4.0, 4.25, 3.5, 2.5)

    def also(bag):
        bag.info("/camera/depth/camera_info", NS, other, frame="depth")

    path = recorded(tmp_path / "x.bag", depths={"frame": "depth"}, also=also)
    _, camera, (colour, _), _ = read(path)
    assert camera.pinhole == other
    assert np.array_equal(colour[2, 3:5], RGB[2, 3:5]) or colour.any()
    assert "depth is not registered to colour" in camera.notes[0]
    assert "resampled" in " ".join(unpacked(path)[1])


def test_registered_depth_has_the_camera_of_colour_unless_it_has_another_size(tmp_path):
    other = PinholeCamera(8, 6, 4.0, 4.25, 3.5, 2.5)
    half = PinholeCamera(4, 3, 4.0, 4.25, 1.5, 1.0)
    path = recorded(
        tmp_path / "x.bag",
        also=lambda bag: bag.info("/camera/depth/camera_info", NS, other),
    )
    _, camera, (colour, _), _ = read(path)
    assert camera.pinhole == CAMERA and np.array_equal(colour, RGB)
    assert "camera_info of depth differs" in camera.notes[0]
    path = recorded(
        tmp_path / "half.bag",
        depth=(MM[::2, ::2].copy(), "16UC1"),
        also=lambda bag: bag.info("/camera/depth/camera_info", NS, half),
    )
    _, camera, (colour, depth), _ = read(path)
    assert camera.pinhole == half and not camera.notes
    assert colour.shape == (3, 4, 3) and depth.shape == (3, 4)


@pytest.mark.parametrize("unit", ["0.0001", "0", "x", "-1", "inf"])
def test_the_unit_of_depth_that_librealsense_writes_is_used(tmp_path, unit):
    def also(bag):
        text = bag.new("std_msgs/msg/String", data=unit)
        bag.write("/device_0/sensor_0/option/Depth_Units/value", text, NS)

    names = [f"/device_0/sensor_{i}/{name}" for i, name in ((1, "Color_0"), (0, "Depth_0"))]
    topics = (f"{names[0]}/image/data", f"{names[1]}/image/data", f"{names[0]}/info/camera_info")
    path = recorded(tmp_path / "x.bag", topics, also=also, depth=(MM, "mono16"))
    if unit != "0.0001":
        with pytest.raises(InputError, match="metres per unit of depth in /device_0"):
            assert StoredSequence(path).pairs
        return
    assert np.allclose(read(path)[2][1], MM / 10000)
    assert "10000 units per metre" in unpacked(path)[1][0]


def test_rectified_images_have_the_camera_p_and_others_warn_of_distortion(tmp_path):
    rectified = PinholeCamera(8, 6, 7.0, 7.0, 3.25, 2.25)
    info = {"d": [0.1, 0, 0, 0, 0], "p": rectified}
    raw = read(recorded(tmp_path / "raw.bag", info=info))[1]
    assert raw.pinhole == CAMERA and raw.notes == (DISTORTED,)
    topics = ("/camera/rgb/image_rect_color", "/camera/depth/image_rect", TUM[2])
    rect = read(recorded(tmp_path / "rect.bag", topics, info=info))[1]
    assert rect.pinhole == rectified and not rect.notes


def test_a_bag_without_a_camera_is_read_with_a_given_one_in_its_own_unit(tmp_path, capsys):
    path = recorded(tmp_path / "x.bag", info={}, topics=(*TUM[:2], "/elsewhere/camera_info"))
    assert read(path)[1].pinhole == CAMERA
    with Recording(tmp_path / "none.bag") as bag:
        bag.image(TUM[0], NS, RGB, "rgb8")
        bag.image(TUM[1], NS, MM, "16UC1")
    with pytest.raises(InputError, match="expected a camera"):
        read(tmp_path / "none.bag")
    out, camera = tmp_path / "out", "8x6,8,8,3.5,2.5"
    assert main(["convert", str(tmp_path / "none.bag"), str(out), "--camera", camera]) == 0
    pairs = StoredSequence(out).pairs
    depth_z_m = read_images(pairs[0], StoredSequence(out).camera)[1]
    assert np.abs(depth_z_m - MM / 1000).max() < 1e-3


def test_images_without_stamps_get_that_of_their_recording(tmp_path):
    with Recording(tmp_path / "x.bag") as bag:
        for i in range(3):
            for topic, pixels, encoding in ((TUM[0], RGB, "rgb8"), (TUM[1], MM, "16UC1")):
                bag.image(topic, 0, pixels, encoding, recorded_ns=NS + STEP * i)
        bag.info(TUM[2], NS, CAMERA)
    pairs, camera, *_ = read(tmp_path / "x.bag")
    assert [p.written[0] for p in pairs][1] == "1305031102.208637456"
    assert "6 images without a stamp" in camera.notes[0]


def test_damaged_images_and_those_of_another_size_are_left_out_and_counted(tmp_path):
    with Recording(tmp_path / "x.bag") as bag:
        for i in range(3):
            data = png_of(RGB)[: 60 if i == 1 else None]
            bag.compressed("/color/compressed", NS + STEP * i, data, "png")
            bag.image("/depth", NS + STEP * i, MM, "16UC1")
        bag.info("/camera_info", NS, CAMERA)
    pairs, camera, *_ = read(tmp_path / "x.bag")
    assert len(pairs) == 2
    assert "1 images left out: rgb of 1305031102.208637456 s: " in camera.notes[0]


def test_a_full_disk_is_noticed_before_it_is_full(tmp_path, monkeypatch):
    path = recorded(tmp_path / "x.bag")
    usage = bag_reader.shutil.disk_usage(tmp_path)
    monkeypatch.setattr(bag_reader.shutil, "disk_usage", lambda folder: usage._replace(free=500))
    with pytest.raises(WorkError, match=r"needs 0\.0 GB, and 0\.0 GB are free; try ICLNUIM_CACHE"):
        assert StoredSequence(path).pairs
    assert list((tmp_path / "cache/bags").iterdir()) == []


def test_a_bag_is_unpacked_once_until_it_changes(tmp_path, monkeypatch):
    path = recorded(tmp_path / "x.bag")
    folder, notes = unpacked(path)
    monkeypatch.setattr(bag_reader, "_unpack", lambda *arguments: 1 / 0)
    assert unpacked(path) == (folder, notes)
    path.write_bytes(path.read_bytes() + b"1")
    with pytest.raises(ZeroDivisionError):
        unpacked(path)


KINDS = ["PoseStamped", "PoseWithCovarianceStamped", "Odometry", "TransformStamped"]


@pytest.mark.parametrize("ros", ["x.bag", "x_ros2"])
@pytest.mark.parametrize("kind", [*KINDS, "Path"])
def test_poses_of_every_kind_are_read_and_their_frame_is_said(tmp_path, kind, ros):
    stamps = [NS + STEP * i for i in range(4)]
    with Recording(tmp_path / ros) as bag:
        if kind == "Path":
            bag.path("/t", stamps, SEVEN)
        else:
            for stamp, seven in zip(stamps, SEVEN, strict=True):
                bag.pose("/t", kind, stamp, seven, frame="/map", child="base_link")
    loaded = read_trajectory(tmp_path / ros)
    assert main(["evaluate", "ate", str(tmp_path / ros), str(tmp_path / ros), "--quiet"]) == 0
    assert np.allclose(loaded.trajectory.T_world_camera.matrix, POSES.matrix, atol=1e-12)
    assert np.allclose(loaded.trajectory.stamps_s, np.array(stamps) / 1e9)
    named = kind in ("Odometry", "TransformStamped")
    frame = "base_link in map" if named else "a frame that is not named in"
    sentence = loaded.read_as.sentence
    assert f"/t ({kind}) of {frame}" in sentence and "taken as the camera" in sentence


MOUNT = SE3.exp(np.array([0.1, -0.02, 0.3, -1.2, 1.2, -1.2]))
TILT = SE3.exp(np.array([0.02, 0.01, 0.0, 0.1, 0.0, 0.05]))


def seven(T: SE3) -> np.ndarray:
    return np.hstack([T.translation, T.quat_xyzw])


@pytest.mark.parametrize("kind", ["tf/msg/tfMessage", "tf2_msgs/msg/TFMessage"])
def test_tum_poses_come_from_the_tree_of_transforms(tmp_path, kind):
    """world > kinect > openni_camera > openni_rgb_optical_frame, of which one moves; the others
    are repeated on /tf.
    """

    def also(bag):
        for i in range(4):
            edges = [("/world", "/kinect", SEVEN[i]), ("/kinect", "/openni_camera", seven(MOUNT))]
            edges.append(("/openni_camera", "/openni_rgb_optical_frame", seven(TILT)))
            edges.append(("/openni_camera", "/openni_depth_frame", seven(MOUNT)))
            for shift, edge in enumerate(edges):
                bag.transforms("/tf", NS + STEP * i - 1000 * shift, [edge], kind)

    frame = {"frame": "/openni_rgb_optical_frame"}
    path = recorded(tmp_path / "x.bag", colour=frame, depths=frame, also=also)
    loaded = read_trajectory(path)
    expected = (POSES @ MOUNT @ TILT).matrix
    assert np.allclose(loaded.trajectory.T_world_camera.matrix, expected, atol=1e-12)
    assert "world > kinect > openni_camera > openni_rgb_optical_frame" in loaded.read_as.sentence
    assert np.allclose(StoredSequence(path).truth.T_world_camera.matrix, expected, atol=1e-8)
    assert inspect_sequence(path).figures["poses"] == 4


@pytest.mark.parametrize("static", [True, False])
def test_odometry_of_the_body_is_moved_to_the_camera(tmp_path, static):
    def also(bag):
        for i in range(4):
            bag.pose("/odom", "Odometry", NS + STEP * i, SEVEN[i], "odom", "base_link")
            bag.transforms("/tf", NS + STEP * i, [("odom", "base_link", SEVEN[3 - i])])
        if static:
            edges = [("base_link", "camera_link", seven(MOUNT))]
            bag.transforms("/tf_static", NS, [*edges, ("camera_link", "optical", seven(TILT))])

    loaded = read_trajectory(recorded(tmp_path / "x.bag", also=also))
    sentence = loaded.read_as.sentence
    moved = POSES @ MOUNT @ TILT if static else POSES
    assert np.allclose(loaded.trajectory.T_world_camera.matrix, moved.matrix, atol=1e-12)
    expected = "moved to optical by /tf" if static else "of base_link in odom, taken as the camera"
    assert expected in sentence
    if not static:
        assert "/tf has no transforms from base_link to optical" in sentence


def test_a_frame_that_tf_does_not_have_is_named_where_it_moves_others(tmp_path):
    def also(bag):
        for i in range(4):
            bag.transforms("/tf", NS + STEP * i, [("odom", "base_link", SEVEN[i])])

    path = recorded(tmp_path / "x.bag", also=also)
    words = "/tf moves base_link, and has no transforms from there to optical"
    with pytest.raises(InputError, match=words):
        read_trajectory(path)
    assert StoredSequence(path).truth is None
    assert words in str(unpacked(path)[1])


def test_transforms_of_two_rates_are_interpolated(tmp_path):
    slide = np.array([[0.0, 0, 0, 0, 0, 0, 1], [0, 0, 3.0, 0, 0, 0, 1]])
    with Recording(tmp_path / "x.bag") as bag:
        for i in range(4):
            bag.transforms("/tf", NS + STEP * i, [("odom", "camera", SEVEN[i])])
        for i in range(2):
            bag.transforms("/tf", NS + 3 * STEP * i, [("map", "odom", slide[i])])
    T = read_trajectory(tmp_path / "x.bag").trajectory.T_world_camera
    assert np.allclose(T.translation, POSES.translation + [[0, 0, i] for i in range(4)], atol=1e-6)


def test_poses_that_do_not_decide_are_named_and_can_be_given(tmp_path, capsys):
    def also(bag):
        for i in range(4):
            bag.pose("/a", "PoseStamped", NS + STEP * i, SEVEN[i])
            bag.pose("/b", "PoseStamped", NS + STEP * i, SEVEN[3 - i])

    path = recorded(tmp_path / "x.bag", also=also)
    with pytest.raises(InputError, match=r"one topic of poses, found /a .*, /b .*; try .*bag:/a"):
        assert StoredSequence(path).truth
    found = inspect_sequence(path)
    assert found.figures["pairs"] == 4 and "one topic of poses" in found.errors[0]
    for given, poses in ((f"{path}:/a", POSES), (f"{path}:/b", POSES[::-1])):
        assert np.allclose(
            StoredSequence(given).truth.T_world_camera.matrix, poses.matrix, atol=1e-8
        )
    arguments = ["evaluate", "ate", f"{path}:/a", f"{path}:/a", "--json"]
    assert main(arguments) == 0


def test_a_lost_pose_is_left_out_and_a_bag_without_poses_has_none(tmp_path):
    with Recording(tmp_path / "lost.bag") as bag:
        for i in range(4):
            found = SEVEN[i] if i != 1 else np.zeros(7)
            bag.pose("/o", "Odometry", NS + STEP * i, found, child="c")
    assert len(read_trajectory(tmp_path / "lost.bag").trajectory) == 3

    def also(bag):
        bag.transforms("/tf_static", NS, [("camera_link", "optical", seven(MOUNT))])

    path = recorded(tmp_path / "x.bag", also=also)
    assert StoredSequence(path).truth_path is None
    with pytest.raises(InputError, match=r"poses: .*, or /tf, found .*no transform that moves"):
        read_trajectory(path)


def test_a_bag_without_an_index_says_how_to_make_one(tmp_path):
    path = recorded(tmp_path / "x.bag")
    whole = path.read_bytes()
    assert whole.count(b"index_pos=") == 1
    at = whole.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(whole[:at] + bytes(8) + whole[at + 8 :])
    with pytest.raises(InputError, match=r"not indexed.*try `rosbag reindex`"):
        assert StoredSequence(path).pairs
    for cut in (0, 5, 500, len(whole) // 2, len(whole) - 10):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match="expected a whole ROS bag"):
            assert StoredSequence(path).pairs
    folder = recorded(tmp_path / "r_ros2")
    (folder / "metadata.yaml").unlink()
    with pytest.raises(InputError, match="metadata"):
        read_trajectory(folder)


def test_the_file_of_a_folder_is_read_alone(tmp_path):
    for storage, ending in (("sqlite3", "db3"), ("mcap", "mcap")):
        folder = recorded(tmp_path / storage, storage=storage)
        assert (
            len(StoredSequence(folder / f"{storage}.{ending}").pairs)
            == len(StoredSequence(folder).pairs)
            == 4
        )


def test_bags_without_the_package_are_refused_with_its_name(tmp_path, monkeypatch):
    path = recorded(tmp_path / "x.bag")
    monkeypatch.setattr("iclnuim.formats.bags.find_spec", lambda name: None)
    for work in (lambda path: StoredSequence(path).pairs, read_trajectory):
        with pytest.raises(WorkError, match="rosbags; try pip install rosbags"):
            work(path)
