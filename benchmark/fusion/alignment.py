"""T_model_mesh of a reconstruction: by ICP, by the trajectory it was fused along, or by picked
points.
"""

from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np
from iclnuim.doubt.fit import WORTH_SHARE
from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import ErrorStatistics
from iclnuim.evaluation.align import (
    MIN_EXTENT_SHARE,
    AlignmentSettings,
    align,
    principal_extents,
    umeyama,
)
from iclnuim.evaluation.associate import associate
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.raycast.distance import TriangleDistance

#: Picked points are within this share of their extent; of up to so many pairs all orders are tried.
_PAIRS_SHARE = 0.05
_MOST_ORDERED = 6


def icp(model: TriangleDistance, points: np.ndarray, T_model_mesh: SE3, rounds: int = 30) -> SE3:
    """T_model_mesh after point-to-plane ICP on 50 000 vertices; inliers are within three medians
    (at least 0.5 mm).

    Raises InputError if the surfaces do not determine a rigid motion.
    """
    T = T_model_mesh
    some = points[:: max(1, len(points) // 50_000)]
    for _ in range(rounds):
        moved = T.apply(some)
        near = model.nearest(moved)
        normals = model.normals(near.triangle)
        offset_m = ((moved - near.point_m) * normals).sum(axis=1)
        use = near.distance_m <= max(5e-4, 3 * np.median(near.distance_m))
        J = np.hstack([normals[use], np.cross(moved[use], normals[use])])
        A = J.T @ J
        if len(J) < 6 or np.linalg.cond(A) > 1e10:
            found = f"{len(J)} vertices on planes for which it is undetermined"
            raise InputError("surfaces that determine a motion", found=found, hint="no alignment")
        # One Gauss-Newton step: a twist (6,), applied from the left.
        step = np.linalg.solve(A, -J.T @ offset_m[use])
        T = SE3.exp(step) @ T
        if np.abs(step).max() < 1e-7:
            break
    return T


def first_poses_transform(
    poses: Trajectory, truth: Trajectory, max_difference_s: float = 0.02
) -> SE3:
    """T_model_mesh of a mesh fused along `poses`: aligns the first of them with the pose of `truth`
    at its time.

    Raises InputError if the truth has no pose within max_difference_s.
    """
    start_s = poses.stamps_s[0]
    nearest = int(np.abs(truth.stamps_s - start_s).argmin())
    if abs(truth.stamps_s[nearest] - start_s) > max_difference_s:
        found = f"the nearest at {truth.stamps_s[nearest]:.3f} s"
        raise InputError(f"a pose at {start_s:.3f} s", found=found)
    return truth.T_world_camera[nearest] @ poses.T_world_camera[0].inverse()


def trajectories_transform(poses: Trajectory, truth: Trajectory, method: str = "se3") -> SE3:
    """T_model_mesh of a mesh fused along `poses`, by aligning all of them with `truth`
    (`evaluation.align.METHODS`).

    Raises InputError if no stamps match, or the trajectories do not determine the alignment.
    """
    pairs = associate(truth.stamps_s, poses.stamps_s)
    reference = truth.T_world_camera[pairs.first]
    estimate = poses.T_world_camera[pairs.second]
    return align(reference, estimate, AlignmentSettings(method)).T_reference_estimate


def pairs_transform(mesh_points: np.ndarray, model_points: np.ndarray) -> tuple[SE3, float]:
    """T_model_mesh from points (n, 3) picked on the mesh and on the model, both in metres, and the
    remaining RMS distance in metres.

    Raises InputError for fewer than three pairs, or pairs on a line.
    """
    for picked in (mesh_points, model_points):
        if len(picked) < 3 or not _span_a_plane(picked):
            found = f"{len(picked)} for which a rotation is undetermined"
            raise InputError("three or more pairs of points that are not on a line", found=found)
    T, _ = umeyama(mesh_points, model_points)
    residual_m = np.linalg.norm(T.apply(mesh_points) - model_points, axis=1)
    return T, float(np.sqrt((residual_m**2).mean()))


def doubtful_pairs(mesh_points: np.ndarray, model_points: np.ndarray) -> str:
    """A sentence if picked pairs (n, 3) do not belong together: with their residual, and that with
    the lines in another order, or with another scale, if it explains them; "" if they do.
    """
    _, rms_m = pairs_transform(mesh_points, model_points)
    extent_m = float(np.linalg.norm(principal_extents(model_points)))
    if rms_m <= _PAIRS_SHARE * extent_m:
        return ""
    text = f"the pairs do not belong together: their residual is {1e3 * rms_m:.4g} mm"
    best_m, order = rms_m, None
    for other in permutations(range(len(mesh_points))) if len(mesh_points) <= _MOST_ORDERED else ():
        found_m = pairs_transform(mesh_points, model_points[list(other)])[1]
        if found_m < best_m:
            best_m, order = found_m, other
    if order and best_m <= min(_PAIRS_SHARE * extent_m, WORTH_SHARE * rms_m):
        lines = ", ".join(str(line + 1) for line in order)
        return f"{text}, {1e3 * best_m:.4g} mm with the model's points of the lines {lines}"
    T, scale = umeyama(mesh_points, model_points, with_scale=True)
    left_m = np.linalg.norm(T.apply(scale * mesh_points) - model_points, axis=1)
    scaled_m = float(np.sqrt((left_m**2).mean()))
    if scaled_m <= min(_PAIRS_SHARE * extent_m, WORTH_SHARE * rms_m):
        return f"{text}, {1e3 * scaled_m:.4g} mm if the mesh is multiplied by {scale:.4g}"
    return f"{text}; check their order, and {{unit}}"


@dataclass(frozen=True, eq=False)
class FitEffect:
    """What a fit changed: distances of the vertices without it, by how far it translated the centre
    of the reconstruction and rotated it.
    """

    unfitted_m: ErrorStatistics
    translation_m: float
    rotation_deg: float
    T_fitted_given: SE3

    def to_dict(self) -> dict[str, Any]:
        return {
            "unfitted_distance_m": self.unfitted_m.to_dict(),
            "translation_m": self.translation_m,
            "rotation_deg": self.rotation_deg,
            "T_fitted_given": self.T_fitted_given.matrix.tolist(),
        }


def fit_effect(model: TriangleDistance, points: np.ndarray, given: SE3, fitted: SE3) -> FitEffect:
    """What a fit changed of points (n, 3). given, fitted: T_model_mesh without and with it."""
    T_fitted_given = fitted @ given.inverse()
    middle = given.apply(points.mean(0))
    return FitEffect(
        ErrorStatistics.of(model.distance(given.apply(points))),
        float(np.linalg.norm(T_fitted_given.apply(middle) - middle)),
        float(np.degrees(so3.angle(T_fitted_given.rotation))),
        T_fitted_given,
    )


def _span_a_plane(points: np.ndarray) -> bool:
    longest, second, _ = principal_extents(points)
    return bool(second > MIN_EXTENT_SHARE * longest)
