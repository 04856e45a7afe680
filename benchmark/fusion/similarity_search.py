"""The similarities that bring points nearest to a surface from anywhere, also mirrored: many starts
of all orientations, places and sizes descend in a field of nearest points, of which fewer and fewer
are kept, and ICP refines the last ones.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from iclnuim.geometry import so3
from iclnuim.raycast.distance import TriangleDistance

#: The part of the model that counts: from one percentile of its vertices to another, and a share
#: of that around it. The field has so many places along an axis.
_PERCENTILES = (1, 99)
_AROUND = 0.25
_PLACES = 40
#: Starts of each size: random orientations, and places within the model's extent of its middle. ICP
#: converges from 20 degrees and a third of the extent: one start in 5000 or more.
_STARTS = 10_000
#: Sizes of points that are a part of the model, relative to all of it, ...
_SIZES = np.geomspace(0.36, 1.15, 8)
#: ... and the smallest: anything can be shrunk to a point on the model.
LEAST_SIZE = 0.3
#: Points of a start, the share of the starts that is kept in a round, and how many in the end, which
#: descend for some more rounds.
_START_POINTS = 30
_KEPT = 0.5
_LAST = 30
_LAST_ROUNDS = 8
_AT_ONCE = 2000
#: Of these so many are tried that are farther apart than this share of the extent.
_TRIED = 4
_APART = 0.1
#: Points of the last rounds and of the result, and rounds of ICP of each.
_TRIED_POINTS = 300
_TRIED_ROUNDS = 6
_REFINED_POINTS = 1000
_REFINED_ROUNDS = 12
_LAST_STEP = 1e-4
#: Points on a line determine no turn about it: this share of their spread holds it.
_REGULAR = 1e-6
#: Inliers in the field are within so many means of the distance.
_INLIERS = 2
#: Beyond this condition number the surface does not determine a similarity.
_UNDETERMINED = 1e10


class Similarity(NamedTuple):
    """x -> matrix x + translation, of a matrix (3, 3) that is a rotation or reflection times a
    scale.
    """

    matrix: np.ndarray
    translation: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3), moved."""
        return points @ self.matrix.T + self.translation

    def then(self, matrix: np.ndarray, translation: np.ndarray) -> "Similarity":
        return Similarity(matrix @ self.matrix, matrix @ self.translation + translation)

    @property
    def scale(self) -> float:
        return float(np.cbrt(abs(np.linalg.det(self.matrix))))

    @property
    def is_mirrored(self) -> bool:
        return bool(np.linalg.det(self.matrix) < 0)


