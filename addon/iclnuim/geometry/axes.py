"""All changes of axes.

| frame | axes | handedness |
|---|---|---|
| world | ours and Blender's: metres, z up | right |
| pov world | POV-Ray's: y up | left |
| cv camera | OpenCV, TUM: x right, y down, z forward | right |
| pov camera | x right, y up, z forward | left |
| blender camera | x right, y up, looks along -z | right |
| NED world, NED camera | x north, y east, z down; x forward, y right, z down | right |

A left-handed pose is stored as SE3, too (its rotation part is a proper rotation). Only these
functions convert between the two kinds.
"""

import numpy as np

from .se3 import SE3

#: p_world = WORLD_FROM_POV @ p_pov, that is (x, y, z) -> (-x, -z, y). Determinant -1: it also
#: changes the handedness.
WORLD_FROM_POV = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: cv camera <-> pov camera: y changes sign (and therefore the handedness changes).
CV_FROM_POV_CAMERA = np.diag([1.0, -1.0, 1.0])
#: cv camera <-> Blender camera: a rotation by 180 degrees about x.
CV_FROM_BLENDER_CAMERA = np.diag([1.0, -1.0, -1.0])
#: y up <-> z up, both right-handed, as Blender's importers do it: (x, y, z) -> (x, -z, y).
Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: a world with the axes of a level cv camera (y down, z forward), both right-handed: (x, y, z) ->
#: (x, z, -y).
Z_UP_FROM_Y_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
#: p_world = WORLD_FROM_NED @ p_ned: north is our y, east our x, down our -z. Its own inverse.
WORLD_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
#: p_ned_camera = NED_FROM_CV_CAMERA @ p_cv: forward is z, right is x, down is y.
NED_FROM_CV_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def world_cv_from_pov(T_pov_camera: SE3) -> SE3:
    """Pose of the pov camera in the pov world (left-handed, metres) -> T_world_cv."""
    return _change_axes(T_pov_camera, WORLD_FROM_POV, CV_FROM_POV_CAMERA)


def pov_from_world_cv(T_world_cv: SE3) -> SE3:
    """T_world_cv -> pose of the pov camera in the pov world (left-handed, metres)."""
    return _change_axes(T_world_cv, WORLD_FROM_POV.T, CV_FROM_POV_CAMERA)


def mirrored_y(T: SE3) -> SE3:
    """S T S, S = diag(1, -1, 1): left-handed y-up poses of `*.gt.freiburg` <-> right-handed y-down.
    Its own inverse.

    On numbers: ty -> -ty and (qx, qy, qz, qw) -> (-qx, qy, -qz, qw).
    """
    return _change_axes(T, CV_FROM_POV_CAMERA, CV_FROM_POV_CAMERA)


def world_blender_from_world_cv(T_world_camera: SE3) -> SE3:
    """T_world_cv <-> pose of Blender's camera object, T_world_blender. Its own inverse."""
    return SE3(T_world_camera.rotation @ CV_FROM_BLENDER_CAMERA, T_world_camera.translation)


world_cv_from_world_blender = world_blender_from_world_cv


def world_cv_from_ned(T_ned_camera: SE3) -> SE3:
    """Pose of a NED camera in a NED world (TartanAir's) -> T_world_cv."""
    return _change_axes(T_ned_camera, WORLD_FROM_NED, NED_FROM_CV_CAMERA)


def ned_from_world_cv(T_world_cv: SE3) -> SE3:
    """T_world_cv -> pose of the NED camera in the NED world."""
    return _change_axes(T_world_cv, WORLD_FROM_NED, NED_FROM_CV_CAMERA.T)


def _change_axes(T: SE3, to_world: np.ndarray, camera: np.ndarray) -> SE3:
    """R' = W R C, t' = W t. `camera`: p_old_camera = C p_new_camera."""
    return SE3(to_world @ T.rotation @ camera, T.translation @ to_world.T)
