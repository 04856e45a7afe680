"""What measuring a cell needs: its volume, and how long it is expected to take, beside what the shipped
ones took.
"""

from collections import defaultdict
from dataclasses import replace
from statistics import mean

import pytest
from iclnuim.benchmark.experiments.recipes.paper.keys import (
    PAPER_REFERENCES,
    PaperKey,
    all_keys,
    core_seconds,
    fuse_settings,
)
from iclnuim.benchmark.odometry.registry import ODOMETERS
from iclnuim.tools import measured
from iclnuim.tools.measured_cells import PublishedCells


@pytest.fixture(scope="module")
def cells():
    return PublishedCells.read(measured.TOP / measured.CELLS).benchmark()


def test_no_odometer_takes_twice_as_long_as_expected_or_the_slowest_half(cells):
    took = defaultdict(lambda: defaultdict(list))
    for found in cells:
        times = found.figures.get("times", {})
        if "track_s" in times:
            expected_s = found.figures["frames"] * core_seconds(found.key, True, surface=False)
            model = found.key.reference if found.key.against_model else ""
            took[found.key.preset, model][found.key.odometer].append(times["track_s"] / expected_s)
    for of_odometers in took.values():
        slowest = max(map(mean, of_odometers.values()))
        assert 0.5 < slowest < 1.5


def test_a_cell_with_its_surface_takes_as_long_as_expected(cells):
    took = []
    for found in cells:
        times = found.figures.get("times", {})
        if "surface" in found.figures and "cpu_s" in times:
            each_s = times["cpu_s"] / found.figures["frames"]
            took.append(each_s / core_seconds(found.key, True, surface=True))
    assert 0.67 < mean(took) < 1.5


def test_the_papers_references_are_one_for_each_odometer():
    keys = all_keys(["paper"], references=[PAPER_REFERENCES])
    assert {(key.odometer, key.reference) for key in keys} == {
        (name, entry.references[0]) for name, entry in ODOMETERS.items()
    }
    both = all_keys(["paper"], references=[PAPER_REFERENCES, "frame"])
    assert len(both) == 2 * len(keys) and len(set(both)) == len(both)


def test_a_surface_is_fused_in_the_window_that_the_frames_were_tracked_in():
    key = PaperKey("living_room", "kt0", "clean", "icp", "paper", "model")
    around, ahead = fuse_settings(key, 9), fuse_settings(replace(key, reference="model-ahead"), 9)
    assert (around.volume.ahead, ahead.volume.ahead) == (0.0, 1.0)
    assert replace(ahead.volume, ahead=0.0) == around.volume
