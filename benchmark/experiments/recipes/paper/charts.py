"""The paper's figures 1 to 9, drawn from our rooms, frames and cells."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from iclnuim import shipped
from iclnuim.benchmark.fusion.pictures import clay
from iclnuim.errors import InputError
from iclnuim.formats.images import read_colour8
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.raycast.caster import RayCaster
from iclnuim.report.charts import COLOURS, REFERENCE_COLOUR, widest_axes
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.trajectory_files.trajectories import read_trajectory
from matplotlib import colormaps, colors
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from ...cell import Measured
from ...table import NOT_MEASURED
from .figures import Ours, Where, ate_of, surface_of
from .keys import HEAT_MM, NOISES, paper_odometers
from .sources import Sources

#: Viewpoints of figure 1: trajectory, and position as a share of its length.
_INTERIOR = (("kt2", 0.0), ("kt3", 0.45))
#: Frames of figures 2 and 3, and of figure 4, as shares of a trajectory.
_PLACES = (0.1, 0.5, 0.9)
_NOISY_PLACES = (0.0, 0.6)
_ERROR_M = 0.05


@dataclass(frozen=True, eq=False)
class Material:
    """Input of the figures. results: cells of a benchmark, of which those of `preset` are used."""

    sources: Sources
    results: Sequence[Measured]
    preset: str = "best"
    first: int | None = None


def draw(number: int, material: Material) -> Figure:
    """Draw a figure.

    Raises InputError, with the command to run, if all its data is missing; single panels show what
    they lack.
    """
    return FIGURES[number][0](material)


# -- 1 to 4: room, frames, noise


def _interior(material: Material) -> Figure:
    """1: the living room without colours."""
    with np.load(material.sources.model("living_room")) as model:
        caster = RayCaster(model["points"], model["triangles"])
    figure, panels = _grid(1, 2, "Figure 1. The interior of the living room, without its colours.")
    for axes, (name, share) in zip(panels.flat, _INTERIOR, strict=True):
        file = shipped.trajectory_file(f"living_room/{name}")
        poses = read_trajectory(file).trajectory.T_world_camera
        axes.imshow(clay(caster, PinholeCamera(), poses[int(share * (len(poses) - 1))]))
    return figure


def _room(name: str) -> str:
    return shipped.SCENES[name].title.lower()


def _frames(room: str, number: int) -> Callable[[Material], Figure]:
    """2 and 3: frames from each trajectory that exists."""

    def drawn(material: Material) -> Figure:
        folders = [material.sources.data / room / kt / "clean" for kt in shipped.TRAJECTORY_NAMES]
        there = [folder for folder in folders if folder.is_dir()]
        if not there:
            raise _lacking(number, f"frames of the {_room(room)}", f"iclnuim make {room}/kt0")
        title = f"Figure {number}. Frames of the {_room(room)} at different poses."
        figure, panels = _grid(len(there), len(_PLACES), title)
        for row, folder in zip(panels, there, strict=True):
            pairs = StoredSequence(folder).pairs[: material.first]
            for axes, share in zip(row, _PLACES, strict=True):
                pair = pairs[int(share * (len(pairs) - 1))]
                axes.imshow(read_colour8(pair.rgb))
                axes.set_title(f"{folder.parent.name}, frame {pair.number}", fontsize=9)
        return figure

    return drawn


def _noise(material: Material) -> Figure:
    """4: depth without and with noise, and their difference."""
    there = [name for name in shipped.paper_sequences() if _both(material, name)]
    if not there:
        raise _lacking(4, "a clean and a noisy sequence", "iclnuim make living_room/kt0")
    folder = material.sources.data / there[0]
    title = f"Figure 4. Depth of {there[0]} without and with the sensor's noise."
    figure, panels = _grid(len(_NOISY_PLACES), 3, title)
    sequence = StoredSequence(folder / "clean")
    clean = sequence.pairs[: material.first]
    noisy = StoredSequence(folder / "noisy").pairs[: material.first]
    for row, share in zip(panels, _NOISY_PLACES, strict=True):
        k = int(share * (min(len(clean), len(noisy)) - 1))
        truth = sequence.images(clean[k])[1]
        measured = sequence.images(noisy[k])[1]
        low, high = np.percentile(truth[truth > 0], (1, 99))
        names = ("without noise", "with noise")
        for axes, depth, name in zip(row[:2], (truth, measured), names, strict=True):
            axes.imshow(np.where(depth > 0, depth, np.nan), cmap="gray", vmin=low, vmax=high)
            axes.set_title(f"frame {clean[k].number} {name}", fontsize=9)
        both = (truth > 0) & (measured > 0)
        error_m = np.where(both, measured - truth, np.nan)
        image = row[2].imshow(error_m, cmap="coolwarm", vmin=-_ERROR_M, vmax=_ERROR_M)
        row[2].set_title("difference", fontsize=9)
        row[2].set_facecolor("0.2")
        figure.colorbar(image, ax=row[2], label="m", shrink=0.8, extend="both")
    return figure


def _both(material: Material, sequence: str) -> bool:
    return all((material.sources.data / sequence / noise).is_dir() for noise in NOISES)


# -- 5, 6, 7, 9: surfaces


def _surfaces(number: int, room: str) -> Callable[[Material], Figure]:
    """5 and 7: surfaces fused along icp's trajectories."""
    cells = [Where(room, kt, "clean", "icp") for kt in ("kt1", "kt2")]
    title = f"Surfaces of the {_room(room)} along icp's trajectories kt1 and kt2."
    return lambda material: _pictures(material, number, cells, "surface", title)


