"""Rays against triangles, what a camera saw of them, and viewpoints in their free space: Embree, by way of embreex. Nothing else asks it for rays."""

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

#: A centroid is seen where the ray to it gets this far, as a share of its length.
_ARRIVED = 1 - 1e-4
#: A point that lies on the surface in double precision needs less: Embree counts in single precision. At 3 m it is seen 0.1 mm behind another.
_REACHED = 1 - 3e-5
FRONT, BACK = 0, 1
#: Viewpoints: places tried, and rays from each.
_CANDIDATES, _RAYS = 3000, 64
#: Heights above the floor that eyes and cameras are held at.
_EYES_M = (1.2, 1.7)
#: A step that a person takes on a floor, stairs included; furniture is higher.
_STEP_M = 0.2
#: A free place sees no more backs than this; of free places those in rooms see nearly as many surfaces around them as any.
#: Where no more than this share of them is free of backs, the walls show their backs to the room.
_BACKS, _ENCLOSED, _FEW = 0.1, 0.6, 0.2


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays of leading shape (...) meet first.

    distance (...): in lengths of the ray's direction, inf where nothing is met. triangle (...): int64, -1 where nothing is met.
    uv (..., 2): barycentric weights of the triangle's second and third corner. normal (..., 3): of the triangle, of length one.
    """

    distance: np.ndarray
    triangle: np.ndarray
    uv: np.ndarray
    normal: np.ndarray


class RayCaster:
    """Of triangles (m, 3), indices into vertices (n, 3) in metres, world. held_out (m,): those that have no depth, but hide what is behind.

    Raises InputError for no triangles, WorkError where embreex is missing.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, held_out: np.ndarray | None = None) -> None:
        if not len(triangles):
            raise InputError("a surface with triangles", found="none")
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError:
            raise WorkError("ray casting needs the package embreex; try: pip install embreex") from None
        self._scene: Any = EmbreeScene()
        self._held_out = held_out if held_out is not None and held_out.any() else None
        TriangleMesh(self._scene, _packed(vertices), np.ascontiguousarray(triangles, np.int32))

    @classmethod
    def of_model(cls, model: SceneModel) -> "RayCaster":
        """Triangle k is the model's."""
        return cls(model.corners_m.reshape(-1, 3), np.arange(3 * len(model)).reshape(-1, 3))

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """Rays of directions (..., 3), of any length, from origins (..., 3) or one origin (3,)."""
        shape = directions.shape[:-1]
        origins, directions = (_packed(np.broadcast_to(a, (*shape, 3)).reshape(-1, 3)) for a in (origins, directions))
        hit = self._scene.run(origins, directions, output=True)
        triangle = hit["primID"].astype(np.int64)
        distance = np.where(triangle >= 0, hit["tfar"], np.float32(np.inf))
        uv, normal = np.stack([hit["u"], hit["v"]], -1), hit["Ng"]
        normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), np.float32(1e-30))
        return Hits(distance.reshape(shape), triangle.reshape(shape), uv.reshape(*shape, 2), normal.reshape(*shape, 3))

    def depth(self, camera: PinholeCamera, T_world_camera: SE3, offset_px: Sequence[float] = (0.0, 0.0)) -> np.ndarray:
        """(h, w) planar Z in metres, 0 where a ray meets nothing. Rays have z = 1, so the distance along them is Z itself."""
        rays = camera.rays() + (offset_px[0] / camera.fx, offset_px[1] / camera.fy, 0.0)
        hits = self.cast(T_world_camera.translation, rays @ T_world_camera.rotation.T)
        met = hits.triangle >= 0
        if self._held_out is not None:
            met &= ~self._held_out[hits.triangle]
        return np.where(met, hits.distance, 0.0)


def _packed(numbers: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(numbers, np.float32)


class Visibility:
    """Which triangles of a model were seen from the poses added so far: `seen` (m, 2), front and back of each.

    By rays through pixels, and rays to the centroids of triangles that no pixel met.
    """

    def __init__(self, model: SceneModel) -> None:
        self._caster = RayCaster.of_model(model)
        self._centroid = model.corners_m.mean(1)
        a, b, c = np.moveaxis(model.corners_m, 1, 0)
        self._normal = np.cross(b - a, c - a)
        self.seen = np.zeros((len(model), 2), bool)

    def along(self, camera: PinholeCamera, T_world_camera: SE3, on_pose: Callable[[], object]) -> None:
        """Poses (n,): what pixel centres see, then triangles whose centroid is in the image with nothing in front of it."""
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
        """(k,) triangles whose visible side was not seen yet and whose centroid projects into the image."""
        towards = np.einsum("ij,ij->i", self._centroid - T_world_camera.translation, self._normal) < 0
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
    far_m: float,
    on_pose: Callable[[], object],
    sides: np.ndarray | None = None,
) -> np.ndarray:
    """(n,) which points (n, 3) on the surface some pose (k,) saw: inside its image, before it, at no more depth than far_m, and with
    nothing between; where `sides` (n, 3) point away from the surface, from that side.
    """
    seen = np.zeros(len(points_m), bool)
    for k in range(len(T_world_camera)):
        rows = np.flatnonzero(~seen)
        rows = rows[_in_image(points_m[rows], camera, T_world_camera[k], far_m)]
        rays = points_m[rows] - T_world_camera[k].translation
        if sides is not None:
            before = (rays * sides[rows]).sum(1) < 0
            rows, rays = rows[before], rays[before]
        seen[rows] = caster.cast(T_world_camera[k].translation, rays).distance > _REACHED
        on_pose()
    return seen


