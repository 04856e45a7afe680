"""Draws what the models of sensors that people own do to a wall, beside published figures:
`python tools/sensor_curves.py docs/measured/pictures` writes a picture of each model, or of those
that are named after the folder. It prints the cost of an image of 640 x 480 (one core:
OPENBLAS_NUM_THREADS=1).
"""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.postprocess import noisy_depth
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: The D435's focal length; a narrow view, whose middle is one distance and one angle.
CAMERA = PinholeCamera(160, 120, 424.0, 424.0, 79.5, 59.5)
MIDDLE = np.s_[30:90, 60:100]
FRAMES = 12
MODELS = ("d435", "azure_kinect", "phone")
#: Diffuse reflectance of a white wall, and of the darkest target of Microsoft's ranges.
WHITE = 0.95
DARK = 0.15
AWAY_M = 2.0
#: Of a printed curve or table.
_TOLERANCE = 0.15
_UNITS = {"fill": "%", "bias": "mm", "sigma": "mm"}


@dataclass(frozen=True)
class Published:
    """A printed figure (fill in percent, bias and sigma in mm) of a wall that faces the camera.
    how: as it is printed. Ours has to be in low..high. apart: why it is not, where it is not.
    """

    model: str
    what: str
    depth_m: float
    how: str
    low: float
    high: float
    source: str
    albedo: float = WHITE
    apart: str = ""

    @property
    def is_bound(self) -> bool:
        return self.how.startswith("at most")

    @property
    def value(self) -> float:
        """Where it is drawn: the bound, or the middle."""
        return self.high if self.is_bound else (self.low + self.high) / 2


def printed(model: str, what: str, depth_m: float, value: float, source: str) -> Published:
    """A point of a printed curve or table."""
    spread = _TOLERANCE * value
    how = f"{value:.3g} {_UNITS[what]}"
    return Published(model, what, depth_m, how, value - spread, value + spread, source)


def bound(model: str, what: str, depth_m: float, most: float, source: str) -> Published:
    how = f"at most {most:.3g} {_UNITS[what]}"
    return Published(model, what, depth_m, how, -most, most, source)


_INTEL = "Intel, tuning paper: Z^2 s / (f b), s = 0.08 px"
_SUPPORT = "Intel's support, librealsense 7806"
_TOLGYESSY = "Tolgyessy and others 2021, as cited by BlenderProc"
_MICROSOFT = "Microsoft, hardware specification"
_ONE_DEVICE = "the calibration of one device, which differs in size and sign between devices"
#: The sources: docs/guide/sensors.md and the settings of the models.
PUBLISHED = (
    *(
        printed("d435", "sigma", z, 80 * z * z / (424 * 0.05), _INTEL)
        for z in (0.5, 1.0, 2.0, 3.0, 4.0)
    ),
    Published("d435", "sigma", 1.0, "2.5 to 5 mm", 2.5, 5.0, _SUPPORT),
    bound("d435", "sigma", 2.0, 40.0, "Ahn and others 2019, as cited by others"),
    bound("d435", "bias", 2.0, 40.0, "Intel, data sheet, as cited in librealsense 7806"),
    Published(
        *("d435", "bias", 1.0, "-19.3 mm", -22.2, -16.4, "M. Calvert 2018, one device"),
        apart=_ONE_DEVICE,
    ),
    printed("azure_kinect", "sigma", 1.0, 1.0, _TOLGYESSY),
    printed("azure_kinect", "sigma", 3.0, 3.6, _TOLGYESSY),
    bound("azure_kinect", "sigma", 3.5, 17.0, "Tolgyessy and others 2021, abstract; " + _MICROSOFT),
    *(
        bound("azure_kinect", "bias", z, 11 + 0.001 * 1000 * z, _MICROSOFT)
        for z in (1.0, 2.0, 3.0, 3.86)
    ),
    Published(
        *("azure_kinect", "fill", 0.49, "nothing nearer than 0.5 m", 0.0, 0.0, _MICROSOFT),
    ),
    Published(
        *("azure_kinect", "fill", 3.0, "15 % of reflectivity to 3.86 m", 99.0, 100.0, _MICROSOFT),
        albedo=DARK,
    ),
    bound("phone", "sigma", 1.0, 10.0, "Luetzenburg and others 2021, as cited by others"),
)


def tilted(depth_m: float, angle_deg: float) -> np.ndarray:
    """Depth (h, w) of a wall whose normal is turned by this angle from the optical axis."""
    tangent = np.tan(np.radians(angle_deg))
    slope = CAMERA.rays()[..., 0]
    return (depth_m / np.maximum(1 + slope * tangent, 1e-3)).astype(np.float32)


