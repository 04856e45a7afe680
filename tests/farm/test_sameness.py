"""`iclnuim compare`: bytes on one kind of processor, tolerance across kinds, and it says which and why."""

import json

import numpy as np
import pytest
from iclnuim.dataset.run_folder import load_trajectory, open_run
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.cli import main
from iclnuim.job import shipped_job

RNG = np.random.default_rng(5)
RGB, Z_M = RNG.uniform(0, 1, (30, 40, 3)), RNG.uniform(1, 4, (30, 40))


@pytest.fixture
def run(tmp_path):
    def make(name, rgb=RGB, depth_z_m=Z_M, features=("avx2",), numbers=(0, 1)):
        job = shipped_job("kt2").changed(camera=PinholeCamera.parse("40x30"))
        recipe = {"job": job.to_dict(), "blender": "4.5", "machine": {"features": list(features)}}
        run = open_run(tmp_path / name, recipe, load_trajectory(job))
        for number in numbers:
            run.write_frame(number, rgb, depth_z_m)
        return str(run.path)

    return make


def told(capsys, *arguments):
    code = main(["compare", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_equal_frames_of_one_kind_are_equal_to_the_byte(run, capsys):
    code, values = told(capsys, run("a"), run("b"))
    assert code == 0 and values["same"] and values["by_bytes"] and values["files"] == 2


def test_one_rounding_is_a_difference_on_one_kind_of_processor_and_none_across_kinds(run, capsys):
    a, b = run("a"), run("b", depth_z_m=Z_M + 1e-5)
    code, values = told(capsys, a, b)
    assert code == 3 and values["different"] == ["exr/000000.exr", "exr/000001.exr"]
    code, values = told(capsys, a, run("c", depth_z_m=Z_M + 1e-5, features=("avx2", "avx512f")))
    assert code == 0 and not values["by_bytes"] and values["why"] == "processor features: avx2 and avx2 avx512f"
    assert told(capsys, a, b, "--tolerance")[0] == 0


@pytest.mark.parametrize("change", [{"depth_z_m": Z_M + 0.002}, {"rgb": RGB * 0.9}])
def test_more_than_the_tolerance_is_a_difference_across_kinds_too(run, capsys, change):
    code, values = told(capsys, run("a"), run("b", features=("sse4_2",), **change))
    assert code == 3 and len(values["different"]) == 2 and values["largest_share"] > 0.5


def test_a_frame_that_only_one_has_is_named(run, capsys):
    code, values = told(capsys, run("a"), run("b", numbers=(0,)))
    assert code == 3 and values["only_in_one"] == ["exr/000001.exr"]


def test_a_folder_without_recipe_is_bad_input(run, tmp_path, capsys):
    assert main(["compare", run("a"), str(tmp_path)]) == 2
    assert "expected a run (sequence.json) or a sequence" in capsys.readouterr().err
