"""Common to the built-in odometers: image pyramids, coarse-to-fine Gauss-Newton, and its normal
equations.

Each level has its own camera. Levels are 2x2 means, so K is defined at pixel centres on every
level.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from . import kernels
from .protocol import Frame, Result, Status, failure

#: A direction whose eigenvalue is below this share of the largest one is unobservable.
RANK_TOLERANCE = 1e-9
#: Below this eigenvalue the geometry is degenerate (furnished rooms: about 0.12; a bare wall: 0).
MIN_EIGENVALUE = 0.05
#: A motion farther than MAX_STEP_M from the prediction is a failure (Kintinuous); a standard
#: deviation above MAX_SIGMA_M is degenerate.
MAX_STEP_M, MAX_SIGMA_M = 0.3, 0.003
ORIGIN = np.zeros(3)
#: (6, 6): index of each element of a symmetric matrix in its upper triangle, stored row by row.
SYMMETRIC = np.array(
    [[min(a, b) * (11 - min(a, b)) // 2 + max(a, b) for b in range(6)] for a in range(6)]
)
#: An image with fewer rows or columns than this has no coarser level.
MIN_SIDE = 32


@dataclass(frozen=True, eq=False)
class Level:
    """grey and depth_z_m (h, w) float32; normals (h, w, 3) are computed at first use."""

    grey: np.ndarray
    depth_z_m: np.ndarray
    camera: PinholeCamera
    normal_step: int = 1
    rendered: bool = False  # a view of a model of many frames
    calibrated: bool = False  # Frame.calibrated

    @cached_property
    def _gradient_points(self) -> dict[tuple, tuple]:
        return {}

    def gradient_points(self, *rule: float) -> tuple:
        """kernels.gradient_points() with the arguments `rule`, computed once: many frames are
        aligned with one keyframe.
        """
        found = self._gradient_points
        if rule not in found:
            found[rule] = kernels.gradient_points(
                self.camera.intrinsics, self.grey, self.depth_z_m, *rule
            )
        return found[rule]

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals towards the camera, in its frame; 0 at depth edges and where a neighbour is
        missing.
        """
        return kernels.normals(self.depth_z_m, self.camera.intrinsics, self.normal_step)


class PyramidOdometer:
    """An odometer whose prepare() returns a list of Level, fine to coarse.

    settings have `iterations`, the maximum number on each level, fine to coarse (0: the level is
    not used), and `reference`. reads_normals, reads_grey: whether a rendered reference needs
    normals and grey values.
    """

    reads_normals = reads_grey = False

    def __init__(self, settings: Any) -> None:
        self.settings, self.iterations, self.reference = (
            settings,
            settings.iterations,
            settings.reference,
        )
        self.finest = next(n for n, count in enumerate(self.iterations) if count)

    def schedule(self, levels: list[Level]) -> list[tuple[int, int]]:
        """(level, iterations) from coarse to fine.

        If the images are too small for these levels, the coarsest one available.
        """
        levels_used = [
            (n, self.iterations[n]) for n in reversed(range(len(levels))) if self.iterations[n]
        ]
        return levels_used or [(len(levels) - 1, self.iterations[self.finest])]


def pyramid(
    frame: Frame,
    camera: PinholeCamera,
    levels: int,
    *,
    median_depth: bool = False,
    normal_step: int = 1,
) -> list[Level]:
    """Levels, fine to coarse.

    Depth is halved by kernels.halve_depth(), or by the 3x3 median of every second pixel.
    """
    grey, z = frame.grey, frame.depth_z_m
    result = [Level(grey, z, camera, normal_step, calibrated=frame.calibrated)]
    for _ in range(levels - 1):
        if min(camera.width, camera.height) < MIN_SIDE:
            break
        camera = camera.halved()
        grey = kernels.halve_grey(grey)
        z = kernels.halve_depth_median(z) if median_depth else kernels.halve_depth(z)
        result.append(replace(result[0], grey=grey, depth_z_m=z, camera=camera))
    return result


