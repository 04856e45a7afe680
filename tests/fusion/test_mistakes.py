"""The thresholds of the checks for common mistakes, each with a case on its two sides; and the gate
of ICP.
"""

import re

import numpy as np
import pytest

pytest.importorskip("igl")
from iclnuim.benchmark.fusion.alignment import icp  # noqa: E402
from iclnuim.benchmark.fusion.mistakes import warnings  # noqa: E402
from iclnuim.benchmark.fusion.similarity_search import SimilaritySearch  # noqa: E402
from iclnuim.geometry.se3 import SE3  # noqa: E402
from iclnuim.raycast.distance import TriangleDistance  # noqa: E402

#: A box of 2 x 2 x 1 m, whose diagonal is 3 m.
BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 1)], float)
SIDES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5]]
    + [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)
SIZE_M = 3.0
MODEL = TriangleDistance(BOX, SIDES)


def on(points, triangles, n=5000, seed=0):
    rng = np.random.default_rng(seed)
    corners = points[triangles[rng.integers(0, len(triangles), n)]]
    return np.einsum("ni,nij->nj", rng.dirichlet((1, 1, 1), n), corners)


def advice(points, model=MODEL, mean_m=None):
    """The sentence about a reconstruction with this mean distance, by default its own."""
    if mean_m is None:
        mean_m = float(model.distance(points).mean())
    return " ".join(warnings(model, points, SE3.identity(), mean_m))


def anywhere():
    """Points in the box, which no motion brings near its sides."""
    return np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 1), (5000, 3))


def noisy(points, sigma_m):
    return points + np.random.default_rng(5).normal(0, sigma_m, points.shape)


@pytest.mark.parametrize("clutter_m", [0.0065, 0.03])
def test_icp_is_not_pulled_by_points_beyond_three_medians(clutter_m):
    """Half of the points of one wall are in front of it; the others have noise of 2 mm."""
    points = noisy(on(BOX, SIDES), 0.002)
    wall = np.flatnonzero(points[:, 0] > 0.99)
    points[wall[::2], 0] -= clutter_m
    T = SE3.exp(np.array([0.004, -0.003, 0.002, 0.001, 0.002, -0.001]))
    found = icp(MODEL, T.inverse().apply(points), SE3.identity())
    assert np.linalg.norm(found.translation - T.translation) < 0.0004


@pytest.mark.parametrize(("scale", "is_valid"), [(0.05, True), (0.033, False)])
def test_a_part_of_a_scene_has_at_least_4_percent_of_its_size(scale, is_valid):
    found = advice(anywhere() * scale + (0.5, 0, 0.5))
    assert ("unit} " in found) != is_valid


@pytest.mark.parametrize(("scale", "is_valid"), [(1.4, True), (1.9, False)])
def test_with_outliers_a_reconstruction_is_up_to_1_6_times_as_large(scale, is_valid):
    found = advice(anywhere() * scale)
    assert ("unit} " in found) != is_valid


@pytest.mark.parametrize(("mean_m", "is_near"), [(0.0045, True), (0.0075, False)])
def test_within_2_parts_in_1000_of_the_size_nothing_is_checked(mean_m, is_near):
    assert ("millimetres" not in advice(1000 * on(BOX, SIDES), mean_m=mean_m)) == is_near


@pytest.mark.parametrize(("mean_m", "is_other"), [(0.075, False), (0.12, True)])
def test_another_world_frame_is_farther_than_3_percent_of_the_size(mean_m, is_other):
    assert ("another world frame" in advice(anywhere(), mean_m=mean_m)) == is_other


@pytest.mark.parametrize(("sigma_m", "is_other"), [(0.0055, False), (0.0095, True)])
def test_what_icp_brings_near_is_in_no_other_world_frame(sigma_m, is_other):
    """Near: 2 parts in 1000 of the size, 6 mm; the mean of |noise| is 0.8 of its deviation."""
    points = noisy(on(BOX, SIDES), sigma_m)
    assert ("another world frame" in advice(points, mean_m=0.12)) == is_other


