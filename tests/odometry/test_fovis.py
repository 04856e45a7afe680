"""FOVIS on a corner of three planes whose cells have random greys: corners with a depth everywhere,
and a motion that we know.
"""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
cv2 = pytest.importorskip("cv2")
from iclnuim.benchmark.odometry import (  # noqa: E402
    byte_patches,
    euler_refinement,
    fast_features,
    features,
    gcc_order,
    small_rotation,
)
from iclnuim.benchmark.odometry.fovis import Fovis  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame  # noqa: E402
from iclnuim.benchmark.odometry.track import track  # noqa: E402

CAMERA = PinholeCamera.parse("320x240")
TWIST = np.array([0.006, -0.004, 0.005, 0.004, -0.003, 0.005])
PLANES = np.array([[0.8, 0.0, 0.6], [-0.8, 0.0, 0.6], [0.0, 0.8, 0.6]])
CELL_M = 0.12


def seen(T_world_camera: SE3, brighter: float = 0.0) -> Frame:
    """n . x = 2 m for each plane; the image is the mean of 2x2 rays a pixel, a little blurred as a
    lens does it.
    """
    fine = PinholeCamera(
        2 * CAMERA.width,
        2 * CAMERA.height,
        2 * CAMERA.fx,
        2 * CAMERA.fy,
        2 * CAMERA.cx + 0.5,
        2 * CAMERA.cy + 0.5,
    )
    z, points = _hits(fine, T_world_camera)
    x, y, w = np.moveaxis(np.floor(points / CELL_M + 0.37).astype(np.int64), -1, 0)
    cell = (x * 73856093) ^ (y * 19349663) ^ (w * 83492791)
    grey = (40 + 170 * (cell % 1000003 * 7919 % 104729) / 104729).astype(np.float32)
    small = cv2.resize(
        cv2.GaussianBlur(grey, (0, 0), 1.2),
        (CAMERA.width, CAMERA.height),
        interpolation=cv2.INTER_AREA,
    )
    return Frame.of(small + brighter, _hits(CAMERA, T_world_camera)[0], 0.0)


def _hits(camera: PinholeCamera, T_world_camera: SE3) -> tuple[np.ndarray, np.ndarray]:
    rays, origin = camera.rays() @ T_world_camera.rotation.T, T_world_camera.translation
    z = np.full(rays.shape[:2], np.inf)
    for n in PLANES:
        slope = rays @ n
        z = np.minimum(
            z, np.where(slope > 1e-6, (2 - n @ origin) / np.maximum(slope, 1e-6), np.inf)
        )
    return z, origin + rays * z[..., None]


def path(count: int) -> list[SE3]:
    return [SE3.exp(i * TWIST) for i in range(count)]


def error_m(found, truth: SE3) -> float:
    return float(np.linalg.norm(found.T_world_camera.translation - truth.translation))


def tracked(preset: str, frames: list[Frame], policy: str = "hold"):
    return list(track(Fovis(Fovis.PRESETS[preset]), CAMERA, enumerate(frames), policy))


@pytest.mark.parametrize("preset", Fovis.PRESETS)
def test_a_known_motion_is_found_from_one_kept_frame(preset):
    poses = path(5)
    found = tracked(preset, [seen(T) for T in poses])
    assert [f.lost for f in found] == [False] * 5 and all(f.result.matches > 250 for f in found[1:])
    assert error_m(found[-1], poses[-1]) < 0.05 * np.linalg.norm(poses[-1].translation)


def test_what_is_seen_through_glass_does_not_count_as_lying_on_it():
    """A pane 0.9 m away before half of the view, which depth sees and colour does not."""
    poses, frames = path(4), []
    for T in poses:
        rays, frame = CAMERA.rays() @ T.rotation.T, seen(T)
        pane = (0.9 - T.translation[2]) / rays[..., 2]
        on = T.translation[0] + pane * rays[..., 0] < 0
        frames.append(Frame.of(frame.grey, np.where(on, pane, frame.depth_z_m), 0.0))
    settings, moved = Fovis.PRESETS["best"], np.linalg.norm(poses[-1].translation)
    without, found = (
        list(track(Fovis(s), CAMERA, enumerate(frames)))
        for s in (replace(settings, depth=False), settings)
    )
    assert error_m(found[-1], poses[-1]) < 0.1 * moved < 0.2 * error_m(without[-1], poses[-1])


