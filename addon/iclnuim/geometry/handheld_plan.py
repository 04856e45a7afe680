"""Planning of a hand-held trajectory through waypoints in a scene: a route around obstacles,
viewing directions and pace, as a recipe of handheld.
"""

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import ClassVar

import numpy as np

from ..errors import InputError
from ..settings import Settings, setting
from . import handheld
from .handheld import Pace, Point, Recipe, Shake, Viewpoint

#: Clearance (n,) in metres at points (n, 3): the distance to the nearest surface.
Clearance = Callable[[np.ndarray], np.ndarray]
#: Maximum number of cells, and minimum side of a cell.
_MAX_CELLS = 400_000
_MIN_CELL_M = 0.1
#: Default shake of the hands: the amplitudes of our kt0..kt3.
SHAKES = (
    Shake(0.25, 1.0, position_mm=8.0, rotation_deg=0.9, position_slope=1.0, rotation_slope=1.0),
    Shake(1.0, 12.0, position_mm=2.0, rotation_deg=0.25, position_slope=2.5, rotation_slope=3.0),
)
#: Pitch downwards if a waypoint has no target: the camera then looks ahead along the route.
_DOWN_RAD = 0.1
#: Margins added to the requested clearance when the route is planned, tried in this order: spline
#: and shake leave the route.
MARGINS_M = (0.15, 0.05, 0.0)
#: Spacings of viewpoints on the route, tried in this order: with smaller ones the spline stays
#: closer to the route.
SPACINGS_M = (1.5, 0.6, 0.3, 0.15)
_MAX_YAW_STEP_RAD = np.radians(80.0)


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """clearance_m (i, j, k) at the cell centres low_m + cell_m * (i, j, k), and the function
    `measure` that computes it.
    """

    low_m: np.ndarray
    cell_m: float
    clearance_m: np.ndarray
    measure: Clearance

    @classmethod
    def between(cls, low_m: np.ndarray, high_m: np.ndarray, measure: Clearance) -> "FreeSpace":
        """The free space of a box, in cells of 0.1 m, or larger for a large box."""
        size = np.maximum(high_m - low_m, 1e-3)
        of_volume_m = float((size.prod() / _MAX_CELLS) ** (1 / 3))
        cell_m = max(_MIN_CELL_M, of_volume_m, float(size.max()) / 400)
        shape = tuple(int(n) + 1 for n in np.ceil(size / cell_m))
        points = low_m + cell_m * np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3)
        return cls(low_m, cell_m, measure(points).reshape(shape), measure)

    def route(self, start_m: np.ndarray, end_m: np.ndarray, clear_m: float) -> np.ndarray:
        """(n, 3) corners, including start and end, of a route with a distance of at least `clear_m`
        to every surface.

        It is straight if possible, else the shortest route by A* on the cells, then straightened.
        Raises InputError if there is none.
        """
        if self._is_clear(start_m, end_m, clear_m):
            return np.stack([start_m, end_m])
        cells = self._search(self._cell(start_m), self._cell(end_m), clear_m)
        points = np.stack([start_m, *(self.low_m + self.cell_m * c for c in cells), end_m])
        corners = [points[0]]
        current = 0
        while current < len(points) - 1:  # skip corners as long as the straight connection is clear
            here = points[current]
            current += 1
            for target in range(len(points) - 1, current, -1):
                if self._is_clear(here, points[target], clear_m):
                    current = target
                    break
            corners.append(points[current])
        return np.stack(corners)

    def _cell(self, point_m: np.ndarray) -> tuple[int, int, int]:
        index = np.rint((point_m - self.low_m) / self.cell_m).astype(int)
        i, j, k = np.clip(index, 0, np.array(self.clearance_m.shape) - 1).tolist()
        return i, j, k

    def _search(self, start: tuple, end: tuple, clear_m: float) -> list[np.ndarray]:
        """Cells from start to end (A*). The clearance of these two is not checked here."""
        # with a blocked border; cells are flat indices of this array
        free = np.pad(self.clearance_m >= clear_m, 1)
        first = _flat_index(start, free.shape)
        goal = _flat_index(end, free.shape)
        free.flat[goal] = True
        places = np.moveaxis(np.indices(free.shape), 0, -1)
        heuristic = np.linalg.norm(places - np.array(end) - 1, axis=-1).ravel().tolist()
        clear = free.tobytes()
        across = (free.shape[1] * free.shape[2], free.shape[2], 1)
        ways = [way for way in product((-1, 0, 1), repeat=3) if any(way)]
        steps = [(int(np.dot(way, across)), float(np.linalg.norm(way))) for way in ways]
        if not _is_reachable(free, first, goal, np.array([step for step, _ in steps])):
            found = f"none with {clear_m:.2f} m to every surface"
            hint = "a smaller {clearance_m}, or viewpoints in one room"
            raise InputError("viewpoints with a route between them", found=found, hint=hint)
        length: dict[int, float] = {first: 0.0}
        before: dict[int, int | None] = {first: None}
        open_ = [(0.0, first)]
        done = set()
        while True:  # terminates, because the goal is reachable
            cell = heapq.heappop(open_)[1]
            if cell == goal:
                route = [goal]
                while (previous := before[route[-1]]) is not None:
                    route.append(previous)
                return [np.array(np.unravel_index(index, free.shape)) - 1 for index in route[::-1]]
            if cell in done:
                continue
            done.add(cell)
            for step, step_length in steps:
                other = cell + step
                if not clear[other] or other in done:
                    continue
                new_length = length[cell] + step_length
                if new_length < length.get(other, np.inf):
                    length[other] = new_length
                    before[other] = cell
                    heapq.heappush(open_, (new_length + heuristic[other], other))

    def _is_clear(self, a_m: np.ndarray, b_m: np.ndarray, clear_m: float) -> bool:
        count = max(2, int(np.linalg.norm(b_m - a_m) / 0.05) + 2)
        share = np.linspace(0.0, 1.0, count)[:, None]
        inner = (a_m + share * (b_m - a_m))[1:-1]
        return bool((self.measure(inner) >= clear_m).all())


