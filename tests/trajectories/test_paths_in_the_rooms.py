"""The paths in their rooms: clear of every surface; kt0's wall leaves ICP free, furnished views do
not.
"""

import json

import numpy as np
import pytest
from iclnuim.geometry import axes
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

CLEARANCE_M = 0.25
CAMERA = PinholeCamera.parse("80x60")
#: Frames of kt0 that see nothing but the bare wall and the thin plant (living room) or the coat
#: stand (office).
STRETCH = {"living_room": slice(505, 901), "office": slice(860, 975)}
DEPTH_RANGE_M = 13.107


def smallest_eigenvalue(points, normals):
    """lambda_min / N of the translation block of the point-to-plane matrix, points centred, of RMS
    distance 1.

    Rows (n, (p - c) x n / s); the rotations are eliminated by the Schur complement.
    """
    centred = points - points.mean(axis=0)
    scale = np.sqrt((centred**2).sum(axis=1).mean())
    rows = np.concatenate([normals, np.cross(centred, normals) / scale], axis=1)
    H = rows.T @ rows
    schur = H[:3, :3] - H[:3, 3:] @ np.linalg.pinv(H[3:, 3:], rcond=1e-9) @ H[3:, :3]
    return np.linalg.eigvalsh(schur)[0] / len(points)


def view(room, path, frame):
    """Smallest eigenvalue of a frame's clean depth, and the share of its pixels by object name."""
    depth_z_m, normals, points, owner = room.cast(path.T_world_camera[frame], CAMERA)
    seen = (depth_z_m > 0) & (depth_z_m < DEPTH_RANGE_M)
    shares = {room.names[k]: (owner == k).mean() for k in np.unique(owner[owner >= 0])}
    return smallest_eigenvalue(points[seen], normals[seen]), shares


def patch(rng, normal, count=500):
    """Random points of a square metre, 2 m along its normal; points and normals (n, 3)."""
    normal = np.asarray(normal, float)
    points = rng.uniform(-0.5, 0.5, (count, 3))
    return points - (points @ normal)[:, None] * normal + 2 * normal, np.tile(normal, (count, 1))


def test_the_eigenvalue_is_0_on_one_or_two_planes_and_a_third_in_a_closed_cube():
    rng = np.random.default_rng(1)
    planes = [patch(rng, n) for n in (*np.eye(3), *-np.eye(3))]
    joined = [
        [np.concatenate(part) for part in zip(*planes[:k], strict=True)] for k in (1, 2, 3, 6)
    ]
    values = [smallest_eigenvalue(points, normals) for points, normals in joined]
    assert values[:2] == pytest.approx([0, 0], abs=1e-12)
    assert values[2] > 0.02
    assert values[3] == pytest.approx(1 / 3, abs=0.01)


@pytest.mark.parametrize("kt", ["kt0", "kt1", "kt2", "kt3", "window"])
def test_no_pose_of_the_living_room_is_within_25_cm_of_a_surface(living_room, path_of, kt):
    positions_m = path_of(f"living_room/{kt}").positions_m
    distance_m, nearest = living_room.clearance_m(positions_m)
    worst = distance_m.argmin()
    assert distance_m[worst] > CLEARANCE_M, (
        f"frame {worst} at {positions_m[worst]} near {nearest[worst]}"
    )
    low, high = np.array([-2.425, -3.09, 0.133]), np.array([2.511, 1.929, 2.633])
    assert ((positions_m > low + CLEARANCE_M) & (positions_m < high - CLEARANCE_M)).all()


def test_the_clearance_test_can_fail(living_room):
    distance_m, nearest = living_room.clearance_m(np.array([[-2.40, -0.4, 1.4], [0.0, 0.0, 0.5]]))
    assert distance_m[0] == pytest.approx(0.025, abs=0.01)
    assert nearest[0] == "wall_left"
    assert distance_m[1] < CLEARANCE_M


