"""Frames to TUM sequences: readable by others, the same bytes in any order, nothing wraps, nothing is mixed."""

import json

import numpy as np
import pytest
from iclnuim.dataset import sequence as sequences
from iclnuim.dataset.depth_units import depth16_from_metres, metres_from_depth16
from iclnuim.dataset.run_folder import open_run
from iclnuim.errors import InputError
from iclnuim.formats.associations import read_associations
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

NOISY = sequences.SensorSettings("released", "released", seed=7)
SIZE = (48, 64)


@pytest.fixture
def run(tmp_path):
    """Four frames of a sloping floor and a colour ramp."""
    camera = {"width": 64, "height": 48, "fx": 48.0, "fy": 48.0, "cx": 31.5, "cy": 23.5}
    recipe = {"job": {"camera": camera, "samples": 1}, "trajectory_sha256": "a", "scene_sha256": "b", "blender": "none"}
    poses = SE3.exp(np.linspace(0, 0.1, 24).reshape(4, 6))
    run = open_run(tmp_path / "raw", recipe, Trajectory.at_rate(poses))
    v, u = np.mgrid[0:48, 0:64]
    for number in range(4):
        run.write_frame(number, np.stack([u / 64, v / 48, (u + v) / 112], -1), 1.0 + number / 10 + v / 30 + u / 100)
    return run


def fill(run, out, settings, numbers):
    sequence = sequences.open_sequence(out, run, settings)
    sequences.write_frames(run, sequence, settings, numbers, lambda number: None)
    sequences.write_lists(run, sequence)
    return sequence


def contents(path):
    return {str(p.relative_to(path)): p.read_bytes() for p in sorted(path.rglob("*")) if p.is_file()}


def test_the_same_bytes_alone_in_parts_backwards_or_at_once(run, tmp_path):
    whole = fill(run, tmp_path / "whole", NOISY, range(4))
    for numbers in ([3], [1, 0], [2]):
        parts = fill(run, tmp_path / "parts", NOISY, numbers)
    assert contents(parts.path) == contents(whole.path)


def test_another_seed_gives_other_noise_and_clean_depth_is_exact(run, tmp_path):
    cv2 = pytest.importorskip("cv2")
    noisy = fill(run, tmp_path / "noisy", NOISY, range(4))
    other = fill(run, tmp_path / "other", sequences.SensorSettings("released", "released", seed=8), range(4))
    assert noisy.depth_file(2).read_bytes() != other.depth_file(2).read_bytes()
    clean = fill(run, tmp_path / "clean", sequences.SensorSettings(), range(4))
    v, u = np.mgrid[0:48, 0:64]
    depth = cv2.imread(str(clean.depth_file(2)), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    assert np.abs(depth / 5000 - (1.2 + v / 30 + u / 100)).max() <= 0.5 / 5000 + 1e-6


def test_independent_readers_pair_every_frame(run, tmp_path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    cv2 = pytest.importorskip("cv2")
    sequence = fill(run, tmp_path / "out", NOISY, range(1, 4))
    truth = file_interface.read_tum_trajectory_file(str(sequence.path / "groundtruth.txt"))
    pairs = read_associations(sequence.path / "associations.txt")
    assert np.allclose(truth.timestamps, pairs.rgb.stamps_s) and len(pairs) == 3
    assert np.allclose(truth.timestamps, [1 / 30, 2 / 30, 3 / 30])
    for rgb, depth in zip(pairs.rgb.paths, pairs.depth.paths, strict=True):
        assert cv2.imread(str(sequence.path / rgb)).shape == (48, 64, 3)
        assert cv2.imread(str(sequence.path / depth), cv2.IMREAD_UNCHANGED).shape == SIZE


def test_damaged_images_count_as_missing(run, tmp_path):
    sequence = fill(run, tmp_path / "out", NOISY, range(4))
    assert sequence.finished(range(5), SIZE) == [0, 1, 2, 3]
    data = sequence.rgb_file(1).read_bytes()
    sequence.rgb_file(1).write_bytes(data[: len(data) // 2])
    sequence.depth_file(2).unlink()
    assert sequence.finished(range(4), SIZE) == [0, 3]


def test_a_folder_of_another_recipe_or_of_other_people_is_refused(run, tmp_path):
    fill(run, tmp_path / "out", NOISY, [0])
    with pytest.raises(InputError, match="seed 7 there, 9 asked"):
        sequences.open_sequence(tmp_path / "out", run, sequences.SensorSettings("released", "released", seed=9))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/diary.txt").write_text("private")
    with pytest.raises(InputError, match="other files"):
        sequences.open_sequence(tmp_path / "mine", run, NOISY)


def test_the_recipe_holds_every_parameter(run, tmp_path):
    sequence = fill(run, tmp_path / "out", NOISY, [0])
    recipe = json.loads((sequence.path / "recipe.json").read_text())
    assert recipe["sensor"] == NOISY.to_dict()
    assert recipe["run"] == run.recipe
    assert recipe["schema_version"] == 1


def test_depth_that_does_not_fit_becomes_no_measurement_and_never_wraps():
    metres = np.array([[0.0, 13.107, 13.1072, 65.0, np.inf, np.nan, -1.0, 0.0002, 1.0]])
    units, lost = depth16_from_metres(metres)
    assert units.tolist() == [[0, 65535, 0, 0, 0, 0, 0, 1, 5000]]
    assert lost == 5
    assert metres_from_depth16(units)[0, -1] == 1.0
