"""Settings are declared once: checks, JSON, options and the docs' table come from the declaration."""

import argparse
import json
import pickle
import subprocess
import sys
from dataclasses import dataclass

import pytest
from iclnuim.errors import InputError, WorkError, named
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.headless.cli import main
from iclnuim.headless.options import add_settings, option_name, settings_from
from iclnuim.job import RenderJob, shipped_job
from iclnuim.sensor.models import DEPTH_MODELS, RGB_MODELS
from iclnuim.sequences.sequence_options import SequenceOptions
from iclnuim.settings import Settings, declared, setting
from iclnuim.tools.write_settings_page import table
from patience import patience


@dataclass(frozen=True)
class Example(Settings):
    """One setting of each kind."""

    size: int = setting(2048, "side of the map", unit="texels", low=16, high=16384)
    rate_hz: float = setting(
        30.0, "frames a second", unit="Hz", low=0.0, source="paper, section III"
    )
    sharp: bool = setting(False, "no filter")
    smooth: bool = setting(True, "with a filter")
    method: str = setting("se3", "how", choices={"se3": "rigid", "sim3": "with scale"})
    sigma: tuple[float, float, float] = setting((1.0, 2.0, 3.0), "of each channel", low=0.0)
    limit: int | None = setting(None, "at most so many; all by default", low=1, option="--at-most")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"size": 15}, "size: expected a whole number in 16..16384 (texels), found 15"),
        ({"size": 20.0}, "size: expected a whole number in 16..16384 (texels), found 20.0"),
        ({"size": True}, "size: expected a whole number in 16..16384 (texels), found True"),
        ({"rate_hz": float("nan")}, "rate_hz: expected a number of 0 or more (Hz), found nan"),
        ({"rate_hz": float("inf")}, "rate_hz: expected a number of 0 or more (Hz), found inf"),
        ({"sharp": 1}, "sharp: expected true or false, found 1"),
        ({"method": "affine"}, "method: expected one of se3, sim3, found affine"),
        ({"method": []}, "method: expected one of se3, sim3, found []"),
        ({"method": {"se3": 1}}, "method: expected one of se3, sim3, found {'se3': 1}"),
        ({"sigma": (1, 2)}, "sigma: expected 3 numbers, found (1, 2)"),
        ({"limit": 0}, "limit: expected a whole number of 1 or more, found 0"),
        (
            {"colour": 1},
            "expected settings: size, rate_hz, sharp, smooth, method, sigma, limit, found colour",
        ),
    ],
)
def test_what_does_not_fit_is_refused_by_name(values, message):
    with pytest.raises(InputError) as error:
        Example.from_dict(values)
    assert str(error.value) == message


def test_json_goes_both_ways():
    made = Example(size=64, sigma=(0, 1, 2), limit=3)
    assert Example.from_dict(made.to_dict()) == made
    assert made.to_dict()["sigma"] == [0.0, 1.0, 2.0]


def test_whole_numbers_become_the_settings_type():
    assert isinstance(Example(rate_hz=15).rate_hz, float)


def test_options_are_made_of_the_declaration():
    parser = argparse.ArgumentParser()
    add_settings(parser, Example)
    args = parser.parse_args(
        [
            "--size",
            "32",
            "--no-smooth",
            "--sharp",
            "--method",
            "sim3",
            "--sigma",
            "4",
            "5",
            "6",
            "--at-most",
            "7",
        ]
    )
    assert settings_from(args, Example(rate_hz=60.0)) == Example(
        32, 60.0, True, False, "sim3", (4, 5, 6), 7
    )
    assert settings_from(parser.parse_args([]), Example(size=99)) == Example(size=99)
    text = " ".join(parser.format_help().split())
    assert "side of the map (texels); default: 2048" in text


def test_a_value_that_does_not_fit_names_its_option():
    parser = argparse.ArgumentParser()
    add_settings(parser, Example)
    for given, message in (
        (["--at-most", "0"], "--at-most: expected a whole number of 1 or more, found 0"),
        (["--method", "affine"], "--method: expected one of se3, sim3, found affine"),
    ):
        with pytest.raises(InputError) as error:
            settings_from(parser.parse_args(given), Example())
        assert error.value.worded(option_name) == message


