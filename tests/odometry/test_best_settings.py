"""What each number of the preset `best` is for: half of it or twice as much does not do that."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry import kernels  # noqa: E402
from iclnuim.benchmark.odometry.icp import Icp  # noqa: E402
from iclnuim.benchmark.odometry.icp_rgbd import IcpRgbd  # noqa: E402
from iclnuim.benchmark.odometry.levels import Level, Pair  # noqa: E402
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.photometric import image_passes  # noqa: E402
from iclnuim.benchmark.odometry.protocol import OdometryStatus  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from iclnuim.benchmark.odometry.solver import Pass, SolverLimits, Stop, solve  # noqa: E402
from iclnuim.benchmark.odometry.terms.depth import DepthTerm, _depth_only_twist  # noqa: E402
from iclnuim.benchmark.odometry.terms.photometric import PhotometricTerm  # noqa: E402
from iclnuim.benchmark.odometry.terms.plane import PlaneTerm  # noqa: E402
from odometry_scenes import BIG, CAMERA, ROOM, STEP, VGA, after, view  # noqa: E402

#: Errors of a guess: 1 degree and 3 cm in some direction, 2 degrees and 5 cm.
NEAR = np.r_[0.02, -0.01, 0.02, np.radians([1, -1, 1])]
FAR = np.r_[0.03, -0.02, 0.03, np.radians([2, -2, 1])]


def pair_of(method, numbers, noise):
    return Pair(*(method.prepare(view(i, ROOM, noise, BIG), BIG) for i in numbers))


def passes_of(name, pair, guess):
    """The passes of `best`, coarse to fine; those of planes alone for `icp_rgbd, planes`."""
    method = odometer(name.split(",")[0])
    schedule = method.schedule(pair.reference)
    if name == "icp":
        return method.planes(pair, guess).passes
    if name == "icp_rgbd, planes":
        return method.alone.planes(pair, guess).passes
    if name == "icp_rgbd":
        planes = {n: PlaneTerm(pair, method.settings, n) for n, _ in schedule}
        return method._jointly(pair, planes, schedule, guess).passes
    finest = schedule[-1][0]
    depth = DepthTerm(pair.reference[finest], pair.current[finest])
    return image_passes(pair, method.settings, schedule, depth)[0]


def left_px(name, pair, truth, k, off):
    """What the k-th pass leaves of a guess that is `off`, with its iterations and with half of
    them: the distance from where it converges, in pixels of the whole image at 2 m.
    """
    guess = truth @ SE3.exp(off)
    limits = SolverLimits(min_inliers=0.0, prior_m=0.003)

    def found(iterations):
        one = passes_of(name, pair, guess)[k]
        one = one._replace(iterations=iterations, stop=Stop())
        return solve([one], guess, limits).T_reference_camera

    count = passes_of(name, pair, guess)[k].iterations
    converged = found(25)
    errors = [(converged.inverse() @ found(n)).log() for n in (count, count // 2)]
    return [BIG.fx * np.hypot(np.linalg.norm(e[:3]) / 2, np.linalg.norm(e[3:])) for e in errors]


class Known:
    """A term that knows every direction to sigma_m, and is at its minimum after one step."""

    def __init__(self, sigma_m, count=1000, pixels=1000):
        A = np.eye(6) / sigma_m**2
        self.pixels = pixels
        self.equations = NormalEquations(
            A, np.zeros(6), 1.0, count, np.zeros(3), 1.0, is_information=True
        )

    def linearise(self, T, iteration):
        return self.equations


def limits_of(name):
    settings = odometer(name).settings
    return settings[0].limits if isinstance(settings, tuple) else settings.limits


@pytest.mark.parametrize(
    ("name", "prior_m"), [("icp", 0.003), ("rgbd", 0.03), ("dvo", 0.03), ("fovis", 0.03)]
)
def test_a_hand_moves_as_before_to_millimetres_for_planes_and_to_centimetres_for_images(
    name, prior_m
):
    """Planes that know a direction to 4 mm leave it to the prediction, to 2 mm they do not; images
    often know no more than centimetres.
    """
    for share, outweighed in ((0.7, 0), (1.4, 6)):
        known = Pass(Known(share * prior_m), 3, Stop())
        found = solve([known], SE3.identity(), limits_of(name))
        assert found.under_constrained == outweighed


@pytest.mark.parametrize(
    ("name", "noise", "first"), [("icp_rgbd", 0.003, False), ("icp_rgbd", 0.003, True)]
)
def test_images_of_noisy_frames_decide_what_they_know_to_a_centimetre(name, noise, first):
    """Nothing else constrains a motion along a wall there."""
    method = odometer(name)
    pair = pair_of(method, (0, 1), noise)
    start = method._start(pair, SE3.identity())
    planes = {n: PlaneTerm(pair, method.settings, n) for n, _ in start.schedule}
    if first:
        limits = method._image_first(pair, planes, start, SE3.identity()).limits
    else:
        limits = method._jointly(pair, planes, start.schedule, SE3.identity()).limits
    for sigma_m, outweighed in ((0.007, 0), (0.014, 6)):
        found = solve([Pass(Known(sigma_m), 3, Stop())], SE3.identity(), limits)
        assert found.under_constrained == outweighed


@pytest.mark.parametrize(("name", "share"), [("rgbd", 0.001), ("dvo", 0.01)])
def test_an_image_with_few_gradients_is_aligned_if_some_match(name, share):
    """`rgbd` uses steep gradients alone, of which a bare room has one in a thousand pixels; `dvo`
    uses almost all pixels.
    """
    pixels = 100_000
    for part, status in ((0.7, OdometryStatus.FAILED), (1.4, OdometryStatus.OK)):
        known = Known(0.001, part * share * pixels, pixels)
        assert solve([Pass(known, 1, Stop())], SE3.identity(), limits_of(name)).status is status


class Halving:
    """Each step is nine tenths of the one before; the error decreases by `decrease` each time."""

    pixels = 100

    def __init__(self, decrease=1.0):
        self.decrease = decrease
        self.step_m = 1e-3

    def linearise(self, T, iteration):
        self.step_m *= 0.9
        b = np.r_[self.step_m, np.zeros(5)]
        error = 1e3 - iteration * self.decrease
        return NormalEquations(np.eye(6), b, error, 100, np.zeros(3), 1.0)


@pytest.mark.parametrize(
    ("name", "least_m"), [("icp", 5e-6), ("rgbd", 2e-5), ("dvo", 2e-5), ("fovis", 1e-5)]
)
def test_steps_end_at_some_micrometres(name, least_m):
    """A tenth of the stated deviations of these methods on clean frames; more iterations would
    not make a motion better.
    """
    settings = odometer(name).settings
    term = Halving()
    found = solve(
        [Pass(term, 500, replace(settings.stop, undo=False))], SE3.identity(), SolverLimits()
    )
    assert found.converged and 0.7 * least_m < term.step_m < 1.4 * least_m


@pytest.mark.parametrize(("decrease", "goes_on"), [(0.0007, False), (0.0014, True)])
def test_dvo_ends_a_level_where_the_error_hardly_decreases(decrease, goes_on):
    """A thousandth of a squared grey level: a renderer rounds to a twelfth."""
    term = Halving(decrease)
    solve([Pass(term, 9, odometer("dvo").settings.stop)], SE3.identity(), SolverLimits())
    assert (term.step_m < 0.5e-3) is goes_on


def ramp(level_gradient, z_m=2.0):
    """A level whose grey values increase by level_gradient a pixel along a row."""
    grey = np.tile(np.arange(CAMERA.width) * level_gradient, (CAMERA.height, 1))
    return Level(grey.astype(np.float32), np.full(grey.shape, z_m, np.float32), CAMERA)


def points_of(level, settings, n):
    """The term of a pyramid's n-th level, if that level were `level`."""
    pair = Pair([level] * (n + 1), [level] * (n + 1))
    return PhotometricTerm(pair, settings, n)


