"""The explanation of a bad estimate: another reading of the poses or of the stamps, a scale, or
another body, with which it fits the ground truth much better.

All explanations compete. The best one wins if it halves the ATE or the RPE, leaves an error that is
small against the motion itself, and holds in each half of the trajectory with the parameters that
the other half gives. Otherwise nothing explains the estimate, or it needs no explanation.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..evaluation.align import umeyama
from ..evaluation.associate import AssociationSettings, associate
from ..evaluation.compared_poses import ComparedPoses, Comparison
from ..geometry.trajectory import Trajectory
from .fit import ROUNDING, Fit
from .readings import Change, Reorder, readings, unchanged
from .time_readings import TIME_KINDS, associated_poses, time_readings

#: Scales within this factor are a drift of scale.
DRIFT_OF_SCALE = 1.15
#: Kinds that are parts of others.
_PARTS = {"body": {"rotation", "arm"}, "rate": {"offset"}}
#: What concerns all errors of lengths.
_OF_ALL = ("scale", *TIME_KINDS)


@dataclass(frozen=True, eq=False)
class Explanation:
    """What explains most of an estimate's error.

    kind: `inverse` (world-to-camera poses), `inverse rotations`, `wxyz` or `xyzw` (order of the
    quaternions), `rotation`, `arm`, `body` (constant rotation, lever arm, or both, between the two
    bodies), `mirror`, `axes` (positions and rotations in different worlds), `scale`, and of the
    stamps `offset`, `rate` or `rows` (time_readings.py). change: what makes reference and estimate,
    as read, those given here. delta: frames between the poses of the pairs whose errors were
    compared.
    """

    kind: str
    change: Change
    reference: Trajectory
    estimate: Trajectory
    delta: int

    def to_dict(self) -> dict[str, Any]:
        """Kind, the file that is read otherwise, and the parameters by names with units."""
        parameters: dict[str, Any] = {}
        change = self.change
        if change.time is not None and self.kind != "rows":
            parameters["offset_s"] = change.time.axis.offset_s
        if self.kind == "rate" and change.time is not None:
            parameters["stamp_scale"] = change.time.axis.scale
            parameters["origin_s"] = change.time.axis.origin_s
        if change.scale != 1.0:
            parameters["scale"] = change.scale
        if change.rotation is not None:
            parameters["rotation"] = change.rotation.tolist()
        if change.arm_m is not None:
            parameters["arm_m"] = change.arm_m.tolist()
        return {"kind": self.kind, "file": change.of, "parameters": parameters}


class _Candidate(NamedTuple):
    kind: str
    parameters: int
    change: Change
    fit: Fit

    @property
    def cost(self) -> float:
        return self.fit.cost(self.parameters)

    def explains(self) -> bool:
        return self.fit.explains(concerns_all=self.kind in _OF_ALL)


def explain(
    reference: Trajectory,
    estimate: Trajectory,
    settings: AssociationSettings | None = None,
    *,
    how: Comparison | None = None,
    reorders: dict[str, Reorder | None] | None = None,
) -> Explanation | None:
    """What explains most of the error of an estimate; None if nothing does, or if it fits as read.

    reorders: of the quaternions of the two files, see readings().
    """
    settings = settings or AssociationSettings()
    how = how or Comparison()
    if not (_turns(reference) and _turns(estimate)):
        how = replace(how, positions_only=True)
    candidates = list(_at_other_times(reference, estimate, settings, how))
    poses = associated_poses(reference, estimate, settings, how)
    if poses is not None:
        candidates += _read_otherwise(poses, reorders or {})
    if not candidates:
        return None
    best = _simplest(min(candidates, key=lambda candidate: candidate.cost), candidates)
    change = best.change
    if best.kind == "scale":
        change = _scale_of_all(reference, estimate, settings)
        if is_drift(change.scale) or best.fit.may_be_noise(change.scale):
            return None
    if not best.explains():
        return None
    truth, T = change.applied(reference.T_world_camera, estimate.T_world_camera)
    stamps_s = estimate.stamps_s
    if change.time is not None:
        stamps_s = change.time.stamps_s - settings.offset_s
    reference = Trajectory(reference.stamps_s, truth)
    estimate = Trajectory(stamps_s, T)
    return Explanation(best.kind, change, reference, estimate, how.delta)


def _at_other_times(
    reference: Trajectory,
    estimate: Trajectory,
    settings: AssociationSettings,
    how: Comparison,
) -> Iterable[_Candidate]:
    """Those that explain the error: others fit poses that the readings do not compare."""
    for kind, parameters, time, fit in time_readings(reference, estimate, settings, how):
        change = Change("estimate", unchanged, time=time)
        candidate = _Candidate(kind, parameters, change, fit)
        if candidate.explains():
            yield candidate


def _simplest(best: _Candidate, candidates: list[_Candidate]) -> _Candidate:
    """The best candidate, or a part of it that explains nearly as much."""
    parts = {"scale", best.kind}
    parts |= _PARTS.get(best.kind, set())
    for part in sorted(candidates, key=lambda candidate: candidate.cost):
        is_simpler = part.parameters < best.parameters or part.kind == "offset"
        is_part = part.kind in parts and is_simpler and part.explains()
        if is_part and not best.fit.halves_errors_of(part.fit):
            return part
    return best


def _turns(trajectory: Trajectory) -> bool:
    """Whether the rotations are more than one that was written for lack of others."""
    rotations = trajectory.T_world_camera.rotation
    return bool((np.abs(rotations - rotations[:1]) > ROUNDING).any())


def _scale_of_all(
    reference: Trajectory, estimate: Trajectory, settings: AssociationSettings
) -> Change:
    """The scale that an alignment by Sim(3) finds."""
    pairs = associate(reference.stamps_s, estimate.stamps_s, settings)
    x = estimate.positions_m[pairs.second]
    y = reference.positions_m[pairs.first]
    return Change("estimate", unchanged, scale=umeyama(x, y, with_scale=True)[1])


def is_drift(scale: float) -> bool:
    """Whether a scale is so near 1 that it may be a drift."""
    return 1 / DRIFT_OF_SCALE < scale < DRIFT_OF_SCALE


def _read_otherwise(
    poses: ComparedPoses, reorders: dict[str, Reorder | None]
) -> Iterable[_Candidate]:
    one, other = poses.halves
    for reading in readings(poses.how, reorders):
        change = reading.fit(poses)
        if reading.kind != "scale" and change.scale != 1.0 and is_drift(change.scale):
            continue
        crossed = reading.fit(other).to(one), reading.fit(one).to(other)
        fit = Fit.of(poses, change.to(poses), crossed)
        yield _Candidate(reading.kind, reading.parameters, change, fit)
