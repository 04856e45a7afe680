"""What the built-in odometers share: pyramids of images, Gauss-Newton from coarse to fine on them, and its normal equations.

Each level has its own camera (2x2 means, so that K keeps to pixel centres).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..geometry import so3
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from . import kernels
from .protocol import Frame, Result, Status, failure

#: A direction counts as without information below this share of the largest eigenvalue.
RANK_TOLERANCE = 1e-9
#: Below this eigenvalue the geometry does not fix the motion (furnished rooms: about 0.12; a bare wall: 0).
MIN_EIGENVALUE = 0.05
#: A motion of more from the prediction is a failure (Kintinuous); a larger standard deviation is degenerate.
MAX_STEP_M, MAX_SIGMA_M = 0.3, 0.003
ORIGIN = np.zeros(3)
#: (6, 6): where a symmetric matrix's elements stand in its upper triangle, row by row.
SYMMETRIC = np.array([[min(a, b) * (11 - min(a, b)) // 2 + max(a, b) for b in range(6)] for a in range(6)])
#: No level is made of an image with fewer rows or columns than this.
MIN_SIDE = 32


@dataclass(frozen=True, eq=False)
class Level:
    """grey and depth_z_m (h, w) float32; normals (h, w, 3) are made when asked for."""

    grey: np.ndarray
    depth_z_m: np.ndarray
    camera: PinholeCamera
    normal_step: int = 1

    @cached_property
    def _gradient_points(self) -> dict[tuple, tuple]:
        return {}

    def gradient_points(self, *rule: float) -> tuple:
        """kernels.gradient_points() by a rule, made once: a keyframe serves for many frames."""
        found = self._gradient_points
        if rule not in found:
            found[rule] = kernels.gradient_points(self.camera.intrinsics, self.grey, self.depth_z_m, *rule)
        return found[rule]

    @cached_property
    def normals(self) -> np.ndarray:
        """Towards the camera, in its frame; 0 at depth edges and where a neighbour is missing."""
        return kernels.normals(self.depth_z_m, self.camera.intrinsics, self.normal_step)


class PyramidOdometer:
    """An odometer whose prepare() makes a list of Level, fine to coarse, and what it reads of them.

    settings have `iterations`, at most so many on each level, fine to coarse (0: the level is not read), and `reference`.
    reads_normals, reads_grey: what a rendered reference needs to hold.
    """

    reads_normals = reads_grey = False

    def __init__(self, settings: Any) -> None:
        self.settings, self.iterations, self.reference = settings, settings.iterations, settings.reference
        self.finest = next(n for n, count in enumerate(self.iterations) if count)

    def schedule(self, levels: list[Level]) -> list[tuple[int, int]]:
        """(level, iterations) from coarse to fine; of images too small for any, the coarsest there is."""
        used = [(n, self.iterations[n]) for n in reversed(range(len(levels))) if self.iterations[n]]
        return used or [(len(levels) - 1, self.iterations[self.finest])]


def pyramid(
    frame: Frame, camera: PinholeCamera, levels: int, *, median_depth: bool = False, normal_step: int = 1
) -> list[Level]:
    """Fine to coarse. Depth is halved by means of what belongs together, or by a 3x3 median and every second pixel."""
    grey, z = frame.grey, frame.depth_z_m
    result = [Level(grey, z, camera, normal_step)]
    for _ in range(levels - 1):
        if min(camera.width, camera.height) < MIN_SIDE:
            break
        camera = camera.halved()
        grey = kernels.halve_grey(grey)
        z = kernels.halve_depth_median(z) if median_depth else kernels.halve_depth(z)
        result.append(Level(grey, z, camera, normal_step))
    return result


@dataclass(frozen=True, eq=False)
class System:
    """A x = b for a twist (6,) in the reference frame; error: weighted mean square; the points' centre and length."""

    A: np.ndarray
    b: np.ndarray
    error: float
    count: float
    centre_m: np.ndarray
    length_m: float
    weight: float = 1.0
    informed: bool = False

    @classmethod
    def of_sums(cls, s: np.ndarray) -> "System":
        """From kernels.sums() (34,)."""
        A = s[SYMMETRIC]
        weight = max(s[28], 1e-30)
        centre = s[30:33] / weight
        length = np.sqrt(max(s[33] / weight - centre @ centre, 1e-12))
        return cls(A, s[21:27], float(s[27] / weight), float(s[29]), centre, float(length), float(weight))

    def less_noise(self, noise: float) -> "System":
        """Every eigenvalue of the centred A less `noise`, at least 0, and b in proportion."""
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        left = np.maximum(values - noise, 0.0)
        share = left / np.where(left > 0, values, 1.0)
        back = _twist_at(self.centre_m, self.length_m).T  # G^-1
        b = back @ (vectors @ (share * (vectors.T @ (G @ self.b))))
        return replace(self, A=back @ (vectors * left) @ vectors.T @ back.T, b=b)

    def as_information(self, spread: float, least_error: float = 1e-12) -> "System":
        """A and b as information (1 / variance) where `spread` pixels share one error; spread 0: unchanged."""
        if not spread:
            return self
        weight = 1.0 / (spread * max(self.error, least_error))
        return replace(self, A=self.A * weight, b=self.b * weight, informed=True)

    def without_scale(self, t_m: np.ndarray, sigma: float) -> "System":
        """Where everything that these equations (information) say of a translation t_m (3,) may be off by one factor.

        The factor, of standard deviation `sigma` about 1, is a further unknown, eliminated by its Schur complement.
        """
        along = np.r_[t_m, np.zeros(3)]
        slopes = self.A @ along
        stiff = along @ slopes + sigma**-2
        return replace(self, A=self.A - np.outer(slopes, slopes) / stiff, b=self.b - slopes * (along @ self.b) / stiff)

    def moved(self, twist: np.ndarray) -> "System":
        """As they are after a step `twist` (6,)."""
        return replace(self, b=self.b - self.A @ twist)

    def plus(self, other: "System", factor: float, factor_b: float) -> "System":
        """Joint equations, with the other's A and b times a factor each; all else stays the first one's."""
        return replace(self, A=self.A + other.A * factor, b=self.b + other.b * factor_b)

    def centred(self) -> tuple[np.ndarray, np.ndarray]:
        """(A, G): A about the points' centre with rotations in lengths, and G with x = G^T x_centred."""
        G = np.eye(6)
        G[3:, :3] = -so3.hat(self.centre_m)
        G[3:] /= self.length_m
        return G @ self.A @ G.T, G

    def length_of(self, twist: np.ndarray) -> float:
        """How far a twist (6,) takes the points, in metres: their centre, and its rotation times their length."""
        return float(np.linalg.norm(_twist_at(self.centre_m, self.length_m) @ twist))

    def smallest_eigenvalue(self) -> float:
        """Of the translation block after eliminating rotation (Schur complement), as a share of the block's trace."""
        A, _ = self.centred()
        trace = np.trace(A[:3, :3])
        if not trace > 0:
            return 0.0
        schur = A[:3, :3] - A[:3, 3:] @ np.linalg.pinv(A[3:, 3:], hermitian=True) @ A[3:, :3]
        return float(max(np.linalg.eigvalsh(schur)[0], 0) / trace)

    def step(self, gone: np.ndarray, prior_m: float = 0.0, camera_m: np.ndarray = ORIGIN) -> tuple[np.ndarray, int]:
        """The twist (6,), and in how many directions the images weigh less than a prior of standard deviation `prior_m`.

        The prior (as in Kerl 2013) keeps what is under-constrained near the prediction, from where the pose has `gone` (6,)
        so far; without one such directions are not updated (solution remapping, Zhang, Kaess, Singh 2016). It is a prior on
        the camera's motion, whose centre is at camera_m (3,): as a prior on the points' motion it would make a rotation in
        front of a wall a translation along it. A direction of negative information, which products of noise can have, counts
        as none.
        """
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        known = values > max(values[-1] * RANK_TOLERANCE, 1e-30)
        part = np.where(known, vectors.T @ (G @ self.b), 0.0)
        if not prior_m:
            return G.T @ (vectors @ (part / np.where(known, values, 1.0))), int((~known).sum())
        way = _twist_at(camera_m, self.length_m)
        there = way @ G.T @ vectors
        stiffness, axes = np.linalg.eigh(np.diag(np.where(known, values, 0.0)) + there.T @ there / prior_m**2)
        right = part - there.T @ (way @ gone) / prior_m**2
        return G.T @ (vectors @ (axes @ ((axes.T @ right) / stiffness))), int((values < prior_m**-2).sum())

    def rotation_step(self) -> np.ndarray:
        """The twist (6,) of a rotation alone, about the reference camera; 0 in directions without information."""
        values, vectors = np.linalg.eigh(self.A[3:, 3:])
        floor = max(values[-1] * RANK_TOLERANCE, 1e-30)
        part = np.where(values > floor, vectors.T @ self.b[3:], 0.0)
        return np.concatenate([np.zeros(3), vectors @ (part / np.maximum(values, floor))])

    def largest_sigma_m(self) -> float:
        """Standard deviation in the least certain direction; rotations count by the points' length. NaN: no noise model."""
        if not self.informed:
            return float("nan")
        smallest = np.linalg.eigvalsh(self.centred()[0])[0]
        return float(max(smallest, 1e-12) ** -0.5)