def test_the_frames_around_one_without_depth_are_tracked():
    poses = path(4)
    frames = [seen(T) for T in poses]
    frames[2] = Frame.of(frames[2].grey, frames[2].depth_z_m * 0, 0.0)
    found = tracked("best", frames)
    assert [f.lost for f in found] == [False, False, True, False]
    assert error_m(found[3], poses[3]) < 0.05 * np.linalg.norm(poses[3].translation)


def test_a_turn_beyond_the_search_is_found_by_the_small_images_first():
    turn = SE3.exp(
        np.r_[0, 0, 0, 0, 0.12, 0]
    )  # 29 pixels; without the first rotation nothing is found in 10
    settings = replace(Fovis.PRESETS["best"], searches_px=(10.0,))
    odometer = Fovis(settings)
    one, other = (odometer.prepare(seen(T), CAMERA) for T in (SE3.identity(), turn))
    result = odometer.align(one, other, SE3.identity())
    assert np.abs(result.T_reference_camera.rotation - turn.rotation).max() < 1e-3


def test_a_brighter_image_is_matched_alike():
    odometer = Fovis(Fovis.PRESETS["paper"])
    one, plain, brighter = (
        odometer.prepare(f, CAMERA)
        for f in (seen(SE3.identity()), seen(path(2)[1]), seen(path(2)[1], 20))
    )
    found = [odometer.align(one, other, SE3.identity()) for other in (plain, brighter)]
    assert found[1].matches > 0.9 * found[0].matches
    assert (
        np.abs(
            found[1].T_reference_camera.translation - found[0].T_reference_camera.translation
        ).max()
        < 5e-4
    )


@pytest.mark.parametrize("preset", Fovis.PRESETS)
@pytest.mark.parametrize("kind", ["grain", "grain with depth of grain", "black", "constant depth"])
def test_frames_without_a_motion_are_lost(preset, kind):
    rng = np.random.default_rng(5)
    h, w = CAMERA.height, CAMERA.width
    frames = []
    for T in path(6):
        frame = seen(T)
        grain = rng.integers(0, 256, (h, w)).astype(np.float32)
        depth = (
            rng.uniform(1, 4, (h, w))
            if "depth of" in kind
            else frame.depth_z_m
            if kind == "black"
            else np.full((h, w), 2.0)
        )
        image = (
            grain
            if "grain" in kind
            else np.zeros((h, w))
            if kind == "black"
            else rng.permuted(frame.grey, axis=1)
        )
        frames.append(Frame.of(image, depth, 0.0))
    found = tracked(preset, frames)[1:]
    assert all(f.lost and f.result.reason and not f.result.matches for f in found)


@pytest.mark.parametrize("preset", Fovis.PRESETS)
def test_views_of_elsewhere_are_lost(preset):
    rng = np.random.default_rng(3)
    frames = [
        seen(
            SE3.exp(
                np.r_[rng.uniform(-0.3, 0.3, 3), rng.choice([-1, 1], 3) * rng.uniform(0.2, 0.5, 3)]
            )
        )
        for _ in range(6)
    ]
    assert all(f.lost for f in tracked(preset, frames)[1:])


def test_a_refined_place_is_where_the_corner_went():
    shift = np.array([0.37, -0.61])
    image = seen(SE3.identity()).grey.astype(np.uint8)
    moved = cv2.warpAffine(
        image, np.c_[np.eye(2), shift], (CAMERA.width, CAMERA.height), flags=cv2.INTER_LANCZOS4
    )
    uv, _ = features.eigenvalue_corners(image)
    uv = uv[((uv > 20) & (uv < (CAMERA.width - 20, CAMERA.height - 20))).all(axis=1)]
    places = uv.astype(float)
    lost = np.zeros(len(uv), bool)
    features.refine(image, moved, uv.astype(float), places, np.arange(len(uv)), 1.0, 0.01, lost)
    assert not lost.any() and np.median(np.abs(places - uv - shift)) < 0.02


def test_the_clique_leaves_out_what_moved_by_itself():
    rng = np.random.default_rng(1)
    points = rng.uniform(-1, 1, (40, 3)) + (0, 0, 3)
    after = SE3.exp(TWIST * 5).apply(points)
    after[30:] += rng.uniform(0.3, 0.6, (10, 3))
    assert features.consistent(points, after, 0.1).tolist() == [True] * 30 + [False] * 10


def test_partners_are_each_others_best_within_reach():
    looks = np.array([[0] * 4, [100] * 4, [200] * 4], np.uint8)
    level, uv = np.zeros(3, np.int64), np.array([[10.0, 10], [20, 10], [30, 10]])
    reach = features.mutual_best(looks, looks[::-1].copy(), level, level, uv, uv, 15.0)
    assert reach.tolist() == [-1, 1, -1]  # the likenesses of 0 and 2 are 20 pixels away
    assert features.mutual_best(looks, looks[::-1].copy(), level, level, uv, uv, 25.0).tolist() == [
        2,
        1,
        0,
    ]


