"""How many points a COLMAP model has, and in how many images each is seen."""

from types import SimpleNamespace

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sequences.layouts.colmap import surface_points

CAMERA = PinholeCamera.parse("320x240")


def still(count, depth_of):
    """`count` frames of a camera at rest before a wall; the numbers of the frames that are asked
    for.
    """
    asked = []

    def surface(number):
        asked.append(number)
        depth = np.full((CAMERA.height, CAMERA.width), depth_of(len(asked)))
        return np.zeros((*depth.shape, 3), np.uint8), depth

    poses = SE3(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
    frames = [SimpleNamespace(number=number) for number in range(count)]
    return SimpleNamespace(camera=CAMERA, frames=frames, poses=poses, surface=surface), asked


def test_a_model_has_the_points_and_the_tracks_of_a_usual_reconstruction():
    """Of a sequence of any length: some ten thousand points to start from, each seen in some
    images, and a minute of work.
    """
    contents, asked = still(400, lambda k: 2.0)
    points, tracks = surface_points(contents)
    assert 28 < len(asked) < 57
    assert 13_000 < len(points) < 27_000
    assert 6 < np.median([len(track) for track in tracks]) < 13


@pytest.mark.parametrize(("nearer", "seen"), [(0.007, True), (0.014, False)])
def test_a_point_is_seen_where_depth_agrees_to_a_percent(nearer, seen):
    """What is nearer hides it."""
    contents, _ = still(2, lambda k: 2.0 if k == 1 else 2.0 * (1 - nearer))
    _, tracks = surface_points(contents)
    assert (max(map(len, tracks)) > 1) is seen
