"""ICP and ICP+RGB-D.

ICP: point-to-plane with projective association, R. Newcombe et al., "KinectFusion", ISMAR 2011,
section 3.5. ICP+RGB-D: with the photometric term, T. Whelan et al., "Robust real-time visual
odometry for dense RGB-D mapping", ICRA 2013, section IV.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from . import kernels
from .certainty import ACROSS, DOWN, MAX_ROUGHNESS, disagreement, jackknife_information, with_bias
from .depth_term import MAX_DISTANCE_M, DepthTerm
from .photometric import (
    PhotometricSettings,
    PhotometricTerm,
    Rgbd,
    Start,
    initialise,
    no_contrast,
    photometric_passes,
)
from .protocol import Frame, Result, Status
from .solver import (
    MIN_EIGENVALUE,
    Level,
    Limits,
    Pass,
    PyramidOdometer,
    Stop,
    System,
    pyramid,
    solve,
)

#: A guess is poor if the RMS distance between the surfaces there is at least this (a prediction has
#: 0.5 to 12 mm, clean and noisy; a guess with an error of 5 degrees has 20 mm and more). A rotation
#: is then estimated first, on a coarse level and with wide gates for distance and angle.
POOR_M = 0.015
WIDE_DISTANCE_M, WIDE_ANGLE_DEG, WIDE_NU, WIDE_LEVEL, WIDE_STRIDE, WIDE_ITERATIONS = (
    1.0,
    60.0,
    2.0,
    2,
    2,
    20,
)
WIDE_STOP, WIDE_LIMITS = Stop(min_step=1e-3), Limits(min_inliers=0.01)
ROUGH_ANGLE_DEG, ROUGH_NOISE = 30.0, 0.25
#: Below this eigenvalue (a share of a trace of three directions) a noisy frame is degenerate: one
#: in a thousand points constrains the direction, at the border of an object that is leaving the
#: view, where normals have more errors than those of noise.
ROUGH_EIGENVALUE = 1 / 3000
#: Weight of the photometric term where its equations are not information (Whelan 2013).
WEIGHT_RGBD = 0.1
#: Where the images do not fit at the prediction, planes alone are trusted if this many times as
#: many points match. At the same motion the counts differ by less than 0.1 %.
MORE_INLIERS = 1.01
#: For noisy frames whose offset of depth is not known. ROUGH_ERROR: relative error of a motion from
#: planes, because depth is biased, and noise shortens the motion: of each component between two
#: frames, of its length against a model. ROUGH_PRIOR_M, for all noisy frames: standard deviation of
#: the motion about its prediction, for frames where the image alone constrains the motion.
ROUGH_ERROR, ROUGH_PRIOR_M = 0.1, 0.01
#: Number of pixels of a noisy image that share one error, next to planes whose offset of depth is
#: known: fewer than on clean frames, whose errors are those of interpolation. With 12 motions are
#: as accurate, but NEES is up to 4.4 instead of 1.9; with 75 errors over a second are 4 to 13 %
#: larger (noisy living room kt1, kt2, office kt2).
CALIBRATED_SPREAD = 24.0


@dataclass(frozen=True)
class IcpSettings:
    """Settings of the geometric term and of the odometer. Tuples run from fine to coarse. The
    defaults are Kintinuous' (KinectFusion).

    A frame is noisy (from a sensor) if its normals three pixels apart differ by more than
    MAX_ROUGHNESS. Its normals are then computed over rough_step pixels, all points within
    ROUGH_ANGLE_DEG match with equal weights, and the share ROUGH_NOISE of the disagreement of
    normals counts as noise.
    """

    iterations: tuple[int, ...] = (10, 5, 4)  # maximum on each level; 0: level not used
    strides: tuple[int, ...] = (1, 1, 1)  # distance between the rows and columns that are used
    bilateral: bool = True  # depth filter, 13 x 13, 4.5 px, 30 mm
    max_angle_deg: float = 20.0
    nu: float = 0.0  # degrees of freedom of Student's t; 0: least squares
    # products of the residuals along the normals of both images, as information; not squares along
    # one normal
    two_normals: bool = False
    rough_step: int = 0  # pixels; 0: no frame counts as noisy
    stop: Stop = Stop()
    limits: Limits = Limits(min_eigenvalue=MIN_EIGENVALUE)
    reference: str = "frame"


class PlaneTerm:
    """Point-to-plane equations in metres on level n. noise_share: share of the disagreement of two
    normals that counts as noise.
    """

    def __init__(
        self,
        reference: Level,
        current: Level,
        settings: IcpSettings,
        n: int,
        noise_share: float = 1.0,
        max_distance_m: float = MAX_DISTANCE_M,
    ) -> None:
        self.reference, self.settings, self.noise_share = reference, settings, noise_share
        self.gate, self.first_m = (
            (max_distance_m, math.cos(math.radians(settings.max_angle_deg))),
            math.nan,
        )
        rule = (settings.strides[n], ACROSS, DOWN)
        found = kernels.flat_points(
            current.camera.intrinsics, current.depth_z_m, current.normals, *rule
        )
        self.pixels, self.points, self.directions, self.blocks = found
        count = len(self.points)
        self.residual, self.residual1 = np.empty((2, count), np.float32)
        self.J, self.J1 = np.empty((2, count, 6), np.float32)
        self.sums = np.empty((ACROSS * DOWN, 34))
        self.sigma, self.disagreement = 0.005, 0.0

    def __call__(self, T: SE3, iteration: int) -> System:
        level, s = self.reference, self.settings
        found = (self.residual, self.J, self.residual1, self.J1)
        kernels.plane_residuals(
            T.matrix,
            level.camera.intrinsics,
            self.points,
            self.directions,
            level.depth_z_m,
            level.normals,
            *self.gate,
            *found,
        )
        if s.nu > 0:
            self.sigma = max(kernels.student_scale(self.residual, s.nu, self.sigma, 10), 1e-5)
        J1, residual1 = (self.J1, self.residual1) if s.two_normals else (self.J, self.residual)
        pairs = (self.J, self.residual, J1, residual1)
        kernels.block_sums(self.points, *pairs, self.sigma, s.nu, self.blocks, self.sums)
        system = System.of_sums(self.sums.sum(axis=0))
        if math.isnan(self.first_m):
            self.first_m = math.sqrt(system.error) if system.count else math.inf
        if s.two_normals:
            if iteration == 0:
                self.disagreement = self._disagreement()
            # The disagreement of two corresponding normals is noise. With the depth steps of a
            # sensor, as much noise again can be common to both.
            system = jackknife_information(
                system.less_noise(self.noise_share * self.disagreement * system.weight),
                self.sums,
                s.nu,
            )
        return system

    def _disagreement(self) -> float:
        """disagreement() of about 2000 pairs of normals."""
        step = len(self.residual) // 2000 + 1
        some = np.isfinite(self.residual[::step])
        return disagreement(np.sum(self.J[::step, :3][some] * self.J1[::step, :3][some], axis=1))


class Icp(PyramidOdometer):
    name, reads_normals = "icp", True
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
            limits=Limits(prior_m=0.003),
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
            levels = [replace(level, normal_step=s.rough_step) for level in levels]
        return levels

    def rough(self, levels: list[Level]) -> bool:
        """Whether prepare() classified the frame as noisy."""
        return self.settings.rough_step > 0 and levels[0].normal_step == self.settings.rough_step

    def biased(self, reference: list[Level], current: list[Level]) -> bool:
        """Whether planes give a biased motion: those of two noisy frames whose offset of depth is
        not known. A model's are averages.
        """
        return self.rough(current) and not (reference[-1].rendered or current[0].calibrated)

    def plane_settings(self, levels: list[Level]) -> tuple[IcpSettings, float]:
        """The settings of the planes of a frame, and the share of the disagreement of normals that
        counts as noise.
        """
        if not self.rough(levels):
            return self.settings, 1.0
        return replace(self.settings, max_angle_deg=ROUGH_ANGLE_DEG, nu=0.0), ROUGH_NOISE

    def align(self, reference: list[Level], current: list[Level], guess: SE3) -> Result:
        """The alignment from the guess.

        In `best`, if the guess is poor, also from an estimated rotation; the one with more inliers
        is returned.
        """
        result, distance_m = self._align_from(reference, current, guess)
        if distance_m >= POOR_M and self.settings.two_normals:
            rotated = estimate_rotation(reference, current, self.settings, guess)
            second, _ = self._align_from(reference, current, rotated)
            result = second if second.inliers > result.inliers else result
        if not self.rough(current):
            return result
        return with_bias(result, current[0].calibrated)

    def _align_from(
        self, reference: list[Level], current: list[Level], guess: SE3
    ) -> tuple[Result, float]:
        """The alignment from a guess, and the RMS distance in metres between the surfaces at the
        guess.
        """
        (s, noise_share), schedule = self.plane_settings(current), self.schedule(reference)
        terms = [PlaneTerm(reference[n], current[n], s, n, noise_share) for n, _ in schedule]
        passes = [
            Pass(term, count, term.pixels, s.stop)
            for term, (_, count) in zip(terms, schedule, strict=True)
        ]
        limits = (
            replace(s.limits, min_eigenvalue=ROUGH_EIGENVALUE) if self.rough(current) else s.limits
        )
        return solve(passes, guess, limits), terms[0].first_m


def estimate_rotation(
    reference: list[Level], current: list[Level], settings: IcpSettings, guess: SE3
) -> SE3:
    """The guess, rotated about the camera to the minimum of the point-to-plane error."""
    n = min(WIDE_LEVEL, len(reference) - 1)
    strides = (WIDE_STRIDE,) * len(reference)
    wide = replace(
        settings, strides=strides, max_angle_deg=WIDE_ANGLE_DEG, nu=WIDE_NU, two_normals=False
    )
    term = PlaneTerm(reference[n], current[n], wide, n, max_distance_m=WIDE_DISTANCE_M)
    result = solve(
        [Pass(term, WIDE_ITERATIONS, term.pixels, WIDE_STOP, rotation_only=True)],
        guess,
        WIDE_LIMITS,
    )
    return guess if result.status is Status.FAILED else result.T_reference_camera


def roughness(level: Level) -> float:
    """Median of 1 - cosine of normals three pixels apart, which have no depth pixel in common."""
    normals = level.normals[::4]
    one, other = normals[:, :-3:4], normals[:, 3::4]
    both = (one[..., 2] != 0) & (other[..., 2] != 0)
    return 1.0 - float(np.median(np.sum(one[both] * other[both], axis=-1))) if both.any() else 0.0


_PAPER = PhotometricSettings(iterations=(10, 5, 4), min_gradients=(12, 5, 3), max_depth_m=13.0)


class IcpRgbd(Icp):
    """Settings: of the geometric term, whose stop and limits are used, and whose iterations are
    those of planes alone; of the photometric
    term, whose iterations are those of both terms; and the weight of the photometric term on the
    right-hand side.
    """

    name, reads_grey = "icp_rgbd", True
    PRESETS = {
        "paper": (IcpSettings(), _PAPER, WEIGHT_RGBD**2),
        # a mistake in the code that the paper used: the matrix is weighted by w^2, the right-hand
        # side by w
        "kintinuous2013": (IcpSettings(), _PAPER, WEIGHT_RGBD),
        "best": (
            replace(Icp.PRESETS["best"], iterations=(0, 4, 3, 0), strides=(1, 2, 1, 1)),
            replace(
                Rgbd.PRESETS["best"],
                iterations=(0, 2, 2, 2),
                min_gradients=(12, 2, 3, 3),
                spread=75.0,
            ),
            1.0,
        ),
    }

    def __init__(self, settings: tuple[IcpSettings, PhotometricSettings, float]) -> None:
        super().__init__(settings[0])
        _, self.photometric, self.weight_b = settings
        self.iterations, self.alone = self.photometric.iterations, Icp(settings[0])

    def _align_from(
        self, reference: list[Level], current: list[Level], guess: SE3
    ) -> tuple[Result, float]:
        """The geometric term alone is used where the images have no contrast or are unrelated, and
        on clean frames where it is more
        certain than the images in every direction. Where both terms are information, each is
        weighted by its own variance, independent of units. If the images do not fit at the guess,
        the alignment starts from a corrected guess, from the guess itself, and from the guess
        without images; the one with the most matching points is returned.
        """
        if no_contrast(reference, current):
            return self.alone._align_from(reference, current, guess)
        biased, rendered, schedule = (
            self.biased(reference, current),
            reference[-1].rendered,
            self.schedule(reference),
        )
        settings = self.photometric
        start = (
            Start(guess, schedule)
            if rendered
            else initialise(reference, current, settings, schedule, guess)
        )
        if self.settings.two_normals and not (self.rough(current) or rendered or start.poor):
            alone, distance_m = self.alone._align_from(reference, current, guess)
            if alone.status is Status.OK and self._outweighs(
                alone, reference, current, schedule[-1:]
            ):
                return alone, distance_m
        # biased planes, and those against a model, get a relative error that is larger than their
        # noise
        rule, noise_share = (
            (self.settings, 1.0) if biased or rendered else self.plane_settings(current)
        )
        planes = {n: PlaneTerm(reference[n], current[n], rule, n, noise_share) for n, _ in schedule}
        coarsest = planes[schedule[0][0]]
        if start.poor or biased:
            coarsest(guess, 0)  # for the distance between the surfaces at the guess
            result, finest = start.aligned(
                lambda one: self._image_first(reference, current, one, planes),
                lambda found: found[0],
            )
            if result.status is not Status.FAILED:
                start = start._replace(guess=result.T_reference_camera)
        if not biased:
            result, finest = self._jointly(reference, current, start, planes)
            # a sudden motion, or contrast that moves in another way than the surfaces: mirrors
            # close by
            if start.poor:
                again = self._jointly(reference, current, start._replace(guess=guess), planes)
                result, finest = max((result, finest), again, key=lambda found: found[0].inliers)
                alone, _ = self.alone._align_from(reference, current, guess)
                if alone.status is Status.OK and alone.inliers > MORE_INLIERS * result.inliers:
                    return alone, coarsest.first_m
        if result.status is not Status.FAILED and finest.unrelated():
            return self.alone._align_from(reference, current, guess)
        return start.checked(finest.checked(result)), coarsest.first_m

    def _outweighs(
        self,
        alone: Result,
        reference: list[Level],
        current: list[Level],
        schedule: list[tuple[int, int]],
    ) -> bool:
        """Whether planes alone have more information than the images in every direction, on the
        levels of `schedule`.
        """
        passes, _ = photometric_passes(reference, current, self.photometric, schedule)
        image = passes[-1].linearise(alone.T_reference_camera, 0)
        return image.is_information and bool(np.linalg.eigvalsh(alone.information - image.A)[0] > 0)

    def _jointly(
        self,
        reference: list[Level],
        current: list[Level],
        start: Start,
        planes: dict[int, PlaneTerm],
    ) -> tuple[Result, PhotometricTerm]:
        """Both terms in all passes: for depth without bias, and against a model, whose planes are
        better than those of a noisy frame.
        """
        rough, rendered = self.rough(current), reference[-1].rendered
        settings = (
            replace(self.photometric, spread=CALIBRATED_SPREAD)
            if rough and not rendered
            else self.photometric
        )
        passes, finest = photometric_passes(reference, current, settings, start.schedule)
        levels = [n for n, _ in start.schedule]
        levels += levels[-1:] * (len(passes) - len(levels))
        error = _length if rough and rendered else None
        joint = [
            self._with_planes(p, planes[n], error) for n, p in zip(levels, passes, strict=True)
        ]
        prior_m = ROUGH_PRIOR_M if rough else self.settings.limits.prior_m
        limits = replace(self.settings.limits, min_eigenvalue=0.0, prior_m=prior_m)
        return solve(joint, start.guess, limits), finest

    def _image_first(
        self,
        reference: list[Level],
        current: list[Level],
        start: Start,
        planes: dict[int, PlaneTerm],
    ) -> tuple[Result, PhotometricTerm]:
        """As `Rgbd`, with the planes in the last pass: for biased depth, and for a guess after a
        poor prediction.
        """
        biased, n = self.biased(reference, current), start.schedule[-1][0]
        settings = replace(self.photometric, spread=Rgbd.PRESETS["best"].spread)
        depth = DepthTerm(reference[n], current[n])
        passes, finest = photometric_passes(reference, current, settings, start.schedule, depth)
        passes[-1] = self._with_planes(passes[-1], planes[n], _components if biased else None)
        prior_m = settings.limits.prior_m if start.poor else ROUGH_PRIOR_M
        limits = replace(settings.limits, prior_m=prior_m)
        return depth.checked(solve(passes, start.guess, limits)), finest

    def _with_planes(
        self, photometric: Pass, plane: PlaneTerm, error: Callable[[SE3], np.ndarray] | None = None
    ) -> Pass:
        """The pass with the equations of the planes, whose motion has a further error
        (System.with_error).
        """

        def joint(T: SE3, iteration: int) -> System:
            geometry, image = plane(T, iteration), photometric.linearise(T, iteration)
            if error:
                geometry = geometry.with_error(error(T))
            return geometry.plus(
                image, 1.0 if image.is_information else WEIGHT_RGBD**2, self.weight_b
            )

        centre = photometric.centre
        return Pass(joint, photometric.iterations, plane.pixels, self.settings.stop, centre=centre)


def _length(T: SE3) -> np.ndarray:
    """(6, 1): an error of the length of the motion T."""
    return ROUGH_ERROR * np.r_[T.translation, np.zeros(3)][:, None]


def _components(T: SE3) -> np.ndarray:
    """(6, 6): an error of each component of the motion T, relative to the norm of its translation
    or rotation.
    """
    twist = T.log()
    return ROUGH_ERROR * np.diag(
        np.repeat([np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])], 3)
    )
