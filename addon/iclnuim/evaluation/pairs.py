"""Two trajectories cut down to the poses that belong together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .associate import Association, AssociationSettings, associate
from .read_only import read_only


@dataclass(frozen=True, eq=False)
class Pairs:
    """Poses (n,) of the reference and of the estimate at the same times; stamps_s (n,) are the reference's."""

    reference: SE3
    estimate: SE3
    stamps_s: np.ndarray
    association: Association

    def __len__(self) -> int:
        return len(self.stamps_s)

    @classmethod
    def of_poses(cls, reference: SE3, estimate: SE3, rate_hz: float = 30.0) -> Pairs:
        """Pose i with pose i, stamped i / rate."""
        if reference.shape != estimate.shape or len(reference.shape) != 1:
            found = f"{estimate.shape} and {reference.shape}"
            raise InputError("as many estimated poses (n,) as reference poses", found=found)
        index = np.arange(len(reference))
        association = Association(index, index, np.zeros(len(index)), len(index), len(index))
        return cls(reference, estimate, read_only(index / rate_hz), association)


def pair_up(reference: Trajectory, estimate: Trajectory, settings: AssociationSettings | None = None) -> Pairs:
    """Associate by time. Raises InputError where the two do not overlap, or overlap without a pair in the window."""
    settings = settings or AssociationSettings()
    association = associate(reference.stamps_s, estimate.stamps_s, settings)
    if len(association) == 0:
        raise _no_pairs(reference.stamps_s, estimate.stamps_s, settings)
    return Pairs(
        reference.T_world_camera[association.first],
        estimate.T_world_camera[association.second],
        read_only(reference.stamps_s[association.first]),
        association,
    )


def _no_pairs(reference_s: np.ndarray, estimate_s: np.ndarray, settings: AssociationSettings) -> InputError:
    if len(reference_s) == 0 or len(estimate_s) == 0:
        return InputError("trajectories of at least one pose", found="an empty one")
    start_s, end_s = estimate_s[[0, -1]] + settings.offset_s
    if start_s > reference_s[-1] or end_s < reference_s[0]:
        shift = f"{reference_s[0] - estimate_s[0]:.6f}".rstrip("0").rstrip(".")
        return InputError(
            f"stamps that overlap the ground truth's {_span(reference_s)}",
            found=f"no overlap in time: {_span(estimate_s + settings.offset_s)}",
            hint=f"--offset {shift} if both start together, or --from tum-ids if these are frame numbers",
        )
    return InputError(
        f"stamps within {settings.max_difference_s:g} s of the ground truth's {_span(reference_s)}",
        found=f"none in {_span(estimate_s + settings.offset_s)}",
        hint="a larger --max-difference, or --offset",
    )


def _span(stamps_s: np.ndarray) -> str:
    return f"{stamps_s[0]:.3f}..{stamps_s[-1]:.3f} s"