def _in_image(points_m: np.ndarray, camera: PinholeCamera, T_world_camera: SE3, far_m: float = np.inf) -> np.ndarray:
    """(n,) bool: before the camera, not beyond far_m, and on one of its pixels; points (n, 3) in the world."""
    points = T_world_camera.inverse().apply(points_m)
    inside = (points[:, 2] > 1e-3) & (points[:, 2] <= far_m)
    u, v = camera.project(points[inside]).T
    inside[inside] = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
    return inside


def viewpoints(space: FreeSpace, caster: RayCaster, count: int, clear_m: float, seed: int) -> list[Waypoint]:
    """`count` waypoints in an order with short routes, above one connected floor. Raises InputError where there is no room for them."""
    if not 2 <= count <= 100:
        raise InputError("2 to 100 viewpoints", found=count)
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(_RAYS, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    places, most = np.zeros((0, 3)), 0
    for margin_m in MARGINS_M:
        places = _standing(space, caster, clear_m + margin_m, rays, rng)
        most = max(most, len(places))
        if len(places) >= count:
            break
    if len(places) < count:
        low, high = _EYES_M
        expected = f"a floor with {count} places free of surfaces {low} to {high} m above it, connected to one another"
        fewer = f"auto:{most}, " if most > 1 else ""
        hint = (
            f"{fewer}a smaller {{clearance_m}}, another {{unit_m}} if the scene's size is wrong, or places of your own"
        )
        height = space.cell_m * (space.clearance_m.shape[2] - 1)
        raise InputError(expected, found=f"{most} in a scene {height:.2g} m high", hint=hint)
    places = farthest_points(places, count)
    left, order = list(range(1, count)), [0]
    while left:  # from one to the nearest that is left
        here = places[order[-1]]
        order.append(left.pop(int(np.argmin([np.linalg.norm(places[k] - here) for k in left]))))
    places = places[order]
    return [Waypoint(rounded(p), rounded(_gaze(p, places, caster, rays))) for p in places]


def _standing(
    space: FreeSpace, caster: RayCaster, clear_m: float, rays: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(n, 3) places where a person could hold a camera: of those in rooms, the ones above the largest floor that can be walked over.

    Table tops are floors of their own, as a step leads there that nobody takes; rooms without a way are, too.
    """
    from scipy import ndimage

    cells = np.argwhere(space.clearance_m >= clear_m)
    places = space.low_m + space.cell_m * cells
    below = _look(caster, places, np.array([[0.0, 0.0, -1.0]]))[0][:, 0] if len(places) else np.zeros(0)
    slack = max(space.cell_m - 0.3, 0.0)  # coarse cells may leave no layer at eye height
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
    kept = rng.permutation(len(places))[:_CANDIDATES]
    kept = kept[_in_rooms(places[kept], caster, rays)]
    names, counts = np.unique(group[kept], return_counts=True)
    return places[kept[group[kept] == names[counts.argmax()]]] if len(kept) else places[:0]


def _in_rooms(places: np.ndarray, caster: RayCaster, rays: np.ndarray) -> np.ndarray:
    """(n,) whether walls stand around; backs mean a place inside of something, unless all walls show theirs."""
    distance, back = _look(caster, places, rays)
    met, free = np.isfinite(distance), back.mean(1) < _BACKS
    free = free if free.mean() > _FEW else np.ones(len(places), bool)
    around = met[:, np.abs(rays[:, 2]) < 0.3].mean(1)
    return free & (around > 0) & (around >= _ENCLOSED * around[free].max(initial=0.0))


def _look(caster: RayCaster, places: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From places (n, 3) along unit directions (d, 3): distance (n, d), inf where nothing is met, and whether a back was met (n, d)."""
    shape = (len(places), len(directions), 3)
    hits = caster.cast(np.broadcast_to(places[:, None], shape), np.broadcast_to(directions, shape))
    distance = hits.distance.astype(float)
    return distance, np.isfinite(distance) & ((hits.normal * directions).sum(-1) > 0)


def _gaze(place: np.ndarray, places: np.ndarray, caster: RayCaster, rays: np.ndarray) -> np.ndarray:
    """A point ahead, across the room: towards the middle of all viewpoints, or where it is far, a little down."""
    middle = places.mean(0) - place
    level = rays[np.abs(rays[:, 2]) < 0.3]
    far = np.minimum(_look(caster, place[None], level)[0][0], 10.0)
    towards = level @ (middle / max(float(np.linalg.norm(middle)), 1e-6))
    ahead = level[int((far * (1.2 + towards)).argmax())]
    return place + 2.0 * np.array([ahead[0], ahead[1], 0.0]) / np.hypot(*ahead[:2]) + [0.0, 0.0, -0.25]
