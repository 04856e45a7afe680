"""Charts of trajectories: top view, position, speed and rotation rate over time, and the error of
an estimate.

They use Matplotlib without pyplot: no window, no global settings. Import this module only when
needed; that takes half a second.
"""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.ticker import MaxNLocator, NullFormatter
from matplotlib.transforms import Bbox

from ..errors import StrPath
from ..evaluation.absolute_error import AbsoluteError
from ..formats.files import atomic_write, check_picture
from ..geometry.axes import Z_UP_FROM_Y_DOWN
from ..geometry.se3 import SE3
from ..shown import COLOURS, MM
from ..trajectory_files.trajectories import ANCHORED_WORLD, LoadedTrajectory
from .trajectory_report import Report, title

REFERENCE_COLOUR = "0.75"
ESTIMATE_COLOUR = "tab:blue"
ROTATION_COLOUR = "tab:orange"
#: Places of a label around its point: alignments, and its distance in points.
_PLACES = tuple(
    (aside, above, (x * distance, y * distance))
    for distance in (4, 12, 20)
    for aside, above, x, y in (
        ("left", "bottom", 1, 1),
        ("left", "top", 1, -1),
        ("right", "bottom", -1, 1),
        ("right", "top", -1, -1),
    )
)
#: A line is interrupted where stamps are more than this number of median steps apart, so that
#: missing frames are visible.
GAP_STEPS = 5.0
#: Up to this number of values, each one has a marker.
FEW = 100


def trajectories_figure(named: list[tuple[str, LoadedTrajectory]]) -> Figure:
    """Top view on the left; position, speed and rotation rate over time on the right.

    Each trajectory is in its own world, z up.
    """
    figure = Figure(figsize=(13, 7), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.15))
    above = figure.add_subplot(grid[:, 0])
    over_time = [figure.add_subplot(grid[row, 1]) for row in range(3)]
    for i, (name, loaded) in enumerate(named):
        colour = COLOURS[i % len(COLOURS)]
        positions_m = positions_z_up_m(loaded)
        above.plot(*positions_m[:, :2].T, color=colour, linewidth=1.2, label=name)
        above.plot(*positions_m[0, :2], "o", color=colour, markersize=7)
        above.plot(*positions_m[-1, :2], "s", color=colour, markersize=6, markerfacecolor="white")
        _draw_over_time(over_time, loaded, colour, single=len(named) == 1)
    _label_plane(above, (0, 1))
    above.set_title("x-y plane, from above where z is up: start \u25cf, end \u25a1")
    above.legend(loc="best", fontsize="small")
    labels = ("position (m)", "speed (m/s)", "rotation rate (\u00b0/s)")
    for axes, label in zip(over_time, labels, strict=True):
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
    for axes in over_time[1:]:
        axes.set_ylim(bottom=0)
    over_time[2].set_xlabel("time since the first pose (s)")
    handles, names = over_time[0].get_legend_handles_labels()
    over_time[0].legend(handles[:3], names[:3], loc="best", fontsize="small", ncols=3)
    return figure


def positions_z_up_m(loaded: LoadedTrajectory) -> np.ndarray:
    """(n, 3) positions; those in the anchored worlds of gt.freiburg and gt.sim (y down) are rotated
    to z up.
    """
    positions_m = loaded.trajectory.positions_m
    if loaded.read_as.frame == ANCHORED_WORLD:
        return positions_m @ Z_UP_FROM_Y_DOWN.T
    return positions_m


def save(figure: Figure, path: StrPath, dpi: int = 110) -> None:
    """Write a figure atomically; the extension of the name is its format."""
    check_picture(path)
    atomic_write(path, lambda temporary: figure.savefig(temporary, dpi=dpi))


def pareto_panel(axes: Axes, points: Sequence[tuple[str, float, float, float, float]]) -> None:
    """Draw (name, cost, error, low, high) as dots with intervals on logarithmic scales, and a line
    through those that none beats in both.
    """
    best = math.inf
    front = []
    for k, (name, cost, value, low, high) in enumerate(sorted(points, key=lambda p: p[1])):
        colour = COLOURS[k % len(COLOURS)]
        ends = [[value - low], [high - value]]
        if not (math.isfinite(high) and low > 0):
            ends = [[0.0], [0.0]]
        axes.errorbar([cost], [value], yerr=ends, fmt="o", color=colour, markersize=5, capsize=3)
        axes.annotate(name, (cost, value), (5, 4), textcoords="offset points", fontsize=7)
        if value < best:
            best = value
            front.append((cost, value))
    axes.plot(*zip(*front, strict=True), drawstyle="steps-post", color="0.6", linewidth=1)
    axes.set(xscale="log", yscale="log")
    axes.margins(x=0.3, y=0.15)
    axes.grid(alpha=0.3)
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        if high < 10 * low:  # few powers of ten, or none
            axis.set_major_locator(MaxNLocator(4))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def spread_labels(figure: Figure) -> None:
    """Move the labels beside points so that none covers another of its panel, if there is room
    around its point. Call it last, as it needs the limits of the axes.
    """
    figure.draw_without_rendering()
    for axes in figure.axes:
        taken: list[Bbox] = []
        for label in (text for text in axes.texts if isinstance(text, Annotation)):
            taken.append(_placed(label, taken))


def _placed(label: Annotation, taken: list[Bbox]) -> Bbox:
    """The box of a label at the first place that is free; the first place of all if none is."""
    for place in (*_PLACES, _PLACES[0]):
        aside, above, label.xyann = place
        label.set(ha=aside, va=above)
        box = label.get_window_extent()
        if not any(box.overlaps(other) for other in taken):
            break
    return box


