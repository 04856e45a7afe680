"""Raycasts of fused analytic surfaces, and what a volume refuses."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera

pytest.importorskip("numba")
from iclnuim_bench.reconstruction.volume import Volume, VolumeSettings  # noqa: E402

CAMERA = PinholeCamera(160, 120, 120.3, 120.0, 79.5, 59.5)
V, U = np.mgrid[:120, :160]
RAYS = np.stack([(U - CAMERA.cx) / CAMERA.fx, (V - CAMERA.cy) / CAMERA.fy, np.ones(U.shape)], axis=-1)


@pytest.mark.parametrize("normal", [(0, 0, -1), (0.5, 0, -1), (-0.5, 0.3, -1), (0, -0.6, -1)])
def test_a_fused_plane_is_seen_where_it_is_from_every_side(normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    depth = (normal @ [0, 0, 1.5]) / (RAYS @ normal)
    volume = Volume(VolumeSettings(most_blocks=20_000))
    volume.integrate(depth.astype(np.float32), CAMERA, np.eye(4))
    view = volume.raycast(CAMERA, np.eye(4))
    error = (view.points_world - [0, 0, 1.5]) @ normal
    assert np.isfinite(error).mean() > 0.9
    assert np.nanmedian(np.abs(error)) < 0.02 * volume.settings.voxel_m
    assert abs(np.nanmean(error)) < 0.02 * volume.settings.voxel_m
    assert np.nanmedian(view.normals_camera @ normal) > 0.999


def test_a_fused_sphere_is_seen_where_it_is():
    a, b, c = (RAYS**2).sum(-1), RAYS @ [0, 0, 1.5], 1.5**2 - 0.5**2
    inside = b * b - a * c
    depth = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, 0)
    volume = Volume(VolumeSettings(most_blocks=20_000))
    volume.integrate(depth.astype(np.float32), CAMERA, np.eye(4))
    error = np.linalg.norm(volume.raycast(CAMERA, np.eye(4)).points_world - [0, 0, 1.5], axis=-1) - 0.5
    assert np.nanmedian(np.abs(error)) < 0.02 * volume.settings.voxel_m


def test_what_cannot_be_fused_is_refused_in_words():
    volume = Volume(VolumeSettings(most_blocks=4))
    with pytest.raises(InputError, match="rigid 4x4 pose"):
        volume.integrate(np.ones((120, 160)), CAMERA, np.full((4, 4), np.nan))
    with pytest.raises(InputError, match="160x120"):
        volume.integrate(np.ones((12, 16)), CAMERA, np.eye(4))
    with pytest.raises(InputError, match="within 4 blocks"):
        volume.integrate(np.ones((120, 160)), CAMERA, np.eye(4))


def test_empty_depth_leaves_nothing_to_see():
    volume = Volume(VolumeSettings(most_blocks=4))
    volume.integrate(np.full((120, 160), np.nan), CAMERA, np.eye(4))
    assert np.isnan(volume.raycast(CAMERA, np.eye(4)).depth_z_m).all()