def test_kt0_rests_where_icp_is_free_before_the_bare_wall(living_room, path_of):
    path = path_of("living_room/kt0")
    frames = range(len(path))[STRETCH["living_room"]][::33]
    views = [view(living_room, path, frame) for frame in frames]
    assert max(value for value, _ in views) < 0.02
    assert min(shares["wall_left"] for _, shares in views) > 0.85
    plant = [shares.get("plant", 0) + shares.get("plant_pot", 0) for _, shares in views]
    assert min(plant) > 0.005, (
        "where the wall alone was seen, systems of feature points lost their way"
    )


def test_kt0_moves_along_the_wall_while_icp_is_free(path_of):
    positions_m = path_of("living_room/kt0").positions_m[STRETCH["living_room"]]
    assert np.ptp(positions_m[:, 1]) > 0.25
    assert len(positions_m) >= 300


def test_kt0_of_the_office_rests_before_a_bare_wall_for_3_to_10_percent_of_its_frames(
    office_room, path_of
):
    """Along a bare wall alone, errors of ICP would be those of one wall, not of the method. (Up to
    frame 1200; then it rises to the ceiling.)
    """
    path = path_of("office/kt0")
    rest, every = range(len(path))[STRETCH["office"]], 15
    before = [view(office_room, path, frame)[0] for frame in range(0, rest.start - 15, every)]
    after = [view(office_room, path, frame)[0] for frame in range(rest.stop + 25, 1200, every)]
    assert max(view(office_room, path, frame)[0] for frame in rest[::every]) < 0.01
    assert min(before + after) > 0.05
    assert 0.03 < len(rest) / len(path) < 0.10


def test_furnished_views_hold_icp(living_room, path_of):
    values = []
    for kt in ("kt0", "kt1", "kt2", "kt3"):
        path = path_of(f"living_room/{kt}")
        wall = range(len(path))[STRETCH["living_room"]] if kt == "kt0" else []
        values += [
            view(living_room, path, i)[0] for i in range(20, len(path), 150) if i not in wall
        ]
    assert np.median(values) > 0.1
    assert np.mean(np.array(values) > 0.05) > 0.8


@pytest.mark.parametrize(("kt", "low", "high"), [("kt2", 0.05, 0.2), ("window", 0.25, 0.45)])
def test_the_window_takes_no_more_of_kt2_than_of_the_originals(living_room, path_of, kt, low, high):
    """Of the original's kt2 the pane takes up to 25 %, and 3.4 % in the mean; `window` is the hard
    case.
    """
    path, pane, small = (
        path_of(f"living_room/{kt}"),
        living_room.names.index("window_pane"),
        PinholeCamera.parse("40x30"),
    )
    frames = range(0, len(path), 20)
    shares = [(living_room.cast(path.T_world_camera[k], small)[3] == pane).mean() for k in frames]
    assert low < max(shares) < high
    if kt == "kt2":
        assert np.mean(shares) < 0.034


@pytest.fixture(scope="module")
def office(repository):
    return json.loads((repository / "trajectories/office/layout.json").read_text())


def distance_to_box_m(positions_m, box):
    outside = np.maximum(np.maximum(box["min_m"] - positions_m, positions_m - box["max_m"]), 0)
    return np.linalg.norm(outside, axis=1)


@pytest.mark.parametrize("kt", ["kt0", "kt1", "kt2", "kt3"])
def test_the_office_paths_keep_40_cm_from_what_the_layout_lists_and_stay_in_its_free_space(
    office, path_of, kt
):
    positions_m = path_of(f"office/{kt}").positions_m
    for box in office["boxes"]:
        assert distance_to_box_m(positions_m, box).min() > 0.40, box["name"]
    walls = np.concatenate(
        [positions_m - office["room_min_m"], office["room_max_m"] - positions_m], axis=1
    )
    assert walls[:, :5].min() > 0.40
    assert walls[:, 5].min() > (0.10 if kt == "kt0" else 0.40), "the ceiling"
    assert (
        np.min([distance_to_box_m(positions_m, box) for box in office["keep_free"]], axis=0) == 0
    ).all()


