"""The paper's figures 1 to 9, drawn from our rooms, frames and cells."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.benchmark.fusion.pictures import clay
from iclnuim.dataset.frames import find_pairs, read_camera, read_images
from iclnuim.errors import InputError
from iclnuim.formats.files import read_json
from iclnuim.formats.images import read_colour8
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.raycast.caster import RayCaster
from iclnuim.report.charts import COLOURS, REFERENCE_COLOUR, widest_axes
from matplotlib import colormaps, colors
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from .cells import NOISES, TITLES, Cell
from .lookup import Ours, ate_of, surface_of
from .measure import HEAT_MM
from .sources import Sources

#: Viewpoints of figure 1: trajectory, and position as a share of its length.
_INTERIOR = (("kt2", 0.0), ("kt3", 0.45))
#: Frames of figures 2 and 3, and of figure 4, as shares of a trajectory.
_PLACES, _NOISY_PLACES = (0.1, 0.5, 0.9), (0.0, 0.6)
_ERROR_M = 0.05


@dataclass(frozen=True, eq=False)
class Material:
    """Input of the figures. results: cells of a benchmark, of which those of `preset` are used."""

    sources: Sources
    results: Sequence[dict]
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
        poses = read_trajectory(
            shipped.trajectory_file(f"living_room/{name}")
        ).trajectory.T_world_camera
        axes.imshow(clay(caster, PinholeCamera(), poses[int(share * (len(poses) - 1))]))
    return figure


def _frames(room: str, number: int) -> Callable[[Material], Figure]:
    """2 and 3: frames from each trajectory that exists."""

    def drawn(material: Material) -> Figure:
        there = [
            kt
            for kt in shipped.TRAJECTORY_NAMES
            if (material.sources.data / room / kt / "clean").is_dir()
        ]
        if not there:
            raise _lacking(
                number,
                f"frames of the {shipped.SCENES[room].title.lower()}",
                f"iclnuim make {room}/kt0",
            )
        title = f"Figure {number}. Frames of the {shipped.SCENES[room].title.lower()} at different poses."
        figure, panels = _grid(len(there), len(_PLACES), title)
        for row, kt in zip(panels, there, strict=True):
            pairs = find_pairs(material.sources.data / room / kt / "clean")[: material.first]
            for axes, share in zip(row, _PLACES, strict=True):
                pair = pairs[int(share * (len(pairs) - 1))]
                axes.imshow(read_colour8(pair.rgb))
                axes.set_title(f"{kt}, frame {pair.number}", fontsize=9)
        return figure

    return drawn


def _noise(material: Material) -> Figure:
    """4: depth without and with noise, and their difference."""
    there = [
        (room, kt)
        for room, kt in product(shipped.SCENE_NAMES, shipped.TRAJECTORY_NAMES)
        if _both(material, room, kt)
    ]
    if not there:
        raise _lacking(4, "a clean and a noisy sequence", "iclnuim make living_room/kt0")
    folder = material.sources.data.joinpath(*there[0])
    figure, panels = _grid(
        len(_NOISY_PLACES),
        3,
        f"Figure 4. Depth of {'/'.join(there[0])} without and with the sensor's noise.",
    )
    clean, noisy = (find_pairs(folder / noise)[: material.first] for noise in NOISES)
    camera = read_camera(folder / "clean", clean[0].rgb)
    for row, share in zip(panels, _NOISY_PLACES, strict=True):
        k = int(share * (min(len(clean), len(noisy)) - 1))
        truth, measured = (read_images(pairs[k], camera)[1] for pairs in (clean, noisy))
        ends = np.percentile(truth[truth > 0], (1, 99))
        for axes, depth, name in zip(
            row, (truth, measured), ("without noise", "with noise"), strict=False
        ):
            axes.imshow(np.where(depth > 0, depth, np.nan), cmap="gray", vmin=ends[0], vmax=ends[1])
            axes.set_title(f"frame {clean[k].number} {name}", fontsize=9)
        both = (truth > 0) & (measured > 0)
        image = row[2].imshow(
            np.where(both, measured - truth, np.nan), cmap="coolwarm", vmin=-_ERROR_M, vmax=_ERROR_M
        )
        row[2].set_title("difference", fontsize=9)
        row[2].set_facecolor("0.2")
        figure.colorbar(image, ax=row[2], label="m", shrink=0.8, extend="both")
    return figure


def _both(material: Material, room: str, trajectory: str) -> bool:
    return all((material.sources.data / room / trajectory / noise).is_dir() for noise in NOISES)


# -- 5, 6, 7, 9: surfaces


def _surfaces(number: int, room: str) -> Callable[[Material], Figure]:
    """5 and 7: surfaces fused along ICP's trajectories."""
    cells = [(room, kt, "clean", "icp") for kt in ("kt1", "kt2")]
    title = f"Figure {number}. Surfaces of the {shipped.SCENES[room].title.lower()} along ICP's trajectories kt1 and kt2."
    return lambda material: _pictures(material, number, cells, "surface", title)


