"""Left-handed poses, or mirrored positions."""

from ...geometry import axes
from ...geometry.se3 import SE3
from ..change import Change
from ..compared_poses import ComparedPoses
from ..constant_transform import body_pose, world_of_positions
from ..hypothesis import Files, Hypothesis, Words, fixed

KIND = "mirror"


def _mirrored(poses: ComparedPoses) -> Change:
    """Of a body whose axes are any of the left-handed ones."""
    right_handed = poses.changed(poses.reference, axes.mirrored_y(poses.estimate))
    C = body_pose(right_handed).rotation

    def change(T: SE3) -> SE3:
        right = axes.mirrored_y(T)
        return SE3(right.rotation @ C, right.translation)

    return Change(KIND, change, parameters={"rotation": C.tolist()}, free=3)


def _positions_mirrored(poses: ComparedPoses) -> Change:
    B = world_of_positions(poses, mirrored=True)
    parameters = {"positions": B.tolist()}
    return Change(KIND, lambda T: SE3(T.rotation, T.translation @ B.T), parameters=parameters)


_OF_POSES = [
    Hypothesis(KIND, _mirrored, group=KIND),
    Hypothesis(KIND, _positions_mirrored, group=KIND),
]
_OF_POSITIONS = [fixed(KIND, axes.mirrored_y)]


def _words(change: Change, format: str) -> Words:
    advice = "gt.freiburg if its poses are left-handed with frame ids, "
    advice += "else making it again with right-handed poses"
    if format.startswith(("gt.", "pov")):
        advice = "tum or tum-ids, since it was read as left-handed"
    better = "mirrored: the estimate is mirrored"
    return Words(better, "its poses may be left-handed", f"reading it as {advice}")


def hypotheses(files: Files) -> list[Hypothesis]:
    return _OF_POSES if files.have_rotations else _OF_POSITIONS


WORDS = dict.fromkeys((KIND,), _words)
