"""Alignment of two paired paths without numpy, by Horn's quaternions: the small sums that quick_ate.py needs.

Horn, "Closed-form solution of absolute orientation using unit quaternions", JOSA A 4(4), 1987, section 4. Vectors are
tuples of three floats in metres, quaternions (w, x, y, z).
"""

from __future__ import annotations

import math
from operator import mul

Vector = tuple[float, float, float]
Quaternion = tuple[float, ...]


class PlainAlignment:
    """y = scale R x + t of paired positions x (estimate) and y (reference), and what the best reflection would leave.

    turn is R's quaternion; extents are the standard deviations along the principal directions, longest first.
    """

    def __init__(self, x: list[Vector], y: list[Vector], with_scale: bool) -> None:
        (mean_x, x), (mean_y, y) = centred(x), centred(y)
        self.extents_x_m, self.extents_y_m = extents(x), extents(y)
        # the best quaternion belongs to the largest eigenvalue of N; the best reflection is minus the best rotation
        # onto -y, whose N has the opposite sign, so it belongs to the smallest
        values, vectors = eigen(horn_matrix(products(x, y)))
        largest, smallest = (pick(range(4), key=values.__getitem__) for pick in (max, min))
        square = sum(sum(map(mul, point, point)) for point in x) or 1.0
        self.turn, full_scale = vectors[largest], values[largest] / square
        self.scale = full_scale if with_scale else 1.0
        self.errors_m = residuals(x, y, self.turn, self.scale)
        self.residual_rms_m = rms(self.errors_m)
        self.rotation_rms_m = rms(residuals(x, y, self.turn, full_scale))
        self.reflection_rms_m = rms(residuals(x, y, vectors[smallest], values[smallest] / square))
        moved = [sum(map(mul, row, mean_x)) for row in rows_of(self.turn)]
        self.translation_m = [to - self.scale * at for to, at in zip(mean_y, moved, strict=True)]


def centred(points: list[Vector]) -> tuple[Vector, list[Vector]]:
    """The mean and the points less it."""
    a, b, c = (math.fsum(column) / len(points) for column in zip(*points, strict=True))
    return (a, b, c), [(x - a, y - b, z - c) for x, y, z in points]


def products(x: list[Vector], y: list[Vector]) -> list[list[float]]:
    """(3, 3) S_ab = sum of x_a y_b."""
    columns_x, columns_y = list(zip(*x, strict=True)), list(zip(*y, strict=True))
    return [[sum(map(mul, a, b)) for b in columns_y] for a in columns_x]


def horn_matrix(s: list[list[float]]) -> list[list[float]]:
    """(4, 4) N of section 4A: q^T N q is the sum of y . R(q) x."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = s
    return [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ]


def extents(points: list[Vector]) -> list[float]:
    """Standard deviations of centred points along their principal directions, longest first."""
    values, _ = eigen(products(points, points))
    return sorted((math.sqrt(max(value, 0.0) / len(points)) for value in values), reverse=True)


def eigen(symmetric: list[list[float]]) -> tuple[list[float], list[tuple[float, ...]]]:
    """Eigenvalues and unit eigenvectors of a small symmetric matrix, by Jacobi's rotations (Golub, Van Loan, 8.5)."""
    a, size = [row[:] for row in symmetric], len(symmetric)
    v = [[float(i == k) for k in range(size)] for i in range(size)]  # its rows become the eigenvectors
    cells = [(p, q) for p in range(size) for q in range(p + 1, size)]
    for _ in range(50):
        for p, q in cells:
            if a[p][q] != 0.0:
                _rotate(a, v, p, q)
        if max(abs(a[p][q]) for p, q in cells) <= 1e-17 * max(abs(a[i][i]) for i in range(size)):
            break
    return [a[i][i] for i in range(size)], [tuple(row) for row in v]


def _rotate(a: list[list[float]], v: list[list[float]], p: int, q: int) -> None:
    """Make a[p][q] zero by a rotation in the plane of p and q."""
    tau = (a[q][q] - a[p][p]) / (2 * a[p][q])
    t = math.copysign(1 / (abs(tau) + math.hypot(1, tau)), tau)
    c = 1 / math.hypot(1, t)
    s = t * c
    for row in a:
        row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]
    for m in (a, v):
        old_p, old_q = m[p], m[q]
        m[p] = [c * x - s * y for x, y in zip(old_p, old_q, strict=True)]
        m[q] = [s * x + c * y for x, y in zip(old_p, old_q, strict=True)]


def rows_of(q: Quaternion) -> list[Vector]:
    """The rows of R(q), Horn's section 3E."""
    w, x, y, z = q
    return [
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    ]


def residuals(x: list[Vector], y: list[Vector], turn: Quaternion, scale: float) -> list[float]:
    """|y - scale R x| of each pair."""
    (a, b, c), (d, e, f), (g, h, i) = ([scale * part for part in row] for row in rows_of(turn))
    return [
        math.sqrt(
            (u - (a * p + b * q + c * r)) ** 2 + (v - (d * p + e * q + f * r)) ** 2 + (w - (g * p + h * q + i * r)) ** 2
        )
        for (p, q, r), (u, v, w) in zip(x, y, strict=True)
    ]


def times(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton's product."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def angle_deg(a: Quaternion, b: Quaternion) -> float:
    """The angle of the rotation from a to b, 0..180."""
    w, x, y, z = times((a[0], -a[1], -a[2], -a[3]), b)
    return math.degrees(2 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w)))


def rms(values: list[float]) -> float:
    return math.sqrt(math.fsum(map(mul, values, values)) / len(values))
