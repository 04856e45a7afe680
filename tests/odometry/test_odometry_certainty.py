"""What an odometer knows of its own error: on textured and bare planes, clean and noisy, with
things in the way.
"""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry import icp, kernels  # noqa: E402
from iclnuim.benchmark.odometry.certainty import (  # noqa: E402
    ACROSS,
    DOWN,
    jackknife_information,
    spread_information,
)
from iclnuim.benchmark.odometry.depth_term import DepthTerm, scale_ambiguity  # noqa: E402
from iclnuim.benchmark.odometry.icp import Icp  # noqa: E402
from iclnuim.benchmark.odometry.photometric import Dvo, PhotometricTerm, Rgbd, Start, Tiles  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame, Result, Status, failure  # noqa: E402
from iclnuim.benchmark.odometry.registry import ODOMETERS, odometer  # noqa: E402
from iclnuim.benchmark.odometry.solver import MAX_SIGMA_M, Level, Limits, Pass, Stop, System, solve  # noqa: E402
from iclnuim.benchmark.odometry.track import (
    EntropyReference,
    KeyframeReference,
    MatchedKeyframeReference,
    MatchesReference,
    Reference,
    Tracker,
    track,
)

CAMERA = PinholeCamera.parse("160x120")
BIG = PinholeCamera.parse("320x240")
STEP = SE3.exp(np.array([0.006, -0.004, 0.005, 0.004, -0.003, 0.005]))
ROOM = ((0.8, 0.0, 0.6), (-0.8, 0.0, 0.6), (0.0, 0.8, 0.6))
WALL = ((0.0, 0.0, 1.0),)


def after(i):
    return SE3.from_matrix(np.linalg.matrix_power(STEP.matrix, i))


def view(i, planes, noise=0.0, camera=CAMERA):
    """The i-th frame of a steady motion before planes at 2 m; depth noise is a share, from a seed
    of its own.
    """
    T, rng = after(i), np.random.default_rng([5, i])
    rays = camera.rays() @ T.rotation.T
    nearest = np.full(rays.shape[:2], np.inf)
    for n in np.array(planes) / np.linalg.norm(planes, axis=1)[:, None]:
        slope = rays @ n
        nearest = np.minimum(
            nearest,
            np.where(slope > 1e-6, (2 - n @ T.translation) / np.maximum(slope, 1e-6), np.inf),
        )
    x, y, z = np.moveaxis(T.translation + rays * nearest[..., None], -1, 0)
    grey = (
        128 + 40 * np.sin(9 * x + 2 * z) + 40 * np.sin(11 * y - 3 * z) + 20 * np.sin(7 * z + 4 * x)
    )
    depth = nearest * (1 + noise * rng.standard_normal(nearest.shape))
    return Frame.of(grey + 500 * noise * rng.standard_normal(grey.shape), depth, i / 30)


def run(method, frames, camera=CAMERA):
    method = odometer(method) if isinstance(method, str) else method
    return list(track(method, camera, [(f.stamp_s, f) for f in frames]))


def error_m(found, last=None):
    true = after(len(found) - 1 if last is None else last)
    return float(np.linalg.norm(found[-1].T_world_camera.translation - true.translation))


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_a_bare_wall_is_flagged_with_and_without_noise_and_a_room_is_not(noise):
    wall = run("icp", [view(i, WALL, noise) for i in range(6)])
    room = run("icp", [view(i, ROOM, noise) for i in range(6)])
    assert all(
        f.result.status is Status.DEGENERATE and f.result.under_constrained >= 3 for f in wall[1:]
    )
    assert not any(f.result.status is Status.DEGENERATE for f in room[1:])


@pytest.mark.parametrize(
    ("side", "floor", "expected"),
    [(0.43, 0.63, Status.DEGENERATE), (0.45, 0.66, Status.OK)],
    ids=["border", "more"],
)
def test_a_motion_that_rests_on_the_last_border_of_two_faces_is_flagged_on_noisy_frames(
    side, floor, expected
):
    """A wall, and at the image's border a few pixels of a face to the side and one below, which set
    the motion along the wall.
    """
    planes = (WALL[0], (np.sqrt(1 - side**2), 0.0, side), (0.0, np.sqrt(1 - floor**2), floor))
    result = run("icp", [view(i, planes, 0.001, BIG) for i in range(2)], BIG)[1].result
    assert result.status is expected
    assert (
        result.largest_sigma_m < MAX_SIGMA_M and result.under_constrained == 0
    )  # no other rule flags it


@pytest.mark.parametrize(("rendered", "calibrated"), [(False, False), (True, False), (False, True)])
def test_planes_of_a_sensor_join_last_unless_its_offset_is_known_or_they_are_of_a_model(
    rendered, calibrated, monkeypatch
):
    method, asked = odometer("icp_rgbd"), []
    frames = (replace(view(i, ROOM, 0.003, BIG), calibrated=calibrated) for i in range(2))
    one, two = (method.prepare(frame, BIG) for frame in frames)
    assert method.rough(two) and method.biased(one, two) is not calibrated
    for name in ("_jointly", "_image_first"):
        way = getattr(method, name)
        monkeypatch.setattr(
            method, name, lambda *args, name=name, way=way: asked.append(name) or way(*args)
        )
    result = method.align([replace(level, rendered=rendered) for level in one], two, SE3.identity())
    assert asked == (["_jointly"] if rendered or calibrated else ["_image_first"])
    assert np.linalg.norm((STEP.inverse() @ result.T_reference_camera).translation) < 0.002


def test_the_least_share_of_matching_pixels_of_a_noisy_frame_is_that_of_images(monkeypatch):
    """Planes have points everywhere, but few pixels of a wall have contrast: with the planes' share
    such a frame was lost, and a wrong motion followed.
    """
    method, limits = odometer("icp_rgbd"), []
    monkeypatch.setattr(
        icp, "solve", lambda passes, guess, some: limits.append(some) or solve(passes, guess, some)
    )
    one, two = (method.prepare(view(i, ROOM, 0.003, BIG), BIG) for i in range(2))
    assert method.align(one, two, SE3.identity()).status is Status.OK
    assert [some.min_inliers for some in limits] == [method.photometric.limits.min_inliers]
    assert method.photometric.limits.min_inliers < method.settings.limits.min_inliers


