"""Normal equations, how well they fix a motion, and the step that they ask for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from iclnuim.geometry.se3 import SE3

#: Below this share the geometry does not fix the motion (furnished rooms: about 0.12; a bare wall: 0).
DEGENERATE = 0.05


@dataclass(frozen=True, eq=False)
class System:
    """A x = b for a twist x (6,) in the reference frame; error: weighted mean square; centre and length of the points."""

    A: np.ndarray
    b: np.ndarray
    error: float
    count: float
    centre_m: np.ndarray
    length_m: float

    @classmethod
    def of_sums(cls, s: np.ndarray) -> System:
        """From kernels.sums() (34,)."""
        A = np.zeros((6, 6))
        A[np.triu_indices(6)] = s[:21]
        A = A + np.triu(A, 1).T
        weight = max(s[28], 1e-30)
        centre = s[30:33] / weight
        length = np.sqrt(max(s[33] / weight - centre @ centre, 1e-12))
        return cls(A, s[21:27], float(s[27] / weight), float(s[29]), centre, float(length))

    def scaled(self, factor: float, factor_b: float | None = None) -> System:
        """All weights times a factor; a second one for b alone only to repeat an old slip."""
        b = self.b * (factor if factor_b is None else factor_b)
        return System(self.A * factor, b, self.error * factor, self.count, self.centre_m, self.length_m)

    def plus(self, other: System) -> System:
        """Joint equations; centre, length and count stay the first one's."""
        return System(
            self.A + other.A, self.b + other.b, self.error + other.error, self.count, self.centre_m, self.length_m
        )

    def centred(self) -> tuple[np.ndarray, np.ndarray]:
        """(A, G): A about the points' centre with rotations in lengths, and G with x = G^T x_centred."""
        x, y, z = self.centre_m
        G = np.eye(6)
        G[3:, :3] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
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

    def step(self, hold_below: float = 0.0) -> tuple[np.ndarray, int]:
        """The twist (6,), and how many directions were held (solution remapping, Zhang, Kaess, Singh 2016)."""
        A, G = self.centred()
        values, vectors = np.linalg.eigh(A)
        floor = max(values[-1] * 1e-9, 1e-30)
        free = values > floor
        held = 0
        if hold_below > 0 and self.smallest_eigenvalue() < hold_below:
            weak = values < hold_below * np.trace(A[:3, :3])
            held, free = int(weak.sum()), free & ~weak
        part = vectors.T @ (G @ self.b)
        x = vectors @ np.where(free, part / np.where(free, values, 1.0), 0.0)
        return G.T @ x, held


def moved(T: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """exp(twist) T, (4, 4)."""
    return SE3.exp(twist).matrix @ T


def inverted(T: np.ndarray) -> np.ndarray:
    """Of (4, 4) with the last row 0 0 0 1, exact also where a long chain is no longer quite a rotation.

    Not np.linalg.inv: OpenBLAS wakes its threads even for this, which takes milliseconds on a busy machine.
    """
    a, b, c = T[0, :3], T[1, :3], T[2, :3]
    bc = np.cross(b, c)
    result = np.eye(4)
    result[:3, :3] = np.array([bc, np.cross(c, a), np.cross(a, b)]).T / (a @ bc)
    result[:3, 3] = -result[:3, :3] @ T[:3, 3]
    return result
