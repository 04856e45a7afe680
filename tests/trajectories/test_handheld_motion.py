"""The generator of hand-held motion: laws of its spline, pace and noise; recipes are checked; the
command.
"""

import json

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry import handheld
from iclnuim.geometry.handheld import Recipe
from iclnuim.geometry.handheld_parts import BandNoise, EasedProgress, NaturalSpline
from iclnuim.headless import cli
from scipy.interpolate import CubicSpline


@pytest.mark.parametrize("count", [2, 3, 4, 17])
def test_the_spline_is_the_natural_one_of_scipy(count):
    rng = np.random.default_rng(count)
    knots = np.cumsum(rng.uniform(0.1, 2.0, count))
    values = rng.normal(size=(count, 6))
    at = np.linspace(knots[0], knots[-1], 301)
    expected = CubicSpline(knots, values, bc_type="natural")(at)
    assert NaturalSpline(knots, values).at(at) == pytest.approx(expected, abs=1e-12)


def test_the_pace_never_goes_back_reaches_every_stop_and_rests_there():
    legs, dwells_s, times_s = (
        np.array([1.0, 3.0, 0.5]),
        np.array([1.0, 2.0, 0.0, 3.0]),
        np.arange(0, 20, 0.01),
    )
    progress = EasedProgress(legs, dwells_s, 0.8, times_s[-1]).at(times_s)
    assert (np.diff(progress) > -1e-12).all()
    assert progress[[0, -1]] == pytest.approx([0, legs.sum()], abs=1e-9)
    # a start and a stop take their time from the rest between them
    for place, rest_s in ((0.0, 1.0), (1.0, 2.0 - 0.8), (4.5, 3.0)):
        assert (np.abs(progress - place) < 1e-9).sum() * 0.01 == pytest.approx(rest_s, abs=0.05)
    acceleration = np.diff(progress, 2) / 0.01**2
    assert np.abs(np.diff(acceleration)).max() < 0.05, "the speed changes smoothly"


def test_a_pace_without_time_to_move_is_refused():
    with pytest.raises(InputError, match=r"dwells shorter than the whole, found 9.0 of 9.9 s"):
        EasedProgress(np.array([1.0]), np.array([4.0, 5.0]), 1.0, 9.9)


@pytest.mark.parametrize("slope", [0.0, 1.0, 2.5])
def test_noise_has_rms_1_stays_in_its_band_and_falls_with_frequency(slope):
    noise = BandNoise.drawn(3000, 30.0, (1.0, 12.0), slope, 2, np.random.default_rng(3)).of_frames()
    assert np.sqrt((noise**2).mean(axis=0)) == pytest.approx([1, 1], abs=1e-12)
    frequency, power = np.fft.rfftfreq(3000, 1 / 30), np.abs(np.fft.rfft(noise, axis=0)) ** 2
    inside = (frequency >= 1.0) & (frequency <= 12.0)
    assert power[~inside].max() < 1e-20 * power.max()
    fitted = np.polyfit(np.log(frequency[inside]), np.log(power[inside, 0]), 1)[0]
    assert fitted == pytest.approx(-slope, abs=1e-6)
    assert abs(np.corrcoef(noise.T)[0, 1]) < 0.3


def test_a_band_that_the_series_cannot_hold_is_refused():
    with pytest.raises(
        InputError, match="a band that contains a frequency of 20 frames, found 0.1..0.5 Hz"
    ):
        BandNoise.drawn(20, 30.0, (0.1, 0.5), 1.0, 3, np.random.default_rng(0))


def still(recipe):
    """The recipe without any shake."""
    for shake in recipe["shakes"]:
        shake["position_mm"] = shake["rotation_deg"] = 0.0
    return recipe


def test_without_shake_it_looks_at_what_the_recipe_says_from_where_it_says(recipe_of):
    recipe = still(recipe_of("office/kt3"))
    recipe["length_m"] = 7.5
    made = handheld.make(Recipe.from_dict(recipe))
    for first_or_last, viewpoint in ((0, recipe["viewpoints"][0]), (-1, recipe["viewpoints"][-1])):
        pose = made.trajectory.T_world_camera[np.arange(len(made.trajectory))[first_or_last]]
        gaze = np.subtract(viewpoint["look_at_m"], viewpoint["position_m"])
        assert pose.rotation[:, 2] == pytest.approx(gaze / np.linalg.norm(gaze), abs=1e-9)
        assert pose.rotation[2, 0] == pytest.approx(0, abs=1e-9), "no roll"
        assert pose.rotation[2, 1] < 0, "the image is upright"
        centre = np.mean([v["position_m"] for v in recipe["viewpoints"]], axis=0)
        assert pose.translation == pytest.approx(
            centre + made.scale * (viewpoint["position_m"] - centre), abs=1e-9
        )


@pytest.mark.parametrize("seed", [0, 7])
def test_another_seed_keeps_the_length_and_changes_the_shake(recipe_of, seed):
    recipe = recipe_of("living_room/kt2")
    shipped = handheld.make(Recipe.from_dict(recipe)).trajectory
    other = handheld.make(Recipe.from_dict({**recipe, "seed": seed})).trajectory
    assert other.length_m() == pytest.approx(8.43, abs=1e-3)
    apart_m = np.linalg.norm(other.positions_m - shipped.positions_m, axis=1)
    assert 0.003 < np.median(apart_m) < 0.06


