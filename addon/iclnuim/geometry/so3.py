"""Rotations in three dimensions: matrix, quaternion and rotation vector, over arrays of any leading
shape.

Numerically stable for angles near 0 (by series) and near pi (by quaternions). All results are
float64. Quaternions are Hamilton's, order named by each function.
"""

import numpy as np

from ..errors import InputError

#: A quaternion whose length differs from one by at most this is normalised, else an error. Three
#: printed decimals are enough.
QUAT_NORM_TOLERANCE = 1e-2
#: A matrix with R^T R = I up to this (largest entry) becomes the nearest rotation, else an error.
#: Three printed decimals are enough: they cause at most 2 sqrt(3) 0.0005 = 1.74e-3.
MATRIX_TOLERANCE = 2e-3
_SMALL_ANGLE = 1e-4


def hat(w: np.ndarray) -> np.ndarray:
    """(..., 3) -> (..., 3, 3): the matrix with hat(w) @ p = w x p."""
    w = np.asarray(w, float)
    m = np.zeros((*w.shape[:-1], 3, 3))
    m[..., 2, 1] = w[..., 0]
    m[..., 0, 2] = w[..., 1]
    m[..., 1, 0] = w[..., 2]
    m[..., 1, 2] = -w[..., 0]
    m[..., 2, 0] = -w[..., 1]
    m[..., 0, 1] = -w[..., 2]
    return m


def unit_quaternion(quat: np.ndarray) -> np.ndarray:
    """(..., 4) in either order -> normalised to length one.

    Raises InputError for another shape, and if a length differs from one by more than
    QUAT_NORM_TOLERANCE or is not finite.
    """
    quat = np.asarray(quat, float)
    if not quat.ndim or quat.shape[-1] != 4:
        raise InputError("quaternions (..., 4)", found=quat.shape)
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # numbers as large as that are refused just below
        norm = np.linalg.norm(quat, axis=-1, keepdims=True)
    bad = ~(np.abs(norm - 1.0) <= QUAT_NORM_TOLERANCE)
    if bad.any():
        worst = norm[bad].flat[0]
        raise InputError(
            f"quaternions of length 1 (to {QUAT_NORM_TOLERANCE:g})", found=f"length {worst:.6g}"
        )
    return quat / norm


def matrix_from_quat_xyzw(quat_xyzw: np.ndarray) -> np.ndarray:
    """(..., 4), scalar last -> (..., 3, 3)."""
    x, y, z, w = np.moveaxis(unit_quaternion(quat_xyzw), -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def quat_xyzw_from_matrix(rotation: np.ndarray) -> np.ndarray:
    """(..., 3, 3) -> (..., 4), scalar last, scalar >= 0.

    Computes the four outer products of the quaternion with itself and uses the best conditioned one
    (Shepperd 1978), so that all angles have full precision.
    """
    m = np.asarray(rotation, float)
    d0 = m[..., 0, 0]
    d1 = m[..., 1, 1]
    d2 = m[..., 2, 2]
    xy = m[..., 0, 1] + m[..., 1, 0]
    xz = m[..., 0, 2] + m[..., 2, 0]
    yz = m[..., 1, 2] + m[..., 2, 1]
    wx = m[..., 2, 1] - m[..., 1, 2]
    wy = m[..., 0, 2] - m[..., 2, 0]
    wz = m[..., 1, 0] - m[..., 0, 1]
    products = (  # row k = 4 q_k q
        (1 + d0 - d1 - d2, xy, xz, wx),
        (xy, 1 - d0 + d1 - d2, yz, wy),
        (xz, yz, 1 - d0 - d1 + d2, wz),
        (wx, wy, wz, 1 + d0 + d1 + d2),
    )
    rows = np.stack([np.stack(row, -1) for row in products], -2)
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., 3:] < 0, -q, q)


def exp(w: np.ndarray) -> np.ndarray:
    """(..., 3) rotation vector in radians -> (..., 3, 3) (Rodrigues)."""
    w = np.asarray(w, float)
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    a, b, _ = exp_coefficients(angle)
    k = hat(w)
    return np.eye(3) + a * k + b * (k @ k)


def log(rotation: np.ndarray) -> np.ndarray:
    """(..., 3, 3) -> (..., 3) rotation vector in radians, of length at most pi."""
    q = quat_xyzw_from_matrix(rotation)
    v = q[..., :3]
    w = q[..., 3:]
    s = np.linalg.norm(v, axis=-1, keepdims=True)
    half = np.arctan2(s, w)
    small = s < _SMALL_ANGLE
    scale = np.where(small, 2.0 + s * s / 3.0, 2.0 * half / np.where(small, 1.0, s))
    return scale * v


def angle(rotation: np.ndarray) -> np.ndarray:
    """(..., 3, 3) -> (...) rotation angle in radians, 0..pi, exact near both ends."""
    q = quat_xyzw_from_matrix(rotation)
    return 2.0 * np.arctan2(np.linalg.norm(q[..., :3], axis=-1), q[..., 3])


def exp_coefficients(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3 for t = angle, by series below 1e-4."""
    t = np.asarray(angle, float)
    small = t < _SMALL_ANGLE
    s = np.where(small, 1.0, t)
    t2 = t * t
    a = np.where(small, 1.0 - t2 / 6.0, np.sin(s) / s)
    b = np.where(small, 0.5 - t2 / 24.0, 2.0 * (np.sin(s / 2.0) / s) ** 2)
    # (s - sin s)/s^3 loses precision up to about 1e-3, so the series has more terms there
    series = 1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0
    c = np.where(t < 0.05, series, (s - np.sin(s)) / (s * s * s))
    return a, b, c


def what_no_rotation_is(matrix: np.ndarray) -> str:
    """What a matrix (3, 3) is that is no rotation."""
    if not np.isfinite(matrix).all():
        return "NaN or infinity"
    with np.errstate(over="ignore", invalid="ignore"):
        det = float(np.linalg.det(matrix))
        scale = float(np.cbrt(abs(det)))
        gram = matrix.T @ matrix
        is_scaled = np.allclose(gram, scale**2 * np.eye(3), atol=1e-3 * scale**2)
    reflected = " and reflected" if det < 0 else ""
    if is_scaled and scale > 0 and abs(scale - 1) > 1e-3:
        return f"rotations multiplied by {scale:.4g}{reflected}"
    if is_scaled and reflected:
        return "a reflection"
    off = np.abs(gram - np.eye(3)).max()
    return f"R^T R that differs from the identity by {off:.3g}"


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """(..., 3, 3) approximate rotation (such as from few printed digits or float32) -> the nearest
    rotation.

    Raises InputError if R^T R differs from the identity by more than MATRIX_TOLERANCE, or if det R
    < 0.
    """
    m = np.asarray(matrix, float)
    if not m.size:
        return m
    every = m.reshape(-1, 3, 3)
    with np.errstate(over="ignore", invalid="ignore"):  # numbers this large are refused just below
        off = np.abs(np.swapaxes(every, 1, 2) @ every - np.eye(3)).max((1, 2))
    if (invalid := ~(off <= MATRIX_TOLERANCE)).any():
        raise InputError("rotation matrices", found=what_no_rotation_is(every[invalid.argmax()]))
    if np.linalg.det(m).min() < 0:
        hint = "converting its axes first"
        raise InputError("rotation matrices with determinant +1", found="a reflection", hint=hint)
    if off.max() < 1e-14:
        return m
    u, _, vt = np.linalg.svd(m)
    return u @ vt