def _flat_index(cell: tuple, shape: tuple[int, ...]) -> int:
    """The flat index of a cell in an array of this shape, which has a border of one cell."""
    return int(np.ravel_multi_index(tuple(n + 1 for n in cell), shape))


def _is_reachable(free: np.ndarray, first: int, goal: int, steps: np.ndarray) -> bool:
    """Whether `goal` is reachable from `first` through free cells by steps (n,) between flat
    indices.
    """
    seen = np.zeros(free.size, bool)
    frontier = np.array([first])
    while len(frontier) and not seen[goal]:
        frontier = np.unique(frontier[:, None] + steps)
        frontier = frontier[free.flat[frontier] & ~seen[frontier]]
        seen[frontier] = True
    return bool(seen[goal])


@dataclass(frozen=True)
class PlanSettings(Settings):
    """Motion of a hand-held camera between given waypoints."""

    group: ClassVar[str] = "settings of a hand-held trajectory"

    clearance_m: float = setting(
        0.25,
        "minimum distance from every surface",
        unit="m",
        low=0.01,
        high=10.0,
        option="--clearance",
        label="Clearance",
    )
    speed_m_s: float = setting(
        0.3, "speed of motion", unit="m/s", low=0.01, high=10.0, option="--speed", label="Speed"
    )
    shake: float = setting(1.0, "factor on the shake of the hands", low=0.0, high=10.0)
    seed: int = setting(0, "seed of the shake", low=0, high=2**63 - 1)


@dataclass(frozen=True)
class Waypoint:
    """A position of the camera in metres, its target (None: it looks ahead), and a rest."""

    position_m: Point
    look_at_m: Point | None = None
    dwell_s: float = 0.0


@dataclass(frozen=True)
class HandheldPlan:
    """A recipe whose trajectory has the required clearance, its motion, and its minimum clearance
    in metres.
    """

    recipe: Recipe
    motion: handheld.Motion
    clearance_m: float


def plan(
    waypoints: list[Waypoint], space: FreeSpace, scene: str, settings: PlanSettings | None = None
) -> HandheldPlan:
    """Hand-held motion through the waypoints with the required clearance to every surface. Raises
    InputError if there is none.

    scene: the name of the scene in the recipe.
    """
    settings = settings or PlanSettings()
    clear_m = settings.clearance_m
    if len(waypoints) < 2:
        raise InputError("two viewpoints or more", found=len(waypoints))
    clearances = space.measure(np.array([w.position_m for w in waypoints]))
    if clearances.min() < clear_m:
        k = int(clearances.argmin())
        found = f"viewpoint {k} at {waypoints[k].position_m}, {clearances[k]:.2f} m away"
        hint = "moving it, or a smaller {clearance_m}"
        expected = f"viewpoints at least {clear_m:g} m from every surface"
        raise InputError(expected, found=found, hint=hint)
    places = [np.array(w.position_m) for w in waypoints]
    found = "none"
    for routes in routes_between(places, space, clear_m):
        for spacing_m in SPACINGS_M:
            recipe = _recipe(_viewpoints(waypoints, routes, spacing_m), scene, settings)
            motion = handheld.make(recipe)
            clearances = space.measure(motion.trajectory.positions_m)
            worst = int(clearances.argmin())
            if clearances[worst] >= clear_m:
                return HandheldPlan(recipe, motion, float(clearances[worst]))
            place = ", ".join(f"{x:.2f}" for x in motion.trajectory.positions_m[worst])
            found = f"{clearances[worst]:.2f} m at ({place})"
    hint = "a smaller {clearance_m}, less {shake}, or one more viewpoint"
    expected = f"viewpoints whose trajectory is {clear_m:g} m from every surface"
    raise InputError(expected, found=found, hint=hint)


