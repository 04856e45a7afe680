"""Runs ORB-SLAM3 through pyorbslam3 on a staged sequence. Arguments: VOCABULARY SETTINGS STAGE OUT;
writes OUT/live.txt and OUT/final.txt.

It runs in any Python that has pyorbslam3 and OpenCV, so it imports nothing else.
"""

import os
import sys

import cv2
import pyorbslam3


def main(vocabulary: str, settings: str, stage: str, out: str) -> None:
    slam = pyorbslam3.Slam(vocabulary, settings, pyorbslam3.Sensor.RGBD, use_viewer=False)
    with open(os.path.join(stage, "associations.txt")) as file:
        rows = [line.split() for line in file]
    live_file = os.path.join(out, "live.txt")
    with open(live_file, "w", buffering=1) as live:  # line buffered, as the system may crash
        for number, (stamp, rgb, _, depth) in enumerate(rows):
            image = cv2.imread(os.path.join(stage, rgb), cv2.IMREAD_UNCHANGED)
            units = cv2.imread(os.path.join(stage, depth), cv2.IMREAD_UNCHANGED)
            found = slam.track_rgbd(image, units.astype("float32"), float(stamp))
            if found.pose_valid:
                values = [f"{value:.9f}" for value in found.pose_wc[:3].ravel()]
                live.write(" ".join([str(number), *values]) + "\n")
    slam.shutdown()
    slam.save_trajectory_tum(os.path.join(out, "final.txt"))


if __name__ == "__main__":
    main(*sys.argv[1:])
