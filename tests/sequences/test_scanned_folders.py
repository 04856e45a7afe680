"""Folders of scanners and of apps on phones are read as they are: every frame with its own depth,
pose, stamp and camera; what is no RGB-D sequence is told so in a line with what works.
"""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim import PinholeCamera, frames_from, phone_depth
from iclnuim.errors import InputError
from iclnuim.formats.exr import write_exr
from iclnuim.formats.images import read_colour8, read_metres
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, sample
from iclnuim.sensor import noise_model
from iclnuim.sensor.models import depth_model, with_depth_noise
from iclnuim.sensor.noise_model import frame_generator
from iclnuim.sequences.frame_source import frames_with_poses, original_frames
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.sequence_formats import READ_ONLY, format_of
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.stored_sequence import StoredSequence, read_depth_m
from iclnuim.sequences.writer import write_sequence
from iclnuim.trajectory_files.trajectories import read_trajectory

pytest.importorskip("cv2")
sys.path[:0] = [str(Path(__file__).parents[1])]
from formats.test_fuzzed_files import (  # noqa: E402
    check_sequence,
    check_trajectory,
    read_all,
    read_sequence,
)

from ..moving_box import depth_z_m  # noqa: E402
from . import scanned_folders as scans  # noqa: E402

each = pytest.mark.parametrize("name", scans.WRITERS)


@pytest.fixture
def scanned(tmp_path):
    """A function that writes a folder; returns it and the camera of its depth."""

    def write(name):
        folder = tmp_path / name
        folder.mkdir()
        return folder, scans.WRITERS[name](folder)

    return write


def number_of(image):
    """The number of the frame that a colour image shows."""
    return round((read_colour8(image)[-1, -1, 0] - 10) / 20)


@each
def test_each_frame_has_its_own_depth_pose_and_camera(scanned, name):
    folder, camera = scanned(name)
    sequence = StoredSequence(folder)
    assert sequence.format.name == scans.READ_AS.get(name, name)
    found = sequence.camera
    assert np.abs(found.pinhole.intrinsics - camera.intrinsics).max() < 1e-3
    assert (found.pinhole.width, found.pinhole.height) == (camera.width, camera.height)
    assert [number_of(pair.rgb) for pair in sequence.pairs] == list(range(scans.FRAMES))
    poses = sample(sequence.truth, sequence.stamps_s)
    assert np.abs(poses.matrix - scans.POSES.matrix).max() < 1e-7
    for number, pair in enumerate(sequence.pairs):
        image, depth_m = sequence.images(pair)
        assert image.shape[:2] == depth_m.shape == (camera.height, camera.width)
        true_m = depth_z_m(scans.POSES[number], camera)
        measured = depth_m > 0
        assert measured.mean() > 0.95
        assert np.abs(depth_m - true_m)[measured].max() < 5.1e-4
    assert inspect_sequence(folder).errors == []


@each
def test_it_goes_into_another_format_with_the_same_depth_and_poses(scanned, tmp_path, name):
    folder, _ = scanned(name)
    source = frames_with_poses(original_frames(folder))
    write_sequence(source, tmp_path / "out", formats=["scannet"], workers=1)
    before, after = StoredSequence(folder), StoredSequence(tmp_path / "out")
    poses = [sequence.truth.T_world_camera.matrix for sequence in (before, after)]
    assert np.abs(poses[0] - poses[1]).max() < 1e-6
    for one, other in zip(before.pairs, after.pairs, strict=True):
        depths = [s.images(pair)[1] for s, pair in ((before, one), (after, other))]
        assert np.abs(depths[0] - depths[1]).max() < 5.1e-4


def test_stamps_of_phones_are_kept_to_the_digit(scanned, tmp_path):
    folder, _ = scanned("stray-scanner")
    pairs = StoredSequence(folder).pairs
    assert [pair.written[0] for pair in pairs][:2] == ["7000.000000", "7000.016667"]
    folder, _ = scanned("record3d")
    assert np.diff(StoredSequence(folder).stamps_s) == pytest.approx(1 / 60)
    folder, _ = scanned("polycam")
    assert StoredSequence(folder).stamps_s[0] == pytest.approx(52_000)


def test_every_second_image_of_a_phone_keeps_its_pose(scanned):
    for name in ("stray-scanner", "record3d", "polycam", "7-scenes"):
        folder, _ = scanned(name)
        colours = StoredSequence(folder).pairs[::2]
        for pair in colours:
            pair.rgb.unlink()
        sequence = StoredSequence(folder)
        poses = sample(sequence.truth, np.array([pair.stamp_s for pair in sequence.pairs]))
        assert np.abs(poses.matrix - scans.POSES.matrix[1::2]).max() < 1e-7, name


