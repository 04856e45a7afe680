"""Charts of pages: valid SVG, names where the pointer is, labels that cover nothing."""

import xml.etree.ElementTree as ElementTree
from itertools import combinations

import numpy as np
from iclnuim.benchmark.experiments import drawn
from iclnuim.benchmark.experiments.drawn import Dot, DrawnCurve, cost_chart, curves


def test_curves_are_svg_with_every_name_and_a_cross_for_a_failure():
    points = [Dot(0, 1.0, 0.5, 2.0, "one & all"), Dot(1, None, about="failed")]
    chart = ElementTree.fromstring(
        curves([DrawnCurve("a<b", 0, points)], ["0", "9"], "x", "ATE, mm")
    )
    titles = [title.text for title in chart.iter("title")]
    assert titles == ["a<b", "one & all", "failed"]
    texts = {text.text: text for text in chart.iter("text")}
    (circle,) = chart.iter("circle")
    cross = next(path for path in chart.iter("path") if "l8 8" in path.get("d", ""))
    assert float(cross.get("d").split()[1].split("l")[0]) < float(circle.get("cy"))
    assert float(texts["10"].get("y")) < float(texts["1"].get("y")) < float(texts["0.1"].get("y"))


def test_labels_cover_neither_each_other_nor_an_interval():
    rng = np.random.default_rng(0)
    for _ in range(30):
        names = [f"method-{k}" for k in range(9)]
        places = list(zip(rng.uniform(90, 330, 9), rng.uniform(30, 250, 9), strict=True))
        bars = [(x, y - 6, y + 6) for x, y in places]
        found = drawn._labels(names, places, bars)
        boxes = [(x, x + drawn._LETTER * 8, y - 6.4, y + 6.4) for x, y in found]
        boxes += [(x - 4, x + 4, low, high) for x, low, high in bars]
        for one, other in combinations(boxes, 2):
            if boxes.index(one) < 9:
                apart = one[0] >= other[1] or other[0] >= one[1]
                assert apart or one[2] >= other[3] or other[2] >= one[3]


def test_a_dot_of_the_cost_chart_says_its_name_and_figures():
    chart = cost_chart([("icp", 0, Dot(20.0, 0.9, 0.8, 1.0, "20 ms"))], "ms", "share")
    assert "icp: 20 ms" in [title.text for title in ElementTree.fromstring(chart).iter("title")]
