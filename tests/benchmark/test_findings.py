"""The rules of the findings: what they say of the printed figures, and that each follows the
figures.
"""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.benchmark.experiments.recipes.paper.correlation import (
    MIN_CELLS,
    correlation,
    correlation_table,
    interval,
)
from iclnuim.benchmark.experiments.recipes.paper.figures import Ours, Printed
from iclnuim.benchmark.experiments.recipes.paper.findings import (
    CLOSE,
    FAILS,
    HOLDS,
    MISSING,
    UNDECIDED,
    VOID,
    findings_table,
    headline,
    verdict,
    verdict_of,
    verdicts_by_method,
)
from iclnuim.benchmark.experiments.recipes.paper.keys import (
    PaperKey,
    all_keys,
    family,
    lambertian_keys,
)
from iclnuim.benchmark.experiments.recipes.paper.rules import RULES
from made_up import only, result, results, with_errors
from scipy import stats

#: What the rules say of the printed figures: all that the paper's own text says of its tables, but
#: where differences decide that are printed as 4 % and 8 %. Findings 3, 5 and 11 have no figures.
ON_THE_PRINTED = (
    dict.fromkeys(RULES, HOLDS) | {2: CLOSE, 4: CLOSE} | dict.fromkeys((3, 5, 11), MISSING)
)


@pytest.mark.parametrize("number", sorted(RULES))
def test_a_rule_says_of_the_printed_figures_what_the_paper_says(number):
    assert verdict_of([Printed()], number).word == ON_THE_PRINTED[number]


def word(number, cells, **words):
    return verdict_of([Ours(cells, **words)], number).word


#: Finding -> cells whose errors are made a thousand times larger, so that it holds or cannot hold
#: any more.
FLIPPED = {
    7: ({"odometer": "fovis"}, {"odometer": "icp", "reference": "model"}),
    8: ({"odometer": "dvo"}, {"odometer": "icp", "reference": "model"}),
    12: ({"noise": "noisy"}, {"noise": "clean"}),
    18: ({"odometer": "icp", "noise": "noisy"}, {"odometer": "icp", "noise": "clean"}),
    5: ({"odometer": "dvo", "reference": "default"}, {"odometer": "dvo", "reference": "model"}),
}


@pytest.mark.parametrize("number", sorted(FLIPPED))
def test_a_verdict_follows_the_figures(number):
    makes, breaks = FLIPPED[number]
    for words, holds in ((makes, True), (breaks, False)):
        cells = with_errors(results(3), 1e6, **words)
        assert word(number, cells) == (HOLDS if holds else FAILS)


@pytest.mark.parametrize(("growth", "holds"), [(2.5, True), (1.5, False)])
def test_noise_increases_an_error_significantly_from_twice_on(growth, holds):
    clean = [result(key, 0.01, 0.01) for key in all_keys() if key.noise == "clean"]
    noisy = [replace(r.key, noise="noisy") for r in clean]
    errors = [0.01 * (growth if key.trajectory == "kt3" else 1.1) for key in noisy]
    assert word(15, [*clean, *map(result, noisy, errors)]) == (HOLDS if holds else FAILS)


@pytest.mark.parametrize(("times", "found"), [(2.5, HOLDS), (2, CLOSE), (1.5, FAILS)])
def test_icp_is_notably_worse_on_a_sequence_from_twice_on(times, found):
    cells = []
    for r in level({"icp": (0.1, 1)}):
        on_kt1 = r.key.odometer == "icp" and r.key.trajectory == "kt1"
        cells.append(result(r.key, 0.001 * times, 0.01) if on_kt1 else r)
    assert word(10, cells) == found


def test_who_is_best_on_another_sequence_does_not_matter_to_a_finding_about_kt3():
    """Finding 17 is decided without ICP+RGB-D on kt0."""
    cells = []
    for r in level({"icp_rgbd": (0.2, 1), "dvo": (0.5, 1)}):
        if r.key.odometer == "icp" and r.key.noise == "clean":
            r = result(r.key, 0.001, 0.01)
        if (r.key.odometer, r.key.trajectory) != ("icp_rgbd", "kt0"):
            cells.append(r)
    assert word(17, cells) == HOLDS


@pytest.mark.parametrize(("share", "found"), [(0.4, HOLDS), (0.6, FAILS), (None, None)])
def test_only_frames_without_reflections_show_whether_these_are_the_reason(share, found):
    """Ten times worse than geometric methods; without reflections a share of that.

    None: one of the eight cells is missing.
    """
    office = [
        result(cell, 0.1 if cell.odometer in family("photometric") else 0.01, 0.01)
        for cell in all_keys()
    ]
    without = [result(cell, 0.1 * (share or 0.4)) for cell in lambertian_keys()]
    rows = {
        row[0]: row for row in findings_table(office + (without if share else without[1:])).rows
    }
    assert ("11" in rows) == bool(found)
    if share:
        assert rows["11"][5] == found
        assert "without reflections" in rows["11"][4] and "100" in rows["11"][4]