def test_a_known_offset_is_removed():
    """The offset shortens the motion, and all pixels agree on it."""
    offset = 0.01
    frames = [view(i, ROOM, camera=BIG) for i in range(2)]
    shifted = [replace(f, depth_z_m=f.depth_z_m / (1 + offset * f.depth_z_m)) for f in frames]
    known = [Frame.of(f.grey, f.depth_z_m, f.stamp_s, depth_offset=offset) for f in shifted]
    assert np.allclose(known[1].depth_z_m, frames[1].depth_z_m, rtol=1e-5) and known[1].calibrated
    steps = [run("icp_rgbd", pair, BIG)[-1].result.T_reference_camera for pair in (shifted, known)]
    errors = [np.linalg.norm((STEP.inverse() @ step).log()) for step in steps]
    assert errors[1] < 0.1 * errors[0]


def test_with_a_known_offset_icp_rgbd_is_as_accurate_as_the_better_one_of_its_parts():
    def rms_m(name):
        method, errors = odometer(name), []
        for i in range(0, 30, 3):
            pair = (replace(view(k, ROOM, 0.001, BIG), calibrated=True) for k in (i, i + 1))
            found = method.align(*(method.prepare(frame, BIG) for frame in pair), SE3.identity())
            errors.append((STEP.inverse() @ found.T_reference_camera).translation)
        return np.sqrt(np.mean(np.square(errors)))

    assert rms_m("icp_rgbd") < min(rms_m("icp"), rms_m("rgbd"))


@pytest.mark.parametrize(("calibrated", "share"), [(False, 0.005), (True, 0.002)])
def test_the_stated_deviation_of_a_noisy_frame_allows_for_the_bias_of_its_depth(calibrated, share):
    """Many pixels with independent errors do not make the length of a motion more certain than the
    sensor's scale.
    """
    frames = [replace(view(i, ROOM, 0.001, BIG), calibrated=calibrated) for i in (0, 8)]
    result = run("icp", frames, BIG)[1].result
    t = result.T_reference_camera.translation
    stated = np.sqrt(t @ np.linalg.inv(result.information)[:3, :3] @ t) / (t @ t)
    assert share < stated < 1.5 * share


@pytest.mark.parametrize("name", ["fovis", "rgbd", "dvo"])
@pytest.mark.parametrize(
    ("noise", "calibrated", "share"), [(0.001, False, 0.005), (0.001, True, 0.002), (0, False, 0)]
)
def test_images_with_depth_of_a_sensor_add_its_bias_to_their_own_variance(
    name, noise, calibrated, share, monkeypatch
):
    frames = [replace(view(i, ROOM, noise, BIG), calibrated=calibrated) for i in (0, 8)]
    with_bias = run(name, frames, BIG)[1].result
    monkeypatch.setattr("iclnuim.benchmark.odometry.depth_term.MAX_ROUGHNESS", np.inf)
    without = run(name, frames, BIG)[1].result
    length_m = np.linalg.norm(without.T_reference_camera.translation)
    added = np.linalg.inv(with_bias.information) - np.linalg.inv(without.information)
    expected = (share * length_m) ** 2 * np.diag([1, 1, 1, 0, 0, 0])
    assert np.allclose(added, expected, rtol=1e-3, atol=1e-12)


def test_noise_fakes_constraint_for_one_normal_and_not_for_two():
    frames = [view(i, WALL, 0.003) for i in range(3)]
    two = run("icp", frames)[-1].result.smallest_eigenvalue
    one = run(Icp(replace(Icp.PRESETS["paper"], bilateral=False)), frames)[
        -1
    ].result.smallest_eigenvalue
    assert two < 0.25 * one


def test_the_stated_deviation_is_of_the_size_of_the_error():
    found = run("icp", [view(i, ROOM, 0.001) for i in range(12)])
    steps = [
        a.T_world_camera.inverse() @ b.T_world_camera
        for a, b in zip(found, found[1:], strict=False)
    ]
    errors = [np.linalg.norm((STEP.inverse() @ step).translation) for step in steps[1:]]
    stated = [np.sqrt(np.trace(np.linalg.inv(f.result.information)[:3, :3])) for f in found[2:]]
    assert 0.1 < np.sqrt(np.mean(np.square(errors))) / np.mean(stated) < 3


@pytest.mark.parametrize("shared", [0.0, 1.0])
def test_information_is_of_errors_that_pixels_share_and_of_those_that_they_do_not(shared):
    """The mean NEES per degree of freedom is 1, whether errors are correlated within blocks or not."""
    rng, nees = np.random.default_rng(7), []
    blocks = np.repeat(np.arange(ACROSS * DOWN, dtype=np.int16), 100)
    for _ in range(60):
        J = (
            rng.normal(size=(len(blocks), 6)).astype(np.float32)
            + rng.normal(size=(ACROSS * DOWN, 6))[blocks]
        )
        J, points = J.astype(np.float32), rng.uniform(1, 2, (len(blocks), 3)).astype(np.float32)
        r = (rng.normal(size=len(blocks)) + shared * rng.normal(size=ACROSS * DOWN)[blocks]).astype(
            np.float32
        ) * 1e-3
        sums = np.empty((ACROSS * DOWN, 34))
        kernels.block_sums(points, J, r, J, r, 1.0, 0.0, blocks, sums)
        system = jackknife_information(System.of_sums(sums.sum(axis=0)), sums, 0.0)
        twist = np.linalg.solve(system.A, system.b)
        nees.append(twist @ system.A @ twist / 6)
    assert 0.5 < np.mean(nees) < 2


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_noise_that_pixels_do_not_share_is_not_taken_for_noise_that_they_share(name):
    """The mean NEES per degree of freedom is near 1 with exact depth and noise that is independent
    in every pixel.
    """

    def noisy(i):
        frame = view(i, ROOM, camera=BIG)
        noise = np.random.default_rng(i).normal(0, 8, frame.grey.shape)
        return replace(frame, grey=frame.grey + noise.astype(np.float32))

    method, nees = odometer(name), []
    for i in range(12):
        result = method.align(*(method.prepare(noisy(k), BIG) for k in (i, i + 1)), STEP)
        error = (STEP @ result.T_reference_camera.inverse()).log()
        nees.append(error @ result.information @ error / 6)
    assert 0.5 < np.mean(nees) < 2


