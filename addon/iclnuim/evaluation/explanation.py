"""The explanation of a bad estimate: another reading of the poses or of the stamps, a scale, or
another body, with which it fits the ground truth much better.

All explanations compete. The best one wins if it halves the ATE or the RPE, leaves an error that is
small against the motion itself, and holds in each half of the trajectory with the parameters that
the other half gives. Otherwise nothing explains the estimate, or it needs no explanation.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..geometry.trajectory import Trajectory
from .align import umeyama
from .associate import AssociationSettings, associate, pairing_offset
from .compared_poses import ComparedPoses, Comparison
from .fit import ROUNDING, Fit
from .readings import Change, Reorder, readings, unchanged

#: Scales within this factor are a drift of scale.
DRIFT_OF_SCALE = 1.15
#: Pairs of poses in each half.
_MIN_PAIRS = 5


@dataclass(frozen=True, eq=False)
class Explanation:
    """What explains most of an estimate's error.

    kind: `inverse` (world-to-camera poses), `inverse rotations`, `wxyz` or `xyzw` (order of the
    quaternions), `rotation`, `arm`, `body` (constant rotation, lever arm, or both, between the two
    bodies), `mirror`, `axes` (positions and rotations in different worlds), `scale`, `offset`.
    change: what makes reference and estimate, as read, those given here. delta: frames between the
    poses of the pairs whose errors were compared.
    """

    kind: str
    change: Change
    reference: Trajectory
    estimate: Trajectory
    delta: int


class _Candidate(NamedTuple):
    kind: str
    parameters: int
    change: Change
    fit: Fit

    @property
    def cost(self) -> float:
        return self.fit.cost(self.parameters)

    def explains(self) -> bool:
        return self.fit.explains(concerns_all=self.kind in ("scale", "offset"))


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
    poses = _compared(reference, estimate, settings, how)
    if poses is None:
        return None
    candidates = list(_read_otherwise(poses, reorders or {}))
    candidates += _shifted(reference, estimate, settings, how)
    best = _simplest(min(candidates, key=lambda candidate: candidate.cost), candidates)
    change = best.change
    if best.kind == "scale":
        change = _scale_of_all(reference, estimate, settings)
        if is_drift(change.scale):
            return None
    if not best.explains():
        return None
    truth, T = change.applied(reference.T_world_camera, estimate.T_world_camera)
    moved_s = change.offset_s - settings.offset_s if change.offset_s else 0.0
    return Explanation(
        best.kind,
        change,
        reference=Trajectory(reference.stamps_s, truth),
        estimate=Trajectory(estimate.stamps_s + moved_s, T),
        delta=how.delta,
    )


def _simplest(best: _Candidate, candidates: list[_Candidate]) -> _Candidate:
    """The best candidate, or a part of it that explains nearly as much."""
    parts = {"scale", best.kind}
    if best.kind == "body":
        parts |= {"rotation", "arm"}
    for part in sorted(candidates, key=lambda candidate: candidate.cost):
        is_part = part.kind in parts and part.parameters < best.parameters
        if is_part and part.explains() and not best.fit.halves_errors_of(part.fit):
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


def _compared(
    reference: Trajectory,
    estimate: Trajectory,
    settings: AssociationSettings,
    how: Comparison,
) -> ComparedPoses | None:
    """Associated poses; None if they are too few."""
    pairs = associate(reference.stamps_s, estimate.stamps_s, settings)
    delta = min(how.delta, max(1, len(pairs) // 4))
    if len(pairs) - delta < 2 * _MIN_PAIRS:
        return None
    first = reference.T_world_camera[pairs.first]
    second = estimate.T_world_camera[pairs.second]
    return ComparedPoses.of(first, second, how, delta)


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


def _shifted(
    reference: Trajectory,
    estimate: Trajectory,
    settings: AssociationSettings,
    how: Comparison,
) -> Iterable[_Candidate]:
    """The best constant offset of the stamps, compared on the poses that both offsets pair."""
    best = pairing_offset(reference, estimate, settings)
    if best is None:
        return
    with_it = replace(settings, offset_s=best[0])
    paired = associate(reference.stamps_s, estimate.stamps_s, with_it)
    same = estimate[np.unique(paired.second)]
    found = _compared(reference, same, with_it, how)
    given = _compared(reference, same, settings, how)
    if found is None or given is None:
        return
    change = Change("estimate", unchanged, offset_s=with_it.offset_s)
    yield _Candidate("offset", 1, change, Fit.of(given, found, found.halves))
