"""Rigid motions SE(3) as an immutable type over arrays of any leading shape.

`T_a_b` is the pose of b in a: p_a = T_a_b.apply(p_b), and T_a_b @ T_b_c = T_a_c. Lengths in metres.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from . import so3


def read_only(array: np.ndarray) -> np.ndarray:
    """A read-only view of the array; the array itself stays writable."""
    view = np.asarray(array).view()
    view.setflags(write=False)
    return view


@dataclass(frozen=True, eq=False)
class SE3:
    """Rotation (..., 3, 3) and translation (..., 3) in metres, float64, read-only.

    The constructor does not check that the rotation is one; `from_matrix` and the `from_quat_*`
    functions do.
    """

    rotation: np.ndarray
    translation: np.ndarray

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation, float)
        translation = np.array(self.translation, float)
        if rotation.shape[-2:] != (3, 3) or translation.shape != (*rotation.shape[:-2], 3):
            found = f"{rotation.shape} and {translation.shape}"
            raise InputError("rotation (..., 3, 3) and translation (..., 3)", found=found)
        object.__setattr__(self, "rotation", read_only(rotation))
        object.__setattr__(self, "translation", read_only(translation))

    @classmethod
    def identity(cls, shape: tuple[int, ...] = ()) -> "SE3":
        return cls(np.broadcast_to(np.eye(3), (*shape, 3, 3)), np.zeros((*shape, 3)))

    @classmethod
    def from_matrix(cls, matrix: np.ndarray) -> "SE3":
        """From (..., 3, 4) or (..., 4, 4).

        A rotation with rounding errors becomes the nearest rotation; raises InputError for larger
        errors.
        """
        m = np.asarray(matrix, float)
        if m.shape[-2:] not in ((3, 4), (4, 4)):
            raise InputError("matrices (..., 3, 4) or (..., 4, 4)", found=m.shape)
        if not np.isfinite(m).all():
            first = np.argmin(np.isfinite(m.reshape(-1, m.shape[-2] * 4)).all(1))
            of = f" in pose {first}" if m.ndim > 2 else ""
            raise InputError("finite numbers", found=f"NaN or infinity{of}")
        if m.shape[-2] == 4 and not np.allclose(m[..., 3, :], (0, 0, 0, 1), atol=1e-6):
            is_turned = np.allclose(m[..., :, 3], (0, 0, 0, 1), atol=1e-6)
            hint = "the transposed matrices" if is_turned else None
            found = m[..., 3, :].reshape(-1, 4)[0]
            raise InputError("a last row of 0 0 0 1", found=found, hint=hint)
        return cls(so3.nearest_rotation(m[..., :3, :3]), m[..., :3, 3])

    @classmethod
    def of(cls, given: "Poses") -> "SE3":
        """The poses, or those of an array of matrices (..., 3, 4) or (..., 4, 4) or of a list of
        matrices or of single poses.

        Raises InputError for anything else.
        """
        if isinstance(given, cls):
            return given
        if isinstance(given, list | tuple) and given and all(isinstance(T, cls) for T in given):
            given = [T.matrix for T in given]
        try:
            matrices = np.asarray(given, float)
        except (TypeError, ValueError):
            raise InputError("poses (SE3) or matrices (..., 4, 4)", found=_kind(given)) from None
        if matrices.shape[-2:] not in ((3, 4), (4, 4)):
            found = matrices.shape or _kind(given)
            raise InputError("poses (SE3) or matrices (..., 4, 4)", found=found)
        return cls.from_matrix(matrices)

    @classmethod
    def from_quat_xyzw(cls, quat_xyzw: np.ndarray, translation: np.ndarray) -> "SE3":
        """From quaternions (..., 4), scalar last, and translations (..., 3).

        Lengths within so3.QUAT_NORM_TOLERANCE of one are normalised.
        """
        return cls(so3.matrix_from_quat_xyzw(quat_xyzw), translation)

    @classmethod
    def exp(cls, twist: np.ndarray) -> "SE3":
        """From twists (..., 6): translational part first (metres), rotation vector last (radians).

        Raises InputError for other shapes.
        """
        twist = np.asarray(twist, float)
        if twist.shape[-1:] != (6,):
            raise InputError("twists (..., 6)", found=twist.shape)
        v = twist[..., :3]
        w = twist[..., 3:]
        angle = np.linalg.norm(w, axis=-1)[..., None, None]
        a, b, c = so3.exp_coefficients(angle)
        k = so3.hat(w)
        one = np.eye(3)
        squared = k @ k
        left_jacobian = one + b * k + c * squared
        return cls(one + a * k + b * squared, (left_jacobian @ v[..., None])[..., 0])

    @property
    def matrix(self) -> np.ndarray:
        """Matrices (..., 4, 4)."""
        m = np.zeros((*self.shape, 4, 4))
        m[..., :3, :3] = self.rotation
        m[..., :3, 3] = self.translation
        m[..., 3, 3] = 1.0
        return m

    @property
    def quat_xyzw(self) -> np.ndarray:
        """Quaternions (..., 4), scalar last and not negative."""
        return so3.quat_xyzw_from_matrix(self.rotation)

    def log(self) -> np.ndarray:
        """Twists (..., 6), the inverse of exp; the rotation vector has a length of at most pi."""
        w = so3.log(self.rotation)
        t = np.linalg.norm(w, axis=-1)[..., None, None]
        k = so3.hat(w)
        t2 = t * t
        small = t < 0.05
        s = np.where(small, 1.0, t)
        # 1/t^2 - cot(t/2)/(2 t), by series for small t, stable up to pi
        exact = 1.0 / (s * s) - np.cos(s / 2) / (2.0 * s * np.sin(s / 2))
        coefficient = np.where(small, 1.0 / 12.0 + t2 / 720.0 + t2 * t2 / 30240.0, exact)
        inverse_jacobian = np.eye(3) - 0.5 * k + coefficient * (k @ k)
        return np.concatenate(
            [(inverse_jacobian @ self.translation[..., None])[..., 0], w], axis=-1
        )

    def inverse(self) -> "SE3":
        r = np.swapaxes(self.rotation, -1, -2)
        return SE3(r, -(r @ self.translation[..., None])[..., 0])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Matrices (..., 4, 4), for np.asarray. Raises ValueError for copy=False: they are made."""
        if copy is False:
            raise ValueError("the matrices of poses are made, which copy=False forbids")
        return self.matrix if dtype is None else self.matrix.astype(dtype)

    #: No arithmetic of NumPy on poses but the product of matrices.
    __array_ufunc__ = None

    def __rmatmul__(self, other: np.ndarray) -> "SE3":
        """Compose a matrix (..., 4, 4) with poses."""
        return SE3.of(other) @ self

    def __matmul__(self, other: "Poses") -> "SE3":
        """Compose: T_a_b @ T_b_c = T_a_c; leading shapes broadcast."""
        other = SE3.of(other)
        rotation = self.rotation @ other.rotation
        translation = (self.rotation @ other.translation[..., None])[..., 0] + self.translation
        return SE3(rotation, np.broadcast_to(translation, rotation.shape[:-1]))

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Transform points (..., n, 3) or (3,) in metres: p_a = T_a_b.apply(p_b).

        A single pose applies to points of any leading shape.
        """
        points = np.asarray(points, float)
        if points.ndim == 1:
            return (self.rotation @ points[..., None])[..., 0] + self.translation
        return points @ np.swapaxes(self.rotation, -1, -2) + self.translation[..., None, :]

    def interpolate(self, other: "SE3", share: np.ndarray | float) -> "SE3":
        """The screw motion from self (share 0) to other (share 1), shares (...) of the poses'
        shape: self exp(share log(self^-1 other)).
        """
        twist = (self.inverse() @ other).log()
        return self @ SE3.exp(np.asarray(share, float)[..., None] * twist)

    def is_rigid(self) -> np.ndarray:
        """(...) whether all numbers are finite and the rotations are rotation matrices, to a
        thousandth.
        """
        R = self.rotation
        with np.errstate(invalid="ignore", over="ignore"):
            orthonormal = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max((-1, -2)) < 1e-3
            proper = np.einsum("...i,...i->...", np.cross(R[..., 0], R[..., 1]), R[..., 2]) > 0
        return np.asarray(orthonormal & proper & np.isfinite(self.translation).all(-1))

    @property
    def shape(self) -> tuple[int, ...]:
        """The leading shape."""
        return self.translation.shape[:-1]

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a single pose has no length")
        return self.shape[0]

    def __iter__(self) -> Iterator["SE3"]:
        """The poses along the first axis of the leading shape."""
        return (self[i] for i in range(len(self)))

    def __bool__(self) -> bool:
        return not self.shape or len(self) > 0

    def __getitem__(self, index: Any) -> "SE3":
        """Indexing over the leading shape."""
        if not self.shape:
            raise IndexError("a single pose has no leading shape to index")
        picked = np.arange(int(np.prod(self.shape))).reshape(self.shape)[index]
        return SE3(self.rotation.reshape(-1, 3, 3)[picked], self.translation.reshape(-1, 3)[picked])

    def __repr__(self) -> str:
        if self.shape:
            return f"SE3(shape={self.shape})"
        return f"SE3(t={self.translation}, quat_xyzw={self.quat_xyzw})"


#: Poses, or matrices (..., 4, 4) as an array or a list.
Poses = SE3 | np.ndarray | Sequence[Any]


def _kind(given: object) -> str:
    return type(given).__name__