@pytest.mark.parametrize("moves", [False, True])
def test_the_image_is_less_certain_only_in_directions_in_which_its_blocks_disagree(moves):
    """Independent errors; one of the blocks may see something that moves sideways (the second
    component of the twist).
    """
    rng, blocks = np.random.default_rng(3), np.repeat(np.arange(ACROSS * DOWN, dtype=np.int16), 400)
    J = rng.normal(size=(len(blocks), 6)).astype(np.float32)
    r = rng.normal(size=len(blocks)).astype(np.float32) + moves * 2 * J[:, 1] * (blocks == 5)
    points, sums = (
        rng.normal(size=(len(blocks), 3)).astype(np.float32),
        np.empty((ACROSS * DOWN, 34)),
    )
    points -= points.mean(axis=0)
    kernels.block_sums(points, J, r, J, r, 1.0, 0.0, blocks, sums)
    system = System.of_sums(sums.sum(axis=0))
    known, spread = (
        system.as_information(10.0),
        spread_information(system, sums[:, :27], 0.0, 10.0, 1e-12),
    )
    share = np.diag(spread.A) / np.diag(known.A)
    assert share[1] < 0.2 if moves else share[1] == 1
    assert (share[[0, 2, 3, 4, 5]] > 0.8).all()


def test_blocks_of_tiles_add_up_to_the_equations_of_the_motion():
    reference, current = (
        odometer("rgbd").prepare(view(i, ROOM, camera=BIG), BIG)[1] for i in range(2)
    )
    term = PhotometricTerm(reference, current, odometer("rgbd").settings, 1, tiles=Tiles())
    for firm in (False, True):
        term(STEP, 0, firm)
        system = term.tiles.eliminated(term.sums, firm)
        blocks = System.of_sums(np.pad(term.tiles.block_sums().sum(axis=0), (0, 7)))
        np.testing.assert_allclose(
            blocks.A, system.A, rtol=1e-9, atol=1e-9 * np.abs(system.A).max()
        )
        np.testing.assert_allclose(
            blocks.b, system.b, rtol=1e-9, atol=1e-9 * np.abs(system.b).max()
        )


@pytest.mark.parametrize(("outliers", "status"), [(60, Status.OK), (130, Status.DEGENERATE)])
def test_an_image_whose_greater_part_depth_contradicts_is_reported(outliers, status):
    """Of 192 equal tiles, `outliers` have a certain factor of 1.6 instead of 1."""
    term = PhotometricTerm(*(2 * [blank()]), Rgbd.PRESETS["best"], 0, tiles=Tiles())
    term.tiles.factor[:outliers], term.tiles.scale_ambiguity = 1.6, 0.0
    sums = np.zeros((192, 42))
    sums[:, [0, 6, 11, 28]], sums[:, 40] = 1.0, 1e9
    term.tiles.eliminated(sums, firm=True)
    assert term.tiles.inlier_share() == pytest.approx(1 - outliers / 192, abs=0.01)
    assert term.checked(Result(SE3.identity())).status is status
    assert term.checked(Result(SE3.identity(), Status.FAILED)).status is Status.FAILED


def blank():
    return Level(np.zeros((48, 64), np.float32), np.ones((48, 64), np.float32), CAMERA)


def beside_the_camera(i):
    """A corner with little contrast, and in the middle tenth of the view a textured object that
    keeps its distance of 1 m from the camera.
    """
    corner, (x, y, _) = view(i, ROOM, camera=BIG), np.moveaxis(BIG.rays(), -1, 0)
    near = np.maximum(abs(x) * BIG.fx / BIG.width, abs(y) * BIG.fy / BIG.height) < np.sqrt(0.1) / 2
    texture = 128 + 60 * np.sin(40 * x) * np.sin(50 * y) + 40 * np.sin(90 * x + 20 * y)
    grey, depth = (
        np.where(near, texture, 90 + 0.3 * corner.grey),
        np.where(near, 1, corner.depth_z_m),
    )
    return Frame.of(np.round(grey), np.round(depth * 5000) / 5000, i / 30)


def test_an_object_that_moves_along_does_not_outvote_the_planes_with_its_texture():
    """Most of the contrast is on the object.

    Blocks of the image disagree about the motion, and planes decide.
    """
    found = run("icp_rgbd", [beside_the_camera(i) for i in range(6)], BIG)
    assert error_m(found) < 0.002


def test_a_motion_that_depth_contradicts_is_as_uncertain_as_it_is_off():
    """A motion with a stated deviation of 0.1 mm: unchanged if it is correct; if it is 4 mm off,
    the enlarged uncertainty covers its error.
    """
    levels = [Dvo(Dvo.PRESETS["best"]).prepare(view(i, ROOM, 0.001, BIG), BIG)[1] for i in range(2)]
    for off_m in (0.0, 0.004):
        error = np.array([off_m, 0, 0, 0, 0, 0])
        depth, T = DepthTerm(*levels), SE3.exp(error) @ STEP
        depth.evaluate(T)
        result = depth.checked(Result(T, information=1e8 * np.eye(6), largest_sigma_m=1e-4))
        assert (
            result.information[0, 0] > 5e7
            if off_m == 0
            else error @ result.information @ error / 6 < 3
        )


