"""Normal equations, how well they fix a motion, and the step that they ask for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry import so3
from ..geometry.se3 import SE3

#: Below this share the geometry does not fix the motion (furnished rooms: about 0.12; a bare wall: 0).
DEGENERATE = 0.05
ORIGIN = np.zeros(3)


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
    def of_sums(cls, s: np.ndarray) -> System:
        """From kernels.sums() (34,)."""
        A = np.zeros((6, 6))
        A[np.triu_indices(6)] = s[:21]
        A = A + np.triu(A, 1).T
        weight = max(s[28], 1e-30)
        centre = s[30:33] / weight
        length = np.sqrt(max(s[33] / weight - centre @ centre, 1e-12))
        return cls(A, s[21:27], float(s[27] / weight), float(s[29]), centre, float(length), float(weight))

    def trusted(self, doubt: float) -> System:
        """Every eigenvalue of the centred A less `doubt`, at least 0, and b in proportion: may-be noise goes."""
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        left = np.maximum(values - doubt, 0.0)
        share = left / np.where(left > 0, values, 1.0)
        back = _twist_at(self.centre_m, self.length_m).T  # G^-1
        b = back @ (vectors @ (share * (vectors.T @ (G @ self.b))))
        return replace(self, A=back @ (vectors * left) @ vectors.T @ back.T, b=b)

    def as_information(self, spread: float) -> System:
        """A and b as information (1 / variance) where `spread` pixels share one error; spread 0: unchanged."""
        if not spread:
            return self
        weight = 1.0 / (spread * max(self.error, 1e-12))
        return replace(self, A=self.A * weight, b=self.b * weight, informed=True)

    def scaled(self, factor: float, factor_b: float | None = None) -> System:
        """All weights times a factor; a second one for b alone only to repeat an old slip."""
        b = self.b * (factor if factor_b is None else factor_b)
        return replace(self, A=self.A * factor, b=b, error=self.error * factor)

    def without_scale(self, t_m: np.ndarray, doubt: float) -> System:
        """Where all that these equations (information) say of a translation t_m (3,) may be off by one factor.

        The factor, of standard deviation `doubt` about 1, is a further unknown, eliminated by its Schur complement.
        """
        along = np.r_[t_m, np.zeros(3)]
        slopes = self.A @ along
        stiff = along @ slopes + doubt**-2
        return replace(self, A=self.A - np.outer(slopes, slopes) / stiff, b=self.b - slopes * (along @ self.b) / stiff)

    def plus(self, other: System) -> System:
        """Joint equations; all else stays the first one's."""
        return replace(self, A=self.A + other.A, b=self.b + other.b)

    def centred(self) -> tuple[np.ndarray, np.ndarray]:
        """(A, G): A about the points' centre with rotations in lengths, and G with x = G^T x_centred."""
        G = np.eye(6)
        G[3:, :3] = -so3.hat(self.centre_m)
        G[3:] /= self.length_m
        return G @ self.A @ G.T, G

    def smallest_eigenvalue(self) -> float:
        """Of the translation block after eliminating rotation (Schur complement), as a share of the block's trace."""
        A, _ = self.centred()
        trace = np.trace(A[:3, :3])
        if not trace > 0:
            return 0.0
        schur = A[:3, :3] - A[:3, 3:] @ np.linalg.pinv(A[3:, 3:], hermitian=True) @ A[3:, :3]
        return float(max(np.linalg.eigvalsh(schur)[0], 0) / trace)

    def step(self, gone: np.ndarray, prior_m: float = 0.0, camera_m: np.ndarray = ORIGIN) -> tuple[np.ndarray, int]:
        """The twist (6,), and in how many directions the images say less than a prior of standard deviation `prior_m`.

        The prior (as in Kerl 2013) holds what is not fixed near the guess, from where the pose has `gone` (6,) so far;
        without one such directions are not updated (solution remapping, Zhang, Kaess, Singh 2016). It is about the way
        of the camera, which is at camera_m (3,): held about the points, a turn in front of a wall would become a
        motion along it. A direction of negative information, which products of noise can have, counts as none.
        """
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        floor = max(values[-1] * 1e-9, 1e-30)
        known = values > floor
        part = np.where(known, vectors.T @ (G @ self.b), 0.0)
        if not prior_m:
            return G.T @ (vectors @ (part / np.where(known, values, 1.0))), int((~known).sum())
        way = _twist_at(camera_m, self.length_m)
        there = way @ G.T @ vectors
        stiffness, axes = np.linalg.eigh(np.diag(np.where(known, values, 0.0)) + there.T @ there / prior_m**2)
        right = part - there.T @ (way @ gone) / prior_m**2
        return G.T @ (vectors @ (axes @ ((axes.T @ right) / stiffness))), int((values < prior_m**-2).sum())

    def turn(self) -> np.ndarray:
        """The twist (6,) of a rotation alone, about the reference camera; not in directions without information."""
        values, vectors = np.linalg.eigh(self.A[3:, 3:])
        floor = max(values[-1] * 1e-9, 1e-30)
        part = np.where(values > floor, vectors.T @ self.b[3:], 0.0)
        return np.r_[np.zeros(3), vectors @ (part / np.maximum(values, floor))]

    def weakest_sigma_m(self) -> float:
        """Standard deviation in the direction known least; rotations count by the points' length. NaN: not known."""
        if not self.informed:
            return float("nan")
        smallest = np.linalg.eigvalsh(self.centred()[0])[0]
        return float(max(smallest, 1e-12) ** -0.5)


def _twist_at(point_m: np.ndarray, length_m: float) -> np.ndarray:
    """(6, 6): a twist about the origin -> how the point moves, and the rotation times a length, all in metres."""
    result = np.eye(6)
    result[:3, 3:] = -so3.hat(point_m)
    result[3:] *= length_m
    return result


def moved(T: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """exp(twist) T, (4, 4)."""
    return SE3.exp(twist).matrix @ T


def inverted(T: np.ndarray) -> np.ndarray:
    """Of (4, 4) with the last row 0 0 0 1, exact also where a long chain is no longer quite a rotation.

    Not np.linalg.inv: OpenBLAS wakes its threads even for this, which takes milliseconds on a busy machine.
    """
    a, b, c = T[0, :3], T[1, :3], T[2, :3]
    bc = _cross(b, c)
    result = np.eye(4)
    result[:3, :3] = np.array([bc, _cross(c, a), _cross(a, b)]).T / (a @ bc)
    result[:3, 3] = -result[:3, :3] @ T[:3, 3]
    return result


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of (3,) and (3,). np.cross takes ten times as long, for it serves arrays of any shape."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
