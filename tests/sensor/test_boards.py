"""The edges of a board before a wall, as an active stereo camera sees them."""

import numpy as np
import pytest
from iclnuim import noisy_depth
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.boards import BoardRecording

CAMERA = PinholeCamera(320, 200, 424.0, 424.0, 159.5, 99.5)
WIDTH_M = 0.3


def recorded(tilted_deg=4.0, behind_m=2.0, shifted_m=0.0, frames=16, **settings):
    """A board at one metre whose edges are turned about the optical axis."""
    x, y = CAMERA.rays()[..., 0], CAMERA.rays()[..., 1]
    turn = np.radians(tilted_deg)
    across = np.cos(turn) * (x - shifted_m) - np.sin(turn) * y
    along = np.sin(turn) * (x - shifted_m) + np.cos(turn) * y
    is_board = (np.abs(across) < WIDTH_M / 2) & (np.abs(along) < 0.2)
    depth_z_m = np.where(is_board, 1.0, behind_m).astype(np.float32)
    batch = np.repeat(depth_z_m[None], frames, 0)
    noisy_m = noisy_depth(batch, "d435", CAMERA, settings=settings, albedo=0.9)
    return BoardRecording(noisy_m, CAMERA, WIDTH_M)


@pytest.mark.parametrize("fat_px, ragged_px", [(2.0, 1.0), (3.0, 0.7), (1.0, 0.5)])
@pytest.mark.parametrize("tilted_deg", [4.0, -2.0])
def test_growth_and_raggedness_are_those_of_the_sensor(fat_px, ragged_px, tilted_deg):
    board = recorded(tilted_deg, fat_px=fat_px, ragged_px=ragged_px).checked()
    assert board.growth_px == pytest.approx(fat_px, abs=0.1)  # 5 % of the published one
    assert board.ragged_px == pytest.approx(ragged_px, rel=0.05)


def test_exact_edges_neither_grow_nor_fray():
    board = recorded(fat_px=0.0, ragged_px=0.0, subpixel_px=0.0).checked()
    assert abs(board.growth_px) < 0.1 and board.ragged_px < 0.15


@pytest.mark.parametrize(
    "how, message",
    [
        ({"tilted_deg": 0.0}, "expected a board that is tilted by a few degrees"),
        ({"behind_m": 1.01}, "expected a board clearly before a wall"),
        ({"shifted_m": 0.25}, "whose left and right edge are in the image"),
    ],
)
def test_a_board_whose_edges_cannot_be_measured_is_refused(how, message):
    with pytest.raises(InputError, match=message):
        recorded(frames=2, **how).checked()
