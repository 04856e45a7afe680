"""The geometric term that checks a motion."""

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.levels import Level  # noqa: E402
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.photometric import Dvo  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame, OdometryResult, OdometryStatus  # noqa: E402
from iclnuim.benchmark.odometry.terms.depth import DepthTerm  # noqa: E402
from iclnuim.benchmark.odometry.terms.free_depth import inlier_weights, scale_ambiguity  # noqa: E402
from odometry_scenes import BIG, CAMERA, ROOM, STEP, VGA, after, error_m, run, view  # noqa: E402


def test_a_motion_that_depth_contradicts_is_as_uncertain_as_it_is_off():
    """A motion with a stated deviation of 0.1 mm: unchanged if it is correct; if it is 4 mm off,
    the enlarged uncertainty covers its error.
    """
    levels = [Dvo(Dvo.PRESETS["best"]).prepare(view(i, ROOM, 0.001, BIG), BIG)[1] for i in range(2)]
    for off_m in (0.0, 0.004):
        error = np.array([off_m, 0, 0, 0, 0, 0])
        depth, T = DepthTerm(*levels), SE3.exp(error) @ STEP
        depth.linearise(T)
        result = depth.checked(OdometryResult(T, information=1e8 * np.eye(6), largest_sigma_m=1e-4))
        assert (
            result.information[0, 0] > 5e7
            if off_m == 0
            else error @ result.information @ error / 6 < 3
        )


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_intensities_that_move_against_depth_are_reported_and_depth_wins(name):
    frames = [view(i, ROOM, camera=BIG) for i in range(3)]
    still = [Frame.of(frames[0].grey, f.depth_z_m, f.stamp_s) for f in frames]
    found = run(name, still, BIG)
    assert found[-1].result.status is OdometryStatus.DEGENERATE and found[
        -1
    ].result.reason.startswith("depth: disagrees")
    assert error_m(found) < 0.2 * np.linalg.norm(after(2).translation)


def test_exact_depth_of_a_plane_observes_scale_across_it_and_none_along_it():
    rng = np.random.default_rng(1)
    for scale in (1e4, 1e7, 1e10):  # up to 1e14, where rounding is above 0.01
        for normal in rng.standard_normal((50, 3)):
            normal /= np.linalg.norm(normal)
            points = rng.uniform(-1, 1, (5_000, 3))
            points += (2 - points @ normal)[:, None] * normal
            rows = np.c_[np.tile(normal, (5_000, 1)), np.cross(points, normal)]
            exact = NormalEquations(scale * rows.T @ rows, np.zeros(6), 0.0, 1.0, np.zeros(3), 1.0)
            along = np.cross(normal, [0.0, 0.0, 1.0])
            assert 0.99 < scale_ambiguity(exact, 0.01 * along) <= 1, scale
            assert 0 <= scale_ambiguity(exact, 0.01 * normal) < 0.1, scale


def wall_level(z_m=2.0):
    return Level(np.full((120, 160), 100, np.float32), np.full((120, 160), z_m, np.float32), CAMERA)


@pytest.mark.parametrize(("angle_deg", "matched"), [(21, True), (42, False)])
def test_surfaces_that_face_elsewhere_do_not_match(angle_deg, matched):
    """A page at 20 cm, turned about its middle: all of its points stay near."""
    depth, about = DepthTerm(wall_level(0.2), wall_level(0.2)), SE3(np.eye(3), [0, 0, 0.2])
    turn = SE3.exp(np.array([0, 0, 0, 0, np.radians(angle_deg), 0]))
    depth.linearise(about @ turn @ about.inverse())
    assert np.isfinite(depth.residual).any() == matched


@pytest.mark.parametrize(("overlap", "used"), [(0.13, False), (0.28, True)])
def test_depth_of_two_places_is_not_used(overlap, used):
    """Depth images that overlap in less than a fifth, though they are of one wall."""
    depth = DepthTerm(wall_level(), wall_level())
    width_m = 2.0 * CAMERA.width / CAMERA.fx
    equations = depth.linearise(SE3(np.eye(3), [(1 - overlap) * width_m, 0, 0]))
    assert (equations.count > 0) is used


@pytest.mark.parametrize(("off_mm", "flagged"), [(4.7, False), (9.4, True)])
def test_depth_that_disagrees_by_a_third_of_a_wrong_motion_is_reported(off_mm, flagged):
    levels = [Dvo(Dvo.PRESETS["best"]).prepare(view(i, ROOM, 0.0, BIG), BIG)[1] for i in range(2)]
    T = SE3(np.eye(3), [off_mm / 1e3, 0, 0]) @ STEP
    depth = DepthTerm(*levels)
    depth.linearise(T)
    result = depth.checked(OdometryResult(T, information=np.eye(6), largest_sigma_m=1e-6))
    assert result.reason.startswith("depth: disagrees") is flagged
    if flagged:
        assert np.linalg.norm((result.T_reference_camera @ STEP.inverse()).translation) < 0.001


@pytest.mark.parametrize(("moved_mm", "evaluations"), [(1.4, 1), (2.8, 2)])
def test_points_are_associated_again_after_millimetres(moved_mm, evaluations):
    depth = DepthTerm(wall_level(), wall_level())
    depth.linearise(SE3.identity())
    equations = depth.linearise(SE3(np.eye(3), [0, 0, moved_mm / 1e3]))
    assert depth.evaluations == evaluations
    # either way they are of the pose asked for
    assert np.linalg.solve(equations.A + np.eye(6), equations.b)[2] == pytest.approx(
        -moved_mm / 1e3, rel=0.01
    )


def test_a_few_thousand_points_check_a_motion():
    """The check costs a small part of an alignment."""
    levels = [Dvo(Dvo.PRESETS["best"]).prepare(view(0, ROOM, camera=VGA), VGA)[1]] * 2
    assert 3000 < DepthTerm(*levels).pixels < 8000


def test_a_part_of_the_image_counts_as_its_depth_is_right():
    """To some percent, that of a sensor; a tenth is a pane of glass or a mirror."""
    weights = inlier_weights(np.array([1.0, 1.03, 0.9]), np.zeros(3), 0.0)
    assert weights[0] == 1 and weights[1] > 0.4 and weights[2] < 0.1


def test_parts_that_are_known_roughly_do_not_say_what_the_common_factor_is():
    """Five parts with a standard deviation of 0.7 agree on the factor 1.5; the others have 1.4."""
    factor = np.r_[np.full(5, 1.5), np.full(9, 0.7)]
    variance = np.r_[np.full(5, 0.5), np.full(9, 2.0)]
    weights = inlier_weights(factor, variance, 1.0)
    assert weights[0] == pytest.approx(1.0)
    variance[5:] = 0.5
    assert inlier_weights(factor, variance, 1.0)[0] < 0.7