def test_every_finding_has_a_rule_and_without_figures_none_a_verdict():
    table = findings_table([])
    assert table.rows == () and set(RULES) == set(range(1, 19))
    assert table.notes[-1].startswith("All findings need more cells than these 0, ")


def test_one_missing_cell_leaves_open_what_needs_it():
    whole = results(1)
    assert {row[0] for row in findings_table(whole).rows} >= set(map(str, range(1, 19))) - {"11"}
    worst = [r for r in with_errors(whole, 1e6, odometer="fovis") if r.key.trajectory != "kt2"]
    lacking = [*worst, *(r for r in only(whole, trajectory="kt2") if r.key.odometer != "fovis")]
    table = findings_table(lacking)
    assert "7" not in [row[0] for row in table.rows] and " 7," in table.notes[-1]


def test_a_claim_that_is_false_decides_without_the_figures_of_others():
    """Of kt0 alone, fovis is not the worst; of icp alone, noise does not hurt it on kt3."""
    kt0 = [r for r in level({"icp": (10, 1), "fovis": (0.1, 1)}) if r.key.trajectory == "kt0"]
    worst = level({"fovis": (10, 1)})
    assert (word(7, kt0), word(7, worst)) == (FAILS, HOLDS)
    assert word(7, only(worst, trajectory="kt0")) == MISSING
    icp = only(level({}), odometer="icp", room="office")
    assert word(17, with_errors(icp, 0.5, noise="noisy")) == FAILS
    assert word(17, with_errors(icp, 2, noise="noisy")) == MISSING


def level(errors):
    """Of all cells: an ATE of 10 mm and a surface of 10 mm, times what `errors` has by odometer."""
    found = []
    for key in all_keys():
        ate, surface = errors.get((key.odometer, key.reference), errors.get(key.odometer, (1, 1)))
        found.append(result(key, 0.01 * ate, 0.01 * surface))
    return found


@pytest.mark.parametrize(
    ("times", "found"), [(0.8, HOLDS), (0.95, CLOSE), (1.05, CLOSE), (1.25, FAILS)]
)
def test_the_model_helps_or_harms_by_more_than_a_tenth_or_decides_nothing(times, found):
    assert word(5, level({("dvo", "model"): (1, times)})) == found


@pytest.mark.parametrize(
    ("kt", "found"), [("kt0", HOLDS), ("kt0,kt1", CLOSE), ("kt0,kt1,kt2", CLOSE)]
)
def test_sequences_that_are_near_do_not_count_and_one_of_the_other_kind_leaves_it_open(kt, found):
    """The model helps on all but these, on which it changes 3 %; then on one more it harms."""
    near = kt.split(",")
    cells = []
    for r in level({("dvo", "model"): (1, 0.5)}):
        model = (r.key.odometer, r.key.reference) == ("dvo", "model")
        changed = model and r.key.trajectory in near
        cells.append(result(r.key, 0.01, 0.0103) if changed else r)
    assert word(5, cells) == found
    harmed = only(cells, odometer="dvo", reference="model", trajectory="kt3")
    others = [r for r in cells if r not in harmed]
    assert word(5, [*others, *(result(r.key, 0.01, 0.02) for r in harmed)]) != HOLDS


def test_one_pair_of_odometers_that_is_turned_does_not_decide_the_main_finding():
    """On over half of the sequences a better trajectory has to have the clearly worse surface."""
    assert word(4, level({"icp": (0.5, 0.5)})) == FAILS
    assert word(4, level({"icp": (0.5, 2.0)})) == HOLDS
    one = level({"icp": (0.5, 0.5)})
    one = [
        result(r.key, 0.005, 0.02) if r.key.odometer == "icp" and r.key.trajectory == "kt0" else r
        for r in one
    ]
    assert word(4, one) == CLOSE
    assert word(4, level({"icp": (0.95, 2.0)})) == CLOSE


def test_a_reason_for_what_is_not_so_is_void():
    assert word(3, level({"icp": (0.5, 0.5)})) == VOID
    rougher = {"dvo": (0.5, 2.0), ("dvo", "model"): (0.5, 1.0), ("icp", "default"): (1, 1.5)}
    found = level(rougher)
    assert word(2, found) == HOLDS
    assert word(3, found) == HOLDS


