"""What files of other programs say of the camera is applied, refused or noted, never ignored without
a word.
"""

import json
import math
import re
import shutil
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.se3 import SE3
from iclnuim.sequences.camera_files import DISTORTED
from iclnuim.sequences.frame_source import image_frames
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.layouts import euroc, nerf, replica, vslam_lab
from iclnuim.sequences.layouts.scannet import SCAN
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.trajectory_files.colmap import (
    MODELS,
)
from iclnuim.trajectory_files.trajectories import read_trajectory

CAMERA_KEYS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")
sys.path.insert(0, str(Path(__file__).parents[1]))
from colmap_binary import made_binary  # noqa: E402

# files of the cameras of euroc and vslam-lab
CAMERAS = ("mav0/cam0/sensor.yaml", "mav0/depth0/sensor.yaml", "calibration.yaml")
BODY = SE3.exp(np.array([0.1, -0.2, 0.05, 0.3, 1.2, -0.7]))


@pytest.fixture
def copied(all_formats, tmp_path):
    """`copied(name)`: an own copy of the sequence in this format."""

    def copy(name: str):
        return shutil.copytree(all_formats / name, tmp_path / name)

    return copy


def camera_of(folder):
    return StoredSequence(folder).camera


def matrix_text(T: SE3) -> str:
    return ", ".join(f"{value:.17g}" for value in T.matrix.ravel())


def replaced(path, old: str, new: str) -> None:
    text = path.read_text()
    assert re.search(old, text)
    path.write_text(re.sub(old, lambda found: new, text))


def changed_nerf(copied, change):
    folder = copied("nerf")
    content = json.loads((folder / "transforms.json").read_text())
    change(content)
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder


def into_frames(content):
    own = {key: content.pop(key) for key in CAMERA_KEYS}
    content["frames"] = [frame | own for frame in content["frames"]]


def angles_alone(content):
    for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        del content[key]


def degrees_alone(content):
    content["x_fov"] = math.degrees(content["camera_angle_x"])
    for key in ("fl_x", "fl_y", "camera_angle_x", "camera_angle_y"):
        del content[key]


def names_without_endings(content):
    for frame in content["frames"]:
        for key in ("file_path", "depth_file_path"):
            frame[key] = "./" + frame[key].removesuffix(".png")


def windows_names(content):
    for frame in content["frames"]:
        for key in ("file_path", "depth_file_path"):
            frame[key] = frame[key].replace("/", "\\")


def depth_path_alone(content):
    for frame in content["frames"]:
        del frame["depth_file_path"]


def three_rows(content):
    for frame in content["frames"]:
        del frame["transform_matrix"][3]


def texts(content):
    for frame in content["frames"]:
        rows = frame["transform_matrix"]
        frame["transform_matrix"] = [[repr(value) for value in row] for row in rows]
    content |= {key: str(content[key]) for key in CAMERA_KEYS}


def scaled_poses(content):
    content["applied_scale"] = 0.25
    for frame in content["frames"]:
        for row in frame["transform_matrix"][:3]:
            row[3] *= 0.25


def other_key_of_the_depth_scale(content):
    content["depth_unit_scale_factor"] = content.pop("integer_depth_scale")


def neutral(content):
    content |= {"camera_model": "PINHOLE", "is_fisheye": False, "k3": 0, "k4": None}
    content |= {"applied_transform": np.eye(4)[:3].tolist(), "scale": 1.0, "offset": [0, 0, 0]}
    content |= {"aabb_scale": 16, "applied_scale": 1, "orientation_override": "none"}
    content |= {"rolling_shutter": [0, 0, 0, 0], "ply_file_path": "sparse.ply"}
    content["frames"][0] |= {"colmap_im_id": 4, "is_bad": False, "sharpness": 12.5}


