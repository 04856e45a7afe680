"""Ray casting of triangles, their visibility from cameras, and viewpoints in free space.

This is the only module that uses Embree (embreex).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, WorkError
from ..formats.scene_model import SceneModel
from ..geometry.camera import PinholeCamera
from ..geometry.handheld_plan import MARGINS_M, FreeSpace, Waypoint, rounded
from ..geometry.points import farthest_points
from ..geometry.se3 import SE3
from ..geometry.triangles import check_mesh

#: A centroid is visible if the ray to it reaches this share of its length.
_ARRIVED = 1 - 1e-4
#: The same for a point on the surface in double precision: Embree uses single precision. At 3 m a
#: point 0.1 mm behind a surface is visible.
_REACHED = 1 - 3e-5
FRONT, BACK = 0, 1
#: Viewpoints: number of candidates, and of rays from each.
_CANDIDATES, _RAYS = 3000, 64
#: Heights of eyes and cameras above the floor.
_EYES_M = (1.2, 1.7)
#: Maximum step of a person on a floor, including stairs; furniture is higher.
_STEP_M = 0.2
#: _BACKS: maximum share of rays from a free place that hit back faces. _ENCLOSED: a place is in a
#: room if the share of horizontal rays that hit a surface is at least this share of the largest
#: one. _FEW: if no more than this share of the places is free, the walls show their back faces to
#: the room, and back faces are ignored.
_BACKS, _ENCLOSED, _FEW = 0.1, 0.6, 0.2


@dataclass(frozen=True, eq=False)
class Hits:
    """First hits of rays of leading shape (...).

    distance (...): in lengths of the ray's direction, inf without a hit. triangle (...): int64, -1
    without a hit. uv (..., 2): barycentric weights of the triangle's second and third corner.
    normal (..., 3): unit normal of the triangle.
    """

    distance: np.ndarray
    triangle: np.ndarray
    uv: np.ndarray
    normal: np.ndarray


class RayCaster:
    """Casts rays at triangles (m, 3), indices into vertices (n, 3) in metres, world. held_out (m,):
    triangles without depth that still occlude.

    Raises InputError if there are no triangles or invalid indices, WorkError if embreex is missing.
    """

    def __init__(
        self, vertices: np.ndarray, triangles: np.ndarray, held_out: np.ndarray | None = None
    ) -> None:
        if not len(triangles):
            raise InputError("a surface with triangles", found="none")
        check_mesh(np.asarray(vertices), np.asarray(triangles))
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError:
            raise WorkError(
                "ray casting needs the package embreex; try: pip install embreex"
            ) from None
        self._scene: Any = EmbreeScene()
        self._held_out = held_out if held_out is not None and held_out.any() else None
        TriangleMesh(self._scene, _packed(vertices), np.ascontiguousarray(triangles, np.int32))

    @classmethod
    def of_model(cls, model: SceneModel) -> "RayCaster":
        """A caster whose triangle k is that of the model."""
        return cls(model.corners_m.reshape(-1, 3), np.arange(3 * len(model)).reshape(-1, 3))

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """Cast rays with directions (..., 3), of any length, from origins (..., 3) or one origin
        (3,).
        """
        shape = directions.shape[:-1]
        origins, directions = (
            _packed(np.broadcast_to(a, (*shape, 3)).reshape(-1, 3)) for a in (origins, directions)
        )
        hit = self._scene.run(origins, directions, output=True)
        triangle = hit["primID"].astype(np.int64)
        distance = np.where(triangle >= 0, hit["tfar"], np.float32(np.inf))
        uv, normal = np.stack([hit["u"], hit["v"]], -1), hit["Ng"]
        normal = normal / np.maximum(
            np.linalg.norm(normal, axis=-1, keepdims=True), np.float32(1e-30)
        )
        return Hits(
            distance.reshape(shape),
            triangle.reshape(shape),
            uv.reshape(*shape, 2),
            normal.reshape(*shape, 3),
        )

    def depth(
        self, camera: PinholeCamera, T_world_camera: SE3, offset_px: Sequence[float] = (0.0, 0.0)
    ) -> np.ndarray:
        """(h, w) planar Z in metres, 0 without a hit.

        Rays have z = 1, so the distance along them is Z.
        """
        rays = camera.rays() + (offset_px[0] / camera.fx, offset_px[1] / camera.fy, 0.0)
        hits = self.cast(T_world_camera.translation, rays @ T_world_camera.rotation.T)
        met = hits.triangle >= 0
        if self._held_out is not None:
            met &= ~self._held_out[hits.triangle]
        return np.where(met, hits.distance, 0.0)


def _packed(numbers: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(numbers, np.float32)


class Visibility:
    """Visibility of the triangles of a model from all poses added so far: `seen` (m, 2), front and
    back of each.

    It is computed by rays through pixels, and by rays to the centroids of triangles that no pixel
    hit.
    """

    def __init__(self, model: SceneModel) -> None:
        self._caster = RayCaster.of_model(model)
        self._centroid = model.corners_m.mean(1)
        a, b, c = np.moveaxis(model.corners_m, 1, 0)
        self._normal = np.cross(b - a, c - a)
        self.seen = np.zeros((len(model), 2), bool)

    def along(
        self, camera: PinholeCamera, T_world_camera: SE3, on_pose: Callable[[], object]
    ) -> None:
        """Add poses (n,): the triangles at pixel centres, then those whose centroid is in the image
        and not occluded.
        """
        for k in range(len(T_world_camera)):
            T = T_world_camera[k]
            rays = camera.rays().reshape(-1, 3) @ T.rotation.T
            triangle = self._caster.cast(T.translation, rays).triangle
            self._mark(triangle[triangle >= 0], rays[triangle >= 0])
            rows = self._in_image(camera, T)
            rays = self._centroid[rows] - T.translation
            hits = self._caster.cast(T.translation, rays)
            reached = (hits.triangle == rows) | (hits.distance > _ARRIVED)
            self._mark(rows[reached], rays[reached])
            on_pose()

    def _in_image(self, camera: PinholeCamera, T_world_camera: SE3) -> np.ndarray:
        """(k,) triangles whose side towards the camera was not seen yet, and whose centroid
        projects into the image.
        """
        towards = (
            np.einsum("ij,ij->i", self._centroid - T_world_camera.translation, self._normal) < 0
        )
        rows = np.flatnonzero(~np.where(towards, self.seen[:, FRONT], self.seen[:, BACK]))
        return rows[_in_image(self._centroid[rows], camera, T_world_camera)]

    def _mark(self, rows: np.ndarray, rays: np.ndarray) -> None:
        side = np.where(np.einsum("ij,ij->i", rays, self._normal[rows]) < 0, FRONT, BACK)
        self.seen[rows, side] = True


def seen_points(
    caster: RayCaster,
    points_m: np.ndarray,
    camera: PinholeCamera,
    T_world_camera: SE3,
    far_m: float = np.inf,
    on_pose: Callable[[], object] | None = None,
    sides: np.ndarray | None = None,
) -> np.ndarray:
    """(n,) bool: the points (n, 3) on the surface that at least one pose (k,) saw: inside its
    image, in front of it, at a depth of at most far_m, and not occluded. With normals `sides` (n,
    3): seen from that side of the surface.
    """
    seen = np.zeros(len(points_m), bool)
    for k in range(len(T_world_camera)):
        rows = np.flatnonzero(~seen)
        rows = rows[_in_image(points_m[rows], camera, T_world_camera[k], far_m)]
        rays = points_m[rows] - T_world_camera[k].translation
        if sides is not None:
            before = (rays * sides[rows]).sum(1) < 0
            rows = rows[before]
            rays = rays[before]
        seen[rows] = caster.cast(T_world_camera[k].translation, rays).distance > _REACHED
        if on_pose:
            on_pose()
    return seen


def _in_image(
    points_m: np.ndarray, camera: PinholeCamera, T_world_camera: SE3, far_m: float = np.inf
) -> np.ndarray:
    """(n,) bool: in front of the camera, at a depth of at most far_m, and inside the image; points
    (n, 3) in the world.
    """
    points = T_world_camera.inverse().apply(points_m)
    inside = (points[:, 2] > 1e-3) & (points[:, 2] <= far_m)
    u, v = camera.project(points[inside]).T
    inside[inside] = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
    return inside


def viewpoints(
    space: FreeSpace, caster: RayCaster, count: int, clear_m: float, seed: int
) -> list[Waypoint]:
    """`count` waypoints above one connected floor, ordered for short routes.

    Raises InputError if there are not enough free places.
    """
    if not 2 <= count <= 100:
        raise InputError("2 to 100 viewpoints", found=count)
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(_RAYS, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    places, largest = np.zeros((0, 3)), 0
    for margin_m in MARGINS_M:
        places = _camera_places(space, caster, clear_m + margin_m, rays, rng)
        largest = max(largest, len(places))
        if len(places) >= count:
            break
    if len(places) < count:
        low, high = _EYES_M
        expected = f"a floor with {count} places free of surfaces {low} to {high} m above it, connected to one another"
        fewer = f"auto:{largest}, " if largest > 1 else ""
        hint = f"{fewer}a smaller {{clearance_m}}, another {{unit_m}} if the scene's size is wrong, or given viewpoints"
        height = space.cell_m * (space.clearance_m.shape[2] - 1)
        raise InputError(expected, found=f"{largest} in a scene {height:.2g} m high", hint=hint)
    places = farthest_points(places, count)
    remaining, order = list(range(1, count)), [0]
    while remaining:  # always to the nearest remaining one
        here = places[order[-1]]
        order.append(
            remaining.pop(int(np.argmin([np.linalg.norm(places[k] - here) for k in remaining])))
        )
    places = places[order]
    return [Waypoint(rounded(p), rounded(_gaze(p, places, caster, rays))) for p in places]


def _camera_places(
    space: FreeSpace, caster: RayCaster, clear_m: float, rays: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(n, 3) places where a person can hold a camera: those in rooms, above the largest connected
    floor.

    Table tops are separate floors, because the step to them is too high. So are rooms that are not
    connected.
    """
    from scipy import ndimage

    cells = np.argwhere(space.clearance_m >= clear_m)
    places = space.low_m + space.cell_m * cells
    below = (
        _cast_from(caster, places, np.array([[0.0, 0.0, -1.0]]))[0][:, 0]
        if len(places)
        else np.zeros(0)
    )
    slack = max(space.cell_m - 0.3, 0.0)  # with coarse cells there may be no layer at eye height
    at_eyes = (below >= _EYES_M[0] - slack) & (below <= _EYES_M[1] + slack)
    cells, places, below = cells[at_eyes], places[at_eyes], below[at_eyes]
    if not len(cells):
        return places
    floors = places[:, 2] - below
    steps = np.rint((floors - floors.min()) / _STEP_M).astype(int)
    walked = np.zeros((*space.clearance_m.shape[:2], steps.max() + 1), bool)
    walked[cells[:, 0], cells[:, 1], steps] = True
    floor = ndimage.label(walked, np.ones((3, 3, 3)))[0][cells[:, 0], cells[:, 1], steps]
    part = ndimage.label(space.clearance_m >= clear_m, np.ones((3, 3, 3)))[0][tuple(cells.T)]
    group = floor * (part.max() + 1) + part
    places[:, 2] = floors + below.clip(*_EYES_M)
    sampled = rng.permutation(len(places))[:_CANDIDATES]
    sampled = sampled[_in_rooms(places[sampled], caster, rays)]
    names, counts = np.unique(group[sampled], return_counts=True)
    return places[sampled[group[sampled] == names[counts.argmax()]]] if len(sampled) else places[:0]


