"""Normal equations against numpy."""

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402


def test_the_step_solves_the_equations_as_numpy_does():
    rng = np.random.default_rng(3)
    J, r, p = rng.normal(size=(50, 6)), rng.normal(size=50), rng.normal(size=(50, 3))
    centre = p.mean(axis=0)
    system = NormalEquations(J.T @ J, J.T @ r, 1.0, 50, centre, 2.0)
    np.testing.assert_allclose(
        system.step(np.zeros(6))[0], np.linalg.lstsq(J, r, rcond=None)[0], rtol=1e-8
    )
    np.testing.assert_allclose(
        (SE3.exp(np.zeros(6)) @ SE3.identity()).matrix, np.eye(4), atol=1e-15
    )


def test_a_rotation_in_front_of_a_bare_wall_is_not_estimated_as_a_motion_along_it():
    rng = np.random.default_rng(6)
    wall = np.c_[rng.uniform(-1, 1, (200, 2)), np.full(200, 2.0)]
    # certain to a millimetre
    J = np.c_[np.tile([0.0, 0, 1], (200, 1)), np.cross(wall, [0.0, 0, 1])] * 1e3
    rotation = np.r_[0, 0, 0.01, 0.02, -0.03, 0]
    for camera_m in (np.zeros(3), np.array([0.2, -0.1, 0.3])):
        # the camera itself moves along z only
        about = np.r_[np.cross(camera_m, rotation[3:]), np.zeros(3)] + rotation
        system = NormalEquations(
            J.T @ J, J.T @ (J @ about), 1.0, 200, wall.mean(axis=0), 0.8, is_information=True
        )
        twist, under_constrained = system.step(np.zeros(6), 0.03, camera_m)
        assert under_constrained == 3
        moved_m = twist[:3] + np.cross(twist[3:], camera_m)
        np.testing.assert_allclose(moved_m[:2], 0, atol=1e-5)
        np.testing.assert_allclose(twist[3:5], rotation[3:5], atol=1e-5)


def test_equations_with_a_further_error_have_the_sum_of_both_variances_and_the_same_optimum():
    rng = np.random.default_rng(4)
    J, r = rng.normal(size=(50, 6)), rng.normal(size=50)
    exact = NormalEquations(J.T @ J, J.T @ r, 1.0, 50, np.zeros(3), 1.0)
    for columns in (rng.normal(size=(6, 1)), np.diag(rng.uniform(0, 1, 6))):
        found = exact.with_error(columns)
        np.testing.assert_allclose(
            np.linalg.inv(found.A), np.linalg.inv(exact.A) + columns @ columns.T, atol=1e-12
        )
        np.testing.assert_allclose(
            np.linalg.solve(found.A, found.b), np.linalg.solve(exact.A, exact.b), rtol=1e-9
        )
    # an unknown length of the motion: the joint problem, its factor solved for as well
    along = np.r_[0.3, -0.1, 0.2, 0, 0, 0]
    free = exact.with_error(1e6 * along[:, None])
    assert abs(along @ free.A @ along) < 1e-6 and abs(along @ free.b) < 1e-6
    joint = np.linalg.lstsq(np.c_[J, J @ along], r, rcond=None)[0]
    np.testing.assert_allclose(free.A @ joint[:6], free.b, atol=1e-6)
    np.testing.assert_allclose(exact.with_error(1e-9 * along[:, None]).A, J.T @ J, atol=1e-9)
    still = exact.with_error(np.zeros((6, 6)))
    np.testing.assert_allclose(still.A, exact.A, rtol=1e-12)


def test_the_rotation_step_is_the_least_squares_solution():
    rng = np.random.default_rng(5)
    J, r = rng.normal(size=(50, 6)), rng.normal(size=50)
    twist = NormalEquations(J.T @ J, J.T @ r, 1.0, 50, np.zeros(3), 1.0).rotation_step()
    np.testing.assert_allclose(twist[3:], np.linalg.lstsq(J[:, 3:], r, rcond=None)[0], rtol=1e-8)
    assert not twist[:3].any()


@pytest.mark.parametrize(("share", "updated"), [(7e-10, False), (1.4e-9, True)])
def test_a_direction_that_is_known_by_rounding_alone_is_not_updated(share, updated):
    A = np.diag([1e6, 1e6, 1e6, 1e6, 1e6, 1e6 * share])
    equations = NormalEquations(A, A @ np.ones(6), 1.0, 50, np.zeros(3), 1.0)
    step, unobservable = equations.step(np.zeros(6))
    np.testing.assert_allclose(step, [1, 1, 1, 1, 1, float(updated)], rtol=1e-6)
    assert unobservable == (not updated)