def test_corners_are_spread_over_the_image_and_have_depth():
    frame = seen(SE3.identity())
    depth = frame.depth_z_m.copy()
    depth[:, :100] = 0
    frame = Frame.of(frame.grey, depth, 0.0)
    for found in (
        features.features(frame, CAMERA, 3, 400),
        fast_features.fast_features(frame, CAMERA, 3, 20),
    ):
        assert found.uv[:, 0].min() >= 100 and len(found.uv) < 400
        bucket = found.uv[found.level == 0] // features.BUCKET_PX
        assert np.unique(bucket, axis=0, return_counts=True)[1].max() <= features.PER_BUCKET
        assert np.allclose(CAMERA.project(found.points_m), found.uv)


def test_the_threshold_of_fast_follows_the_number_of_corners():
    odometer, frame = Fovis(Fovis.PRESETS["paper"]), seen(SE3.identity())
    blank = fast_features.fast_features(replace(frame, grey=0 * frame.grey), CAMERA, 3, 20)
    assert (
        not len(blank.uv) and blank.next_threshold == 19
    )  # 320 * 240 / 250 = 307 corners too few, times 0.005
    found = fast_features.fast_features(frame, CAMERA, 3, 5)
    assert found.next_threshold > 5
    for _ in range(30):
        before, found = found, odometer.prepare_after(found, frame, CAMERA)
    assert found.next_threshold == before.next_threshold
    assert np.array_equal(found.uv, before.uv)


def test_small_levels_are_binomial_means_rounded_down():
    image = np.random.default_rng(7).integers(0, 256, (64, 96)).astype(np.uint8)
    difference = fast_features.halved(image).astype(int) - cv2.pyrDown(image)
    assert difference.shape == (32, 48)
    assert set(np.unique(difference[1:, 1:])) <= {-2, -1, 0}  # cv2 rounds to the nearest


@pytest.mark.parametrize("turn", [np.r_[0.02, 0, 0], np.r_[0, -0.02, 0]])
def test_the_first_rotation_is_seen_in_small_images(turn):
    odometer = Fovis(Fovis.PRESETS["paper"])
    T = SE3.exp(np.r_[0, 0, 0, turn])
    one, other = (odometer.prepare(seen(pose), CAMERA) for pose in (SE3.identity(), T))
    found = odometer.initial_motion(one, other)
    assert np.abs(found.rotation - T.rotation).max() < 0.4 * 0.02 and not found.translation.any()


def test_a_planar_motion_is_found_to_a_tenth_of_a_pixel():
    small = cv2.GaussianBlur(
        np.random.default_rng(2).uniform(0, 255, (30, 40)).astype(np.float32), (0, 0), 2
    )
    angle, shift = 0.03, np.array([0.8, -0.5])
    warp = np.c_[[[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]], shift]
    template = cv2.warpAffine(
        small, warp, (40, 30), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderValue=128
    )
    found = small_rotation.planar_motion(template, small)
    assert (
        np.abs(found[:, :2] - warp[:, :2]).max() < 0.005 and np.abs(found[:, 2] - shift).max() < 0.1
    )


def test_positions_in_bytes_are_where_the_corners_went():
    shift = np.array([0.37, -0.61])
    image = seen(SE3.identity()).grey.astype(np.uint8)
    moved = cv2.warpAffine(
        image, np.c_[np.eye(2), shift], (CAMERA.width, CAMERA.height), flags=cv2.INTER_LANCZOS4
    )
    uv = fast_features.fast_corners(image, 20)[0].astype(float)
    uv = uv[((uv > 20) & (uv < (CAMERA.width - 20, CAMERA.height - 20))).all(axis=1)]
    places = uv.copy()
    byte_patches.refine_in_bytes(image, moved, uv, places, np.arange(len(uv)), 1.0)
    assert np.median(np.linalg.norm(places - uv - shift, axis=1)) < 0.2


def test_a_corner_beside_missing_depth_agrees_with_none():
    poses, odometer = path(2), Fovis(Fovis.PRESETS["paper"])
    one, other = (odometer.prepare(seen(T), CAMERA) for T in poses)
    expected_uv = CAMERA.project(poses[1].inverse().apply(one.points_m))
    whole = byte_patches.match_in_bytes(one, other, expected_uv, 25.0)
    moved = np.flatnonzero((whole.uv1 != np.rint(whole.uv1)).all(axis=1))[:5]
    depth = other.depth_z_m.copy()
    depth[tuple(np.ceil(whole.uv1[moved]).astype(int).T[::-1])] = 0
    found = byte_patches.match_in_bytes(one, replace(other, depth_z_m=depth), expected_uv, 25.0)
    assert len(found) == len(whole) and np.isnan(found.points1_m[moved]).all()
    assert not features.consistent(found.points0_m, found.points1_m, 0.1)[moved].any()