@pytest.mark.parametrize(
    "change",
    [
        into_frames,
        angles_alone,
        degrees_alone,
        names_without_endings,
        windows_names,
        depth_path_alone,
        three_rows,
        texts,
        scaled_poses,
        other_key_of_the_depth_scale,
        neutral,
    ],
)
def test_transforms_of_other_programs_are_the_same_sequence(copied, all_formats, change):
    folder = changed_nerf(copied, change)
    camera = camera_of(folder)
    expected = camera_of(all_formats / "nerf")
    assert camera.pinhole.intrinsics == pytest.approx(expected.pinhole.intrinsics, rel=1e-9)
    assert camera.depth_units_per_metre == pytest.approx(expected.depth_units_per_metre)
    assert camera.notes == ()
    truth = StoredSequence(all_formats / "nerf").truth.T_world_camera.matrix
    assert np.allclose(StoredSequence(folder).truth.T_world_camera.matrix, truth, atol=1e-12)
    assert [pair.depth.name for pair in StoredSequence(folder).pairs] == [
        pair.depth.name for pair in StoredSequence(all_formats / "nerf").pairs
    ]
    assert inspect_sequence(folder).warnings == inspect_sequence(all_formats / "nerf").warnings


def in_a_frame(**values):
    return lambda content: content["frames"][2].update(values)


def in_all(**values):
    return lambda content: content.update(values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (in_a_frame(fl_x=40), "frames with the same camera, found fl_x from 40 to 48"),
        (in_a_frame(cy=22.5), "the same camera, found cy"),
        (in_a_frame(w=32), "the same camera, found w"),
        (in_all(camera_model="OPENCV_FISHEYE"), "pinhole camera, found camera_model OPENCV_FISH"),
        (in_all(camera_model="EQUIRECTANGULAR"), "pinhole camera, found camera_model"),
        (in_a_frame(camera_model="ORTHOPHOTO"), "pinhole camera, found camera_model"),
        (in_all(is_fisheye=True), "pinhole camera, found is_fisheye"),
        (in_all(orthographic=True), "pinhole camera, found orthographic"),
        (in_all(ftheta_p0=0.0), "pinhole camera, found ftheta_p0"),
        (in_all(from_mitsuba=True), "from_mitsuba"),
        (in_all(integer_depth_scale=-1), "one depth scale above 0"),
        (in_all(depth_unit_scale_factor=0.0002), "one depth scale .* 0.001 and 0.0002"),
        (in_all(camera_angle_x=0), "camera_angle_x of less than half a turn"),
        (in_all(fl_y="wide"), "a number for fl_y"),
        (in_all(cx=[32]), "a number for cx"),
        (in_all(h=1e400), "finite|JSON|number"),
    ],
)
def test_transforms_with_another_camera_are_refused(copied, change, message):
    folder = changed_nerf(copied, change)
    with pytest.raises(InputError, match=message) as error:
        camera_of(folder)
    assert "transforms.json" in str(error.value)


@pytest.mark.parametrize(
    ("change", "note"),
    [
        (in_a_frame(k1=0.1), DISTORTED),
        (in_all(k3=0.1), DISTORTED),
        (in_all(p2="0.001"), DISTORTED),
        (in_all(distortion_params=[0, 0, 0, 0, 0, 0.1]), DISTORTED),
        (
            in_all(applied_transform=[[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]]),
            "applied_transform",
        ),
        (in_all(scale=0.33), "scale 0.33"),
        (in_all(offset=[0.5, 0.5, 0.5]), r"offset \[0.5"),
        (in_all(orientation_override="up"), "orientation_override up"),
        (in_all(rolling_shutter=[0, 0, 1, 0]), "rolling_shutter"),
        (in_a_frame(mask_path="masks/2.png"), "mask_path"),
        (in_a_frame(is_bad=True), "is_bad True"),
        (in_a_frame(transform_matrix_start=[[1]]), "transform_matrix_start"),
        (in_all(depth_offset=0.5), "depth_offset 0.5"),
        (in_all(camera_angle_x=1.0), "fl_x gives a focal length of 48 .*camera_angle_x gives 58"),
    ],
)
def test_what_transforms_say_and_is_not_applied_is_noted(copied, change, note, command_here):
    folder = changed_nerf(copied, change)
    assert any(re.search(note, sentence) for sentence in camera_of(folder).notes)
    assert any(re.search(note, sentence) for sentence in inspect_sequence(folder).warnings)
    code, _, noted = command_here("convert", folder, folder.parent / "out")
    assert code == 0 and re.search(note, noted)


