"""EDEX, as cuVSLAM's tools write and read it: the keys that they read, what they mean, and rigs."""

import json

import numpy as np
import pytest
from iclnuim.channels import DEPTH, RGB
from iclnuim.errors import InputError
from iclnuim.geometry.se3 import SE3
from iclnuim.sequences.frame_source import original_frames
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@pytest.fixture
def edex(all_formats, tmp_path):
    """A sequence in the format, a test's own."""
    write_sequence(original_frames(all_formats / "tum"), tmp_path / "out", formats=["edex"])
    return tmp_path / "out"


def rig_of(folder):
    return json.loads((folder / "stereo.edex").read_text())


def changed(folder, change):
    head, body = rig_of(folder)
    change(head, body)
    (folder / "stereo.edex").write_text(json.dumps([head, body]))


def test_it_has_the_keys_that_their_tools_read(edex):
    """read_stereo_edex and the replay of PyCuVSLAM, and Intrinsics, EDEXHeader and EDEXBody of the
    tools of cuVSLAM.
    """
    head, body = rig_of(edex)
    (camera,) = head["cameras"]
    assert {"version", "frame_start", "frame_end"} <= set(head)
    assert np.shape(camera["transform"]) == (3, 4)
    assert camera["intrinsics"]["distortion_model"] == "pinhole"
    assert camera["intrinsics"]["distortion_params"] == []
    for key in ("focal", "principal", "size"):
        assert len(camera["intrinsics"][key]) == 2
    assert all(isinstance(pixels, int) for pixels in camera["intrinsics"]["size"])
    assert body["frame_metadata"] == "frame_metadata.jsonl"
    lines = (edex / "frame_metadata.jsonl").read_text().splitlines()
    assert head["frame_end"] - head["frame_start"] + 1 == len(lines) == 4
    for place, line in enumerate(lines):
        frame = json.loads(line)
        assert frame["frame_id"] == place
        for key in ("cams", "depth"):
            (image,) = frame[key]
            assert image["id"] == camera["depth_id"] == 0
            assert isinstance(image["timestamp"], int) and (edex / image["filename"]).is_file()


def test_its_poses_are_those_of_the_sequence_relative_to_the_first(edex, all_formats):
    rows = np.loadtxt(edex / "gt.txt").reshape(-1, 3, 4)
    assert np.array_equal(rows[0], np.eye(4)[:3])
    T = StoredSequence(all_formats / "tum").truth.T_world_camera
    assert np.abs(rows - (T[0].inverse() @ T).matrix[:, :3]).max() < 1e-9


def test_depth_keeps_stamps_of_its_own(all_formats, tmp_path):
    late = tmp_path / "tum"
    write_sequence(original_frames(all_formats / "tum"), late, formats=["tum"])
    for name in ("depth.txt", "associations.txt"):
        text = (late / name).read_text()
        head, *rows = text.splitlines() if name == "depth.txt" else ["", *text.splitlines()]
        lines = [row.split() for row in rows]
        column = 0 if name == "depth.txt" else 2
        for fields in lines:
            fields[column] = f"{float(fields[column]) + 0.015:.6f}"
        rows = [" ".join(fields) for fields in lines]
        (late / name).write_text("\n".join([head, *rows][not head :]) + "\n")
    write_sequence(original_frames(late), tmp_path / "out", formats=["edex"])
    before, after = (StoredSequence(folder).pairs for folder in (late, tmp_path / "out"))
    assert [pair.written for pair in before] == [pair.written for pair in after]
    assert after[0].depth_stamp_s - after[0].stamp_s == pytest.approx(0.015)


def test_a_camera_on_a_rig_has_its_own_pose(edex):
    """transform is the pose of the camera in the rig, both with OpenGL's axes; gt.txt the rig's."""
    T_rig_camera = SE3.exp(np.array([0.1, -0.2, 0.3, 0.4, 0.1, -0.3]))
    before = StoredSequence(edex).truth.T_world_camera.matrix

    def mount(head, body):
        transform = FLIP @ T_rig_camera.matrix @ FLIP
        head["cameras"][0]["transform"] = transform[:3].tolist()

    changed(edex, mount)
    sequence = StoredSequence(edex)
    assert np.abs(sequence.truth.T_world_camera.matrix - before @ T_rig_camera.matrix).max() < 1e-9
    assert any("transform is applied" in note for note in sequence.camera.notes)


def test_the_camera_with_depth_is_read_of_several(edex):
    def add(head, body):
        other = json.loads(json.dumps(head["cameras"][0]))
        del other["depth_id"], other["depth_scale_factor"]
        other["intrinsics"]["focal"] = [1.5, 1.5]
        head["cameras"].insert(0, other)

    changed(edex, add)
    file = edex / "frame_metadata.jsonl"
    frames = [json.loads(line) for line in file.read_text().splitlines()]
    for frame in frames:
        frame["cams"][0]["id"] = 1
        frame["cams"].insert(0, {"id": 0, "filename": "left.png", "timestamp": 1})
    file.write_text("".join(json.dumps(frame) + "\n" for frame in frames))
    sequence = StoredSequence(edex)
    assert sequence.camera.pinhole.fx == 48.0 and len(sequence.pairs) == 4
    assert "has 2 cameras, of which number 1 is read" in str(sequence.camera.notes)


def test_stereo_alone_and_a_fisheye_are_refused_in_a_line(edex):
    def without(head, body):
        del head["cameras"][0]["depth_id"]

    def fisheye(head, body):
        head["cameras"][0]["intrinsics"]["distortion_model"] = "fisheye"

    whole = (edex / "stereo.edex").read_bytes()
    changed(edex, without)
    with pytest.raises(InputError, match=r"stereo.edex: expected a camera with depth_id, found 1"):
        assert StoredSequence(edex).pairs
    (edex / "stereo.edex").write_bytes(whole)
    changed(edex, fisheye)
    with pytest.raises(InputError, match=r"a pinhole camera, found distortion_model fisheye"):
        assert StoredSequence(edex).camera


def test_labels_and_other_channels_have_folders_of_their_own(labelled_formats):
    names = {path.name for path in (labelled_formats / "edex").iterdir() if path.is_dir()}
    assert {"00", "01", "instance", "class"} <= names and RGB not in names and DEPTH not in names