def test_equal_values_are_in_the_order_of_gcc():
    """The literals are what std::sort and std::nth_element of libstdc++ 12 make of these values."""
    values = np.array([int(c) for c in "3133403201424301210441012413242322404141"])
    first = [20, 12, 34, 10, 36, 19, 38, 25, 29, 4]
    order = [25, 29, 4, 38, 20, 19, 36, 10, 34, 12, 13, 27, 31, 6, 3, 2, 0, 11, 33, 16]
    order += [32, 7, 30, 28, 24, 39, 37, 26, 23, 21, 17, 15, 9, 1, 22, 18, 14, 35, 8, 5]
    assert gcc_order.descending(values).tolist() == order
    assert gcc_order.largest_first(values, 10)[:10].tolist() == first


@pytest.mark.parametrize("count", [0, 1, 2, 3, 17, 100, 501])
def test_orders_are_complete_and_descending(count):
    values = np.random.default_rng(count).integers(0, 30, count)
    order = gcc_order.descending(values)
    assert sorted(order) == list(range(count)) and (np.diff(values[order]) <= 0).all()
    some = gcc_order.largest_first(values, 25)
    assert sorted(some) == list(range(count))
    assert sorted(values[some[:25]]) == sorted(values)[-25:]


def test_the_rotation_of_euler_angles_is_scipys():
    angles = np.array([0.3, -0.2, 0.5])
    R = euler_refinement.rotations(angles)
    assert np.allclose(R[0], Rotation.from_euler("xyz", angles).as_matrix())
    T = np.eye(4)
    T[:3, :3] = R[0]
    assert np.allclose(euler_refinement.euler_angles(T), angles)
    for a in range(3):
        step = 1e-6 * np.eye(3)[a]
        slope = (
            euler_refinement.rotations(angles + step)[0]
            - euler_refinement.rotations(angles - step)[0]
        ) / 2e-6
        assert np.allclose(R[a + 1], slope, atol=1e-8)


def test_the_refined_motion_has_the_least_error():
    """Against SciPy's least squares, from matches with an error of a quarter of a pixel."""
    rng, camera, truth = np.random.default_rng(4), replace(CAMERA, fy=CAMERA.fx), SE3.exp(3 * TWIST)
    points1 = rng.uniform((-1, -1, 2), (1, 1, 4), (200, 3))
    points0 = truth.apply(points1)
    uv0, uv1 = (camera.project(p) + rng.normal(0, 0.25, (200, 2)) for p in (points0, points1))
    points0, points1 = (p * rng.normal(1, 0.001, (200, 1)) for p in (points0, points1))
    matches = (camera.intrinsics, points0, uv0, points1, uv1)
    found = euler_refinement.refine_motion(np.eye(4), *matches, 6)

    def residuals(twist: np.ndarray) -> np.ndarray:
        T = SE3.exp(twist)
        return np.r_[
            camera.project(T.apply(points1)) - uv0, camera.project(T.inverse().apply(points0)) - uv1
        ].ravel()

    best = SE3.exp(least_squares(residuals, np.zeros(6)).x)
    assert (
        np.abs(found - best.matrix).max() < 1e-4 and np.abs(best.matrix - truth.matrix).max() < 2e-3
    )
    assert np.isclose(
        euler_refinement.squared_error(best.matrix, *matches), (residuals(best.log()) ** 2).sum()
    )


def test_a_sequential_odometer_is_given_the_frame_before():
    """The tracker does not predict the motion, and FAST's threshold is carried on."""
    odometer, calls = Fovis(Fovis.PRESETS["paper"]), []
    initial_motion = odometer.initial_motion
    odometer.initial_motion = lambda *pair: calls.append(pair) or initial_motion(*pair)  # type: ignore[method-assign]
    found = list(track(odometer, CAMERA, enumerate([seen(T) for T in path(4)])))
    assert not any(f.lost for f in found) and len(calls) == 3
    assert all(one[1] is other[0] for one, other in zip(calls, calls[1:], strict=False))
    thresholds = [calls[0][0].next_threshold] + [current.next_threshold for _, current in calls]
    assert len(set(thresholds)) > 1