@pytest.mark.parametrize(
    ("format", "depth"), [("nerf", "depth/000002.png"), ("colmap", "depth/000002.png")]
)
def test_a_frame_without_its_depth_image_is_left_out_with_a_note(
    copied, format, depth, command_here
):
    folder = copied(format)
    (folder / depth).unlink()
    assert [pair.number for pair in StoredSequence(folder).pairs] == [0, 1, 3]
    found = inspect_sequence(folder)
    assert not any("000002.png" in error for error in found.errors)
    assert any("000002.png" in warning for warning in found.warnings)
    code, _, noted = command_here("convert", folder, folder.parent / "out")
    assert code == 0 and "000002.png" in noted
    shutil.rmtree(folder / "depth")
    with pytest.raises(InputError, match="has no depth/000000.png"):
        assert StoredSequence(folder).pairs


def test_a_frame_of_transforms_that_names_no_depth_is_left_out(copied):
    folder = changed_nerf(copied, lambda content: content["frames"].append({"file_path": "a.png"}))
    assert len(StoredSequence(folder).pairs) == 4


def with_body(folder, file: str, T: SE3):
    replaced(folder / file, r"\[1.0, 0.0, 0.0, 0.0, 0.0, 1.0[^\]]*\]", f"[{matrix_text(T)}]")


@pytest.mark.parametrize(
    ("format", "files"),
    [
        ("euroc", ("mav0/cam0/sensor.yaml", "mav0/depth0/sensor.yaml")),
        ("vslam-lab", ("calibration.yaml",)),
    ],
)
def test_poses_of_a_body_become_those_of_its_camera(
    copied, all_formats, format, files, command_here
):
    folder = copied(format)
    for file in files:
        with_body(folder, file, BODY)
    truth = StoredSequence(all_formats / format).truth
    moved = StoredSequence(folder).truth
    expected = (truth.T_world_camera @ BODY).matrix
    assert np.allclose(moved.T_world_camera.matrix, expected, atol=1e-9)
    assert "T_BS" in StoredSequence(folder).loaded_truth.read_as.sentence
    (note,) = camera_of(folder).notes
    assert note.startswith("T_BS is applied") and f"{_distance_mm():.3g} mm" in note
    # a copy in the same format has the poses of the camera, not the file of the body
    numbers = image_frames(folder).numbers
    assert image_frames(folder).truth_file(numbers) is None
    assert image_frames(all_formats / format).truth_file(numbers) is not None
    truth_file = StoredSequence(folder).truth_path
    for reference, is_body in ((truth_file, True), (folder, False)):
        code, _, said = command_here("evaluate", reference, truth_file, "--align", "none")
        assert code == 0 and ("poses of the body, without T_BS" in said) == is_body
    right = StoredSequence(all_formats / format).truth_path
    code, _, said = command_here("evaluate", right, truth_file, "--align", "none")
    assert code == 0 and "of the body" not in said
    code, _, _ = command_here("convert", folder, folder.parent / "out")
    written = StoredSequence(folder.parent / "out").truth.T_world_camera.matrix
    assert code == 0 and np.allclose(written, expected, atol=1e-6)


def _distance_mm() -> float:
    return 1000 * np.linalg.norm(BODY.translation)


def test_the_lists_of_euroc_may_have_names_of_columns_blanks_and_commas_at_the_end(copied):
    folder = copied("euroc")
    names = [pair.rgb for pair in StoredSequence(folder).pairs]
    for sensor in ("cam0", "depth0"):
        file = folder / f"mav0/{sensor}/data.csv"
        lines = file.read_text().splitlines()[1:]
        text = "timestamp,filename\r\n" + "".join(f" {line} ,\r\n" for line in lines)
        file.write_text(text.replace(",1", ", 1"), newline="")
    assert [pair.rgb for pair in StoredSequence(folder).pairs] == names
    file.write_text(text.replace("timestamp", "0"), newline="")
    assert len(StoredSequence(folder).pairs) == len(names)
    file.write_text(text + "later,1.png\n", newline="")
    with pytest.raises(InputError, match="data.csv:6: expected lines `nanoseconds,image`"):
        assert StoredSequence(folder).pairs


