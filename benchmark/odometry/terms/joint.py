"""The geometric and the photometric term together: T. Whelan et al., "Robust real-time visual
odometry for dense RGB-D mapping", ICRA 2013, section IV.
"""

from collections.abc import Callable

import numpy as np
from iclnuim.geometry.se3 import SE3

from ..normal_equations import NormalEquations
from ..solver import Term
from .plane import PlaneTerm

#: Weight of the photometric term where its equations are not information (Whelan 2013, section IV).
WEIGHT_RGBD = 0.1


class JointTerm:
    """The sum of both equations. Where the image's are information, each term is weighted by its
    own variance, independent of units.

    weight_b: of the photometric right-hand side; error: a further error of the motion that planes
    measure (NormalEquations.with_error).
    """

    def __init__(
        self,
        planes: PlaneTerm,
        image: Term,
        weight_b: float,
        error: Callable[[SE3], np.ndarray] | None = None,
    ) -> None:
        self.planes = planes
        self.image = image
        self.weight_b = weight_b
        self.error = error
        self.pixels = planes.pixels

    def linearise(self, T: SE3, iteration: int) -> NormalEquations:
        geometry = self.planes.linearise(T, iteration)
        image = self.image.linearise(T, iteration)
        if self.error:
            geometry = geometry.with_error(self.error(T))
        weight = 1.0 if image.is_information else WEIGHT_RGBD**2
        return geometry.plus(image, weight, self.weight_b)
