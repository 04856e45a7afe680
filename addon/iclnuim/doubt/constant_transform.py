"""Constant rotations and translations between the two bodies, or the two worlds, that a ground
truth and an estimate are poses of, and the names of the usual ones.

If the estimate is of another body, T_true = A T_estimate X with a constant X = T_body_camera, and
the motions M between two poses fulfil M_true = X^-1 M_estimate X: the rotation of X turns axes of
rotation and translations alike.
"""

from itertools import combinations

import numpy as np

from ..geometry import axes, so3
from ..geometry.axis_changes import changes_of_axes
from ..geometry.se3 import SE3
from .compared_poses import ComparedPoses, rms

#: Rounds of rotation and lever arm in turn.
_ROUNDS = 4
#: A scale nearer to 1 may be due to noise of the motions, which makes it smaller.
_CLEAR_SCALE = 1.3
#: Columns of a camera's axes (x right, y down, z forward) in those of another body.
_CV_FROM_FLU = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_CV_FROM = {
    "OpenCV's": np.eye(3),
    "OpenGL's": axes.CV_FROM_BLENDER_CAMERA,
    "FLU": _CV_FROM_FLU,
    "NED": axes.NED_FROM_CV_CAMERA.T,
}
#: A usual rotation is named within this angle.
_NAMED_DEG = 3.0


def body_rotation(poses: ComparedPoses) -> np.ndarray:
    """The rotation C (3, 3) for which R_estimate C fits the ground truth's rotations best."""
    true, estimated = poses.motions()
    covariance = np.zeros((3, 3))
    turns = so3.log(true.rotation), so3.log(estimated.rotation)
    for y, x in ((true.translation, estimated.translation), turns):
        size = rms(x) * rms(y)
        if size > 0.0:
            covariance += y.T @ x / (len(x) * size)
    return _rotation(covariance).T


def lever_arm(poses: ComparedPoses, rotation: np.ndarray) -> np.ndarray:
    """The arm (3,) in the estimate's body and unit whose end moves as the ground truth does, if
    that body is turned by `rotation`; but for a scale, if one is clearly there.
    """
    true, estimated = poses.motions()
    turned = (true.translation @ rotation.T).reshape(-1)
    moved = estimated.translation.reshape(-1)
    turns = (estimated.rotation - np.eye(3)).reshape(-1, 3)
    size = np.linalg.norm(turned) / max(float(np.linalg.norm(moved)), 1e-300)
    *arm_m, share = np.linalg.lstsq(np.column_stack([turns, size * moved]), turned, rcond=1e-3)[0]
    scale = float(share * size)
    if 1 / _CLEAR_SCALE < scale < _CLEAR_SCALE or scale <= 0:
        return np.linalg.lstsq(turns, turned - moved, rcond=1e-3)[0]
    return np.array(arm_m) / scale


def body_pose(poses: ComparedPoses) -> SE3:
    """T_body_camera with which the estimate's poses fit the ground truth best."""
    rotation = body_rotation(poses)
    arm = lever_arm(poses, rotation)
    for _ in range(_ROUNDS):
        moved = poses.estimate @ SE3(np.eye(3), arm)
        rotation = body_rotation(poses.changed(poses.reference, moved))
        arm = lever_arm(poses, rotation)
    return SE3(rotation, arm)


def world_of_positions(poses: ComparedPoses, mirrored: bool = False) -> np.ndarray:
    """The change of axes B (3, 3), or the mirrored one, of the estimate's positions into the world
    of its rotations: R^T B dp is the ground truth's motion.
    """
    half = len(poses)
    true, _ = poses.motions()
    y = (poses.estimate.rotation[:half] @ true.translation[..., None])[..., 0]
    x = poses.estimate.translation[half:] - poses.estimate.translation[:half]
    agreement = [np.vdot(B, y.T @ x) for B in _AXES[mirrored]]
    return _AXES[mirrored][int(np.argmax(agreement))]


_AXES = {False: changes_of_axes(1), True: changes_of_axes(-1)}


def _rotation(covariance: np.ndarray) -> np.ndarray:
    """The R (3, 3) that minimises |y - R x|^2, of the sum of y x^T."""
    u, _, vt = np.linalg.svd(covariance)
    return (u * np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])) @ vt


def rotation_name(rotation: np.ndarray) -> str:
    """A constant rotation in words: the axes that it changes, if it is a usual one, and its angle
    and axis.
    """
    pairs = []
    for one, other in combinations(_CV_FROM, 2):
        usual = _CV_FROM[one].T @ _CV_FROM[other]
        apart = so3.angle(np.stack([usual, usual.T]) @ rotation)
        if np.degrees(apart.min()) < _NAMED_DEG:
            pairs.append(f"{one} and {other} axes")
    vector = so3.log(rotation)
    angle = float(np.linalg.norm(vector))
    axis = ", ".join(f"{value:.3g}" for value in vector / max(angle, 1e-12) + 0.0)
    text = f"{np.degrees(angle):.4g} degrees about ({axis})"
    return f"{text}, as between {' or '.join(pairs)}" if pairs else text