def _draw_over_time(axes: list[Axes], loaded: LoadedTrajectory, colour: str, single: bool) -> None:
    trajectory = loaded.trajectory
    positions_m = positions_z_up_m(loaded)
    time_s = trajectory.stamps_s - trajectory.stamps_s[0]
    for axis, style in enumerate(("-", "--", ":")):
        axis_colour = COLOURS[axis] if single else colour
        along = positions_m[:, axis]
        axes[0].plot(time_s, along, style, color=axis_colour, linewidth=1.2, label="xyz"[axis])
    steps_s = np.diff(time_s)
    middle_s = (time_s[1:] + time_s[:-1]) / 2
    turned_deg = np.degrees(trajectory.step_angles_rad())
    axes[1].plot(middle_s, trajectory.step_lengths_m() / steps_s, color=colour, linewidth=0.8)
    axes[2].plot(middle_s, turned_deg / steps_s, color=colour, linewidth=0.8)


# -- errors of an estimate


def error_figure(report: Report) -> Figure:
    """One figure with four charts."""
    figure = Figure(figsize=(11, 8), layout="constrained")
    figure.suptitle(title(report.to_dict()))
    (first, along), (over_time, rotation) = figure.subplots(2, 2)
    result = report.result
    stamps_s = report.result.stamps_s
    errors_mm = MM * report.result.translation_error_m
    if isinstance(result, AbsoluteError):
        truth = report.reference.loaded.trajectory  # complete: gaps of the estimate are visible
        plane = widest_axes(truth.positions_m)
        coloured = result.aligned
        along.set_title("the estimate, coloured by its error")
        _draw_truth(first, truth.stamps_s, truth.T_world_camera, plane, 3.0)
        _, broken = _with_gaps(stamps_s, result.aligned.translation)
        first.plot(*broken[:, plane].T, color=ESTIMATE_COLOUR, linewidth=1.2, label="estimate")
        first.set_title("trajectories")
        first.legend()
    else:
        shares = 100 * np.arange(1, len(errors_mm) + 1) / len(errors_mm)
        first.plot(np.sort(errors_mm), shares, color=ESTIMATE_COLOUR)
        first.set(title="RPE pairs within an error", xlabel="translation error (mm)")
        first.set(ylabel="share of RPE pairs (%)", xlim=(0, None), ylim=(0, 102))
        plane = widest_axes(result.reference.translation)
        coloured = result.reference[result.start]
        along.set_title("where the RPE pairs start, coloured by their error")
        _draw_truth(along, stamps_s, result.reference, plane, 1.2)
        stamps_s = stamps_s[result.start]
    x, y = coloured.translation[:, plane].T
    dots = along.scatter(x, y, c=errors_mm, s=7, cmap="viridis", zorder=3)
    figure.colorbar(dots, ax=along, label="translation error (mm)")
    _label_plane(along, plane)
    _series(over_time, stamps_s, errors_mm, "translation error (mm)", ESTIMATE_COLOUR)
    errors_deg = np.degrees(result.rotation_error_rad)
    if np.isfinite(errors_deg).all():
        _series(rotation, stamps_s, errors_deg, "rotation error (deg)", ROTATION_COLOUR)
    else:
        rotation.set_axis_off()  # positions alone
    return figure


def widest_axes(positions_m: np.ndarray) -> tuple[int, int]:
    """The two axes, in order, with the largest extents of positions (n, 3)."""
    a, b = sorted(np.argsort(np.ptp(positions_m, axis=0))[1:].tolist())
    return a, b


def _draw_truth(
    chart: Axes, stamps_s: np.ndarray, poses: SE3, plane: tuple[int, int], width: float
) -> None:
    _, broken = _with_gaps(stamps_s, poses.translation)
    x, y = broken[:, plane].T
    chart.plot(x, y, color=REFERENCE_COLOUR, linewidth=width, label="ground truth")
    _label_plane(chart, plane)


def _label_plane(chart: Axes, plane: tuple[int, int]) -> None:
    a, b = plane
    chart.set(xlabel=f"{'xyz'[a]} (m)", ylabel=f"{'xyz'[b]} (m)")
    chart.set_aspect("equal", adjustable="datalim")
    chart.grid(alpha=0.3)


def _series(chart: Axes, stamps_s: np.ndarray, errors: np.ndarray, label: str, colour: str) -> None:
    rmse = float(np.sqrt(np.mean(np.square(errors))))
    times_s, broken = _with_gaps(stamps_s, errors[:, None])
    marker = "." if len(errors) <= FEW else None
    chart.plot(times_s - stamps_s[0], broken[:, 0], color=colour, linewidth=0.9, marker=marker)
    chart.axhline(rmse, color="0.2", linestyle="--", linewidth=0.9, label=f"RMSE {rmse:.4g}")
    top = 1.08 * float(np.max(errors, initial=1e-9))
    chart.set(xlabel=f"time since {stamps_s[0]:.3f} s (s)", ylabel=label, ylim=(0, top))
    chart.grid(alpha=0.3)
    chart.legend()


def _with_gaps(stamps_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) and values (n, k) with a row of NaN at each gap."""
    steps_s = np.diff(stamps_s)
    usual_s = np.median(steps_s) if len(steps_s) else 0.0
    gaps = np.flatnonzero(steps_s > GAP_STEPS * usual_s) + 1
    return np.insert(stamps_s, gaps, np.nan), np.insert(values, gaps, np.nan, axis=0)


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points (the Pareto front) that no other point beats: none is at most as large in both quantities
    and smaller in one. Sorted by the first.
    """
    kept = [k for k, one in enumerate(points) if not any(_beats(other, one) for other in points)]
    return sorted(kept, key=lambda k: points[k])


def _beats(other: tuple[float, float], one: tuple[float, float]) -> bool:
    return other[0] <= one[0] and other[1] <= one[1] and other != one
