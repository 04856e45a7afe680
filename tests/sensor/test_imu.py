"""The readings of an IMU: signs, span, mounting; its noise: a function of seed and number, term by
term.
"""

import dataclasses
import json

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.continuous import RecipeMotion, SplineMotion
from iclnuim.geometry.handheld import Recipe
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sensor.imu import GRAVITY_M_S2, ImuStream, imu_on
from iclnuim.sensor.imu_noise import IMU_MODELS, ImuNoise, imu_noise
from iclnuim.settings import declared

RATE_HZ = 200.0


def still(count: int, value: float = 0.0) -> ImuStream:
    stamps_ns = np.arange(count) * 5_000_000
    return ImuStream(stamps_ns, np.full((count, 6), value), RATE_HZ)


def test_at_rest_it_measures_9_81_upwards_and_no_rotation():
    """A camera that looks along x of the world has y downwards."""
    level = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    rest = Trajectory.at_rate(SE3(np.tile(level, (30, 1, 1)), np.zeros((30, 3))))
    imu = imu_on(SplineMotion(rest), RATE_HZ)
    assert imu.readings == pytest.approx(np.tile([0, 0, 0, 0, -9.81, 0], (len(imu), 1)))


def test_it_accelerates_forwards_and_turns_about_its_own_axes():
    stamps_s = 1 + np.arange(91) / 30
    positions = np.zeros((91, 3))
    positions[:, 2] = 0.5 * 2.0 * (stamps_s - 1) ** 2
    turns = np.zeros((91, 3))
    turns[:, 2] = 0.7 * stamps_s
    poses = SE3.exp(np.hstack([np.zeros((91, 3)), turns]))
    imu = imu_on(SplineMotion(Trajectory(stamps_s, SE3(poses.rotation, positions))), RATE_HZ)
    middle = imu.readings[len(imu) // 2]
    assert middle == pytest.approx([0, 0, 0.7, 0, 0, 9.81 + 2.0], abs=1e-3)


@pytest.mark.parametrize("rate_hz", [100, 200, 333, 1000])
def test_it_begins_before_the_first_pose_and_ends_after_the_last(rate_hz):
    poses = Trajectory.at_rate(SE3.exp(np.random.default_rng(0).normal(size=(40, 6)) * 0.01))
    imu = imu_on(SplineMotion(poses), rate_hz)
    assert imu.stamps_s[0] < poses.stamps_s[0] - 0.05
    assert imu.stamps_s[-1] >= poses.stamps_s[-1] + 0.1 - 1e-9
    assert round(1e9 * poses.stamps_s[0]) in imu.stamps_ns
    assert np.abs(np.diff(imu.stamps_ns) - 1e9 / rate_hz).max() <= 1


def test_a_mounted_imu_measures_what_its_own_path_gives():
    """The IMU of a camera's path, and the IMU of the path of its own poses."""
    rng = np.random.default_rng(4)
    poses = Trajectory.at_rate(SE3.exp(np.cumsum(rng.normal(size=(300, 6)) * 1e-3, axis=0)))
    T_imu_camera = SE3.exp(np.array([0.05, -0.02, 0.1, 0.3, -0.5, 1.0]))
    mounted = imu_on(SplineMotion(poses), 1000, T_imu_camera)
    fine_s = np.arange(1.0, 10.9, 1e-3)
    states = SplineMotion(poses).states(fine_s)
    own = Trajectory(fine_s, states.T_world_body @ T_imu_camera.inverse())
    alone = imu_on(SplineMotion(own), 1000)
    inside = slice(1000, 8000)
    off = np.abs(mounted.readings[inside] - alone.readings[inside])
    assert np.median(off[:, :3]) < 1e-6
    assert np.median(off[:, 3:]) < 1e-3


def test_another_rate_is_refused():
    poses = Trajectory.at_rate(SE3.identity((10,)))
    with pytest.raises(InputError, match="an IMU at 100 to 1000 Hz, found 50"):
        imu_on(SplineMotion(poses), 50)


# -- noise


@pytest.mark.parametrize("name", IMU_MODELS)
def test_noise_is_that_of_the_seed_and_the_reading_s_number(name):
    noise = imu_noise(name)
    long, short = noise.apply(still(2000, 0.5), 3), noise.apply(still(700, 0.5), 3)
    assert (long.readings[:700] == short.readings).all()
    assert (long.biases[:700] == short.biases).all()
    other = noise.apply(still(700, 0.5), 4)
    assert (name == "none") == bool((other.readings == short.readings).all())


def test_no_term_leaves_the_readings_as_they_are():
    given = still(50, 0.123456789)
    found = ImuNoise().apply(given, 7)
    assert (found.readings == given.readings).all() and not found.biases.any()
    assert found.noise == {}


def test_no_two_axes_and_no_two_terms_have_the_same_noise():
    terms = ("noise_density", "bias_instability", "random_walk")
    made = [
        ImuNoise(**{f"{sensor}_{term}": 1.0}).apply(still(4000), 0).readings
        for sensor in ("gyro", "accel")
        for term in terms
    ]
    columns = np.hstack([each[:, each.any(axis=0)] for each in made])
    assert columns.shape == (4000, 18)
    steps = np.diff(columns, axis=0)
    correlation = np.corrcoef(steps.T) - np.eye(18)
    assert np.abs(correlation).max() < 0.08


def test_a_scale_error_is_one_factor_of_each_axis():
    rng = np.random.default_rng(0)
    given = dataclasses.replace(still(100), readings=rng.normal(size=(100, 6)))
    found = ImuNoise(gyro_scale_error=0.01).apply(given, 0)
    factors = found.readings / given.readings
    assert np.ptp(factors, axis=0) == pytest.approx(np.zeros(6), abs=1e-12)
    assert (factors[0, :3] != 1).all() and (factors[:, 3:] == 1).all()


def test_readings_end_at_the_range_and_lie_on_steps():
    given = dataclasses.replace(still(101), readings=np.tile(np.linspace(-5, 5, 101), (6, 1)).T)
    found = ImuNoise(accel_range=3.0, accel_step=0.25).apply(given, 0).readings[:, 3:]
    assert np.abs(found).max() == 3.0
    assert (found / 0.25 == np.rint(found / 0.25)).all()
    inside = np.abs(given.readings[:, 3:]) <= 3
    assert np.abs(found - given.readings[:, 3:])[inside].max() <= 0.125 + 1e-12


def test_readings_less_bias_are_the_true_ones_without_white_noise():
    noise = ImuNoise(gyro_bias_instability=0.1, gyro_random_walk=0.2, accel_random_walk=0.3)
    found = noise.apply(still(500, 2.0), 1)
    assert found.readings - found.biases == pytest.approx(np.full((500, 6), 2.0))


@pytest.mark.parametrize("name", ["bmi055", "adis16448"])
def test_each_figure_of_a_preset_has_a_source(name):
    model = IMU_MODELS[name]
    plain = ImuNoise()
    for figure, declaration in declared(model).items():
        assert bool(declaration.source) == (declaration.default != getattr(plain, figure)), figure
    assert set(model().figures()) == {
        "gyroscope_noise_density",
        "gyroscope_random_walk",
        "accelerometer_noise_density",
        "accelerometer_random_walk",
    }


def test_a_recording_at_rest_averages_to_gravity(repository):
    content = (repository / "trajectories/living_room/kt2.json").read_text()
    motion = RecipeMotion(Recipe.from_dict(json.loads(content)))
    imu = imu_noise("adis16448").apply(imu_on(motion, RATE_HZ), 0)
    R_world_imu = motion.states(imu.stamps_s).T_world_body.rotation
    mean = np.einsum("nij,nj->ni", R_world_imu, imu.readings[:, 3:]).mean(axis=0)
    assert mean == pytest.approx(-np.array(GRAVITY_M_S2), abs=0.05)


def test_an_unknown_sensor_is_refused():
    with pytest.raises(InputError, match=r"the noise of an IMU \(none, bmi055, adis16448\)"):
        imu_noise("mpu9250")
    with pytest.raises(InputError, match="gyro_noise_density"):
        imu_noise("bmi055", {"gyro_noise_density": -1.0})