def figures(model: str, depth_m: float, angle_deg: float, albedo: float) -> dict[str, float]:
    """Share of measured pixels in percent, mean error and its standard deviation in mm."""
    depth = tilted(depth_m, angle_deg)
    # a single wall gets no light over another one, which takes long to compute
    settings = {"multipath": 0.0} if model == "azure_kinect" else {}
    errors = []
    for seed in range(FRAMES):
        noisy = noisy_depth(depth, model, CAMERA, seed, settings=settings, albedo=albedo)
        noisy = noisy[MIDDLE].astype(float)
        errors.append(np.where(noisy > 0, noisy - depth[MIDDLE], np.nan))
    error_mm = 1000 * np.stack(errors)
    known = error_mm[np.isfinite(error_mm)]
    some = known.size > 100
    return {
        "fill": 100 * known.size / error_mm.size,
        "bias": float(known.mean()) if some else np.nan,
        "sigma": float(known.std()) if some else np.nan,
    }


def of_model(point: Published) -> float:
    """What the model does where a figure is printed."""
    return figures(point.model, point.depth_m, 0, point.albedo)[point.what]


def blenderproc_mm(depth_m: np.ndarray) -> np.ndarray:
    """The sigma that BlenderProc's add_kinect_azure_noise adds, in mm."""
    return 0.5 + np.maximum(depth_m - 0.5, 0)


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


#: Label, values, and the depth, angle and albedo of each value.
Sweep = tuple[str, np.ndarray, Callable[[float], tuple[float, float, float]]]


def _sweeps(albedo: float) -> Sequence[Sweep]:
    return (
        ("distance in m, facing", np.linspace(0.4, 6, 225), lambda z: (z, 0, albedo)),
        ("angle in degrees, 2 m", np.linspace(0, 88, 23), lambda a: (AWAY_M, a, albedo)),
        ("albedo, 2 m, facing", np.geomspace(0.01, 0.95, 24), lambda r: (AWAY_M, 0, r)),
    )


def curves(model: str) -> Figure:
    """Rows: fill, bias, sigma. Columns: by distance, angle and albedo."""
    drawing = Figure(figsize=(12, 9), layout="constrained")
    axes = drawing.subplots(3, 3)
    _draw_model(axes, model, WHITE, "C0", f"{model}, white wall ({WHITE})")
    _draw_model(axes[:, :2], model, DARK, "0.3", f"{model}, dark wall ({DARK})")
    _draw_others(axes, model)
    _draw_published(axes[:, 0], model)
    for column, (label, _, _) in enumerate(_sweeps(WHITE)):
        axes[2, column].set_xlabel(label)
        axes[2, column].set_yscale("log")
        axes[0, column].set_ylim(-5, 105)
        for row in range(3):
            axes[row, column].grid(alpha=0.3)
    for axis in axes[:, 2]:
        axis.set_xscale("log")
    for row, label in enumerate(("measured, %", "mean error, mm", "standard deviation, mm")):
        axes[row, 0].set_ylabel(label)
    named: dict[str, Artist] = {}
    for axis in axes.ravel():
        named |= {text: line for line, text in zip(*axis.get_legend_handles_labels(), strict=True)}
    drawing.legend(
        list(named.values()), list(named), loc="outside lower center", ncols=2, fontsize=9
    )
    return drawing


def _draw_model(axes: np.ndarray, model: str, albedo: float, colour: str, label: str) -> None:
    style = "-" if albedo == WHITE else "--"
    for (_, values, place), column in zip(_sweeps(albedo), axes.T, strict=False):
        found = [figures(model, *place(value)) for value in values]
        for axis, what in zip(column, ("fill", "bias", "sigma"), strict=True):
            line = [f[what] for f in found]
            axis.plot(values, line, style, color=colour, label=label, linewidth=1.2)


def _draw_others(axes: np.ndarray, model: str) -> None:
    """What other programs add: beside the time-of-flight camera BlenderProc's function, beside the
    others the law of habitat-sim's Redwood noise.
    """
    if model != "azure_kinect":
        _draw_model(axes, "redwood", WHITE, "C1", "redwood, as habitat-sim's")
        return
    depth_m = np.linspace(0.5, 6, 60)
    axes[2, 0].plot(depth_m, blenderproc_mm(depth_m), color="C1", label="BlenderProc's Azure")
    for axis in axes[2, 1:]:
        axis.axhline(blenderproc_mm(np.array(AWAY_M)), color="C1")


def _draw_published(axes: Sequence[Axes], model: str) -> None:
    for point in PUBLISHED:
        if point.model != model:
            continue
        axis = axes[("fill", "bias", "sigma").index(point.what)]
        kind, marker = ("printed", "o")
        if point.apart:
            kind, marker = ("printed, and not as ours", "x")
        elif point.is_bound:
            kind, marker = ("printed bound, ours is below", "v")
        elif not point.how[0].isdigit() or " to " in point.how:
            kind, marker = ("printed range, ours is inside", "D")
        axis.plot(point.depth_m, point.value, marker, color="C3", label=kind, markersize=6)


if __name__ == "__main__":
    print("\n".join(costs()))
    for name in sys.argv[2:] or MODELS:
        curves(name).savefig(Path(sys.argv[1]) / f"sensors_{name}.png", dpi=70)
