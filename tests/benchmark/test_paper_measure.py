"""What a cell of the paper's experiment stores for charts and pictures."""

import json

import numpy as np
import pytest

pytest.importorskip("cv2")
from iclnuim import shipped  # noqa: E402
from iclnuim.benchmark.experiments.recipes.paper.measure import _drawn  # noqa: E402
from iclnuim.benchmark.experiments.recipes.paper.surface import _draw  # noqa: E402
from iclnuim.benchmark.fusion import pictures  # noqa: E402
from iclnuim.benchmark.fusion.mesh import Mesh  # noqa: E402
from iclnuim.evaluation.absolute_error import absolute_error  # noqa: E402
from iclnuim.formats.images import read_colour8  # noqa: E402
from iclnuim.trajectory_files.trajectories import read_trajectory  # noqa: E402


def beside_m(points_m, line_m):
    """(n,) distance of points (n, 3) from a line through `line_m` (k, 3)."""
    distances_m = np.full(len(points_m), np.inf)
    for begin, end in zip(line_m[:-1], line_m[1:], strict=True):
        along = end - begin
        share = np.clip((points_m - begin) @ along / max(along @ along, 1e-12), 0, 1)
        there = points_m - begin - share[:, None] * along
        distances_m = np.minimum(distances_m, np.linalg.norm(there, axis=1))
    return distances_m


def test_a_stored_path_is_the_path_to_millimetres_and_some_kilobytes():
    """The longest sequence, of 1510 frames; a chart of 7 m has 10 mm a pixel, and a page holds the
    paths of more than a hundred cells.
    """
    truth = read_trajectory(shipped.trajectory_file("living_room/kt0")).trajectory
    drawn = _drawn(truth, absolute_error(truth, truth), None)
    assert beside_m(truth.positions_m, np.array(drawn["truth_m"])).max() < 0.006
    assert len(json.dumps(drawn)) < 30_000


def test_pictures_of_a_surface_have_the_shape_of_the_images(tmp_path):
    """Four to three."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    mesh = Mesh(points, np.array([[0, 1, 2]]), np.full((3, 3), 200, np.uint8))
    _draw(tmp_path, mesh, points, np.zeros(3))
    for name in ("surface", "heat"):
        height, width = read_colour8(tmp_path / f"{name}.jpg").shape[:2]
        assert width / height == pytest.approx(4 / 3, rel=0.01)


@pytest.mark.parametrize(("width", "height"), [(64, 64), (96, 64), (40, 80)])
def test_pixels_of_a_picture_of_a_surface_are_square(width, height):
    directions = pictures._rays(np.zeros(3), 1.0, width, height)[1].reshape(height, width, 3)
    middle = directions[height // 2, width // 2]
    right = np.linalg.norm(directions[height // 2, width // 2 + 1] - middle)
    down = np.linalg.norm(directions[height // 2 + 1, width // 2] - middle)
    assert right == pytest.approx(down, rel=0.05)
