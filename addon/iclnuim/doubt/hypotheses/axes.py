"""Positions in a world of other axes than the rotations'."""

import numpy as np

from ...geometry.se3 import SE3
from ..change import Change
from ..compared_poses import ComparedPoses
from ..constant_transform import rotation_name, world_of_positions
from ..hypothesis import Files, Hypothesis, Words
from . import body

KIND = "axes"


def _positions_turned(poses: ComparedPoses) -> Change | None:
    B = world_of_positions(poses)
    if np.array_equal(B, np.eye(3)):
        return None
    parameters = {"positions": B.tolist()}
    return Change(KIND, lambda T: SE3(T.rotation, T.translation @ B.T), parameters=parameters)


#: Other axes of a body would be others of the same.
_OF_POSES = [Hypothesis(KIND, _positions_turned, group=body.GROUP)]


def _words(change: Change, format: str) -> Words:
    turn = rotation_name(np.array(change.parameters["positions"]))
    cause = "its positions and its rotations, or the ground truth's, may be in worlds of other axes"
    advice = "converting positions and rotations together"
    return Words(f"with its positions alone turned by {turn}", cause, advice)


def hypotheses(files: Files) -> list[Hypothesis]:
    return _OF_POSES if files.have_rotations else []


WORDS = dict.fromkeys((KIND,), _words)
