"""The paper's depth noise (equation 3, the step along the normal): every sigma comes back out,
nothing bleeds.
"""

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.depth import PaperDepthNoise, _projected
from iclnuim.sensor.noise_model import frame_generator, gaussian

STEPS_CM = 35130.0
#: Parts switched off one by one: no shift, no disparity noise, steps too small to see.
NO_SHIFT = {"sigma_s_px": 0.0}
NO_STEPS = {"sigma_d": 0.0, "disparity_cm": 1e9}
NO_LATERAL = {"lateral": False}


def _walls(around_m, count, steps=3):
    """Depths that sweep `steps` steps of disparity round a depth, evenly in depth."""
    middle = STEPS_CM / 100 / around_m
    far, near = (STEPS_CM / 100 / (middle + s) for s in (-steps / 2, steps / 2))
    return near + (np.arange(count) + 0.5) / count * (far - near)


def _swept(model, around_m, count=90, seed=1):
    """(true, noisy) depths of walls that sweep three steps, flattened."""
    camera = PinholeCamera.parse("160x120")
    true, noisy = [], []
    for k, depth_m in enumerate(_walls(around_m, count)):
        wall = np.full((120, 160), depth_m, np.float32)
        noisy.append(model.apply(wall, camera, frame_generator(seed, k, 0)).astype(float).ravel())
        true.append(wall.astype(float).ravel())
    return np.concatenate(true), np.concatenate(noisy)


@pytest.mark.parametrize(("around_m", "step_mm"), [(1.0, 2.8), (2.0, 11.4), (4.0, 45.5)])
def test_swept_walls_have_no_bias_and_the_step_of_equation_3(around_m, step_mm):
    true, noisy = _swept(PaperDepthNoise(**NO_LATERAL), around_m)
    step_m = around_m**2 / (STEPS_CM / 100)
    assert abs((noisy - true).mean()) < 0.01 * step_m
    levels = np.unique(noisy)
    assert np.diff(levels).mean() * 1000 == pytest.approx(step_mm, rel=0.02)


@pytest.mark.parametrize("around_m", [1.0, 2.0, 4.0])
def test_sigma_d_comes_back(around_m):
    # rounding of an evenly swept value adds 1/12, whatever the noise
    model = PaperDepthNoise(**NO_LATERAL)
    true, noisy = _swept(model, around_m)
    disparity_error = STEPS_CM / 100 / noisy - STEPS_CM / 100 / true
    assert np.sqrt(disparity_error.var() - 1 / 12) == pytest.approx(model.sigma_d, rel=0.03)
    assert abs(disparity_error.mean()) < 0.005


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sigma_s_px", [0.5, 1.15])
def test_sigma_s_comes_back_along_either_axis(camera, plane, axis, sigma_s_px):
    depth = plane(camera, 40, 2.0)
    depth = depth if axis else np.ascontiguousarray(depth[:, : camera.height].T)
    model = PaperDepthNoise(sigma_s_px=sigma_s_px, **NO_STEPS, **NO_LATERAL)
    noisy = model.apply(depth, camera, frame_generator(1, 2, 0)).astype(float)
    inverse = 1 / depth.astype(float)  # linear over the image of a plane
    slope = np.gradient(inverse, axis=axis)
    shift = ((1 / noisy - inverse) / slope)[6:-6, 6:-6]
    assert shift.std() == pytest.approx(sigma_s_px, rel=0.03)
    assert abs(shift.mean()) < 0.02


