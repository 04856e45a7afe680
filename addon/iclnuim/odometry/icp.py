"""ICP: point-to-plane with projective association, R. Newcombe et al., "KinectFusion", ISMAR 2011, section 3.5."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from . import kernels
from .protocol import Frame, Result
from .pyramid import Level, PyramidOdometer, pyramid
from .solver import MIN_EIGENVALUE, Limits, Pass, Stop, System, solve

#: Disagreement of normals (1 - cosine) that is not yet noise: steps of 0.2 mm make less.
MIN_NOISE = 1e-4


@dataclass(frozen=True)
class IcpSettings:
    """Of the term and of the odometer. Tuples run from fine to coarse. The defaults are Kintinuous' (KinectFusion).

    A frame whose normals three pixels apart differ by more than max_roughness (1 - cosine, in the median; `released` noise
    has 0.006, clean frames below 1e-4) is a sensor's: its normals are taken over rough_step pixels, all within
    rough_angle_deg match, none is outweighed, and rough_noise of what normals disagree about counts as noise.
    """

    iterations: tuple[int, ...] = (10, 5, 4)  # at most, on each level; 0: not used
    strides: tuple[int, ...] = (1, 1, 1)  # every so many rows and columns
    bilateral: bool = True  # depth filter, 13 x 13, 4.5 px, 30 mm
    max_distance_m: float = 0.10
    max_angle_deg: float = 20.0
    normal_step: int = 1  # pixels to either side
    nu: float = 0.0  # degrees of freedom of Student's t; 0: least squares
    two_normals: bool = False  # products of the residuals along both images' normals, not squares along one
    spread: float = 0.0  # so many pixels share one error (fitted on kt2); 0: no noise model
    rough_step: int = 0  # pixels; 0: no frame is taken for a sensor's
    rough_angle_deg: float = 30.0
    rough_noise: float = 0.25
    max_roughness: float = 1e-3
    stop: Stop = Stop()
    limits: Limits = Limits(min_eigenvalue=MIN_EIGENVALUE)
    reference: str = "frame"


PRESETS = {
    "paper": IcpSettings(),
    "best": IcpSettings(
        iterations=(0, 4, 3),
        strides=(1, 2, 1),
        bilateral=False,
        two_normals=True,
        max_angle_deg=12.0,
        nu=10.0,
        spread=30.0,
        rough_step=3,
        stop=Stop(min_step=5e-6),
        limits=Limits(prior_m=0.003),
    ),
}


class PlaneTerm:
    """Point-to-plane equations in metres on level n; noise_share of what two normals disagree about counts as noise."""

    def __init__(
        self, reference: Level, current: Level, settings: IcpSettings, n: int, noise_share: float = 1.0
    ) -> None:
        self.reference, self.settings, self.noise_share = reference, settings, noise_share
        z, stride = current.depth_z_m, settings.strides[n]
        size = -(-z.shape[0] // stride) * -(-z.shape[1] // stride)
        points, directions = np.empty((size, 3), np.float32), np.empty((size, 3), np.float32)
        count = kernels.flat_points(current.k, z, current.normals, stride, points, directions)
        self.pixels, self.points, self.directions = size, points[:count], directions[:count]
        self.residual, self.J = np.empty(count, np.float32), np.empty((count, 6), np.float32)
        self.residual1, self.J1 = np.empty(count, np.float32), np.empty((count, 6), np.float32)
        self.sigma, self.disagreement = 0.005, 0.0

    def __call__(self, T: SE3, iteration: int) -> System:
        level, s = self.reference, self.settings
        gate = (s.max_distance_m, math.cos(math.radians(s.max_angle_deg)))
        found = (self.residual, self.J, self.residual1, self.J1)
        kernels.plane_residuals(
            T.matrix, level.k, self.points, self.directions, level.depth_z_m, level.normals, *gate, *found
        )
        if s.nu > 0:
            self.sigma = max(kernels.student_scale(self.residual, s.nu, self.sigma, 10), 1e-5)
        J1, residual1 = (self.J1, self.residual1) if s.two_normals else (self.J, self.residual)
        system = System.of_sums(kernels.sums(self.points, self.J, self.residual, J1, residual1, self.sigma, s.nu))
        if s.two_normals:
            if iteration == 0:
                self.disagreement = self._disagreement()
            # What two normals of one place disagree about is noise; a sensor's steps may let them agree on as much again.
            system = system.less_noise(self.noise_share * self.disagreement * system.weight)
        return system.as_information(s.spread)

    def _disagreement(self) -> float:
        """1 - n0 . n1 in the mean, from the median of some 2000 pairs: true normals differ by more at edges."""
        step = len(self.residual) // 2000 + 1
        some = np.isfinite(self.residual[::step])
        cosines = np.sum(self.J[::step, :3][some] * self.J1[::step, :3][some], axis=1)
        mean = (1.0 - float(np.median(cosines))) / math.log(2.0) if len(cosines) else 0.0
        return max(mean - MIN_NOISE, 0.0)


class Icp(PyramidOdometer):
    name, reads_normals = "icp", True

    def __init__(self, settings: IcpSettings) -> None:
        super().__init__(settings.iterations, settings.reference)
        self.icp = settings

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        s = self.icp
        if s.bilateral:
            # what is missing lies too far off to weigh, and stays missing
            smooth = cv2.bilateralFilter(frame.depth_z_m, 13, 0.03, 4.5)
            frame = replace(frame, depth_z_m=np.where(frame.depth_z_m > 0, smooth, np.float32(0)))
        levels = pyramid(frame, camera, len(s.iterations), normal_step=s.normal_step)
        if s.rough_step and roughness(levels[min(1, len(levels) - 1)]) > s.max_roughness:
            levels = [replace(level, normal_step=s.rough_step) for level in levels]
        return levels

    def rough(self, levels: list[Level]) -> bool:
        """Whether prepare() took the frame for a sensor's."""
        return self.icp.rough_step > 0 and levels[0].normal_step == self.icp.rough_step

    def align(self, reference: list[Level], current: list[Level], guess: SE3) -> Result:
        s, passes, noise_share = self.icp, [], 1.0
        if self.rough(current):
            s, noise_share = replace(s, max_angle_deg=s.rough_angle_deg, nu=0.0), s.rough_noise
        for n, iterations in self.schedule(reference):
            term = PlaneTerm(reference[n], current[n], s, n, noise_share)
            passes.append(Pass(term, iterations, term.pixels, s.stop))
        return solve(passes, guess, s.limits)


def roughness(level: Level) -> float:
    """1 - cosine of normals three pixels apart, which share no depth, in the median."""
    normals = level.normals[::4]
    one, other = normals[:, :-3:4], normals[:, 3::4]
    both = (one[..., 2] != 0) & (other[..., 2] != 0)
    return 1.0 - float(np.median(np.sum(one[both] * other[both], axis=-1))) if both.any() else 0.0