def test_an_error_names_the_option_on_the_command_line():
    with pytest.raises(InputError) as error:
        Example(rate_hz=-1)
    assert error.value.worded(option_name).startswith("--rate-hz: expected a number")
    hinted = InputError("a sequence, or {scene} and {trajectory}", hint="{frames} 0:10")
    assert (
        hinted.worded(option_name)
        == "expected a sequence, or --scene and --trajectory; try --frames 0:10"
    )
    assert str(pickle.loads(pickle.dumps(error.value))) == str(error.value)


def test_work_that_failed_names_options_in_its_hint_here_and_from_another_process():
    error = WorkError("no space", hint="fewer {frames} or another {out}")
    assert str(error) == "no space; try fewer frames or another out"
    assert error.worded(option_name) == named(error.template, option_name)
    assert error.worded(option_name) == "no space; try fewer --frames or another --out"
    assert pickle.loads(pickle.dumps(error)).worded(option_name) == error.worded(option_name)


def test_the_table_names_every_setting():
    lines = table(list(declared(Example).values()), []).splitlines()
    assert len(lines) == 2 + len(declared(Example))
    assert lines[2] == "| `size` | `--size` | `2048` | 16..16384 texels | side of the map |"
    assert "| `--at-most` |" in lines[-1]


def test_a_job_checks_and_keeps_its_settings_as_recipes_have_them():
    job = shipped_job("kt2")
    content = job.to_dict()
    assert list(content) == [
        "schema_version", "sequence", "scene", "trajectory", "camera", "light", "samples", "denoise", "antialias", "mipmaps",
        "lambertian", "map_size", "map_samples", "seed", "exposure_s", "readout_s",
    ]  # fmt: skip
    whole = {
        **content,
        "exposure_s": 0,
        "reading": {"up": "y", "unit_m": 0.01},
        "ground_truth": True,
    }
    assert json.dumps(RenderJob.from_dict(whole).to_dict()) == json.dumps(whole)
    with pytest.raises(
        InputError, match=r"map_samples: expected a whole number in 2\.\.65536, found 1"
    ):
        job.changed(map_samples=1)
    assert (job.changed(light="path").samples, job.changed(light="path").denoise) == (64, True)


def test_one_sample_of_the_light_map_is_refused_before_anything_is_opened(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["render", "kt2", "--map-samples", "1", "--out", str(out)]) == 2
    assert "--map-samples: expected a whole number in 2..65536, found 1" in capsys.readouterr().err
    assert not out.exists()


def test_a_scenes_unit_is_a_name_or_metres():
    parser = argparse.ArgumentParser()
    add_settings(parser, SceneReading)
    read = settings_from(
        parser.parse_args(["--scene-unit", "cm", "--up=-y"]), SceneReading(mirror="x")
    )
    assert read == SceneReading("-y", 0.01, "x")
    assert option_name("unit_m") == "--scene-unit" and option_name("exposure_s") == "--exposure"


def test_a_sequences_options_read_the_registries_and_make_the_settings():
    listed = declared(SequenceOptions)
    assert set(listed["depth_noise"].choices) == set(DEPTH_MODELS) and set(
        listed["rgb_noise"].choices
    ) == set(RGB_MODELS)
    assert all(listed["depth_noise"].choices.values())
    options = SequenceOptions.from_dict(
        {"depth_noise": "redwood", "seed": 4, "formats": ["tum", "nerf"]}
    )
    assert SequenceOptions.from_dict(json.loads(json.dumps(options.to_dict()))) == options
    assert (options.sequence_settings().depth.name, options.without_noise().depth.name) == (
        "redwood",
        "none",
    )
    assert SequenceOptions(depth_noise="mine:noise").depth_noise == "mine:noise"
    for wrong in (
        {"formats": []},
        {"formats": ["tune"]},
        {"depth_settings": 3},
        {"depth_units": 0},
    ):
        with pytest.raises(InputError):
            SequenceOptions.from_dict(wrong)
    parser = argparse.ArgumentParser()
    add_settings(parser, SequenceOptions, ("formats",))
    assert settings_from(
        parser.parse_args(["--format", "tum", "--format", "nerf"]), options
    ).formats == ("tum", "nerf")


def test_the_page_of_settings_is_written_from_the_declarations(repository):
    pytest.importorskip(
        "numba", reason="the settings of odometers are declared beside compiled loops"
    )
    words = [sys.executable, str(repository / "tools/write_settings_page.py"), "--check"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=patience(120))
    assert done.returncode == 0, done.stdout + done.stderr
