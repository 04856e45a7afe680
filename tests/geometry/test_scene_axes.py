"""How a scene file's axes and units are taken: options as matrices, guesses that follow the scene
when it is turned or scaled.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry import scene_axes
from iclnuim.geometry.scene_axes import SceneReading


def room(size):
    """Vertices and triangles of a closed box of this size."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) * size
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


@pytest.mark.parametrize("up", scene_axes.UP)
def test_every_up_axis_is_turned_to_z_by_a_rotation(up):
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    matrix = scene_axes.linear(up, 1.0, "none")
    assert matrix @ axis == pytest.approx([0, 0, 1])
    assert matrix @ matrix.T == pytest.approx(np.eye(3))
    assert np.linalg.det(matrix) == pytest.approx(1)


@pytest.mark.parametrize("mirror", ["x", "y", "z"])
def test_a_mirror_changes_the_hand_and_units_the_size(mirror):
    assert np.linalg.det(scene_axes.linear("y", 0.01, mirror)) == pytest.approx(-1e-6)


@pytest.mark.parametrize("usual", ["y", "z"])
@pytest.mark.parametrize(
    ("size", "truth"), [((5, 2.5, 6), "y"), ((5, 6, 2.5), "z"), ((4.94, 2.5, 5.02), "y")]
)
def test_a_room_stands_on_its_floor_whatever_the_format_mostly_does(usual, size, truth):
    assert scene_axes.guess_up(scene_axes.shape_of(*room(np.array(size))), usual) == truth


@pytest.mark.parametrize("usual", ["y", "z"])
def test_a_cube_says_nothing_so_the_format_decides(usual):
    assert scene_axes.guess_up(scene_axes.shape_of(*room(np.ones(3))), usual) == usual


@pytest.mark.parametrize("size", [(5, 2.5, 6), (12, 3, 20), (3, 2, 2.2), (8, 6, 9)])
@pytest.mark.parametrize("unit_m", [1.0, 0.01, 0.001])
def test_the_unit_of_a_room_is_found(size, unit_m):
    shape = scene_axes.shape_of(*room(np.array(size) / unit_m))
    assert scene_axes.guess_unit_m(shape, "y") == unit_m


def test_a_landscape_seen_through_a_window_does_not_count():
    vertices, triangles = room(np.array([5, 2.5, 6.0]))
    many = np.concatenate([triangles] * 20)
    far = np.array([(-80, 0, -80), (80, 0, -80), (80, 0, 80), (-80, 40, 80)], float)
    ground = np.array([(0, 1, 2), (0, 2, 3)]) + len(vertices)
    shape = scene_axes.shape_of(np.concatenate([vertices, far]), np.concatenate([many, ground]))
    assert scene_axes.guess_up(shape, "z") == "y"
    assert scene_axes.guess_unit_m(shape, "y") == 1.0


def scan(noise_m, balloon_m=0.0):
    """A scanned room of 5 m x 4 m x 2.5 m, y up, and a sphere around it, as far reconstructed."""
    steps = np.linspace(0, 1, 60)
    a, b = (side.ravel() for side in np.meshgrid(steps, steps))
    walls = []
    for axis in range(3):
        for end in (0.0, 1.0):
            walls.append(np.insert(np.stack([a, b], 1), axis, end, axis=1) * (5, 2.5, 4))
    if balloon_m:
        turn, lift = 2 * np.pi * a, np.pi * (b - 0.5)
        around = [np.cos(turn) * np.cos(lift), np.sin(lift), np.sin(turn) * np.cos(lift)]
        walls.append(balloon_m * np.stack(around, 1))
    at = np.arange(60 * 60).reshape(60, 60)
    halves = [(at[:-1, :-1], at[:-1, 1:], at[1:, 1:]), (at[:-1, :-1], at[1:, 1:], at[1:, :-1])]
    quads = np.concatenate([np.stack(half, -1).reshape(-1, 3) for half in halves])
    faces = np.concatenate([quads + k * at.size for k in range(len(walls))])
    vertices = np.concatenate(walls)
    return vertices + np.random.default_rng(0).normal(0, noise_m, vertices.shape), faces


@pytest.mark.parametrize("unit_m", [1.0, 0.0254, 0.001])
def test_the_unit_of_a_scanned_room_is_found(unit_m):
    vertices, triangles = scan(noise_m=0.05)
    shape = scene_axes.shape_of(vertices / unit_m, triangles)
    assert scene_axes.guess_unit_m(shape, "y") == unit_m


@pytest.mark.parametrize("balloon_m", [40, 60, 100])
def test_a_scan_with_parts_far_outside_the_room_has_no_other_unit(balloon_m):
    assert scene_axes.guess_unit_m(scene_axes.shape_of(*scan(0.02, balloon_m)), "y") == 1.0