class _NearestPoints:
    """The points of a surface that are nearest to the places of a grid, about its centre (3,)."""

    def __init__(self, model: TriangleDistance) -> None:
        low, high = np.percentile(model.vertices[np.unique(model.triangles)], _PERCENTILES, axis=0)
        self.centre = (low + high) / 2
        self._half = (high - low) / 2 + _AROUND * np.linalg.norm(high - low)
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, _PLACES)] * 3, indexing="ij"), -1)
        near = model.nearest(self.centre + self._half * grid.reshape(-1, 3)).point_m - self.centre
        self._nearest = near.astype(np.float32)

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) about the nearest points of points (..., 3), both about the centre."""
        place = (points / self._half.astype(np.float32) + 1) * np.float32((_PLACES - 1) / 2)
        index = (place + np.float32(0.5)).clip(0, _PLACES - 1).astype(np.int32)
        return self._nearest[(index[..., 0] * _PLACES + index[..., 1]) * _PLACES + index[..., 2]]

    def covers(self, points: np.ndarray) -> np.ndarray:
        """(n,) which points (n, 3) are inside."""
        return (np.abs(points - self.centre) <= self._half).all(axis=-1)


class _Starts(NamedTuple):
    """Similarities, from points about their mean to the field about its centre: matrix (m, 3, 3),
    translation (m, 3), and their scale (m,).
    """

    matrix: np.ndarray
    translation: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, *parts: np.ndarray) -> "_Starts":
        """They in float32, which is half of the time."""
        return cls(*(part.astype(np.float32) for part in parts))

    def rows(self, rows: np.ndarray | slice) -> "_Starts":
        return _Starts(*(part[rows] for part in self))


class SimilaritySearch:
    """The search for points (n, 3) that are a part of the model, about `LEAST_SIZE` of it or more."""

    def __init__(self, model: TriangleDistance, points: np.ndarray) -> None:
        self.model = model
        self.points = points
        self._mean = points.mean(axis=0)
        self._field = _NearestPoints(model)
        corners = model.vertices[model.triangles]
        places, weights = _quadrature(corners)
        inside = self._field.covers(places)
        self._middle = np.average(places[inside], weights=weights[inside], axis=0)
        apart = ((places[inside] - self._middle) ** 2).sum(axis=1)
        self._extent = float(np.sqrt(np.average(apart, weights=weights[inside])))
        self.ratio = float(np.linalg.norm(points.std(axis=0))) / self._extent

    def best(self, mirrored: bool, scale: float | None) -> Similarity | None:
        """The similarity that leaves the smallest share of the points' size, of this scale or of
        any one.
        """
        scales = _SIZES / self.ratio if scale is None else np.array([scale])
        some = _thinned(self.points, _TRIED_POINTS)
        found = []
        for start in self._starts(mirrored, scales):
            one = self._plane_icp(some, start, scale is None, _TRIED_ROUNDS)
            if self.ratio * one.scale >= LEAST_SIZE:
                found.append(one)
        if not found:
            return None
        return self._refined(min(found, key=lambda one: self._share(some, one)), scale is None)

    def refined(self, start: Similarity, with_scale: bool = False) -> Similarity:
        """The start after ICP, of which only the last rounds change the scale, if they may."""
        some = self._about_mean(_TRIED_POINTS)
        moved = start.apply(self._mean[None]) - self._field.centre
        near = _Starts.of(start.matrix[None], moved, np.array([start.scale]))
        for _ in range(_LAST_ROUNDS):
            near, _ = self._descended(some, near)
        return self._refined(self._similarity(near, 0), with_scale)

    def _refined(self, start: Similarity, with_scale: bool) -> Similarity:
        return self._plane_icp(
            _thinned(self.points, _REFINED_POINTS), start, with_scale, _REFINED_ROUNDS
        )

    def _starts(self, mirrored: bool, scales: np.ndarray) -> Iterator[Similarity]:
        """The best of all orientations, scales and places, apart from each other."""
        some = self._about_mean(_START_POINTS)
        starts = self._anywhere(mirrored, scales)
        while len(starts.scale) > _LAST:
            parts = []
            for first in range(0, len(starts.scale), _AT_ONCE):
                parts.append(self._descended(some, starts.rows(slice(first, first + _AT_ONCE))))
            starts = _Starts(*map(np.concatenate, zip(*[one for one, _ in parts], strict=True)))
            left = np.concatenate([left for _, left in parts])
            kept = max(_LAST, int(_KEPT * len(left)))
            starts = starts.rows(np.argpartition(left, kept - 1)[:kept])
        some = self._about_mean(_TRIED_POINTS)
        for _ in range(_LAST_ROUNDS):
            starts, left = self._descended(some, starts)
        chosen: list[np.ndarray] = []
        for row in np.argsort(left):
            moved = some @ starts.matrix[row].T + starts.translation[row]
            apart = [np.linalg.norm(moved - other, axis=1).mean() for other in chosen]
            if min(apart, default=np.inf) > _APART * self._extent and len(chosen) < _TRIED:
                chosen.append(moved)
                yield self._similarity(starts, row)

    def _anywhere(self, mirrored: bool, scales: np.ndarray) -> _Starts:
        """`_STARTS` of each scale."""
        rng = np.random.default_rng(0)
        count = _STARTS * len(scales)
        quat_xyzw, away = rng.normal(size=(count, 4)), rng.normal(size=(count, 3))
        quat_xyzw /= np.linalg.norm(quat_xyzw, axis=1, keepdims=True)
        away *= np.cbrt(rng.uniform(size=(count, 1))) / np.linalg.norm(away, axis=1, keepdims=True)
        scale = np.repeat(scales, _STARTS)
        flip = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
        matrix = scale[:, None, None] * so3.matrix_from_quat_xyzw(quat_xyzw) @ flip
        translation = self._middle - self._field.centre + self._extent * away
        return _Starts.of(matrix, translation, scale)

    def _about_mean(self, count: int) -> np.ndarray:
        return (_thinned(self.points, count) - self._mean).astype(np.float32)

    def _similarity(self, starts: _Starts, row: int) -> Similarity:
        matrix = starts.matrix[row].astype(float)
        moved = starts.translation[row] + self._field.centre
        return Similarity(matrix, moved - matrix @ self._mean)

    def _descended(self, points: np.ndarray, starts: _Starts) -> tuple[_Starts, np.ndarray]:
        """The starts after a step of point-to-point ICP in the field, which keeps their scale, and
        (m,) the shares that they left before it. points and starts are float32.
        """
        moved = points @ starts.matrix.swapaxes(1, 2) + starts.translation[:, None]
        offset = self._field.nearest(moved) - moved
        left = np.sqrt(np.einsum("mni,mni->mn", offset, offset))
        mean = left.mean(axis=1, keepdims=True)
        use = (left <= _INLIERS * mean).astype(np.float32)[:, None]
        use /= use.sum(axis=2, keepdims=True)
        middle, shift = use @ moved, (use @ offset)[:, 0]
        about = moved - middle
        weighted = (use.swapaxes(1, 2) * about).swapaxes(1, 2)
        inertia = -(weighted @ about)
        spread = np.maximum(-np.einsum("mii->m", inertia), np.finfo(np.float32).tiny)
        inertia[:, range(3), range(3)] += (1 + _REGULAR) * spread[:, None]
        torque = weighted @ offset
        torque = (torque - torque.swapaxes(1, 2))[:, [1, 2, 0], [2, 0, 1]]
        R = so3.exp(np.linalg.solve(inertia, torque[..., None])[..., 0]).astype(np.float32)
        translation = (R @ (starts.translation[..., None] - middle.swapaxes(1, 2)))[..., 0]
        translation += middle[:, 0] + shift
        return _Starts(R @ starts.matrix, translation, starts.scale), mean[:, 0] / starts.scale

    def resized(self, one: Similarity, scale: float) -> Similarity:
        """The same with another scale, about the centre of the points."""
        matrix = one.matrix * (scale / one.scale)
        return Similarity(matrix, one.apply(self._mean[None])[0] - matrix @ self._mean)

    def share(self, one: Similarity) -> float:
        """The mean distance that a similarity leaves, as a share of its scale."""
        return self._share(_thinned(self.points, _REFINED_POINTS), one)

    def _share(self, points: np.ndarray, one: Similarity) -> float:
        return float(self.model.distance(one.apply(points)).mean()) / one.scale

    def _plane_icp(
        self, points: np.ndarray, start: Similarity, with_scale: bool, rounds: int
    ) -> Similarity:
        """Point-to-plane ICP, which is exact; the weights make it that of least absolute distances."""
        found = start
        for _ in range(rounds):
            moved = found.apply(points)
            near = self.model.nearest(moved)
            normals = self.model.normals(near.triangle)
            offset = ((moved - near.point_m) * normals).sum(axis=1)
            weight = 1 / (near.distance_m + max(np.median(near.distance_m), _LAST_STEP))
            middle = moved.mean(axis=0)
            about = moved - middle
            columns = [normals, np.cross(about, normals)]
            if with_scale:
                columns.append((about * normals).sum(axis=1, keepdims=True))
            J = np.hstack(columns)
            A = (weight * J.T) @ J
            if len(J) < J.shape[1] or np.linalg.cond(A) > _UNDETERMINED:
                break
            step = np.linalg.solve(A, -J.T @ (weight * offset))
            matrix = so3.exp(step[3:6]) * np.exp(step[6:].sum())
            found = found.then(matrix, middle - matrix @ middle + step[:3])
            if np.abs(step).max() < _LAST_STEP:
                break
        return found


def _thinned(points: np.ndarray, count: int) -> np.ndarray:
    """About so many of the points."""
    return points[:: max(1, len(points) // count)]


def _quadrature(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (3 m, 3) in triangles (m, 3, 3) and weights (3 m,), exact for second moments."""
    shares = np.full((3, 3), 1 / 6) + np.eye(3) / 2
    places = np.einsum("ki,mij->mkj", shares, corners).reshape(-1, 3)
    edges = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return places, np.repeat(areas, 3)
