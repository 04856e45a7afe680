"""When an explanation of a bad estimate fits: every limit, from both sides."""

from dataclasses import replace

import pytest
from iclnuim.doubt.fit import Fit
from iclnuim.evaluation.compared_poses import Errors

GIVEN = Errors(position_m=1.0, motion_m=0.2, turn_rad=0.1)


def fit(found, extent_m=10.0, motion_m=10.0, given=GIVEN, halves=None):
    return Fit(given, found, (given, given), halves or (found, found), extent_m, motion_m)


def found(position_m=1.0, motion_m=0.2, turn_rad=0.1):
    return Errors(position_m, motion_m, turn_rad)


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


@pytest.mark.parametrize(("position_m", "explains"), [(0.85, True), (0.95, False)])
def test_it_holds_in_each_half(position_m, explains):
    halves = found(position_m=0.1), found(position_m)
    assert fit(found(position_m=0.4), halves=halves).explains() == explains


def test_errors_below_the_resolution_of_files_are_not_explained():
    for size, explains in ((1.5e-4, True), (0.7e-4, False)):
        given = replace(GIVEN, position_m=size)
        assert fit(found(position_m=size / 4), given=given).explains() == explains


def test_a_fitted_parameter_has_its_price():
    """Three more parameters have to reduce an error to 55 %: not to 70, and 40 are enough."""
    plain = fit(found()).cost(3)
    assert fit(found(position_m=0.70)).cost(6) > plain > fit(found(position_m=0.40)).cost(6)
