"""Held-out views: far from every training view, and showing only surfaces that training views saw;
checked or chosen by ray casting.
"""

from dataclasses import dataclass

import numpy as np

from ..console import Meter, advance_of
from ..errors import InputError
from ..geometry import so3
from ..geometry.camera import CameraOrText, PinholeCamera
from ..geometry.handheld import rotation_world_camera
from ..geometry.se3 import SE3, Poses
from ..shown import Brief
from .caster import RayCaster
from .visibility import seen_points

#: A view is new if its distance to every training view is at least this ...
MIN_DISTANCE_M = 0.5
#: ... or the angle between their viewing directions is.
MIN_ANGLE_DEG = 20.0
#: Maximum share of a view's pixels whose surface no training view saw.
MAX_UNSEEN = 0.01
#: Approximate number of rays of a view: every 4th pixel of every 4th row of 640 x 480.
_RAYS = 19_200
#: Minimum distance of a chosen view from any surface.
_CLEAR_M = 0.25
_HINT = "a number of views, which are then chosen"


@dataclass(frozen=True, repr=False)
class HeldOutView(Brief):
    """distance_m and angle_deg (between viewing directions) to the most similar training view;
    unseen: share of its pixels whose surface no training view saw.
    """

    distance_m: float
    angle_deg: float
    unseen: float

    @property
    def is_new(self) -> bool:
        """At least MIN_DISTANCE_M or MIN_ANGLE_DEG from every training view."""
        return self.distance_m >= MIN_DISTANCE_M or self.angle_deg >= MIN_ANGLE_DEG


def check_held_out(
    caster: RayCaster,
    camera: CameraOrText,
    T_world_view: Poses,
    T_world_training: Poses,
    progress: Meter = None,
) -> list[HeldOutView]:
    """Compare views (n,) with training views (k,) of the same camera, all in the caster's world.
    About 19,200 rays represent a view's pixels; a training view sees a surface only from its side.
    progress: as of render_frames().

    Raises InputError if a view is not new, or more than MAX_UNSEEN of it was not seen by training
    views.
    """
    camera = PinholeCamera.of(camera)
    views = list(SE3.of(T_world_view))
    on_view = advance_of(progress, len(views), "held-out views, checked", "views")
    T_world_training = SE3.of(T_world_training)
    nearest = [_nearest(view, T_world_training) for view in views]
    _refuse_near(nearest)
    found_views = []
    for k, (view, place) in enumerate(zip(views, nearest, strict=True)):
        found_views.append(HeldOutView(*place, _unseen(caster, camera, view, T_world_training)))
        if found_views[-1].unseen > MAX_UNSEEN:
            expected = (
                f"held-out views with at most {MAX_UNSEEN:.0%} of pixels whose surface no training "
                "view saw"
            )
            found = f"view {k} with {found_views[-1].unseen:.1%}"
            raise InputError(expected, found=found, hint=_HINT)
        on_view()
    return found_views


def _refuse_near(nearest: list[tuple[float, float]]) -> None:
    """Raises InputError unless every view is new, by its distances to the nearest training view."""
    near = [k for k, place in enumerate(nearest) if not HeldOutView(*place, 0.0).is_new]
    if not near:
        return
    limits = f"{MIN_DISTANCE_M:g} m or {MIN_ANGLE_DEG:g} degrees"
    distance_m, angle_deg = nearest[near[0]]
    found = f"view {near[0]} at {distance_m:.3f} m and {angle_deg:.1f} degrees"
    if len(near) > 1:
        found += f", and {len(near) - 1} more"
    raise InputError(f"held-out views {limits} from every training view", found=found, hint=_HINT)


