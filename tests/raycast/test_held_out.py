"""Held-out views in rooms whose visibility is known by hand: what is new, what was seen, what is
refused, what is chosen.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("embreex", reason="casts rays")
from iclnuim import check_held_out, choose_held_out  # noqa: E402
from iclnuim.raycast.caster import RayCaster  # noqa: E402

CAMERA = PinholeCamera.parse("80x60")
#: Looks along world y, z up.
AHEAD = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
CORNERS = np.array(np.meshgrid([-2.0, 2.0], [-2.5, 2.5], [-1.2, 1.3])).reshape(3, -1).T
_FACES = [(0, 2, 6, 4), (1, 3, 7, 5), (0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6)]
TRIANGLES = np.array([t for a, b, c, d in _FACES for t in ((a, b, c), (a, c, d))])
#: A sheet across the room at y = 1, half a metre wide.
SHEET = np.array([[-0.25, 1.0, -1.2], [0.25, 1.0, -1.2], [0.25, 1.0, 1.3], [-0.25, 1.0, 1.3]])


@pytest.fixture(scope="module")
def room():
    return RayCaster(CORNERS, TRIANGLES)


@pytest.fixture(scope="module")
def parted_room():
    return RayCaster(np.vstack([CORNERS, SHEET]), np.vstack([TRIANGLES, [[8, 9, 10], [8, 10, 11]]]))


def looking(yaw_deg, *places):
    """Views (n,) from places, turned about z from world y towards -x."""
    R = so3.exp([0.0, 0.0, np.radians(yaw_deg)]) @ AHEAD
    return SE3(np.broadcast_to(R, (len(places), 3, 3)), np.array(places, float))


def unseen_by_hand(view, training):
    """In an empty box nothing hides anything: share of all pixels whose point on the walls is in no
    training image.
    """
    rays = CAMERA.rays().reshape(-1, 3) @ view.rotation.T
    walls = np.where(rays > 0, CORNERS.max(0), CORNERS.min(0))
    points = view.translation + ((walls - view.translation) / rays).min(1, keepdims=True) * rays
    seen = np.zeros(len(points), bool)
    for k in range(len(training)):
        u, v = CAMERA.project(training[k].inverse().apply(points)).T
        seen |= (np.abs(u - 39.5) < 40) & (np.abs(v - 29.5) < 30)
    return 1 - seen.mean()


def test_what_was_not_seen_is_what_the_images_of_training_do_not_reach(room):
    training = looking(0, (0, 0, 0), (0.2, -0.4, 0))
    for view in (looking(0, (0.0, 0.9, 0.1)), looking(4, (0.1, 0.6, 0))):
        (found,) = check_held_out(room, CAMERA, view, training)
        assert (
            found.unseen == pytest.approx(unseen_by_hand(view[0], training), abs=0.001)
            and found.unseen <= 0.01
        )
    # -1.23, not -1.2: there, a column of points is exactly on the border of a training image, on
    # one side or the other by rounding
    for view in (looking(25, (0, 0, 0)), looking(0, (0.0, -1.23, 0))):
        share = unseen_by_hand(view[0], training)
        with pytest.raises(
            InputError,
            match=r"at most 1% of pixels whose surface no training view saw, found view 0 with (\S+)%",
        ) as e:
            check_held_out(room, CAMERA, view, training)
        assert float(str(e.value).split("view 0 with ")[1].split("%")[0]) == pytest.approx(
            100 * share, abs=0.1
        )


@pytest.mark.parametrize(
    ("yaw_deg", "place", "said"),
    [
        (0, (0, 0.499, 0), "view 1 at 0.499 m and 0.0 degrees"),
        (19.9, (0, 0, 0), "view 1 at 0.000 m and 19.9 degrees"),
        (19.9, (0, 0.499, 0), "view 1 at 0.499 m and 19.9 degrees"),
        (0, (0, 0.501, 0), None),
    ],
)
def test_a_view_nearer_than_half_a_metre_and_20_degrees_is_refused(room, yaw_deg, place, said):
    training = looking(0, (0, 0, 0), (0, -2.0, 0))
    views = SE3(*(np.concatenate([getattr(T, part) for T in (looking(0, (0, 0.9, 0)), looking(yaw_deg, place))])
                  for part in ("rotation", "translation")))  # fmt: skip
    if said is None:
        assert [round(v.distance_m, 3) for v in check_held_out(room, CAMERA, views, training)] == [
            0.9,
            0.501,
        ]
        return
    with pytest.raises(InputError, match="0.5 m or 20 degrees from every training view") as e:
        check_held_out(room, CAMERA, views, training)
    assert said in str(e.value)


def test_roll_makes_no_view_new(room):
    rolled = SE3(looking(0, (0, 0, 0)).rotation @ so3.exp([0, 0, 1.0]), np.zeros((1, 3)))
    with pytest.raises(InputError, match="view 0 at 0.000 m and 0.0 degrees"):
        check_held_out(room, CAMERA, rolled, looking(0, (0, 0, 0)))


def test_what_a_thing_hides_and_its_back_were_not_seen(parted_room):
    training = looking(0, (0, -1.5, 0), (0, -2.0, 0))
    assert check_held_out(parted_room, CAMERA, looking(0, (0, -0.9, 0)), training)[0].unseen == 0
    with pytest.raises(InputError, match="no training view saw"):  # the wall behind the sheet
        check_held_out(parted_room, CAMERA, looking(0, (0, 1.1, 0)), training)
    both = looking(0, (0, -1.5, 0), (-0.9, -1.5, 0), (0.9, -1.5, 0))
    with pytest.raises(
        InputError, match="no training view saw"
    ):  # its back, whose points are those of its front
        check_held_out(parted_room, CAMERA, looking(180, (0, 1.8, 0)), both)


def test_chosen_views_are_new_seen_level_and_always_the_same(parted_room):
    training = looking(0, *((x, -2.0, 0.1) for x in np.linspace(-1.2, 1.2, 12)))
    small = PinholeCamera.parse("40x30")
    views = choose_held_out(parted_room, small, training, 2, seed=3)
    assert len(check_held_out(parted_room, small, views, training)) == 2
    again = choose_held_out(parted_room, small, training, 2, seed=3)
    assert views.matrix.tobytes() == again.matrix.tobytes()
    assert np.abs(views.rotation[:, 2, 0]).max() < 1e-12  # the x axis of the image is level
    assert (
        choose_held_out(parted_room, small, training, 2, seed=4).matrix.tobytes()
        != views.matrix.tobytes()
    )
    with pytest.raises(
        InputError, match="expected 1 views of what training saw, .*, found 0; try fewer"
    ):
        choose_held_out(parted_room, CAMERA, looking(0, (0, 9.0, 0)), 1)  # outside, looking away


def test_chosen_views_keep_a_quarter_of_a_metre_from_walls():
    """In a corridor of 80 cm that leaves 30 cm in its middle."""
    corridor = RayCaster(CORNERS * (0.2, 1, 1), TRIANGLES)
    places = [(x, y, 0.0) for y in np.linspace(-2.2, 1.0, 9) for x in (-0.25, 0.25)]
    training = looking(0, *places)
    views = choose_held_out(corridor, PinholeCamera.parse("40x30"), training, 5, seed=0)
    assert np.abs(views.translation[:, 0]).max() < 0.17