def _in_rooms(places: np.ndarray, caster: RayCaster, rays: np.ndarray) -> np.ndarray:
    """(n,) whether a place is surrounded by walls.

    Back faces mean that it is inside an object, unless all walls show their back faces.
    """
    distance, back = _cast_from(caster, places, rays)
    met, free = np.isfinite(distance), back.mean(1) < _BACKS
    free = free if free.mean() > _FEW else np.ones(len(places), bool)
    around = met[:, np.abs(rays[:, 2]) < 0.3].mean(1)
    return free & (around > 0) & (around >= _ENCLOSED * around[free].max(initial=0.0))


def _cast_from(
    caster: RayCaster, places: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """From places (n, 3) along unit directions (d, 3): distance (n, d), inf without a hit, and
    whether a back face was hit (n, d).
    """
    shape = (len(places), len(directions), 3)
    hits = caster.cast(np.broadcast_to(places[:, None], shape), np.broadcast_to(directions, shape))
    distance = hits.distance.astype(float)
    return distance, np.isfinite(distance) & ((hits.normal * directions).sum(-1) > 0)


def _gaze(place: np.ndarray, places: np.ndarray, caster: RayCaster, rays: np.ndarray) -> np.ndarray:
    """A target across the room: in the direction of the centre of all viewpoints or of a large
    distance, slightly downwards.
    """
    middle = places.mean(0) - place
    level = rays[np.abs(rays[:, 2]) < 0.3]
    far = np.minimum(_cast_from(caster, place[None], level)[0][0], 10.0)
    towards = level @ (middle / max(float(np.linalg.norm(middle)), 1e-6))
    ahead = level[int((far * (1.2 + towards)).argmax())]
    return (
        place + 2.0 * np.array([ahead[0], ahead[1], 0.0]) / np.hypot(*ahead[:2]) + [0.0, 0.0, -0.25]
    )
