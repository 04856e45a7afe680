"""The readings of an IMU against the poses of the camera that it moves with: do they agree, and if
not, which mistake in the readings, their stamps or the mounting explains both?
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.trajectory import Trajectory
from ..sensor.imu import ImuStream
from .change import Change
from .competition import Candidate, candidate, winner
from .imu_evidence import LIMITS, ImuEvidence
from .imu_hypotheses import CHAINS, WORDS

#: Of longer recordings, so much is compared.
_LONGEST_S = 60.0


@dataclass(frozen=True, eq=False)
class ImuAgreement:
    """Differences of readings and poses in rad/s and m/s^2 (RMS, without constant biases), None
    without enough of both; changes: what explains them, and `explained`: the differences then.
    """

    errors: tuple[float, float] | None = None
    changes: tuple[Change, ...] = ()
    explained: tuple[float, float] | None = None

    def sentence(self) -> str:
        """What is wrong and what to try; "" if nothing is."""
        if self.errors is None or (np.array(self.errors) <= LIMITS.worth).all():
            return ""
        as_read = f"the IMU does not fit the poses: they differ by {_shown(self.errors)}"
        if self.changes and self.explained is not None:
            words = [WORDS[change.kind](change) for change in self.changes]
            better = " and ".join(one.better for one in words)
            tries = "; ".join(f"{one.cause}; try {one.advice}" for one in words)
            return f"{as_read} as read, by {_shown(self.explained)} {better}: {tries}"
        if (np.array(self.errors) <= LIMITS.largest).all():
            return ""
        return f"{as_read}, and no known mistake explains it: are the poses noisy?"


def _shown(errors: tuple[float, float]) -> str:
    return f"{errors[0]:.2g} rad/s and {errors[1]:.2g} m/s^2"


def imu_agreement(imu: ImuStream, poses: Trajectory) -> ImuAgreement:
    """Compare the readings of an IMU with the poses of the camera, in a world z up."""
    given = ImuEvidence.of(*_shortened(imu, poses))
    if given is None:
        return ImuAgreement()
    errors = (given.errors[0], given.errors[1])
    if (np.array(errors) <= given.limits.worth).all():
        return ImuAgreement(errors)
    found: list[Candidate] = []
    best = None
    for chains in CHAINS:
        fitted = [candidate(given.parts, chain) for chain in chains]
        found += [one for one in fitted if one is not None]
        best = winner(found)
        if best is not None and (best.fit.found[0] <= given.limits.worth).all():
            break
    if best is None:
        return ImuAgreement(errors)
    left = given.after(best.changes).errors
    return ImuAgreement(errors, best.changes, (left[0], left[1]))


def _shortened(imu: ImuStream, poses: Trajectory) -> tuple[ImuStream, Trajectory]:
    """The first minute that has both; of stamps without one, the first minute of each."""
    stamps_s = imu.stamps_s
    if not len(stamps_s) or not len(poses):
        return imu, poses
    first_s, first_read_s = float(poses.stamps_s[0]), float(stamps_s[0])
    if first_read_s <= poses.stamps_s[-1] and first_s <= stamps_s[-1]:
        first_s = first_read_s = max(first_s, first_read_s)
    kept = (poses.stamps_s >= first_s) & (poses.stamps_s <= first_s + _LONGEST_S)
    last_s = first_read_s + _LONGEST_S
    if not kept.any():
        return imu, poses
    return imu.around(first_read_s, last_s), poses[np.flatnonzero(kept)]