def _heat_maps(number: int, noise: str) -> Callable[[Material], Figure]:
    """6 and 9: surfaces coloured by their error."""
    cells = [Where("living_room", kt, noise, "icp") for kt in shipped.TRAJECTORY_NAMES]
    how = f"Surfaces of the living room by their distance to the model, {noise}"
    along = "along icp's trajectories"
    if noise == "clean":
        cells.insert(0, Where("living_room", "kt0", noise, "dvo"))
        along += " except where noted"
    return lambda material: _pictures(material, number, cells, "heat", f"{how}, {along}.")


def _pictures(
    material: Material, number: int, cells: Sequence[Where], kind: str, title: str
) -> Figure:
    """A grid of the cells' surface.jpg or heat.jpg, with their errors."""
    ours = Ours(material.results, material.preset)
    if not any(ours.figures(cell) for cell in cells):
        odometers = ",".join(sorted({cell.odometer for cell in cells}))
        only = f"{cells[0].room}/{cells[0].noise}/{odometers}"
        raise _lacking(number, "measured cells", f"iclnuim benchmark --only {only}")
    columns = 2 if len(cells) < 5 else 3
    figure, panels = _grid(-(-len(cells) // columns), columns, f"Figure {number}. {title}")
    for axes in panels.flat[len(cells) :]:
        axes.set_visible(False)
    for axes, cell in zip(panels.flat, cells, strict=False):
        name = cell.trajectory
        if cell.odometer != "icp":
            name += f" ({cell.odometer})"
        axes.set_title(name + _errors(ours.figures(cell)), fontsize=10)
        result = ours.result(cell)
        if result is None or surface_of(result.figures) is None:
            _write_in(axes, f"surface {NOT_MEASURED}")
            continue
        path = result.folder / f"{kind}.jpg"
        if result.folder.name and path.is_file():
            axes.imshow(read_colour8(path))
        else:
            _write_in(axes, "picture not kept")
    if kind == "heat":
        scale = ScalarMappable(colors.LogNorm(*HEAT_MM), colormaps["turbo"])
        label = "distance to the model [mm]"
        figure.colorbar(scale, ax=panels, label=label, extend="both", shrink=0.7)
    return figure


def _errors(figures: Mapping[str, Any]) -> str:
    """`: mean 0.28 mm, ATE 0.04 mm`: those that are measured."""
    named = {"mean": surface_of(figures), "ATE": ate_of(figures)}
    words = [f"{name} {1e3 * value:.2f} mm" for name, value in named.items() if value is not None]
    return f": {', '.join(words)}" if words else ""


def _write_in(axes: Axes, words: str) -> None:
    """Write words in the middle of a panel without a picture."""
    text = axes.text(0.5, 0.5, words, ha="center", va="center", color="grey")
    text.set_transform(axes.transAxes)


# -- 8: trajectories


def _best_trajectories(material: Material) -> Figure:
    """8: for each sequence, the best estimate of the five over the true trajectory."""
    rows = list(product(NOISES, shipped.paper_scenes()))
    figure = Figure(figsize=(13, 13), layout="constrained")
    what = "The best of the five odometers on each sequence (colour) over the ground truth (grey)"
    figure.suptitle(f"Figure 8. {what}.")
    panels = figure.subplots(len(rows), 4)
    drawn = 0
    for row, (noise, room) in zip(panels, rows, strict=True):
        for axes, kt in zip(row, shipped.TRAJECTORY_NAMES, strict=True):
            axes.set_title(f"{room.replace('_', ' ')} {kt}, {noise}", fontsize=9)
            drawn += _draw_best(axes, _of_the_five(material, (room, kt, noise)))
    if not drawn:
        raise _lacking(8, "measured cells", "iclnuim benchmark")
    return figure


def _of_the_five(material: Material, place: tuple[str, str, str]) -> list[Measured]:
    """The measured trajectories of the five odometers on a sequence."""
    found = []
    for result in material.results:
        key = result.key
        there = (key.room, key.trajectory, key.noise) == place and key.seed == 0
        ours = key.odometer in paper_odometers() and key.preset == material.preset
        if there and ours and ate_of(result.figures) is not None:
            found.append(result)
    return found


def _draw_best(axes: Axes, results: Sequence[Measured]) -> bool:
    """Draw the best result; False if there is none."""
    if not results:
        _write_in(axes, NOT_MEASURED)
        axes.set_axis_off()
        return False
    best = min(results, key=lambda r: ate_of(r.figures) or 0.0)
    truth_m, estimate_m = _paths(best)
    a, b = widest_axes(truth_m)
    key = best.key
    colour = COLOURS[paper_odometers().index(key.odometer) % len(COLOURS)]
    name = f"{key.odometer} with a model" if key.against_model else key.odometer
    name += f", {1e3 * (ate_of(best.figures) or 0):.2f} mm"
    axes.plot(truth_m[:, a], truth_m[:, b], color=REFERENCE_COLOUR, linewidth=4)
    if not len(estimate_m):
        name += " (path not kept)"
    axes.plot(estimate_m[:, a], estimate_m[:, b], color=colour, linewidth=1, label=name)
    axes.set(xlabel=f"{'xyz'[a]} [m]", ylabel=f"{'xyz'[b]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.tick_params(labelsize=7)
    axes.legend(fontsize=6, loc="best", handlelength=1)
    return True


def _paths(result: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) in metres of the true and of the estimated trajectory; the estimate of a
    shipped cell is empty.
    """
    if path := result.figures.get("path"):
        return np.array(path["truth_m"]), np.array(path["estimate_m"])
    file = shipped.trajectory_file(f"{result.key.room}/{result.key.trajectory}")
    truth = read_trajectory(file).trajectory.T_world_camera
    return truth.translation, np.empty((0, 3))


def _grid(rows: int, columns: int, title: str) -> tuple[Figure, np.ndarray]:
    """A figure with panels without axes, in the shape of the images."""
    figure = Figure(figsize=(4.4 * columns + 0.4, 3.4 * rows + 0.5), layout="constrained")
    figure.suptitle(title, fontsize=11)
    panels = figure.subplots(rows, columns, squeeze=False)
    for axes in panels.flat:
        axes.set(xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set_visible(False)
    return figure, panels


def _lacking(number: int, what: str, command: str) -> InputError:
    return InputError(f"{what} for figure {number}", found="none", hint=command)


#: Number -> (function that draws the figure, its content).
FIGURES: dict[int, tuple[Callable[[Material], Figure], str]] = {
    1: (_interior, "the living room without its colours"),
    2: (_frames("living_room", 2), "frames of the living room"),
    3: (_frames("office", 3), "frames of the office"),
    4: (_noise, "depth with noise"),
    5: (_surfaces(5, "living_room"), "surfaces of the living room"),
    6: (_heat_maps(6, "clean"), "heat maps of the living room, clean"),
    7: (_surfaces(7, "office"), "surfaces of the office"),
    8: (_best_trajectories, "the best trajectories"),
    9: (_heat_maps(9, "noisy"), "heat maps of the living room, noisy"),
}
