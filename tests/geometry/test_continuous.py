"""Motion as a function of time: its derivatives are those of its poses, a recipe's passes through the
poses that the recipe makes, a spline's through those that it is given.
"""

import json

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.continuous import RecipeMotion, SplineMotion
from iclnuim.geometry.handheld import Recipe
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

STEP_S = 1e-4


def recipe(repository, name="living_room/kt2", **changed) -> Recipe:
    content = json.loads((repository / f"trajectories/{name}.json").read_text())
    return Recipe.from_dict({**content, **changed})


def strong_shake(repository) -> Recipe:
    """A shake that turns the camera by more than a radian."""
    content = json.loads((repository / "trajectories/office/kt1.json").read_text())
    band = {**content["shakes"][0], "rotation_deg": 45.0}
    return recipe(repository, "office/kt1", shakes=[band])


@pytest.fixture(params=["recipe", "strong shake", "spline"])
def motion(request, repository):
    if request.param == "spline":
        rng = np.random.default_rng(1)
        return SplineMotion(Trajectory.at_rate(SE3.exp(rng.normal(size=(900, 6)).cumsum(0) * 0.02)))
    made = recipe(repository) if request.param == "recipe" else strong_shake(repository)
    return RecipeMotion(made)


def test_its_derivatives_are_those_of_its_poses(motion):
    stamps_s = np.random.default_rng(0).uniform(0.9, motion.stamps_s[-1] + 0.1, 400)
    before, here, after = (motion.states(stamps_s + k * STEP_S) for k in (-1, 0, 1))

    def by_time(a, b):
        return (b - a) / (2 * STEP_S)

    positions = by_time(before.T_world_body.translation, after.T_world_body.translation)
    turned = np.swapaxes(before.T_world_body.rotation, -1, -2) @ after.T_world_body.rotation
    rates = Rotation.from_matrix(turned).as_rotvec() / (2 * STEP_S)
    for found, expected in (
        (here.velocity_m_s, positions),
        (here.acceleration_m_s2, by_time(before.velocity_m_s, after.velocity_m_s)),
        (here.rate_rad_s, rates),
        (here.rate_change_rad_s2, by_time(before.rate_rad_s, after.rate_rad_s)),
    ):
        # the third derivative of a spline jumps at its knots
        off = np.abs(found - expected).max(axis=1)
        assert np.median(off) < 1e-4 * np.abs(found).max()
        assert np.percentile(off, 95) < 1e-3 * np.abs(found).max()


@pytest.mark.parametrize("name", ["living_room/kt0", "office/kt3"])
def test_a_recipe_s_motion_passes_through_the_poses_that_it_makes(repository, name):
    motion = RecipeMotion(recipe(repository, name))
    exact_s = 1 + np.arange(len(motion.trajectory)) / 30
    T, made = motion.states(exact_s).T_world_body, motion.trajectory.T_world_camera
    assert np.abs(T.translation - made.translation).max() < 1e-13
    assert np.abs(T.rotation - made.rotation).max() < 1e-13


def test_a_spline_passes_through_its_poses_and_is_that_of_scipy_in_position():
    rng = np.random.default_rng(2)
    given = Trajectory(np.cumsum(rng.uniform(0.01, 0.1, 60)), SE3.exp(rng.normal(size=(60, 6)) * 2))
    motion = SplineMotion(given)
    T = motion.states(given.stamps_s).T_world_body
    assert np.abs(T.matrix - given.T_world_camera.matrix).max() < 1e-9
    scipy = CubicSpline(given.stamps_s, given.positions_m, bc_type="natural")
    at_s = np.linspace(*given.stamps_s[[0, -1]], 333)
    states = motion.states(at_s)
    assert states.T_world_body.translation == pytest.approx(scipy(at_s), abs=1e-9)
    assert states.acceleration_m_s2 == pytest.approx(scipy(at_s, 2), abs=1e-6)


def test_a_spline_goes_on_at_constant_velocity():
    given = Trajectory.at_rate(SE3.exp(np.random.default_rng(3).normal(size=(9, 6)) * 0.1))
    ends_s = given.stamps_s[[0, -1]]
    at, beyond = (SplineMotion(given).states(ends_s + k * np.array([-0.2, 0.2])) for k in (0, 1))
    assert beyond.velocity_m_s == pytest.approx(at.velocity_m_s)
    assert beyond.acceleration_m_s2 == pytest.approx(np.zeros((2, 3)))


def test_before_and_after_a_recipe_s_frames_only_the_shake_goes_on(repository):
    still = recipe(repository, shakes=[], length_m=8.2)
    states = RecipeMotion(still).states(np.array([0.5, 1.0, 100.0]))
    assert np.abs(states.velocity_m_s).max() < 1e-12
    assert np.abs(states.rate_rad_s).max() < 1e-12


def test_a_mounted_body_moves_as_its_poses_do(motion):
    T_body_other = SE3.exp(np.array([0.1, -0.07, 0.05, 0.4, -1.0, 2.0]))
    stamps_s = np.linspace(2.0, 9.0, 50)
    states = [motion.states(stamps_s + k * STEP_S).of_mounted(T_body_other) for k in (-1, 0, 1)]
    positions = [s.T_world_body.translation for s in states]
    velocity = (positions[2] - positions[0]) / (2 * STEP_S)
    acceleration = (states[2].velocity_m_s - states[0].velocity_m_s) / (2 * STEP_S)
    assert np.median(np.abs(states[1].velocity_m_s - velocity)) < 1e-5
    assert np.median(np.abs(states[1].acceleration_m_s2 - acceleration)) < 1e-3
    back = states[1].of_mounted(T_body_other.inverse())
    assert back.acceleration_m_s2 == pytest.approx(motion.states(stamps_s).acceleration_m_s2)
    assert back.rate_rad_s == pytest.approx(motion.states(stamps_s).rate_rad_s)


def test_one_pose_is_no_motion():
    with pytest.raises(InputError, match="at least two poses to put a path through, found 1"):
        SplineMotion(Trajectory.at_rate(SE3.identity((1,))))