def without_symmetry(count):
    """A model of small triangles anywhere in a box, 3 m large, and points on it."""
    rng = np.random.default_rng(0)
    centres = rng.uniform(-1, 1, (count, 1, 3)) * (1, 1, 0.5)
    points = (centres + 0.1 * rng.normal(size=(count, 3, 3))).reshape(-1, 3)
    triangles = np.arange(len(points)).reshape(-1, 3)
    return TriangleDistance(points, triangles), on(points, triangles, 2000)


def test_a_reflection_that_a_symmetric_room_suggests_is_undone(monkeypatch):
    """As if the search without a reflection had missed it."""
    best = SimilaritySearch.best

    def missed(self, mirrored, scale):
        return best(self, mirrored, scale) if mirrored else None

    monkeypatch.setattr(SimilaritySearch, "best", missed)
    turned = SE3.exp(np.array([5.0, -2.0, 1.0, 0.9, -1.4, 0.6])).apply(on(BOX, SIDES))
    found = advice(turned)
    assert "another world frame" in found and "mirrored" not in found


@pytest.mark.parametrize(("sigma_m", "is_named"), [(0.024, True), (0.049, False)])
def test_a_mirrored_reconstruction_fits_within_1_percent_of_the_size(sigma_m, is_named):
    """22 and 45 mm. Nothing but a reflection fits a few triangles: rigid fits are 230 mm away."""
    model, points = without_symmetry(12)
    assert ("is mirrored" in advice(noisy(points * (-1, 1, 1), sigma_m), model)) == is_named


@pytest.mark.parametrize("sigma_m", [0.012, 0.018])
@pytest.mark.parametrize(("axes", "is_named"), [((-1, 1, 1), True), ((-1, -1, 1), False)])
def test_a_mirrored_reconstruction_fits_twice_as_well_as_any_rigid_motion(sigma_m, axes, is_named):
    """11 and 16 mm. Many triangles are near any point: rigid fits are 82 mm away."""
    model, points = without_symmetry(300)
    assert ("is mirrored" in advice(noisy(points * axes, sigma_m), model)) == is_named


def test_a_part_in_feet_whose_middle_is_elsewhere_is_found_from_anywhere():
    """Its middle is 0.4 of the model's extent from that of the model."""
    model, points = without_symmetry(60)
    part = points[points[:, 0] < 0.1]
    turned = SE3.exp(np.array([5.0, -2.0, 1.0, 0.9, -1.4, 0.6])).apply(part)
    found = advice(turned / 0.3048, model)
    assert "the reconstruction seems to be in feet" in found and "another world frame" in found
    assert float(re.search(r"distance is (\S+) mm instead", found)[1]) < 1


@pytest.mark.parametrize(("sigma_m", "is_named"), [(0.15, True), (0.45, False)])
def test_another_unit_fits_within_5_percent_of_the_size(sigma_m, is_named):
    """4 and 6 percent of the size of the reconstruction, which noise makes larger."""
    points = noisy(on(BOX, SIDES), sigma_m)
    assert ("millimetres" in advice(1000 * points)) == is_named


@pytest.mark.parametrize(("share", "is_named"), [(0.02, True), (0.09, False)])
def test_where_the_sizes_are_valid_another_unit_fits_twice_as_well(share, is_named):
    """A plate of 2 x 2 and 0.15 high in feet, as a model that is read in metres: as read, the mean
    distance is 12 percent of the reconstruction's size, in feet it is `share`.
    """
    plate = (BOX * (1, 1, 0)) + (0, 0, 0.15)
    model = TriangleDistance(plate, SIDES)
    points = on(plate, SIDES)
    points[:, 2] += np.random.default_rng(1).normal(0, share * np.sqrt(8) / 0.8, len(points))
    assert ("the model seems to be in feet" in advice(0.3048 * points, model)) == is_named