def test_normals_and_pyramids_bear_single_missing_pixels():
    frame, missing = view(0, ROOM, camera=BIG), np.random.default_rng(8).random((240, 320)) < 0.1
    whole, holey = frame.depth_z_m, np.where(missing, np.float32(0), frame.depth_z_m)
    true = kernels.normals(whole, BIG.intrinsics, 1)
    for step in (1, 2):
        found = kernels.normals(holey, BIG.intrinsics, step)
        has = found[..., 2] != 0
        assert has.mean() > 0.8
        assert np.median(np.abs(found - true)[has].max(axis=-1)) < 1e-3
    for halve in (kernels.halve_depth, kernels.halve_depth_median):
        half, half_true = halve(holey), halve(whole)
        assert (half > 0).mean() > 0.95
        assert np.abs(half / half_true - 1)[half > 0].max() < 0.05 and (half[half > 0] > 1).all()
    assert np.median(np.abs(kernels.halve_depth(holey) / kernels.halve_depth(whole) - 1)) < 1e-6


@pytest.mark.parametrize("bare", ["light", "geometry"])
def test_the_joint_odometer_holds_on_to_the_part_that_knows(bare):
    frames = [view(i, WALL if bare == "geometry" else ROOM) for i in range(6)]
    if bare == "light":
        frames = [Frame.of(f.grey * 0 + 128, f.depth_z_m, f.stamp_s) for f in frames]
    assert error_m(run("icp_rgbd", frames)) < 0.003


def test_student_weights_withstand_something_that_moves_through_the_picture():
    frames = [view(i, ROOM) for i in range(6)]
    for i, frame in enumerate(frames):
        frame.grey[40:80, 20 + 8 * i : 60 + 8 * i] = 250.0
    settings = replace(Dvo.PRESETS["paper"], median_depth=False, limits=Limits(min_inliers=0.01))
    plain, robust = Dvo(replace(settings, nu=0.0)), Dvo(settings)
    assert error_m(run(robust, frames)) < 0.5 * error_m(run(plain, frames))


def behind_glass(i, to_m=-0.9):
    """A corner whose left part, x < -0.9 m, is glass: its depth is the corner's, its light that of
    a wall 6 m off.
    """
    frame, T = view(i, ROOM, camera=BIG), after(i)
    rays = BIG.rays() @ T.rotation.T
    x, y, z = np.moveaxis(T.translation + rays * frame.depth_z_m[..., None].astype(float), -1, 0)
    near = (
        128
        + 40 * np.sin(27 * x + 6 * z)
        + 40 * np.sin(33 * y - 9 * z)
        + 20 * np.sin(21 * z + 12 * x)
    )
    a, b, _ = np.moveaxis(
        T.translation + rays * ((6 - T.translation[2]) / rays[..., 2])[..., None], -1, 0
    )
    far = 128 + 50 * np.sin(10 * a) + 50 * np.sin(12 * b)
    return Frame.of(np.where(x < to_m, far, near), frame.depth_z_m, frame.stamp_s)


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_light_through_a_glass_does_not_pull_the_motion_along(name):
    frames, method = [behind_glass(i) for i in range(10)], odometer(name)
    rigid = type(method)(replace(method.settings, tiles=False))
    found = run(method, frames, BIG)
    assert error_m(found) < 0.25 * error_m(run(rigid, frames, BIG))
    assert 0.5 < found[-1].result.inliers < 0.85  # what lies behind the glass is given up


def test_a_glass_over_most_of_the_view_is_not_believed_because_depth_tells_which_part_it_is():
    frames = [behind_glass(i, 0.2) for i in range(0, 10, 3)]
    rigid = type(odometer("rgbd"))(replace(odometer("rgbd").settings, tiles=False))
    found = run("rgbd", frames, BIG)
    assert error_m(found, 9) < 0.1 * error_m(run(rigid, frames, BIG), 9)
    assert found[-1].result.inliers < 0.5


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_intensities_that_move_against_depth_are_reported_and_depth_wins(name):
    frames = [view(i, ROOM, camera=BIG) for i in range(3)]
    still = [Frame.of(frames[0].grey, f.depth_z_m, f.stamp_s) for f in frames]
    found = run(name, still, BIG)
    assert found[-1].result.status is Status.DEGENERATE and found[-1].result.reason.startswith(
        "depth: disagrees"
    )
    assert error_m(found) < 0.2 * np.linalg.norm(after(2).translation)


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_a_change_of_exposure_is_no_motion(name):
    frames = [view(i, ROOM, camera=BIG) for i in range(3)]
    changed = [
        Frame.of(f.grey * (1, 0.6)[i % 2] + 20 * (i % 3), f.depth_z_m, f.stamp_s)
        for i, f in enumerate(frames)
    ]
    assert error_m(run(name, changed, BIG)) < error_m(run(name, frames, BIG)) + 5e-4


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_a_guess_that_is_ten_degrees_off_is_found_to_be_wrong_by_small_images(name):
    method = odometer(name)
    reference, current = (method.prepare(view(i, ROOM, camera=BIG), BIG) for i in (0, 2))
    for axis in np.eye(3):
        found = method.align(reference, current, SE3.exp(np.r_[0, 0, 0, np.radians(10) * axis]))
        assert np.abs((after(2).inverse() @ found.T_reference_camera).log()).max() < 1e-3


@pytest.mark.parametrize("off_deg", [10, 20])
@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_a_guess_that_is_far_off_is_corrected_from_a_far_keyframe(name, off_deg):
    """The parallax between the two views is as large as the error of the guess."""
    method = odometer(name)
    reference, current = (method.prepare(view(i, ROOM, camera=BIG), BIG) for i in (0, 20))
    for axis in (*np.eye(3), *-np.eye(3)):
        found = method.align(
            reference, current, after(20) @ SE3.exp(np.r_[0, 0, 0, np.radians(off_deg) * axis])
        )
        assert np.abs((after(20).inverse() @ found.T_reference_camera).log()).max() < 2e-3


