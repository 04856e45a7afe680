"""Depth images against the poses of their frames: do they agree, and if not, which other reading of
the poses or of the depth explains both?

The explanations compete. Residuals are relative to depth and lengths are compared as a ratio of
poses to depth, so that a smaller unit is no better by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .depth_pairs import DepthPairs, LoadDepth
from .pose_readings import (
    AS_READ,
    STILL,
    Reading,
    discrete,
    of_camera,
    other_cameras,
    scaled,
    with_arm,
)

#: Relative residual that right poses may have: a constant, and a share of the noise of a pixel.
_EXACT = 1e-4
_NOISE_SHARE = 0.2
#: An explanation leaves a residual of at most this multiple of the noise of a pixel, or something
#: else is wrong, too.
_NOISE_LEFT = 4
#: An explanation has at most this share of the residual of the poses as read, and every explanation
#: of another kind at least `_CLEARLY` times its residual.
_AT_MOST = 0.5
_CLEARLY = 1.25
#: Above this relative residual poses and depth do not match, whatever explains it.
MISMATCH = 0.02
#: Fewer pairs cannot be divided into those that choose an explanation and those that test it.
_MIN_PAIRS = 4
#: Pairs and share of the points that choose the candidates, and number of candidates.
_SCREENED_PAIRS = 8
_SCREENED_STEP = 3
_CANDIDATES = 8
#: Ratios of poses to depth that are tried: logarithms to the base 10, and the last step of the
#: search.
_DECADES = np.linspace(-4, 4, 81)
_LAST_STEP = 2e-4
#: First steps of the search for an arm, as a share of the depth, and for a principal point, as a
#: share of the image; how often steps are halved; focal lengths that are tried, as logarithms.
_FIRST_ARM = 0.05
_FIRST_CENTRE = 0.04
_HALVINGS = 6
_FOCAL_DECADES = np.linspace(-0.4, 0.4, 17)


@dataclass(frozen=True, eq=False)
class Agreement:
    """How well poses and depth agree. residual: mean relative difference in depth between pairs of
    images with the poses as read, NaN without pairs; explained: the same with `reading`, the one
    that explains the images. told: whether the images move enough to tell. matches: False if poses
    and depth differ by more than sensors do. depth_m: median depth as read.
    """

    residual: float = float("nan")
    told: bool = False
    matches: bool = True
    reading: Reading = AS_READ
    explained: float = float("nan")
    depth_m: float = float("nan")

    @property
    def doubtful(self) -> bool:
        """Whether there is a reason for a warning."""
        return not self.matches or self.reading is not AS_READ


def agreement(load: LoadDepth, T_world_camera: SE3, camera: PinholeCamera) -> Agreement:
    """Compare the depth images of n frames with their poses (n,).

    load(i): planar depth in metres, (h, w) as the camera's, 0 = missing; None if unknown. At most
    25 frames are read.
    """
    pairs = DepthPairs.of(load, T_world_camera, camera)
    pairs = pairs[np.isfinite(AS_READ.residuals(pairs, T_world_camera))]
    if len(pairs) < _MIN_PAIRS:
        return Agreement()
    residual = AS_READ.residual(pairs, T_world_camera)
    still = STILL.residual(pairs, T_world_camera)
    told = still >= _CLEARLY * max(residual, _EXACT)
    found = Agreement(residual, told, depth_m=pairs.depth_m)
    if residual <= _EXACT + _NOISE_SHARE * pairs.noise:
        return found
    explanations = _explanations(pairs, T_world_camera)
    kinds = {each.kind for each in explanations}
    if kinds == {"unit", "arm"}:
        both = {each.kind: each for each in explanations[::-1]}
        best = Reading(
            "either", f"{both['unit'].detail};{both['arm'].detail}", both["unit"].motions
        )
        explained = both["unit"].residual(pairs, T_world_camera)
        return replace(found, told=True, reading=best, explained=explained)
    if len(kinds) == 1 and STILL not in explanations:
        best = explanations[0]
        explained = best.residual(pairs, T_world_camera)
        if best.kind == "unit":
            best = _measured_again(best, load, T_world_camera, camera)
        return replace(found, told=True, reading=best, explained=explained)
    return replace(found, matches=residual <= MISMATCH and not explanations)


def _explanations(pairs: DepthPairs, T: SE3) -> list[Reading]:
    """The readings that explain the images: the best one first, and those that are nearly as good.

    Half of the pairs choose them, the other half tests the best one.
    """
    chooses = pairs[::2]
    candidates = _candidates(chooses, T)
    totals = np.array([each.residual(chooses, T) for each in candidates])
    best = candidates[int(np.argmin(totals))]
    if not (_halves(best, chooses, T) and _halves(best, pairs[1::2], T)):
        return []
    nearly = np.flatnonzero(totals < _CLEARLY * totals.min())
    return [candidates[i] for i in nearly[np.argsort(totals[nearly])]]


def _halves(reading: Reading, pairs: DepthPairs, T: SE3) -> bool:
    """Whether the residual is at most half of that of the poses as read; a quarter if it is larger
    than noise explains.
    """
    explained = reading.residuals(pairs, T)
    usable = np.isfinite(explained)
    as_read = AS_READ.residuals(pairs[usable], T)
    share = _AT_MOST
    if usable.any() and explained[usable].mean() > _EXACT + _NOISE_LEFT * pairs.noise:
        share /= 2
    return bool(usable.any()) and explained[usable].mean() <= share * as_read.mean()


def _candidates(pairs: DepthPairs, T: SE3) -> list[Reading]:
    """The readings with the smallest residuals of some of the pairs and of their points."""
    few = pairs[:: -(-len(pairs) // _SCREENED_PAIRS)].thinned(_SCREENED_STEP)
    readings = [STILL, *discrete()]
    if (factor := _best_factor(few, T)) is not None:
        readings.append(scaled(factor))
    camera = next(iter(pairs.blocks.values())).camera
    readings += other_cameras(camera)
    readings += _of_other_cameras(few, T, camera)
    readings.append(_best_arm(few, T))
    totals = [reading.residual(few, T) for reading in readings]
    return [readings[i] for i in np.argsort(totals)[:_CANDIDATES]]


def _best_arm(pairs: DepthPairs, T: SE3) -> Reading:
    """Where the camera is on the body whose poses these are."""

    def left(arm_m: np.ndarray) -> float:
        return with_arm(arm_m).residual(pairs, T)

    return with_arm(_lowest(left, np.zeros(3), _FIRST_ARM * pairs.depth_m))


def _of_other_cameras(pairs: DepthPairs, T: SE3, camera: PinholeCamera) -> list[Reading]:
    """The best focal length, and the best principal point."""
    size = np.array([camera.width, camera.height])

    def focal(decade: np.ndarray) -> Reading:
        factor = float(10 ** decade[0])
        return of_camera(replace(camera, fx=factor * camera.fx, fy=factor * camera.fy))

    def centre(moved: np.ndarray) -> Reading:
        cx, cy = (camera.cx, camera.cy) + size * moved
        return of_camera(replace(camera, cx=float(cx), cy=float(cy)))

    tried = [np.array([decade]) for decade in _FOCAL_DECADES]
    start = min(tried, key=lambda one: focal(one).residual(pairs, T))
    step = float(_FOCAL_DECADES[1] - _FOCAL_DECADES[0])
    best = _lowest(lambda one: focal(one).residual(pairs, T), start, step)
    moved = _lowest(lambda one: centre(one).residual(pairs, T), np.zeros(2), _FIRST_CENTRE)
    return [focal(best), centre(moved)]


def _lowest(cost: Callable[[np.ndarray], float], start: np.ndarray, step: float) -> np.ndarray:
    """The place (d,) near the start with the lowest cost, by steps to all sides that halve."""
    cost_at = cache(lambda *place: cost(np.array(place)))  # most places are tried again
    last = step / 2**_HALVINGS
    while step > last:
        around = [start + step * np.array(one) for one in product((-1, 0, 1), repeat=len(start))]
        costs = [cost_at(*place) for place in around]
        lowest = int(np.argmin(costs))
        if costs[lowest] < cost_at(*start):
            start = around[lowest]
        else:
            step /= 2
    return start


def _best_factor(pairs: DepthPairs, T: SE3) -> float | None:
    """The factor of the positions with the smallest residual; None at the end of the range."""
    tried = [scaled(10**decade).residual(pairs, T) for decade in _DECADES]
    best = int(np.argmin(tried))
    if best in (0, len(_DECADES) - 1):
        return None
    return _factor_near(_DECADES[best], _DECADES[1] - _DECADES[0], pairs, T)


def _factor_near(decade: float, step: float, pairs: DepthPairs, T: SE3) -> float:
    """The factor of the positions with the smallest residual, whose logarithm to the base 10 is
    within `step`.
    """
    while step > _LAST_STEP:
        step /= 2
        around = decade + step * np.array([-1, 0, 1])
        decade = around[np.argmin([scaled(10**x).residual(pairs, T) for x in around])]
    return float(10**decade)


def _measured_again(found: Reading, load: LoadDepth, T: SE3, camera: PinholeCamera) -> Reading:
    """The same factor, measured with pairs that are chosen by the motion in the right unit."""
    factor = float(found.detail)
    right = SE3(T.rotation, factor * T.translation)
    pairs = DepthPairs.of(load, right, camera)
    return scaled(factor * _factor_near(0.0, _DECADES[1] - _DECADES[0], pairs, right))
