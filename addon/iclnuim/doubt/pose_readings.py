"""Other readings of a sequence's poses and depth: what a file's conventions may be instead."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .depth_pairs import DepthPairs

#: Motions (p,) T_second_first of the pairs by the poses (n,).
Motions = Callable[[DepthPairs, SE3], SE3]
#: The images of the pairs in another reading.
Images = Callable[[DepthPairs], DepthPairs]
#: Number of frames by which poses may be shifted.
_SHIFTS = (-2, -1, 1, 2)
#: Ratios of the resolution of images to that of their camera's file.
_RESOLUTIONS = (0.25, 0.5, 2 / 3, 1.5, 2.0, 4.0)
#: Axes x, y, z of the body whose poses a file may have, and the name of the convention.
_BODIES = (
    ("right", "up", "backward", "OpenGL, Blender"),
    ("left", "down", "backward", ""),
    ("left", "up", "forward", "upside down"),
    ("forward", "right", "down", "NED"),
    ("forward", "left", "up", "FLU"),
    ("right", "forward", "up", ""),
    ("down", "left", "forward", "portrait"),
    ("up", "right", "forward", "portrait"),
    ("left", "down", "forward", ""),
    ("right", "up", "forward", "ICL-NUIM, Unity"),
    ("right", "down", "backward", ""),
    ("left", "up", "backward", ""),
    ("forward", "right", "up", "Unreal"),
)
#: The directions in the frame of the cv camera.
_DIRECTIONS = {
    "right": (1, 0, 0),
    "left": (-1, 0, 0),
    "down": (0, 1, 0),
    "up": (0, -1, 0),
    "forward": (0, 0, 1),
    "backward": (0, 0, -1),
}


def unchanged(pairs: DepthPairs) -> DepthPairs:
    return pairs


@dataclass(frozen=True, eq=False)
class Reading:
    """kind: one of `unit`, `ray`, `mirrored`, `inverse`, `shifted`, `axes`, `quaternion`, `arm`,
    `camera`, or "" for the poses as read. detail: which one of its kind. images: of the pairs, as
    they are then.
    """

    kind: str
    detail: str
    motions: Motions
    images: Images = unchanged

    def residuals(self, pairs: DepthPairs, T_world_camera: SE3) -> np.ndarray:
        """(p,) relative residuals of the pairs with the poses (n,) in this reading; NaN where it
        has no pose.
        """
        pairs = self.images(pairs)
        return pairs.residuals(self.motions(pairs, T_world_camera))

    def residual(self, pairs: DepthPairs, T_world_camera: SE3) -> float:
        """The mean over the pairs; infinite if it has no poses."""
        found = self.residuals(pairs, T_world_camera)
        known = np.isfinite(found)
        return float(found[known].mean()) if known.any() else float("inf")


AS_READ = Reading("", "", DepthPairs.relative)
#: A camera that does not move.
STILL = Reading("still", "", lambda pairs, T: SE3.identity((len(pairs),)))


def scaled(factor: float) -> Reading:
    """The positions multiplied by a factor; the same as depth divided by it."""

    def motions(pairs: DepthPairs, T: SE3) -> SE3:
        return pairs.relative(SE3(T.rotation, factor * T.translation))

    return Reading("unit", f"{factor:.5g}", motions)


def with_arm(arm_m: np.ndarray) -> Reading:
    """Poses of a body, in whose frame the camera is at (3,)."""
    arm = SE3(np.eye(3), arm_m)
    text = ", ".join(f"{value:.3g}" for value in arm_m)
    return Reading("arm", text, lambda pairs, T: pairs.relative(T @ arm))


def of_camera(camera: PinholeCamera) -> Reading:
    """Images of another camera of the same size."""
    values = (camera.fx, camera.fy, camera.cx, camera.cy)
    text = ",".join(f"{value:.5g}" for value in values)
    return Reading("camera", text, DepthPairs.relative, lambda pairs: pairs.seen_by(camera))


def other_cameras(camera: PinholeCamera) -> list[Reading]:
    """Usual mistakes of a camera's file: that of another resolution, of the turned image, and the
    centre of the image in place of the principal point.
    """
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    centre = (camera.width - 1) / 2, (camera.height - 1) / 2
    found = [(fy, fx, cy, cx), (fx, fy, cy, cx), (fx, fy, *centre)]
    for scale in _RESOLUTIONS:
        found.append((scale * fx, scale * fy, scale * (cx + 0.5) - 0.5, scale * (cy + 0.5) - 0.5))
    changed = [replace(camera, fx=a, fy=b, cx=c, cy=d) for a, b, c, d in found]
    return [of_camera(other) for other in changed if other != camera]


def discrete() -> list[Reading]:
    """All readings without a free parameter, except that of the poses as read."""
    found = [
        Reading("ray", "", DepthPairs.relative, lambda pairs: pairs.along_rays),
        Reading("inverse", "", lambda pairs, T: pairs.relative(T.inverse())),
        Reading("quaternion", "", lambda pairs, T: pairs.relative(_scalar_first(T))),
    ]
    found += [_shifted(frames) for frames in _SHIFTS]
    found += [_of_body(*body) for body in _BODIES]
    return found


def _shifted(frames: int) -> Reading:
    def motions(pairs: DepthPairs, T: SE3) -> SE3:
        there = np.arange(len(T)) + frames
        inside = (there >= 0) & (there < len(T))
        positions = np.where(inside[:, None], T.translation[there.clip(0, len(T) - 1)], np.nan)
        return pairs.relative(SE3(T.rotation[there.clip(0, len(T) - 1)], positions))

    return Reading("shifted", f"{frames:+d}", motions)


def _scalar_first(T: SE3) -> SE3:
    """The poses if the four numbers that were read as qx qy qz qw are qw qx qy qz."""
    return SE3.from_quat_xyzw(np.roll(T.quat_xyzw, -1, axis=-1), T.translation)


def _of_body(x: str, y: str, z: str, convention: str) -> Reading:
    """Poses of a body whose axes have these directions; left-handed ones are mirrored."""
    body = np.array([_DIRECTIONS[axis] for axis in (x, y, z)], float).T

    def motions(pairs: DepthPairs, T: SE3) -> SE3:
        moved = pairs.relative(T)
        return SE3(body @ moved.rotation @ body.T, moved.translation @ body.T)

    kind = "axes" if np.linalg.det(body) > 0 else "mirrored"
    name = f" ({convention})" if convention else ""
    return Reading(kind, f"x {x}, y {y}, z {z}{name}", motions)
