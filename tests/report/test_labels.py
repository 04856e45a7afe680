"""Labels beside points of charts: each is read, and is near its point."""

import itertools

import numpy as np
import pytest
from iclnuim.report.charts import spread_labels
from matplotlib.figure import Figure
from matplotlib.text import Annotation


@pytest.mark.parametrize("seed", range(5))
def test_labels_of_points_that_are_near_each_other_do_not_cover_each_other(seed):
    rng = np.random.default_rng(seed)
    figure = Figure(figsize=(5, 4), layout="constrained")
    for axes in figure.subplots(1, 2):
        middles = np.repeat([[1.0, 1.0], [9.0, 9.0], [1.0, 9.0]], 4, axis=0)
        places = middles + rng.normal(0, 0.05, middles.shape)
        axes.set(xlim=(0, 10), ylim=(0, 10))
        for k, place in enumerate(places):
            axes.annotate(f"m_{k}", place, (5, 4), textcoords="offset points", fontsize=7)
    spread_labels(figure)
    figure.draw_without_rendering()
    for axes in figure.axes:
        labels = [text for text in axes.texts if isinstance(text, Annotation)]
        boxes = [label.get_window_extent() for label in labels]
        assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
        for label, box in zip(labels, boxes, strict=True):
            x, y = axes.transData.transform(label.xy)
            aside = max(box.x0 - x, x - box.x1, 0), max(box.y0 - y, y - box.y1, 0)
            assert np.hypot(*aside) < 30 * figure.dpi / 72
