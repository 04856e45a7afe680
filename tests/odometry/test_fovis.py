"""FOVIS on a corner of three planes whose cells have random greys: corners with a depth everywhere,
and a motion that we know.
"""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
cv2 = pytest.importorskip("cv2")
from iclnuim.benchmark.odometry import features, fovis  # noqa: E402
from iclnuim.benchmark.odometry.fovis import (  # noqa: E402
    Fovis,
    Preliminary,
    _MatchSearch,
    estimate_rotation,
)
from iclnuim.benchmark.odometry.normal_equations import NormalEquations  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame  # noqa: E402
from iclnuim.benchmark.odometry.terms.reprojection import Matches  # noqa: E402
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


def behind_a_pane(poses: list[SE3]) -> list[Frame]:
    """A pane 0.9 m away before half of the view, which depth sees and colour does not."""
    frames = []
    for T in poses:
        rays, frame = CAMERA.rays() @ T.rotation.T, seen(T)
        pane = (0.9 - T.translation[2]) / rays[..., 2]
        on = T.translation[0] + pane * rays[..., 0] < 0
        frames.append(Frame.of(frame.grey, np.where(on, pane, frame.depth_z_m), 0.0))
    return frames


def test_what_is_seen_through_glass_does_not_count_as_lying_on_it():
    poses = path(4)
    frames = behind_a_pane(poses)
    settings, moved = Fovis.PRESETS["best"], np.linalg.norm(poses[-1].translation)
    without, found = (
        list(track(Fovis(s), CAMERA, enumerate(frames)))
        for s in (replace(settings, depth=False), settings)
    )
    assert error_m(found[-1], poses[-1]) < 0.1 * moved < 0.2 * error_m(without[-1], poses[-1])


def test_behind_glass_most_corners_agree_with_the_motion_and_it_is_right_to_millimetres():
    """9 mm a frame; the parallax of the pane is smallest in the first one."""
    poses = path(3)
    found = tracked("best", behind_a_pane(poses))
    assert error_m(found[1], poses[1]) < 0.004
    assert error_m(found[2], poses[2]) < 0.001
    assert found[1].result.inliers > 0.75 and found[2].result.inliers > 0.75


def test_the_frames_around_one_without_depth_are_tracked():
    poses = path(4)
    frames = [seen(T) for T in poses]
    frames[2] = Frame.of(frames[2].grey, frames[2].depth_z_m * 0, 0.0)
    found = tracked("best", frames)
    assert [f.lost for f in found] == [False, False, True, False]
    assert error_m(found[3], poses[3]) < 0.05 * np.linalg.norm(poses[3].translation)


def test_a_turn_beyond_the_search_is_found_by_the_small_images_first():
    # 29 pixels; without the first rotation nothing is found in 10
    turn = SE3.exp(np.r_[0, 0, 0, 0, 0.12, 0])
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
    at = np.arange(len(uv))
    features.refine((image, moved), uv.astype(float), places, at, (1.0, 0.01), lost)
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
    one, other = (looks, level, uv), (looks[::-1].copy(), level, uv)
    reach = features.mutual_best(one, other, 15.0)
    assert reach.tolist() == [-1, 1, -1]  # the likenesses of 0 and 2 are 20 pixels away
    assert features.mutual_best(one, other, 25.0).tolist() == [
        2,
        1,
        0,
    ]


def test_corners_are_spread_over_the_image_and_have_depth():
    frame = seen(SE3.identity())
    depth = frame.depth_z_m.copy()
    depth[:, :100] = 0
    frame = Frame.of(frame.grey, depth, 0.0)
    found = features.features(frame, CAMERA, 3, 400)
    assert found.uv[:, 0].min() >= 100 and len(found.uv) < 400
    bucket = found.uv[found.level == 0] // features.BUCKET_PX
    assert np.unique(bucket, axis=0, return_counts=True)[1].max() <= features.PER_BUCKET
    assert np.allclose(CAMERA.project(found.points_m), found.uv)


def test_the_scores_of_corners_are_opencvs():
    image = np.random.default_rng(0).integers(0, 255, (60, 80)).astype(np.uint8)
    found = features.smaller_eigenvalues(image)[8:-8, 8:-8]
    np.testing.assert_allclose(found, cv2.cornerMinEigenVal(image, 7)[8:-8, 8:-8], rtol=1e-4)


@pytest.mark.parametrize(("levels", "corners"), [(4, 0), (5, 1)])
def test_a_corner_has_a_contrast_of_a_few_grey_levels(levels, corners):
    """Less is noise of a camera."""
    image = np.full((120, 160), 100, np.uint8)
    image[60:, 80:] += levels
    assert len(features.eigenvalue_corners(image)[0]) == corners


def test_a_description_keeps_the_whole_contrast_of_its_patch():
    """Greys of 30 and 225 about the middle of a byte: neither is clipped."""
    image = np.full((40, 40), 30, np.uint8)
    image[:, 20:] = 225
    found = features.describe(image, np.array([[20, 20]]))[0].astype(int)
    assert np.ptp(found) == 195
    assert abs(found.mean() - 128) < 1


