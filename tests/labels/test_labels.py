"""Figures of labels: by scikit-learn and panoptica where they are, by their definitions, and by
laws.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from iclnuim import PanopticQuality, Segmentation, label_confusion, label_figures, panoptic_quality
from iclnuim.errors import InputError
from judges import judged_by

HERE = Path(__file__).parent
CLASSES = 9
IS_THING = np.array([False, False, False] + [True] * 7)


def made_labels(rng, frames=6, shape=(48, 64)):
    """Frames of rectangles on a background, and a prediction with classes swapped, segments
    shifted, joined and cut, and pixels unlabelled.
    """
    truth = np.ones((frames, *shape), np.int32)
    instance = np.ones((frames, *shape), np.int64)
    for frame in range(frames):
        for number in range(2, 14):
            top, left = rng.integers(0, shape[0] - 4), rng.integers(0, shape[1] - 4)
            box = (frame, slice(top, top + rng.integers(2, 20)), slice(left, left + 12))
            truth[box] = rng.integers(0, CLASSES)
            instance[box] = number
    return truth, instance, *spoilt(truth, instance, rng)


def spoilt(truth, instance, rng):
    """A worse copy of the labels and instances of frames."""
    labels, numbers = truth.copy(), instance.copy()
    for frame in range(len(truth)):
        labels[frame] = np.roll(labels[frame], rng.integers(-2, 3, 2), (0, 1))
        numbers[frame] = np.roll(numbers[frame], rng.integers(-2, 3, 2), (0, 1))
        for number in np.unique(numbers[frame])[1:4]:
            here = numbers[frame] == number
            labels[frame][here] = rng.integers(0, CLASSES)
            numbers[frame][here & (rng.random(here.shape) < 0.5)] += 100
        labels[frame][rng.random(labels[frame].shape) < 0.03] = 0
    return labels, numbers


def figures_of(truth, predicted, classes=CLASSES):
    return label_figures(label_confusion(truth, predicted, classes))


def quality_of(truth, instance, predicted, numbers, is_thing=IS_THING):
    """Of all frames, summed."""
    found = None
    for frame in zip(truth, instance, predicted, numbers, strict=True):
        quality = panoptic_quality(Segmentation(*frame[:2]), Segmentation(*frame[2:]), is_thing)
        found = quality if found is None else found + quality
    return found


def judged(path, truth, instance, predicted, numbers, is_thing):
    """The figures of scikit-learn and panoptica."""
    np.savez(
        path,
        truth=truth,
        predicted=predicted,
        true_instance=instance,
        predicted_instance=numbers,
        is_thing=is_thing,
    )
    said = judged_by(
        "panoptica and scikit-learn", "sklearn, panoptica", HERE / "label_judge.py", path
    )
    return json.loads(said.splitlines()[-1])


def check_against_judge(found, figures, quality):
    of_pixels = found["pixels"]
    assert np.array_equal(figures.confusion, of_pixels["confusion"])
    for name in ("mean_iou", "frequency_weighted_iou", "pixel_accuracy", "mean_accuracy"):
        assert abs(getattr(figures, name) - of_pixels[name]) < 1e-12, name
    for kind, iou in of_pixels["iou"].items():
        assert abs(figures.iou[int(kind)] - iou) < 1e-12
    for kind, of_class in found["segments"].items():
        for name, value in of_class.items():
            assert abs(getattr(quality, name)[int(kind)] - value) < 1e-9, (kind, name)


@pytest.mark.parametrize("seed", range(3))
def test_figures_are_those_of_scikit_learn_and_panoptica(seed, tmp_path):
    truth, instance, predicted, numbers = made_labels(np.random.default_rng(seed))
    found = judged(tmp_path / "labels.npz", truth, instance, predicted, numbers, IS_THING)
    quality = quality_of(truth, instance, predicted, numbers)
    assert 0 < quality.to_dict()["panoptic_quality"] < 1
    check_against_judge(found, figures_of(truth, predicted), quality)


def test_a_perfect_prediction_has_one():
    truth, instance, _, _ = made_labels(np.random.default_rng(3))
    figures = figures_of(truth, truth)
    values = figures.to_dict()
    assert values.pop("unlabelled") == 0 and set(values.values()) == {1.0}
    quality = quality_of(truth, instance, truth, instance)
    assert set(quality.to_dict().values()) == {1.0}
    assert not quality.false_positives.any() and not quality.false_negatives.any()


def test_figures_follow_their_definitions():
    truth = np.array([1, 1, 1, 1, 2, 2, 0, 0])
    predicted = np.array([1, 1, 2, 0, 2, 3, 1, 3])
    figures = figures_of(truth, predicted, 3)
    assert figures.confusion.tolist() == [[0] * 4, [1, 2, 1, 0], [0, 0, 1, 1], [0] * 4]
    assert figures.iou[1:3].tolist() == [2 / 4, 1 / 3] and np.isnan(figures.iou[[0, 3]]).all()
    assert figures.mean_iou == pytest.approx((1 / 2 + 1 / 3) / 2)
    assert figures.frequency_weighted_iou == pytest.approx((4 / 2 + 2 / 3) / 6)
    assert (figures.pixel_accuracy, figures.mean_accuracy) == (3 / 6, (2 / 4 + 1 / 2) / 2)
    assert figures.unlabelled == 1 / 6


def test_what_the_truth_does_not_label_never_counts():
    truth, instance, predicted, numbers = made_labels(np.random.default_rng(4))
    before = figures_of(truth, predicted).to_dict()
    quality = quality_of(truth, instance, predicted, numbers)
    void = truth == 0
    predicted[void] = 7
    numbers[void] = 1
    assert figures_of(truth, predicted).to_dict() == before
    again = quality_of(truth, instance, predicted, numbers)
    assert again.to_dict() == quality.to_dict()


def test_classes_below_a_thousandth_of_the_pixels_are_rare():
    truth = np.ones(10_000, np.int32)
    truth[:9] = 2
    truth[9:19] = 3
    predicted = np.where(truth == 2, 1, truth)
    figures = figures_of(truth, predicted, 3)
    assert figures.is_rare.tolist() == [False, False, True, False]
    assert figures.mean_iou == pytest.approx((9981 / 9990 + 0 + 1) / 3)
    assert figures.mean_iou_without_rare == pytest.approx((9981 / 9990 + 1) / 2)


def test_half_an_overlap_does_not_match():
    truth, instance = np.array([[3, 3, 3, 3]]), np.array([[5, 5, 5, 5]])
    predicted = np.array([[3, 3, 0, 0]])
    quality = quality_of(truth, instance, predicted, instance)
    assert quality.matched[3] == 0 and quality.false_negatives[3] == 1
    predicted[0, 2] = 3
    quality = quality_of(truth, instance, predicted, instance)
    assert quality.matched[3] == 1 and quality.panoptic_quality[3] == 3 / 4


@pytest.mark.parametrize(
    ("matched", "missed", "invented"),
    [(1, 0, 0), (3, 1, 0), (3, 0, 1), (2, 3, 1), (1, 4, 5), (0, 2, 1)],
)
def test_recognition_is_the_f1_score_and_panoptic_quality_its_product_with_the_mean_iou(
    matched, missed, invented
):
    """Segments of 4 pixels in a row; a matched one is predicted with 3 of them."""
    segments = np.arange(1, 1 + matched + missed + invented)
    instance = np.repeat(segments, 4)[None]
    truth = np.where(instance <= matched + missed, 3, 1)
    predicted = np.where((instance <= matched) | (instance > matched + missed), 3, 1)
    predicted[0, : 4 * matched : 4] = 1
    quality = quality_of(truth[None], instance[None], predicted[None], instance[None])
    precision = matched / max(1, matched + invented)
    recall = matched / (matched + missed)
    f1 = 2 * precision * recall / (precision + recall) if matched else 0.0
    assert quality.recognition_quality[3] == pytest.approx(f1, abs=1e-15)
    iou = 3 / 4 if matched else 0.0
    assert quality.segmentation_quality[3] == iou
    assert quality.panoptic_quality[3] == pytest.approx(iou * f1, abs=1e-15)


def test_stuff_is_one_segment_and_sums_are_over_frames():
    truth = np.full((1, 4), 1)
    numbers = np.arange(4)[None]
    whole = Segmentation(truth, numbers)
    stuff = np.array([False, False])
    quality = panoptic_quality(whole, whole, stuff)
    assert quality.matched.tolist() == [0, 1]
    assert panoptic_quality(whole, whole, ~stuff).matched.tolist() == [0, 4]
    assert isinstance(quality + quality, PanopticQuality)
    assert (quality + quality).matched.tolist() == [0, 2]


def test_arrays_that_are_no_labels_are_refused():
    ones = np.ones((2, 3), int)
    for truth, predicted, message in (
        (ones, np.ones((3, 2), int), "a prediction of shape"),
        (ones * 1.0, ones, "a truth of integers"),
        (ones, ones * 5, "a prediction of classes 0 to 4"),
        (-ones, ones, "a truth of classes 0 to 4"),
    ):
        with pytest.raises(InputError, match=message):
            label_confusion(truth, predicted, 4)
    with pytest.raises(InputError, match="true labels"):
        label_figures(label_confusion(ones * 0, ones, 4))
