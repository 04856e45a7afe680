"""GTSAM integrates the readings to the poses that they were made with; allantools finds the noise that
was asked for.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from iclnuim import shipped
from iclnuim.sensor.imu import ImuStream, imu_on
from iclnuim.sensor.imu_noise import ImuNoise
from iclnuim.trajectory_files.paths import path_of
from judges import judged_by

pytestmark = pytest.mark.slow
JUDGE = Path(__file__).with_name("imu_judge.py")
WINDOW_S = 10.0
ALLAN_RATE_HZ = 100.0
TWO_HOURS = int(7200 * ALLAN_RATE_HZ)


def integration_errors(folder, rate_hz) -> np.ndarray:
    """Errors (n, 2) in metres and degrees of all windows of the eight sequences."""
    windows = {}
    count = 0
    for name in shipped.paper_sequences():
        motion = path_of(name).motion
        imu = imu_on(motion, rate_hz)
        length = round(WINDOW_S * rate_hz)
        for start in range(0, len(imu) - length, length):
            part = slice(start, start + length + 1)
            stamps_s = imu.stamps_s[part]
            ends = motion.states(stamps_s[[0, -1]])
            windows |= {
                f"stamps_s{count}": stamps_s,
                f"readings{count}": imu.readings[part],
                f"poses{count}": ends.T_world_body.matrix,
                f"velocities{count}": ends.velocity_m_s,
            }
            count += 1
    np.savez(folder / "windows.npz", windows=count, **windows)
    arguments = JUDGE, "integrate", folder / "windows.npz"
    return np.array(json.loads(judged_by("gtsam", "gtsam", *arguments)))


def test_gtsam_comes_to_the_true_pose_and_closer_with_the_square_of_the_step(tmp_path):
    errors = {rate_hz: integration_errors(tmp_path, rate_hz) for rate_hz in (200, 400, 1000)}
    for rate_hz, most_m, most_deg in ((1000, 0.3e-3, 0.001), (200, 8e-3, 0.002)):
        assert errors[rate_hz][:, 0].max() < most_m
        assert errors[rate_hz][:, 1].max() < most_deg
    quarter = np.median(errors[400] / errors[200], axis=0)
    assert quarter == pytest.approx([0.25, 0.25], abs=0.03)


def allan_ratios(folder, term, taus_s, expected) -> np.ndarray:
    """The median over five seeds and six axes of the Allan deviations of one term at times, over
    those of a term of 1.
    """
    stamps_ns = np.arange(TWO_HOURS) * round(1e9 / ALLAN_RATE_HZ)
    still = ImuStream(stamps_ns, np.zeros((TWO_HOURS, 6)), ALLAN_RATE_HZ)
    noise = ImuNoise(**{f"gyro_{term}": 1.0})
    readings = np.hstack([noise.apply(still, seed).readings[:, :1] for seed in range(5)])
    np.savez(folder / "noise.npz", readings=readings)
    arguments = JUDGE, "allan", folder / "noise.npz", ALLAN_RATE_HZ, *taus_s
    found = json.loads(judged_by("allantools", "allantools", *arguments))
    return np.median(found, axis=0) / expected


@pytest.mark.parametrize(
    ("term", "taus_s", "expected", "within"),
    [
        ("noise_density", [0.1, 1.0], [10**0.5, 1.0], [0.03, 0.03]),
        ("bias_instability", [1.0, 3.0, 10.0, 30.0], 0.6643, [0.05, 0.05, 0.05, 0.1]),
        ("random_walk", [10.0], (10 / 3) ** 0.5, [0.05]),
    ],
)
def test_allantools_finds_each_term_of_the_noise(tmp_path, term, taus_s, expected, within):
    ratios = allan_ratios(tmp_path, term, taus_s, np.array(expected))
    assert (np.abs(ratios - 1) < within).all(), ratios
