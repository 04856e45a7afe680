"""Reprojection errors of matched corners in both images: A. Huang et al., ISRR 2011, section
3.5.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from ...compiled import compiled
from .. import kernels
from ..certainty import BLOCKS, GRID, jackknife_information
from ..normal_equations import NormalEquations
from .free_depth import LOOSE, inlier_weights, scale_ambiguity


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched corners: pixels uv (n, 2) and points_m (n, 3) in both frames, the pyramid level (n,)
    and a weight (n,) of their residuals.
    """

    uv0: np.ndarray
    points0_m: np.ndarray
    uv1: np.ndarray
    points1_m: np.ndarray
    level: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.level)

    def chosen(self, which: np.ndarray) -> "Matches":
        """The matches selected by a mask or by indices."""
        return Matches(**{name: values[which] for name, values in vars(self).items()})


class Seen(NamedTuple):
    """What the compiled loops read: the intrinsics, pixels and points in both frames, weights."""

    k: np.ndarray
    points0: np.ndarray
    uv0: np.ndarray
    points1: np.ndarray
    uv1: np.ndarray
    weight: np.ndarray


class ReprojectionTerm:
    """Equations in pixels: the reprojection errors of each frame's points in the other image.

    nu: degrees of freedom of Student's t, whose equations are information; 0: least squares. loose:
    the inverse depth of each match has an unknown factor, which is eliminated (as for the tiles of
    a photometric term). A corner in a mirror or behind glass then still constrains the motion.
    """

    def __init__(
        self, matches: Matches, camera: PinholeCamera, nu: float, loose: bool = False
    ) -> None:
        m = matches
        self.nu = nu
        self.loose = loose
        self.sigma = 1.0
        self.pixels = 4 * len(matches)
        self.seen = Seen(camera.intrinsics, m.points0_m, m.uv0, m.points1_m, m.uv1, m.weight)
        across, down = (m.uv0 * GRID / (camera.width, camera.height)).astype(np.int16).T
        self.blocks = np.repeat(down * GRID[0] + across, 4)
        self.sums = np.empty((BLOCKS, 34))

    def linearise(self, T: SE3, iteration: int) -> NormalEquations:
        arms, residual, J = reprojections(T.matrix, self.seen)
        if self.nu:
            self.sigma = max(kernels.student_scale(residual, self.nu, self.sigma, 10), 1e-3)
        rows = (residual, J, residual, J)
        kernels.block_sums(arms, rows, (self.sigma, self.nu), self.blocks, self.sums)
        equations = NormalEquations.of_sums(self.sums.sum(axis=0))
        if not self.nu:
            return equations
        return jackknife_information(equations, self.sums, self.nu)

    def solved(
        self, T: SE3, A: np.ndarray, b: np.ndarray, iterations: int, min_step: float
    ) -> tuple[SE3, np.ndarray]:
        """The optimal pose and the twist (6,) from T to it, without the uncertainty, in a compiled
        loop. A x = b are further equations (information) for this twist x.
        """
        student = (self.sigma, self.nu)
        stop = (iterations, min_step)
        found = least_squares(T.matrix, self.seen, self.loose, student, (A, b), stop)
        matrix, total_twist, self.sigma = found
        return SE3(matrix[:3, :3], matrix[:3, 3]), total_twist

    def inlier_weights(self, geometry: NormalEquations, T: SE3) -> np.ndarray:
        """Weights (n,), 0..1, of the residuals, at the solution T of the loose equations: small
        where depth is an outlier.
        """
        _, residual, J = reprojections(T.matrix, self.seen)
        factor, stiff = free_depth(T.translation, J, residual, (self.sigma / LOOSE) ** 2)
        ambiguity = scale_ambiguity(geometry, T.translation)
        kept = inlier_weights(factor, self.sigma**2 / np.maximum(stiff, 1e-12), ambiguity)
        return np.sqrt(kept + (1.0 - kept) * ambiguity)