def changed(recipe, place, value):
    """The recipe with the entry at `place` (keys and indices) set to `value`."""
    inner = recipe
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return recipe


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (["speed"], 1, "expected a recipe: scene, about, .*, found speed"),
        (
            ["viewpoints", 2, "lookat_m"],
            [0, 0, 0],
            r"viewpoints\[2\]: expected a viewpoint: position_m, .*, found lookat_m",
        ),
        (
            ["viewpoints", 1, "position_m"],
            [0, 0],
            r"viewpoints\[1\]: expected position_m of a viewpoint as 3 numbers, found \[0, 0\]",
        ),
        (
            ["viewpoints", 1, "hurry"],
            99,
            r"viewpoints\[1\]: expected hurry of a viewpoint as a number in 0.1..10, found 99",
        ),
        (
            ["frames"],
            12.5,
            "expected frames of a recipe as a whole number in 2..1000000, found 12.5",
        ),
        (
            ["frames"],
            True,
            "expected frames of a recipe as a whole number in 2..1000000, found True",
        ),
        (["frames"], 1, "expected frames of a recipe as a whole number in 2..1000000, found 1"),
        (
            ["seed"],
            "one",
            "expected seed of a recipe as a whole number in 0..9223372036854775807, found one",
        ),
        (
            ["pace", "ease_s"],
            float("nan"),
            r"pace: expected ease_s of a pace as a number in 0.001..1e\+09 \(s\), found nan",
        ),
        (
            ["shakes", 0, "high_hz"],
            16,
            r"shakes\[0\]: expected a band within 0..15 Hz, found 0.25..16 Hz",
        ),
        (["schema_version"], 2, "expected schema_version 1, found 2"),
        (
            ["length_m"],
            99.0,
            "expected viewpoints on a trajectory of about 99 m, found .* m at scales 0.85..1.15",
        ),
        (["viewpoints", 0, "look_at_m"], [0.3, -2.2, 9.0], ""),
    ],
)
def test_a_recipe_that_is_wrong_is_refused_in_one_line(recipe_of, place, value, message):
    recipe = changed(recipe_of("living_room/kt0"), place, value)
    if not message:
        recipe["viewpoints"][0]["position_m"] = [0.3, -2.2, 1.0]
        message = "expected look_at_m not directly above or below position_m, found viewpoint 0"
    with pytest.raises(InputError, match=message) as refused:
        handheld.make(Recipe.from_dict(recipe))
    assert "\n" not in str(refused.value)


def test_a_missing_key_and_an_ambiguous_turn_are_named(recipe_of):
    recipe = recipe_of("living_room/kt0")
    del recipe["pace"]["turn_deg_s"]
    with pytest.raises(InputError, match="pace: expected a pace with turn_deg_s, found none"):
        Recipe.from_dict(recipe)
    recipe = recipe_of("living_room/kt0")
    recipe["viewpoints"][3]["look_at_m"] = [-0.7, -9.0, 1.5]
    with pytest.raises(
        InputError,
        match="expected rotations of at most 150 degrees between viewpoints, found .* degrees before viewpoint",
    ):
        handheld.make(Recipe.from_dict(recipe))


def test_mutated_recipes_are_made_or_refused_and_nothing_else(recipe_of):
    rng = np.random.default_rng(5)
    odd = [
        None,
        True,
        -1,
        0,
        1e-320,
        1e308,
        10**400,
        float("inf"),
        "",
        "x",
        [],
        {},
        [1, 2, 3],
        3,
        0.5,
    ]
    made = 0
    for _ in range(400):
        recipe = recipe_of("living_room/kt1")
        for _ in range(rng.integers(1, 3)):
            inner = recipe
            while rng.random() < 0.8 and isinstance(inner, dict | list) and inner:
                keys = list(inner) if isinstance(inner, dict) else range(len(inner))
                key = keys[int(rng.integers(len(keys)))]
                if not isinstance(inner[key], dict | list) or rng.random() < 0.2:
                    inner[key] = odd[rng.integers(len(odd))]
                    break
                inner = inner[key]
        try:
            motion = handheld.make(Recipe.from_dict(recipe))
        except InputError:
            continue
        made += 1
        assert np.isfinite(motion.trajectory.positions_m).all()
        assert np.isfinite(motion.trajectory.T_world_camera.rotation).all()
    assert made > 0


def test_the_command_makes_checks_and_says_what_is_other(repository, tmp_path, capsys):
    assert cli.main(["trajectory", "make", "--check", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)["trajectories"]
    assert [f["frames"] for f in figures] == [*([1510, 967, 882, 1242] * 2), 882]
    assert cli.main(["trajectory", "make", "kt1", "--out", str(tmp_path)]) == 0
    made = tmp_path / "living_room/kt1.txt"
    assert made.read_bytes() == (repository / "trajectories/living_room/kt1.txt").read_bytes()
    made.write_text(made.read_text().replace("1", "2", 1))
    assert cli.main(["trajectory", "make", "kt1", "--out", str(tmp_path), "--check"]) == 3
    assert "kt1.txt: differs from the trajectory that its recipe makes" in capsys.readouterr().err
    assert cli.main(["trajectory", "make", "office/kt1", "--out", str(tmp_path), "--check"]) == 3
    assert "does not exist" in capsys.readouterr().err


def test_the_command_takes_ones_own_recipe_and_refuses_other_things(recipe_of, tmp_path, capsys):
    own = tmp_path / "mine.json"
    own.write_text(json.dumps({**recipe_of("office/kt2"), "seed": 9}))
    assert cli.main(["trajectory", "make", str(own)]) == 0
    assert len((tmp_path / "mine.txt").read_text().splitlines()) == 883
    own.write_text(json.dumps({**recipe_of("office/kt2"), "speed": 9}))
    assert cli.main(["trajectory", "make", str(own)]) == 2
    assert f"{own}: expected a recipe: scene" in capsys.readouterr().err
    for name, said in (
        ("kt9", "expected one of living_room/kt0"),
        ("no.json", "found no such file"),
    ):
        assert cli.main(["trajectory", "make", name]) == 2
        assert said in capsys.readouterr().err
