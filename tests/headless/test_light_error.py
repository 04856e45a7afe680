"""How far a frame is from a reference, free of the reference's noise, and how a surface point
changes between frames.
"""

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sensor.transfer import light_from_srgb
from iclnuim.tools.light_comparison import carried_difference, error

CAMERA = PinholeCamera.parse("160x120")


def halves_of(display: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    return np.stack(
        [light_from_srgb(display + noise * rng.standard_normal(display.shape)) for _ in range(2)]
    )


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_the_error_is_that_of_the_frame_whatever_the_noise_of_the_reference(noise):
    rng = np.random.default_rng(1)
    display = rng.uniform(0.3, 0.7, (2, 120, 160, 3))
    off = display + 0.01 * rng.standard_normal(display.shape)
    found = error(light_from_srgb(off), halves_of(display, noise, rng))
    assert found.mean_psnr_db == pytest.approx(40, abs=0.2)
    assert found.median == pytest.approx(0.6745 * 0.01, rel=0.1)


def wall(T_world_camera: SE3, brightness: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A smooth pattern on the plane z = 2, as light and planar depth."""
    rays = CAMERA.unproject(np.ones((CAMERA.height, CAMERA.width))) @ T_world_camera.rotation.T
    points = T_world_camera.translation + rays * (
        (2 - T_world_camera.translation[2]) / rays[..., 2:]
    )
    display = 0.5 + 0.2 * np.sin(3 * points) + brightness
    return light_from_srgb(display), T_world_camera.inverse().apply(points.reshape(-1, 3))[
        :, 2
    ].reshape(rays.shape[:2])


@pytest.mark.parametrize("brightness", [0.0, 0.05])
def test_a_surface_point_changes_by_what_its_light_changes_and_not_by_motion(brightness):
    T_a, T_b = SE3.identity(), SE3.exp(np.array([0.03, -0.02, 0.05, 0.01, 0.02, -0.01]))
    change = carried_difference(*wall(T_a), *wall(T_b, brightness), T_b.inverse() @ T_a, CAMERA)
    assert len(change) > 0.8 * CAMERA.width * CAMERA.height
    assert np.median(change) == pytest.approx(brightness, abs=2e-4)


def test_what_lies_behind_another_surface_in_the_other_frame_is_left_out():
    light, depth_z_m = wall(SE3.identity())
    nearer = depth_z_m.copy()
    nearer[:, :80] = 1.0
    still = SE3.identity()
    assert (
        len(carried_difference(light, depth_z_m, light, nearer, still, CAMERA))
        < 0.5 * depth_z_m.size
    )
