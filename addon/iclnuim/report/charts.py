"""Pictures of trajectories: the path from above, and position, speed and rotation rate over time.

Matplotlib's Agg canvas without pyplot: no window, no global settings. Import this module late, it takes half a second.
"""

import os

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..formats.columns import ANCHORED_WORLD
from ..formats.files import atomic_write, check_picture
from ..formats.trajectories import LoadedTrajectory
from ..geometry.axes import Z_UP_FROM_Y_DOWN

#: Told apart also without colour vision (Okabe and Ito's set, without yellow).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")


def trajectories_figure(named: list[tuple[str, LoadedTrajectory]]) -> Figure:
    """Top view on the left; position, speed and rotation rate over time on the right. Each in its own world, z up."""
    figure = Figure(figsize=(13, 7), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.15))
    above = figure.add_subplot(grid[:, 0])
    over_time = [figure.add_subplot(grid[row, 1]) for row in range(3)]
    for i, (name, loaded) in enumerate(named):
        colour = COLOURS[i % len(COLOURS)]
        _draw_above(above, positions_z_up_m(loaded), name, colour)
        _draw_over_time(over_time, loaded, colour, alone=len(named) == 1)
    _label(above, over_time)
    return figure


def positions_z_up_m(loaded: LoadedTrajectory) -> np.ndarray:
    """(n, 3): as they are, but the anchored worlds of gt.freiburg and gt.sim (y down) turned z up."""
    positions_m = loaded.trajectory.positions_m
    return positions_m @ Z_UP_FROM_Y_DOWN.T if loaded.read_as.frame == ANCHORED_WORLD else positions_m


def save(figure: Figure, path: str | os.PathLike[str], dpi: int = 110) -> None:
    """Write a figure, whole or not at all; the name's ending is its format."""
    check_picture(path)
    atomic_write(path, lambda temporary: figure.savefig(temporary, dpi=dpi))


def _draw_above(axes: Axes, positions_m: np.ndarray, name: str, colour: str) -> None:
    axes.plot(positions_m[:, 0], positions_m[:, 1], color=colour, linewidth=1.2, label=name)
    axes.plot(*positions_m[0, :2], "o", color=colour, markersize=7)
    axes.plot(*positions_m[-1, :2], "s", color=colour, markersize=6, markerfacecolor="white")


def _draw_over_time(axes: list[Axes], loaded: LoadedTrajectory, colour: str, alone: bool) -> None:
    trajectory, positions_m = loaded.trajectory, positions_z_up_m(loaded)
    time_s = trajectory.stamps_s - trajectory.stamps_s[0]
    for axis, style in enumerate(("-", "--", ":")):
        own = COLOURS[axis] if alone else colour
        axes[0].plot(time_s, positions_m[:, axis], style, color=own, linewidth=1.2, label="xyz"[axis])
    steps_s, middle_s = np.diff(time_s), (time_s[1:] + time_s[:-1]) / 2
    axes[1].plot(middle_s, trajectory.step_lengths_m() / steps_s, color=colour, linewidth=0.8)
    axes[2].plot(middle_s, np.degrees(trajectory.step_angles_rad()) / steps_s, color=colour, linewidth=0.8)


def _label(above: Axes, over_time: list[Axes]) -> None:
    above.set(title="x-y plane, from above where z is up: start \u25cf, end \u25a1", xlabel="x [m]", ylabel="y [m]")
    above.set_aspect("equal", adjustable="datalim")
    above.legend(loc="best", fontsize="small")
    for axes, label in zip(over_time, ("position [m]", "speed [m/s]", "rotation rate [\u00b0/s]"), strict=True):
        axes.set_ylabel(label)
    for axes in over_time[1:]:
        axes.set_ylim(bottom=0)
    over_time[2].set_xlabel("time since the first pose [s]")
    handles, labels = over_time[0].get_legend_handles_labels()
    over_time[0].legend(handles[:3], labels[:3], loc="best", fontsize="small", ncols=3)
    for axes in (above, *over_time):
        axes.grid(alpha=0.3)
