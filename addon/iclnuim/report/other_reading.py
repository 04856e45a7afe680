"""Other readings of an estimate that fit the ground truth much better: its poses inverted, or its
quaternions with the scalar first.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..evaluation.absolute_error import AbsoluteError
from ..evaluation.relative_error import RelativeError
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory

#: Another reading, unit or time offset is only reported if the error is above WORTH_M, and is
#: reduced below WORTH_SHARE of it.
WORTH_M = 1e-4
WORTH_SHARE = 0.5
#: Rotations read in the wrong order are wrong by more than this, and in the right one by less than
#: this share of it. Another convention of the camera's axes is wrong in every order.
_WORTH_DEG = 1.0
_TURN_SHARE = 0.25

Measure = Callable[[Trajectory], AbsoluteError | RelativeError]


@dataclass(frozen=True)
class OtherReading:
    """A reading with much smaller errors. kind: `inverse` (world-to-camera poses) or `wxyz` (scalar
    first); RMSE in metres and degrees in this reading, and as given.
    """

    kind: str
    rmse_m: float
    given_rmse_m: float
    rotation_rmse_deg: float
    given_rotation_rmse_deg: float

    @classmethod
    def of(
        cls, estimate: Trajectory, given: AbsoluteError | RelativeError, measure: Measure
    ) -> "OtherReading | None":
        """The reading of the estimate with much smaller errors by `measure` than those `given`;
        None if there is none.
        """
        metres = given.translation_m.rmse
        degrees = given.rotation_deg.rmse
        for kind, poses in (("inverse", SE3.inverse), ("wxyz", _scalar_first)):
            try:
                found = measure(Trajectory(estimate.stamps_s, poses(estimate.T_world_camera)))
            except InputError:
                continue
            reading = cls(kind, found.translation_m.rmse, metres, found.rotation_deg.rmse, degrees)
            if reading._fits():
                return reading
        return None

    def _fits(self) -> bool:
        given_deg = self.given_rotation_rmse_deg
        if self.kind == "inverse":
            closer = self.given_rmse_m > WORTH_M and self.rmse_m < WORTH_SHARE * self.given_rmse_m
            return closer and self.rotation_rmse_deg <= given_deg
        turned = given_deg > _WORTH_DEG and self.rotation_rmse_deg < _TURN_SHARE * given_deg
        return turned and self.rmse_m <= self.given_rmse_m * (1 + 1e-9)

    def sentence(self, format: str) -> str:
        """A warning with advice; `format`: the name of the format of the estimate's file."""
        if self.kind == "inverse":
            what = "inverted"
            errors = f"{1000 * self.rmse_m:.3g} mm instead of {1000 * self.given_rmse_m:.3g}"
            why = "its poses may be world to camera"
        else:
            what = "with quaternions qw qx qy qz"
            given_deg = self.given_rotation_rmse_deg
            errors = f"{self.rotation_rmse_deg:.3g} degrees instead of {given_deg:.3g}"
            why = "they may have the scalar first"
        advice = f"reading it as tum-{self.kind}" if format == "tum" else "converting it"
        return f"the estimate fits much better {what}: {errors}; {why}; try {advice}"


def _scalar_first(poses: SE3) -> SE3:
    """The poses if the four numbers that were read as qx qy qz qw are qw qx qy qz."""
    return SE3.from_quat_xyzw(np.roll(poses.quat_xyzw, -1, axis=-1), poses.translation)
