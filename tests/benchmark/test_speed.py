"""Accuracy beside speed, its intervals and its chart."""

import math
from dataclasses import replace

import numpy as np
import pytest
from iclnuim.benchmark.experiments.intervals import log_interval, share_interval
from iclnuim.benchmark.experiments.memory import peak_mb, reset_peak
from iclnuim.benchmark.experiments.recipes.paper.keys import all_keys
from iclnuim.benchmark.experiments.recipes.paper.speed import speed_figure, speed_table
from iclnuim.report.charts import pareto_panel
from made_up import result
from matplotlib.figure import Figure


def test_an_interval_of_ratios_holds_the_true_one_in_19_of_20_cases():
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(2000):
        mean, low, high = log_interval(np.exp(rng.normal(0.3, 0.5, 8)).tolist())
        assert low < mean < high
        held += low < math.exp(0.3) < high
    assert held / 2000 == pytest.approx(0.95, abs=0.02)
    assert log_interval([2.0])[1:] == (0.0, math.inf)


def test_the_interval_of_a_share_stays_within_0_and_1():
    for successes in (0, 5, 10):
        share, low, high = share_interval(successes, 10)
        assert 0 <= low <= share <= high <= 1 and high - low > 0.2


def test_a_table_shows_what_a_method_costs_and_a_dash_where_nothing_was_measured():
    keys = [key for key in all_keys() if key.noise == "clean" and key.reference == "default"]
    times = {"track_s": 0.75, "cpu_s": 80.0}  # of 60 frames
    found = [result(key, 0.01, 0.002, times=times) for key in keys]
    rows = [dict(zip(speed_table(found).columns, r, strict=True)) for r in speed_table(found).rows]
    assert len(rows) == 10
    for row in rows:
        assert (row["ATE mm"], row["surface mm"], row["ms a frame"]) == ("10", "2", "12.5")
        assert (row["core-s"], row["MB"]) == ("80", "-")
    bare = [replace(found[0], figures={**found[0].figures, "surface": {}}), *found[1:]]
    surfaces = [row[3] for row in speed_table(bare).rows]
    assert surfaces.count("-") == 1  # a median of other sequences would stand beside this ATE
    assert len([a for a in speed_figure(found).axes if a.get_visible()]) == 2
    assert speed_figure([result(key, 0.01, times={}) for key in keys]) is None


def test_the_line_goes_through_what_nothing_beats_in_both():
    axes = Figure().subplots()
    points = [("a", 1, 5, 4, 6), ("b", 2, 3, 2, 4), ("c", 3, 4, 3, 5), ("d", 4, 1, 0.5, 2)]
    pareto_panel(axes, points)
    line = axes.lines[-1]
    assert list(zip(*line.get_data(), strict=True)) == [(1, 5), (2, 3), (4, 1)]


@pytest.mark.skipif(peak_mb() is None, reason="the system does not say")
def test_the_largest_memory_is_of_what_follows_the_reset():
    del [np.ones(40_000_000)][:]
    reset_peak()
    before_mb = peak_mb()
    block = np.ones(25_000_000)  # 200 MB
    after_mb = peak_mb()
    del block
    assert 150 < after_mb - before_mb < 260