@pytest.mark.parametrize(
    ("turned", "predicted", "taken"),
    [
        (0.2, 0.95, "predicted"),
        (0.7, 0.95, "turned"),
        (None, 0.95, "turned"),
        (0.9, None, "turned"),
    ],
)
def test_the_prediction_is_aligned_too_where_another_guess_replaces_it(turned, predicted, taken):
    """Correlations at the two results; None: the alignment fails."""
    poses, fits = (
        {"turned": after(1), "predicted": after(2)},
        {"turned": turned, "predicted": predicted},
    )

    class Images:
        def fit(self, T):
            return next(fits[name] for name, pose in poses.items() if pose is T), 0.4

    def align(start):
        name = next(name for name, pose in poses.items() if pose is start.guess)
        return Result(start.guess) if fits[name] else failure("image: unrelated")

    start = Start(poses["turned"], [], Images(), predicted=poses["predicted"])
    found = start.aligned(align, lambda result: result)
    assert found.status is (Status.OK if fits[taken] else Status.FAILED)
    assert not fits[taken] or found.T_reference_camera is poses[taken]


@pytest.mark.parametrize("jump, noise", [(10, 0.0), (14, 0.001)])
@pytest.mark.parametrize("name", ["icp_rgbd", "rgbd", "dvo"])
def test_a_sudden_motion_along_a_wall_is_found_by_its_image(name, jump, noise):
    """The planes do not constrain it, and the prediction is 9 and 12 cm off."""
    numbers = (0, 1, 2, 2 + jump, 3 + jump)
    found = run(name, [view(i, WALL, noise, BIG) for i in numbers], BIG)
    assert error_m(found, numbers[-1]) < 5e-4
    assert found[3].result.status is Status.OK and found[3].result.converged


@pytest.mark.parametrize("name", ["icp_rgbd", "rgbd", "dvo"])
def test_images_that_still_do_not_fit_after_a_poor_prediction_are_reported(name):
    """Half of the view shows another texture, so that no motion aligns it."""
    method = odometer(name)
    frames = [view(i, ROOM, camera=BIG) for i in (0, 30)]
    frames[1].grey[:, 160:] = frames[1].grey[::-1, 160:]
    reference, current = (method.prepare(f, BIG) for f in frames)
    result = method.align(reference, current, after(27))
    assert result.status is Status.DEGENERATE and result.reason.startswith(
        "prediction: poor, correlation 0.5"
    )


@pytest.mark.parametrize("name", ["icp_rgbd", "dvo"])
def test_the_authors_settings_report_a_motion_if_half_of_the_image_has_changed(name):
    method = odometer(name, "paper")
    frames = [view(i, ROOM, camera=BIG) for i in (0, 1, 1)]
    frames[2].grey[:, 160:] = frames[2].grey[::-1, 160:]
    reference, same, changed = (method.prepare(f, BIG) for f in frames)
    assert method.align(reference, same, after(1)).status is Status.OK
    result = method.align(reference, changed, after(1))
    assert result.status is not Status.OK and result.reason.startswith(
        ("image: does not fit", "overlap", "step")
    )


@pytest.mark.parametrize("name", ["icp", "icp_rgbd", "rgbd", "dvo"])
def test_a_wrong_camera_is_no_crash_and_shows_in_residual_or_inliers_or_as_lost(name):
    frames = [view(i, ROOM) for i in range(4)]
    wrong = PinholeCamera(160, 120, CAMERA.fx * 1.5, CAMERA.fy * 0.7, 40.0, 20.0)
    right, bent = run(name, frames), run(name, frames, wrong)
    assert len(bent) == 4
    for a, b in zip(right[1:], bent[1:], strict=True):
        worse = (
            b.result.residual > 1.5 * a.result.residual or b.result.inliers < 0.6 * a.result.inliers
        )
        assert b.lost or worse


def test_a_kept_frame_is_left_for_one_from_half_way_when_the_camera_has_gone_away():
    reference = KeyframeReference(max_m=0.02, max_deg=90)
    kept = []
    for i in range(9):
        kept.append(reference.renew(None, i, SE3(np.eye(3), [0.006 * i, 0, 0])))
    assert [view for view, _ in kept] == [0, 0, 0, 0, 2, 2, 4, 4, 6]
    assert all(T.translation[0] == 0.006 * view for view, T in kept)


@pytest.mark.parametrize("distance", [(0.0, 10.0), (0.2, 0.0), (-1.0, 10.0), (float("nan"), 10.0)])
def test_a_keyframe_distance_that_is_not_positive_is_refused(distance):
    with pytest.raises(InputError, match="above 0 m and 0 degrees"):
        KeyframeReference(*distance)


def test_a_reported_pose_becomes_no_keyframe_while_there_is_a_good_one():
    def kept(bad):
        reference = KeyframeReference(max_m=0.02, max_deg=90)
        results = (
            Result(SE3.identity(), Status.DEGENERATE if i in bad else Status.OK) for i in range(9)
        )
        return [
            reference.renew(None, i, SE3(np.eye(3), [0.006 * i, 0, 0]), r)[0]
            for i, r in enumerate(results)
        ]

    assert kept(bad=()) == [0, 0, 0, 0, 2, 2, 4, 4, 6]
    assert kept(bad=(2,)) == [0, 0, 0, 0, 3, 3, 3, 5, 5]
    assert kept(bad=(2, 3)) == [0, 0, 0, 0, 4, 4, 4, 4, 6]  # none: the current one


def test_the_next_keyframe_is_the_most_certain_frame_per_distance():
    def kept(sigmas_m):
        reference = KeyframeReference(max_m=0.02, max_deg=90)
        results = (Result(SE3.identity(), largest_sigma_m=sigma_m) for sigma_m in sigmas_m)
        return [
            reference.renew(None, i, SE3(np.eye(3), [0.004 * i, 0, 0]), r)[0]
            for i, r in enumerate(results)
        ]

    assert kept([1e-3] * 6)[-1] == 4  # as certain as the others and the farthest
    assert kept([1e-3, 1e-3, 1e-3, 1e-3, 2e-3, 1e-3])[-1] == 3
    assert kept([1e-3, 1e-3, 1e-3, 9e-3, 2e-3, 1e-3])[-1] == 4