def small_twist(T_from: SE3, T_to: SE3) -> np.ndarray:
    """(6,): the small twist, to first order, that takes one pose to the other from the left."""
    turn = T_to.rotation @ T_from.rotation.T
    about = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return np.concatenate([T_to.translation - turn @ T_from.translation, np.array(about) / 2])


def _twist_at(point_m: np.ndarray, length_m: float) -> np.ndarray:
    """(6, 6): a twist about the origin -> how the point moves, and the rotation times a length, all in metres."""
    result = np.eye(6)
    result[:3, 3:] = -so3.hat(point_m)
    result[3:] *= length_m
    return result


@dataclass(frozen=True)
class Stop:
    """When a level ends. Twists in metres and radians; min_decrease in the unit of System.error.

    undo: a step that raised the error is taken back, and ends the level (Kerl 2013).
    """

    min_step: float = 0.0
    min_decrease: float = -np.inf
    undo: bool = False


@dataclass(frozen=True)
class Limits:
    """Fewer inliers (share) count as a failure, a smaller eigenvalue (share, as smallest_eigenvalue) as degenerate.

    prior_m: standard deviation of the motion about the constant-velocity prediction; 0: no prior.
    """

    min_inliers: float = 0.02
    min_eigenvalue: float = 0.0
    prior_m: float = 0.0


