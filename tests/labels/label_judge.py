"""Figures of labels by scikit-learn and panoptica, run by a Python that has them:

    python label_judge.py LABELS.npz

prints JSON. The file has truth, predicted (classes from 0, no class), true_instance and
predicted_instance, (frames, h, w) each, and is_thing (classes + 1).
"""

import json
import sys

import numpy as np


def pixels(truth, predicted, count):
    from sklearn import metrics

    valid = truth > 0
    t, p = truth[valid], predicted[valid]
    present = np.unique(t)
    of_classes = {"labels": present, "zero_division": 0}
    return {
        "confusion": metrics.confusion_matrix(t, p, labels=np.arange(count)).tolist(),
        "mean_iou": metrics.jaccard_score(t, p, average="macro", **of_classes),
        "frequency_weighted_iou": metrics.jaccard_score(t, p, average="weighted", **of_classes),
        "iou": dict(
            zip(
                present.tolist(),
                metrics.jaccard_score(t, p, average=None, **of_classes).tolist(),
                strict=True,
            )
        ),
        "pixel_accuracy": metrics.accuracy_score(t, p),
        "mean_accuracy": metrics.recall_score(t, p, average="macro", **of_classes),
    }


def segments(labels, instances, kind, is_thing, valid):
    """One volume of all frames: the segments of a class, numbered from 1."""
    inside = (labels == kind) & valid
    frame = np.arange(len(labels))[:, None, None] + np.zeros(labels.shape, int)
    keys = frame << 32 | (instances.astype(int) if is_thing else 0)
    numbers = np.zeros(labels.shape, np.uint32)
    numbers[inside] = np.unique(keys[inside], return_inverse=True)[1] + 1
    return numbers


def panoptic(truth, predicted, true_instance, predicted_instance, is_thing):
    from panoptica import InputType, NaiveThresholdMatching, Panoptica_Evaluator

    # panoptica accepts a pair at the threshold, the paper only above it
    evaluator = Panoptica_Evaluator(
        expected_input=InputType.UNMATCHED_INSTANCE,
        instance_matcher=NaiveThresholdMatching(matching_threshold=0.5 + 1e-9),
    )
    valid = truth > 0
    found = {}
    for kind in np.unique(truth[valid]).tolist():
        of = is_thing[kind]
        result = evaluator.evaluate(
            segments(predicted, predicted_instance, kind, of, valid),
            segments(truth, true_instance, kind, of, valid),
            verbose=False,
        )["ungrouped"]
        quality = float(np.nan_to_num(result.sq))
        found[kind] = {
            "matched": int(result.tp),
            "false_positives": int(result.fp),
            "false_negatives": int(result.fn),
            "segmentation_quality": quality,
            "recognition_quality": float(result.rq),
            "panoptic_quality": quality * float(result.rq),
        }
        if result.tp:
            assert abs(found[kind]["panoptic_quality"] - float(result.pq)) < 1e-12
    return found


if __name__ == "__main__":
    given = np.load(sys.argv[1])
    images = [given[name] for name in ("truth", "predicted", "true_instance", "predicted_instance")]
    of_pixels = pixels(images[0], images[1], len(given["is_thing"]))
    of_segments = panoptic(*images, given["is_thing"])
    sys.stdout.write(json.dumps({"pixels": of_pixels, "segments": of_segments}) + "\n")
