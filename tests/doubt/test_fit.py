"""When an explanation fits: every limit of the competition, from both sides."""

import numpy as np
import pytest
from iclnuim.doubt.change import Change
from iclnuim.doubt.competition import Candidate, winner
from iclnuim.doubt.fit import Fit, Limits

#: Of positions, of motions, and of turns.
GIVEN = np.array([1.0, 0.2, 0.1])


def fit(found, extent_m=10.0, motion_m=10.0, given=GIVEN, halves=None):
    limits = Limits(
        rounding=np.full(3, 1e-6),
        worth=np.array([1e-4, 1e-4, np.inf]),
        largest=np.array([0.35 * extent_m, 0.7 * motion_m, 0.0]),
        bearable=np.array([np.inf, np.inf, 0.5]),
    )
    return Fit(np.array([given] * 3), np.array([found, *(halves or (found, found))]), limits)


def found(position_m=1.0, motion_m=0.2, turn_rad=0.1):
    return np.array([position_m, motion_m, turn_rad])


@pytest.mark.parametrize(
    ("errors", "explains"),
    [
        (found(position_m=0.45), True),
        (found(position_m=0.55), False),
        (found(motion_m=0.09), True),
        (found(motion_m=0.11), False),
        (found(position_m=0.4, motion_m=0.21), True),
        (found(position_m=0.4, motion_m=0.25), False),
        (found(position_m=0.4, turn_rad=0.105), True),
        (found(position_m=0.4, turn_rad=0.13), False),
    ],
)
def test_an_error_is_halved_and_no_other_is_worse(errors, explains):
    assert fit(errors).explains() == explains


@pytest.mark.parametrize(("motion_m", "explains"), [(0.17, True), (0.19, False)])
def test_what_concerns_all_errors_makes_all_smaller(motion_m, explains):
    assert fit(found(0.4, motion_m)).explains(concerns_all=True) == explains


@pytest.mark.parametrize(("extent_m", "explains"), [(1.25, True), (1.0, False), (0.5, False)])
def test_what_is_left_is_small_against_the_extent(extent_m, explains):
    assert fit(found(position_m=0.4), extent_m=extent_m).explains() == explains


@pytest.mark.parametrize(("motion_m", "explains"), [(0.15, True), (0.12, False), (0.06, False)])
def test_what_is_left_is_small_against_the_motion(motion_m, explains):
    assert fit(found(motion_m=0.09), motion_m=motion_m).explains() == explains


@pytest.mark.parametrize(("turn_rad", "explains"), [(0.4, True), (0.6, False)])
def test_another_motion_is_no_other_reading(turn_rad, explains):
    assert fit(found(0.01, 0.01, turn_rad), given=np.array([1.0, 1.0, 2.0])).explains() == explains


@pytest.mark.parametrize(("position_m", "explains"), [(0.85, True), (0.95, False)])
def test_it_holds_in_each_half(position_m, explains):
    halves = found(position_m=0.1), found(position_m)
    assert fit(found(position_m=0.4), halves=halves).explains() == explains


def test_errors_below_the_resolution_of_files_are_not_explained():
    for size, explains in ((1.5e-4, True), (0.7e-4, False)):
        given = found(position_m=size)
        assert fit(found(position_m=size / 4), given=given).explains() == explains


def test_a_fitted_parameter_has_its_price():
    """Three more parameters have to reduce an error to 55 %: not to 70, and 40 are enough."""
    plain = fit(found()).cost(3)
    assert fit(found(position_m=0.70)).cost(6) > plain > fit(found(position_m=0.40)).cost(6)


@pytest.mark.parametrize(("motion_m", "explains"), [(0.1, True), (0.19, False)])
def test_what_is_explained_is_worth_the_price_of_its_parameters(motion_m, explains):
    """An arm that halves one error by drift, and hardly changes the other: its price is 0.55."""
    half = found(0.65, motion_m)
    arm = fit(found(0.49, motion_m), halves=(half, half))
    assert Candidate((Change("arm", free=3),), arm).explains() == explains


def candidate(kinds, *errors):
    return Candidate(tuple(Change(kind) for kind in kinds), fit(found(*errors)))


@pytest.mark.parametrize(("both_m", "kinds"), [(0.15, ["inverse", "scale"]), (0.25, ["inverse"])])
def test_two_at_once_halve_what_each_of_them_leaves(both_m, kinds):
    alone = candidate(["inverse"], 0.4, 0.1), candidate(["scale"], 0.8, 0.15)
    both = candidate(["inverse", "scale"], both_m, 0.09)
    assert winner([*alone, both]).kinds == kinds


def test_what_leaves_nothing_does_not_halve_itself():
    exact = fit(found(0.0, 0.1, 0.0))
    assert not exact.halves_errors_of(exact)
    assert exact.halves_errors_of(fit(found(1e-9, 0.1, 0.0)))
