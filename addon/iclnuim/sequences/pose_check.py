"""Depth of a sequence against its poses: the frames that have both, and the verdict in words."""

from collections.abc import Callable, Sequence

import numpy as np

from ..doubt.depth_against_poses import Agreement, agreement
from ..doubt.depth_hypotheses import WORDS, Depth
from ..errors import InputError, named
from ..geometry.trajectory import Trajectory, sample
from .camera_files import SequenceCamera
from .frames import ImagePair, depth_stamps_s, posed
from .stored_sequence import read_depth_m

TOO_LITTLE = "cannot be told from these frames: the camera moves too little"


def pose_agreement(
    pairs: Sequence[ImagePair], camera: SequenceCamera, poses: Trajectory
) -> Agreement:
    """Compare the depth of the pairs that have a pose with these poses. Images that cannot be read
    are left out.
    """
    within = [p for p in pairs if poses.stamps_s[0] <= p.depth_stamp_s <= poses.stamps_s[-1]]
    stamps_s = depth_stamps_s(within)
    if len(within) < 2 or len(poses) < 2:
        return Agreement()
    chosen = np.flatnonzero(posed(stamps_s, poses)).tolist()

    def load(frame: int) -> np.ndarray | None:
        try:
            return read_depth_m(within[chosen[frame]].depth, camera.depth_units_per_metre)
        except InputError:
            return None

    return agreement(load, sample(poses, stamps_s[chosen]), camera.pinhole)


def doubt(
    found: Agreement,
    camera: SequenceCamera,
    name_of: Callable[[str], str] = "depth_{}_per_metre".format,
) -> str:
    """What is wrong and what to try, in one sentence; "" if the poses are as they should be.

    name_of: the name of the setting `units`; by default that in camera.json.
    """
    if not found.doubtful:
        return ""
    measured = f"between images depth differs by {_percent(found.residual)}"
    if not found.changes:
        return f"poses, depth and camera do not match: {measured} with the poses as read"
    depth = Depth(camera.depth_units_per_metre, found.depth_m)
    words = [WORDS[change.kind](change, depth) for change in found.changes]
    means = " and ".join(one.better for one in words)
    hint = named(", and ".join(one.advice for one in words), name_of)
    explained = f"by {_percent(found.explained)} {means}"
    return f"poses and depth do not match: {measured} as read, {explained}; try {hint}"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