@pytest.mark.parametrize(
    ("name", "n", "least"),
    [
        ("rgbd", 0, 12),
        ("rgbd", 1, 2),
        ("rgbd", 2, 3),
        ("rgbd", 3, 2),
        ("dvo", 0, 2),
        ("dvo", 1, 2),
        ("dvo", 2, 2),
        ("dvo", 3, 2),
        ("icp_rgbd", 0, 12),
        ("icp_rgbd", 1, 2),
        ("icp_rgbd", 2, 3),
        ("icp_rgbd", 3, 3),
    ],
)
def test_a_gradient_is_used_where_it_is_more_than_noise(name, n, least):
    """In grey levels a pixel. The whole image is used only if it is too small for a pyramid: there
    edges alone have less noise than contrast.
    """
    method = odometer(name)
    settings = method.photometric if name == "icp_rgbd" else method.settings
    assert len(points_of(ramp(0.7 * least), settings, n).seen.points) == 0
    assert len(points_of(ramp(1.4 * least), settings, n).seen.points) > 18_000


@pytest.mark.parametrize("name", ["rgbd", "icp_rgbd"])
def test_depth_is_used_as_far_as_a_sixteen_bit_image_holds_it(name):
    """65,535 fifths of a millimetre are 13.1 m; what lies beyond is a mistake."""
    method = odometer(name)
    settings = method.photometric if name == "icp_rgbd" else method.settings
    for z_m, used in ((12.9, True), (20.0, False)):
        assert (len(points_of(ramp(5.0, z_m), settings, 1).seen.points) > 0) is used


