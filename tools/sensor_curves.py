"""Draws what the models of sensors that people own do to a wall, beside published figures:
`python tools/sensor_curves.py docs/measured/pictures/sensors.png`. It prints the deviations, and
the cost of an image of 640 x 480 (one core: OPENBLAS_NUM_THREADS=1).
"""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.postprocess import noisy_depth
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: The D435's focal length; a narrow view, whose middle is one distance and one angle.
CAMERA = PinholeCamera(160, 120, 424.0, 424.0, 79.5, 59.5)
MIDDLE = np.s_[30:90, 60:100]
FRAMES = 8
MODELS = {"d435": "C0", "azure_kinect": "C1", "phone": "C2", "redwood": "0.6"}
WHITE = 0.95
AWAY_M = 2.0


@dataclass(frozen=True)
class Published:
    """A printed figure in millimetres, for a white wall that faces the camera. is_bound: at most."""

    model: str
    what: str
    depth_m: float
    value_mm: float
    source: str
    is_bound: bool = False


#: The sources: docs/guide/sensors.md and the settings of the models.
PUBLISHED = (
    *(
        Published("d435", "sigma", z, 80 * z * z / (424 * 0.05), "Intel, tuning paper")
        for z in (0.5, 1.0, 2.0, 3.0, 4.0)
    ),
    Published("d435", "sigma", 2.0, 40.0, "Ahn and others 2019: as much as", is_bound=True),
    Published("azure_kinect", "sigma", 1.0, 1.0, "Tolgyessy and others 2021, quoted"),
    Published("azure_kinect", "sigma", 3.0, 3.6, "Tolgyessy and others 2021, quoted"),
    Published("azure_kinect", "sigma", 3.5, 17.0, "Microsoft: at most", is_bound=True),
    Published("azure_kinect", "bias", 3.5, 14.5, "Microsoft: at most", is_bound=True),
    Published("phone", "sigma", 1.0, 10.0, "Luetzenburg and others 2021: within", is_bound=True),
)


def tilted(depth_m: float, angle_deg: float) -> np.ndarray:
    """Depth (h, w) of a wall whose normal is turned by this angle from the optical axis."""
    tangent = np.tan(np.radians(angle_deg))
    slope = CAMERA.rays()[..., 0]
    return (depth_m / np.maximum(1 + slope * tangent, 1e-3)).astype(np.float32)


def figures(model: str, depth_m: float, angle_deg: float, albedo: float) -> dict[str, float]:
    """Share of measured pixels in percent, mean error and its standard deviation in mm."""
    depth = tilted(depth_m, angle_deg)
    errors = []
    for seed in range(FRAMES):
        noisy = noisy_depth(depth, model, CAMERA, seed, albedo=albedo)[MIDDLE].astype(float)
        errors.append(np.where(noisy > 0, noisy - depth[MIDDLE], np.nan))
    error_mm = 1000 * np.stack(errors)
    known = error_mm[np.isfinite(error_mm)]
    some = known.size > 100
    return {
        "fill": 100 * known.size / error_mm.size,
        "bias": float(known.mean()) if some else np.nan,
        "sigma": float(known.std()) if some else np.nan,
    }


def blenderproc_mm(depth_m: np.ndarray) -> np.ndarray:
    """The sigma that BlenderProc's add_kinect_azure_noise adds, in mm."""
    return 0.5 + np.maximum(depth_m - 0.5, 0)


def deviations() -> list[str]:
    """One line for each published figure: ours beside it."""
    lines = []
    for point in PUBLISHED:
        ours = figures(point.model, point.depth_m, 0, WHITE)[point.what]
        sign = "<=" if point.is_bound else "for"
        lines.append(
            f"{point.model:13} {point.what:5} {point.depth_m:g} m: {ours:7.2f} {sign} "
            f"{point.value_mm:6.2f} mm ({point.source})"
        )
    return lines


def costs() -> list[str]:
    """Median processor time of a room with boxes, 640 x 480, for each model."""
    rng = np.random.default_rng(0)
    camera = PinholeCamera()
    depth = (3 / (1 + np.abs(camera.rays()[..., 0]))).astype(np.float32)
    for left, top in rng.integers(0, (590, 430), (12, 2)):
        depth[top : top + 50, left : left + 50] = rng.uniform(0.8, 1.5)
    rgb = rng.uniform(0.05, 0.6, (480, 640, 3)).astype(np.float32)
    lines = []
    for model in MODELS:
        taken_s = []
        for seed in range(9):
            start_s = time.process_time()
            noisy_depth(depth, model, camera, seed, rgb=rgb)
            taken_s.append(time.process_time() - start_s)
        lines.append(f"{model:13} {1000 * np.median(taken_s):.0f} ms")
    return lines


def curves() -> Figure:
    """Rows: fill, bias, sigma. Columns: by distance, angle and albedo."""
    sweeps: Sequence[tuple[str, np.ndarray, Callable[[float], tuple[float, float, float]]]] = (
        ("distance in m, white, facing", np.linspace(0.5, 5, 73), lambda z: (z, 0, WHITE)),
        ("angle in degrees, 2 m, white", np.linspace(0, 80, 17), lambda a: (AWAY_M, a, WHITE)),
        ("albedo, 2 m, facing", np.geomspace(0.01, 0.95, 16), lambda r: (AWAY_M, 0, r)),
    )
    drawing = Figure(figsize=(12, 8.5), layout="constrained")
    axes = drawing.subplots(3, 3)
    for column, (label, values, place) in enumerate(sweeps):
        for model, colour in MODELS.items():
            found = [figures(model, *place(value)) for value in values]
            for row, what in enumerate(("fill", "bias", "sigma")):
                line = [f[what] for f in found]
                axes[row, column].plot(values, line, color=colour, label=model)
        axes[2, column].set_xlabel(label)
        axes[2, column].set_yscale("log")
        for row in range(3):
            axes[row, column].grid(alpha=0.3)
            if column == 2:
                axes[row, column].set_xscale("log")
    for row, label in enumerate(("measured, %", "mean error, mm", "standard deviation, mm")):
        axes[row, 0].set_ylabel(label)
    _draw_published(axes[:, 0])
    for axis in axes[0]:
        axis.set_ylim(-5, 105)
    drawing.legend(
        *axes[2, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8
    )
    return drawing


def _draw_published(axes: Sequence[Axes]) -> None:
    named: set[str] = set()
    for point in PUBLISHED:
        row = ("fill", "bias", "sigma").index(point.what)
        marker = "v" if point.is_bound else "o"
        name = f"{point.model}: {point.source}"
        axes[row].plot(
            point.depth_m,
            point.value_mm,
            marker,
            color=MODELS[point.model],
            label=None if name in named or row != 2 else name,
        )
        named.add(name)
    depth_m = np.linspace(0.5, 5, 40)
    axes[2].plot(depth_m, blenderproc_mm(depth_m), "--", color="C1", label="BlenderProc's Azure")


if __name__ == "__main__":
    print("\n".join([*deviations(), *costs()]))
    curves().savefig(sys.argv[1], dpi=80)