def test_a_single_outlier_becomes_no_keyframe():
    def kept(places_m, bad):
        reference, found = KeyframeReference(max_m=0.02, max_deg=90), []
        for i, x in enumerate(places_m):
            result = Result(SE3.identity(), Status.DEGENERATE if i in bad else Status.OK)
            found.append(reference.renew(None, i, SE3(np.eye(3), [x, 0, 0]), result)[0])
        return found

    assert kept([0, 0.006, 0.5, 0.008], bad=(2,)) == [0, 0, 0, 0]
    assert kept([0, 0.006, 0.5, 0.504], bad=(2, 3)) == [0, 0, 0, 3]  # the camera has gone there
    assert kept([0, 0.006, 0.5, 0.008], bad=()) == [0, 0, 2, 3]


def test_a_matched_keyframe_is_left_for_the_current_frame_when_a_quarter_of_its_first_matches_is_lost():
    def kept(matches, step_m=0.001):
        reference = MatchedKeyframeReference()
        results = [None, *(Result(SE3.identity(), matches=count) for count in matches)]
        return [
            reference.renew(None, i, SE3(np.eye(3), [step_m * i, 0, 0]), r)[0]
            for i, r in enumerate(results)
        ]

    assert kept([200, 400, 150, 200]) == [0, 0, 0, 0, 0]
    # the share is that of the new keyframe's own first matches
    assert kept([200, 149, 100, 76, 74]) == [0, 0, 2, 2, 2, 5]
    assert kept([200] * 5, step_m=0.06) == [0, 0, 0, 0, 2, 2]  # and by distance, as any keyframe
    assert kept([200, 200, 200, 200, 100, 76], step_m=0.06) == [0, 0, 0, 0, 2, 2, 4]


def test_a_matched_keyframe_after_lost_frames_counts_its_own_matches():
    reference = MatchedKeyframeReference()
    few, many = (Result(SE3.identity(), matches=count) for count in (100, 200))
    for i, result in enumerate((None, many)):
        reference.renew(None, i, SE3.identity(), result)
    assert reference.restart(None, 2, SE3.identity())[0] == 2
    assert [reference.renew(None, i, SE3.identity(), few)[0] for i in (3, 4)] == [2, 2]


def tracked_by(result_of, count, lost=(), against=None):
    """`count` tracked frames, of which those in `lost` have no image, if an odometer aligns frame
    `other` with frame `one` with result_of(one, other).
    """

    class Stub:
        name, reference = "stub", "frame"

        def prepare(self, frame, camera):
            return int(frame.stamp_s)

        def align(self, one, other, guess):
            return result_of(one, other)

    tracker = Tracker(Stub(), CAMERA, against=against)
    frames = [replace(view(i, ROOM), stamp_s=i) for i in range(count)]
    return [tracker.add(i, "no image" if i in lost else f) for i, f in enumerate(frames)]


def reasons_of_tracked(count, result_of, lost=()):
    return [f.result.reason for f in tracked_by(result_of, count, lost)]


def test_a_frame_that_does_not_fit_a_matched_keyframe_is_aligned_with_the_frame_before_and_reported():
    aligned = []

    def result_of(one, other):
        aligned.append((one, other))
        if other - one > farthest or other in unusable:
            return failure("test: too far")
        return Result(SE3(np.eye(3), [0.01 * (other - one), 0, 0]))

    def run_on(count, lost=(), against=MatchedKeyframeReference):
        aligned.clear()
        found = tracked_by(result_of, count, lost, against())
        places_m = [f.T_world_camera.translation[0] for f in found if not f.lost]
        assert places_m == pytest.approx([0.01 * i for i, f in enumerate(found) if not f.lost])
        return [f.result.status for f in found]

    ok, bad, lost = Status.OK, Status.DEGENERATE, Status.FAILED
    farthest, unusable = 2, ()
    assert run_on(9) == [ok] * 3 + [bad] * 5 + [
        ok
    ]  # after five such frames the last one is the keyframe
    assert aligned[:6] == [(0, 1), (0, 2), (0, 3), (2, 3), (0, 4), (3, 4)] and aligned[-1] == (7, 8)
    farthest, unusable = 9, (2,)
    assert run_on(4) == [ok, ok, lost, ok] and aligned == [(0, 1), (0, 2), (1, 2), (0, 3)]
    farthest, unusable = 1, ()
    assert run_on(4, lost=(2,)) == [ok, ok, lost, lost] and aligned == [(0, 1), (0, 3)]
    assert run_on(3, against=KeyframeReference) == [ok, ok, lost] and aligned == [(0, 1), (0, 2)]


def test_the_frame_after_an_outlier_is_reported_as_the_motion_between_them_is_wrong():
    def states(places_m, bad, lost=()):
        def result_of(one, other):
            T = SE3(np.eye(3), [places_m[other] - places_m[one], 0, 0])
            return Result(
                T,
                Status.DEGENERATE if other in bad else Status.OK,
                reason="test" if other in bad else "",
            )

        return reasons_of_tracked(len(places_m), result_of, lost)

    outlier = "track: the pose before was an outlier"
    assert states([0, 1e-3, 2e-2, 3e-3, 4e-3], bad=(2,)) == ["", "", "test", outlier, ""]
    assert states([0, 1e-3, 3e-3, 3e-3, 4e-3], bad=(2,)) == ["", "", "test", "", ""]
    assert states([0, 1e-3, 2e-2, 3e-3, 4e-3], bad=()) == [""] * 5  # not doubted
    assert states([0, 1e-3, 2e-2, 2e-2, 3e-3, 4e-3], bad=(2,), lost=(3,)) == [
        "",
        "",
        "test",
        "no image",
        outlier,
        "",
    ]
    assert states([0, 1e-3, 2e-3, 2e-3, 4e-3, 5e-3], bad=(2,), lost=(3,)) == [
        "",
        "",
        "test",
        "no image",
        "",
        "",
    ]