def test_a_sensor_without_a_pose_has_that_of_the_other(copied, all_formats):
    folder = copied("euroc")
    with_body(folder, CAMERAS[0], BODY)
    replaced(folder / CAMERAS[1], r"T_BS:\n(.*\n){3}", "")
    expected = StoredSequence(all_formats / "euroc").truth.T_world_camera @ BODY
    assert np.allclose(
        StoredSequence(folder).truth.T_world_camera.matrix, expected.matrix, atol=1e-9
    )
    (note,) = camera_of(folder).notes
    assert note.startswith("T_BS is applied")


def test_euroc_poses_of_another_body_than_the_cameras_are_converted(copied, all_formats):
    folder = copied("euroc")
    for file in ("mav0/cam0/sensor.yaml", "mav0/depth0/sensor.yaml"):
        with_body(folder, file, BODY)
    tracked = SE3.exp(np.array([0, 0.3, 0.1, 1, 0.4, 0.2]))
    rows = "\n    ".join(f"{value:.17g}," for value in tracked.matrix.ravel()).removesuffix(",")
    sensor = folder / "mav0/state_groundtruth_estimate0/sensor.yaml"
    sensor.write_text(f"%YAML:1.0\n# Vicon\nT_BS: !!opencv-matrix\n  rows: 4\n  data: [{rows}]\n")
    expected = StoredSequence(all_formats / "euroc").truth.T_world_camera @ tracked.inverse() @ BODY
    assert np.allclose(
        StoredSequence(folder).truth.T_world_camera.matrix, expected.matrix, atol=1e-9
    )


@pytest.mark.parametrize(
    ("file", "old", "new", "note"),
    [
        (0, r"\[0.0, 0.0, 0.0, 0.0\]", "[-0.28, 0.07, 0, 0]", DISTORTED),
        (1, r"\[0.0, 0.0, 0.0, 0.0\]", "\n  - 0.0\n  - 0.01", DISTORTED),
        (
            0,
            "comment",
            "timeshift_cam_imu: 0.0125\ncomment",
            "sensor.yaml .* timeshift_cam_imu 0.01",
        ),
        (1, "comment", "shutter: rolling\ncomment", "shutter rolling"),
        (0, "data: .*", f"data: [{matrix_text(BODY)}]", "T_BS of cam0 and depth0 differ"),
        (2, "fps", "distortion_coefficients: [0.26, -0.95],\n     fps", DISTORTED),
        (2, "fps", "line_delay: 0.00003,\n     fps", "line_delay 0.00003"),
    ],
)
def test_what_a_sensor_file_says_and_is_not_applied_is_noted(copied, file, old, new, note):
    folder = copied("vslam-lab" if file == 2 else "euroc")
    replaced(folder / CAMERAS[file], old, new)
    assert any(re.search(note, sentence) for sentence in camera_of(folder).notes)
    assert any(re.search(note, sentence) for sentence in inspect_sequence(folder).warnings)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (0, "radial-tangential", "equidistant", "found distortion_model equidistant"),
        (1, "camera_model: pinhole", "camera_model: omni", "found camera_model omni"),
        (0, "data: .*", "data: [1, 2]", "T_BS with the 16 numbers"),
        (0, "data: .*", f"data: [{'2, ' * 15}2]", "sensor.yaml"),
        (1, "resolution: .*", "resolution: [64]", "resolution: .w, h. and intrinsics"),
        (1, "resolution: .*", "resolution: [64, 48", "sensor.yaml:.*: expected YAML"),
        (2, "cam_model: pinhole", "cam_model: pinhole, distortion_type: equid4", "equid4"),
        (2, "cam_name: rgb_0", "cam_name: rgb_1", "the camera rgb_0"),
    ],
)
def test_a_sensor_file_of_another_camera_is_refused(copied, file, old, new, message):
    folder = copied("vslam-lab" if file == 2 else "euroc")
    replaced(folder / CAMERAS[file], old, new)
    with pytest.raises(InputError, match=message) as error:
        camera_of(folder)
    assert str(folder) in str(error.value)


