"""A map's layout: charts apart from each other, every corner in the map, every texel's point on its
surface.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.lightmap.layout import lay_out
from iclnuim.lightmap.surfaces import BACK, FRONT


def both(scene):
    return np.ones((scene.faces, 2), bool)


@pytest.mark.parametrize("size", [64, 128, 300])
def test_reading_the_map_anywhere_on_a_surface_meets_its_own_chart_only(scene, size):
    layout = lay_out(scene, both(scene), size)
    sides, rng = layout.sides.surfaces, np.random.default_rng(1)
    triangle = rng.integers(len(sides.triangles), size=4000)
    at = (
        np.einsum(
            "nk,nkj->nj", rng.dirichlet(np.ones(3), 4000), layout.corners[sides.triangles[triangle]]
        )
        - 0.5
    )
    chart = layout.texels.image(layout.texels.chart, -1)
    own = layout.charts.chart[sides.triangle_face[triangle]]
    low = np.floor(at).astype(int)
    for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = np.prod(np.where([dx, dy], at - low, 1 - (at - low)), 1)
        read = weight > 1e-3
        assert (chart[low[read, 1] + dy, low[read, 0] + dx] == own[read]).all()


def test_every_corner_lies_in_the_map_and_sides_have_their_own_place(scene):
    layout = lay_out(scene, both(scene), 128)
    uv, has = layout.uv()
    assert has.all()
    assert ((uv > 0) & (uv < 1)).all()
    assert np.abs(uv[FRONT] - uv[BACK]).max(-1).min() > 1 / 128


def test_points_of_texels_lie_on_the_surface_where_the_map_says(scene):
    layout = lay_out(scene, both(scene), 200)
    points, normals = layout.points()
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    sides = layout.sides.surfaces
    corners = sides.triangles[layout.texels.triangle]
    plane = np.einsum("nj,nj->n", points - sides.corners_m[corners[:, 0]], normals)
    assert np.abs(plane).max() < 1e-9  # flat-shaded: shading normals are the planes' own
    inside = layout.texels.weights
    assert inside.min() > -0.35 and np.allclose(inside.sum(1), 1)


def test_light_read_back_by_interpolation_is_the_light_that_was_stored(scene):
    """Irradiance linear in space, stored at texels and read bilinearly at face centres, comes back."""
    layout = lay_out(scene, both(scene), 256)
    points, _ = layout.points()
    slope = np.array([0.3, -0.2, 0.5])
    image = layout.texels.image(points @ slope)
    uv, _ = layout.uv()
    sides = layout.sides.surfaces
    side_of_corner = layout.sides.side[sides.face_of_corner]
    at = uv[side_of_corner, layout.sides.corner] * 256 - 0.5
    for k in np.flatnonzero(np.linalg.norm(sides.area_vectors(), axis=1) > 0.005):
        rows = slice(sides.face_start[k], sides.face_start[k + 1])
        (x, y), centre = at[rows].mean(0), sides.corners_m[rows].mean(0)
        i, j = int(y), int(x)
        fy, fx = y - i, x - j
        read = (image[i, j] * (1 - fx) + image[i, j + 1] * fx) * (1 - fy) + (
            image[i + 1, j] * (1 - fx) + image[i + 1, j + 1] * fx
        ) * fy
        assert abs(read - centre @ slope) < 0.004


def test_narrow_faces_are_widened_towards_a_texel_each(scene):
    layout = lay_out(scene, both(scene), 256)
    sides = layout.sides.surfaces
    strip = np.flatnonzero(sides.face_object == 2)
    across = 0.02 * np.pi / 2 / 8 * layout.density
    width = []
    for k in strip:
        corners = layout.corners[sides.face_start[k] : sides.face_start[k + 1]]
        width.append(
            min(np.linalg.norm(corners[1] - corners[0]), np.linalg.norm(corners[2] - corners[1]))
        )
    assert across < 0.9
    assert np.median(width) > 1.5 * across


def test_a_map_too_small_for_its_charts_is_refused(scene):
    with pytest.raises(InputError, match="larger map"):
        lay_out(scene, both(scene), 6)


def test_charts_where_light_changes_fast_get_more_texels(scene):
    even, changing = np.full((scene.faces, 2), 1e-3), np.full((scene.faces, 2), 1e-3)
    changing[: scene.faces // 8] = 1.0

    def share(contrast):
        layout = lay_out(scene, both(scene), 256, contrast=contrast)
        return np.mean(layout.face_of_texel < scene.faces // 8)

    assert share(changing) > 1.2 * share(even)