def test_an_outlier_after_a_new_reference_at_an_assumed_pose_is_noticed_too():
    def states(places_m):
        def result_of(one, other):
            if 2 <= other <= 6:
                return failure("test: unrelated")
            T = SE3(np.eye(3), [places_m[other] - places_m[one], 0, 0])
            return Result(
                T,
                Status.DEGENERATE if other == 7 else Status.OK,
                reason="test: uncertain" if other == 7 else "",
            )

        return reasons_of_tracked(len(places_m), result_of)[7:]

    after_six = [0.0] * 7
    outlier = "track: the pose before was an outlier"
    assert states([*after_six, 2e-2, 2e-3, 3e-3]) == ["test: uncertain", outlier, ""]
    assert states([*after_six, 1e-3, 2e-3, 3e-3]) == ["test: uncertain", "", ""]


def test_after_an_uncertain_pose_frames_are_reported_until_an_alignment_converges_or_is_certain():
    def reasons(sigmas_m, unconverged):
        def result_of(one, other):
            return Result(
                SE3.identity(), converged=other not in unconverged, largest_sigma_m=sigmas_m[other]
            )

        return reasons_of_tracked(len(sigmas_m), result_of)

    after = "track: not converged, and the pose before was uncertain"
    assert reasons([0, 1e-3, 0.03, 0.03, 1e-3, 1e-3], unconverged=(1, 3, 4, 5)) == [
        "",
        "",
        "",
        after,
        after,
        "",
    ]
    assert reasons([0, 1e-3, 0.03, 1e-3], unconverged=(1,)) == [""] * 4
    assert reasons([0, 1e-3, 0.01, 1e-3], unconverged=(1, 2, 3)) == [""] * 4


def test_an_unconverged_pose_far_from_its_prediction_is_reported():
    def reasons(places_m, angles_deg, unconverged):
        def result_of(one, other):
            axis = np.array([0, 0, np.radians(angles_deg[other] - angles_deg[one])])
            T = SE3(so3.exp(axis), [places_m[other] - places_m[one], 0, 0])
            return Result(T, converged=other not in unconverged, largest_sigma_m=1e-3)

        return reasons_of_tracked(len(places_m), result_of)

    far, still = "track: not converged, and far from the prediction", [0.0] * 4
    assert reasons([0, 0.03, 0.06, 0.09], still, unconverged=(2, 3)) == [""] * 4  # as predicted
    assert reasons([0, 0.01, 0.045, 0.08], still, unconverged=(2, 3)) == ["", "", far, ""]
    assert reasons([0, 0.01, 0.045, 0.08], still, unconverged=()) == [""] * 4
    assert reasons(still, [0, 0.2, 1.6, 3.0], unconverged=(2, 3)) == ["", "", far, ""]


def test_a_kept_frame_far_from_its_successor_is_left_for_the_last():
    reference = KeyframeReference(max_m=0.02, max_deg=90)
    for i, x in enumerate((0.0, 0.012, 0.5)):
        view, _ = reference.renew(None, i, SE3(np.eye(3), [x, 0, 0]))
    assert view == 2


def test_a_frame_is_kept_while_its_entropy_is_near_the_first_and_left_for_the_last_sure_one():
    reference, kept = EntropyReference(min_ratio=0.9), []
    for i, sigma in enumerate((1.0, 1e-3, 1.1e-3, 1.5e-3, 2.2e-3, 1e-3, 1.1e-3)):
        said = Result(
            SE3.identity(), residual=1.0, information=np.eye(6) / sigma**2, largest_sigma_m=sigma
        )
        kept.append(reference.renew(None, i, SE3.identity(), said)[0])
    # ln(2.2e-3) / ln(1e-3) is 0.886
    assert kept == [0, 0, 0, 0, 3, 3, 3]


def test_dvo_with_frames_kept_by_entropy_errs_less_than_from_frame_to_frame():
    frames, found = [view(i, ROOM, 0.002) for i in range(25)], []
    for reference in (Reference(), EntropyReference()):
        tracker = Tracker(odometer("dvo", "paper"), CAMERA, against=reference)
        found.append(error_m([tracker.add(f.stamp_s, f) for f in frames]))
    assert found[1] < found[0]


def test_errors_add_up_once_a_kept_frame():
    frames = [view(i, ROOM, 0.002) for i in range(25)]
    found = []
    for reference in (Reference(), KeyframeReference()):
        tracker = Tracker(odometer("dvo"), CAMERA, against=reference)
        found.append(error_m([tracker.add(f.stamp_s, f) for f in frames]))
    assert found[1] < found[0]


def test_a_coarse_level_without_overlap_is_left_out_and_the_finest_is_not():
    """Holes may leave a coarse level without normals; every frame was lost then."""
    term = System(np.eye(6) * 1e6, np.eye(6)[0] * 1e3, 1.0, 500, np.zeros(3), 1.0)
    empty = replace(term, count=0)

    def result(*systems):
        passes = [
            Pass(lambda T, i, s=s: replace(s, b=s.b * (i == 0)), 3, 1000, Stop()) for s in systems
        ]
        return solve(passes, SE3.identity(), Limits())

    assert result(empty, term).T_reference_camera.translation == pytest.approx([1e-3, 0, 0])
    assert result(term, empty).status is Status.FAILED


def celled(i):
    """The corner in cells of random greys, which have corners to match, a little blurred by the
    pixels' 3x3 means.
    """
    frame, T = view(i, ROOM), after(i)
    fine = PinholeCamera(
        480, 360, 3 * CAMERA.fx, 3 * CAMERA.fy, 3 * CAMERA.cx + 1, 3 * CAMERA.cy + 1
    )
    points = T.apply(fine.rays() * view(i, ROOM, camera=fine).depth_z_m[..., None].astype(float))
    x, y, z = np.moveaxis(np.floor(points / 0.2 + 0.37).astype(np.int64), -1, 0)
    cell = (x * 73856093) ^ (y * 19349663) ^ (z * 83492791)
    grey = 40 + 170 * (cell % 1000003 * 7919 % 104729) / 104729
    return Frame.of(grey.reshape(120, 3, 160, 3).mean(axis=(1, 3)), frame.depth_z_m, i / 30)