@pytest.mark.parametrize(("name", "most_m"), [("rgbd", 0.07), ("icp_rgbd", 0.07), ("dvo", 0.05)])
def test_a_surface_some_centimetres_before_another_hides_it(name, most_m):
    method = odometer(name)
    settings = method.photometric if name == "icp_rgbd" else method.settings
    for before_m, seen in ((0.7 * most_m, True), (1.4 * most_m, False)):
        one = [ramp(5.0)] * 2
        term = PhotometricTerm(Pair(one, [ramp(5.0, 2.0 - before_m)] * 2), settings, 1)
        term.linearise(SE3.identity(), 0)
        assert np.isfinite(term.residual).any() == seen


@pytest.mark.parametrize(("angle_deg", "matched"), [(8.5, True), (17, False)])
def test_normals_of_exact_depth_match_to_some_degrees(angle_deg, matched):
    """More is another surface: a page at 20 cm, turned about its middle."""
    depth = np.full((120, 160), 0.2, np.float32)
    levels = [Level(np.full(depth.shape, 100, np.float32), depth, CAMERA)] * 2
    about = SE3(np.eye(3), [0, 0, 0.2])
    turn = about @ SE3.exp(np.array([0, 0, 0, 0, np.radians(angle_deg), 0])) @ about.inverse()
    for settings in (Icp.PRESETS["best"], IcpRgbd.PRESETS["best"][0]):
        term = PlaneTerm(Pair(levels, levels), settings, 1)
        term.linearise(turn, 0)
        assert np.isfinite(term.residual).any() == matched


def test_levels_of_planes_have_some_ten_thousand_points_where_the_image_has_more():
    """Of a VGA image: fewer are less certain, more cost time. A level with fewer pixels is used
    whole: the coarsest one, and an image too small for a pyramid.
    """
    tiny = PinholeCamera.parse("40x30")
    for method in (odometer("icp"), odometer("icp_rgbd").alone):
        levels = method.prepare(view(0, ROOM, camera=VGA), VGA)
        for n in range(1, len(levels)):
            term = PlaneTerm(Pair(levels, levels), method.settings, n)
            whole = levels[n].depth_z_m.size
            assert min(13_000, 0.7 * whole) < term.pixels < 27_000
        small = method.prepare(view(0, ROOM, camera=tiny), tiny)
        term = PlaneTerm(Pair(small, small), method.settings, 0)
        assert term.pixels > 0.7 * tiny.width * tiny.height


def page(z_m, camera=CAMERA):
    """A level that sees a wall; z_m is a number or an image."""
    depth = np.broadcast_to(np.float32(z_m), (camera.height, camera.width))
    return Level(np.full(depth.shape, 100, np.float32), np.ascontiguousarray(depth), camera)


def noisy_wall(before_m, share):
    """A wall at 2 m with 3 mm of noise; a share of it has an object `before_m` in front."""
    noise = np.random.default_rng(0).normal(0, 0.003, (CAMERA.height, CAMERA.width))
    noise[: int(share * CAMERA.height)] -= before_m
    return page((2 + noise).astype(np.float32))


def wall_terms(current):
    """Planes of exact depth with one normal, and the geometric term of the images."""
    settings = replace(Icp.PRESETS["best"], two_normals=False, max_angle_deg=60.0)
    smooth = replace(current, normal_step=3)
    return PlaneTerm(Pair([page(2.0)], [smooth]), settings, 0), DepthTerm(page(2.0), current)


def test_an_object_before_a_tenth_of_a_wall_hardly_moves_it():
    """By less than 0.9 mm; it is 30 mm in front, so that the mean of all points moves by 3 mm."""
    for term in wall_terms(noisy_wall(0.03, 0.1)):
        z_m = 0.0
        for iteration in range(8):
            found = term.linearise(SE3(np.eye(3), [0, 0, z_m]), iteration)
            z_m += found.b[2] / found.A[2, 2]
        assert 0 < z_m < 0.0009


def test_weights_hardly_count_against_noise_without_outliers():
    """The information that they state is at most a fifth above that of the mean of all points."""
    for term in wall_terms(noisy_wall(0.0, 0.0)):
        for iteration in range(6):
            found = term.linearise(SE3(np.eye(3), [0, 0, 2.5e-3 * (iteration % 2)]), iteration)
        found = term.linearise(SE3.identity(), 6)
        residual = term.residual[np.isfinite(term.residual)]
        information = found.A[2, 2] / (1.0 if found.is_information else found.error)
        assert 1.0 < information * np.var(residual) / len(residual) < 1.2


