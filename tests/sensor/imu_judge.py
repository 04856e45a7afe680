"""Integrates readings of an IMU with GTSAM, or their Allan deviations with allantools; run by a Python
that has them.

integrate FILE.npz: windows of states and readings -> for each the error in metres and degrees.
allan FILE.npz RATE TAU..: columns of readings -> for each the Allan deviations.
"""

import json
import sys

import numpy as np


def integrated(data) -> list[list[float]]:
    import gtsam

    params = gtsam.PreintegrationParams.MakeSharedU(9.81)
    found = []
    for k in range(int(data["windows"])):
        stamps_s, readings, poses, velocities = (
            data[f"{name}{k}"] for name in ("stamps_s", "readings", "poses", "velocities")
        )
        state = gtsam.NavState(gtsam.Pose3(poses[0]), velocities[0])
        bias = gtsam.imuBias.ConstantBias()
        every = max(1, round(0.1 / (stamps_s[1] - stamps_s[0])))
        for start in range(0, len(stamps_s) - 1, every):
            preintegrated = gtsam.PreintegratedImuMeasurements(params, bias)
            for i in range(start, min(start + every, len(stamps_s) - 1)):
                step_s = stamps_s[i + 1] - stamps_s[i]
                rate = (readings[i, :3] + readings[i + 1, :3]) / 2
                turned = gtsam.Rot3.Expmap(rate * step_s).matrix() @ readings[i + 1, 3:]
                preintegrated.integrateMeasurement((readings[i, 3:] + turned) / 2, rate, step_s)
            state = preintegrated.predict(state, bias)
        off = gtsam.Pose3(poses[1]).between(state.pose())
        angle = np.degrees(np.linalg.norm(gtsam.Rot3.Logmap(off.rotation())))
        found.append([float(np.linalg.norm(off.translation())), float(angle)])
    return found


def allan(data, rate_hz: float, taus_s: list[float]) -> list[list[float]]:
    import allantools

    columns = data["readings"].T
    of = {"rate": rate_hz, "data_type": "freq", "taus": taus_s}
    return [allantools.oadev(column, **of)[1].tolist() for column in columns]


if __name__ == "__main__":
    with np.load(sys.argv[2]) as given:
        if sys.argv[1] == "integrate":
            print(json.dumps(integrated(given)))
        else:
            print(json.dumps(allan(given, float(sys.argv[3]), list(map(float, sys.argv[4:])))))