def test_another_colour_camera_of_euroc_is_read(copied):
    folder = copied("euroc")
    replaced(folder / CAMERAS[0], "intrinsics: .*", "intrinsics: [50, 50, 30, 24]")
    camera = camera_of(folder)
    assert camera.colour.intrinsics.tolist() == [50, 50, 30, 24]
    assert camera.pinhole.intrinsics.tolist() == [48, 48, 31.5, 23.5]


def test_the_camera_of_vslam_lab_is_that_of_the_list_also_beside_a_second_one(copied):
    folder = copied("vslam-lab")
    text = (folder / CAMERAS[2]).read_text()
    second = "  - {cam_name: rgb_1, cam_model: pinhole, focal_length: [1, 1], fps: 30}\n"
    (folder / CAMERAS[2]).write_text(text + second)
    assert camera_of(folder).pinhole.fx == 48


@pytest.mark.parametrize(
    ("line", "note"),
    [
        ("1 SIMPLE_PINHOLE 64 48 48 32 24", ()),
        ("1 SIMPLE_RADIAL 64 48 48 32 24 0", ()),
        ("1 RADIAL 64 48 48 32 24 0 0.0", ()),
        ("1 OPENCV 64 48 48 48 32 24 0 0 0 0", ()),
        ("1 FULL_OPENCV 64 48 48 48 32 24 0 0 0 0 0 0 0 0", ()),
        ("1 DIVISION 64 48 48 48 32 24 0", ()),
        ("1 PINHOLE 64 48 48 48 32 24\n7 PINHOLE 64 48 90 90 32 24", ()),
        ("1 SIMPLE_RADIAL 64 48 48 32 24 -0.02", (DISTORTED,)),
        ("1 OPENCV 64 48 48 48 32 24 0 0 0 0.001", (DISTORTED,)),
    ],
)
def test_cameras_of_colmap(copied, line, note):
    folder = copied("colmap")
    (folder / "sparse/0/cameras.txt").write_text(f"# cameras\n{line}\n")
    camera = camera_of(folder)
    assert camera.pinhole.intrinsics.tolist() == [48, 48, 31.5, 23.5]
    assert camera.notes == note and camera.depth_units_per_metre == 5000


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("1 OPENCV_FISHEYE 64 48 48 48 32 24 0 0 0 0", "pinhole .*found OPENCV_FISHEYE"),
        ("1 FOV 64 48 48 48 32 24 0", "pinhole .*found FOV"),
        ("1 SIMPLE_FISHEYE 64 48 48 32 24", "pinhole .*found SIMPLE_FISHEYE"),
        ("1 EQUIRECTANGULAR 64 48 64 48", "pinhole .*found EQUIRECTANGULAR"),
        ("1 NEW 64 48 48 32 24", "a camera model of COLMAP, found NEW"),
        ("1", "a camera model of COLMAP"),
        ("1 PINHOLE 64 48 48 32 24", "numbers of a PINHOLE"),
        ("1 PINHOLE 64 48 48 x 32 24", "numbers of a PINHOLE"),
        ("2 PINHOLE 64 48 48 48 32 24", "the cameras of images.txt, found no camera 1"),
    ],
)
def test_other_cameras_of_colmap_are_refused(copied, lines, message):
    folder = copied("colmap")
    (folder / "sparse/0/cameras.txt").write_text(lines + "\n")
    with pytest.raises(InputError, match=message) as error:
        camera_of(folder)
    assert "cameras.txt" in str(error.value)


def second_camera(folder, line: str) -> None:
    model = folder / "sparse/0"
    replaced(model / "images.txt", " 1 000002.png", " 2 000002.png")
    (model / "cameras.txt").write_text(f"1 PINHOLE 64 48 48 48 32 24\n{line}\n")


