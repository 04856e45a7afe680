"""Pictures of a mesh, plain or coloured by its error: rays from a camera outside, back faces left out, lit from the camera."""

from typing import TYPE_CHECKING

import numpy as np

from ..raycast.caster import RayCaster
from .surface_error import SurfaceError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: How many back faces a ray may pass.
_PASSES = 12
_BACKGROUND = 255


def picture(
    points: np.ndarray, triangles: np.ndarray, colours: np.ndarray | None, width: int = 960, height: int = 720
) -> np.ndarray:
    """(height, width, 3) uint8: from above and aside, z up, as one looks into a doll's house. colours (n, 3) 0..255."""
    caster = RayCaster(points, triangles)
    low, high = np.percentile(points, (1, 99), axis=0)
    origin, rays = _rays((low + high) / 2, float(np.linalg.norm(high - low)), width, height)
    hit, uv, normal = _front_hits(caster, origin, rays)
    image = np.full((len(rays), 3), _BACKGROUND, np.float32)
    seen = hit >= 0
    facing = np.abs((normal[seen] * rays[seen]).sum(axis=1))
    corners = triangles[hit[seen]]
    if colours is None or not colours.shape[1]:
        colour = np.full((len(corners), 3), 200.0)
    else:
        u, v = uv[seen, :1], uv[seen, 1:]
        parts = colours.astype(np.float32)[corners]
        colour = (1 - u - v) * parts[:, 0] + u * parts[:, 1] + v * parts[:, 2]
    image[seen] = colour * (0.35 + 0.65 * facing[:, None])
    return np.clip(image, 0, 255).astype(np.uint8).reshape(height, width, 3)


def _rays(centre: np.ndarray, size: float, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3,) and unit directions (width height, 3) of a camera that looks down on the centre at 40 degrees, field of view 40."""
    back = np.array([-0.55, -0.55, 0.0]) / np.hypot(0.55, 0.55) * np.cos(np.radians(40))
    back[2] = np.sin(np.radians(40))
    right = np.cross([0, 0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    reach = np.tan(np.radians(20))
    x = np.linspace(-1, 1, width) * reach
    y = -np.linspace(-1, 1, height) * reach * height / width
    direction = -back + x[None, :, None] * right + y[:, None, None] * up
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    origin = centre + back * size * 0.5 / np.tan(np.radians(20)) * 0.95
    return origin.astype(np.float32), direction.reshape(-1, 3).astype(np.float32)


def _front_hits(caster: RayCaster, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(triangle or -1, barycentric uv, normal) of the first surface that each ray meets from the front."""
    hit, uv, normal = np.full(len(rays), -1), np.zeros((len(rays), 2), np.float32), np.zeros((len(rays), 3), np.float32)
    origins, remaining = np.repeat(origin[None], len(rays), axis=0), np.arange(len(rays))
    for _ in range(_PASSES):
        if not len(remaining):
            break
        hits = caster.cast(origins[remaining], rays[remaining])
        met = hits.triangle >= 0
        front = met & ((hits.normal * rays[remaining]).sum(axis=1) < 0)
        found = remaining[front]
        hit[found], uv[found], normal[found] = hits.triangle[front], hits.uv[front], hits.normal[front]
        behind = met & ~front
        remaining = remaining[behind]
        origins[remaining] += rays[remaining] * (hits.distance[behind, None] + 1e-4)
    return hit, uv, normal


def error_figure(points: np.ndarray, triangles: np.ndarray, error: SurfaceError, max_mm: float) -> "Figure":
    """points (n, 3) in the model's world; without triangles they are drawn from above. Dark is near, bright is `max_mm` and more."""
    from matplotlib import colormaps, colors
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(14, 5.6), layout="constrained")
    FigureCanvasAgg(drawing)
    surface, histogram = drawing.subplots(1, 2, width_ratios=(1.35, 1))
    distances_mm, scale = error.distances_m * 1e3, colormaps["turbo"]
    colours = scale(np.clip(distances_mm / max_mm, 0, 1))[:, :3] * 255
    if len(triangles):
        surface.imshow(picture(points, triangles, colours, 1120, 840))
    else:
        order = np.argsort(points[:, 2])
        surface.scatter(*points[order, :2].T, c=colours[order] / 255, s=0.5, marker=".")
        surface.set_aspect("equal")
    surface.set_axis_off()
    mappable = ScalarMappable(colors.Normalize(0, max_mm), scale)
    drawing.colorbar(mappable, ax=surface, label="distance to the model [mm]", extend="max", shrink=0.8)
    bins = np.linspace(0, max_mm, 101)
    histogram.hist(
        np.minimum(distances_mm, max_mm), bins, weights=np.full(len(points), 100 / len(points)), color="#0072B2"
    )
    s = error.statistics
    for value, style, name in ((s.median * 1e3, "--", "median"), (s.mean * 1e3, "-", "mean")):
        histogram.axvline(min(value, max_mm), color="#D55E00", linestyle=style, label=f"{name} {value:.3f} mm")
    histogram.set(
        yscale="log", xlabel=f"distance [mm]; the last bar holds all beyond {max_mm:g}", ylabel="vertices [%]"
    )
    histogram.legend()
    histogram.grid(alpha=0.3)
    return drawing
