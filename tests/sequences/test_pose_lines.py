"""Which line of a pose file without stamps belongs to which image."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.trajectory import stamps_of_frames
from iclnuim.sequences.pose_lines import (
    ImagesOfLines,
    first_numbers,
    tied_by_whole_stamps,
    tied_to_images,
    tied_to_poses,
)
from iclnuim.trajectory_files.trajectories import LoadedTrajectory, read_trajectory


@pytest.fixture
def read(tmp_path):
    """read(rows): poses at x = 0, 1, ... as KITTI's rows; None is a lost row."""

    def read_rows(rows) -> LoadedTrajectory:
        lines = ["nan " * 12 if x is None else f"1 0 0 {x} 0 1 0 0 0 0 1 0" for x in rows]
        (tmp_path / "poses.txt").write_text("\n".join(lines) + "\n")
        return read_trajectory(tmp_path / "poses.txt")

    return read_rows


def images(numbers, residuals=lambda frames, readings: [np.nan] * len(readings)) -> ImagesOfLines:
    return ImagesOfLines(stamps_of_frames(numbers), numbers, residuals)


def x_of(loaded) -> list[float]:
    return loaded.trajectory.positions_m[:, 0].tolist()


@pytest.mark.parametrize(
    ("numbers", "lines", "firsts"),
    [
        ([0, 1, 2, 4], 5, [0]),  # a lost image in the middle
        ([0, 1, 2], 5, [0]),  # the last images are lost
        ([1, 2, 4, 5], 5, [1]),  # numbered from 1, one lost
        ([2, 3, 5], 5, [1]),  # numbered from 1, the first one lost
        ([1, 2, 3, 4], 5, [0, 1]),  # the first one lost, or numbered from 1 and the last one lost
        ([2, 3], 5, [0, 1, 2]),
        ([100, 101, 103], 4, [100]),  # part of a longer recording
        ([100, 101, 102], 4, [99, 100]),
        ([0, 2, 4], 4, []),  # every second image
        ([1, 7], 5, []),
    ],
)
def test_numbers_tell_the_first_line_or_leave_several(numbers, lines, firsts):
    assert first_numbers(numbers, lines) == firsts


@pytest.mark.parametrize("numbers", [[0, 1, 2], [1, 2, 3], [7, 8, 9], [0, 5, 10], [3, 4, 9]])
def test_as_many_lines_as_images_are_theirs_in_order(read, numbers):
    tied = tied_to_images(read([0, 1, 2]), images(numbers))
    assert x_of(tied) == [0, 1, 2]
    np.testing.assert_allclose(tied.trajectory.stamps_s, stamps_of_frames(numbers))
    said = "one line for each image" in tied.read_as.sentence
    assert said == (numbers != [0, 1, 2])


def with_stamps(tmp_path, stamps) -> LoadedTrajectory:
    """Poses at x = 0, 1, ... with these stamps as TUM's rows."""
    lines = [f"{stamp} {x} 0 0 0 0 0 1" for x, stamp in enumerate(stamps)]
    (tmp_path / "poses.tum").write_text("\n".join(lines) + "\n")
    return read_trajectory(tmp_path / "poses.tum")


@pytest.mark.parametrize(
    ("stamps", "numbers", "x"),
    [
        (range(20), range(20), range(20)),
        (range(1, 21), range(20), range(20)),  # counted from 1, the images from 0
        (range(20), range(1, 21), range(20)),
        (range(30), range(5, 20), range(5, 20)),  # poses of more images than there are
        (range(0, 30, 3), range(30), range(10)),  # of every third image
    ],
)
def test_whole_stamps_outside_the_time_of_the_images_are_their_numbers(
    tmp_path, stamps, numbers, x
):
    tied = tied_by_whole_stamps(with_stamps(tmp_path, stamps), images(list(numbers)))
    assert x_of(tied) == list(x)
    posed = numbers if len(x) == len(numbers) else stamps
    np.testing.assert_allclose(tied.trajectory.stamps_s, stamps_of_frames(list(posed)))


@pytest.mark.parametrize(
    ("stamps", "numbers"),
    [
        ([1, 2, 3, 4], range(100)),  # a pose a second: most lie within the images' 3.3 s
        (range(1, 31), range(20)),  # the numbers of other images
    ],
)
def test_other_whole_stamps_are_left(tmp_path, stamps, numbers):
    loaded = with_stamps(tmp_path, stamps)
    assert tied_by_whole_stamps(loaded, images(list(numbers))) is loaded


def test_a_lost_row_leaves_its_image_without_a_pose(read):
    tied = tied_to_images(read([0, None, 2]), images([1, 2, 3]))
    assert x_of(tied) == [0, 2]
    np.testing.assert_allclose(tied.trajectory.stamps_s, stamps_of_frames([1, 3]))


def test_lost_images_shift_no_pose(read):
    tied = tied_to_images(read(range(8)), images([1, 2, 5, 8]))
    assert x_of(tied) == [0, 1, 4, 7]
    assert "8 lines for 4 images: the first line is that of number 1" in tied.read_as.sentence


