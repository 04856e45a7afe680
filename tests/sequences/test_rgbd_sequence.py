"""open_sequence gives the frames of a sequence in any format: by number, by slice, by iteration."""

import numpy as np
import pytest
from iclnuim import InputError, PinholeCamera, PosedFrame, Trajectory, open_sequence
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.stored_sequence import StoredSequence, read_images
from iclnuim.trajectory_files.trajectories import write_trajectory


@pytest.mark.parametrize("name", FORMATS)
def test_frames_are_those_of_every_format(all_formats, name):
    folder = all_formats / name
    sequence = open_sequence(folder)
    pairs = StoredSequence(folder).pairs
    camera = StoredSequence(folder).camera
    assert len(sequence) == len(pairs) == len(list(sequence)) and sequence.camera == camera.pinhole
    for pair, frame in zip(pairs, sequence, strict=True):
        stamp_s, rgb, depth_z_m, T_world_camera = frame
        expected_rgb, expected_m = read_images(pair, camera)
        assert stamp_s == pair.stamp_s and rgb.dtype == np.uint8 and depth_z_m.dtype == np.float32
        assert np.array_equal(rgb, expected_rgb) and np.array_equal(depth_z_m, expected_m)
    truth = StoredSequence(folder).truth
    assert np.array_equal(sequence.truth.T_world_camera.matrix, truth.T_world_camera.matrix)
    T = T_world_camera.matrix
    np.testing.assert_allclose(T, truth.T_world_camera.matrix[-1], atol=1e-12)


def test_a_part_reads_nothing_and_has_its_own_ground_truth(all_formats):
    sequence = open_sequence(all_formats / "tum")
    part = sequence[1:3]
    assert len(part) == 2 and part.stamps_s.tolist() == sequence.stamps_s[1:3].tolist()
    assert part.truth.stamps_s.tolist() == sequence.truth.stamps_s[1:3].tolist()
    assert part[-1].stamp_s == sequence[2].stamp_s and len(sequence[::-1]) == len(sequence)
    assert np.array_equal(part[0].depth_z_m, sequence[1].depth_z_m)
    with pytest.raises(IndexError):
        part[2]


@pytest.fixture
def own(run, tmp_path):
    from iclnuim import make_sequence

    make_sequence(run.path, tmp_path / "own")
    return tmp_path / "own"


def test_images_are_read_when_a_frame_is_asked_for(own):
    sequence = open_sequence(own)
    sequence.pairs[2].depth.write_bytes(b"no image")
    assert isinstance(sequence[1], PosedFrame) and len(sequence[2:]) == 2
    with pytest.raises(InputError, match="000002"):
        sequence[2]


def test_poses_between_those_of_the_ground_truth_are_on_the_way(own):
    """Ground truth half a step later: the first frame is half a step before it, the others
    between two poses; a gap of a whole step has no pose.
    """
    truth = StoredSequence(own).truth
    later = Trajectory(truth.stamps_s + 1 / 120, truth.T_world_camera)
    write_trajectory(own / "groundtruth.txt", later, "tum")
    sequence = open_sequence(own)
    T = sequence[2].T_world_camera.translation
    expected = truth.T_world_camera[1].interpolate(truth.T_world_camera[2], 0.75).translation
    np.testing.assert_allclose(T, expected, atol=1e-5)
    write_trajectory(own / "groundtruth.txt", later[:2], "tum")
    assert open_sequence(own)[3].T_world_camera is None
    write_trajectory(own / "groundtruth.txt", later[:1], "tum")
    assert open_sequence(own)[0].T_world_camera is not None
    (own / "groundtruth.txt").unlink()
    without = open_sequence(own)
    assert without.truth is None and without[0].T_world_camera is None
    assert "no ground truth" in repr(without)


def test_a_camera_can_be_given_as_text_with_its_depth_units(own):
    (own / "camera.json").unlink()
    with pytest.raises(InputError, match="a camera"):
        open_sequence(own)
    given = open_sequence(own, "64x48,48,-48,31.5,23.5", depth_units_per_metre=1000)
    assert given.camera == PinholeCamera(64, 48, 48, 48, 31.5, 23.5)
    with pytest.raises(InputError, match="a camera with depth_units_per_metre"):
        open_sequence(own, depth_units_per_metre=1000)
    with pytest.raises(InputError, match="found int"):
        open_sequence(own, 640)
    assert given[0].depth_z_m.max() > 5  # in units of a fifth of a millimetre: five times as far
    with pytest.raises(InputError, match="64 x 48"):
        open_sequence(own, "32x24")[0]


def test_a_sequence_is_described_in_one_line(own):
    sequence = open_sequence(own)
    text = repr(sequence)
    assert "4 frames of 64x48, 1.000..1.100 s, 4 true poses" in text and "\n" not in text
    assert len(repr(sequence[0])) < 150 and "64x48" in repr(sequence[0])


def test_what_is_no_sequence_is_refused(tmp_path):
    with pytest.raises(InputError, match="found nothing"):
        open_sequence(tmp_path / "nowhere")