@dataclass(frozen=True, eq=False)
class System:
    """Normal equations A x = b for a twist (6,) in the reference frame. error: weighted mean
    square; centre_m, length_m: mean and
    RMS radius of the points; is_information: A is an information matrix (inverse covariance).
    """

    A: np.ndarray
    b: np.ndarray
    error: float
    count: float
    centre_m: np.ndarray
    length_m: float
    weight: float = 1.0
    is_information: bool = False

    @classmethod
    def of_sums(cls, s: np.ndarray) -> "System":
        """The equations from kernels.sums() (34,)."""
        A = s[SYMMETRIC]
        weight = max(s[28], 1e-30)
        centre = s[30:33] / weight
        length = np.sqrt(max(s[33] / weight - centre @ centre, 1e-12))
        return cls(
            A, s[21:27], float(s[27] / weight), float(s[29]), centre, float(length), float(weight)
        )

    def less_noise(self, noise: float) -> "System":
        """Subtract `noise` from every eigenvalue of the centred A (down to 0), and reduce b in
        proportion.
        """
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        remaining = np.maximum(values - noise, 0.0)
        share = remaining / np.where(remaining > 0, values, 1.0)
        G_inverse = _twist_at(self.centre_m, self.length_m).T  # G^-1
        b = G_inverse @ (vectors @ (share * (vectors.T @ (G @ self.b))))
        return replace(self, A=G_inverse @ (vectors * remaining) @ vectors.T @ G_inverse.T, b=b)

    def as_information(self, spread: float, least_error: float = 1e-12) -> "System":
        """A and b as information (1 / variance) if `spread` pixels share one error; spread 0:
        unchanged.
        """
        if not spread:
            return self
        weight = 1.0 / (spread * max(self.error, least_error))
        return replace(self, A=self.A * weight, b=self.b * weight, is_information=True)

    def with_error(self, columns: np.ndarray) -> "System":
        """These equations (information) if the twist that they measure has a further error: the
        columns (6, k) times k independent
        unknowns with a standard deviation of 1, which the Schur complement eliminates.
        """
        slopes = self.A @ columns
        share = np.linalg.solve(
            np.eye(columns.shape[1]) + columns.T @ slopes, np.c_[slopes.T, columns.T @ self.b]
        )
        return replace(self, A=self.A - slopes @ share[:, :6], b=self.b - slopes @ share[:, 6])

    def after_step(self, twist: np.ndarray) -> "System":
        """These equations after a step `twist` (6,)."""
        return replace(self, b=self.b - self.A @ twist)

    def plus(self, other: "System", factor: float, factor_b: float) -> "System":
        """Joint equations: A and b of the other are multiplied by `factor` and `factor_b` and
        added; all else is from this one.
        """
        return replace(self, A=self.A + other.A * factor, b=self.b + other.b * factor_b)

    def centred(self) -> tuple[np.ndarray, np.ndarray]:
        """(A, G): A about the centre of the points, with rotations as lengths in metres; G is such
        that x = G^T x_centred.
        """
        G = np.eye(6)
        G[3:, :3] = -so3.hat(self.centre_m)
        G[3:] /= self.length_m
        return G @ self.A @ G.T, G

    def length_of(self, twist: np.ndarray) -> float:
        """Norm of a twist (6,) in metres: the displacement of the points' centre, and the rotation
        times their length.
        """
        return float(np.linalg.norm(_twist_at(self.centre_m, self.length_m) @ twist))

    def smallest_eigenvalue(self) -> float:
        """The smallest eigenvalue of the translation block after eliminating rotation (Schur
        complement), as a share of the block's trace.
        """
        A, _ = self.centred()
        trace = np.trace(A[:3, :3])
        if not trace > 0:
            return 0.0
        schur = A[:3, :3] - A[:3, 3:] @ np.linalg.pinv(A[3:, 3:], hermitian=True) @ A[3:, :3]
        return float(max(np.linalg.eigvalsh(schur)[0], 0) / trace)

    def step(
        self, total_twist: np.ndarray, prior_m: float = 0.0, camera_m: np.ndarray = ORIGIN
    ) -> tuple[np.ndarray, int]:
        """The Gauss-Newton step (6,), and the number of directions in which the prior outweighs the
        images.

        The prior has the standard deviation `prior_m` (as in Kerl 2013). It keeps under-constrained
        directions near the prediction; total_twist (6,) is the accumulated motion from it. Without
        a prior such directions are not updated (solution remapping, Zhang, Kaess, Singh 2016). The
        prior is on the motion of the camera, whose centre is at camera_m (3,): a prior on the
        motion of the points would convert a rotation in front of a wall into a translation along
        it. Products of noise can give a direction negative information, which counts as none.
        """
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        observable = values > max(values[-1] * RANK_TOLERANCE, 1e-30)
        projected = np.where(observable, vectors.T @ (G @ self.b), 0.0)
        if not prior_m:
            return G.T @ (vectors @ (projected / np.where(observable, values, 1.0))), int(
                (~observable).sum()
            )
        camera_twist = _twist_at(camera_m, self.length_m)
        camera_axes = camera_twist @ G.T @ vectors
        stiffness, axes = np.linalg.eigh(
            np.diag(np.where(observable, values, 0.0)) + camera_axes.T @ camera_axes / prior_m**2
        )
        right = projected - camera_axes.T @ (camera_twist @ total_twist) / prior_m**2
        return G.T @ (vectors @ (axes @ ((axes.T @ right) / stiffness))), int(
            (values < prior_m**-2).sum()
        )

    def rotation_step(self) -> np.ndarray:
        """The Gauss-Newton step (6,) for a pure rotation about the reference camera; 0 in
        directions without information.
        """
        values, vectors = np.linalg.eigh(self.A[3:, 3:])
        floor = max(values[-1] * RANK_TOLERANCE, 1e-30)
        projected = np.where(values > floor, vectors.T @ self.b[3:], 0.0)
        return np.concatenate([np.zeros(3), vectors @ (projected / np.maximum(values, floor))])

    def largest_sigma_m(self) -> float:
        """Standard deviation in the least certain direction; rotations are multiplied by the
        points' length. NaN without a noise model.
        """
        if not self.is_information:
            return float("nan")
        smallest = np.linalg.eigvalsh(self.centred()[0])[0]
        return float(max(smallest, 1e-12) ** -0.5)