@pytest.fixture(scope="module")
def unusable():
    """What is wrong -> three frames, the first of them included."""
    frames, rng = [celled(i) for i in range(3)], np.random.default_rng(11)

    return {
        "constant depth": [Frame.of(f.grey, np.full_like(f.grey, 2), f.stamp_s) for f in frames],
        "black": [Frame.of(f.grey * 0, f.depth_z_m, f.stamp_s) for f in frames],
        "grain": [
            Frame.of(rng.integers(0, 256, f.grey.shape), f.depth_z_m, f.stamp_s) for f in frames
        ],
        "shuffled": [replace(celled(i), stamp_s=n / 30) for n, i in enumerate((60, 0, 120))],
    }


@pytest.mark.parametrize("preset", ["paper", "best"])
@pytest.mark.parametrize("name", ODOMETERS)
def test_frames_that_no_motion_can_be_told_from_are_lost_or_flagged(name, preset, unusable):
    for wrong, frames in unusable.items():
        found = list(track(odometer(name, preset), CAMERA, [(f.stamp_s, f) for f in frames]))
        unheeded = name.startswith("icp") and wrong in (
            "black",
            "grain",
        )  # geometry alone decides, and is right
        if unheeded:
            assert error_m(found) < 0.003, wrong
        else:
            assert all(f.result.status is not Status.OK for f in found[1:]), wrong


def test_depth_of_one_value_is_noticed_and_a_wall_a_little_aslant_is_none():
    two = np.full((6, 8), 2.0)
    holes, aslant = np.where(np.eye(6, 8) > 0, 0, two), two + 2e-4 * np.arange(8)
    assert [Frame.of(two, z, 0).flat() for z in (two, holes, aslant)] == [True, True, False]
    noise = np.random.default_rng(0).standard_normal((480, 640))
    assert [Frame.of(noise, 2 + deviation_m * noise, 0).flat() for deviation_m in (1e-4, 2e-4)] == [
        True,
        False,
    ]


def test_exact_depth_of_a_plane_observes_scale_across_it_and_none_along_it():
    rng = np.random.default_rng(1)
    for scale in (1e4, 1e7, 1e10):  # up to 1e14, where rounding is above 0.01
        for normal in rng.standard_normal((50, 3)):
            normal /= np.linalg.norm(normal)
            points = rng.uniform(-1, 1, (5_000, 3))
            points += (2 - points @ normal)[:, None] * normal
            rows = np.c_[np.tile(normal, (5_000, 1)), np.cross(points, normal)]
            exact = System(scale * rows.T @ rows, np.zeros(6), 0.0, 1.0, np.zeros(3), 1.0)
            along = np.cross(normal, [0.0, 0.0, 1.0])
            assert 0.99 < scale_ambiguity(exact, 0.01 * along) <= 1, scale
            assert 0 <= scale_ambiguity(exact, 0.01 * normal) < 0.1, scale


class Noting:
    """An odometer that knows the true pose of each frame by its stamp, and notes the guesses it is
    given.
    """

    name, reference = "noting", "frame"

    def __init__(self):
        self.guesses = []

    def prepare(self, frame, camera):
        return frame.stamp_s

    def align(self, reference, current, guess):
        self.guesses.append((current, guess))
        return Result(at(reference).inverse() @ at(current))


def at(stamp_s):
    return SE3.exp(30 * stamp_s * STEP.log())


def test_a_motion_is_predicted_for_the_time_since_the_last_frame():
    stamps_s = [k / 30 for k in (0, 1, 2, 5, 6, 13, 14)]
    noting = Noting()
    found = list(
        track(
            noting, CAMERA, [(t, replace(view(k, ROOM), stamp_s=t)) for k, t in enumerate(stamps_s)]
        )
    )
    for (stamp_s, guess), before in list(zip(noting.guesses, stamps_s, strict=False))[
        1:
    ]:  # the first has no motion yet
        off = guess.inverse() @ at(before).inverse() @ at(stamp_s)
        assert np.abs(off.log()).max() < 1e-9, stamp_s
    assert all(f.result.status is Status.OK for f in found)
    noting = Noting()  # after a gap of ten seconds, the motion of one
    list(
        track(
            noting,
            CAMERA,
            [(t, replace(view(k, ROOM), stamp_s=t)) for k, t in enumerate((0.0, 1 / 30, 10.0))],
        )
    )
    np.testing.assert_allclose(noting.guesses[-1][1].log(), at(1.0).log(), atol=1e-9)


@pytest.mark.parametrize("name", sorted(ODOMETERS))
def test_repeated_frames_keep_the_pose_and_are_reported_and_the_motion_goes_on_after_them(name):
    stuck = [0, 1, 2, 3, 3, 3, 3, 7, 8, 9]
    frames = [
        (k / 30, replace(view(j, ROOM, camera=BIG), stamp_s=k / 30)) for k, j in enumerate(stuck)
    ]
    found = list(track(odometer(name), BIG, frames))
    reported = [k for k, f in enumerate(found) if f.result.status is not Status.OK]
    assert reported == [4, 5, 6, 7]
    assert (
        all(f.result.reason.startswith("image: repeats") for f in found[4:7])
        and "repeated" in found[7].result.reason
    )
    np.testing.assert_allclose(
        found[6].T_world_camera.matrix, found[3].T_world_camera.matrix, atol=1e-12
    )
    steady = run(name, [view(k, ROOM, camera=BIG) for k in range(len(stuck))], BIG)
    moved = found[-1].T_world_camera.translation - steady[-1].T_world_camera.translation
    assert np.linalg.norm(moved) < 0.002
    # of fovis with its keyframe one alignment of these few corners is off by 10 mm, with and
    # without repeated frames
    against = MatchesReference() if name == "fovis" else None
    assert error_m(list(track(odometer(name), BIG, frames, against=against))) < (
        0.01 if name == "fovis" else 0.002
    )
    interrupted = list(
        track(odometer(name), BIG, [*frames[:7], (6.5 / 30, "no image"), *frames[7:]])
    )
    assert [k for k, f in enumerate(interrupted) if f.result.status is not Status.OK] == [
        4,
        5,
        6,
        7,
        8,
    ]