def test_images_of_several_cameras_in_colmap(copied):
    folder = copied("colmap")
    second_camera(folder, "2 PINHOLE 64 48 48 48 32 24")
    assert camera_of(folder).pinhole.fx == 48
    (folder / "sparse/0/cameras.txt").write_text(
        "1 PINHOLE 64 48 48 48 32 24\n2 PINHOLE 64 48 50 50 32 24\n"
    )
    with pytest.raises(InputError, match="one camera, .* found 2 different cameras"):
        camera_of(folder)


def test_a_binary_model_of_colmap_is_read(copied, all_formats):
    folder = copied("colmap")
    made_binary(folder / "sparse/0")
    assert camera_of(folder) == camera_of(all_formats / "colmap")
    names = [pair.rgb.name for pair in StoredSequence(folder).pairs]
    assert names == [pair.rgb.name for pair in StoredSequence(all_formats / "colmap").pairs]
    expected = StoredSequence(all_formats / "colmap").truth.T_world_camera.matrix
    assert np.allclose(StoredSequence(folder).truth.T_world_camera.matrix, expected, atol=1e-12)
    assert read_trajectory(folder / "sparse/0/images.bin").read_as.format == "colmap"
    whole = (folder / "sparse/0/images.bin").read_bytes()
    for data in (whole[:-40], b"", whole[:90]):
        (folder / "sparse/0/images.bin").write_bytes(data)
        with pytest.raises(InputError, match=r"images.bin: expected a whole binary file"):
            assert StoredSequence(folder).pairs


def test_a_binary_camera_of_colmap_that_is_damaged_or_unknown_is_refused(copied):
    folder = copied("colmap")
    made_binary(folder / "sparse/0")
    file = folder / "sparse/0/cameras.bin"
    whole = file.read_bytes()
    for data, message in (
        (whole[:-1], "a whole binary file"),
        (whole[:12] + struct.pack("<i", len(MODELS)) + whole[16:], "a camera model of COLMAP"),
        (whole[:12] + struct.pack("<i", 5) + whole[16:], "a whole binary file"),
    ):
        file.write_bytes(data)
        with pytest.raises(InputError, match=message):
            camera_of(folder)


ALIGNMENT = "axisAlignment = 0.9 0.4 0 -2 -0.4 0.9 0 1 0 0 1 0 0 0 0 1\ncolorWidth = 64\n"


@pytest.mark.parametrize(
    ("format", "file", "content", "note"),
    [
        ("scannet", "frames/intrinsic/extrinsic_color.txt", BODY, "extrinsic_color"),
        ("scannet", "frames/intrinsic/extrinsic_depth.txt", BODY, "extrinsic_depth"),
        ("scannet", "scene0000_00.txt", ALIGNMENT, "axisAlignment"),
        ("scannet", "frames/scene0000_00.txt", ALIGNMENT, "axisAlignment"),
        ("replica", "cam_params.json", {"k1": 0.1}, DISTORTED),
        ("replica", "cam_params.json", {"crop_edge": 8}, "crop_edge 8"),
        ("replica", "cam_params.json", {"depth_trunc": 4}, "depth_trunc 4"),
    ],
)
def test_what_other_files_say_and_is_not_applied_is_noted(copied, format, file, content, note):
    folder = copied(format)
    assert camera_of(folder).notes == ()
    path = folder / file
    if isinstance(content, SE3):
        path.write_text(matrix_text(content).replace(",", " "))
    elif isinstance(content, dict):
        known = json.loads(path.read_text())
        path.write_text(json.dumps({"camera": known["camera"] | content}))
    else:
        path.write_text(content)
    (found,) = camera_of(folder).notes
    assert note in found


def test_a_distortion_in_camera_json_is_noted(copied):
    folder = copied("tum")
    known = json.loads((folder / "camera.json").read_text())
    for coefficients, notes in (
        ({"k1": 0, "distortion": [0.0, 0]}, ()),
        ({"distortion": [0.0, 0.1]}, (DISTORTED,)),
    ):
        (folder / "camera.json").write_text(json.dumps(known | coefficients))
        assert camera_of(folder).notes == notes
    (folder / "camera.json").write_text(json.dumps(known | {"skew": 0.1}))
    with pytest.raises(InputError, match="skew"):
        camera_of(folder)