def routes_between(
    places: Sequence[np.ndarray], space: FreeSpace, clear_m: float
) -> Iterator[list[np.ndarray]]:
    """The routes from each place to the next one, with each of MARGINS_M that allows them. Raises
    InputError if there are none without a margin.
    """
    for margin_m in MARGINS_M:
        try:
            routes = [space.route(a, b, clear_m + margin_m) for a, b in pairwise(places)]
        except InputError:
            if margin_m == MARGINS_M[-1]:
                raise
            continue
        yield routes


def _viewpoints(
    waypoints: list[Waypoint], routes: list[np.ndarray], spacing_m: float
) -> tuple[Viewpoint, ...]:
    """The waypoints with points of the routes between them; the viewing direction rotates uniformly
    from one to the next.
    """
    gazes = _gazes(waypoints, routes)
    found = [_viewpoint(waypoints[0].position_m, *gazes[0], waypoints[0].dwell_s)]
    for k, route in enumerate(routes):
        yaw_step = (gazes[k + 1][0] - gazes[k][0] + np.pi) % (2 * np.pi) - np.pi
        turns = max(1, int(np.ceil(abs(yaw_step) / _MAX_YAW_STEP_RAD)))
        share, points = along(route, spacing_m, turns)
        for s, point in zip(share[1:-1], points[1:-1], strict=True):
            pitch = (1 - s) * gazes[k][1] + s * gazes[k + 1][1]
            found.append(_viewpoint(point, gazes[k][0] + s * yaw_step, pitch, 0.0))
        waypoint = waypoints[k + 1]
        found.append(_viewpoint(waypoint.position_m, *gazes[k + 1], waypoint.dwell_s))
    return tuple(found)


def _gazes(waypoints: list[Waypoint], routes: list[np.ndarray]) -> list[tuple[float, float]]:
    """Yaw and pitch at each waypoint, radians."""
    ahead = [route[1] - route[0] for route in routes] + [routes[-1][-1] - routes[-1][-2]]
    found: list[tuple[float, float]] = []
    for waypoint, gaze in zip(waypoints, ahead, strict=True):
        target = waypoint.look_at_m
        if target is not None:
            gaze = np.array(target) - np.array(waypoint.position_m)
        across = float(np.hypot(gaze[0], gaze[1]))
        if across >= 0.05:
            yaw = float(np.arctan2(gaze[1], gaze[0]))
        elif target is None:
            yaw = found[-1][0] if found else 0.0
        else:
            expected = "a target not directly above or below the viewpoint"
            raise InputError(expected, found=f"{target}")
        pitch = -_DOWN_RAD if target is None else float(np.arctan2(gaze[2], across))
        found.append((yaw, pitch))
    return found


def along(route: np.ndarray, spacing_m: float, min_count: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Shares (n,) of the route's length and the points (n, 3) there: its corners, and more points
    where these are far apart.
    """
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(route, axis=0), axis=1))])
    whole = max(float(reached[-1]), 1e-9)
    count = max(min_count, int(np.ceil(whole / spacing_m)))
    shares = np.unique(np.round(np.concatenate([reached / whole, np.arange(count + 1) / count]), 9))
    if len(shares) > 2:
        near = np.flatnonzero(np.diff(shares) * whole < 0.05)
        # of two that are close the second goes, but not the last one of all
        shares = np.delete(shares, np.where(near + 2 < len(shares), near + 1, near))
    points = np.stack([np.interp(shares * whole, reached, route[:, k]) for k in range(3)], -1)
    return shares, points


def _viewpoint(
    position_m: np.ndarray | tuple, yaw: float, pitch: float, dwell_s: float
) -> Viewpoint:
    """A viewpoint rounded to 0.1 mm, so that the written recipe is short and gives the same
    trajectory.
    """
    ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    place = np.array(position_m, float)
    return Viewpoint(rounded(place), rounded(place + 2.0 * ahead), dwell_s)


def rounded(point: np.ndarray) -> Point:
    """The point rounded to 0.1 mm."""
    x, y, z = (round(float(v), 4) for v in point)
    return x, y, z


def _recipe(viewpoints: tuple[Viewpoint, ...], scene: str, settings: PlanSettings) -> Recipe:
    """A recipe with the length and duration that the viewpoints have at this pace, so that they are
    not scaled.
    """
    shakes = []
    for shake in SHAKES:
        position_mm = settings.shake * shake.position_mm
        rotation_deg = settings.shake * shake.rotation_deg
        shakes.append(replace(shake, position_mm=position_mm, rotation_deg=rotation_deg))
    recipe = Recipe(
        scene=scene,
        about="A walk through viewpoints, clear of the surfaces.",
        frames=1_000_000,
        length_m=1.0,
        seed=settings.seed,
        pace=Pace(settings.speed_m_s, 40.0, 0.9),
        shakes=tuple(shakes),
        viewpoints=viewpoints,
    )
    frames = int(np.ceil(handheld.unhurried_s(recipe) * handheld.FRAME_RATE_HZ)) + 1
    recipe = replace(recipe, frames=max(frames, 240))
    return replace(recipe, length_m=round(handheld.natural_length_m(recipe), 6))
