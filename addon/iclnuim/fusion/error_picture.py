"""The surface coloured by its error, and how the errors are distributed."""

from typing import TYPE_CHECKING

import numpy as np

from .shading import picture
from .surface_error import SurfaceError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure(points: np.ndarray, triangles: np.ndarray, error: SurfaceError, max_mm: float) -> "Figure":
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
