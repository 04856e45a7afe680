"""Viewing directions along a route: towards what there is to see, with the pitch and the range of
our kt0..kt3.
"""

import numpy as np

from ..geometry.handheld import rotation_world_camera
from ..geometry.se3 import SE3
from .caster import RayCaster

#: Surfaces that are farther away are not worth a view.
FAR_M = 8.0
#: Pitch of kt0..kt3 of both scenes, and the median distance of what is in view: their quantiles 5,
#: 25, 50, 75 and 95 %.
_PITCHES_RAD = np.radians([-24.0, -17.0, -12.0, -8.0, -1.0])
_RANGES_M = np.array([1.7, 2.1, 2.9, 3.5, 4.0])
#: Yaws that are compared, each with all pitches.
_YAWS_RAD = np.arange(24) * (2 * np.pi / 24)
#: Maximum rotation to the next point, so that all that is seen between is in one of the two views.
_MAX_TURN_RAD = np.radians(45.0)


def directions(points: np.ndarray, stops: np.ndarray, caster: RayCaster, seed: int) -> np.ndarray:
    """Unit viewing directions (n, 3) at points (n, 3) of a route, of which those with the indices
    `stops` are viewpoints.

    Of all sequences of views it is the one that shows most of the surfaces, with little rotation,
    while pitch and range go from viewpoint to viewpoint through those of kt0..kt3, in an order by
    `seed`. As bad as a view of half as many surfaces are a range that is wrong by a factor of 2, a
    pitch that is wrong by its standard deviation, and a rotation by half a turn.
    """
    yaws, pitches = (part.ravel() for part in np.meshgrid(_YAWS_RAD, _PITCHES_RAD))
    views = rotation_world_camera(yaws, pitches, np.zeros_like(yaws))
    distance_m = np.stack([_distances(views, point, caster) for point in points])
    shares = (distance_m <= FAR_M).mean(-1).clip(1e-3)
    ranges_m = np.median(distance_m.clip(1e-3, FAR_M), axis=-1)
    rng = np.random.default_rng(seed)
    pitch = _through(rng.permutation(_PITCHES_RAD), stops)
    range_m = _through(rng.permutation(_RANGES_M), stops)
    costs = np.log2(shares) ** 2 + np.log2(ranges_m / range_m) ** 2
    costs += ((pitches - pitch) / _PITCHES_RAD.std()) ** 2
    yaw_steps = (yaws[:, None] - yaws + np.pi) % (2 * np.pi) - np.pi
    turns_rad = np.hypot(yaw_steps, pitches[:, None] - pitches)
    steps = np.where(turns_rad < 1.01 * _MAX_TURN_RAD, (turns_rad / np.pi) ** 2, np.inf)
    return views[_cheapest(costs, steps), :, 2]


def shares_seen(T_world_camera: SE3, caster: RayCaster) -> np.ndarray:
    """The share of the view that surfaces within FAR_M fill, for each of n poses."""
    poses = zip(T_world_camera.rotation, T_world_camera.translation, strict=True)
    distance_m = np.array([_distances(rotation, place, caster) for rotation, place in poses])
    return (distance_m <= FAR_M).mean(1)


def _distances(rotations: np.ndarray, place: np.ndarray, caster: RayCaster) -> np.ndarray:
    """Distances (..., 140) of the surfaces that the default camera sees from a place with rotations
    (..., 3, 3), inf where it sees none.
    """
    x, y = np.meshgrid(np.linspace(-0.66, 0.66, 14), np.linspace(-0.5, 0.5, 10))
    rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return caster.cast(place, rays @ np.swapaxes(rotations, -1, -2)).distance


def _through(quantiles: np.ndarray, stops: np.ndarray) -> np.ndarray:
    """(n, 1) for the n points up to the last stop: one of the quantiles at each stop, and linear
    between them.
    """
    wanted = np.resize(quantiles, len(stops))
    return np.interp(np.arange(stops[-1] + 1), stops, wanted)[:, None]


def _cheapest(costs: np.ndarray, steps: np.ndarray) -> list[int]:
    """The sequence of choices (n,) with the least sum of their costs (n, v), and of those of each
    step (v, v) from one to the next: by dynamic programming.
    """
    total = costs[0]
    before = []
    for cost in costs[1:]:
        sums = total[:, None] + steps
        before.append(sums.argmin(0))
        total = sums.min(0) + cost
    chosen = [int(total.argmin())]
    for choice in reversed(before):
        chosen.append(int(choice[chosen[-1]]))
    return chosen[::-1]
