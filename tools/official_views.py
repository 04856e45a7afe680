"""The official frames of both rooms: colour, depth, and poses in our world."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry import axes, so3
from iclnuim.geometry.se3 import SE3
from iclnuim.trajectory_files.trajectories import read_trajectory

#: Pose of the frame of office kt0's ground truth in our world: origin (m) and rotation vector
#: (degrees). It is fitted so that floor, ceiling and two walls of the depth images are planar to
#: 0.3 mm at z = 3, z = 5.4, x = -2.5, y =
#: -3.7. The ground truth is relative to the pose of image 1, which is rotated by 0.27 degrees
#: against the room's axes.
OFFICE_ORIGIN_M = (-0.70238, -0.46228, 4.96647)
OFFICE_ROTATION_DEG = (0.2594, -0.0550, -0.0408)


@dataclass(frozen=True)
class OfficialViews:
    """Some official frames of one room. poses(samples): T_world_camera of every frame from 0
    (OpenCV camera).
    """

    scene: str
    sequence: str
    frames: tuple[int, ...]
    trajectory: str
    poses: Callable[[Path], SE3]
    picture: str
    depth: str
    depth_scale: float

    def official(self, samples: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Frame `number`: BGR uint8 (480, 640, 3) and planar depth in metres (480, 640)."""
        bgr = cv2.imread(str(samples / self.picture.format(number)))
        depth = cv2.imread(str(samples / self.depth.format(number)), cv2.IMREAD_UNCHANGED)
        if bgr is None or depth is None:
            expected = f"the official frame {number} (colour and depth)"
            raise InputError(expected, path=samples / self.sequence, found="not both")
        return bgr, depth / self.depth_scale


def _living_room_poses(samples: Path) -> SE3:
    return read_trajectory(samples / LIVING_ROOM.trajectory, "pov-matrix").trajectory.T_world_camera


def _office_poses(samples: Path) -> SE3:
    """Poses by frame number; frames before the first line of the file repeat its pose."""
    rows = np.loadtxt(samples / OFFICE.trajectory)
    numbers = np.clip(np.arange(int(rows[-1, 0]) + 1) - int(rows[0, 0]), 0, None)
    T_room_anchor = SE3(so3.exp(np.radians(OFFICE_ROTATION_DEG)), np.array(OFFICE_ORIGIN_M))
    T_pov = SE3.from_quat_xyzw(rows[:, 4:], rows[:, 1:4])
    return T_room_anchor @ axes.world_cv_from_pov(T_pov)[numbers]


LIVING_ROOM = OfficialViews(
    scene="living_room",
    sequence="lr_kt0",
    frames=(0, 1, 50),
    trajectory="trajectories/lr_kt0_Tpov_cam_3x4.txt",
    poses=_living_room_poses,
    picture="lr_kt0/image_rgb_{}.png",
    depth="lr_kt0/image_depth_{}.pgm",
    depth_scale=1000.0,
)
OFFICE = OfficialViews(
    scene="office",
    sequence="or_kt0",
    frames=(600, 660, 719),
    trajectory="or_kt0/traj0.gt.freiburg",
    poses=_office_poses,
    picture="or_kt0/rgb/{}.png",
    depth="or_kt0/depth/{}.png",
    depth_scale=5000.0,
)
VIEWS = {views.scene: views for views in (LIVING_ROOM, OFFICE)}
