"""Trajectories: statistics, equation 2, resampling, slices."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import (
    Trajectory,
    adopt,
    frame_rate_hz,
    frame_slice,
    frames_of_stamps,
    resample,
    sample,
    stamps_of_frames,
    trajectory_statistics,
)
from scipy.interpolate import interp1d
from scipy.spatial.transform import Rotation, Slerp


@pytest.fixture
def walk() -> Trajectory:
    """200 poses at 30 Hz: a random walk of centimetres and degrees."""
    rng = np.random.default_rng(11)
    rotations = Rotation.from_rotvec(
        np.cumsum(rng.normal(size=(200, 3)) * 0.02, axis=0)
    ).as_matrix()
    return Trajectory.at_rate(SE3(rotations, np.cumsum(rng.normal(size=(200, 3)) * 0.01, axis=0)))


def test_statistics_of_an_even_turn_are_known():
    angle, radius_m = np.arange(91) * np.radians(1), 2.0
    rotvec = np.stack([0 * angle, 0 * angle, angle], 1)
    circle = SE3(
        Rotation.from_rotvec(rotvec).as_matrix(),
        radius_m * np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1),
    )
    figures = trajectory_statistics(Trajectory.at_rate(circle))
    assert figures.frames == 91 and figures.gaps == 0
    assert figures.duration_s == pytest.approx(3.0) and figures.rate_hz == pytest.approx(30)
    assert figures.length_m == pytest.approx(90 * 2 * radius_m * np.sin(np.radians(0.5)))
    assert figures.mean_speed == pytest.approx(
        figures.length_m / 3
    ) and figures.mean_rotation_rate == pytest.approx(30)
    # steps between stamps of microseconds
    assert figures.max_speed == pytest.approx(figures.mean_speed, rel=2e-5)
    assert figures.max_rotation_rate == pytest.approx(30, rel=2e-5)


def test_gaps_are_counted_and_measured(walk):
    kept = np.delete(np.arange(200), [50, 51, 52, 120])
    figures = trajectory_statistics(walk[kept])
    assert figures.gaps == 2 and figures.longest_gap_s == pytest.approx(4 / 30, abs=1.01e-6)


@pytest.mark.parametrize("rate_hz", [15, 23.976, 29.97, 30, 60, 240])
def test_frames_have_stamps_of_microseconds_from_one_second_on(rate_hz):
    numbers = np.arange(3000)
    stamps_s = stamps_of_frames(numbers, rate_hz)
    assert stamps_s[0] == 1 and [f"{s:.6f}" for s in stamps_s] == [
        f"{1 + i / rate_hz:.6f}" for i in numbers
    ]
    np.testing.assert_array_equal(np.rint(frames_of_stamps(stamps_s, rate_hz)), numbers)
    # as release 0.1 wrote them
    np.testing.assert_allclose(frames_of_stamps(numbers / rate_hz, rate_hz), numbers)
    assert frame_rate_hz(stamps_s) == rate_hz
    assert frame_rate_hz(np.delete(stamps_s, [7, 8, 9, 50])) == pytest.approx(rate_hz, rel=1e-5)


@pytest.mark.parametrize("rate_hz", [15, 30, 60, 240])
def test_two_stamps_tell_a_whole_rate(rate_hz):
    assert {frame_rate_hz(stamps_of_frames([i, i + 1], rate_hz)) for i in range(10)} == {rate_hz}


def test_one_pose_has_statistics():
    figures = trajectory_statistics(Trajectory.at_rate(SE3.identity((1,))))
    assert figures.frames == 1 and figures.length_m == 0 and figures.rate_hz == 0


def test_length_is_that_of_the_positions_and_no_rigid_motion_changes_it(walk):
    moved = Trajectory(
        walk.stamps_s, SE3.exp(np.array([3.0, 1, 2, 0.3, 2, 1])) @ walk.T_world_camera
    )
    assert moved.length_m() == pytest.approx(walk.length_m(), rel=1e-12)
    np.testing.assert_allclose(moved.step_angles_rad(), walk.step_angles_rad(), atol=1e-13)


@pytest.mark.parametrize("stamps", [[0, 0], [1, 0], [0, np.nan], [0, np.inf], [0, 1, 2]])
def test_stamps_that_cannot_be_are_refused(stamps):
    with pytest.raises(InputError):
        Trajectory(np.array(stamps, float), SE3.identity((2,)))


# -- equation 2


def test_adopting_puts_the_first_pose_on_the_start_pose(walk):
    start = SE3.exp(np.array([1.0, 2, 3, 0.4, 0.5, 0.6]))
    adopted = adopt(walk, start, 0.7)
    np.testing.assert_allclose(adopted.T_world_camera[0].matrix, start.matrix, atol=1e-13)
    np.testing.assert_array_equal(adopted.stamps_s, walk.stamps_s)


def test_adopting_keeps_the_motion_and_scales_the_path(walk):
    adopted = adopt(walk, SE3.exp(np.array([1.0, 2, 3, 0.4, 0.5, 0.6])), 0.7)
    assert adopted.length_m() == pytest.approx(0.7 * walk.length_m(), rel=1e-12)
    source = walk.T_world_camera[0].inverse() @ walk.T_world_camera
    result = adopted.T_world_camera[0].inverse() @ adopted.T_world_camera
    np.testing.assert_allclose(result.rotation, source.rotation, atol=1e-13)
    np.testing.assert_allclose(result.translation, 0.7 * source.translation, atol=1e-13)


def test_adopting_twice_is_adopting_once(walk):
    start = SE3.exp(np.array([1.0, 2, 3, 0.4, 0.5, 0.6]))
    once, twice = adopt(walk, start, 0.42), adopt(adopt(walk, start.inverse(), 0.6), start, 0.7)
    np.testing.assert_allclose(twice.T_world_camera.matrix, once.T_world_camera.matrix, atol=1e-12)


def test_adopting_on_its_own_start_is_no_change(walk):
    np.testing.assert_allclose(
        adopt(walk, walk.T_world_camera[0]).T_world_camera.matrix,
        walk.T_world_camera.matrix,
        atol=1e-13,
    )


@pytest.mark.parametrize("scale", [0, -1, np.nan, np.inf])
def test_a_scale_that_cannot_be_is_refused(walk, scale):
    with pytest.raises(InputError, match="a scale > 0"):
        adopt(walk, SE3.identity(), scale)


def test_nothing_cannot_be_adopted():
    with pytest.raises(InputError, match="at least one pose"):
        adopt(Trajectory.at_rate(SE3.identity((0,))), SE3.identity())


# -- resampling


def test_sampling_at_the_own_stamps_gives_the_own_poses(walk):
    np.testing.assert_allclose(
        sample(walk, walk.stamps_s).matrix, walk.T_world_camera.matrix, atol=1e-12
    )


def test_sampled_rotations_agree_with_scipys_slerp(walk):
    stamps_s = np.random.default_rng(12).uniform(*walk.stamps_s[[0, -1]], 500)
    judge = Slerp(walk.stamps_s, Rotation.from_matrix(walk.T_world_camera.rotation))(stamps_s)
    np.testing.assert_allclose(sample(walk, stamps_s).rotation, judge.as_matrix(), atol=1e-12)


def test_sampled_positions_stay_near_the_straight_line(walk):
    stamps_s = np.linspace(*walk.stamps_s[[0, -1]], 777)
    straight = interp1d(walk.stamps_s, walk.positions_m, axis=0)(stamps_s)
    # a screw through 3 cm and 0.06 rad bulges by at most step * angle / 8
    assert np.abs(sample(walk, stamps_s).translation - straight).max() < 1e-3


def test_resampling_up_and_down_again_gives_the_same_poses(walk):
    there_and_back = resample(resample(walk, 120), 30)
    np.testing.assert_allclose(there_and_back.stamps_s, walk.stamps_s, atol=1e-12)
    np.testing.assert_allclose(
        there_and_back.T_world_camera.matrix, walk.T_world_camera.matrix, atol=1e-11
    )


@pytest.mark.parametrize("rate_hz", [15, 24, 29.97, 30, 60, 100, 240])
def test_resampling_keeps_start_span_and_rate(walk, rate_hz):
    resampled = resample(walk, rate_hz)
    assert resampled.stamps_s[0] == walk.stamps_s[0]
    assert walk.stamps_s[-1] - 1 / rate_hz < resampled.stamps_s[-1] <= walk.stamps_s[-1] + 1e-6
    np.testing.assert_allclose(
        resampled.stamps_s, np.round(1 + np.arange(len(resampled)) / rate_hz, 6), atol=1e-12
    )


@pytest.mark.parametrize("digits", [6, 7, 9])
@pytest.mark.parametrize("frames", [2, 5, 100, 101])
def test_printed_stamps_do_not_cost_the_last_frame(walk, digits, frames):
    printed = Trajectory(np.round(np.arange(frames) / 30, digits), walk.T_world_camera[:frames])
    assert len(resample(printed, 30)) == frames
    assert len(resample(printed, 240)) >= 8 * (frames - 1)


def test_even_motion_stays_even_when_resampled():
    screw = SE3.exp(np.outer(np.arange(60), [0.01, 0.002, 0, 0.01, 0.02, 0.005]))
    resampled = resample(Trajectory.at_rate(screw), 77)
    expected = SE3.exp(np.outer((resampled.stamps_s - 1) * 30, [0.01, 0.002, 0, 0.01, 0.02, 0.005]))
    # stamps of microseconds
    np.testing.assert_allclose(resampled.T_world_camera.matrix, expected.matrix, atol=1e-6)


@pytest.mark.parametrize("rate_hz", [14.9, 240.1, 0, -30, np.nan])
def test_a_rate_that_no_camera_has_is_refused(walk, rate_hz):
    with pytest.raises(InputError, match="15 to 240 Hz"):
        resample(walk, rate_hz)


def test_a_stamp_outside_the_span_is_refused(walk):
    with pytest.raises(InputError, match="stamps within"):
        sample(walk, np.array([0.9]))


def test_a_broken_stamp_does_not_fill_the_memory(walk):
    with pytest.raises(InputError, match="at most 10000000 frames"):
        resample(Trajectory(np.array([0.0, 1e10]), walk.T_world_camera[:2]), 240)


def test_one_pose_cannot_be_resampled(walk):
    with pytest.raises(InputError, match="at least two poses"):
        resample(walk[:1], 30)


# -- slices


@pytest.mark.parametrize("count", [1, 7, 30])
def test_frames_are_picked_as_a_python_slice_picks_them(count):
    numbers = ["", "0", "1", "5", "-1", "-3", "100"]
    for text in [f"{a}:{b}:{c}" for a in numbers for b in numbers for c in ("", "1", "3", "-2")]:
        expected = list(range(count))[
            eval(f"slice({','.join(part or 'None' for part in text.split(':'))})")
        ]
        if expected:
            assert list(frame_slice(text, count)) == sorted(expected)
        else:
            with pytest.raises(InputError, match="at least one of the frames"):
                frame_slice(text, count)


def test_one_number_is_one_frame():
    assert list(frame_slice("3", 10)) == [3]
    assert list(frame_slice("-1", 10)) == [9]
    assert list(frame_slice("-10", 10)) == [0]


@pytest.mark.parametrize("text", ["", "a", "1:2:3:4", "1.5", "::0", "1;2", "10", "-11"])
def test_frames_that_cannot_be_understood_are_refused(text):
    with pytest.raises(InputError):
        frame_slice(text, 10)


@pytest.mark.parametrize(
    "wrong", [np.full((3, 3), np.nan), -np.eye(3), 2 * np.eye(3), np.zeros((3, 3))]
)
def test_matrices_that_are_no_rotations_are_refused(walk, wrong):
    rotations = walk.T_world_camera.rotation.copy()
    rotations[7] = wrong
    with pytest.raises(InputError, match="rotation matrices, found pose 7 without them"):
        Trajectory(walk.stamps_s, SE3(rotations, walk.positions_m))


def test_positions_that_are_not_finite_are_refused(walk):
    positions_m = walk.positions_m.copy()
    positions_m[3, 1] = np.inf
    with pytest.raises(InputError, match="finite positions .* pose 3 without"):
        Trajectory(walk.stamps_s, SE3(walk.T_world_camera.rotation, positions_m))
