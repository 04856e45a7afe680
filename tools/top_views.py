"""Draws the shipped trajectories from above, each in its room: `python tools/top_views.py` writes
the .png next to each .txt.

The room is drawn by vertical rays that start below its ceiling: grey by the direction of the
surface, with lines where height or object change. A dot marks the start, a square the end, and an
arrow every second the viewing direction.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.blender.open import scene
from iclnuim.blender.render import model
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.caster import RayCaster
from iclnuim.report import charts
from matplotlib import colormaps
from matplotlib.figure import Figure

#: Height of the rays' origins above the floor, below the ceiling.
_ABOVE_FLOOR_M = 2.3
#: Border of the picture, side of a pixel, and metres on an inch of it.
_MARGIN_M = 0.1
_STEP_M = 0.01
_INCH_M = 1.62
#: A line is drawn where the height changes by more.
_EDGE_M = 0.02
_LIGHT = np.array([-0.3, 0.4, 0.87])


def main(rooms: Sequence[str]) -> None:
    for room in rooms:
        scene.open_scene(room)
        found = model.scene_model()
        picture, extent = top_view(RayCaster.of_model(found), found.corners_m, found.instance)
        for name in shipped.sequence_names():
            if name.startswith(f"{room}/"):
                path = shipped.trajectory_file(name)
                poses = read_trajectory(path).trajectory.T_world_camera
                draw(picture, extent, poses, path.with_suffix(".png"))


def top_view(
    caster: RayCaster, corners_m: np.ndarray, instance: np.ndarray
) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """Grey values (h, w) of the model from above, and its extent (left, right, bottom, top) in
    metres.
    """
    floor_m = np.percentile(corners_m[..., 2], 1)
    inside = corners_m[np.abs(corners_m[..., 2] - floor_m) < _ABOVE_FLOOR_M]
    low, high = np.percentile(inside[:, :2], [0.1, 99.9], axis=0)
    (left, bottom), (right, top) = low - _MARGIN_M, high + _MARGIN_M
    x, y = np.arange(left, right, _STEP_M), np.arange(bottom, top, _STEP_M)
    origins = np.stack(
        [*np.meshgrid(x, y[::-1]), np.full((len(y), len(x)), floor_m + _ABOVE_FLOOR_M)], -1
    )
    hits = caster.cast(origins, np.broadcast_to((0.0, 0.0, -1.0), origins.shape))
    met = hits.triangle >= 0
    normal = hits.normal * np.sign(hits.normal[..., 2:])
    grey = np.where(met, 0.62 + 0.34 * np.clip(normal @ _LIGHT, 0, 1), 1.0)
    edges = _edges(np.where(met, hits.distance, 9), np.where(met, instance[hits.triangle], -1))
    return np.where(edges, 0.6, 1) * grey, (x[0], x[-1], y[0], y[-1])


def _edges(height_m: np.ndarray, instance: np.ndarray) -> np.ndarray:
    found = np.zeros(height_m.shape, bool)
    for axis in (0, 1):
        step_m = np.abs(np.diff(height_m, axis=axis))
        step = step_m > np.where(np.diff(instance, axis=axis) == 0, _EDGE_M, _EDGE_M / 4)
        found |= np.pad(step, [(0, 1), (0, 0)] if axis == 0 else [(0, 0), (0, 1)])
    return found


def draw(
    picture: np.ndarray, extent: tuple[float, float, float, float], T_world_camera: SE3, path: Path
) -> None:
    width_m, height_m = extent[1] - extent[0], extent[3] - extent[2]
    figure = Figure(figsize=(width_m / _INCH_M, height_m / _INCH_M))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(picture, cmap="gray", vmin=0, vmax=1, extent=extent, interpolation="antialiased")
    places, looks = T_world_camera.translation[:, :2], T_world_camera.rotation[:, :2, 2]
    colours = colormaps["viridis"](np.linspace(0, 1, len(places)))
    axes.scatter(places[:, 0], places[:, 1], s=2, c=colours, zorder=3)
    for place, look, colour in zip(places[::30], looks[::30], colours[::30], strict=True):
        arrow = {"arrowstyle": "-|>", "mutation_scale": 6, "shrinkA": 0, "shrinkB": 0}
        arrow |= {"color": colour, "lw": 1.0}
        end = place + 0.32 * look / np.linalg.norm(look)
        axes.annotate("", end, place, arrowprops=arrow, zorder=4)
    axes.plot(*places[0], "o", c=colours[0], ms=6)
    axes.plot(*places[-1], "s", c=colours[-1], ms=5, mec="k", mew=0.5)
    axes.axis("off")
    charts.save(figure, path)


if __name__ == "__main__":
    main(sys.argv[1:] or shipped.SCENE_NAMES)
