"""Absolute trajectory error (ATE): how far each aligned estimated pose is from the ground truth's at the same time.

Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, section VII; the paper's Table II
holds such errors.
"""

from dataclasses import dataclass, field

import numpy as np

from ..geometry import so3
from ..geometry.se3 import SE3, read_only
from ..geometry.trajectory import Trajectory
from .align import Alignment, AlignmentSettings, align, check_mirror
from .associate import AssociationSettings, Pairs, pair_up
from .statistics import Completeness, PoseErrors


@dataclass(frozen=True)
class AbsoluteErrorSettings:
    """How poses are associated by their stamps, and how the estimate is aligned with the reference."""

    association: AssociationSettings = field(default_factory=AssociationSettings)
    alignment: AlignmentSettings = field(default_factory=AlignmentSettings)


@dataclass(frozen=True, eq=False)
class AbsoluteError(PoseErrors):
    """Errors of n pairs, and how they came about: reference and aligned (n,), both in the reference's world."""

    aligned: SE3
    alignment: Alignment

    @property
    def completeness(self) -> Completeness:
        """Over all ground-truth frames; where one has several estimates, the closest in time counts."""
        return Completeness.of(
            self.translation_error_m[self.association.closest_per_first()], self.association.first_count
        )


def absolute_error(
    reference: Trajectory, estimate: Trajectory, settings: AbsoluteErrorSettings | None = None
) -> AbsoluteError:
    """ATE of an estimate. Raises InputError where no stamps agree, or the paths do not fix the alignment asked for."""
    settings = settings or AbsoluteErrorSettings()
    return absolute_error_of_pairs(pair_up(reference, estimate, settings.association), settings.alignment)


def absolute_error_of_pairs(pairs: Pairs, settings: AlignmentSettings | None = None) -> AbsoluteError:
    """ATE of poses that are paired already: |t_ref - t_est| and the angle of R_ref^T R_est after alignment."""
    alignment = align(pairs.reference, pairs.estimate, settings)
    aligned = alignment.apply(pairs.estimate)
    return AbsoluteError(
        reference=pairs.reference,
        aligned=aligned,
        stamps_s=pairs.stamps_s,
        association=pairs.association,
        alignment=alignment,
        mirror=check_mirror(pairs.reference.translation, pairs.estimate.translation),
        translation_error_m=read_only(np.linalg.norm(aligned.translation - pairs.reference.translation, axis=1)),
        rotation_error_rad=read_only(so3.angle(np.swapaxes(pairs.reference.rotation, -1, -2) @ aligned.rotation)),
    )
