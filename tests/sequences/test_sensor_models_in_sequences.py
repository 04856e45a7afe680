"""A model that sees colour gets the frame's light, the same in folders as in Python."""

import iclnuim
import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.models import DEPTH_MODELS, depth_model, rgb_model
from iclnuim.sequences.frame_images import noisy_metres
from iclnuim.sequences.sequence_options import SequenceSettings

CAMERA = PinholeCamera.parse("160x120")
ASKING = [name for name, model in DEPTH_MODELS.items() if model.asks_appearance]


def frame():
    """Depth of a near square before a wall, and colour with a black half."""
    depth = np.full((120, 160), 2.5, np.float32)
    depth[40:80, 60:90] = 1.0
    light = np.full((120, 160, 3), 0.4, np.float32)
    light[:, 100:] = 0.002
    return depth, light


@pytest.mark.parametrize("name", ASKING)
def test_sequences_and_arrays_have_the_same_depth_whatever_the_exposure(name):
    depth, light = frame()
    settings = SequenceSettings(depth_model(name), rgb_model("paper", {"exposure": 3.0}), seed=5)
    in_sequence = noisy_metres(light, depth, CAMERA, 8, settings).depth_z_m
    alone = iclnuim.noisy_depth(depth, name, CAMERA, seed=5, frame=8, rgb=light)
    assert in_sequence.tobytes() == alone.tobytes()
    dark, bright = in_sequence[:, 110:150], in_sequence[:, 20:50]
    assert (dark > 0).mean() < (bright > 0).mean()


@pytest.mark.parametrize("name", ASKING)
def test_light_that_is_no_number_or_infinite_spoils_nothing_else(name):
    depth, light = frame()
    alone = iclnuim.noisy_depth(depth, name, CAMERA, seed=5, rgb=light)
    light[5, 5] = np.nan
    light[5, 9] = np.inf
    odd = iclnuim.noisy_depth(depth, name, CAMERA, seed=5, rgb=light)
    assert np.isfinite(odd).all() and (odd[40:] == alone[40:]).all()


def test_colour_in_another_unit_is_refused_or_doubted():
    depth, light = frame()
    with pytest.raises(InputError, match="colour as floating-point numbers or uint8, found int64"):
        iclnuim.noisy_depth(depth, "d435", CAMERA, rgb=(255 * light).astype(int))
    with pytest.warns(UserWarning, match="scene-linear RGB has 1 = white"):
        iclnuim.noisy_depth(depth, "d435", CAMERA, rgb=255 * np.maximum(light, 0.4))


@pytest.mark.parametrize("name", DEPTH_MODELS)
def test_a_batch_has_the_bytes_of_its_frames_and_a_seed_the_same_noise(name):
    depth, light = frame()
    batch, lights = np.stack([depth, 2 * depth]), np.stack([light, light])
    noisy = iclnuim.noisy_depth(batch, name, CAMERA, seed=3, frame=6, rgb=lights)
    for k, image in enumerate(batch):
        alone = iclnuim.noisy_depth(image, name, CAMERA, seed=3, frame=6 + k, rgb=light)
        assert noisy[k].tobytes() == alone.tobytes()
    if name != "none":
        other = iclnuim.noisy_depth(batch, name, CAMERA, seed=4, frame=6, rgb=lights)
        assert (noisy != other).any((1, 2)).all()
