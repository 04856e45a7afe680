"""The pinhole camera: pixel centres, depth, Blender's settings there and back, the pyramid's next
level.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera, blender_from_pinhole
from iclnuim.job import RenderJob


def random_cameras(count: int, largest: int = 2000) -> list[PinholeCamera]:
    rng = np.random.default_rng(7)
    cameras = []
    for _ in range(count):
        width, height = (int(n) for n in rng.integers(4, largest, 2))
        fx, fy = rng.uniform(0.3, 3, 2) * width
        cx, cy = rng.uniform(-0.2, 1.2, 2) * (width, height)
        cameras.append(PinholeCamera(width, height, fx, fy, cx, cy))
    return cameras


def test_the_default_is_the_benchmarks_camera():
    camera = PinholeCamera()
    assert (camera.width, camera.height, camera.fy, camera.cx, camera.cy) == (
        640,
        480,
        480,
        319.5,
        239.5,
    )
    assert camera.fx == pytest.approx(481.203, abs=1e-3)
    # true field of view 67.25 x 53.13 degrees
    assert 2 * np.degrees(np.arctan(320 / camera.fx)) == pytest.approx(67.25, abs=0.01)
    assert 2 * np.degrees(np.arctan(240 / camera.fy)) == pytest.approx(53.13, abs=0.01)


def pinhole_of(blender):
    """Blender's projection with a horizontal sensor fit, written out."""
    width, height = blender.resolution_x, blender.resolution_y
    aspect = blender.pixel_aspect_y / blender.pixel_aspect_x
    fx = blender.lens * width / blender.sensor_width
    cx, cy = (
        (width - 1) / 2 - blender.shift_x * width,
        (height - 1) / 2 + blender.shift_y * width / aspect,
    )
    return PinholeCamera(width, height, fx, fx / aspect, cx, cy)


def test_blender_and_back_gives_the_same_k():
    for camera in random_cameras(200):
        back = pinhole_of(blender_from_pinhole(camera))
        assert (back.width, back.height) == (camera.width, camera.height)
        np.testing.assert_allclose(back.K, camera.K, rtol=1e-12, atol=1e-9)


def test_blender_keeps_its_pixel_aspects_at_one_or_above():
    for camera in random_cameras(200):
        blender = blender_from_pinhole(camera)
        assert min(blender.pixel_aspect_x, blender.pixel_aspect_y) == 1


def test_a_short_lens_gets_a_wider_sensor_and_what_blender_cannot_render_is_refused():
    wide = PinholeCamera(32, 24, 1.0, 1.0, 15.5, 11.5)
    assert blender_from_pinhole(wide).lens >= 1 - 1e-12
    np.testing.assert_allclose(pinhole_of(blender_from_pinhole(wide)).K, wide.K, rtol=1e-12)
    for size, focal in (
        ((3, 24), (24, 24)),
        ((32, 3), (24, 24)),
        ((32, 24), (24, 7000)),
        ((32, 24), (7000, 24)),
    ):
        camera = PinholeCamera(*size, *focal, 1, 1)
        with pytest.raises(InputError, match="as Blender renders"):
            RenderJob("kt2", "living_room", "living_room/kt2", camera=camera)


def test_the_benchmarks_camera_needs_no_shift_in_blender():
    blender = blender_from_pinhole(PinholeCamera())
    assert blender.shift_x == 0 and blender.shift_y == 0


def test_projection_undoes_unprojection():
    rng = np.random.default_rng(8)
    for camera in random_cameras(5, largest=400):
        depth_z_m = rng.uniform(0.5, 9, (camera.height, camera.width))
        uv = camera.project(camera.unproject(depth_z_m))
        np.testing.assert_allclose(
            uv[..., 0], np.broadcast_to(np.arange(camera.width), depth_z_m.shape), atol=1e-8
        )
        np.testing.assert_allclose(
            uv[..., 1],
            np.broadcast_to(np.arange(camera.height)[:, None], depth_z_m.shape),
            atol=1e-8,
        )
        np.testing.assert_array_equal(camera.unproject(depth_z_m)[..., 2], depth_z_m)


def test_projection_is_k_times_the_point():
    camera = random_cameras(1)[0]
    points = np.random.default_rng(9).uniform(0.1, 2, (100, 3))
    homogeneous = points @ camera.K.T
    np.testing.assert_allclose(
        camera.project(points), homogeneous[:, :2] / homogeneous[:, 2:], rtol=1e-13
    )


def test_points_behind_the_camera_have_no_pixel():
    assert np.isnan(PinholeCamera().project(np.array([[0.0, 0, -1], [0, 0, 0]]))).all()


def test_a_plane_has_one_planar_depth_and_many_ray_distances():
    camera = PinholeCamera()
    distance_m = np.linalg.norm(camera.unproject(np.full((480, 640), 2.0)), axis=-1)
    assert distance_m[0, 0] == pytest.approx(2.6, abs=0.1) and distance_m[
        240, 320
    ] == pytest.approx(2.0, abs=1e-5)
    np.testing.assert_allclose(distance_m / np.linalg.norm(camera.rays(), axis=-1), 2.0, rtol=1e-14)


def test_the_halved_camera_sees_each_pixel_through_the_middle_of_its_four():
    for camera in random_cameras(50, largest=400):
        half = camera.halved()
        rows, columns = 2 * half.height, 2 * half.width
        rays = camera.rays()[:rows, :columns]
        means = rays.reshape(half.height, 2, half.width, 2, 3).mean(axis=(1, 3))
        np.testing.assert_allclose(half.rays(), means, atol=1e-9)


def test_settings_survive_json_like_dictionaries():
    for camera in random_cameras(20):
        assert PinholeCamera.from_dict(camera.to_dict()) == camera


def test_a_view_can_be_written_in_one_word():
    assert PinholeCamera.parse("640x480") == PinholeCamera()
    assert PinholeCamera.parse("320x240").K[0, 0] == pytest.approx(PinholeCamera().fx / 2)
    assert PinholeCamera.parse("320x240,1,2,3,4") == PinholeCamera(320, 240, 1, 2, 3, 4)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "640",
        "640x480,1,2,3",
        "640x480,a,2,3,4",
        "0x480",
        "640x480,-1,2,3,4",
        "640x480,nan,2,3,4",
        pytest.param("9" * 5000 + "x48", id="digits"),
    ],
)
def test_a_view_that_cannot_be_understood_is_refused(text):
    with pytest.raises(InputError):
        PinholeCamera.parse(text)


@pytest.mark.parametrize("key", ["width", "height", "fx", "fy", "cx", "cy"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), "wide", None, [1]])
def test_settings_that_are_no_numbers_are_refused(key, value):
    with pytest.raises(InputError):
        PinholeCamera.from_dict({**PinholeCamera().to_dict(), key: value})


def test_unknown_settings_are_refused():
    with pytest.raises(InputError, match="found k1"):
        PinholeCamera.from_dict({**PinholeCamera().to_dict(), "k1": 0.1})


def test_the_minus_sign_of_the_paper_is_explained():
    with pytest.raises(InputError, match="its absolute value: a negative fy means"):
        PinholeCamera(fy=-480)


def test_depth_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"\(480, 640\)"):
        PinholeCamera().unproject(np.zeros((640, 480)))


def test_focal_lengths_below_a_pixel_are_shares_of_the_image():
    with pytest.raises(InputError, match="at least a pixel, found fx 0.86 and fy 1.15; try pixels"):
        PinholeCamera(640, 480, 0.86, 1.15, 0.5, 0.5)