def test_the_small_images_find_a_turn_of_seven_degrees_to_less_than_the_search():
    """24 pixels. Coarser ones leave a third of them, and on finer ones the turn is too far."""
    odometer = Fovis(Fovis.PRESETS["best"])
    turn = SE3.exp(np.array([0, 0, 0, 0, np.radians(7), 0]))
    one, other = (odometer.prepare(seen(T), CAMERA) for T in (SE3.identity(), turn))
    found = estimate_rotation(one, other, SE3.identity())
    assert so3.angle(found.rotation.T @ turn.rotation) * CAMERA.fx < 6


def test_the_narrow_search_bears_the_error_of_a_prediction_and_takes_no_other_corner():
    """A prediction that is 2.4 pixels off, and one that is 7.2 pixels off: on a texture that
    repeats itself, that is another place.
    """
    odometer = Fovis(Fovis.PRESETS["best"])
    T = path(2)[1]
    one, other = (odometer.prepare(seen(pose), CAMERA) for pose in (SE3.identity(), T))
    search = _MatchSearch(one, other, odometer.settings)
    near_px = odometer.settings.searches_px[-1]
    found = [
        search.around(T @ SE3.exp(np.array([0, 0, 0, 0, off_rad, 0])), near_px)
        for off_rad in (0.01, 0.03)
    ]
    assert len(found[0].inliers) > 300 and found[1].reason


def searches_of(monkeypatch, shares):
    """The radii of the searches of an alignment, if those around the guess find these shares of
    their matches to agree (narrow, wide); and whether a rotation was estimated.
    """
    searched = []
    turned = []

    def around(self, start, search_px):
        searched.append(search_px)
        share = shares[search_px > 10]
        return Preliminary(start, [None] * 20, share, search_px, "not refined")

    monkeypatch.setattr(_MatchSearch, "around", around)
    monkeypatch.setattr(
        fovis, "estimate_rotation", lambda one, other, guess: turned.append(guess) or guess
    )
    odometer = Fovis(Fovis.PRESETS["best"])
    frame = odometer.prepare(seen(SE3.identity()), CAMERA)
    odometer.align(frame, frame, SE3.identity())
    return searched, bool(turned)


@pytest.mark.parametrize(("share", "wide"), [(0.25, True), (0.49, False)])
def test_the_wide_search_is_for_frames_of_whose_matches_most_disagree(monkeypatch, share, wide):
    """Noisy frames near their prediction have 0.42 and more."""
    searched, turned = searches_of(monkeypatch, (share, 0.9))
    assert (len(searched) > 1) is wide and not turned


@pytest.mark.parametrize(("share", "rotates"), [(0.17, True), (0.35, False)])
def test_a_rotation_is_estimated_where_hardly_any_match_agrees(monkeypatch, share, rotates):
    """Unrelated images have up to 0.07, furnished rooms 0.4 and more."""
    assert searches_of(monkeypatch, (0.0, share))[1] is rotates


@pytest.mark.parametrize(("share", "related"), [(0.07, False), (0.14, True)])
def test_frames_of_whose_matches_a_fourteenth_agrees_are_of_two_places(monkeypatch, share, related):
    """Chance alone makes up to 0.07 agree; 400 matches, of which a share moves alike."""
    rng = np.random.default_rng(0)
    count = 400
    uv, z_m = rng.uniform((20, 20), (300, 220), (count, 2)), rng.uniform(1, 3, count)
    points_m = features.points(CAMERA, uv, z_m)
    moved_m = points_m.copy()
    moved_m[int(share * count) :] += rng.uniform(0.5, 5, (count - int(share * count), 3))
    found = Matches(
        uv, points_m, CAMERA.project(moved_m), moved_m, np.zeros(count, int), np.ones(count)
    )
    monkeypatch.setattr(fovis, "match", lambda *images: found)
    odometer = Fovis(replace(Fovis.PRESETS["best"], depth=False))
    frame = odometer.prepare(seen(SE3.identity()), CAMERA)
    result = _MatchSearch(frame, frame, odometer.settings).around(SE3.identity(), 4.0)
    assert (not result.reason) is related


@pytest.mark.parametrize(("step_mm", "again"), [(0.7, False), (1.4, True)])
def test_the_geometric_term_is_evaluated_again_while_a_motion_moves_by_a_millimetre(step_mm, again):
    """And a few times at most: each costs as much as all iterations of the corners."""
    evaluated = []

    class Geometry:
        def linearise(self, T):
            evaluated.append(T)
            return NormalEquations.of_information(np.eye(6))

    class Corners:
        def solved(self, T, A, b, iterations, min_step):
            step = np.array([step_mm / 1e3, 0, 0, 0, 0, 0])
            return SE3.exp(step) @ T, step

    odometer = Fovis(Fovis.PRESETS["best"])
    frame = odometer.prepare(seen(SE3.identity()), CAMERA)
    search = _MatchSearch(frame, frame, odometer.settings)
    search._estimate(Corners(), SE3.identity(), 1e-5, Geometry())
    assert len(evaluated) in (range(3, 5) if again else range(1, 2))