def test_a_thing_on_a_table_is_believed_to_be_in_metres():
    assert (
        scene_axes.guess_unit_m(scene_axes.shape_of(*room(np.array([0.3, 0.2, 0.3]))), "y") == 1.0
    )


@pytest.mark.parametrize(
    "settings",
    [
        {"up": "w"},
        {"mirror": "xy"},
        {"unit_m": 0.0},
        {"unit_m": "cm"},
        {"unit_m": True},
        {"textures": 3},
    ],
)
def test_a_reading_that_makes_no_sense_is_refused(settings):
    with pytest.raises(InputError):
        SceneReading.from_dict(settings)


def test_a_reading_comes_back_from_its_dictionary_and_an_open_one_leaves_no_trace():
    reading = SceneReading(up="-y", unit_m=0.01, mirror="x", textures="/pictures")
    assert SceneReading.from_dict(reading.to_dict()) == reading
    assert SceneReading().to_dict() == {}
    with pytest.raises(InputError, match="up, unit_m"):
        SceneReading.from_dict({"upp": "y"})


def test_units_are_read_by_name_or_as_metres():
    assert scene_axes.parse_unit("cm") == 0.01
    assert scene_axes.parse_unit("0.3048") == 0.3048
    with pytest.raises(InputError, match="a unit"):
        scene_axes.parse_unit("furlong")


def boxes(lows, highs):
    """Vertices and triangles of closed boxes between (n, 3) and (n, 3)."""
    made = [room(np.subtract(high, low)) for low, high in zip(lows, highs, strict=True)]
    vertices = np.concatenate([corners + low for (corners, _), low in zip(made, lows, strict=True)])
    return vertices, np.concatenate([triangles + 8 * k for k, (_, triangles) in enumerate(made)])


def kitchen(width, depth, height, ceiling=True):
    """z up: a floor, walls and a ceiling of two triangles each; along one wall cupboards of many
    panels with handles; a table.
    """
    lows, highs = [], []
    for x in np.arange(0.0, width - 0.6, 0.6):
        for z, top, back in ((0.1, 0.85, 0.6), (1.4, 2.1, 0.35)):
            # back, drawer, door of two panels
            lows += [(x, y, z) for y in (0.02, back - 0.06, back - 0.04, back)]
            highs += [(x + 0.58, y + 0.02, top) for y in (0.02, back - 0.06, back - 0.04, back)]
            lows += [(x + 0.1 + 0.03 * k, back + 0.03, top - 0.1) for k in range(12)]
            highs += [(x + 0.12 + 0.03 * k, back + 0.05, top - 0.08) for k in range(12)]
    lows += [(0.0, 0.02, 0.86), (0.8, depth - 1.2, 0.72)]
    highs += [(width - 0.3, 0.62, 0.9), (width - 0.8, depth - 0.4, 0.76)]
    lows += [(x, depth - 1.2, 0.0) for x in (0.8, width - 0.85)]
    highs += [(x + 0.05, depth - 1.15, 0.72) for x in (0.8, width - 0.85)]
    shell, faces = room(np.array([width, depth, height]))
    inside, panels = boxes(np.array(lows), np.array(highs))
    if not ceiling:
        faces = faces[~(shell[faces][..., 2] == height).all(1)]
    return np.concatenate([shell, inside]), np.concatenate([faces, panels + 8])


@pytest.mark.parametrize("unit", scene_axes.UNITS_M)
@pytest.mark.parametrize(
    ("up", "size", "ceiling"),
    [
        *[
            (up, (6.9, 4.1, 2.8), True) for up in "zyx"
        ],  # x up, which is rare, is found where it is clear
        *[(up, *kind) for up in "zy" for kind in (((4.2, 3.4, 2.5), True), ((5, 3.6, 2.6), False))],
    ],
)
def test_a_kitchen_stands_on_its_floor_in_every_unit(up, size, ceiling, unit):
    vertices, triangles = kitchen(*size, ceiling)
    turned = np.roll(vertices, "xyz".index(up) - 2, axis=1) / scene_axes.UNITS_M[unit]
    shape = scene_axes.shape_of(turned, triangles)
    assert {scene_axes.guess_up(shape, usual) for usual in "yz"} == {up}
    assert scene_axes.guess_unit_m(shape, up) == scene_axes.UNITS_M[unit]


def test_a_size_that_no_unit_makes_a_room_stays_in_metres_and_is_not_plausible():
    shape = scene_axes.shape_of(*room(np.array([140.0, 90.0, 1.2])))
    assert scene_axes.guess_unit_m(shape, "z") == 1.0
    assert not scene_axes.is_plausible(shape.extent, "z")
    assert scene_axes.is_plausible(np.array([20.0, 12.0, 8.0]), "z")
