"""Relative pose error (RPE): how much the motion over a stretch of frames, seconds or metres is off.

Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, section VII: E_i = (Q_i^-1 Q_j)^-1
(P_i^-1 P_j) with Q the ground truth and P the estimate.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError
from ..geometry import so3
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .align import MirrorCheck, check_mirror, umeyama
from .associate import Association, AssociationSettings
from .pairs import Pairs, pair_up
from .read_only import read_only
from .statistics import ErrorStatistics
from .stretches import StretchSettings, stretches


@dataclass(frozen=True)
class RelativeErrorSettings:
    """correct_scale: multiply the estimate by the scale of its Sim(3) alignment (a rigid one changes nothing here)."""

    stretch: StretchSettings = field(default_factory=StretchSettings)
    association: AssociationSettings = field(default_factory=AssociationSettings)
    correct_scale: bool = False


@dataclass(frozen=True, eq=False)
class RelativeError:
    """Errors of m stretches, from pair start (m,) to pair end (m,): translation_error_m (m,), rotation_error_rad (m,).

    reference (n,) are the paired poses and stamps_s (n,) the stamps of the ground truth.
    """

    reference: SE3
    start: np.ndarray
    end: np.ndarray
    stamps_s: np.ndarray
    association: Association
    scale: float
    mirror: MirrorCheck
    translation_error_m: np.ndarray
    rotation_error_rad: np.ndarray

    @property
    def translation_m(self) -> ErrorStatistics:
        return ErrorStatistics.of(self.translation_error_m)

    @property
    def rotation_deg(self) -> ErrorStatistics:
        return ErrorStatistics.of(self.rotation_error_rad, 180 / np.pi)


def relative_error(
    reference: Trajectory, estimate: Trajectory, settings: RelativeErrorSettings | None = None
) -> RelativeError:
    """RPE of an estimate. Raises InputError where no stamps agree, or no two poses are as far apart as asked for."""
    settings = settings or RelativeErrorSettings()
    pairs = pair_up(reference, estimate, settings.association)
    return relative_error_of_pairs(pairs, settings.stretch, settings.correct_scale)


def relative_error_of_pairs(
    pairs: Pairs, settings: StretchSettings | None = None, correct_scale: bool = False
) -> RelativeError:
    """RPE of poses that are paired already."""
    settings = settings or StretchSettings()
    reference_m, estimate_m = pairs.reference.translation, pairs.estimate.translation
    scale = _scale(reference_m, estimate_m) if correct_scale else 1.0
    estimate = SE3(pairs.estimate.rotation, scale * estimate_m)
    path = pairs.reference if settings.measured_on == "reference" else estimate
    start, end = stretches(pairs.stamps_s, path.translation, settings)
    translation_m, rotation_rad = _errors(pairs.reference, estimate, start, end)
    mirror = check_mirror(reference_m, estimate_m)
    return RelativeError(
        reference=pairs.reference,
        start=read_only(start),
        end=read_only(end),
        stamps_s=pairs.stamps_s,
        association=pairs.association,
        scale=scale,
        mirror=mirror,
        translation_error_m=read_only(translation_m),
        rotation_error_rad=read_only(rotation_rad),
    )


def _errors(reference: SE3, estimate: SE3, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|trans E| and the angle of E. The rotation in front of trans E = R_q^T (t_p - t_q) does not change its length."""
    Q, P = (poses[start].inverse() @ poses[end] for poses in (reference, estimate))
    translation_m = np.linalg.norm(P.translation - Q.translation, axis=1)
    return translation_m, so3.angle(np.swapaxes(Q.rotation, -1, -2) @ P.rotation)


def _scale(reference_m: np.ndarray, estimate_m: np.ndarray) -> float:
    if np.ptp(estimate_m, axis=0).max() == 0.0:
        raise InputError("an estimate that moves, to correct its scale", found="one that stands still")
    _, scale = umeyama(estimate_m, reference_m, with_scale=True)
    return scale
