"""Raycasts of fused analytic surfaces, the window that moves, and what a volume refuses."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba")
from dataclasses import replace  # noqa: E402

from iclnuim.benchmark.fusion import fuse_kernels  # noqa: E402
from iclnuim.benchmark.fusion.grid import read  # noqa: E402
from iclnuim.benchmark.fusion.mesh import extract  # noqa: E402
from iclnuim.benchmark.fusion.settings import PRESETS, VolumeSettings  # noqa: E402
from iclnuim.benchmark.fusion.volume import Volume  # noqa: E402

SMALL = {name: replace(preset, max_blocks=20_000) for name, preset in PRESETS.items()}
VOXEL_M = SMALL["best"].voxel_m


def points_world(volume, camera, T_world_camera):
    """(h, w, 3) and the view."""
    view = volume.raycast(camera, T_world_camera)
    return T_world_camera.apply(camera.unproject(view.depth_z_m).astype(float)), view


@pytest.mark.parametrize("preset", SMALL)
@pytest.mark.parametrize(
    "normal", [(0, 0, -1), (0.5, 0, -1), (-0.5, 0.3, -1), (0, -0.6, -1), (0.9, 0.7, -1)]
)
def test_a_fused_plane_is_seen_where_it_is_from_every_side(preset, normal, camera, plane_depth):
    normal = np.array(normal) / np.linalg.norm(normal)
    volume = Volume(SMALL[preset])
    volume.integrate(plane_depth(normal, (0, 0, 1.5)), camera, SE3.identity())
    points, view = points_world(volume, camera, SE3.identity())
    error = (points - [0, 0, 1.5]) @ normal
    assert np.isfinite(error).mean() > (0.9 if abs(normal[2]) > 0.8 else 0.5)
    assert np.nanmedian(np.abs(error)) < 0.02 * VOXEL_M
    assert abs(np.nanmean(error)) < 0.02 * VOXEL_M
    assert np.nanmedian(view.normals_camera @ normal) > 0.999


def test_a_sphere_seen_from_around_has_no_bias_in_any_direction(camera, sphere_depth, looking_at):
    centre, radius, volume = np.array([0.3, -0.2, 1.1]), 0.5, Volume(SMALL["best"])
    places = [
        centre + 1.5 * np.array([np.cos(a), np.sin(a), h])
        for a in np.arange(0, 2 * np.pi, 0.5)
        for h in (-0.4, 0.5)
    ]
    poses = [looking_at(place, centre) for place in places]
    for T in poses:
        volume.integrate(sphere_depth(centre, radius, T), camera, T)
    points = np.concatenate([points_world(volume, camera, T)[0].reshape(-1, 3) for T in poses])
    points = points[np.isfinite(points).all(axis=1)] - centre
    error = np.linalg.norm(points, axis=1) - radius
    assert np.median(np.abs(error)) < 0.02 * VOXEL_M
    for axis in range(3):
        for sign in (1, -1):
            side = sign * points[:, axis] > 0.8 * radius
            if side.sum() > 100:  # the poles are not seen
                assert abs(np.median(error[side])) < 0.02 * VOXEL_M, (axis, sign)


def test_a_single_view_of_a_sphere_is_exact(camera, sphere_depth):
    volume = Volume(SMALL["best"])
    volume.integrate(sphere_depth((0, 0, 1.5), 0.5), camera, SE3.identity())
    error = (
        np.linalg.norm(points_world(volume, camera, SE3.identity())[0] - [0, 0, 1.5], axis=-1) - 0.5
    )
    assert np.isfinite(error).sum() > 1000
    assert np.nanmedian(np.abs(error)) < 0.02 * VOXEL_M


def test_a_table_seen_at_a_grazing_angle_is_whole_up_to_its_rim(camera, plane_depth):
    # 8.4 mm before the next voxel
    table, volume = (
        plane_depth((0, 1, 0), (0, 0.1146, 0)),
        Volume(SMALL["best"]),
    )
    depth = np.where((table > 0) & (table < 0.75), table, np.float32(3))  # at 9 degrees there
    for _ in range(3):
        volume.integrate(depth, camera, SE3.identity())
    points = extract(volume).points
    x, y, z = points[(np.abs(points[:, 0]) < 0.1) & (points[:, 2] < 1)].T
    assert np.abs(y - 0.1146).max() < 0.01 * VOXEL_M
    assert np.histogram2d(x, z, bins=(10, 10), range=((-0.1, 0.1), (0.52, 0.72)))[0].min() > 0
    assert z.max() < 0.75 + VOXEL_M


def test_colour_is_the_mean_of_what_was_seen(camera, plane_depth):
    volume, depth = Volume(SMALL["best"]), plane_depth((0, 0, -1), (0, 0, 1.5))
    for value in (10, 50):
        image = np.zeros((120, 160, 3), np.uint8)
        image[:] = (value, 100, 200)
        volume.integrate(depth, camera, SE3.identity(), image)
    colour = volume.raycast(camera, SE3.identity()).colour[30:90, 40:120]
    assert np.abs(colour - [30, 100, 200]).max() < 0.1


def test_the_rounding_of_many_colours_has_no_bias(camera, plane_depth):
    """Each rounding is off by at most half of 1/256, evenly: 200 of them by 0.01 together."""
    volume, depth = Volume(SMALL["best"]), plane_depth((0, 0, -1), (0, 0, 1.5))
    values = np.random.default_rng(1).integers(0, 256, (200, 3))
    for value in values:
        image = np.broadcast_to(value.astype(np.uint8), (120, 160, 3)).copy()
        volume.integrate(depth, camera, SE3.identity(), image)
    colour = volume.raycast(camera, SE3.identity()).colour[30:90, 40:120]
    assert np.abs(colour - values.mean(axis=0)).max() < 0.05


def test_the_number_of_threads_changes_nothing(camera, sphere_depth, looking_at):
    import numba

    views, threads = [], numba.get_num_threads()
    for count in (1, threads):
        numba.set_num_threads(count)
        volume = Volume(SMALL["best"])
        for place in ((1.5, 0, 0.1), (1.4, 0.2, 0.0)):
            T = looking_at(np.array(place), (0, 0, 0))
            volume.integrate(
                sphere_depth((0, 0, 0), 0.5, T), camera, T, np.full((120, 160, 3), 90, np.uint8)
            )
        views.append(volume.raycast(camera, T))
    numba.set_num_threads(threads)
    for name in ("depth_z_m", "normals_camera", "colour"):
        np.testing.assert_array_equal(getattr(views[0], name), getattr(views[1], name))


def test_a_window_that_follows_forgets_what_it_leaves_and_sees_what_it_reaches(camera, plane_depth):
    gone = []
    settings = VolumeSettings(window_blocks=16, max_blocks=5000)  # 1.1 m
    volume = Volume(settings, lambda volume, leaves: gone.append(int(leaves.sum())))
    for x in np.arange(0, 3, 0.1):
        T = SE3(np.eye(3), [x, 0, 0])
        volume.integrate(plane_depth((0, 0, -1), (0, 0, 0.4), T), camera, T)
        view = volume.raycast(camera, T, colour=False)
        assert np.nanmedian(np.abs(view.depth_z_m - 0.4)) < 0.02 * VOXEL_M
        assert np.isfinite(view.depth_z_m).mean() > 0.9
    assert sum(gone) > 0
    assert volume.blocks < 16**3 / 4
    assert np.isnan(volume.raycast(camera, SE3.identity()).depth_z_m).all()


def test_full_memory_sends_away_what_lies_farthest(camera, plane_depth):
    gone = []
    volume = Volume(
        VolumeSettings(max_blocks=3000), lambda volume, leaves: gone.append(int(leaves.sum()))
    )
    for x in np.arange(0, 20, 1.0):
        T = SE3(np.eye(3), [x, 0, 0])
        volume.integrate(plane_depth((0, 0, -1), (0, 0, 1.0), T), camera, T)
    assert gone
    assert volume.max_used <= 3000
    assert np.isfinite(volume.raycast(camera, T).depth_z_m).mean() > 0.9


def test_what_cannot_be_fused_is_refused_in_words(camera):
    volume = Volume(VolumeSettings(max_blocks=4))
    with pytest.raises(InputError, match="rigid pose"):
        volume.integrate(np.ones((120, 160)), camera, SE3(np.full((3, 3), np.nan), np.zeros(3)))
    with pytest.raises(InputError, match="160x120"):
        volume.integrate(np.ones((12, 16)), camera, SE3.identity())
    with pytest.raises(InputError, match="3 channels"):
        volume.integrate(np.ones((120, 160)), camera, SE3.identity(), np.ones((120, 160)))
    with pytest.raises(InputError, match="within 4 blocks"):
        volume.integrate(np.ones((120, 160)), camera, SE3.identity())


@pytest.mark.parametrize(
    "wrong",
    [
        {"voxel_m": 0},
        {"truncation_m": 0.01},
        {"truncation_m": 1e6},
        {"window_blocks": 100},
        {"behind_m": 0.1},
        {"channels": 2},
        {"max_blocks": 10**11},
    ],
)
def test_settings_that_make_no_volume_are_refused(wrong):
    with pytest.raises(InputError):
        VolumeSettings(**wrong)


def test_more_blocks_than_fit_into_memory_are_refused(monkeypatch):
    def full(*arguments):
        raise MemoryError

    monkeypatch.setattr("iclnuim.benchmark.fusion.volume._empty_grid", full)
    with pytest.raises(
        InputError, match="max_blocks: expected blocks that fit into memory, found 7"
    ):
        Volume(VolumeSettings(max_blocks=7))


def test_empty_depth_leaves_nothing_to_see(camera):
    volume = Volume(VolumeSettings(max_blocks=4))
    volume.integrate(np.full((120, 160), np.nan), camera, SE3.identity())
    assert np.isnan(volume.raycast(camera, SE3.identity()).depth_z_m).all()


def test_what_lies_beside_and_behind_costs_a_raycast_nothing(camera, plane_depth):
    volume = Volume(SMALL["best"])
    volume.integrate(plane_depth((0, 0, -1), (0, 0, 1.5)), camera, SE3.identity())
    alone = volume._reach(camera, SE3.identity())
    for angle in (np.pi / 2, -np.pi / 2, np.pi):
        T = SE3.exp(np.array([0, 0, 0, 0, angle, 0]))
        normal = -T.rotation[:, 2]
        volume.integrate(plane_depth(normal, T.rotation[:, 2], T), camera, T)
    np.testing.assert_array_equal(alone, volume._reach(camera, SE3.identity()))
    assert alone[0].min() > 1.2
    assert alone[1].max() < 1.8


def test_a_plane_continues_at_every_pixel_of_it_however_thin_the_truncation():
    """Its inverse depth is linear in the image; points behind it, of which the nearest one of the
    plane lies between pixels.
    """
    K = (100.0, 110.0, 31.5, 23.5)
    n = (0.4, -0.3, 0.5)
    v, u = np.mgrid[:48, :64].astype(float)
    inverse = n[0] * (u - K[2]) / K[0] + n[1] * (v - K[3]) / K[1] + n[2]
    rng = np.random.default_rng(0)
    for column, row in rng.uniform((20, 15), (44, 33), (50, 2)):
        found = n[0] * (column - K[2]) / K[0] + n[1] * (row - K[3]) / K[1] + n[2]
        for behind_m in (0.0, 0.05):
            at = (column, row, 1 / found + behind_m)
            assert fuse_kernels._continues(inverse, K, at, found, n, 1e-6)
        assert not fuse_kernels._continues(inverse + 0.1, K, at, found, n, 0.01)


def test_the_block_of_the_nearest_voxel_of_a_ray_is_fused():
    """One pixel has depth; its ray runs a third of a voxel before the border of blocks."""
    camera = PinholeCamera(64, 48, 100.0, 100.0, 32.0, 24.0)
    depth = np.zeros((48, 64), np.float32)
    depth[24, 32] = 1.0
    border_m = 8 * VOXEL_M * np.array([3, -2])
    T = SE3(np.eye(3), np.r_[border_m - 0.3 * VOXEL_M, 0.0])
    volume = Volume(SMALL["best"])
    volume.integrate(depth, camera, T)
    rows = volume.grid.slots[volume.grid.slots > 0]
    places = np.unique(volume.grid.place[rows, :2], axis=0)
    assert places.tolist() == [[3, -2]]


def test_a_seen_point_of_a_rough_surface_is_at_the_zero_of_the_fused_distance():
    """6 mm of noise: between voxels the distance is no straight line. In shares of the truncation."""
    camera = PinholeCamera.parse("160x120")
    noise = np.random.default_rng(5).normal(0, 0.006, (120, 160))
    depth = 1.0 + 0.25 * camera.rays()[..., 0] + noise
    volume = Volume(SMALL["best"])
    volume.integrate(depth.astype(np.float32), camera, SE3.identity())
    points, _ = points_world(volume, camera, SE3.identity())
    points = points[np.isfinite(points).all(axis=2)]
    assert len(points) > 15_000
    fused = np.array([read(volume.grid, *point) for point in points[::7] / VOXEL_M])
    assert np.abs(fused).max() < 0.005


def test_colour_between_voxels_is_interpolated():
    """A ramp along the image's rows and columns, on a tilted plane; a voxel is some pixels wide."""
    camera = PinholeCamera(160, 120, 300.0, 300.0, 79.5, 59.5)
    rays = camera.rays()
    depth = (1.0 / (1.0 + 0.3 * rays[..., 0])).astype(np.float32)
    v, u = np.mgrid[:120, :160]
    image = np.stack([20 + u, 20 + 1.5 * v, 255 - u], axis=-1).astype(np.uint8)
    volume = Volume(SMALL["best"])
    volume.integrate(depth, camera, SE3.identity(), image)
    seen = volume.raycast(camera, SE3.identity()).colour[20:100, 20:140]
    error = np.abs(seen - image[20:100, 20:140].astype(float))
    assert np.nanpercentile(error, 99) < 1.0
