"""The normal equations of a Gauss-Newton step, their step with and without a prior, and how certain
it is.
"""

from dataclasses import dataclass, replace

import numpy as np
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3

#: A direction whose eigenvalue is below this share of the largest one is unobservable: what
#: rounding leaves of zero.
RANK_TOLERANCE = 1e-9
ORIGIN = np.zeros(3)


def _symmetric() -> np.ndarray:
    """(6, 6): index of each element of a symmetric matrix in its upper triangle, row by row."""
    result = np.zeros((6, 6), int)
    result[np.triu_indices(6)] = np.arange(21)
    return np.maximum(result, result.T)


SYMMETRIC = _symmetric()


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations A x = b for a twist (6,) in the reference frame.

    error: weighted mean square of the residuals; centre_m, length_m: mean and RMS radius of the
    points; is_information: A is an information matrix (inverse covariance).
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
    def of_sums(cls, s: np.ndarray) -> "NormalEquations":
        """The equations from kernels.sums() (34,)."""
        A = s[SYMMETRIC]
        weight = max(s[28], 1e-30)
        centre = s[30:33] / weight
        length = np.sqrt(max(s[33] / weight - centre @ centre, 1e-12))
        return cls(
            A=A,
            b=s[21:27],
            error=float(s[27] / weight),
            count=float(s[29]),
            centre_m=centre,
            length_m=float(length),
            weight=float(weight),
        )

    @classmethod
    def of_information(cls, A: np.ndarray) -> "NormalEquations":
        """Equations that hold at the current pose, with information A (6, 6) about the origin."""
        return cls(A, np.zeros(6), error=0.0, count=0.0, centre_m=ORIGIN, length_m=1.0)

    def less_noise(self, noise: float) -> "NormalEquations":
        """Subtract `noise` from every eigenvalue of the centred A (down to 0), and reduce b in
        proportion.
        """
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        remaining = np.maximum(values - noise, 0.0)
        share = remaining / np.where(remaining > 0, values, 1.0)
        G_inverse = _twist_at(self.centre_m, self.length_m).T  # G^-1
        b = G_inverse @ (vectors @ (share * (vectors.T @ (G @ self.b))))
        A = G_inverse @ (vectors * remaining) @ vectors.T @ G_inverse.T
        return replace(self, A=A, b=b)

    def as_information(self, spread: float, least_error: float = 1e-12) -> "NormalEquations":
        """A and b as information (1 / variance) if `spread` pixels share one error; spread 0:
        unchanged.
        """
        if not spread:
            return self
        weight = 1.0 / (spread * max(self.error, least_error))
        return replace(self, A=self.A * weight, b=self.b * weight, is_information=True)

    def with_error(self, columns: np.ndarray) -> "NormalEquations":
        """These equations (information) if the twist that they measure has a further error: the
        columns (6, k) times k independent unknowns with a standard deviation of 1, which the Schur
        complement eliminates.
        """
        slopes = self.A @ columns
        unknowns = np.eye(columns.shape[1]) + columns.T @ slopes
        share = np.linalg.solve(unknowns, np.c_[slopes.T, columns.T @ self.b])
        return replace(self, A=self.A - slopes @ share[:, :6], b=self.b - slopes @ share[:, 6])

    def after_step(self, twist: np.ndarray) -> "NormalEquations":
        """These equations after a step `twist` (6,)."""
        return replace(self, b=self.b - self.A @ twist)

    def plus(self, other: "NormalEquations", factor: float, factor_b: float) -> "NormalEquations":
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

        The prior has the standard deviation `prior_m` (as in Kerl 2013). It keeps
        under-constrained directions near the prediction; total_twist (6,) is the accumulated motion
        from it. Without a prior such directions are not updated (solution remapping, Zhang, Kaess,
        Singh 2016). The prior is on the motion of the camera, whose centre is at camera_m (3,): a
        prior on the motion of the points would convert a rotation in front of a wall into a
        translation along it. Products of noise can give a direction negative information, which
        counts as none.
        """
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        observable = values > max(values[-1] * RANK_TOLERANCE, 1e-30)
        projected = np.where(observable, vectors.T @ (G @ self.b), 0.0)
        if not prior_m:
            step = projected / np.where(observable, values, 1.0)
            return G.T @ (vectors @ step), int((~observable).sum())
        camera_twist = _twist_at(camera_m, self.length_m)
        camera_axes = camera_twist @ G.T @ vectors
        known = np.diag(np.where(observable, values, 0.0))
        stiffness, axes = np.linalg.eigh(known + camera_axes.T @ camera_axes / prior_m**2)
        right = projected - camera_axes.T @ (camera_twist @ total_twist) / prior_m**2
        step = axes @ ((axes.T @ right) / stiffness)
        return G.T @ (vectors @ step), int((values < prior_m**-2).sum())

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