#: (T_reference_current, iteration) -> equations; their count is of pixels used
Linearise = Callable[[SE3, int], System]


class Pass(NamedTuple):
    """At most `iterations` on one level of `pixels`; rotation_only: the translation stays; centre: the prior is about where
    this pass begins, not about the guess.
    """

    linearise: Linearise
    iterations: int
    pixels: int
    stop: Stop
    rotation_only: bool = False
    centre: bool = False


def solve(passes: list[Pass], guess: SE3, limits: Limits) -> Result:
    """All passes, coarse to fine, from `guess` (T_reference_current); those without overlap are left out, but for the last. The result's
    inliers are the last pass's.
    """
    T, used, free, system, pixels, converged, gone = guess, 0, 0, None, 1, False, np.zeros(6)
    for n, (linearise, iterations, pixels, stop, rotation_only, centre) in enumerate(passes, 1):
        gone = gone * (not centre)
        best, before = np.inf, T
        for i in range(iterations):
            system = linearise(T, i)
            if system.count < max(6, limits.min_inliers * pixels):
                if i == 0 and n < len(passes):  # holes may leave a coarse level empty: a finer one decides
                    break
                return failure(f"overlap: {system.count:.0f} of {pixels} pixels")
            if stop.undo and system.error > best:
                T, converged = before, True
                break
            decrease, best, before = best - system.error, system.error, T
            if rotation_only:
                twist = system.rotation_step()
            else:
                twist, free = system.step(gone, limits.prior_m, T.translation)
            used += 1
            T, gone, size = SE3.exp(twist) @ T, gone + twist, np.abs(twist).max()
            converged = bool(size < max(stop.min_step, 1e-4))
            if decrease < stop.min_decrease or size < stop.min_step:
                converged = True
                break
    if system is None or not np.isfinite(T.translation).all() or not np.isfinite(T.rotation).all():
        return failure("equations: no finite solution")
    step_m = float(np.linalg.norm(T.translation - guess.translation))
    if step_m > MAX_STEP_M:
        return failure(f"step: {step_m:.3f} m, more than {MAX_STEP_M} m")
    smallest, sigma_m = system.smallest_eigenvalue(), system.largest_sigma_m()
    degenerate = smallest < limits.min_eigenvalue or sigma_m > MAX_SIGMA_M
    return Result(
        T,
        Status.DEGENERATE if degenerate else Status.OK,
        converged,
        used,
        residual=float(np.sqrt(max(system.error, 0))),
        inliers=system.count / pixels,
        information=system.A,
        smallest_eigenvalue=smallest,
        largest_sigma_m=sigma_m,
        under_constrained=free,
        reason="" if converged else "iterations used up",
    )