@compiled()
def reprojections(T: np.ndarray, seen: Seen) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(arms (4 n, 3), residuals (4 n,), Jacobian (4 n, 6) by a twist), per match: u and v in the
    reference's image, u and v in the current one.

    T (4, 4) is T_reference_current; arms are the points in the reference's frame.
    """
    k = seen.k
    n = len(seen.weight)
    arms = np.empty((4 * n, 3))
    residual = np.empty(4 * n)
    J = np.empty((4 * n, 6))
    slope = np.empty(3)
    p = np.empty(3)
    for i in range(4 * n):
        m = i // 4
        back = i % 4 >= 2
        along_v = i % 2
        uv = seen.uv1 if back else seen.uv0
        other = seen.points0 if back else seen.points1
        for a in range(3):
            if back:
                arms[i, a] = other[m, a]
                p[a] = 0.0
                for b in range(3):
                    p[a] += T[b, a] * (other[m, b] - T[b, 3])
            else:
                arms[i, a] = T[a, 3]
                for b in range(3):
                    arms[i, a] += T[a, b] * other[m, b]
                p[a] = arms[i, a]
        f = k[along_v]
        w = seen.weight[m]
        residual[i] = w * (uv[m, along_v] - k[2 + along_v] - f * p[along_v] / p[2])
        slope[1 - along_v] = 0.0
        slope[along_v] = w * f / p[2]
        slope[2] = -w * f * p[along_v] / p[2] ** 2
        for a in range(3):
            J[i, a] = slope[a]
            if back:  # the motion of the other camera has the opposite sign
                J[i, a] = -(T[a, 0] * slope[0] + T[a, 1] * slope[1] + T[a, 2] * slope[2])
        x, y, z = arms[i]
        J[i, 3] = y * J[i, 2] - z * J[i, 1]
        J[i, 4] = z * J[i, 0] - x * J[i, 2]
        J[i, 5] = x * J[i, 1] - y * J[i, 0]
    return arms, residual, J


@compiled()
def least_squares(
    T: np.ndarray, seen: Seen, loose: bool, student: tuple, further: tuple, stop: tuple
) -> Any:
    """(T, the twist (6,) to it, scale of Student's t), by Gauss-Newton from T (4, 4).

    student: scale, degrees of freedom; further: A and b of further equations for that twist; stop:
    iterations, minimum step. Units are those of the residuals' mean square.
    """
    sigma, nu = student
    A, b = further
    iterations, min_step = stop
    gone = np.zeros(6)
    for _ in range(iterations):
        arms, residual, J = reprojections(T, seen)
        if loose:
            free_depth(T[:3, 3], J, residual, (sigma / LOOSE) ** 2)
        if nu > 0:
            sigma = max(kernels.student_scale(residual, nu, sigma, 10), 1e-3)
        s = kernels.sums(arms, residual, J, (sigma, nu))
        scale = s[28] / max(s[27], 1e-12)
        left = A.copy()
        right = b - A @ gone
        n = 0
        for a in range(6):
            for c in range(a, 6):
                left[a, c] += scale * s[n]
                left[c, a] = left[a, c]
                n += 1
            right[a] += scale * s[21 + a]
        step = np.linalg.solve(left, right)
        T = moved(T, step)
        gone = gone + step
        if np.abs(step).max() < min_step:
            break
    return T, gone, sigma


@compiled()
def moved(T: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """(4, 4): exp(twist) T (as SE3.exp, for rotations of less than 180 degrees)."""
    x, y, z = twist[3:]
    angle = np.sqrt(x * x + y * y + z * z)
    a = 1.0
    b = 0.5
    c = 1.0 / 6.0
    if angle > 1e-4:
        a = np.sin(angle) / angle
        b = 2.0 * (np.sin(angle / 2) / angle) ** 2
        c = (1.0 - a) / angle**2
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    squared = k @ k
    out = np.eye(4)
    out[:3, :3] += a * k + b * squared
    out[:3, 3] = twist[:3] + b * (k @ twist[:3]) + c * (squared @ twist[:3])
    return out @ T


@compiled()
def free_depth(
    t: np.ndarray, J: np.ndarray, residual: np.ndarray, prior: float
) -> tuple[np.ndarray, np.ndarray]:
    """(factor (n,) of each match's inverse depth, g^T g (n,)), where g is the derivative of the
    match's 4 residuals by that factor.

    Modifies J and residual so that their squares are the equations with the factor eliminated
    (Schur complement). t (3,) is the translation of T_reference_current.
    """
    n = len(residual) // 4
    g = np.empty(4)
    factor = np.empty(n)
    stiff = np.empty(n)
    for m in range(n):
        squares = 0.0
        product = 0.0
        for i in range(4):
            row = J[4 * m + i]
            g[i] = row[0] * t[0] + row[1] * t[1] + row[2] * t[2]
            squares += g[i] * g[i]
            product += g[i] * residual[4 * m + i]
        factor[m] = 1.0 + product / (squares + prior)
        stiff[m] = squares
        left = (1.0 - np.sqrt(prior / (squares + prior))) / max(squares, 1e-30)
        for i in range(4):
            residual[4 * m + i] -= left * product * g[i]
        for a in range(6):
            slope = 0.0
            for i in range(4):
                slope += g[i] * J[4 * m + i, a]
            for i in range(4):
                J[4 * m + i, a] -= left * slope * g[i]
    return factor, stiff
