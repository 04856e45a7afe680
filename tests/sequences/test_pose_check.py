"""Commands that read a sequence with poses warn when depth and poses do not agree, and say what to
try; `inspect` reports it as an error.
"""

import json
import shutil

import numpy as np
import pytest
from iclnuim.doubt.depth_against_poses import Agreement
from iclnuim.doubt.depth_hypotheses import conventions, scaled, shifted
from iclnuim.formats.files import read_json, write_json
from iclnuim.formats.png import read_depth16, write_png
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences import inspection
from iclnuim.sequences.camera_files import SequenceCamera
from iclnuim.sequences.frame_source import run_frames
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.pose_check import TOO_LITTLE, doubt, pose_agreement
from iclnuim.sequences.run_folder import open_run
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence
from iclnuim.trajectory_files.trajectories import write_trajectory
from moving_box import CAMERA, depth_z_m, hand_held

FRAMES = 12
METRES = SequenceCamera(CAMERA, 5000)


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    """A right sequence: format -> folder."""
    top = tmp_path_factory.mktemp("box")
    poses = hand_held(FRAMES, seed=8)
    recipe = {
        "job": {"camera": CAMERA.to_dict()},
        "trajectory_sha256": "a",
        "scene_sha256": "b",
        "blender": "none",
    }
    run = open_run(top / "raw", recipe, Trajectory.at_rate(poses))
    for i in range(FRAMES):
        depth_m = depth_z_m(poses[i]).astype(np.float32)
        run.write_frame(i, np.repeat((depth_m / 5)[..., None], 3, -1), depth_m)
    write_sequence(run_frames(run.path), top / "all", formats=list(FORMATS))
    return {name: top / "all" / name for name in FORMATS}


@pytest.fixture
def tum(box, tmp_path):
    return shutil.copytree(box["tum"], tmp_path / "sequence")


@pytest.mark.parametrize(("residual", "is_wrong"), [(0.008, False), (0.018, False), (0.025, True)])
def test_a_small_residual_without_an_explanation_is_no_error(tum, monkeypatch, residual, is_wrong):
    def unexplained(*_):
        return Agreement(residual, told=True, matches=False)

    monkeypatch.setattr(inspection, "pose_agreement", unexplained)
    found = inspect_sequence(tum)
    (said,) = [text for text in found.errors + found.warnings if "do not match" in text]
    assert (said in found.errors) == is_wrong


def write_poses(folder, change):
    truth = StoredSequence(folder).truth
    changed = Trajectory(truth.stamps_s, change(truth.T_world_camera))
    write_trajectory(folder / "groundtruth.txt", changed, "tum")


@pytest.mark.parametrize("name", FORMATS)
def test_a_right_sequence_is_not_in_doubt_in_any_format(box, name):
    folder = box[name]
    pairs = StoredSequence(folder).pairs
    found = pose_agreement(pairs, StoredSequence(folder).camera, StoredSequence(folder).truth)
    assert found.told and not found.doubtful
    assert not any("not match" in sentence for sentence in inspect_sequence(folder).errors)


@pytest.mark.parametrize("name", ["tum", "replica", "scannet", "tartanair"])
def test_millimetres_read_as_another_unit_are_named_in_every_format(box, name):
    folder = box[name]
    pairs = StoredSequence(folder).pairs
    camera = SequenceCamera(CAMERA, 1000)
    if name == "tartanair":  # arrays in metres have no unit
        truth = StoredSequence(folder).truth
        small = SE3(truth.T_world_camera.rotation, 1000 * truth.positions_m)
        found = pose_agreement(pairs, camera, Trajectory(truth.stamps_s, small))
        assert "with positions in mm" in doubt(found, camera)
        return
    right = StoredSequence(folder).camera.depth_units_per_metre
    found = pose_agreement(pairs, camera, StoredSequence(folder).truth)
    assert found.kinds == ["unit"] * (right != 1000)
    if right != 1000:
        assert f"depth_units_per_metre {right:g}, or" in doubt(found, camera)


def test_commands_warn_in_one_line_and_go_on(tum, tmp_path, command_here):
    code, _, notes = command_here("convert", tum, tmp_path / "right", "--format", "replica")
    assert code == 0 and "warning" not in notes
    write_poses(tum, SE3.inverse)
    for command in ("convert", "noise"):
        options = ["--depth-noise", "paper"] if command == "noise" else []
        code, _, notes = command_here(command, tum, tmp_path / command, *options)
        assert code == 0
        warnings = [line for line in notes.splitlines() if line.startswith("warning: ")]
        assert len(warnings) == 1 and "world to camera; try the format tum-inverse" in warnings[0]