@pytest.mark.parametrize("angle_deg", [0, 30, 50, 70])
@pytest.mark.parametrize("depth_m", [1.0, 2.0, 4.0])
def test_sigma_theta_comes_back_by_angle_and_depth(plane, angle_deg, depth_m):
    camera = PinholeCamera(200, 200, 2000, 2000, 99.5, 99.5)  # a narrow view: one angle, one depth
    model = PaperDepthNoise(
        sigma_theta_m=1e-5,
        sigma_theta_m_per_rad=2e-5,
        sigma_theta_m_per_m=1e-5,
        sigma_theta_m_per_rad_m=0.5e-5,
        **NO_SHIFT,
        **NO_STEPS,
    )
    depth = plane(camera, angle_deg, depth_m)
    noisy = model.apply(depth, camera, frame_generator(1, 1, 0)).astype(float)
    # so small a step moves no vertex to another pixel: what changes is z, by the step's z component
    step_m = (noisy - depth) / np.cos(np.radians(angle_deg))
    rays = camera.rays()
    cosine = (
        rays
        @ [np.sin(np.radians(angle_deg)), 0, np.cos(np.radians(angle_deg))]
        / np.linalg.norm(rays, axis=-1)
    )
    angle = np.arccos(np.minimum(cosine, 1))
    sigma_m = 1e-5 + 2e-5 * angle + (1e-5 + 0.5e-5 * angle) * depth
    assert (step_m / sigma_m)[1:-1, 1:-1].std() == pytest.approx(1, rel=0.03)


def test_sigma_theta_is_the_bilinear_fit_of_the_part_of_nguyens_noise_that_grows_with_the_angle():
    angle, depth_m = np.meshgrid(np.radians(np.linspace(0, 75, 76)), np.linspace(0.5, 4.5, 81))
    angle, depth_m = angle.ravel(), depth_m.ravel()
    nguyen_m = 0.0001 / np.sqrt(depth_m) * angle**2 / (np.pi / 2 - angle) ** 2
    terms = np.column_stack([np.ones_like(angle), angle, depth_m, angle * depth_m])
    fitted = np.linalg.lstsq(terms, nguyen_m, rcond=None)[0]
    model = PaperDepthNoise()
    ours = [model.sigma_theta_m, model.sigma_theta_m_per_rad]
    ours += [model.sigma_theta_m_per_m, model.sigma_theta_m_per_rad_m]
    assert ours == pytest.approx(fitted.tolist(), rel=0.005)


class Constant:
    """A generator whose every number is the same, so that all vertices step equally far."""

    def __init__(self, level):
        self.level = level

    def integers(self, low, high, size, dtype):
        return np.full(size, self.level, dtype)


@pytest.mark.parametrize("axis", ["u", "v"])
@pytest.mark.parametrize(
    "level", [2000, 63000]
)  # 1.9 and 1.8 sigma towards the camera and away from it
@pytest.mark.parametrize("angle_deg", [-50, 50])
def test_equal_steps_along_the_normal_move_a_slanted_plane_as_a_whole(
    plane, axis, level, angle_deg
):
    camera, generator = PinholeCamera(161, 161, 160, 160, 80, 80), Constant(level)
    none = dict.fromkeys(
        ("sigma_theta_m_per_rad", "sigma_theta_m_per_m", "sigma_theta_m_per_rad_m"), 0.0
    )
    model = PaperDepthNoise(sigma_theta_m=0.05, **none, **NO_SHIFT, **NO_STEPS)
    step_m = 0.05 * gaussian(generator, (1,))[0]
    depth = plane(camera, angle_deg, 2.0)
    # the plane lies 2 cos(angle) from the camera; moved along its normal it meets the optical axis
    # this much farther
    moved = plane(camera, angle_deg, 2.0 + step_m / np.cos(np.radians(angle_deg)))
    if axis == "v":
        depth, moved = depth.T, moved.T
    noisy = model.apply(depth, camera, generator).astype(float)
    # each point lands on the pixel nearest to its ray, so depth is off by half a pixel's slope at
    # most
    half_pixel = 0.5 * np.abs(np.stack(np.gradient(moved.astype(float)))).max(0)
    inner, landed = np.s_[20:-20, 20:-20], noisy > 0
    assert landed[inner].mean() > 0.6
    assert (np.abs(noisy - moved) <= 1.1 * half_pixel + 1e-4)[inner][landed[inner]].all()
    assert np.sign((noisy - depth)[inner][landed[inner]].mean()) == np.sign(step_m)


