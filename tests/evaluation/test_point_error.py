"""Errors of point maps: equal to formulas written here, a planted similarity is found, and what
cannot be compared is refused.
"""

import numpy as np
import pytest
from iclnuim import SE3, point_error
from iclnuim.errors import InputError


@pytest.fixture
def points():
    """Points (3, 12, 16, 3) of three cameras in one world, and the cameras' centres."""
    rng = np.random.default_rng(2)
    return rng.uniform([-2, -2, 1], [2, 2, 5], (3, 12, 16, 3)), rng.uniform(-1, 1, (3, 3))


def test_figures_equal_the_formulas(points):
    true_m, centres = points
    predicted = true_m + np.random.default_rng(0).normal(0, 0.3, true_m.shape)
    found = point_error(true_m, predicted, "none", centres=centres)
    figures = {"mean_m": [], "median_m": [], "rmse_m": [], "abs_rel": [], "delta1": []}
    for t, p, c in zip(true_m, predicted, centres, strict=True):
        error = np.linalg.norm(t - p, axis=-1)
        far = np.linalg.norm(t - c, axis=-1)
        figures["mean_m"].append(error.mean())
        figures["median_m"].append(np.median(error))
        figures["rmse_m"].append(np.sqrt(np.mean(error**2)))
        figures["abs_rel"].append(np.mean(error / far))
        figures["delta1"].append(
            np.mean(error < 0.25 * np.minimum(far, np.linalg.norm(p - c, axis=-1)))
        )
    for name, values in figures.items():
        assert getattr(found, name) == pytest.approx(np.mean(values), rel=1e-12), name


def test_one_similarity_of_all_images_is_found(points):
    true_m, centres = points
    T = SE3.exp(np.array([0.3, -1.2, 0.5, 0.4, 2.0, -0.7]))
    predicted = T.inverse().apply(true_m.reshape(-1, 3)).reshape(true_m.shape) / 2.7
    found = point_error(true_m, predicted, centres=centres)
    assert found.scale == pytest.approx(2.7, rel=1e-9)
    assert np.abs(found.T_true_predicted.matrix - T.matrix).max() < 1e-9
    assert found.mean_m < 1e-9 and found.delta1 == 1
    scaled = point_error(true_m, true_m / 0.4, "scale")
    assert scaled.scale == pytest.approx(0.4, rel=1e-9) and scaled.rmse_m < 1e-9


def test_exact_points_have_no_error(points):
    found = point_error(points[0], points[0], "none")
    assert found.mean_m == found.abs_rel == 0 and found.delta1 == 1
    assert "AbsRel" in repr(found) and len(found.rows()) == 4


def test_masks_and_missing_points(points):
    true_m, _ = points
    predicted = true_m.copy()
    predicted[0, :3] = np.inf
    mask = np.ones(true_m.shape[:3], bool)
    mask[:, :, :4] = False
    found = point_error(true_m, predicted, "none", mask=mask)
    assert found.frames[0].missing == 0.25 and found.frames[1].missing == 0
    assert [frame.points for frame in found.frames] == [108, 144, 144]
    moge = {"points": np.where(mask[0][..., None], true_m[0], np.inf), "mask": mask[0]}
    assert point_error(true_m[0], moge).mean_m < 1e-12
    vggt = {"world_points": true_m[None].astype(np.float32), "depth": true_m[None, ..., 2:]}
    assert point_error(true_m, vggt).mean_m < 1e-5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"predicted": np.ones((3, 12, 16))}, "point maps"),
        ({"predicted": np.ones((2, 12, 16, 3))}, r"of shape \(3, 12, 16, 3\)"),
        ({"predicted": np.ones((3, 12, 16, 3), int)}, "floating-point"),
        ({"predicted": {"depth": np.ones((3, 12, 16))}}, "one of world_points"),
        ({"predicted": np.ones((3, 12, 16, 3))}, "points that differ"),
        ({"predicted": np.full((3, 12, 16, 3), np.nan)}, "at least three pixels"),
        ({"align": "sim3"}, "one of none, scale, similarity"),
        ({"centres": np.zeros((2, 3))}, r"centres \(3, 3\)"),
        ({"mask": np.ones((12, 15), bool)}, "a mask of shape"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_line(points, change, words):
    given = {"true": points[0], "predicted": points[0]} | change
    with pytest.raises(InputError, match=words) as error:
        point_error(**given)
    assert "\n" not in str(error.value)