def _heat_maps(number: int, noise: str) -> Callable[[Material], Figure]:
    """6 and 9: surfaces coloured by their error."""
    cells = [("living_room", kt, noise, "icp") for kt in shipped.TRAJECTORY_NAMES]
    if noise == "clean":
        cells.insert(0, ("living_room", "kt0", noise, "dvo"))
    title = f"Figure {number}. Surfaces of the living room by their distance to the model, {noise}, along ICP's trajectories{' except where noted' if noise == 'clean' else ''}."
    return lambda material: _pictures(material, number, cells, "heat", title)


def _pictures(
    material: Material, number: int, cells: list[tuple[str, str, str, str]], kind: str, title: str
) -> Figure:
    """A grid of the cells' surface.jpg or heat.jpg."""
    ours = Ours(material.results, material.preset)
    found = [ours.result(*cell) for cell in cells]
    if not any("surface" in result for result in found):
        room, _, noise, _ = cells[0]
        odometers = ",".join(sorted({cell[3] for cell in cells}))
        raise _lacking(
            number, "measured cells", f"iclnuim benchmark --only {room}/{noise}/{odometers}"
        )
    columns = 2 if len(cells) < 5 else 3
    figure, panels = _grid(-(-len(cells) // columns), columns, title)
    for axes in panels.flat[len(cells) :]:
        axes.set_visible(False)
    for axes, (_, kt, _, odometer), result in zip(panels.flat, cells, found, strict=False):
        name = f"{kt} ({TITLES[odometer]})" if odometer != "icp" else kt
        path = result["folder"] / f"{kind}.jpg" if result else Path()
        if not path.is_file():
            axes.text(
                0.5,
                0.5,
                "not measured",
                ha="center",
                va="center",
                transform=axes.transAxes,
                color="grey",
            )
            axes.set_title(name, fontsize=10)
            continue
        axes.imshow(read_colour8(path))
        axes.set_title(
            f"{name}: mean {1e3 * (surface_of(result) or 0):.2f} mm, ATE {1e3 * (ate_of(result) or 0):.2f} mm",
            fontsize=10,
        )
    if kind == "heat":
        scale = ScalarMappable(colors.LogNorm(*HEAT_MM), colormaps["turbo"])
        figure.colorbar(
            scale, ax=panels, label="distance to the model [mm]", extend="both", shrink=0.7
        )
    return figure


# -- 8: trajectories


def _best_trajectories(material: Material) -> Figure:
    """8: for each sequence, the estimate with the least ATE of the five, over the true trajectory."""
    rows = list(product(NOISES, shipped.SCENE_NAMES))
    figure = Figure(figsize=(13, 13), layout="constrained")
    figure.suptitle(
        "Figure 8. The best of the five odometers on each sequence (colour) over the ground truth (grey)."
    )
    panels, drawn = figure.subplots(len(rows), 4), 0
    for row, (noise, room) in zip(panels, rows, strict=True):
        for axes, kt in zip(row, shipped.TRAJECTORY_NAMES, strict=True):
            axes.set_title(f"{room.replace('_', ' ')} {kt}, {noise}", fontsize=9)
            drawn += _draw_best(
                axes,
                [
                    r
                    for r in material.results
                    if _is_ours(r["cell"], room, kt, noise, material.preset)
                ],
            )
    if not drawn:
        raise _lacking(8, "measured cells", "iclnuim benchmark")
    return figure


def _is_ours(cell: Cell, *expected: str) -> bool:
    return (
        (cell.room, cell.trajectory, cell.noise, cell.preset) == expected
        and not cell.external
        and cell.seed == 0
    )


def _draw_best(axes: Axes, results: list[dict]) -> bool:
    """Draw the best result; False if there is none."""
    measured = [
        r for r in results if ate_of(r) is not None and (r["folder"] / "path.json").is_file()
    ]
    if not measured:
        axes.text(
            0.5,
            0.5,
            "not measured",
            ha="center",
            va="center",
            transform=axes.transAxes,
            color="grey",
        )
        axes.set_axis_off()
        return False
    best = min(measured, key=lambda r: ate_of(r) or 0.0)
    path = read_json(best["folder"] / "path.json")
    truth_m, estimate_m = np.array(path["truth_m"]), np.array(path["estimate_m"])
    a, b = widest_axes(truth_m)
    cell, colour = best["cell"], COLOURS[list(TITLES).index(best["cell"].odometer) % len(COLOURS)]
    name = f"{cell.title}{' with a model' if cell.reference == 'model' else ''}, {1e3 * (ate_of(best) or 0):.2f} mm"
    axes.plot(truth_m[:, a], truth_m[:, b], color=REFERENCE_COLOUR, linewidth=4)
    axes.plot(estimate_m[:, a], estimate_m[:, b], color=colour, linewidth=1, label=name)
    axes.set(xlabel=f"{'xyz'[a]} [m]", ylabel=f"{'xyz'[b]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.tick_params(labelsize=7)
    axes.legend(fontsize=7, loc="best")
    return True


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
