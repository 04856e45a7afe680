"""Runs ORB-SLAM3 through pyorbslam3 on a staged sequence. Arguments: VOCABULARY SETTINGS STAGE OUT
[IMU], the last a file of readings for the mode RGB-D-inertial; writes OUT/live.txt and
OUT/final.txt, and with an IMU OUT/initialised.txt, the stamps at which it was initialised.

It runs in any Python that has pyorbslam3 and OpenCV, so it imports nothing else but NumPy, which
they need.
"""

import os
import sys

import cv2
import numpy
import pyorbslam3


def main(vocabulary: str, settings: str, stage: str, out: str, imu: str = "") -> None:
    sensor = pyorbslam3.Sensor.IMU_RGBD if imu else pyorbslam3.Sensor.RGBD
    readings = _readings(imu) if imu else numpy.zeros((0, 7))
    slam = pyorbslam3.Slam(vocabulary, settings, sensor, use_viewer=False)
    with open(os.path.join(stage, "associations.txt")) as file:
        rows = [line.split() for line in file]
    live_file = os.path.join(out, "live.txt")
    fed = 0
    was_initialised = False
    with open(live_file, "w", buffering=1) as live:  # line buffered, as the system may crash
        for number, (stamp, rgb, _, depth) in enumerate(rows):
            image = cv2.imread(os.path.join(stage, rgb), cv2.IMREAD_UNCHANGED)
            units = cv2.imread(os.path.join(stage, depth), cv2.IMREAD_UNCHANGED)
            begin, fed = fed, int(numpy.searchsorted(readings[:, 0], float(stamp), side="right"))
            found = slam.track_rgbd(
                image, units.astype("float32"), float(stamp), readings[begin:fed] if imu else None
            )
            if found.pose_valid:
                values = [f"{value:.9f}" for value in found.pose_wc[:3].ravel()]
                live.write(" ".join([str(number), *values]) + "\n")
            if imu:
                is_initialised = slam.imu_initialized()  # no longer of a map that is begun anew
                if is_initialised and not was_initialised:
                    with open(os.path.join(out, "initialised.txt"), "a") as file:
                        file.write(f"{stamp}\n")
                was_initialised = is_initialised
    slam.shutdown()
    slam.save_trajectory_tum(os.path.join(out, "final.txt"))


def _readings(imu: str) -> numpy.ndarray:
    """(n, 7) seconds, rotation rate, specific force, from a file in EuRoC's columns."""
    found = numpy.loadtxt(imu, delimiter=",", ndmin=2)
    found[:, 0] /= 1e9
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