def test_another_colour_camera_of_the_same_size_is_read_in_scannet(copied):
    folder = copied("scannet")
    replaced(folder / "frames/intrinsic/intrinsic_color.txt", "^48 0 31.5", "50 0 30")
    assert camera_of(folder).colour.intrinsics.tolist() == [50, 48, 30, 23.5]


@pytest.mark.parametrize(
    ("format", "file", "old", "new"),
    [
        ("scannet", "frames/intrinsic/intrinsic_depth.txt", "^48 0 ", "48 0.5 "),
        ("scannet", "frames/intrinsic/intrinsic_color.txt", "0 0 1 0\n", "0 0 2 0\n"),
        ("icl-nuim", "calibration.txt", " 0.000000 31", " 0.500000 31"),
        ("icl-nuim", "calibration.txt", "1.000000", "2.000000"),
    ],
)
def test_a_camera_matrix_with_skew_is_refused(copied, format, file, old, new):
    folder = copied(format)
    replaced(folder / file, old, new)
    with pytest.raises(InputError, match=f"{file}: expected a camera matrix fx 0 cx"):
        camera_of(folder)


@pytest.mark.parametrize(("share", "differs"), [(0.007, False), (0.015, True)])
def test_keys_that_agree_but_for_rounding_are_the_same(copied, share, differs):
    def change(content):
        content["depth_unit_scale_factor"] = content["integer_depth_scale"]
        content["x_fov"] = 2 * math.degrees(math.atan(32 / (48 * (1 + share))))

    folder = changed_nerf(copied, change)
    assert bool(camera_of(folder).notes) == differs
    file = folder / "transforms.json"
    content = json.loads(file.read_text())
    content["depth_unit_scale_factor"] *= 1 + share
    file.write_text(json.dumps(content))
    if differs:
        with pytest.raises(InputError, match="one depth scale"):
            camera_of(folder)
    else:
        camera_of(folder)


@pytest.mark.parametrize(("change", "differs"), [(0.7e-6, False), (1.5e-6, True)])
def test_smaller_differences_than_a_millionth_are_rounding(copied, change, differs):
    other = SE3(np.eye(3), np.array([0, change, 0]))
    folder = changed_nerf(copied, in_all(applied_transform=other.matrix[:3].tolist()))
    assert bool(camera_of(folder).notes) == differs
    folder = copied("euroc")
    for file in CAMERAS[:2]:
        with_body(folder, file, other)
    assert bool(camera_of(folder).notes) == differs


@pytest.mark.parametrize(("change", "message"), [(0.7e-6, None), (1.5e-6, "the same camera")])
def test_cameras_of_frames_are_the_same_to_a_millionth(copied, change, message):
    folder = changed_nerf(copied, in_a_frame(fl_x=48 * (1 - change)))
    if message is None:
        camera_of(folder)
        return
    with pytest.raises(InputError, match=message):
        camera_of(folder)


@pytest.mark.parametrize("scale", [0.9e-6, 1.1e6, 0, -1, "x"])
def test_an_applied_scale_beyond_all_reason_is_refused(copied, scale):
    folder = changed_nerf(copied, in_all(applied_scale=scale))
    with pytest.raises(InputError, match="transforms.json: expected applied_scale of"):
        assert StoredSequence(folder).truth


@pytest.mark.parametrize("keys", [nerf.KEYS, euroc.KEYS, vslam_lab.KEYS, replica.KEYS, SCAN])
def test_every_key_of_a_format_has_one_meaning(keys, tmp_path):
    kinds = (keys.used, keys.harmless, keys.noted, keys.required, keys.distortion)
    assert len(set().union(*kinds)) == sum(map(len, kinds))
    for key in keys.required:
        with pytest.raises(InputError, match=f"found {key} other"):
            keys.notes([{key: "other"}], tmp_path)
    for key in [*keys.noted, "unknown"]:
        assert f"{key} other" in " ".join(keys.notes([{key: "other"}], tmp_path))
    for key in keys.used | keys.harmless:
        assert keys.notes([{key: "other"}], tmp_path) == ()
    for key in keys.distortion:
        assert keys.notes([{key: "other"}], tmp_path) == (DISTORTED,)