def test_a_phone_that_focuses_is_one_camera_with_a_note_and_one_that_zooms_is_refused(scanned):
    folder, _ = scanned("polycam")
    file = next((folder / "keyframes/corrected_cameras").iterdir())
    wide = file.read_text()
    file.write_text(wide.replace(f'"fx": {scans.WIDE.fx}', f'"fx": {1.01 * scans.WIDE.fx}'))
    assert "from frame to frame: one camera is used" in str(StoredSequence(folder).camera.notes)
    file.write_text(wide.replace(f'"fx": {scans.WIDE.fx}', f'"fx": {2 * scans.WIDE.fx}'))
    with pytest.raises(InputError, match="frames of one camera, found focal lengths of"):
        assert StoredSequence(folder).camera


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("transforms_train.json", "train/r_0.png"), "without depth; try `iclnuim trajectory`"),
        (("exr/000000.exr",), "the EXR frames of a run; try `iclnuim dataset`"),
        (("metadata", "rgbd/0.depth", "rgbd/0.jpg"), "LZFSE; try the app's export as EXR and JPG"),
        (("rgba_00000.png", "depth_00000.tiff"), "Kubric's TIFF"),
        (("seq-01/frame-000000.depth.png",), "try one of them, as seq-01"),
    ],
)
def test_what_is_no_sequence_is_told_with_what_works(tmp_path, names, words):
    touch(tmp_path, *names)
    with pytest.raises(InputError, match=words):
        assert StoredSequence(tmp_path).pairs


def test_redwoods_folders_as_they_are_downloaded(scanned):
    folder, _ = scanned("redwood")
    before = [pair.depth.read_bytes() for pair in StoredSequence(folder).pairs]
    (folder / "colors").rename(folder / "office1-color")
    (folder / "depth").rename(folder / "office1-depth-clean")
    shutil.copytree(folder / "office1-depth-clean", folder / "office1-depth-simulated")
    (folder / "office1-depth-simulated/00001.png").write_bytes(before[0])
    sequence = StoredSequence(folder)
    assert [pair.depth.read_bytes() for pair in sequence.pairs] == before
    assert "office1-depth-simulated/ is not read" in sequence.camera.notes


@pytest.mark.parametrize("lost", ["-inf", "-INF", "-1.#INF", "nan"])
def test_a_lost_frame_has_no_pose(scanned, lost):
    folder, _ = scanned("bundle-fusion")
    (folder / "frame-000003.pose.txt").write_text(f"{' '.join([lost] * 4)}\n" * 4)
    found = inspect_sequence(folder)
    assert found.figures["poses"] == scans.FRAMES - 1 and found.errors == []
    assert "1 frames without a pose: frame-000003.color.jpg" in found.warnings


def test_a_video_alone_is_told_how_to_become_images(scanned):
    folder, _ = scanned("stray-scanner")
    shutil.rmtree(folder / "rgb")
    touch(folder, "rgb.mp4")
    with pytest.raises(InputError, match=r"ffmpeg -i rgb.mp4 -start_number 0 .* rgb/%06d.jpg"):
        assert StoredSequence(folder).pairs


def test_polycam_without_lidar_has_poses_alone(scanned):
    folder, _ = scanned("polycam")
    shutil.rmtree(folder / "keyframes/depth")
    with pytest.raises(InputError, match="keyframes/depth, which LiDAR sessions have"):
        assert StoredSequence(folder).pairs
    loaded = read_trajectory(folder / "keyframes/cameras")
    assert np.abs(loaded.trajectory.T_world_camera.matrix - scans.POSES.matrix).max() < 1e-7


DEPTH = np.linspace(0.5, 4, 12, dtype=np.float32).reshape(3, 4)
OTHER = np.zeros_like(DEPTH)


@pytest.mark.parametrize(
    "channels",
    [
        {"Z": DEPTH},
        {"R": OTHER, "G": OTHER, "B": OTHER, "Z": DEPTH},
        {"V": DEPTH},
        {"Depth.V": DEPTH},
        {"ViewLayer.Depth.Z": DEPTH, "ViewLayer.Normal.Z": OTHER, "ViewLayer.Combined.R": OTHER},
        {"R": DEPTH, "G": DEPTH, "B": DEPTH, "A": OTHER},
        {"left.Z": DEPTH, "left.Normal.Z": OTHER, "left.R": OTHER},
    ],
)
def test_the_channel_of_depth_is_found_by_its_name(tmp_path, channels):
    write_exr(tmp_path / "a.exr", channels)
    assert np.array_equal(read_depth_m(tmp_path / "a.exr", 5000.0), DEPTH)


