"""Figures of predicted depth: equal to formulas written here, laws of the alignments, and rules for
pixels and arrays that cannot be compared.
"""

import numpy as np
import pytest
from iclnuim import depth_error
from iclnuim.errors import InputError
from iclnuim.evaluation.depth_boundary import boundary_counts, boundary_f1
from iclnuim.evaluation.depth_figures import DepthSums


@pytest.fixture
def scene():
    """True depth with steps and slopes, and a prediction with relative errors, 60 x 80."""
    rng = np.random.default_rng(3)
    v, u = np.mgrid[0:60, 0:80]
    true_m = 2 + v / 40 + (u // 20) * 0.7 + (v // 15 % 2) * 0.5
    return true_m, true_m * np.exp(rng.normal(0, 0.1, true_m.shape))


def formulas(d, g):
    """The definitions, one line each, of pixels (n,)."""
    logs = np.log(d) - np.log(g)
    ratio = np.maximum(d / g, g / d)
    return {
        "abs_rel": np.mean(np.abs(d - g) / g),
        "sq_rel_m": np.mean((d - g) ** 2 / g),
        "rmse_m": np.sqrt(np.mean((d - g) ** 2)),
        "rmse_log": np.sqrt(np.mean(logs**2)),
        "silog": 100 * np.sqrt(np.mean(logs**2) - np.mean(logs) ** 2),
        "log10": np.mean(np.abs(np.log10(d) - np.log10(g))),
        "delta1": np.mean(ratio < 1.25),
        "delta2": np.mean(ratio < 1.25**2),
        "delta3": np.mean(ratio < 1.25**3),
        "mae_m": np.mean(np.abs(d - g)),
    }


def neighbours_f1(d, g):
    """Boundary F1 pixel by pixel, of images without missing depth."""
    height, width = g.shape
    total = 0.0
    weights = np.linspace(1.05, 1.25, 10)
    for t in weights:
        precisions, recalls = [], []
        for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            both = predicted = true = 0
            for v in range(height):
                for u in range(width):
                    if 0 <= v + dv < height and 0 <= u + du < width:
                        of_d = d[v + dv, u + du] / d[v, u] > t
                        of_g = g[v + dv, u + du] / g[v, u] > t
                        both += of_d and of_g
                        predicted += of_d
                        true += of_g
            precisions.append(both / max(predicted, 1))
            recalls.append(both / max(true, 1))
        p, r = np.mean(precisions), np.mean(recalls)
        total += t * (2 * p * r / (p + r) if p + r else 0.0)
    return total / weights.sum()


def aligned_by_hand(method, x, y):
    if method == "median":
        return x * np.median(y) / np.median(x)
    if method == "scale":
        return x * np.linalg.lstsq(x[:, None], y, rcond=None)[0]
    if method == "affine":
        rows = np.stack([x, np.ones_like(x)], 1)
        return rows @ np.linalg.lstsq(rows, y, rcond=None)[0]
    return x


@pytest.mark.parametrize("quantity", ["depth", "inverse-depth"])
@pytest.mark.parametrize("method", ["none", "median", "scale", "affine"])
def test_figures_equal_the_formulas(scene, method, quantity):
    true_m, predicted_m = scene
    inverse = quantity != "depth"
    predicted = 1 / predicted_m if inverse else predicted_m
    found = depth_error(true_m, predicted, method, quantity=quantity, boundary=False)
    y = 1 / true_m.ravel() if inverse else true_m.ravel()
    aligned = aligned_by_hand(method, predicted.ravel(), y)
    if method == "affine":  # the rule for values that a shift makes impossible
        aligned = np.maximum(aligned, y.min()) if inverse else aligned
    expected = formulas(1 / aligned if inverse else aligned, true_m.ravel())
    figures = found.figures.to_dict()
    for name, value in expected.items():
        assert figures[name] == pytest.approx(value, rel=1e-12, abs=1e-12), name
    assert found.mae_mm == pytest.approx(1e3 * expected["mae_m"])


def test_boundary_f1_equals_that_of_a_loop_over_all_neighbours(scene):
    true_m, predicted_m = scene
    smooth_m = true_m * (1 + 0.05 * np.sin(np.arange(80) / 3))
    for prediction in (predicted_m, smooth_m, np.roll(true_m, 1, axis=1)):
        found = depth_error(true_m, prediction).boundary_f1
        assert found == pytest.approx(neighbours_f1(prediction, true_m), rel=1e-12)


def test_boundary_f1_does_not_depend_on_scale_and_is_none_without_a_boundary(scene):
    true_m, predicted_m = scene
    f1 = depth_error(true_m, predicted_m).boundary_f1
    assert depth_error(true_m, 0.5 * predicted_m).boundary_f1 == f1
    assert depth_error(np.full((5, 5), 2.0), predicted_m[:5, :5]).boundary_f1 is None


def test_boundaries_that_a_prediction_leaves_out_are_not_found():
    true_m = np.full((6, 8), 2.0)
    true_m[:, 4:] = 4.0
    predicted_m = true_m.copy()
    whole = boundary_f1(boundary_counts(predicted_m, true_m))
    predicted_m[:3] = np.nan
    assert boundary_f1(boundary_counts(predicted_m, true_m)) < whole
    true_m[:3] = np.nan  # where the truth is missing, nothing counts
    assert boundary_f1(boundary_counts(predicted_m, true_m)) == whole


def test_exact_depth_has_no_error(scene):
    true_m, _ = scene
    for method in ("none", "median", "scale", "affine"):
        found = depth_error(true_m, true_m, method)
        figures = found.figures.to_dict()
        ones = [figures.pop(name) for name in ("delta1", "delta2", "delta3")]
        assert ones == [1.0, 1.0, 1.0]
        f1 = figures.pop("boundary_f1")
        if method == "none":
            # below 1 by definition: some directions have no boundary of the larger ratios
            assert f1 == pytest.approx(neighbours_f1(true_m, true_m))
        limit = 1e-12 if method in ("scale", "affine") else 0.0
        assert max(figures.values()) <= limit


@pytest.mark.parametrize("per", ["frame", "sequence"])
@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("quantity", ["depth", "inverse-depth", "disparity"])
def test_a_planted_scale_and_shift_is_found(scene, quantity, robust, per):
    true_m = np.stack([scene[0], scene[0] + 0.5, scene[0][::-1]])
    values = true_m if quantity == "depth" else 1 / true_m
    of = {"quantity": quantity, "robust": robust, "per": per}
    for method in ("median", "scale", "affine"):
        shift = -0.05 if method == "affine" else 0.0
        found = depth_error(true_m, (values - shift) / 3.7, method, **of)
        assert found.scale == pytest.approx(3.7, rel=1e-9)
        assert found.shift == pytest.approx(shift, abs=1e-9)
        assert found.abs_rel < 1e-9 and found.delta1 == 1


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_a_robust_alignment_ignores_outliers_and_least_squares_does_not(scene, share):
    rng = np.random.default_rng(0)
    true_m, _ = scene
    predicted = (true_m - 0.4) / 2.5
    outlier = rng.random(true_m.shape) < share
    predicted[outlier] = rng.uniform(0.1, 9, outlier.sum())
    robust = depth_error(true_m, predicted, "affine", robust=True)
    assert robust.scale == pytest.approx(2.5, rel=1e-9)
    assert robust.shift == pytest.approx(0.4, abs=1e-9)
    assert abs(depth_error(true_m, predicted, "affine").scale - 2.5) > 0.3
    only_scaled = np.where(outlier, predicted, true_m / 2.5)
    assert depth_error(true_m, only_scaled, "scale", robust=True).scale == pytest.approx(2.5)


def test_one_alignment_per_sequence_is_that_of_all_pixels(scene):
    true_m, predicted_m = scene
    trues = np.stack([true_m, 1.5 * true_m])
    predicted = np.stack([predicted_m, predicted_m])
    whole = depth_error(trues, predicted, "affine", per="sequence")
    long = depth_error(np.concatenate(trues), np.concatenate(predicted), "affine")
    assert whole.scale == pytest.approx(long.scale, rel=1e-12)
    assert whole.shift == pytest.approx(long.shift, rel=1e-9)
    assert len({frame.alignment for frame in whole.frames}) == 1


def test_pools_are_the_mean_over_frames_or_all_pixels(scene):
    true_m, predicted_m = scene
    trues = np.stack([true_m, true_m])
    predicted = np.stack([predicted_m, 1.3 * true_m])
    trues[1, :30] = 0
    frames = depth_error(trues, predicted)
    assert frames.rmse_m == pytest.approx(np.mean([f.figures.rmse_m for f in frames.frames]))
    pixels = depth_error(trues, predicted, pool="pixels")
    used = trues > 0
    expected = formulas(predicted[used], trues[used])
    figures = pixels.figures.to_dict()
    for name, value in expected.items():
        assert figures[name] == pytest.approx(value, rel=1e-12), name
    assert 0 < pixels.boundary_f1 < 1


def test_sums_of_groups_are_those_of_the_whole(scene):
    true_m, predicted_m = (image.ravel() for image in scene)
    groups = np.arange(true_m.size) % 3
    by = DepthSums.of(predicted_m, true_m, groups, 4)
    for k in range(3):
        expected = formulas(predicted_m[groups == k], true_m[groups == k])
        figures = by.figures(k).to_dict()
        for name, value in expected.items():
            assert figures[name] == pytest.approx(value, rel=1e-12), (k, name)
    assert by.count.tolist() == [1600, 1600, 1600, 0]


def test_missing_pixels_are_counted_and_in_no_figure(scene):
    true_m, predicted_m = scene
    holes = predicted_m.copy()
    holes[0, :4] = [0, np.nan, np.inf, -1.0]
    found = depth_error(true_m, holes, boundary=False)
    there = np.ones(true_m.shape, bool)
    there[0, :4] = False
    assert found.pixels == true_m.size - 4 and found.missing == pytest.approx(4 / true_m.size)
    assert found.abs_rel == pytest.approx(formulas(predicted_m[there], true_m[there])["abs_rel"])
    without = true_m.copy()
    without[1, :3] = [0, np.nan, np.inf]
    assert depth_error(without, predicted_m).missing == 0
    assert depth_error(without, predicted_m).pixels == true_m.size - 3


def test_limits_and_masks_choose_pixels_of_the_truth(scene):
    true_m, predicted_m = scene
    found = depth_error(true_m, predicted_m, min_depth_m=2.5, max_depth_m=4.0, boundary=False)
    used = (true_m > 2.5) & (true_m <= 4)
    assert found.pixels == used.sum()
    same = depth_error(true_m, predicted_m, mask=used, boundary=False)
    assert same.figures == found.figures


def test_pixels_that_an_affine_alignment_makes_impossible_are_clamped_and_counted():
    true_m = np.array([[1.0, 2, 3, 4, 5, 6], [1.0, 2, 3, 4, 5, 6]])
    predicted = np.array([[-9.0, 2, 3, 4, 5, 6], [-9.0, 2, 3, 4, 5, 6]])
    found = depth_error(true_m, predicted, "affine", robust=True)
    assert found.clamped == 2 and found.abs_rel < 1e-12  # 1 m is the nearest true depth
    inverse = 1 / true_m
    inverse[:, 5] = -3
    found = depth_error(true_m, inverse, "affine", robust=True, quantity="inverse-depth")
    assert found.clamped == 2 and found.abs_rel < 1e-12


def test_half_precision_is_computed_in_double(scene):
    true_m, predicted_m = scene
    half = predicted_m.astype(np.float16)
    found = depth_error(true_m, half, boundary=False)
    assert found.abs_rel == pytest.approx(
        formulas(half.astype(float).ravel(), true_m.ravel())["abs_rel"], rel=1e-12
    )


@pytest.mark.parametrize("how", ["nearest", "bilinear"])
def test_a_prediction_of_another_size_is_resampled_at_pixel_centres(how):
    v, u = np.mgrid[0:60, 0:80]
    true_m = 2 + u / 80 + v / 60
    half = true_m.reshape(30, 2, 40, 2).mean(axis=(1, 3))
    inside = np.zeros(true_m.shape, bool)
    inside[1:-1, 1:-1] = True
    found = depth_error(true_m, half, resize=how, mask=inside)
    limit = 1e-12 if how == "bilinear" else 0.5 / 80 + 0.5 / 60
    assert found.mae_m <= limit
    half[10, 10] = np.nan
    assert depth_error(true_m, half, resize=how).missing == 4 / true_m.size


def test_a_disparity_is_focal_length_times_baseline_by_depth(scene):
    true_m, _ = scene
    found = depth_error(true_m, 52.0 / true_m, quantity="disparity", disparity_factor=52.0)
    assert found.abs_rel < 1e-12


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"predicted": np.ones((60, 80), np.uint16)}, "floating-point numbers, found uint16"),
        ({"true": np.ones((60, 80), np.int32)}, "floating-point numbers, found int32"),
        ({"predicted": np.ones((60, 81))}, "a prediction of 80 x 60"),
        ({"predicted": np.ones((2, 60, 80))}, "1 predicted images"),
        ({"predicted": np.ones(4800)}, r"predicted depth \(h, w\)"),
        ({"predicted": np.ones((60, 80, 3, 2))}, r"predicted depth \(h, w\)"),
        ({"predicted": np.ones((60, 100)), "resize": "nearest"}, "aspect ratio"),
        ({"predicted": {"conf": np.ones((60, 80))}}, "one of depth"),
        ({"predicted": object()}, "one of depth"),
        ({"predicted": np.full((60, 80), np.nan)}, "pixels that have true and predicted depth"),
        ({"predicted": np.ones((60, 80)), "align": "affine"}, "image 0: .*that varies"),
        ({"mask": np.ones((60, 80))}, "a mask"),
        ({"mask": np.ones((60, 81), bool)}, r"a mask of shape \(1, 60, 80\)"),
        ({"align": "sim3"}, "one of none, median, scale, affine"),
        ({"quantity": "disparity"}, "a focal length times baseline"),
        ({"min_depth_m": 3.0, "max_depth_m": 2.0}, "a largest depth above the smallest"),
        ({"max_depth_m": float("nan")}, "a number"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_line(scene, change, words):
    given = {"true": scene[0], "predicted": scene[1]} | change
    with pytest.raises(InputError, match=words) as error:
        depth_error(**given)
    assert "\n" not in str(error.value)


def test_what_networks_return_is_read():
    """Shapes by the code of MoGe 2, Depth Anything 3 and VGGT; the values are made up."""
    true_m = np.linspace(1, 4, 2 * 6 * 8).reshape(2, 6, 8)
    seen = np.ones((6, 8), bool)
    seen[0] = False
    moge = {
        "points": np.zeros((6, 8, 3), np.float32),
        "depth": np.where(seen, true_m[0], np.inf).astype(np.float32),
        "mask": seen,
        "intrinsics": np.eye(3, dtype=np.float32),
    }
    found = depth_error(true_m[0], moge)
    assert found.abs_rel < 1e-6 and found.missing == 1 / 6

    class Prediction:
        depth = true_m.astype(np.float32) / 3
        sky = ~np.broadcast_to(seen, (2, 6, 8))
        conf = np.ones((2, 6, 8), np.float32)
        is_metric = 0

    found = depth_error(true_m, Prediction(), "scale")
    assert found.scale == pytest.approx(3, rel=1e-6) and found.missing == 1 / 6
    vggt = {
        "depth": (true_m / 3).astype(np.float32)[None, ..., None],
        "depth_conf": np.ones((1, 2, 6, 8), np.float32),
        "world_points": np.zeros((1, 2, 6, 8, 3), np.float32),
        "images": np.zeros((1, 2, 3, 6, 8), np.float32),
    }
    assert depth_error(true_m, vggt, "scale").abs_rel < 1e-6
    vggt = {name: values[0] for name, values in vggt.items()}
    assert depth_error(true_m, vggt, "scale").abs_rel < 1e-6


def test_a_result_shows_itself(scene):
    found = depth_error(*scene, align="scale")
    assert "AbsRel" in repr(found) and "delta1" in found._repr_html_()
    first, *lines = found.rows()
    assert len(first) == len(lines[0]) and found.to_dict()["scale"] == found.scale
    assert found.plot().get_ylabel() == "AbsRel"
    with pytest.raises(AttributeError):
        found.nothing  # noqa: B018


def test_scale_and_shift_of_images_are_their_medians(scene):
    true_m, _ = scene
    planted = [(2.0, 0.1), (3.0, 0.2), (9.0, 4.0)]
    predictions = [(true_m - shift) / scale for scale, shift in planted]
    error = depth_error(np.stack([true_m] * 3), np.stack(predictions), align="affine")
    assert (error.scale, error.shift) == (pytest.approx(3.0), pytest.approx(0.2))