def test_units_that_are_given_are_checked(tum, tmp_path, command_here):
    write_json(tum / "camera.json", read_json(tum / "camera.json") | {"depth_units_per_metre": 1e3})
    _, _, notes = command_here("convert", tum, tmp_path / "a")
    assert "with 5000 depth units per metre instead of 1000; try --units 5000" in notes
    _, _, notes = command_here("convert", tum, tmp_path / "b", "--units", "5000")
    assert "warning" not in notes


def test_inspect_reports_the_explanation_as_an_error_and_in_json(tum, command_here):
    write_poses(tum, lambda T: T[np.clip(np.arange(FRAMES) - 1, 0, None)])
    code, text, _ = command_here("inspect", tum, "--json")
    found = json.loads(text)
    assert code == 2 and len(found["errors"]) == 1
    assert "with the poses of 1 frame later" in found["errors"][0]
    assert found["explanations"] == [{"kind": "shifted", "parameters": {"frames": 1}}]
    percent = found["explained_error"]["depth_fits_poses_percent"]
    assert percent < 0.5 * found["figures"]["depth_fits_poses_percent"]


def change_depth(folder, change):
    for path in sorted((folder / "depth").iterdir()):
        write_png(path, change(read_depth16(path)))


def test_depth_of_another_byte_order_is_reported_and_rough_depth_with_holes_is_not(tum):
    rng = np.random.default_rng(4)

    def rough(depth):
        """Noise of 70 mm, and too many holes for a smooth surface."""
        noisy = depth + 350 * rng.normal(size=depth.shape)
        return (noisy * (rng.random(depth.shape) < 0.5)).astype(np.uint16)

    change_depth(tum, np.ndarray.byteswap)
    found = inspect_sequence(tum)
    assert any("byte order" in sentence for sentence in found.warnings)
    change_depth(tum, np.ndarray.byteswap)
    change_depth(tum, rough)
    found = inspect_sequence(tum)
    assert 55 < found.figures["depth_fits_poses_mm"] < 95
    assert found.warnings == ["50% of the depth is missing"] and not found.errors


def test_a_camera_that_does_not_move_is_said_and_is_no_error(tum):
    for image in (tum / "depth").glob("*.png"):
        if image.name != "000000.png":
            shutil.copy(tum / "depth/000000.png", image)
    write_poses(tum, lambda T: T[np.zeros(FRAMES, int)])
    found = inspect_sequence(tum)
    assert found.errors == [] and found.figures["depth_against_poses"] == TOO_LITTLE


def sentence(change, camera=METRES, depth_m=2.0):
    return doubt(Agreement(0.03, True, True, (change,), 0.001, depth_m), camera)


@pytest.mark.parametrize(
    ("factor", "units", "depth_m", "words"),
    [
        (
            0.2,
            5000,
            10.0,
            "with 1000 depth units per metre instead of 5000; try depth_units_per_metre 1000",
        ),
        (0.2018, 5000, 10.0, "with 1000 depth units per metre"),
        (0.2022, 5000, 10.0, "with positions times 0.2022, or depth divided by it"),
        (1.3107, 5000, 2.0, "with 6553.5 depth units per metre instead of 5000"),
        (0.001, 5000, 2.0, "with positions in mm; try positions times 0.001"),
        (0.01, 100, 2.0, "with positions in cm"),
        (0.01, 100, 200.0, "with 1 depth units per metre instead of 100"),
        (0.3048, 5000, 2.0, "with positions in ft"),
    ],
)
def test_a_known_unit_is_named_within_a_hundredth(factor, units, depth_m, words):
    assert words in sentence(scaled(factor), SequenceCamera(CAMERA, units), depth_m)


def test_every_change_has_a_sentence_with_both_figures_and_what_to_try():
    every = [*conventions(), *map(shifted, (-2, 1, 0.4)), scaled(0.7)]
    for change in every:
        text = sentence(change)
        assert "depth differs by 3 % as read, by 0.1 % " in text and "; try " in text
    texts = [sentence(change) for change in every]
    assert len(set(texts)) == len(texts)
    assert any("with the poses of 2 frames earlier" in text for text in texts)
    assert any("left-handed" in text and "format gt.freiburg" in text for text in texts)
    assert any("(NED); try the format tartanair" in text for text in texts)
    assert "poses, depth and camera do not match" in doubt(Agreement(0.05, True, False), METRES)
    assert doubt(Agreement(), METRES) == ""
