"""The similarities that bring points nearest to a surface from anywhere, also mirrored: starts of
all orientations and sizes are looked up in a field of distances, and ICP refines the nearest ones.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from iclnuim.doubt.axis_changes import changes_of_axes
from iclnuim.evaluation.align import umeyama
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.distance import TriangleDistance

#: The part of the model that counts: from one percentile of its vertices to another, and a share
#: of that around it. The field has so many places along an axis.
_PERCENTILES = (1, 99)
_AROUND = 0.25
_PLACES = 32
#: Rotations besides those that swap axes, so that one is within about 20 degrees of any.
_ROTATIONS = 500
#: Sizes of points that are a part of the model, relative to all of it, ...
_SIZES = (1.25, 1.12, 1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.33)
#: ... and the smallest: anything can be shrunk to a point on the model.
LEAST_SIZE = 0.3
#: Points that are looked up and tried, starts and the angle between them, points of the result, and
#: rounds of each.
_LOOKED_UP = 100
_TRIED_POINTS = 300
_STARTS = 16
_APART_RAD = np.radians(25.0)
_ROUNDS = 8
_REFINED_POINTS = 1500
_REFINED_ROUNDS = 30
_LAST_STEP = 1e-7
#: Inliers of ICP are within so many medians.
_INLIERS = 3
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


@dataclass(frozen=True, eq=False)
class _DistanceField:
    """distance_m (k, k, k): distances to the surface at places `step` (3,) apart from `low` (3,) on."""

    low: np.ndarray
    step: np.ndarray
    distance_m: np.ndarray

    @classmethod
    def of(cls, model: TriangleDistance) -> "_DistanceField":
        low, high = np.percentile(model.vertices[np.unique(model.triangles)], _PERCENTILES, axis=0)
        around = _AROUND * np.linalg.norm(high - low)
        low, high = low - around, high + around
        step = (high - low) / (_PLACES - 1)
        places = low + step * np.stack(np.meshgrid(*[np.arange(_PLACES)] * 3, indexing="ij"), -1)
        found = model.distance(places.reshape(-1, 3)).reshape([_PLACES] * 3)
        return cls(low, step, found)

    def at(self, points: np.ndarray) -> np.ndarray:
        """(...) about the distances of points (..., 3)."""
        place = (points - self.low) / self.step
        inside = np.rint(place).clip(0, _PLACES - 1).astype(int)
        beyond = np.abs(place - place.clip(0, _PLACES - 1)) * self.step
        return self.distance_m[tuple(np.moveaxis(inside, -1, 0))] + beyond.sum(axis=-1)

    def covers(self, points: np.ndarray) -> np.ndarray:
        """(n,) which points (n, 3) are inside."""
        place = (points - self.low) / self.step
        return ((place >= 0) & (place <= _PLACES - 1)).all(axis=-1)


class SimilaritySearch:
    """The search for points (n, 3) that are a part of the model, about `LEAST_SIZE` of it or more."""

    def __init__(self, model: TriangleDistance, points: np.ndarray) -> None:
        self.model = model
        self.points = points
        self._field = _DistanceField.of(model)
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
        scales = np.array(_SIZES) / self.ratio if scale is None else np.array([scale])
        some = _thinned(self.points, _TRIED_POINTS)
        tried = []
        for start in self._starts(mirrored, scales):
            rough = self._icp(some, start, scale is None)
            tried += [rough, self._plane_icp(some, rough, scale is None, _ROUNDS)]
        found = [one for one in tried if self.ratio * one.scale >= LEAST_SIZE]
        if not found:
            return None
        nearest = min(found, key=lambda one: self._share(some, one))
        return self.refined(nearest, scale is None)

    def refined(self, start: Similarity, with_scale: bool) -> Similarity:
        """The start after ICP, which may change its scale."""
        some = _thinned(self.points, _REFINED_POINTS)
        rough = self._icp(some, start, with_scale)
        fine = self._plane_icp(some, rough, with_scale, _REFINED_ROUNDS)
        return min((start, rough, fine), key=lambda one: self._share(some, one))

    def _starts(self, mirrored: bool, scales: np.ndarray) -> Iterator[Similarity]:
        """The best of all orientations, scales and places."""
        some = _thinned(self.points, _LOOKED_UP)
        middles = (np.zeros(3), np.zeros(3)), (self.points.mean(axis=0), self._middle)
        rotations = _rotations()
        flip = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
        best = np.full(len(rotations), np.inf)
        starts: list[Similarity | None] = [None] * len(rotations)
        for scale, (own, other) in product(scales, middles):
            matrices = scale * rotations @ flip
            moved = np.einsum("rij,nj->rni", matrices, some - own) + other
            left = self._field.at(moved).mean(axis=1) / scale
            for row in np.flatnonzero(left < best):
                best[row] = left[row]
                starts[row] = Similarity(matrices[row], other - matrices[row] @ own)
        for _ in range(_STARTS):
            row = int(best.argmin())
            if (start := starts[row]) is None or best[row] == np.inf:
                return
            yield start
            best[so3.angle(rotations[row].T @ rotations) < _APART_RAD] = np.inf

    def resized(self, one: Similarity, scale: float) -> Similarity:
        """The same with another scale, about the centre of the points."""
        middle = self.points.mean(axis=0)
        matrix = one.matrix * (scale / one.scale)
        return Similarity(matrix, one.apply(middle[None])[0] - matrix @ middle)

    def share(self, one: Similarity) -> float:
        """The mean distance that a similarity leaves, as a share of its scale."""
        return self._share(_thinned(self.points, _REFINED_POINTS), one)

    def _share(self, points: np.ndarray, one: Similarity) -> float:
        return float(self.model.distance(one.apply(points)).mean()) / one.scale

    def _icp(self, points: np.ndarray, start: Similarity, with_scale: bool) -> Similarity:
        """Point-to-point ICP, which converges from afar."""
        found = start
        for _ in range(_ROUNDS):
            moved = found.apply(points)
            near = self.model.nearest(moved)
            use = near.distance_m <= _INLIERS * np.median(near.distance_m)
            if np.count_nonzero(use) < 4:
                break
            T, factor = umeyama(moved[use], near.point_m[use], with_scale=with_scale)
            found = found.then(factor * T.rotation, T.translation)
        return found

    def _plane_icp(
        self, points: np.ndarray, start: Similarity, with_scale: bool, rounds: int
    ) -> Similarity:
        """Point-to-plane ICP, which is exact."""
        found = start
        for _ in range(rounds):
            moved = found.apply(points)
            near = self.model.nearest(moved)
            normals = self.model.normals(near.triangle)
            offset = ((moved - near.point_m) * normals).sum(axis=1)
            use = near.distance_m <= _INLIERS * np.median(near.distance_m)
            middle = moved.mean(axis=0)
            about = moved[use] - middle
            n = normals[use]
            columns = [n, np.cross(about, n)]
            if with_scale:
                columns.append((about * n).sum(axis=1, keepdims=True))
            J = np.hstack(columns)
            A = J.T @ J
            if len(J) < J.shape[1] or np.linalg.cond(A) > _UNDETERMINED:
                break
            step = np.linalg.solve(A, -J.T @ offset[use])
            matrix = so3.exp(step[3:6]) * np.exp(step[6:].sum())
            found = found.then(matrix, middle - matrix @ middle + step[:3])
            if np.abs(step).max() < _LAST_STEP:
                break
        return found


def _thinned(points: np.ndarray, count: int) -> np.ndarray:
    """About so many of the points."""
    return points[:: max(1, len(points) // count)]


def _rotations() -> np.ndarray:
    """(m, 3, 3) rotations that swap axes, and others in all directions."""
    quat_xyzw = np.random.default_rng(0).normal(size=(_ROTATIONS, 4))
    quat_xyzw /= np.linalg.norm(quat_xyzw, axis=1, keepdims=True)
    anywhere = SE3.from_quat_xyzw(quat_xyzw, np.zeros((_ROTATIONS, 3))).rotation
    return np.concatenate([changes_of_axes(1), anywhere])


def _quadrature(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (3 m, 3) in triangles (m, 3, 3) and weights (3 m,), exact for second moments."""
    shares = np.full((3, 3), 1 / 6) + np.eye(3) / 2
    places = np.einsum("ki,mij->mkj", shares, corners).reshape(-1, 3)
    edges = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return places, np.repeat(areas, 3)
