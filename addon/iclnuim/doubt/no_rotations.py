"""Files without rotations of their own: the same one, mostly the identity, stands in every pose, as
trackers of positions write it.
"""

import numpy as np

from ..evaluation.align import umeyama
from ..evaluation.associate import AssociationSettings, associate
from ..geometry import so3
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory

#: Rotations that differ by less are the same, in radians; a camera that turns does so by more than
#: the other angle.
_SAME = 1e-6
_TURNS_RAD = np.radians(5.0)


def turns(trajectory: Trajectory) -> bool:
    """Whether the rotations are more than one that was written for lack of others."""
    rotations = trajectory.T_world_camera.rotation
    return bool((np.abs(rotations - rotations[:1]) > _SAME).any())


def lacks_rotations(trajectory: Trajectory, other: Trajectory) -> bool:
    """Whether all rotations are the same while the camera of the other trajectory turns."""
    if len(trajectory) < 2 or turns(trajectory):
        return False
    rotations = other.T_world_camera.rotation
    return bool((so3.angle(rotations[0].T @ rotations) > _TURNS_RAD).any())


def positions_alone(
    reference: Trajectory, estimate: Trajectory, settings: AssociationSettings
) -> tuple[Trajectory, Trajectory]:
    """Both without rotations, the estimate aligned by SE(3): motions of one pose to another are
    then differences of positions in the reference's world.
    """
    pairs = associate(reference.stamps_s, estimate.stamps_s, settings)
    if len(pairs) >= 3:
        x = estimate.positions_m[pairs.second]
        T, _ = umeyama(x, reference.positions_m[pairs.first])
        estimate = Trajectory(estimate.stamps_s, T @ estimate.T_world_camera)
    return _unturned(reference), _unturned(estimate)


def _unturned(trajectory: Trajectory) -> Trajectory:
    none = SE3.identity((len(trajectory),))
    return Trajectory(trajectory.stamps_s, SE3(none.rotation, trajectory.positions_m))
