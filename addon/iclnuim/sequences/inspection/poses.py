"""Inspection of a sequence's ground truth: its frames, its speed, and depth against poses."""

import itertools
from typing import Any

import numpy as np

from ...doubt.carried_depth import carried_residual
from ...doubt.depth_against_poses import MISMATCH
from ...doubt.pose_readings import Reading
from ...evaluation.associate import nearest
from ...geometry.camera import PinholeCamera
from ...geometry.se3 import SE3
from ...geometry.trajectory import Trajectory, sample, trajectory_statistics
from ...trajectory_files.trajectories import LoadedTrajectory
from ..camera_files import SequenceCamera
from ..frames import ImagePair, posed, usual_step_s
from .findings import Inspection, first_names
from .official_archives import archive_of, described
from .pose_check import TOO_LITTLE, doubt, pose_agreement

#: Maximum distance of a frame from its pose, as a share of the time between frames.
_SLACK = 0.5
#: Poses belong to a sequence if not more than this share of its frames has none.
_MOST = 0.5
#: Larger residuals are caused by other surfaces, not by errors of the pose.
_SAME_SURFACE_M = 0.3
#: Of unrelated images the median is half of that.
_UNRELATED_M = _SAME_SURFACE_M / 3
_STEP_PX = 6


def inspect_poses(result: Inspection, pairs: list[ImagePair], loaded: LoadedTrajectory) -> None:
    truth = loaded.trajectory
    stamps = np.array([p.stamp_s for p in pairs])
    figures = trajectory_statistics(truth)
    result.figures["poses"] = figures.frames
    result.figures["length_m"] = round(figures.length_m, 3)
    result.figures["max_speed_m_s"] = round(figures.max_speed, 3)
    if archive := archive_of(loaded):
        result.figures["published_as"] = described(archive, loaded)
    without = np.flatnonzero(~posed(stamps, truth))
    if without.size:
        names = first_names([pairs[int(i)].rgb.name for i in without])
        sentence = f"{without.size} frames without a pose: {names}"
        if without.size > _MOST * len(stamps):
            times = f"{stamps[0]:.3f} to {stamps[-1]:.3f} s, those of poses are "
            times += f"{truth.stamps_s[0]:.3f} to {truth.stamps_s[-1]:.3f} s"
            result.errors.append(f"{sentence}; stamps of images are {times}")
        else:
            result.warnings.append(sentence)
    if loaded.read_as.lost:
        lost = f"{loaded.read_as.lost} of {loaded.row_count} rows have no finite pose"
        result.warnings.append(f"{lost} and are left out")
    if loaded.by_depth:
        result.warnings.append(loaded.by_depth)
    if idle := _without_frame(loaded, stamps):
        result.warnings.append(f"{idle} poses without a frame")
    if figures.max_speed > 5:
        result.warnings.append(f"a jump: the camera moves at up to {figures.max_speed:.1f} m/s")


def _without_frame(loaded: LoadedTrajectory, stamps_s: np.ndarray) -> int:
    """The number of poses that belong to no frame; 0 for those of a motion tracker, which has a
    higher rate than the frames.
    """
    if loaded.is_counted:
        return loaded.row_count - loaded.read_as.lost - len(loaded.trajectory)
    usual = usual_step_s(stamps_s)
    poses_s = loaded.trajectory.stamps_s
    poses_s = poses_s[(poses_s > stamps_s[0] - usual) & (poses_s < stamps_s[-1] + usual)]
    idle = nearest(poses_s, np.sort(stamps_s))[1] > _SLACK * usual + 1e-9
    return int(idle.sum()) if len(loaded.trajectory) <= 1.5 * len(stamps_s) else 0


def inspect_depth_against_poses(
    result: Inspection, pairs: list[ImagePair], camera: SequenceCamera, truth: Trajectory
) -> None:
    """Report whether the depth images agree with the poses."""
    found = pose_agreement(pairs, camera, truth)
    if not np.isfinite(found.residual):
        _report_unrelated(result)
        return
    result.figures["depth_fits_poses_percent"] = round(100 * found.residual, 3)
    if sentence := doubt(found, camera):
        is_wrong = found.reading.kind or found.residual > MISMATCH
        (result.errors if is_wrong else result.warnings).append(sentence)
    elif not found.told:
        result.figures["depth_against_poses"] = TOO_LITTLE
    if found.reading.kind:
        explanation = {"kind": found.reading.kind, "parameters": _parameters(found.reading)}
        result.explanations.append(explanation)
        percent = round(100 * found.explained, 3)
        result.explained_error = {"depth_fits_poses_percent": percent}


def _parameters(reading: Reading) -> dict[str, Any]:
    """The parameters of a reading by name: the factor of the positions, the frames by which they
    are late, or the axes of the camera.
    """
    match reading.kind:
        case "unit":
            return {"factor": float(reading.detail)}
        case "shifted":
            return {"frames": int(reading.detail)}
    return {"axes": reading.detail} if reading.detail else {}


def _report_unrelated(result: Inspection) -> None:
    """Report depth images that fit each other as badly as unrelated ones, and cannot be compared by
    their surfaces.
    """
    distance_mm = result.figures.get("depth_fits_poses_mm")
    if isinstance(distance_mm, float) and distance_mm > 1000 * _UNRELATED_M:
        result.warnings.append(
            f"successive depth images differ by {distance_mm:g} mm with the poses, and have too "
            "few smooth surfaces to tell why: is their byte order right?"
        )


def inspect_distances(
    result: Inspection,
    depths: list[tuple[float, np.ndarray]],
    truth: Trajectory,
    camera: PinholeCamera,
) -> None:
    """Report the distance between successive ones of some depth images, with their stamps."""
    first, last = truth.stamps_s[[0, -1]]
    depths = [(stamp_s, depth) for stamp_s, depth in depths if first <= stamp_s <= last]
    if len(depths) < 2 or len(truth) < 2:
        return
    distance_m = _fit_m(depths, sample(truth, np.array([stamp_s for stamp_s, _ in depths])), camera)
    if np.isfinite(distance_m):
        result.figures["depth_fits_poses_mm"] = round(1000 * distance_m, 2)


def _fit_m(depths: list[tuple[float, np.ndarray]], T: SE3, camera: PinholeCamera) -> float:
    """Median distance along z in metres between each of n depth images, transformed by the poses
    (n,), and the next; NaN without overlap.
    """
    found = []
    for i, ((_, a), (_, b)) in enumerate(itertools.pairwise(depths)):
        T_next_this = T[i + 1].inverse() @ T[i]
        found.append(carried_residual(a, b, T_next_this, camera, _STEP_PX).ravel())
    every = np.abs(np.concatenate(found))
    every = every[every < _SAME_SURFACE_M]  # NaN is not
    return float(np.median(every)) if every.size > 100 else float("nan")
