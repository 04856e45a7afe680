"""ICP: point-to-plane with projective association, R. Newcombe et al., "KinectFusion", ISMAR 2011,
section 3.5.
"""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from .candidates import AlignmentCandidate, Estimate, pick
from .certainty import MAX_ROUGHNESS, with_bias
from .levels import Level, Pair, PyramidOdometer, pyramid
from .protocol import Frame, OdometryResult, OdometryStatus
from .solver import Pass, SolverLimits, Stop, solve
from .terms.plane import IcpSettings, PlaneTerm, roughness

#: A guess is poor if the RMS distance between the surfaces there is at least this (a prediction has
#: 0.5 to 12 mm, clean and noisy; a guess with an error of 5 degrees has 20 mm and more). A rotation
#: is then estimated first, on a coarse level and with wide gates for distance and angle (guesses
#: 35 degrees off are found; with a gate of 30 degrees only those up to 25).
POOR_M = 0.015
WIDE_LEVEL = 2
WIDE: dict[str, Any] = {"max_distance_m": 1.0, "max_angle_deg": 60.0, "nu": 2.0}
#: What differs in the planes of a noisy frame: all points within this angle match with equal
#: weights.
ROUGH: dict[str, Any] = {"max_angle_deg": 30.0, "nu": 0.0, "noise_share": 0.25}
#: Below this eigenvalue (a share of a trace of three directions) a noisy frame is degenerate: one
#: in a thousand points constrains the direction, at the border of an object that is leaving the
#: view, where normals have more errors than those of noise.
ROUGH_EIGENVALUE = 1 / 3000


class Icp(PyramidOdometer):
    name = "icp"
    reads_normals = True
    PRESETS: dict[str, Any] = {
        "paper": IcpSettings(),
        "best": IcpSettings(
            iterations=(0, 4, 3),
            strides=(1, 2, 1),
            bilateral=False,
            two_normals=True,
            max_angle_deg=12.0,
            nu=10.0,
            rough_step=3,
            stop=Stop(min_step=5e-6),
            limits=SolverLimits(prior_m=0.003),
            reference="keyframe",
        ),
    }

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        s = self.settings
        if s.bilateral:
            # missing depth (0) is too far from any other for a weight, and stays missing
            smooth = cv2.bilateralFilter(frame.depth_z_m, 13, 0.03, 4.5)
            frame = replace(frame, depth_z_m=np.where(frame.depth_z_m > 0, smooth, np.float32(0)))
        levels = pyramid(frame, camera, len(s.iterations))
        if s.rough_step and roughness(levels[min(1, len(levels) - 1)]) > MAX_ROUGHNESS:
            return [replace(level, normal_step=s.rough_step, rough=True) for level in levels]
        return levels

    def align(self, reference: list[Level], current: list[Level], guess: SE3) -> OdometryResult:
        """The alignment from the guess.

        In `best`, if the guess is poor, also from an estimated rotation; the one with more inliers
        is returned.
        """
        pair = Pair(reference, current)
        found = self._align_from(pair, guess)
        assert found.surface
        if found.surface.distance_m >= POOR_M and self.settings.two_normals:
            rotated = estimate_rotation(pair, self.settings, guess)
            found = pick(found, [self._align_from(pair, rotated)], lambda one: one.result.inliers)
        return with_bias(found.result, pair.calibrated) if pair.rough else found.result

    def _align_from(self, pair: Pair, guess: SE3) -> Estimate:
        return self.planes(pair, guess).estimate()

    def planes(self, pair: Pair, guess: SE3) -> AlignmentCandidate:
        """Planes alone."""
        s = self.plane_settings(pair)
        schedule = self.schedule(pair.reference)
        terms = [PlaneTerm(pair, s, n) for n, _ in schedule]
        passes = [Pass(term, schedule[k][1], s.stop) for k, term in enumerate(terms)]
        limits = s.limits
        if pair.rough:
            limits = replace(limits, min_eigenvalue=ROUGH_EIGENVALUE)
        return AlignmentCandidate(guess, passes, limits, surface=terms[0])

    def plane_settings(self, pair: Pair) -> IcpSettings:
        return replace(self.settings, **ROUGH) if pair.rough else self.settings


def estimate_rotation(pair: Pair, settings: IcpSettings, guess: SE3) -> SE3:
    """The guess, rotated about the camera to the minimum of the point-to-plane error."""
    n = min(WIDE_LEVEL, len(pair.reference) - 1)
    strides = (2,) * len(pair.reference)
    wide = replace(settings, strides=strides, two_normals=False, **WIDE)
    search = Pass(PlaneTerm(pair, wide, n), 20, Stop(min_step=1e-3), rotation_only=True)
    result = solve([search], guess, SolverLimits(min_inliers=0.01))
    return guess if result.status is OdometryStatus.FAILED else result.T_reference_camera