def test_dvo_beats_icp_narrowly_by_however_little_but_not_by_half():
    best = {name: (4, 1) for name in ("fovis", "rgbd", "icp_rgbd", "dvo")}
    for times, found in ((0.3, FAILS), (0.7, HOLDS), (0.96, HOLDS), (1.04, CLOSE), (1.3, FAILS)):
        cells = []
        for r in level(best):
            on_kt0 = r.key.odometer == "dvo" and r.key.trajectory == "kt0"
            cells.append(result(r.key, 0.01 * times, 0.01) if on_kt0 else r)
        assert word(6, cells) == found


@pytest.mark.parametrize("number", [13, 14])
def test_what_chance_does_on_kt0_decides_nothing(number):
    clean = [r.key for r in level({}) if r.key.noise == "clean"]
    for on_kt0 in (0.5, 1, 5):
        grown = {"kt0": on_kt0}
        cells = [result(key, 0.01, 0.01) for key in clean]
        for key in clean:
            error = 0.01 * grown.get(key.trajectory, 2.0) * (1 if key.odometer == "icp" else 3)
            cells.append(result(replace(key, noise="noisy"), error, error))
        assert word(number, cells) == HOLDS


@pytest.mark.parametrize(("times", "found"), [(2.5, HOLDS), (2, CLOSE), (1.5, FAILS)])
def test_photometric_methods_are_poor_from_twice_on(times, found):
    errors = dict.fromkeys(family("photometric"), (times, 1))
    assert word(8, level(errors)) == found


def test_fovis_that_falls_in_the_office_alone_is_seen():
    grown = [replace(r.key, noise="noisy") for r in only(results(), noise="clean")]
    clean = [result(key, 0.01, 0.01) for key in all_keys() if key.noise == "clean"]
    noisy = []
    for key in grown:
        falls = key.room == "office" and key.odometer in ("fovis", "rgbd")
        noisy.append(result(key, 0.005 if falls else 0.02, 0.01))
    assert word(16, [*clean, *noisy]) == HOLDS
    without = [result(r.key, 0.02, 0.01) if r.key.odometer == "rgbd" else r for r in noisy]
    assert word(16, [*clean, *without]) == FAILS


def test_the_authors_programs_stand_in_the_place_of_our_odometers():
    paper = [replace(key, preset="paper") for key in all_keys()]
    ours = [result(key, 0.01, 0.01) for key in paper]
    theirs = []
    for key in paper:
        if key.odometer == "fovis" and not key.seed:
            system = replace(key, odometer="libfovis", preset="final", reference="run", run=1)
            theirs.append(result(system, 5.0))
        if (key.odometer, key.reference) == ("dvo", "default"):
            system = replace(key, odometer="dvo_core", preset="final", reference="run", run=1)
            theirs.append(result(system, 0.1))
    found = verdicts_by_method([*ours, *theirs])
    words = {name: verdicts[7 - 1].word for name, verdicts in found.items()}
    assert words == {
        "printed": HOLDS,
        "paper": CLOSE,
        "paper, window ahead": MISSING,
        "paper, authors' programs": HOLDS,
        "best": MISSING,
    }
    assert any(line == "With best, of 18 findings 18 not measured." for line in headline(ours))


def test_a_model_with_its_window_ahead_stands_in_the_place_of_the_papers():
    """Noise costs ICP's trajectory on kt3, but not with the window ahead."""
    clean = PaperKey("living_room", "kt3", "clean", "icp", "paper", "model")
    found = [result(clean, 0.01), result(replace(clean, noise="noisy"), 0.03)]
    for noise in ("clean", "noisy"):
        found.append(result(replace(clean, noise=noise, reference="model-ahead"), 0.01))
    words = {name: of[15 - 1].word for name, of in verdicts_by_method(found).items()}
    assert words["paper"] == HOLDS and words["paper, window ahead"] == FAILS
    assert words["best"] == MISSING


def test_every_verdict_names_what_it_compared():
    for row in findings_table(results(4)).rows:
        assert row[7].split(":")[0] in ("method", "room", "noise") or row[5] == VOID


def test_seeds_that_disagree_decide_nothing():
    assert (
        verdict([True, True]) == HOLDS
        and verdict([False]) == FAILS
        and verdict([True, False]) == UNDECIDED
    )
    grown = [r for seed in (0, 1) for r in results(0, (seed,)) if r.key.noise == "noisy"]
    clean = only(results(0), noise="clean")
    two = [*clean, *with_errors(grown, 1e6, noise="noisy", seed=0)]
    two = [r if r.key.seed != 1 else result(r.key, 1e-9, 1e-9) for r in two]
    rows = {row[0]: row[5:7] for row in findings_table(two).rows}
    assert rows["12"] == (UNDECIDED, "1 of 2") and rows["1"][1] == "-"


