"""Images of a mesh, plain or coloured by its error: raycast from a camera outside, with back-face
culling, lit from the camera.
"""

from typing import TYPE_CHECKING

import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.caster import RayCaster

from .surface_error import SurfaceError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BACKGROUND = 255


def picture(
    points: np.ndarray,
    triangles: np.ndarray,
    colours: np.ndarray | None,
    width: int = 960,
    height: int = 720,
) -> np.ndarray:
    """(height, width, 3) uint8: oblique view from above into the open room, z up. colours (n, 3)
    0..255.
    """
    low, high = np.percentile(points, (1, 99), axis=0)
    origin, rays = _rays((low + high) / 2, float(np.linalg.norm(high - low)), width, height)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    triangles = triangles[np.einsum("ij,ij->i", np.cross(b - a, c - a), a - origin) < 0]
    image = np.full((len(rays), 3), _BACKGROUND, np.float32)
    if len(triangles):
        hits = RayCaster(points, triangles).cast(origin, rays)
        seen = hits.triangle >= 0
        facing = np.abs((hits.normal[seen] * rays[seen]).sum(axis=1))
        corners = triangles[hits.triangle[seen]]
        if colours is None or not colours.shape[1]:
            colour = np.full((len(corners), 3), 200.0)
        else:
            u = hits.uv[seen, :1]
            v = hits.uv[seen, 1:]
            parts = colours.astype(np.float32)[corners]
            colour = (1 - u - v) * parts[:, 0] + u * parts[:, 1] + v * parts[:, 2]
        image[seen] = colour * (0.35 + 0.65 * facing[:, None])
    return np.clip(image, 0, 255).astype(np.uint8).reshape(height, width, 3)


def _rays(
    centre: np.ndarray, size: float, width: int, height: int
) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3,) and unit directions (width height, 3) of a camera that looks at the centre, 40
    degrees downwards; field of view 40 degrees.
    """
    pitch = np.radians(40)
    reach = np.tan(np.radians(20))
    back = -np.cos(pitch) * np.sqrt(0.5)
    backward = np.array([back, back, np.sin(pitch)])
    right = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0])
    x = np.linspace(-reach, reach, width)[None, :, None]
    y = np.linspace(reach, -reach, height)[:, None, None] * height / width
    direction = -backward + x * right + y * np.cross(backward, right)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    origin = centre + backward * size * 0.5 / reach * 0.95
    return origin.astype(np.float32), direction.reshape(-1, 3).astype(np.float32)


def clay(
    caster: RayCaster,
    camera: PinholeCamera,
    T_world_camera: SE3,
    reach_m: float = 0.8,
    rays: int = 32,
) -> np.ndarray:
    """(h, w, 3) uint8: a model as clay, lit from the camera, with ambient occlusion by surfaces
    within reach_m.
    """
    directions = camera.rays() @ T_world_camera.rotation.T
    hits = caster.cast(T_world_camera.translation, directions)
    seen = hits.triangle >= 0
    towards = directions[seen] / np.linalg.norm(directions[seen], axis=1, keepdims=True)
    normal = hits.normal[seen]
    facing = (normal * towards).sum(1, keepdims=True)
    normal = np.where(facing > 0, -normal, normal)
    places = T_world_camera.translation + directions[seen] * hits.distance[seen][:, None]
    places = places + 1e-3 * normal
    rng = np.random.default_rng(0)
    open_rays = np.zeros(len(places), np.float32)
    for _ in range(rays):
        # points on a unit sphere around the tip of the normal: cosine-weighted directions
        point = rng.normal(size=(len(places), 3))
        point = normal + point / np.linalg.norm(point, axis=1, keepdims=True)
        point /= np.maximum(np.linalg.norm(point, axis=1, keepdims=True), 1e-6)
        open_rays += caster.cast(places, point).distance > reach_m
    image = np.full((*seen.shape, 1), 255, np.float32)
    image[seen] = 235 * (0.45 + 0.55 * np.abs(facing)) * (0.25 + 0.75 * open_rays[:, None] / rays)
    return np.repeat(np.clip(image, 0, 255).astype(np.uint8), 3, axis=2)


def heat_colours(distances_mm: np.ndarray, low_mm: float, high_mm: float) -> np.ndarray:
    """Colours (n, 3) 0..255 for distances (n,) on a logarithmic scale: blue at low_mm and less, red
    at high_mm and more.
    """
    from matplotlib import colormaps

    share = np.log(np.clip(distances_mm, low_mm, high_mm) / low_mm) / np.log(high_mm / low_mm)
    return colormaps["turbo"](share)[:, :3] * 255


def error_figure(
    points: np.ndarray, triangles: np.ndarray, error: SurfaceError, max_mm: float
) -> "Figure":
    """Image and histogram of the error. points (n, 3) in the model's world; without triangles they
    are drawn from above. Dark is near, bright is `max_mm` and more.
    """
    from matplotlib import colormaps, colors
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(14, 5.6), layout="constrained")
    surface, histogram = drawing.subplots(1, 2, width_ratios=(1.35, 1))
    distances_mm = error.distances_m * 1e3
    scale = colormaps["turbo"]
    colours = scale(np.clip(distances_mm / max_mm, 0, 1))[:, :3] * 255
    if len(triangles):
        surface.imshow(picture(points, triangles, colours, 1120, 840))
    else:
        order = np.argsort(points[:, 2])
        surface.scatter(*points[order, :2].T, c=colours[order] / 255, s=0.5, marker=".")
        surface.set_aspect("equal")
    surface.set_axis_off()
    mappable = ScalarMappable(colors.Normalize(0, max_mm), scale)
    drawing.colorbar(
        mappable, ax=surface, label="distance to the model [mm]", extend="max", shrink=0.8
    )
    _draw_histogram(histogram, error, max_mm)
    return drawing


def _draw_histogram(axes: "Axes", error: SurfaceError, max_mm: float) -> None:
    distances_mm = np.minimum(error.distances_m * 1e3, max_mm)
    weights = np.full(len(distances_mm), 100 / len(distances_mm))
    axes.hist(distances_mm, 100, range=(0, max_mm), weights=weights, color="#0072B2")
    s = error.statistics
    for value, style, name in ((s.median * 1e3, "--", "median"), (s.mean * 1e3, "-", "mean")):
        label = f"{name} {value:.3f} mm"
        axes.axvline(min(value, max_mm), color="#D55E00", linestyle=style, label=label)
    axes.set(
        yscale="log",
        xlabel=f"distance [mm]; the last bar holds all beyond {max_mm:g}",
        ylabel="vertices [%]",
    )
    axes.legend()
    axes.grid(alpha=0.3)
