"""Claims over two figures: when they are true, false, or too near, and what the tolerance is for."""

from collections import defaultdict
from statistics import median

import pytest
from iclnuim.benchmark.experiments.recipes.paper.claims import (
    METHOD,
    TOLERANCE,
    Claim,
    all_hold,
    majority,
)
from iclnuim.tools import measured
from iclnuim.tools.measured_cells import PublishedCells


@pytest.mark.parametrize("times", [1.0, 2.0, 0.5])
@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
def test_a_claim_and_its_opposite_are_never_both_true_and_do_not_depend_on_the_scale(times, scale):
    for ratio in (0.5, 0.85, 0.95, 1.0, 1.05, 1.2, 2.0):
        claim = Claim(METHOD, scale, scale * ratio * times, "", "", times=times)
        opposite = Claim(METHOD, scale * ratio * times, scale, "", "", times=1 / times)
        expected = None if 0.9 <= ratio <= 1.1 else ratio > 1
        assert claim.holds is expected
        assert opposite.holds is (None if expected is None else not expected)


def test_the_answers_of_many_claims():
    assert all_hold([True, True]) is True
    assert all_hold([True, None]) is None
    assert all_hold([None, False]) is False
    assert majority([True, True, None]) is True
    assert majority([False, False, None]) is False
    assert majority([True, True, False]) is None
    assert majority([True, None]) is None


def test_another_seed_of_the_noise_changes_an_error_by_about_the_tolerance():
    """The median over methods and noisy sequences of how far a seed's ATE is from the median."""
    by_cell = defaultdict(list)
    for found in PublishedCells.read(measured.TOP / measured.CELLS).benchmark():
        key = found.key
        if key.noise == "noisy" and not key.external and "ate_m" in found.figures:
            where = (key.sequence.partition("noisy")[0], key.odometer, key.preset, key.reference)
            by_cell[where].append(found.figures["ate_m"]["rmse"])
    several = [errors for errors in by_cell.values() if len(errors) > 2]
    changes = [max(abs(e / median(errors) - 1) for e in errors) for errors in several]
    assert TOLERANCE / 2 < median(changes) < 2 * TOLERANCE
