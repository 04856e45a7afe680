"""Poses of another body than the camera: a constant rotation (other axes), a lever arm, or both,
on the right of the poses.
"""

import numpy as np

from ...geometry.se3 import SE3
from ..change import Change
from ..compared_poses import ComparedPoses
from ..constant_transform import body_pose, body_rotation, lever_arm, rotation_name
from ..hypothesis import Files, Hypothesis, Words

GROUP = "body"


def rotated(poses: ComparedPoses) -> Change:
    return _change("rotation", SE3(body_rotation(poses), np.zeros(3)), 3)


def with_arm(poses: ComparedPoses) -> Change:
    return _change("arm", SE3(np.eye(3), lever_arm(poses, np.eye(3))), 3)


def of_another_body(poses: ComparedPoses) -> Change:
    return _change("body", body_pose(poses), 6)


def _change(kind: str, X: SE3, free: int) -> Change:
    parameters = {"rotation": X.rotation.tolist(), "arm_m": X.translation.tolist()}
    return Change(kind, lambda T: T @ X, parameters=parameters, free=free)


_OF_POSES = [
    Hypothesis("rotation", rotated, group=GROUP),
    Hypothesis("arm", with_arm, group=GROUP),
    Hypothesis("body", of_another_body, group=GROUP),
]


def _words(change: Change, format: str) -> Words:
    parts = []
    if change.kind != "arm":
        turn = rotation_name(np.array(change.parameters["rotation"]))
        parts.append(f"a constant rotation of {turn}")
    if change.kind != "rotation":
        arm = ", ".join(f"{value:.4g}" for value in change.parameters["arm_m"])
        parts.append(f"a constant lever arm of ({arm}) m")
    better = f"with {' and '.join(parts)} on the right of its poses"
    cause = "its poses may be of another body or other axes than the ground truth's"
    return Words(better, cause, "expressing both in the same camera frame")


def hypotheses(files: Files) -> list[Hypothesis]:
    return _OF_POSES if files.have_rotations else []


WORDS = dict.fromkeys(("rotation", "arm", "body"), _words)
