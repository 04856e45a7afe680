"""A stand-in for the package pyorbslam3: notes what it is given in calls.json of its working folder,
follows no camera, and initialises its IMU at the 12th and, after a new map, at the 30th frame.
"""

import json
import os

import numpy as np


class Sensor:
    RGBD = 2
    if "WITHOUT_IMU" not in os.environ:
        IMU_RGBD = 5


class Found:
    pose_valid = True

    def __init__(self, number):
        self.pose_wc = np.eye(4)
        self.pose_wc[0, 3] = number


class Slam:
    def __init__(self, vocabulary, settings, sensor, use_viewer):
        self.calls = []
        self.sensor = sensor

    def track_rgbd(self, image, depth, stamp, imu=None):
        assert image.dtype == np.uint8 and depth.dtype == np.float32
        self.calls.append([stamp, None if imu is None else imu.tolist()])
        return Found(len(self.calls))

    def imu_initialized(self):
        assert self.sensor == 5
        return 12 <= len(self.calls) < 25 or len(self.calls) >= 30

    def shutdown(self):
        with open("calls.json", "w") as file:
            json.dump(self.calls, file)

    def save_trajectory_tum(self, path):
        with open(path, "w") as file:
            for number, (stamp, _) in enumerate(self.calls):
                file.write(f"{stamp} {number} 0 0 0 0 0 1\n")