def test_an_exr_without_depth_is_refused_with_its_channels(tmp_path):
    write_exr(tmp_path / "a.exr", {"Normal.X": DEPTH, "Normal.Y": OTHER, "Normal.Z": OTHER})
    with pytest.raises(InputError, match=r"a.exr: .*found channels Normal.X, Normal.Y, Normal.Z"):
        read_metres(tmp_path / "a.exr")


@pytest.mark.parametrize("kind", [np.float32, np.float16])
def test_no_surface_in_an_exr_is_no_depth(tmp_path, kind):
    depth = DEPTH.copy()
    depth[0] = [1e10, np.inf, np.nan, 65504]
    with np.errstate(over="ignore"):
        write_exr(tmp_path / "a.exr", {"V": depth.astype(kind)})
    found = read_depth_m(tmp_path / "a.exr", 5000.0)
    assert (found[0] == 0).all() and np.abs(found[1:] / DEPTH[1:] - 1).max() < 1e-3


def test_formats_that_are_only_read_are_no_output():
    from iclnuim.sequences.sequence_formats import FORMATS

    assert not {format.name for format in READ_ONLY} & set(FORMATS)


#: Files that are damaged in turn, by the folder's writer.
DAMAGED = {
    "7-scenes": ("frame-000001.pose.txt", "frame-000002.depth.png"),
    "bundle-fusion": ("info.txt", "frame-000001.pose.txt"),
    "open3d": ("camera_intrinsic.json", "scene/trajectory.log"),
    "polycam": ("keyframes/corrected_cameras/52000066000.json",),
    "tum with exr": ("depth/0001.exr", "camera.json"),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("files", [24, pytest.param(2000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_folders_are_read_or_refused(scanned, name, files):
    folder, _ = scanned(name)
    for pair in StoredSequence(folder).pairs[3:]:  # fewer images are read faster
        pair.rgb.unlink()
    refused = 0
    for file in DAMAGED[name]:
        whole = (folder / file).read_bytes()
        count = -(-files // len(DAMAGED[name]))
        refused += read_all(
            folder / file, whole, [12], count, lambda: read_sequence(folder), check_sequence, folder
        )[1]
        (folder / file).write_bytes(whole)
    assert refused
    assert format_of(folder).name == scans.READ_AS.get(name, name)
    check_sequence(read_sequence(folder))


def test_trajectories_of_phones_are_read_alone(scanned):
    folder, _ = scanned("record3d")
    loaded = read_trajectory(folder / "metadata.json")
    check_trajectory(loaded)
    assert loaded.read_as.format == "record3d" and not loaded.is_counted
    assert np.abs(loaded.trajectory.T_world_camera.matrix - scans.POSES.matrix).max() < 1e-7


PHONES = {"stray-scanner": ".png", "record3d": ".exr"}


def depths_of(folder):
    sequence = StoredSequence(folder)
    return [sequence.images(pair)[1] for pair in sequence.pairs]


@pytest.mark.parametrize("name", PHONES)
def test_a_phones_folder_holds_the_depth_that_the_sensor_gives(tmp_path, name):
    """The phone's model has one value for each pixel of its image, which is all that is stored."""
    camera = scans.CAMERA.resized(640, 480)
    poses = scans.POSES[:2]

    def load(number):
        light = np.random.default_rng(number).uniform(0.2, 0.8, (480, 640, 3)).astype(np.float32)
        return light, depth_z_m(poses[number], camera).astype(np.float32)

    source = frames_from(camera, Trajectory.at_rate(poses), load)
    settings = SequenceSettings(depth=depth_model("phone"), seed=3)
    write_sequence(source, tmp_path / "out", settings, formats=[name], workers=1)
    sequence = StoredSequence(tmp_path / "out")
    small = camera.narrowed(256)
    assert (small.width, small.height) == (256, 192)
    assert np.abs(sequence.camera.pinhole.intrinsics - small.intrinsics).max() < 1e-6
    for number, depth_m in enumerate(depths_of(tmp_path / "out")):
        light, true_m = load(number)
        model = depth_model("phone", {"size": "native"})
        rng = frame_generator(3, number, noise_model.DEPTH)
        native_m = with_depth_noise(model, true_m, camera, rng, light)
        step = 5.1e-4 if name == "stray-scanner" else 0.0
        assert depth_m.shape == (192, 256) and np.abs(depth_m - native_m).max() <= step


@pytest.mark.parametrize("size", ["640x480", "200x150"])
def test_a_stray_scanner_folder_has_the_confidence_of_each_depth(tmp_path, size):
    import cv2

    camera = PinholeCamera.parse(size)
    shape = (camera.height, camera.width)
    u = np.linspace(0, 1, camera.width)
    dark_and_far = np.broadcast_to(np.where(u < 0.5, 0.4, 0.02)[:, None], (*shape, 3))
    depth_m = np.full(shape, 2.0)
    light = dark_and_far.astype(np.float32)
    source = frames_from(camera, Trajectory.at_rate(scans.POSES[:2]), lambda i: (light, depth_m))
    formats = ["stray-scanner", "record3d", "tum"]
    settings = {n: SequenceSettings(depth=depth_model(n), seed=3) for n in ("phone", "d435")}
    for noise, of_it in settings.items():
        write_sequence(source, tmp_path / noise, of_it, formats=formats, workers=1)
    found = {path.parent.relative_to(tmp_path) for path in tmp_path.rglob("confidence/*")}
    assert found == {Path("phone/stray-scanner/confidence")}
    for number in (0, 1):
        _, confidence, _ = phone_depth(depth_m, camera, 3, number, rgb=light)
        written = tmp_path / f"phone/stray-scanner/confidence/{number:06}.png"
        assert (cv2.imread(str(written), cv2.IMREAD_UNCHANGED) == confidence).all()
        assert set(np.unique(confidence)) == {0, 1, 2}
    journal = (tmp_path / "phone/frames.jsonl").read_text()
    written.unlink()  # the last one: a sequence without it is not complete, and is mended
    write_sequence(source, tmp_path / "phone", settings["phone"], formats=formats, workers=1)
    assert written.is_file() and (tmp_path / "phone/frames.jsonl").read_text() == journal


@pytest.mark.parametrize("name", PHONES)
def test_a_phones_folder_goes_into_itself_byte_for_byte(scanned, tmp_path, name):
    folder, _ = scanned("open3d")
    for out, source in (("a", folder), ("b", tmp_path / "a"), ("c", tmp_path / "b")):
        write_sequence(original_frames(source), tmp_path / out, formats=[name], workers=1)
    for path in (tmp_path / "b/depth").iterdir():
        assert path.read_bytes() == (tmp_path / "c/depth" / path.name).read_bytes()
    texts = {"odometry.csv", "camera_matrix.csv", "metadata.json"}
    for text in texts & {path.name for path in (tmp_path / "b").iterdir()}:
        assert (tmp_path / "b" / text).read_bytes() == (tmp_path / "c" / text).read_bytes()


def test_the_video_of_stray_scanner_has_every_frame(scanned, tmp_path):
    import cv2

    folder, _ = scanned("open3d")
    write_sequence(original_frames(folder), tmp_path / "out", formats=["stray-scanner"], workers=1)
    video = cv2.VideoCapture(str(tmp_path / "out/rgb.mp4"))
    found = [round((int(video.read()[1][-9, -9, 0]) - 10) / 20) for _ in range(scans.FRAMES)]
    assert found == list(range(scans.FRAMES)) and not video.read()[0]
    odometry = np.loadtxt(tmp_path / "out/odometry.csv", delimiter=",", skiprows=1)
    T = SE3.from_quat_xyzw(odometry[:, 5:9], odometry[:, 2:5])  # as StrayVisualizer reads them
    assert np.abs(T.matrix - scans.POSES.matrix).max() < 1e-7


def test_metadata_of_record3d_is_as_nerfstudio_reads_it(scanned, tmp_path):
    from scipy.spatial.transform import Rotation

    folder, camera = scanned("open3d")
    write_sequence(original_frames(folder), tmp_path / "out", formats=["record3d"], workers=1)
    content = json.loads((tmp_path / "out/metadata.json").read_text())
    K = np.array(content["K"]).reshape(3, 3).T
    assert np.abs(K - camera.K).max() < 1e-9 and (content["w"], content["h"]) == (160, 120)
    poses = np.array(content["poses"])
    rotations = Rotation.from_quat(poses[:, :4]).as_matrix()
    assert np.abs(rotations - scans.OPENGL[:, :3, :3]).max() < 1e-7
    assert np.abs(poses[:, 4:] - scans.OPENGL[:, :3, 3]).max() < 1e-7