def choose_held_out(
    caster: RayCaster,
    camera: CameraOrText,
    T_world_training: Poses,
    count: int,
    seed: int = 0,
    progress: Meter = None,
) -> SE3:
    """Choose `count` views (n,) that `check_held_out` accepts. They are also new relative to each
    other, at least 0.25 m from surfaces, and visible from the position of a training view.

    They have no roll relative to the z axis of the world. The same arguments give the same views.
    progress: as of render_frames(). Raises InputError if too few are found.
    """
    camera = PinholeCamera.of(camera)
    on_view = advance_of(progress, count, "held-out views", "views")
    T_world_training = SE3.of(T_world_training)
    rng = np.random.default_rng(seed)
    chosen = SE3.identity((0,))
    some = T_world_training[:: -(-len(T_world_training) // 100)]  # for a first, rough check
    for _ in range(1000 * count):
        view = _candidate(caster, T_world_training, rng)
        if view is None or not all(_is_new(view, T) for T in (T_world_training, chosen)):
            continue
        if _unseen(caster, camera, view, some, 800) > MAX_UNSEEN:
            continue
        # half of the limit, because rays do not go through all pixels
        if _unseen(caster, camera, view, T_world_training) <= MAX_UNSEEN / 2:
            places = np.array([*chosen.translation, view.translation])
            chosen = SE3(np.array([*chosen.rotation, view.rotation]), places)
            on_view()
        if len(chosen) == count:
            return chosen
    expected = (
        f"{count} views of what training saw, {MIN_DISTANCE_M:g} m or {MIN_ANGLE_DEG:g} degrees "
        "from its views and each other"
    )
    raise InputError(expected, found=len(chosen), hint="fewer, or training views that see more")


def _candidate(caster: RayCaster, T_world_training: SE3, rng: np.random.Generator) -> SE3 | None:
    """A view without roll of a point that a training view sees, from a position nearer to the
    point, or between two training views. None if the position is too close to a surface, or not
    visible from the training view.
    """
    row, other_row = rng.integers(len(T_world_training), size=2)
    training = T_world_training[int(row)]
    ray = training.rotation @ [*rng.uniform((-0.3, -0.2), (0.3, 0.2)), 1.0]
    distance = float(caster.cast(training.translation, ray[None]).distance[0])
    around = rng.normal(scale=(np.radians(30), 0.1)) * rng.random()
    nearer = rng.uniform(0.3, 1.1)
    between = rng.random()
    offset = rng.normal(scale=0.15, size=3)
    is_between = rng.random() < 0.5
    if not np.isfinite(distance):
        return None
    point = training.translation + distance * ray
    way = T_world_training[int(other_row)].translation - training.translation
    place = training.translation + between * way + offset
    if not is_between:
        rotated = so3.exp(np.array([0.0, 0.0, around[0]])) @ (training.translation - point)
        place = point + nearer * rotated + [0.0, 0.0, around[1] * distance]
    gaze = point - place
    across = float(np.hypot(gaze[0], gaze[1]))
    if across < 0.3 or not _is_free(caster, place, training.translation):
        return None
    angles = np.array([[np.arctan2(gaze[1], gaze[0])], [np.arctan2(gaze[2], across)], [0.0]])
    return SE3(rotation_world_camera(*angles)[0], place)


def _is_free(caster: RayCaster, place: np.ndarray, seen_from: np.ndarray) -> bool:
    """Whether no surface is within _CLEAR_M of `place`, along rays in all directions, or between it
    and `seen_from`.
    """
    sides = 64
    k = np.arange(sides) + 0.5  # spiral over the sphere
    azimuth = np.pi * (1 + 5**0.5) * k
    z = 1 - 2 * k / sides
    across = np.sqrt(1 - z * z)
    rays = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], -1)
    sight = caster.cast(seen_from, (place - seen_from)[None]).distance[0]
    return bool(caster.cast(place, rays).distance.min() >= _CLEAR_M and sight > 1)


def _is_new(view: SE3, others: SE3) -> bool:
    return not len(others) or HeldOutView(*_nearest(view, others), 0.0).is_new


def _nearest(view: SE3, others: SE3) -> tuple[float, float]:
    """Distance in metres and angle in degrees between the view and the most similar of the others
    (k,).
    """
    distance_m = np.linalg.norm(others.translation - view.translation, axis=-1)
    ahead = view.rotation[:, 2]
    their_ahead = others.rotation[..., 2]
    sine = np.linalg.norm(np.cross(their_ahead, ahead), axis=-1)
    angle_deg = np.degrees(np.arctan2(sine, their_ahead @ ahead))
    k = int(np.maximum(distance_m / MIN_DISTANCE_M, angle_deg / MIN_ANGLE_DEG).argmin())
    return float(distance_m[k]), float(angle_deg[k])


def _unseen(
    caster: RayCaster, camera: PinholeCamera, view: SE3, T_world_training: SE3, count: int = _RAYS
) -> float:
    """Share of a view's pixels that show a side of a surface that no training view saw; pixels
    without a surface count as seen.
    """
    step = max(1, int((camera.width * camera.height / count) ** 0.5))
    rays = camera.rays()[step // 2 :: step, step // 2 :: step].reshape(-1, 3) @ view.rotation.T
    hits = caster.cast(view.translation, rays)
    met = np.isfinite(hits.distance)
    towards = rays[met]
    points = view.translation + hits.distance[met, None].astype(float) * towards
    sides = hits.normal[met]
    sides = sides * np.where((sides * towards).sum(1) > 0, -1.0, 1.0)[:, None]
    away_m = np.linalg.norm(T_world_training.translation - view.translation, axis=-1)
    order = away_m.argsort(kind="stable")
    for start in range(0, len(order), 8):  # the nearest views usually saw most points
        some = T_world_training[order[start : start + 8]]
        remaining = ~seen_points(caster, points, camera, some, sides=sides)
        points = points[remaining]
        sides = sides[remaining]
        if not len(points):
            break
    return len(points) / len(rays)
