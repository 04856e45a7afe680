"""The motion of FOVIS as its authors' program (fovis 1.2) refines it: translation and Euler angles,
both reprojection errors.

A. Huang et al., ISRR 2011, section 3.5. The steps are those of efficient second-order minimization
(Benhimane, Malis 2004): derivatives are means of those at the current motion and those at no
motion, where each frame's points take the place of the other's.
"""

import numpy as np
from numba import njit

#: A step is the last one if it is shorter than this in every component (constants of the program).
MIN_STEP_M, MIN_STEP_RAD = 1e-4, np.radians(0.01)


@njit(cache=True)
def refine_motion(T, k, points0, uv0, points1, uv1, iterations):
    """T_reference_current (4, 4), refined from T. k (4,): fx, fy, cx, cy; points (n, 3) and uv (n,
    2) of the reference (0) and the current frame (1).

    A step that increases the squared error is not taken and ends the iteration. Like the program,
    uses fx for both axes.
    """
    best, angles = T.copy(), euler_angles(T)
    least = squared_error(best, k, points0, uv0, points1, uv1)
    none, still = np.eye(4), rotations(np.zeros(3))
    for _ in range(iterations):
        now = rotations(angles)
        A, b = np.zeros((6, 6)), np.zeros(6)
        for i in range(len(points0)):
            _add(A, b, best, now, none, still, k, points1[i], points0[i], uv0[i], False)
            _add(A, b, best, now, none, still, k, points0[i], points1[i], uv1[i], True)
        step = -2.0 * np.linalg.solve(A, b)
        next_angles, moved = angles + step[3:], np.eye(4)
        moved[:3, :3], moved[:3, 3] = rotations(next_angles)[0], best[:3, 3] + step[:3]
        error = squared_error(moved, k, points0, uv0, points1, uv1)
        if not error <= least:
            break
        best, angles, least = moved, next_angles, error
        if np.abs(step[:3]).max() < MIN_STEP_M and np.abs(step[3:]).max() < MIN_STEP_RAD:
            break
    return best


@njit(cache=True)
def euler_angles(T):
    """(3,): angles about x, y, z of the rotation Rz Ry Rx in T (4, 4)."""
    return np.array(
        [np.arctan2(T[2, 1], T[2, 2]), np.arcsin(-T[2, 0]), np.arctan2(T[1, 0], T[0, 0])]
    )


@njit(cache=True)
def rotations(angles):
    """(4, 3, 3): Rz Ry Rx, and its derivatives by the angles (3,) about x, y, z."""
    parts, slopes = np.zeros((3, 3, 3)), np.zeros((3, 3, 3))
    for a in range(3):
        s, c, i, j = np.sin(angles[a]), np.cos(angles[a]), (a + 1) % 3, (a + 2) % 3
        parts[a, a, a] = 1.0
        parts[a, i, i] = parts[a, j, j] = c
        parts[a, i, j], parts[a, j, i] = -s, s
        slopes[a, i, i] = slopes[a, j, j] = -s
        slopes[a, i, j], slopes[a, j, i] = -c, c
    out = np.empty((4, 3, 3))
    out[0] = parts[2] @ parts[1] @ parts[0]
    out[1] = parts[2] @ parts[1] @ slopes[0]
    out[2] = parts[2] @ slopes[1] @ parts[0]
    out[3] = slopes[2] @ parts[1] @ parts[0]
    return out


@njit(cache=True)
def squared_error(T, k, points0, uv0, points1, uv1):
    """Sum of the squared reprojection errors in both images, in pixels."""
    total, q = 0.0, np.empty(3)
    for i in range(len(points0)):
        for back in (False, True):
            _moved(T, points0[i] if back else points1[i], back, q)
            uv = uv1[i] if back else uv0[i]
            total += (k[0] * q[0] / q[2] + k[2] - uv[0]) ** 2 + (
                k[0] * q[1] / q[2] + k[3] - uv[1]
            ) ** 2
    return total


@njit(cache=True)
def _moved(T, p, back, out):
    """out (3,): T p, or with `back` T^-1 p."""
    for a in range(3):
        out[a] = 0.0 if back else T[a, 3]
        for b in range(3):
            out[a] += T[b, a] * (p[b] - T[b, 3]) if back else T[a, b] * p[b]


@njit(cache=True)
def _add(A, b, T, now, none, still, k, p, p_there, uv, back):
    """Add the equations of the point p of one frame, seen at uv in the other, where p_there is the
    same point.

    now, still: rotations() at the motion T and at none.
    """
    q, J, J0 = np.empty(3), np.empty((2, 6)), np.empty((2, 6))
    _moved(none, p_there, back, q)
    _slopes(none, still, k, p_there, q, back, J0)
    _moved(T, p, back, q)
    _slopes(T, now, k, p, q, back, J)
    for axis in range(2):
        error = k[0] * q[axis] / q[2] + k[2 + axis] - uv[axis]
        for i in range(6):
            row = J[axis, i] + J0[axis, i]
            b[i] += row * error
            for j in range(6):
                A[i, j] += row * (J[axis, j] + J0[axis, j])


@njit(cache=True)
def _slopes(T, turned, k, p, q, back, out):
    """out (2, 6): derivatives of the projection of q = T p (with `back` T^-1 p) by translation and
    angles. turned: rotations() of T.
    """
    d = np.empty(3)
    for i in range(6):
        for a in range(3):
            if i < 3:
                d[a] = -T[i, a] if back else (1.0 if a == i else 0.0)
            else:
                d[a] = 0.0
                for c in range(3):
                    d[a] += (
                        turned[i - 2, c, a] * (p[c] - T[c, 3])
                        if back
                        else turned[i - 2, a, c] * p[c]
                    )
        for axis in range(2):
            out[axis, i] = k[0] * (d[axis] * q[2] - q[axis] * d[2]) / q[2] ** 2
