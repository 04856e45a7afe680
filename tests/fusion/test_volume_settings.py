"""What each setting of the volume is for, and which blocks a measured depth needs."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba")
from iclnuim.benchmark.fusion.mesh import extract  # noqa: E402
from iclnuim.benchmark.fusion.quality import SeenBy, what_was_seen  # noqa: E402
from iclnuim.benchmark.fusion.samples import thinned  # noqa: E402
from iclnuim.benchmark.fusion.settings import (  # noqa: E402
    PRESETS,
    FuseSettings,
    QualitySettings,
    VolumeSettings,
)
from iclnuim.benchmark.fusion.surface_error import TrueSurface  # noqa: E402
from iclnuim.benchmark.fusion.volume import Volume  # noqa: E402

#: A pixel of the image is 1/50 of its depth wide.
SMALL = PinholeCamera(8, 6, 50.0, 50.0, 3.5, 2.5)


def frontal(depth_m):
    return np.full((6, 8), depth_m, np.float32)


def wall(volume, depth_m, times=1):
    for _ in range(times):
        volume.integrate(frontal(depth_m), SMALL, SE3.identity())
    return volume


def test_a_depth_allocates_the_blocks_of_the_voxels_nearest_to_its_ray_within_the_truncation():
    """A single pixel, at depths that put the ends of the truncation anywhere in a voxel. Beyond the
    farther end the ray may be sampled for up to one more voxel.
    """
    settings = VolumeSettings(voxel_m=0.01, truncation_m=0.0455, behind_m=0.0455, max_blocks=100)
    camera = PinholeCamera(2, 2, 50.0, 50.0, 0.0, 0.0)
    for depth_m in np.arange(1.0, 1.1, 0.0007):
        depth_z_m = np.array([[depth_m, 0], [0, 0]])
        volume = Volume(settings)
        volume.integrate(depth_z_m, camera, SE3.identity())
        found = set(volume.grid.place[volume.rows(), 2].tolist())
        measured = float(np.float32(depth_m))
        along_m = np.arange(measured - 0.0456, measured + 0.0556, 0.0001)
        nearest = np.rint(along_m / 0.01).astype(int) >> 3
        needed = set(nearest[np.abs(along_m - measured) < 0.0445].tolist())
        assert needed <= found <= set(nearest.tolist()), depth_m


def test_a_board_of_3_cm_keeps_both_sides_with_the_best_preset(camera, plane_depth):
    """The false wall behind a surface, of the depth `behind_m`, does not reach its other side."""
    volume = Volume(replace(PRESETS["best"], max_blocks=20_000))
    behind = SE3(np.diag([-1.0, 1, -1]), np.array([0, 0, 2.03]))
    for _ in range(2):
        for T, depth_m in ((SE3.identity(), 1.0), (behind, 1.0)):
            volume.integrate(np.full((120, 160), depth_m, np.float32), camera, T)
    for T in (SE3.identity(), behind):
        depth_z_m = volume.raycast(camera, T).depth_z_m
        assert abs(np.nanmedian(depth_z_m) - 1.0) < 0.0002


@pytest.mark.parametrize(("far_m", "is_fused"), [(7.5, True), (8.5, False)])
def test_depth_up_to_8_m_is_used(far_m, is_fused):
    assert bool(wall(Volume(replace(PRESETS["best"], max_blocks=500)), far_m).blocks) == is_fused


@pytest.mark.parametrize(("preset", "width_m"), [("best", 18.0), ("paper", 4.5)])
def test_a_window_has_the_width_that_its_preset_states(preset, width_m):
    volume = Volume(replace(PRESETS[preset], max_blocks=500))
    side_m = volume.settings.window_blocks * 8 * volume.settings.voxel_m
    assert side_m == pytest.approx(width_m, rel=0.01)
    assert volume.grid.slots.nbytes < 0.1e9
    wall(volume, 1.0)
    volume.follow(np.array([0.45 * width_m, 0, 0]))
    assert volume.blocks > 0
    volume.follow(np.array([0.55 * width_m, 0, 0]))
    assert volume.blocks == 0


def test_120000_blocks_take_a_gigabyte():
    volume = wall(Volume(VolumeSettings(max_blocks=500)), 1.0)
    a_block = (volume.bytes_used - volume.grid.slots.nbytes) / volume.max_used
    assert a_block * VolumeSettings().max_blocks == pytest.approx(0.9e9, rel=0.1)


def test_a_mean_forgets_after_255_frames():
    """After 300 frames at one distance, 100 at another move the surface by 1 - (255/256)^100."""
    volume = Volume(replace(PRESETS["paper"], max_blocks=500))
    wall(wall(volume, 1.0, 300), 1.01, 100)
    found_m = np.nanmedian(volume.raycast(SMALL, SE3.identity()).depth_z_m)
    assert (found_m - 1.0) / 0.01 == pytest.approx(1 - (255 / 256) ** 100, abs=0.03)


@pytest.mark.parametrize(("tilt_deg", "is_meshed"), [(65, True), (80, False)])
def test_a_quarter_of_a_frame_is_enough_for_a_mesh(tilt_deg, is_meshed, camera, plane_depth):
    """A view of a surface counts by the cosine of its slant, and less behind the surface: half at
    the next voxel.
    """
    normal = (np.sin(np.radians(tilt_deg)), 0, -np.cos(np.radians(tilt_deg)))
    volume = Volume(replace(PRESETS["best"], max_blocks=20_000))
    volume.integrate(plane_depth(normal, (0, 0, 1.0)), camera, SE3.identity())
    points = extract(volume, min_weight=FuseSettings().min_weight).points
    centre = np.abs(points[:, :2]).max(axis=1) < 0.05
    area = len(points[centre]) * VolumeSettings().voxel_m ** 2 * np.cos(np.radians(tilt_deg))
    assert (area > 0.3 * 0.1**2) == is_meshed


def square(side_m):
    """A square 1 m before the camera, of which it sees 1 m2."""
    half = side_m / 2
    corners = np.array([[-half, -half, 1], [half, -half, 1], [half, half, 1], [-half, half, 1]])
    return TrueSurface(corners, np.array([[0, 1, 2], [0, 2, 3]]))


@pytest.mark.parametrize(
    ("share", "samples"), [(0.94, 0.94), (0.6, 1.0), (1 / 15, 1.0), (1 / 35, 20 / 35)]
)
def test_a_model_is_sampled_again_if_less_than_90_percent_is_seen_with_up_to_20_times_as_many(
    share, samples
):
    camera = PinholeCamera(120, 120, 120.0, 120.0, 59.5, 59.5)
    surface = square(np.sqrt(1 / share))
    settings = QualitySettings(samples=3000)
    poses = SE3.from_matrix(np.eye(4)[None])
    seen = what_was_seen(surface, SeenBy(camera, poses), settings)
    assert len(seen.points_m) / 3000 == pytest.approx(samples, abs=0.03)


def test_a_cloud_has_a_sample_per_cell_of_5_mm():
    def kept(spacing_m):
        side = np.arange(100) * spacing_m
        cloud = np.stack(np.meshgrid(side, side, [0.0]), -1).reshape(-1, 3)
        return len(thinned(cloud, 100_000, 0)) / len(cloud)

    assert kept(0.006) == 1 and kept(0.003) == pytest.approx((3 / 5) ** 2, abs=0.02)


def test_samples_of_a_room_are_a_few_millimetres_apart():
    """A room of 5 x 4 x 2.5 m has 85 m2; the mean of its error is then known to 0.2 %."""
    spacing_m = np.sqrt(85 / QualitySettings().samples)
    assert 0.012 < spacing_m < 0.018


@pytest.mark.parametrize("tilt_deg", [80, 86])
def test_a_slanted_surface_is_fused_up_to_four_truncations_along_the_ray(tilt_deg):
    """Behind itself by 20 mm along its normal, if that is not farther than 180 mm along z."""
    normal = np.array([np.sin(np.radians(tilt_deg)), 0, -np.cos(np.radians(tilt_deg))])
    volume = Volume(replace(PRESETS["best"], max_blocks=20_000))
    camera = PinholeCamera(160, 120, 1200.0, 1200.0, 79.5, 59.5)
    depth_z_m = normal[2] / (camera.rays() @ normal)
    volume.integrate(depth_z_m, camera, SE3.identity())
    rows = volume.rows()
    inside = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), -1).reshape(-1, 3)
    voxels = (8 * volume.grid.place[rows][:, None] + inside) * volume.settings.voxel_m
    voxels = voxels[volume.grid.weight[rows] > 0]
    voxels = voxels[np.abs(voxels[:, 0]) < 0.008]
    behind_m = -((voxels - (0, 0, 1)) @ normal).min()
    expected_m = min(0.020, 4 * 0.045 * np.cos(np.radians(tilt_deg)))
    assert behind_m == pytest.approx(expected_m, abs=0.0025)


@pytest.mark.parametrize(
    ("tilt_deg", "low_m", "high_m"), [(50, -0.003, 0.0005), (20, 0.001, 0.007)]
)
def test_behind_a_tilted_board_nothing_is_fused_beside_its_edge(tilt_deg, low_m, high_m):
    """The point of the board that is nearest to a fused voxel is on the board, x < 0. A board that
    is nearly frontal need not: 20 mm behind it, at 20 degrees, that point is up to 7 mm beside it.
    """
    normal = np.array([np.sin(np.radians(tilt_deg)), 0, -np.cos(np.radians(tilt_deg))])
    camera = PinholeCamera(160, 120, 1200.0, 1200.0, 79.5, 59.5)
    rays = camera.rays()
    depth_z_m = normal[2] / (rays @ normal)
    depth_z_m[rays[..., 0] > 0] = 3.0
    volume = Volume(replace(PRESETS["best"], voxel_m=0.004, max_blocks=20_000))
    volume.integrate(depth_z_m, camera, SE3.identity())
    rows = volume.rows()
    inside = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), -1).reshape(-1, 3)
    voxels = (8 * volume.grid.place[rows][:, None] + inside) * volume.settings.voxel_m
    behind = (volume.grid.weight[rows] > 0) & (volume.grid.tsdf[rows] < 0) & (voxels[..., 2] < 2)
    voxels = voxels[behind]
    nearest = voxels - ((voxels - (0, 0, 1)) @ normal)[:, None] * normal
    assert low_m <= nearest[:, 0].max() <= high_m
