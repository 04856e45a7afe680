"""How well a possible explanation of a bad estimate fits, and whether it explains it."""

from dataclasses import dataclass

import numpy as np

from ..evaluation.compared_poses import ComparedPoses, Errors

#: An explanation is worth naming if it leaves at most this share of an error, which is above
#: WORTH_M: files have a resolution of about 0.1 mm.
WORTH_SHARE = 0.5
WORTH_M = 1e-4
#: In each half of the trajectory it leaves at most this share.
HALF_SHARE = 0.9
#: What is left is at most this share of the ground truth's extent, or of its motions: a failed
#: estimate can always be shrunk to a point.
FITS_EXTENT = 0.35
FITS_MOTION = 0.7
#: With a larger error of the turns (30 degrees) the estimate is another motion.
_OTHER_TURN_RAD = 0.5
#: A logarithm of a scale below this multiple of what is left, as a share of the extent, may be
#: noise.
_NOISE_OF_SCALE = 2.5
#: Each fitted parameter has to reduce the product of the three errors by this share.
PER_PARAMETER = 0.2
#: Errors below this, in metres and radians, are rounding.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Fit:
    """Errors as given and as explained, in all and in each half of the trajectory, where the
    explanation has the parameters that fit the other half; extent of the ground truth, and RMS of
    its motions.
    """

    given: Errors
    found: Errors
    given_halves: tuple[Errors, Errors]
    found_halves: tuple[Errors, Errors]
    extent_m: float
    motion_m: float

    @classmethod
    def of(
        cls,
        given: ComparedPoses,
        found: ComparedPoses,
        found_halves: tuple[ComparedPoses, ComparedPoses],
    ) -> "Fit":
        extent_m, motion_m = found.sizes_m()
        return cls(
            given=given.errors,
            found=found.errors,
            given_halves=(given.halves[0].errors, given.halves[1].errors),
            found_halves=(found_halves[0].errors, found_halves[1].errors),
            extent_m=extent_m,
            motion_m=motion_m,
        )

    def cost(self, parameters: int) -> float:
        """Mean logarithm of the product of the errors of each half, and the price of the fitted
        parameters.
        """
        errors = [(half.position_m, half.motion_m, half.turn_rad) for half in self.found_halves]
        product = np.log(np.maximum(errors, ROUNDING)).sum() / 2
        return float(product) + PER_PARAMETER * parameters

    def explains(self, concerns_all: bool = False) -> bool:
        """Whether it halves an error and makes none of the others clearly worse; or makes all
        others of lengths clearly smaller, if it concerns them all.
        """
        turn_rad = self.found.turn_rad
        if turn_rad > _OTHER_TURN_RAD or self._left("turn_rad") > 1 / HALF_SHARE:
            return False
        lengths = ("position_m", "motion_m")
        limit = HALF_SHARE if concerns_all else 1 / HALF_SHARE
        if any(self._left(name) > limit for name in lengths):
            return False
        return any(self._halves(name) for name in lengths)

    def may_be_noise(self, scale: float) -> bool:
        """Whether errors as large as those that are left can have caused the scale."""
        noise = self.found.position_m / self.extent_m
        return abs(np.log(scale)) < _NOISE_OF_SCALE * noise

    def _left(self, name: str) -> float:
        """The share of an error that is left."""
        return (getattr(self.found, name) + ROUNDING) / (getattr(self.given, name) + ROUNDING)

    def halves_errors_of(self, other: "Fit") -> bool:
        """Whether it leaves at most half of what another explanation leaves."""
        position = self.found.position_m <= WORTH_SHARE * other.found.position_m
        return position or self.found.motion_m <= WORTH_SHARE * other.found.motion_m

    def _halves(self, name: str) -> bool:
        limits_m = {
            "position_m": FITS_EXTENT * self.extent_m,
            "motion_m": FITS_MOTION * self.motion_m,
        }
        given_m = getattr(self.given, name)
        worth = given_m > WORTH_M
        fits = getattr(self.found, name) <= min(WORTH_SHARE * given_m, limits_m[name])
        return worth and fits and self._holds_in_halves(name)

    def _holds_in_halves(self, name: str) -> bool:
        for given, found in zip(self.given_halves, self.found_halves, strict=True):
            if getattr(found, name) > HALF_SHARE * getattr(given, name):
                return False
        return True