@pytest.mark.parametrize("sigma_px", [0.3, 0.6, 1.0])
def test_pixels_go_missing_as_often_as_no_vertex_lands_on_them(plane, sigma_px):
    from scipy.stats import norm

    camera, angle = PinholeCamera(300, 200, 6000, 6000, 149.5, 99.5), np.radians(70)
    depth = plane(camera, 70, 2.0)
    # a step along the normal moves a vertex by its sine
    sigma_m = sigma_px * 2.0 / camera.fx / np.sin(angle)
    constant = {
        "sigma_theta_m": sigma_m,
        "sigma_theta_m_per_rad": 0.0,
        "sigma_theta_m_per_m": 0.0,
        "sigma_theta_m_per_rad_m": 0.0,
    }
    noisy = PaperDepthNoise(**constant, **NO_SHIFT, **NO_STEPS).apply(
        depth, camera, frame_generator(3, 0, 0)
    )
    lands = [norm.cdf((k + 0.5) / sigma_px) - norm.cdf((k - 0.5) / sigma_px) for k in range(-6, 7)]
    expected = np.prod([1 - p for p in lands])
    assert (noisy[:, 10:-10] == 0).mean() == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("seed", range(3))
def test_where_vertices_land_on_one_pixel_the_nearest_is_seen(seed):
    """Whether it moved there or stayed: by a loop over all vertices, with a dictionary."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1, 2, (30, 40)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = 0
    shift_u, shift_v = rng.normal(0, 1.5, (2, *depth.shape)).astype(np.float32)
    nearest = {}
    for (row, column), z in np.ndenumerate(depth):
        place = (
            row + round(float(shift_v[row, column])),
            column + round(float(shift_u[row, column])),
        )
        if z > 0:
            nearest[place] = min(nearest.get(place, np.inf), z)
    expected = np.zeros_like(depth)
    for (row, column), z in nearest.items():
        if 0 <= row < 30 and 0 <= column < 40:
            expected[row, column] = z
    np.testing.assert_array_equal(_projected(depth, shift_u, shift_v), expected)


def test_oblique_surfaces_go_missing_and_facing_ones_do_not(plane):
    # the middle of the benchmark's image: angles to 3 degrees
    camera = PinholeCamera(40, 40, 481, 480, 19.5, 19.5)
    missing = []
    for angle_deg in (0, 40, 60, 70, 78, 86):
        wall = plane(camera, angle_deg, 1.0)
        frames = [
            PaperDepthNoise().apply(wall, camera, frame_generator(0, k, 0))[2:-2, 2:-2]
            for k in range(10)
        ]
        missing.append(np.mean([(frame == 0).mean() for frame in frames]))
    assert missing[0] == missing[1] == 0
    assert missing == sorted(missing)
    assert missing[4] > 0.1
    assert missing[5] == 1


@pytest.mark.parametrize("lateral", [False, True])
def test_edges_borders_and_missing_pixels_never_bleed(lateral):
    camera = PinholeCamera.parse("160x120")
    depth = np.full((120, 160), 3.0, np.float32)
    depth[30:70, 40:90] = 1.0
    depth[80:110, 20:60] = 0.0
    depth[60:65, 80:100] = np.nan
    model = PaperDepthNoise(lateral=lateral)
    for frame in range(5):
        noisy = model.apply(depth, camera, frame_generator(8, frame, 0))
        near, far = np.abs(noisy - 1) < 0.02, np.abs(noisy - 3) < 0.12
        assert (near | far | (noisy == 0)).all()
        assert (
            (noisy[0] > 0).all()
            and (noisy[-1] > 0).all()
            and (noisy[:, 0] > 0).all()
            and (noisy[:, -1] > 0).all()
        )
        assert (noisy[90:100, 30:50] == 0).all()
        # an edge moves by the shift alone: 4.32 sigma of half a pixel, two and a half pixels at
        # most
        assert near[34:58, 44:76].all() and far[:26].all() and far[:, 105:].all()


def test_a_single_wall_is_biased_by_at_most_a_fifth_of_a_step_as_equation_3_has_it():
    biases = []
    for depth_m in _walls(2.0, 40, steps=1):
        wall = np.full((120, 160), depth_m, np.float32)
        noisy = PaperDepthNoise(**NO_LATERAL).apply(
            wall, PinholeCamera.parse("160x120"), frame_generator(1, 1, 0)
        )
        biases.append((noisy.astype(float).mean() - wall.astype(float).mean()) / (4.0 / 351.3))
    assert 0.15 < np.abs(biases).max() < 0.21
