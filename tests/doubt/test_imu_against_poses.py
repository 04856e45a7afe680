"""Readings of an IMU that fit the poses are not doubted, and those that are spoilt by a usual mistake
are, with the right name: on windows of ten seconds, mounted turned and centimetres away.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from iclnuim.doubt.imu_against_poses import imu_agreement
from iclnuim.doubt.imu_hypotheses import CHAINS, WORDS
from iclnuim.geometry import so3
from iclnuim.geometry.axis_changes import changes_of_axes
from iclnuim.geometry.continuous import RecipeMotion, SplineMotion
from iclnuim.geometry.handheld import Recipe
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sensor.imu import ImuStream, imu_on
from iclnuim.sensor.imu_noise import imu_noise
from iclnuim.trajectory_files.trajectories import read_trajectory

G = 9.81
GRAVITY = np.array([0.0, 0.0, -G])
LENGTH_S = 10.0
SEQUENCES = [(room, f"kt{k}") for room in ("living_room", "office") for k in range(4)]
AXES = [*changes_of_axes(1), *changes_of_axes(-1)]
EVERY = {one.kind for chains in CHAINS for chain in chains for one in chain}
KINDS = sorted(EVERY - {"gravity_direction"})


@pytest.fixture(scope="session")
def recordings(repository):
    """recordings(seed): readings of a mounted IMU with the noise of a sensor or none, and poses."""
    folder = repository / "trajectories"
    known = []
    for room, name in SEQUENCES:
        content = json.loads((folder / room / f"{name}.json").read_text())
        poses = read_trajectory(folder / room / f"{name}.txt").trajectory
        known.append((RecipeMotion(Recipe.from_dict(content)), poses))

    def make(seed: int) -> tuple[ImuStream, Trajectory, np.random.Generator]:
        rng = np.random.default_rng(seed)
        motion, poses = known[seed % len(known)]
        arm = rng.normal(size=3)
        arm *= rng.uniform(0.02, 0.1) / np.linalg.norm(arm)
        mount = SE3(so3.exp(1.5 * rng.normal(size=3)), arm)
        stream = imu_on(motion, float(rng.choice([100, 200, 400])), mount)
        model = str(rng.choice(["none", "bmi055", "adis16448"]))
        stream = imu_noise(model).apply(stream, seed)
        first_s = rng.uniform(poses.stamps_s[0], poses.stamps_s[-1] - LENGTH_S)
        kept = (poses.stamps_s >= first_s) & (poses.stamps_s <= first_s + LENGTH_S)
        poses = poses[np.flatnonzero(kept)]
        return stream.around(*poses.stamps_s[[0, -1]]), poses, rng

    return make


def spoilt(imu: ImuStream, poses: Trajectory, rng: np.random.Generator, kind: str) -> ImuStream:
    gyro, accel = imu.readings[:, :3], imu.readings[:, 3:]
    R_world_camera = SplineMotion(poses).states(imu.stamps_s).T_world_body.rotation
    up = -GRAVITY @ (R_world_camera @ imu.T_imu_camera.rotation.T)
    B = AXES[rng.integers(1, 24 if kind == "axes" else 48)]
    offset_s = rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(0.005), np.log(0.5)))
    drift = 1 + rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(0.001), np.log(0.03)))
    factor = rng.choice([0.4, 0.5, 0.8, 1.25, 2, drift, drift])
    since = imu.stamps_ns - imu.stamps_ns[0]
    changed = {
        "degrees": (np.rad2deg(gyro), accel),
        "g": (gyro, accel / 9.80665),
        "no_gravity": (gyro, accel - up),
        "gravity_reversed": (gyro, accel - 2 * up),
        "axes": (gyro @ B.T, accel @ B.T),
        "gyro_axes": (gyro @ B.T, accel),
        "accel_axes": (gyro, accel @ B.T),
    }
    if kind in changed:
        return replace(imu, readings=np.hstack(changed[kind]))
    if kind == "mount_inverse":
        return replace(imu, T_imu_camera=imu.T_imu_camera.inverse())
    if kind == "offset":
        return replace(imu, stamps_ns=imu.stamps_ns + int(1e9 * offset_s))
    scaled = imu.stamps_ns[0] + np.rint(factor * since).astype(np.int64)
    return replace(imu, stamps_ns=scaled)


@pytest.mark.parametrize("seed", range(8))
def test_readings_as_they_should_be_are_not_doubted(recordings, seed):
    imu, poses, _ = recordings(seed)
    found = imu_agreement(imu, poses)
    assert found.changes == () and found.sentence() == ""
    assert found.errors[0] < 0.005 and found.errors[1] < 0.06


@pytest.mark.parametrize("kind", KINDS)
def test_a_usual_mistake_is_named(recordings, kind):
    imu, poses, rng = recordings(KINDS.index(kind) + 50)
    found = imu_agreement(spoilt(imu, poses, rng, kind), poses)
    assert [change.kind for change in found.changes] == [kind]
    assert found.explained[0] < 0.005 and found.explained[1] < 0.06
    assert "the IMU does not fit the poses" in found.sentence()


def test_a_mistake_of_each_sensor_is_named(recordings):
    imu, poses, rng = recordings(3)
    both = spoilt(spoilt(imu, poses, rng, "degrees"), poses, rng, "g")
    found = imu_agreement(both, poses)
    assert [change.kind for change in found.changes] == ["degrees", "g"]


def test_an_offset_is_given_back_to_half_a_millisecond(recordings):
    imu, poses, _ = recordings(2)
    late = replace(imu, stamps_ns=imu.stamps_ns + 5_000_000)
    found = imu_agreement(late, poses)
    assert found.changes[0].parameters["offset_s"] == pytest.approx(-0.005, abs=5e-4)
    assert "ms late; try adding -0.00" in found.sentence()


def test_stamps_of_another_epoch_are_an_offset(recordings):
    imu, poses, _ = recordings(5)
    found = imu_agreement(replace(imu, stamps_ns=imu.stamps_ns + 10**15), poses)
    assert [change.kind for change in found.changes] == ["offset"]
    assert found.changes[0].parameters["offset_s"] == pytest.approx(-1e6, abs=1e-3)


def test_a_world_that_is_not_z_up_is_named_with_its_gravity(recordings):
    imu, poses, _ = recordings(4)
    turned = SE3(so3.exp(np.array([np.pi / 2, 0, 0])), np.zeros(3))
    found = imu_agreement(imu, Trajectory(poses.stamps_s, turned @ poses.T_world_camera))
    assert [change.kind for change in found.changes] == ["gravity_direction"]
    gravity = found.changes[0].parameters["gravity_m_s2"]
    assert gravity == pytest.approx([0, G, 0], abs=0.05)


def test_biases_of_real_sensors_are_not_doubted(recordings):
    imu, poses, _ = recordings(6)
    biased = imu.readings + np.array([0.03, -0.05, 0.02, 0.2, -0.3, 0.1])
    assert imu_agreement(replace(imu, readings=biased), poses).sentence() == ""


def test_noise_that_hides_the_motion_is_no_known_mistake(recordings):
    imu, poses, rng = recordings(7)
    loud = imu.readings + rng.normal(0, [1] * 3 + [10] * 3, imu.readings.shape)
    found = imu_agreement(replace(imu, readings=loud), poses)
    assert found.changes == ()
    assert "no known mistake explains it" in found.sentence()


def test_too_little_is_not_compared(recordings):
    imu, poses, _ = recordings(0)
    assert imu_agreement(imu, poses[:10]).errors is None
    assert imu_agreement(imu.around(0, 0.1), poses).errors is None


def test_every_kind_has_words():
    assert set(WORDS) == EVERY


@pytest.mark.slow
def test_of_spoilt_readings_nineteen_of_twenty_are_named_and_of_right_ones_none(recordings):
    named = 0
    for seed in range(100, 220):
        imu, poses, rng = recordings(seed)
        kind = KINDS[seed % len(KINDS)]
        found = imu_agreement(spoilt(imu, poses, rng, kind), poses)
        named += [change.kind for change in found.changes] == [kind]
    assert named >= 0.95 * 120
    for seed in range(1000, 1080):
        imu, poses, _ = recordings(seed)
        assert imu_agreement(imu, poses).sentence() == ""
