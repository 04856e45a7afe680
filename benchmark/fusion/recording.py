"""A surface with its errors for the Rerun viewer."""

import numpy as np
from iclnuim.errors import StrPath
from iclnuim.report.recording import Recorder, record

from .surface_error import SurfaceError

_BARS = 100


def record_surface(
    path: StrPath,
    of: StrPath,
    points: np.ndarray,
    triangles: np.ndarray,
    error: SurfaceError,
    max_mm: float,
) -> None:
    """Record points (n, 3) in the model's world, in metres, and triangles (m, 3), m = 0 for a
    cloud, coloured by distance to the model from 0 to max_mm; the distances in millimetres; and
    their histogram, whose last bar contains all larger ones. `of`: the file of the surface. Raises
    WorkError without rerun-sdk.
    """
    from matplotlib import colormaps

    distances_mm = 1e3 * error.distances_m
    colours = (255 * colormaps["turbo"](np.clip(distances_mm / max_mm, 0, 1))).astype(np.uint8)
    counts = np.histogram(np.minimum(distances_mm, max_mm), _BARS, (0, max_mm))[0]

    def fill(recorder: Recorder) -> None:
        if len(triangles):
            surface = recorder.rerun.Mesh3D(
                vertex_positions=points, triangle_indices=triangles, vertex_colors=colours
            )
        else:
            surface = recorder.rerun.Points3D(points, colors=colours)
        recorder.static("world/surface", surface)
        recorder.static(
            "world/surface", recorder.rerun.AnyValues(error_mm=distances_mm.astype(np.float32))
        )
        recorder.static("errors", recorder.rerun.BarChart(counts))
        s = error.statistics.to_dict()
        names = ("mean", "median", "std", "min", "max")
        text = "\n".join(f"{name}: {1e3 * s[name]:.3f} mm" for name in names)
        recorder.static("statistics", recorder.rerun.TextDocument(text))

    record(path, of, fill)