def test_normals_of_a_noisy_frame_are_smoothed_as_far_as_edges_bear_it():
    """At 0.2 % of noise a sixth of them are more than 12 degrees off; of exact depth, 3 % would be
    with twice the step, beside the edges of the corner.
    """
    level = odometer("icp").prepare(view(0, ROOM, 0.002, BIG), BIG)[0]
    exact = view(0, ROOM, camera=BIG).depth_z_m
    true = kernels.normals(exact, BIG.intrinsics, 1)

    def wrong(normals):
        both = (normals[..., 2] != 0) & (true[..., 2] != 0)
        cosines = np.sum(normals * true, axis=-1)[both]
        return np.mean(cosines < np.cos(np.radians(12)))

    assert wrong(level.normals) < 0.2
    assert wrong(kernels.normals(exact, BIG.intrinsics, level.normal_step)) < 0.022


def test_two_rounded_images_are_as_certain_as_rounding_leaves_them_in_rgbd_and_dvo():
    """Each pixel has an error of its own there; without weights, which do not change this."""
    for name in ("rgbd", "dvo"):
        pair = pair_of(odometer(name), (0, 0), 0.0)
        term = PhotometricTerm(pair, replace(odometer(name).settings, nu=0.0), 1)
        equations = term.linearise(SE3.identity(), 0)
        J = term.J[np.isfinite(term.residual)].astype(float)
        np.testing.assert_allclose(equations.A, 6 * J.T @ J, rtol=0.02)


@pytest.mark.parametrize(
    ("noise", "calibrated", "least", "most"), [(0.0, False, 53, 106), (0.003, True, 17, 34)]
)
def test_beside_planes_an_image_counts_as_fewer_pixels(noise, calibrated, least, most):
    """Errors of interpolation, those of exact frames, are shared by more pixels than noise is."""
    method = odometer("icp_rgbd")
    frames = (replace(view(i, ROOM, noise, BIG), calibrated=calibrated) for i in range(2))
    pair = Pair(*(method.prepare(frame, BIG) for frame in frames))
    start = method._start(pair, STEP)
    planes = {n: PlaneTerm(pair, method.settings, n) for n, _ in start.schedule}
    beside = method._jointly(pair, planes, start.schedule, STEP).passes[-1].term.image
    single = image_passes(pair, replace(method.photometric, spread=1.0), start.schedule)[0][-1].term
    shares = [np.trace(term.linearise(STEP, 0).A) for term in (single, beside)]
    assert least < shares[0] / shares[1] < most


@pytest.mark.parametrize(("sigma_m", "least", "most"), [(0.015, 0.7, 0.9), (0.06, 0.1, 0.3)])
def test_depth_alone_moves_a_motion_by_centimetres_where_it_knows_them(sigma_m, least, most):
    """Of a step of 1 mm that depth asks for, with a standard deviation of 15 and of 60 mm."""
    A = np.eye(6) / sigma_m**2
    depth = NormalEquations(A, A[0] * 1e-3, 1.0, 100, np.zeros(3), 1.0)
    assert least < _depth_only_twist(depth)[0] / 1e-3 < most


@pytest.mark.parametrize(
    ("name", "k", "noise", "off", "limit_px"),
    [
        ("icp", 0, 0.003, FAR, 0.25),
        ("icp", 1, 0.003, FAR, 0.03),
        ("icp_rgbd, planes", 0, 0.003, FAR, 0.25),
        ("icp_rgbd, planes", 1, 0.003, FAR, 0.03),
        ("icp_rgbd", 0, 0.0, NEAR, 0.7),
        ("icp_rgbd", 1, 0.003, FAR, 0.8),
        ("icp_rgbd", 2, 0.003, FAR, 1.0),
        ("rgbd", 0, 0.003, FAR, 0.5),
        ("rgbd", 1, 0.003, FAR, 0.5),
        ("rgbd", 2, 0.003, FAR, 0.15),
        ("dvo", 0, 0.003, FAR, 0.5),
        ("dvo", 1, 0.003, FAR, 0.5),
        ("dvo", 2, 0.003, FAR, 0.15),
    ],
)
def test_a_level_has_the_iterations_that_it_needs(name, k, noise, off, limit_px):
    """From a poor guess a coarse level comes within a fraction of a pixel, and the finest one
    closer, as its result is not improved; with half of the iterations neither does. Noisy frames,
    which converge the slowest; the coarsest level of `icp_rgbd` has no points on them.
    """
    pair = pair_of(odometer(name.split(",")[0]), (0, 8), noise)
    enough, half = left_px(name, pair, after(8), k, off)
    assert enough < limit_px < half