def small_twist(T_from: SE3, T_to: SE3) -> np.ndarray:
    """(6,): the twist, to first order, with T_to = exp(twist) T_from."""
    rotation = T_to.rotation @ T_from.rotation.T
    about = [
        rotation[2, 1] - rotation[1, 2],
        rotation[0, 2] - rotation[2, 0],
        rotation[1, 0] - rotation[0, 1],
    ]
    return np.concatenate([T_to.translation - rotation @ T_from.translation, np.array(about) / 2])


def _twist_at(point_m: np.ndarray, length_m: float) -> np.ndarray:
    """(6, 6) matrix that maps a twist about the origin to the displacement of the point and the
    rotation times a length, in metres.
    """
    result = np.eye(6)
    result[:3, 3:] = -so3.hat(point_m)
    result[3:] *= length_m
    return result


@dataclass(frozen=True)
class Stop:
    """Stopping criteria of a level. Twists are in metres and radians; min_decrease has the unit of
    System.error.

    undo: a step that increased the error is undone and ends the level (Kerl 2013).
    """

    min_step: float = 0.0
    min_decrease: float = -np.inf
    undo: bool = False


@dataclass(frozen=True)
class Limits:
    """A smaller share of inliers is a failure; a smaller eigenvalue (share, as smallest_eigenvalue)
    is degenerate.

    prior_m: standard deviation of the motion about the constant-velocity prediction; 0: no prior.
    """

    min_inliers: float = 0.02
    min_eigenvalue: float = 0.0
    prior_m: float = 0.0


#: (T_reference_current, iteration) -> equations; their count is the number of pixels used
Linearise = Callable[[SE3, int], System]


class Pass(NamedTuple):
    """At most `iterations` on one level of `pixels`. rotation_only: the translation is fixed;
    centre: the prior is about the pose at
    which this pass begins, not about the guess.
    """

    linearise: Linearise
    iterations: int
    pixels: int
    stop: Stop
    rotation_only: bool = False
    centre: bool = False


def solve(passes: list[Pass], guess: SE3, limits: Limits) -> Result:
    """Run all passes, coarse to fine, from `guess` (T_reference_current).

    Passes without overlap are skipped; without overlap in the last one the alignment fails. The
    inliers of the result are those of the last pass.
    """
    T, iterations_used, under_constrained, system, pixels, converged, total_twist = (
        guess,
        0,
        0,
        None,
        1,
        False,
        np.zeros(6),
    )
    for n, (linearise, iterations, pixels, stop, rotation_only, centre) in enumerate(passes, 1):
        total_twist = total_twist * (not centre)
        best, before = np.inf, T
        for i in range(iterations):
            system = linearise(T, i)
            if system.count < max(6, limits.min_inliers * pixels):
                if i == 0 and n < len(
                    passes
                ):  # holes can leave a coarse level empty: continue on a finer one
                    break
                return failure(f"overlap: {system.count:.0f} of {pixels} pixels")
            if stop.undo and system.error > best:
                T, converged = before, True
                break
            decrease, best, before = best - system.error, system.error, T
            if rotation_only:
                twist = system.rotation_step()
            else:
                twist, under_constrained = system.step(total_twist, limits.prior_m, T.translation)
            iterations_used += 1
            T, total_twist, size = SE3.exp(twist) @ T, total_twist + twist, np.abs(twist).max()
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
        iterations_used,
        residual=float(np.sqrt(max(system.error, 0))),
        inliers=system.count / pixels,
        information=system.A,
        smallest_eigenvalue=smallest,
        largest_sigma_m=sigma_m,
        under_constrained=under_constrained,
        reason="" if converged else "maximum number of iterations reached",
    )
