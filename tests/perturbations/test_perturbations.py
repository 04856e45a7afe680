"""Every perturbation does what its numbers say, to the same bytes in any order."""

import numpy as np
import pytest
from iclnuim import noisy_depth, noisy_rgb
from iclnuim.benchmark.perturbations.motion import Shift
from iclnuim.benchmark.perturbations.plan import FILE, FUNCTIONS, read_plan
from iclnuim.errors import InputError
from iclnuim.sensor.transfer import linear_from_srgb8

PLAN = read_plan()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_perturbed_frame_is_the_same_whenever_it_is_made_and_the_original_stays(segment, name):
    number = segment.numbers[24]
    before = [image.copy() for image in segment.load(number)]
    perturbed = PLAN.apply(name, 4, segment)
    perturbed.load(segment.numbers[3])
    colour, depth_z_m = perturbed.load(number)
    again = PLAN.apply(name, 4, segment).load(number)
    assert (colour.dtype, colour.shape) == (np.uint8, before[0].shape)
    assert (depth_z_m.dtype, depth_z_m.shape) == (np.float32, before[1].shape)
    assert np.isfinite(depth_z_m).all() and (depth_z_m >= 0).all()
    assert all(np.array_equal(a, b) for a, b in zip((colour, depth_z_m), again, strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(segment.load(number), before, strict=True))


def test_there_are_twenty_perturbations_and_more_each_with_five_severities_of_its_own():
    assert len(PLAN.perturbations) >= 20 and set(PLAN.perturbations) == set(FUNCTIONS)
    for name, p in PLAN.perturbations.items():
        steps = np.diff(p.levels)
        assert (steps > 0).all() or (steps < 0).all(), name


def test_noise_once_is_that_of_the_library(segment):
    number = segment.numbers[2]
    colour, depth_z_m = PLAN.apply("noise", 2, segment).load(number)
    clean, true_m = segment.load(number)
    assert PLAN.perturbations["noise"].levels[1] == 1
    assert np.array_equal(depth_z_m, noisy_depth(true_m, "released", segment.camera, 3, number))
    assert np.array_equal(colour, noisy_rgb(linear_from_srgb8(clean), "released", 3, number))


def test_what_is_seen_between_frames_is_what_the_scene_shows_there(segment, look_at):
    """The judge is the analytic box, a third of a frame later."""
    number = segment.numbers[10]
    stamp_s = segment.stamps_s[number] + 0.011
    shift = Shift.between(segment, number, stamp_s)
    true_colour, depth_z_m = look_at(stamp_s)
    colour, seen_m = shift.colour(segment.load(number)[0]), shift.depth(segment.load(number)[1])
    inside = (slice(4, -4), slice(4, -4))
    assert np.median(np.abs(colour.astype(int) - true_colour)[inside]) <= 1
    assert np.percentile(np.abs(seen_m - depth_z_m)[inside], 95) < 0.01
    assert (
        np.abs(segment.load(number)[1] - depth_z_m)[inside].mean()
        > 3 * np.abs(seen_m - depth_z_m)[inside].mean()
    )


@pytest.mark.parametrize(("name", "severity"), [("rolling_shutter", 5), ("out_of_step", 3)])
def test_rows_and_streams_show_their_own_instants(segment, look_at, name, severity):
    number = segment.numbers[20]
    colour, depth_z_m = PLAN.apply(name, severity, segment).load(number)
    level_s = PLAN.perturbations[name].levels[severity - 1] / 1e3
    for row in (10, 110):
        rolled_s = ((row + 0.5) / 120 - 0.5) * level_s
        true_colour, true_m = look_at(
            segment.stamps_s[number] + (rolled_s if name == "rolling_shutter" else level_s)
        )
        assert np.median(np.abs(colour[row].astype(int) - true_colour[row])) <= 1
        if name == "rolling_shutter":
            assert np.median(np.abs(depth_z_m[row] - true_m[row])) < 0.005


def test_a_file_that_does_not_fit_is_refused_with_its_place(tmp_path):
    text, path = FILE.read_text(), tmp_path / "perturbations.toml"
    for old, new, message in (
        ("levels = [4, 5, 6, 7, 8]", "levels = [4, 5, 6, 7]", "expected 5 levels, found 4"),
        ("[perturbations.speed]", "[perturbations.haste]", "found haste"),
        ("frames = 120", "frames = ", "expected TOML"),
    ):
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(InputError) as error:
            read_plan(path)
        assert message in str(error.value)


def test_a_short_sequence_has_stretches_of_its_own():
    assert PLAN.starts_of("living_room/kt2", 882) == PLAN.starts["living_room/kt2"]
    assert PLAN.starts_of("living_room/kt2", PLAN.frames + 60) == [6, 27, 48]
    assert PLAN.starts_of("living_room/kt2", PLAN.frames) == [0]
