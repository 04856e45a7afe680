"""Which free places are in a room."""

import numpy as np
import pytest

pytest.importorskip("embreex", reason="casts rays")
from iclnuim.raycast import viewpoints  # noqa: E402

#: Level rays, which meet walls, and as many that are not.
RAYS = np.r_[np.tile([1.0, 0, 0], (100, 1)), np.tile([0, 0, 1.0], (100, 1))]


def in_rooms(monkeypatch, hits, backs):
    """Whether each place is in a room, if these shares of its rays hit a surface, and a back
    face.
    """
    hit = np.array([np.arange(200) % 100 < 100 * share for share in hits])
    back = np.array([np.arange(200) < 200 * share for share in backs])
    distance = np.where(hit, 2.0, np.inf)
    monkeypatch.setattr(viewpoints, "_cast_from", lambda caster, places, rays: (distance, back))
    return viewpoints._in_rooms(np.zeros((len(hit), 3)), None, RAYS).tolist()


def test_a_place_is_inside_an_object_if_a_seventh_of_its_rays_meet_back_faces(monkeypatch):
    """Some back faces, as of a plant's leaves, are seen from a room too."""
    assert in_rooms(monkeypatch, [1, 1, 1], [0, 0.07, 0.14]) == [True, True, False]


@pytest.mark.parametrize(("free", "turned"), [(14, True), (28, False)])
def test_back_faces_are_ignored_in_a_scene_whose_walls_show_them_to_the_room(
    monkeypatch, free, turned
):
    """Where only a few places of a hundred see none: their walls are turned around."""
    found = in_rooms(monkeypatch, [1] * 100, [0] * free + [1] * (100 - free))
    assert sum(found) == (100 if turned else free)


def test_a_place_is_in_a_room_if_more_than_half_of_the_walls_of_the_best_place_are_around(
    monkeypatch,
):
    """A terrace has a wall on one side or two."""
    assert in_rooms(monkeypatch, [0.9, 0.7, 0.4], [0, 0, 0]) == [True, True, False]
