"""Readings of a ground truth and an estimate that may explain a bad estimate: mistakes that files
of poses are often read with, undone.

A reading has free parameters, which are fitted; the explanation is chosen in explanation.py.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..evaluation.compared_poses import ComparedPoses, Comparison
from ..evaluation.time_axis import OtherTime
from ..geometry import axes
from ..geometry.se3 import SE3
from . import constant_transform


@dataclass(frozen=True, eq=False)
class Change:
    """What turns poses as read into those of another reading: `poses` is applied to the poses of
    the estimate or of the reference (`of`), the estimate's positions are multiplied by `scale`,
    and its stamps are those of `time`. rotation (3, 3) and arm_m (3,): of the other body, if the
    reading has one.
    """

    of: str
    poses: Callable[[SE3], SE3]
    scale: float = 1.0
    time: OtherTime | None = None
    rotation: np.ndarray | None = None
    arm_m: np.ndarray | None = None

    def applied(self, reference: SE3, estimate: SE3) -> tuple[SE3, SE3]:
        if self.of == "reference":
            reference = self.poses(reference)
        else:
            estimate = self.poses(estimate)
        return reference, SE3(estimate.rotation, self.scale * estimate.translation)

    def to(self, poses: ComparedPoses) -> ComparedPoses:
        return poses.changed(*self.applied(poses.reference, poses.estimate))


@dataclass(frozen=True)
class Reading:
    """One kind of mistake: `fit` finds its change for compared poses; parameters: how many it
    fits.
    """

    kind: str
    parameters: int
    fit: Callable[[ComparedPoses], Change]


class Reorder(NamedTuple):
    """The other order of quaternions, `wxyz` or `xyzw`, and the poses in it, of poses as read."""

    kind: str
    poses: Callable[[SE3], SE3]


def turned_back(poses: SE3) -> SE3:
    """The poses with inverse rotations at the same positions."""
    return SE3(np.swapaxes(poses.rotation, -1, -2), poses.translation)


def _fixed(of: str, change: Callable[[SE3], SE3]) -> Callable[[ComparedPoses], Change]:
    return lambda poses: Change(of, change)


def unchanged(poses: SE3) -> SE3:
    return poses


def _rotated(poses: ComparedPoses) -> Change:
    C = constant_transform.body_rotation(poses)
    return Change("estimate", lambda T: SE3(T.rotation @ C, T.translation), rotation=C)


def _with_arm(poses: ComparedPoses) -> Change:
    arm_m = constant_transform.lever_arm(poses, np.eye(3))
    return Change("estimate", lambda T: T @ SE3(np.eye(3), arm_m), arm_m=arm_m)


def _of_another_body(poses: ComparedPoses) -> Change:
    X = constant_transform.body_pose(poses)
    return Change("estimate", lambda T: T @ X, rotation=X.rotation, arm_m=X.translation)


def _mirrored(poses: ComparedPoses) -> Change:
    right_handed = poses.changed(poses.reference, axes.mirrored_y(poses.estimate))
    C = constant_transform.body_rotation(right_handed)

    def change(T: SE3) -> SE3:
        right = axes.mirrored_y(T)
        return SE3(right.rotation @ C, right.translation)

    return Change("estimate", change)


def _positions_mirrored(poses: ComparedPoses) -> Change:
    B = constant_transform.world_of_positions(poses, mirrored=True)
    return Change("estimate", lambda T: SE3(T.rotation, T.translation @ B.T))


def _positions_turned(poses: ComparedPoses) -> Change:
    B = constant_transform.world_of_positions(poses)
    return Change("estimate", lambda T: SE3(T.rotation, T.translation @ B.T), rotation=B)


def _scaled(reading: Reading) -> Reading:
    """The reading, and a scale of the estimate."""

    def fit(poses: ComparedPoses) -> Change:
        change = reading.fit(poses)
        scale = change.to(poses).scale()
        return replace(change, scale=scale)

    return Reading(reading.kind, reading.parameters + 1, fit)


def readings(how: Comparison, reorders: dict[str, Reorder | None]) -> list[Reading]:
    """All readings, those with a scale if it is not corrected anyway.

    reorders: of the quaternions of the "estimate" and the "reference"; None or nothing for a file
    of matrices.
    """
    if how.positions_only:
        return _with_scales([Reading("mirror", 0, _fixed("estimate", axes.mirrored_y))], how)
    found = []
    for of in ("estimate", "reference"):
        found.append(Reading("inverse", 0, _fixed(of, SE3.inverse)))
        found.append(Reading("inverse rotations", 0, _fixed(of, turned_back)))
        reorder = reorders.get(of)
        if reorder is not None:
            found.append(Reading(reorder.kind, 0, _fixed(of, reorder.poses)))
    found.append(Reading("rotation", 3, _rotated))
    found.append(Reading("mirror", 3, _mirrored))
    found = _with_scales(found, how)
    found.append(Reading("mirror", 0, _positions_mirrored))
    found.append(Reading("axes", 0, _positions_turned))
    found.append(Reading("arm", 3, _with_arm))
    found.append(Reading("body", 6, _of_another_body))
    return found


def _with_scales(found: list[Reading], how: Comparison) -> list[Reading]:
    """The readings, the same with a scale, and a scale alone, if the scale is not corrected
    anyway.
    """
    if how.with_scale:
        return found
    scale = Reading("scale", 0, _fixed("estimate", unchanged))
    return found + [_scaled(reading) for reading in [*found, scale]]
