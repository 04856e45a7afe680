"""Which method has the least error under which condition."""

from dataclasses import replace

import pytest
from iclnuim.benchmark.experiments.recipes.paper.best_methods import (
    best_methods_table,
    errors_by_condition,
)
from iclnuim.benchmark.experiments.recipes.paper.keys import PaperKey
from made_up import external, result


def cells(odometer, errors_m, noise="noisy", reference="default"):
    keys = [PaperKey("office", f"kt{k}", noise, odometer, "best", reference) for k in range(4)]
    return [result(key, ate_m) for key, ate_m in zip(keys, errors_m, strict=False)]


def test_methods_are_ranked_by_the_geometric_mean_over_the_sequences():
    """One sequence that is lost does not decide: 1, 1, 1, 16 cm have a mean of 2 cm."""
    found = cells("icp", [0.01, 0.01, 0.01, 0.16]) + cells("dvo", [0.03] * 4)
    found += cells("rgbd", [0.001] * 3)  # is not measured on kt3
    found += cells("icp", [0.5] * 4, noise="clean")  # alone in its condition
    table = best_methods_table(found)
    assert table.rows == (
        ("office, noisy", "icp", "20", "dvo: 1.50 times", "dvo: 1.50 times", "4"),
    )


@pytest.mark.parametrize(("coverage", "is_there"), [(0.35, False), (0.85, False), (0.95, True)])
def test_an_error_of_a_part_of_the_frames_ranks_nowhere(coverage, is_there):
    found = cells("icp", [0.01] * 4) + cells("dvo", [0.02] * 4)
    part = cells("rgbd", [0.001] * 4)
    for one in part:
        one.figures["coverage"] = coverage
    assert ("rgbd" in str(best_methods_table(found + part).rows)) == is_there


def test_runs_of_a_system_count_by_their_median_and_another_reference_is_another_method():
    found = cells("icp", [0.01] * 4) + cells("icp", [0.02] * 4, reference="model")
    for one in cells("icp", [0.01] * 4):
        found += [result(external(one.key, run), run**2) for run in (1, 2, 3)]
    errors = errors_by_condition(found)["office", "noisy"]
    assert set(errors) == {"icp", "icp, model", "ORB-SLAM3"}
    assert errors["ORB-SLAM3"]["kt0"] == 4 and errors["icp, model"]["kt2"] == pytest.approx(0.02)


def test_noise_seeds_count_by_their_median():
    found = cells("dvo", [0.02] * 4)
    for seed, ate_m in ((1, 0.05), (2, 0.03)):
        found += [result(replace(one.key, seed=seed), ate_m) for one in cells("dvo", [0.0] * 4)]
    assert errors_by_condition(found)["office", "noisy"]["dvo"]["kt0"] == 0.03
