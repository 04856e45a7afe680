"""The original's raw `.depth` frames: distances along the ray become planar Z."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.raw_depth import read_ray_depth
from iclnuim.geometry.camera import PinholeCamera

CAMERA = PinholeCamera.parse("64x48")


def write(path, distance, line_end=" "):
    path.write_text("".join(f"{d:.9g}{line_end}" for d in np.ravel(distance)))
    return path


@pytest.mark.parametrize("line_end", [" ", "\n", " \r\n"])
@pytest.mark.parametrize("unit_m", [1.0, 0.01])
def test_a_tilted_plane_gives_its_planar_depth(tmp_path, unit_m, line_end):
    # points of the plane n . p = 2: Z = 2 / (n . ray), distance = |ray| Z
    rays = CAMERA.rays()
    depth_z_m = 2.0 / (rays @ (0.2, -0.3, 0.9))
    distance = np.linalg.norm(rays, axis=-1) * depth_z_m / unit_m
    read = read_ray_depth(write(tmp_path / "0.depth", distance, line_end), CAMERA, unit_m)
    np.testing.assert_allclose(read, depth_z_m, rtol=1e-8)


def test_the_middle_keeps_its_distance_and_the_corner_shrinks(tmp_path):
    read = read_ray_depth(write(tmp_path / "0.depth", np.full((480, 640), 2.0)), PinholeCamera())
    assert read[240, 320] == pytest.approx(2.0, abs=1e-5)
    assert read[0, 0] == pytest.approx(2.0 / np.hypot(1, np.hypot(319.5 * 1.33 / 640, 239.5 / 480)))


def test_what_was_not_hit_has_depth_zero(tmp_path):
    distance = np.full((48, 64), 3.0)
    distance[5, 6] = 1e10
    read = read_ray_depth(write(tmp_path / "0.depth", distance), CAMERA)
    assert read[5, 6] == 0 and (read == 0).sum() == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1 2 3", "0.depth: expected 3072 distances, 64 x 48, found 3"),
        ("1 2\nx 3", "0.depth:2: expected distances .* found 'x'"),
        ("1 -2", "0.depth:1: .* found '-2'"),
        ("nan", "found 'nan'"),
        ("", "an empty file"),
        ("<html>", "a web page"),
    ],
)
def test_what_is_wrong_with_a_raw_frame_is_said(tmp_path, content, message):
    (tmp_path / "0.depth").write_text(content)
    with pytest.raises(InputError, match=message):
        read_ray_depth(tmp_path / "0.depth", CAMERA)