def test_seeds_that_lack_the_cells_of_a_finding_do_not_count_for_it():
    """The second seed has trajectories only, the third those of one sequence, which contradicts 14."""
    found = results(0, (0, 1, 2))
    found = [result(r.key, r.figures["ate_m"]["rmse"]) if r.key.seed else r for r in found]
    found = [r for r in found if r.key.seed < 2 or r.key.trajectory == "kt2"]
    seeds = {row[0]: row[6].partition(" of ")[2] for row in findings_table(found).rows}
    assert (seeds["12"], seeds["15"], seeds["18"]) == ("1", "2", "2") and seeds["14"] == "3"


def test_an_error_that_does_not_grow_as_printed_decides_finding_13_without_the_others():
    clean = only(results(0), noise="clean")
    noisy = [replace(r.key, noise="noisy", seed=3) for r in only(clean, odometer="icp")]
    found = [*clean, *(result(key, 1e-6, 1e-6) for key in noisy)]
    assert {row[0]: row[5:7] for row in findings_table(found).rows}["13"] == (FAILS, "0 of 1")


def test_the_rank_correlation_and_its_interval_are_scipys():
    rng = np.random.default_rng(5)
    x = rng.normal(size=60).round(1)  # with ties
    y = (x + rng.normal(size=60)).round(1)

    def rho(a, b):
        return stats.spearmanr(a, b).statistic

    theirs = stats.bootstrap(
        (x, y),
        rho,
        paired=True,
        vectorized=False,
        n_resamples=300,
        method="percentile",
        rng=np.random.default_rng(0),
    )
    low, high = interval(x, y)
    assert low == pytest.approx(theirs.confidence_interval.low, abs=0.05)
    assert high == pytest.approx(theirs.confidence_interval.high, abs=0.05)


def test_an_interval_is_of_the_data_and_not_of_the_draw():
    """Its ends move with a standard deviation of about 0.01, between a half and twice which the
    cells themselves are too few to tell; the order of the cells draws anew.
    """
    rng = np.random.default_rng(3)
    x = rng.normal(size=16)
    y = 0.6 * x + 0.8 * rng.normal(size=16)
    orders = [rng.permutation(16) for _ in range(30)]
    low_ends = [interval(x[order], y[order])[0] for order in orders]
    assert 0.0095 < np.std(low_ends) < 0.0142


def test_pairs_on_one_sequence_say_whether_a_better_trajectory_means_a_better_surface():
    key = only(results(), room="office", trajectory="kt1", noise="clean")[0].key
    cells = [replace(key, run=k) for k in range(MIN_CELLS)]
    same = [result(cell, 0.01 * 2**k, 0.02 * 2**k) for k, cell in enumerate(cells)]
    found = correlation(same)
    assert (found.rho, found.pairs, found.discordant) == (pytest.approx(1), 66, 0)
    turned = [result(cell, 0.01 * 2**k, 0.02 / 2**k) for k, cell in enumerate(cells)]
    assert (correlation(turned).rho, correlation(turned).discordant) == (pytest.approx(-1), 66)
    near = [result(cell, 0.01 * 1.005**k, 0.02 / 2**k) for k, cell in enumerate(cells)]
    assert correlation(near).pairs == 0  # trajectories that hardly differ
    elsewhere = [replace(cell, trajectory=f"kt{k}") for k, cell in enumerate(cells)][2:]
    for share, pairs in ((0.92, 0), (0.85, 1)):  # errors that differ by 8 % and by 15 %
        two = [result(cells[0], 0.01, 0.02), result(cells[1], 0.01 * share, 0.04)]
        others = [result(key, 0.5, 0.5) for key in elsewhere]
        assert correlation(two + others).pairs == pairs
    assert correlation(same[:-1]) is None
    assert [row[0] for row in correlation_table(results()).rows] == [
        "all cells",
        "living room",
        "office",
        "clean",
        "noisy",
    ]


def test_the_interval_of_fewer_cells_is_nearly_all_that_is_possible():
    """Its width, in the median over errors that have nothing to do with each other; at most 2."""
    rng = np.random.default_rng(0)
    widths = {}
    for n in (MIN_CELLS // 2, MIN_CELLS, 2 * MIN_CELLS):
        ends = [interval(*rng.normal(size=(2, n))) for _ in range(15)]
        widths[n] = np.median(np.diff(ends))
    few, some, many = widths.values()
    assert few > 1.7 > some > 1.0 > many
