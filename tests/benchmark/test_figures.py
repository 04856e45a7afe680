"""The paper's figures of what is there; where nothing is, a line that says what to run."""

import cv2
import numpy as np
import pytest
from iclnuim.benchmark.experiments.recipes.paper.charts import FIGURES, Material, draw
from iclnuim.benchmark.experiments.recipes.paper.keys import PaperKey
from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND
from iclnuim.benchmark.experiments.recipes.paper.sources import Sources
from iclnuim.benchmark.experiments.store import Store
from iclnuim.benchmark.fusion.pictures import clay
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.headless import cli
from iclnuim.raycast.caster import RayCaster
from iclnuim.tools import measured
from iclnuim.tools.measured_cells import PublishedCells
from made_up import only, results, written


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    """Cells of kt0 and kt1 with pictures; no sequences."""
    out = tmp_path_factory.mktemp("figures")
    found = [r for kt in ("kt0", "kt1") for r in only(results(1), trajectory=kt)]
    written(out, found)
    for r in found:
        for name in ("heat", "surface"):
            cv2.imwrite(
                str(out / "cells" / r.key.place / f"{name}.jpg"),
                np.full((6, 8, 3), 90, np.uint8),
            )
    return Material(Sources(out / "nothing", out), Store(out, KIND).read_all(PaperKey))


@pytest.mark.parametrize(
    ("number", "panels", "drawn"), [(5, 2, 1), (6, 5, 3), (7, 2, 1), (9, 4, 2)]
)
def test_a_figure_of_surfaces_shows_what_is_measured_and_names_what_is_not(
    material, number, panels, drawn
):
    figure = draw(number, material)
    axes = [a for a in figure.axes if a.get_visible() and a.get_title()]
    assert len(axes) == panels and sum(bool(a.images) for a in axes) == drawn
    missing = [a.get_title() for a in axes if any("not measured" in t.get_text() for t in a.texts)]
    assert len(missing) == panels - drawn and all("mean" not in title for title in missing)


@pytest.mark.parametrize("number", range(5, 10))
def test_every_figure_of_cells_shows_the_errors_of_those_that_the_checkout_has(tmp_path, number):
    cells = PublishedCells.read(measured.TOP / measured.CELLS).benchmark()
    figure = draw(number, Material(Sources(tmp_path, tmp_path), cells))
    shown = [a for a in figure.axes if a.get_title()]
    labels = [label.get_text() for a in shown if (box := a.get_legend()) for label in box.texts]
    words = labels if number == 8 else [a.get_title() for a in shown]
    assert words and all(" mm" in text for text in words)


def test_the_best_of_the_five_is_drawn_in_each_of_sixteen_panels(material):
    figure = draw(8, material)
    assert len(figure.axes) == 16 and sum(len(a.lines) == 2 for a in figure.axes) == 8
    panel = next(a for a in figure.axes if a.get_title() == "office kt1, noisy")
    mine = only(list(material.results), room="office", trajectory="kt1", noise="noisy")
    best = min(mine, key=lambda r: r.figures["ate_m"]["rmse"])
    assert best.key.odometer in panel.lines[1].get_label()
    assert f"{1e3 * best.figures['ate_m']['rmse']:.2f} mm" in panel.lines[1].get_label()


@pytest.mark.parametrize("number", sorted(set(FIGURES) - {1}))
def test_without_data_a_figure_says_what_to_run(tmp_path, number):
    with pytest.raises(InputError, match="try iclnuim (make|benchmark)"):
        draw(number, Material(Sources(tmp_path, tmp_path), []))


def test_clay_is_darker_where_surfaces_stand_around_a_place():
    """A floor two metres before the camera, and a wall that stands on its right half."""
    corners = [
        (-3, -3, 2),
        (3, -3, 2),
        (3, 3, 2),
        (-3, 3, 2),
        (1, -3, 2),
        (1, 3, 2),
        (1, 3, 1),
        (1, -3, 1),
    ]
    triangles = [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)]
    caster = RayCaster(np.array(corners, float), np.array(triangles))
    image = clay(caster, PinholeCamera(80, 60, 40, 40, 39.5, 29.5), SE3.identity(), rays=64)
    assert image.shape == (60, 80, 3) and image.dtype == np.uint8
    assert image[30, 57].mean() < 0.85 * image[30, 40].mean()


def test_the_command_writes_a_picture(material, tmp_path, capsys):
    target, out = tmp_path / "5.png", str(material.sources.out)
    assert cli.main(["figure", "5", "-o", str(target), "--benchmark", out]) == 0
    assert target.read_bytes().startswith(b"\x89PNG")
    assert cli.main(["figure", "2", "-o", str(target), "--data", out]) == 2
    assert "iclnuim make living_room/kt0" in capsys.readouterr().err