def test_kt0_of_the_office_passes_for_seconds_close_under_the_ceiling_and_looks_along_it(
    office, path_of
):
    """As the original, 12 cm under its ceiling; panels and bars fill half of the picture."""
    path = path_of("office/kt0")
    below_m = office["room_max_m"][2] - path.positions_m[:, 2]
    close = np.flatnonzero(below_m < 0.18)
    assert len(close) > 120 and np.ptp(close) < 200
    pitch_deg = np.degrees(np.arcsin(path.T_world_camera.rotation[close, 2, 2]))
    assert np.median(pitch_deg) > 4


def test_kt0_of_the_office_rises_and_moves_backwards_along_a_mirroring_bar(path_of):
    """DVO follows the mirrored desks there; on two other paths under the ceiling it did not
    (docs/measured/systems.md).
    """
    path = path_of("office/kt0")
    position_m, forward = path.positions_m[1300:1361], path.T_world_camera.rotation[1300:1361, :, 2]
    beside_the_bar_m = -0.5 - position_m[:, 0]
    assert ((beside_the_bar_m > 0.08) & (beside_the_bar_m < 0.20)).all()
    assert position_m[-1, 1] - position_m[0, 1] > 0.10
    assert position_m[-1, 2] - position_m[0, 2] > 0.04
    assert (forward[:, 1] < -0.7).all()  # looks towards -y, moves towards +y


def test_the_offices_free_space_lies_25_cm_from_its_furniture(office):
    for free in office["keep_free"]:
        for box in office["boxes"]:
            gap = np.maximum(
                np.subtract(box["min_m"], free["max_m"]), np.subtract(free["min_m"], box["max_m"])
            )
            assert np.linalg.norm(np.maximum(gap, 0)) >= CLEARANCE_M, (free["name"], box["name"])


def test_the_offices_boxes_lie_in_the_official_depth(samples, office):
    """Every box marked `seen` holds points of office kt0's depth images; the free space holds none."""
    cv2 = pytest.importorskip("cv2")
    poses = np.loadtxt(samples / "or_kt0/traj0.gt.freiburg")
    clouds = []
    for frame in range(600, 720, 10):
        row = poses[poses[:, 0] == frame][0]
        # anchored at (0, 0, -2.5), itself at the start pose in the scene, whose axes are the room's
        start = np.array([0.7004, 4.9714, -2.0385]) + [0, 0, 2.5]
        T_pov = SE3.from_quat_xyzw(row[4:], row[1:4] + start)
        depth = (
            cv2.imread(str(samples / f"or_kt0/depth/{frame}.png"), cv2.IMREAD_UNCHANGED)[::4, ::4]
            / 5000.0
        )
        camera = PinholeCamera.parse("160x120,120.3,120,79.875,59.875")
        points = camera.unproject(depth)[depth > 0]
        clouds.append(axes.world_cv_from_pov(T_pov).apply(points))
    cloud = np.concatenate(clouds)
    for box in office["boxes"]:
        inside = (distance_to_box_m(cloud, box) < 0.03).sum()
        if (
            box["basis"] == "seen" and box["name"] != "desk_lamp_a"
        ):  # the lamp stands there in kt3 only
            assert inside > 20, box["name"]
    low, high = np.array(office["room_min_m"]) - 0.03, np.array(office["room_max_m"]) + 0.03
    assert ((cloud > low) & (cloud < high)).all(axis=1).mean() > 0.999
    for free in office["keep_free"]:
        within = (
            (cloud > np.array(free["min_m"]) + 0.03) & (cloud < np.array(free["max_m"]) - 0.03)
        ).all(axis=1)
        assert not within.any(), free["name"]