@pytest.mark.parametrize(("shares", "first"), [((0.01, 0.006), 1), ((0.006, 0.01), 0)])
def test_depth_decides_between_two_readings_and_says_its_figures(read, shares, first):
    numbers = [1, 2, 3, 4]
    tied = tied_to_images(read(range(5)), images(numbers, lambda frames, readings: list(shares)))
    assert x_of(tied) == [number - first for number in numbers]
    figures = f"{100 * shares[0]:.2f} % with 0, {100 * shares[1]:.2f} % with 1"
    assert figures in tied.read_as.sentence and figures in tied.by_depth


@pytest.mark.parametrize("shares", [(0.01, 0.009), (np.nan, np.nan), (0.0, np.nan), (0.0, 0.0)])
def test_two_readings_that_depth_does_not_tell_are_refused_with_both(read, shares):
    with pytest.raises(InputError) as error:
        tied_to_images(read(range(5)), images([1, 2, 3, 4], lambda *_: list(shares)))
    assert "0 or 1" in str(error.value) and "5 lines for 4 images, 1 to 4" in str(error.value)


@pytest.mark.parametrize("numbers", [[0, 1, 2, 3], [0, 2, 9]])
def test_lines_that_fit_no_reading_are_refused_with_both_counts(read, numbers):
    lines = 5 if len(numbers) == 3 else 3
    with pytest.raises(InputError) as error:
        tied_to_images(read(range(lines)), images(numbers))
    assert f"{len(numbers)} images" in str(error.value) and f"{lines} lines" in str(error.value)


def test_images_without_numbers_need_as_many_lines(read):
    stamps_s = np.array([1305031102.175304, 1305031102.211214, 1305031102.243211])
    unnumbered = ImagesOfLines(stamps_s, None, lambda *_: [])
    tied = tied_to_images(read([0, 1, 2]), unnumbered)
    np.testing.assert_array_equal(tied.trajectory.stamps_s, stamps_s)
    with pytest.raises(InputError, match="3 images, found 4 lines"):
        tied_to_images(read(range(4)), unnumbered)


# -- an estimate and the ground truth


def tum(tmp_path, stamps_s) -> LoadedTrajectory:
    text = "".join(f"{s!r} {x} 0 0 0 0 0 1\n" for x, s in enumerate(stamps_s))
    (tmp_path / "tum.txt").write_text(text)
    return read_trajectory(tmp_path / "tum.txt")


STAMPS_S = [1305031102.175304, 1305031102.211214, 1305031102.243211, 1305031102.275326]


def test_an_estimate_without_stamps_has_those_of_as_many_poses(read, tmp_path):
    truth, estimate = tied_to_poses(tum(tmp_path, STAMPS_S), read([0, None, 2, 3]))
    assert x_of(estimate) == [0, 2, 3]
    np.testing.assert_array_equal(estimate.trajectory.stamps_s, np.array(STAMPS_S)[[0, 2, 3]])
    truth, estimate = tied_to_poses(read([0, None, 2, 3]), tum(tmp_path, STAMPS_S))
    assert x_of(truth) == [0, 2, 3]
    np.testing.assert_array_equal(truth.trajectory.stamps_s, np.array(STAMPS_S)[[0, 2, 3]])


def test_other_numbers_of_rows_are_refused_with_both_counts(read, tmp_path):
    stamped = tum(tmp_path, STAMPS_S)
    for reference, estimate in ((stamped, read(range(3))), (read(range(3)), stamped)):
        with pytest.raises(InputError) as error:
            tied_to_poses(reference, estimate)
        assert "3 lines" in str(error.value) and ", 4," in str(error.value)
    with pytest.raises(InputError, match=r"ground truth, 6, found 5 lines"):
        tied_to_poses(read(range(6)), read(range(5)))


def test_an_estimate_with_the_stamps_of_frame_numbers_keeps_them(read, tmp_path):
    few = tum(tmp_path, stamps_of_frames([1, 4]).tolist())
    truth, estimate = tied_to_poses(read(range(6)), few)
    assert estimate is few and x_of(truth) == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("numbers", "shift"), [([1, 2, 3, 4], 1), ([2, 4], 1), ([0, 3], 0), ([1, 3], 0)]
)
@pytest.mark.parametrize("rate_hz", [30, 20])
def test_an_estimate_that_counts_the_poses_from_1_is_shifted_and_says_so(
    read, tmp_path, numbers, shift, rate_hz
):
    """Images 1.png to 4.png of four poses, in any file with frame numbers."""
    rows = "".join(f"{number} 1 0 0 {number} 0 1 0 0 0 0 1 0\n" for number in numbers)
    (tmp_path / "numbered.txt").write_text(rows)
    estimate = read_trajectory(tmp_path / "numbered.txt", rate_hz=rate_hz)
    for truth in (read(range(4)), tum(tmp_path, stamps_of_frames(range(4), rate_hz).tolist())):
        if truth.is_counted and rate_hz != 30:
            continue
        tied = tied_to_poses(truth, estimate)[1]
        stamps_s = stamps_of_frames(np.array(numbers) - shift, rate_hz)
        np.testing.assert_allclose(tied.trajectory.stamps_s, stamps_s, rtol=0, atol=2e-6)
        said = "its numbers count the 4 poses of the ground truth from 1" in tied.read_as.sentence
        assert said == bool(shift)
