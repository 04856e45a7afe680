"""The registry of rendered channels: what a job has, how it is stored and read, what is lost."""

import numpy as np
import pytest
from iclnuim.channels import BASE, CHANNELS, FURTHER, exr_bytes, exr_types, further_of
from iclnuim.errors import InputError
from iclnuim.job import RenderJob


def names(channels):
    return [channel.name for channel in channels]


def job(**settings):
    return RenderJob(sequence="x", scene="living_room", trajectory="living_room/kt2", **settings)


def test_a_frame_has_half_colour_and_float_depth_and_with_ground_truth_four_more_floats():
    assert exr_bytes(BASE) == 3 * 2 + 4
    assert exr_bytes((*BASE, *job(ground_truth=True).further)) == 3 * 2 + 4 + 4 * 4
    assert list(exr_types(job(channels=("class",)).further)) == ["instance"]


def test_a_job_has_the_channels_of_ground_truth_and_those_it_names_each_once():
    assert names(job().further) == []
    assert names(job(ground_truth=True).further) == ["instance", "class", "normal"]
    chosen = job(channels=["normal", "instance", "normal"])
    assert chosen.channels == ("instance", "normal")
    assert (
        job(ground_truth=True, channels=("normal",)).to_dict() == job(ground_truth=True).to_dict()
    )
    assert RenderJob.from_dict(chosen.to_dict()) == chosen
    assert names(further_of(chosen.to_dict())) == ["instance", "normal"]
    with pytest.raises(InputError, match="one of instance, class, normal"):
        job(channels=("flow",))


def test_only_a_job_with_channels_has_them_in_its_recipe():
    assert "channels" not in job().to_dict()
    assert job(channels=("normal",)).to_dict()["channels"] == ["normal"]


@pytest.mark.parametrize("name", CHANNELS)
def test_what_is_stored_in_a_sequence_is_equal_to_the_frame_within_the_tolerance(name):
    """The noise model converts colour to 8 bits."""
    from iclnuim.sensor.transfer import srgb8

    rng = np.random.default_rng(1)
    exr = {c: rng.uniform(0.05, 1, (20, 30)).astype(np.float16) for c in "RGB"}
    exr["Z"] = rng.uniform(0.5, 5, (20, 30)).astype(np.float32)
    exr["instance"] = rng.integers(0, 30, (20, 30)).astype(np.float32)
    normal = rng.normal(size=(20, 30, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    exr |= {f"normal.{c}": normal[..., k].astype(np.float32) for k, c in enumerate("XYZ")}
    channel = CHANNELS[name]
    image = channel.read(exr, lambda: np.arange(100, dtype=np.uint16)[::-1])
    stored = channel.encode(srgb8(image) if name == "rgb" else image, 5000.0)
    assert stored.dtype in (np.uint8, np.uint16)
    back = channel.decode(stored, 5000.0)
    assert np.abs(back - channel.displayed(image)).max() <= (channel.tolerance or 0)
    if name == "class":
        assert np.array_equal(stored, 99 - exr["instance"])


def test_a_format_says_what_it_loses_of_colour_and_depth():
    assert CHANNELS["rgb"].loss(".png", 5000.0, 5000.0) == ""
    assert CHANNELS["rgb"].loss(".jpg", 5000.0, 5000.0) == "colour is stored as JPEG, with loss"
    assert "1000 units per metre; the source has 5000" in CHANNELS["depth"].loss(
        ".png", 1000.0, 5000.0
    )
    assert CHANNELS["depth"].loss(".npy", 1000.0, 5000.0) == ""
    assert not any(channel.loss(".png", 1000.0, 5000.0) for channel in FURTHER.values())
